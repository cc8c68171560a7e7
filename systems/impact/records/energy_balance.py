"""Energy balance of a motion: work and dissipation, by element."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.modes.taylor.mode import TaylorMode
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.records.observables import applied, forces_on, gap_of, jumps
from dynkit.systems.impact.records.second_moments import (
    MOST_NODES,
    Intervals,
    intervals,
    nodes_needed,
    quadrature,
)

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.simulation.trajectory import Trajectory


@final
@dataclass(frozen=True, eq=False, repr=False)
class EnergyBalance(Saved):
    """Work and dissipated energy of a motion, from its start to its last impact.

    Attributes
    ----------
    change : float
        Change of the kinetic and elastic energy of the structure.
    work : dict of str to float
        Work done on the structure by ``forces``, by ``damping`` (its dashpots), and by each element
        under its name. Their sum equals the change, to within the error.
    dissipated : dict of str to float
        Energy that becomes heat in dashpots and in each element. Energy that an element stores and
        returns, and work done by the motion of the element, are not part of it. The energy of the
        omitted bounces of a chatter is dissipated by the stop. The forces of friction elements that
        stick together are not determined; those with the least sum of squares are used.
    error : float
        Difference between the change and the sum of the work, or the rounding error of their terms
        if that is larger.
    cost : Cost
        Seconds; numbers of events and of nodes of quadrature.
    """

    _stored: ClassVar = ("change", "work", "dissipated", "error", "cost")
    change: float
    work: dict[str, float]
    dissipated: dict[str, float]
    error: float
    cost: Cost

    def __repr__(self) -> str:
        lost = sum(self.dissipated.values())
        return f"<EnergyBalance: {self.change:.6g}, dissipated {lost:.6g}, error {self.error:.1e}>"

    def dataset(self) -> Dataset:
        """Return work and dissipated energy as a dataset over ``source``."""
        lost = [self.dissipated.get(name, np.nan) for name in self.work]
        return Dataset(
            {"source": ("source", list(self.work))},
            {
                "work": ("source", list(self.work.values())),
                "dissipated": ("source", lost),
                "error": ((), self.error),
            },
            described(
                "Energy balance of a motion",
                cost=self.cost,
                error="difference between the change of energy and the sum of the work",
                change=self.change,
            ),
        )


@final
class _Sums:
    """Sums of work and of dissipated energy, by name; sum `size` of the absolute values of work."""

    def __init__(self, names: list[str]) -> None:
        self.work = dict.fromkeys(["forces", "damping", *names], 0.0)
        self.dissipated = dict.fromkeys(["damping", *names], 0.0)
        self.size = 0.0

    def add(self, name: str, work: Array, dissipated: Any = None) -> None:
        """Add terms (k,) to the work and to the dissipated energy under a name."""
        self.work[name] += float(work.sum())
        self.size += float(abs(work).sum())
        if dissipated is not None:
            self.dissipated[name] += float(np.sum(dissipated))


def energy_balance(system: ImpactMap, run: Trajectory) -> EnergyBalance:
    """The balance of a run from its start to its last impact, which must be after the start."""
    began = time.perf_counter()
    names, parts = element_names(system), system._automaton.parts
    sums, nodes, modes = _Sums(names), 0, system._automaton.modes
    for part in intervals(run):
        regimes = run.regimes[modes.index(part.mode)]
        count = nodes_needed(part)
        if count is None:
            raise ValueError(f"record must not need more than {MOST_NODES} nodes of quadrature")
        for _, weights, states in quadrature(part):
            _flights(system, part, regimes, weights, states, sums)
            nodes += len(weights)
    events = _impacts(system, run, sums)
    s = run.segments
    last = int(np.searchsorted(s.point, run.impacts))
    # the regimes of the start may be decided anew; a contact, after left-out bounces, takes energy
    starts = int(np.searchsorted(s.begin, 0.0, side="right"))
    contacts = np.flatnonzero(s.kind[1:starts] == EventKind.CONTACT)
    first = min(int(contacts[0]) if len(contacts) else starts - 1, last)
    energies = []
    mode: Any
    for i, sign in ((first, 1.0), (last, -1.0)):
        (mode, _) = next(run.modes(s.mode[[i]]))
        x, v = mode.motion(s.of(mode, [i]))
        if system._motion is not None:
            energies.append(float(mode.powers(s.of(mode, [i]))[0, 0]))
        else:
            own = v[0] @ system.mass @ v[0] + x[0] @ system.stiffness @ x[0]
            energies.append(0.5 * float(own))
        # Springs of elements may store energy at the start and at the end of the motion.
        now = parts.now(run.regimes[int(s.mode[i])])
        for k, (name, element, regime) in enumerate(zip(names, system._elements, now, strict=True)):
            spring = element.spring or regime.stiffness
            preload = 0.0 if regime.halts or element.slider else regime.push
            gap = float(gap_of(system, mode, k, s.of(mode, [i]))[0][0])
            sums.dissipated[name] += sign * (0.5 * spring * gap**2 - preload * gap)
    change = energies[1] - energies[0]
    rounding = 2.0**-50 * (sums.size + sum(map(abs, energies)))
    missed = abs(change - sum(sums.work.values()))
    cost = Cost(time.perf_counter() - began, {"events": events, "nodes": nodes})
    return EnergyBalance(change, sums.work, sums.dissipated, max(missed, rounding), cost)


def _flights(
    system: ImpactMap,
    part: Intervals,
    regimes: tuple[int, ...],
    weights: Array,
    states: Array,
    sums: _Sums,
) -> None:
    """Add the work in one mode, from states at nodes with weights (k,), to the sums.

    `regimes` are those of the elements in this mode.
    """
    mode, now = part.mode, system._automaton.parts.now(regimes)
    _, v = mode.motion(states)
    sums.add("forces", weights * (applied(system, mode, states) * v).sum(axis=1))
    if isinstance(mode, TaylorMode):
        _, losses, gains = mode.powers(states).T
        lost = weights * losses
        sums.add("forces", weights * gains)
    else:
        lost = weights * ((v @ system.damping_matrix) * v).sum(axis=1)
    sums.add("damping", -lost, lost)
    forces = forces_on(system, mode, regimes, states)
    for k, (name, regime, force) in enumerate(zip(element_names(system), now, forces, strict=True)):
        _, rate, own = gap_of(system, mode, k, states)
        if regime.holds or regime.sticks:
            sums.add(name, weights * force * own)
        elif regime.acts:
            sums.add(name, weights * force * (rate + own), -weights * force * rate)


def _impacts(system: ImpactMap, run: Trajectory, sums: _Sums) -> int:
    """Add the work of impacts and of omitted bounces to the sums; return the number of these."""
    found, names = jumps(system, run), element_names(system)
    middle = found.after + found.before
    work = 0.5 * (found.momentum * middle).sum(axis=1)
    own = [
        e.sign * (e.swing_rate(system.frequency, *found.turn) + e.drift) for e in system._elements
    ]
    lost = (found.impulse.T * own).sum(axis=0) - work
    hit = run.segments.element[1 : len(work) + 1]
    for k, stop in system._automaton.parts.normal.items():
        here, element = found.hits & (hit == stop), system._elements[k]
        along = 0.5 * element.sign * system._functions[k].gradient(found.place)
        rubbed = (found.impulse[:, k] * (middle * along).sum(axis=1))[here]
        heat = found.impulse[here, k] * own[k][here] - rubbed
        sums.add(names[k], rubbed, heat)
        work[here] -= rubbed
        lost[here] -= heat
    for k in np.unique(hit[found.hits]).tolist():
        here = found.hits & (hit == k)
        sums.add(names[k], work[here], lost[here])
    return int(found.hits.sum())
