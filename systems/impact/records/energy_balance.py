"""Where the energy of a motion comes from, and where it goes, by element."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import EventKind, Regime
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.records.second_moments import (
    MOST_NODES,
    intervals,
    nodes_needed,
    quadrature,
)

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.simulation.trajectory import Trajectory


@final
@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Work and dissipated energy of a motion, from its start to its last impact.

    Attributes
    ----------
    change : float
        Of the kinetic and elastic energy of the structure.
    work : dict of str to float
        Done on the structure: by ``forces``, by ``damping`` (its dashpots), and by each element,
        under the name of its parameters. Their sum is the change, but for the error.
    dissipated : dict of str to float
        What becomes heat, in dashpots and elements: what these do not give back, nor take from
        their own motion. Of a chatter all that is left out is a stop's. While friction sticks
        together the share of each is open: they have the least forces, as a sum of squares.
    error : float
        By how much the work misses the change, or what rounding makes of their terms.
    cost : Cost
        Seconds; events, and nodes of quadrature.
    """

    change: float
    work: dict[str, float]
    dissipated: dict[str, float]
    error: float
    cost: Cost

    def __repr__(self) -> str:
        lost = sum(self.dissipated.values())
        return f"<EnergyBalance: {self.change:.6g}, dissipated {lost:.6g}, error {self.error:.1e}>"


@final
class _Sums:
    """Sums of work and of what is dissipated, by name, and of absolute terms."""

    def __init__(self, names: list[str]) -> None:
        self.work = dict.fromkeys(["forces", "damping", *names], 0.0)
        self.dissipated = dict.fromkeys(["damping", *names], 0.0)
        self.size = 0.0

    def add(self, name: str, work: Array, dissipated: Any = None) -> None:
        """Add terms, (k,)."""
        self.work[name] += float(work.sum())
        self.size += float(abs(work).sum())
        if dissipated is not None:
            self.dissipated[name] += float(np.sum(dissipated))


def energy_balance(system: ImpactMap, run: Trajectory) -> EnergyBalance:
    """The balance of a run from its start to its last impact, which must be later."""
    began = time.perf_counter()
    names, parts = element_names(system), system._automaton.parts
    sums, nodes, modes = _Sums(names), 0, system._automaton.modes
    for part in intervals(run):
        regimes = parts.now(run.regimes[modes.index(part.mode)])
        count = nodes_needed(part)
        if count is None:
            raise ValueError(f"record must not need more than {MOST_NODES} nodes of quadrature")
        for _, weights, states in quadrature(part):
            _flights(
                system, part.mode, dict(zip(names, regimes, strict=True)), weights, states, sums
            )
        nodes += count
    events = _impacts(system, run, names, sums)
    s = run.segments
    last = int(np.searchsorted(s.point, run.impacts))
    first = min(int(np.searchsorted(s.begin, 0.0, side="right")) - 1, last)
    energies = []
    for i, sign in ((first, 1.0), (last, -1.0)):
        (mode, _) = next(run.modes(s.mode[[i]]))
        x, v = mode.motion(s.of(mode, [i]))
        energies.append(0.5 * float(v[0] @ system.mass @ v[0] + x[0] @ system.stiffness @ x[0]))
        # Springs of elements may be pressed as the motion begins, and as it ends.
        regimes = parts.now(run.regimes[int(s.mode[i])])
        for k, (name, regime) in enumerate(zip(names, regimes, strict=True)):
            spring = system._elements[k].spring or regime.stiffness
            gap = float(_gap(system, mode, k, s.of(mode, [i]))[0][0])
            sums.dissipated[name] += sign * 0.5 * spring * gap**2
    change = energies[1] - energies[0]
    rounding = 2.0**-50 * (sums.size + sum(energies))
    missed = abs(change - sum(sums.work.values()))
    cost = Cost(time.perf_counter() - began, {"events": events, "nodes": nodes})
    return EnergyBalance(change, sums.work, sums.dissipated, max(missed, rounding), cost)


def _gap(system: ImpactMap, mode: Mode, number: int, states: Array) -> tuple[Array, Array, Array]:
    """Of states gaps, their rates, and how fast the element itself moves, towards its side.

    With a slider, by how much it is behind in place of the gap.
    """
    x, v = mode.motion(states)
    _, sine, cosine = mode.parts(states)
    element, slider = system._elements[number], system._automaton.sliders.get(number)
    row, sign = element.row(x.shape[1]), element.sign
    own = element.swing_rate(system.frequency, sine, cosine) + element.drift
    place = element.offset + element.swing(sine, cosine)
    if slider is not None:
        place = mode.sliders(states)[:, slider - mode.bodies]
    gap = x @ row - place
    return sign * gap, sign * (v @ row - own), sign * (own + 0.0 * gap)


def _flights(
    system: ImpactMap,
    mode: Mode,
    regimes: dict[str, Regime],
    weights: Array,
    states: Array,
    sums: _Sums,
) -> None:
    """Work in one mode, where elements are in these regimes, at nodes with these weights (k,)."""
    x, v = mode.motion(states)
    _, sine, cosine = mode.parts(states)
    excitation, c = system._excitation, system.damping_matrix
    applied = np.outer(sine, excitation.harmonic.real) + np.outer(cosine, excitation.harmonic.imag)
    applied = (applied + excitation.constant)[:, : mode.bodies]
    sums.add("forces", weights * (applied * v).sum(axis=1))
    lost = weights * ((v @ c) * v).sum(axis=1)
    sums.add("damping", -lost, lost)
    left = _accelerations(mode, states) @ system.mass + v @ c + x @ system.stiffness - applied
    held = []
    for k, (name, regime) in enumerate(regimes.items()):
        gap, rate, own = _gap(system, mode, k, states)
        element = system._elements[k]
        row = element.sign * element.row(x.shape[1])
        if regime.holds or regime.sticks:
            held.append((name, row, own))
        elif regime.acts:
            force = regime.push - regime.stiffness * gap - regime.damping * rate
            sums.add(name, weights * force * (rate + own), -weights * force * rate)
            left -= np.outer(force, row)
    if held:
        rows = np.array([row for _, row, _ in held])
        for (name, _, own), force in zip(held, np.linalg.lstsq(rows.T, left.T)[0], strict=True):
            sums.add(name, weights * force * own)


def _accelerations(mode: Mode, states: Array) -> Array:
    """Accelerations (k, N) of states."""
    rates = mode.rate(states)
    return mode.motion(rates)[1] - mode.motion(0.0 * rates)[1]


def _impacts(system: ImpactMap, run: Trajectory, names: list[str], sums: _Sums) -> int:
    """Work of impacts, and of the bounces that are left out; how many there are."""
    s = run.segments
    last = int(np.searchsorted(s.point, run.impacts))
    before, after = np.zeros((2, last, system.degrees_of_freedom))
    turn = np.zeros((2, last))
    durations = np.diff(s.begin)[:last]
    for mode, here in run.modes(s.mode[:last]):
        (some,) = np.nonzero(here)
        ends = mode.after(s.of(mode, some), np.arange(len(some)), durations[some])
        before[some] = mode.motion(ends)[1]
    for mode, here in run.modes(s.mode[1 : last + 1]):
        (some,) = np.nonzero(here)
        states = s.of(mode, some + 1)
        after[some], turn[:, some] = mode.motion(states)[1], mode.parts(states)[1:]
    kinds = s.kind[1 : last + 1]
    hits = (kinds == EventKind.CONTACT) | ((kinds == EventKind.IMPACT) & (not system._strobed))
    pairs = np.stack([s.mode[:last], s.element[1 : last + 1]], axis=1)
    for number, element in np.unique(pairs[hits], axis=0).tolist():
        here = hits & (pairs == (number, element)).all(axis=1)
        held = [k for k in system._automaton.parts.grips(run.regimes[number])[0] if k != element]
        stops = [system._elements[k] for k in (element, *held)]
        rows = np.array([stop.row(before.shape[1]) for stop in stops])
        change = after[here] - before[here]
        impulse = np.linalg.lstsq(rows.T, system.mass @ change.T)[0]
        own = np.array([stop.swing_rate(system.frequency, *turn[:, here]) for stop in stops])
        work = 0.5 * ((change @ system.mass) * (after[here] + before[here])).sum(axis=1)
        sums.add(names[element], work, (impulse * own).sum(axis=0) - work)
    return int(hits.sum())
