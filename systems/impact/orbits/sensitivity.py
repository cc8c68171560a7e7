"""Derivatives of the impact map by any parameter, through all modes between two sections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.no_motion import NoCrossing, NoDerivative, NoMotion, replaced
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.orbits.exponentials import moved
from dynkit.systems.impact.orbits.itineraries.flying import number_of
from dynkit.systems.impact.orbits.itineraries.itinerary import regimes_of
from dynkit.systems.impact.orbits.machine import Changes, Machine, Regimes
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.variational.order import check_order
from dynkit.systems.impact.variational.saltation import comes_by_itself

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.simulation.state import ImpactState
    from dynkit.systems.impact.simulation.trajectory import Trajectory

_ROUNDING = 1e-9
"""A sum that is smaller than this, relative to its terms, is zero."""


def change_by(oscillator: ImpactMap, name: str) -> Array | None:
    """Derivative of the numbers of a machine by a parameter: see `numbers_of`.

    None where an element has other regimes at neighbouring values of the parameter.
    """

    def system(p: Array) -> Any:
        return replaced(oscillator, **{name: float(p[0])})

    try:
        found = Changes(system).by(np.array([oscillator.value_of(name)], dtype=float), 0)
    except NoMotion:
        return None
    return None if found is None else found[0]


def map_derivative_by(oscillator: ImpactMap, state: ImpactState, change: Array) -> Array | None:
    """Derivative (d,) of the impact map in section coordinates by a change of all numbers.

    The change of the state, its imaginary part, passes all modes and events until the next impact.
    The guard of each event gives the change of the event's time. None if a chatter ends on the way,
    if friction acts at a stop, if an element halts at time zero, or if an element rests on a
    preloaded stop. None as well where energies are not quadratic, for stops along curves, and where
    neither a hard stop nor a forcing defines the section.

    Raises
    ------
    NoCrossing
        When there is no next impact.
    NoDerivative
        When the outcome of the next impact is a choice of law, friction that rests at a closed stop
        would slip forward or backward with the sign of the change, or a slider starts at a limit of
        its spring that changes.
    """
    system, parts = oscillator, oscillator._parts
    turns = not system._strobed or system._excitation.turns
    if system._motion is not None or parts.normal or system._curves or not turns:
        return None
    run = trajectory_of(system, state, 1, store=True)
    if run.impacts < 1:
        raise NoCrossing(f"there is no next impact: {run.ending.value}")
    if run.ambiguous >= 0:
        raise NoDerivative("the outcome of the next impact is a choice of law")
    check_order(oscillator, run)
    if not _followed(oscillator, run):
        return None
    m = Machine(system, change)
    z, began, late = _begun(m, system, state), 0.0, 0.0
    _refuse_loosened(m, system, run, z)
    measures = _measures(m, system, (state, run.final))
    hit, last = not system._strobed, len(run.switches.guard)
    times = np.append(run.switches.time, run.time).tolist()
    for k, number in enumerate(np.append(run.switches.guard, run.log.guard).tolist()):
        mode, guard = _regimes(system, run, number, 0), system._automaton.guards[number]
        flow, lasts = m.flow(mode), times[k] - began
        if lasts > 0.0 and began == 0.0:
            _refuse_limits(m, system, mode, z)
        if lasts > 0.0:
            (flown,) = moved(flow[None], np.array([lasts]), measures)
            z, began = flown @ z, times[k]
        if k == last and not hit:  # the end of the forcing's period depends on the frequency alone
            later = -late - began * m.frequency.imag / STEP / m.frequency.real
        else:
            row = _row(m, system, mode, guard)
            if lasts > 0.0 and hit and guard.watch.force and began == times[-1]:
                row = m.gap(run.final.element)  # the impact at the same time gives the change
            rates, value = row.real * (flow.real @ z.real), row @ z
            at = run.segments, k, guard, value.real, rates, m.frequency.real
            comes = lasts > 0.0 or comes_by_itself(*at)
            later = -float(value.imag) / STEP / float(rates.sum()) if comes else 0.0
        z, late = z + 1j * STEP * later * (flow.real @ z.real), late + later
        if k < last:
            z = m.caught(mode, _regimes(system, run, number, 2)) @ z
    return _section(m, system, run, mode, z)


def _regimes(system: Any, run: Trajectory, guard: int, column: int) -> Regimes:
    """The mode that a guard ends (column 0) or begins (column 2)."""
    return regimes_of(system, run.regimes[run.guards[guard, column]])


def _followed(system: Any, run: Trajectory) -> bool:
    """Whether no event is a halt at time zero or a chatter, and no element rests preloaded."""
    kinds, speeds = run.guards[run.switches.guard, 3], run.switches.speed
    guards = [system._automaton.guards[k] for k in run.switches.guard.tolist()]
    halts = [
        g.watch.event == HALT and t == 0.0 for g, t in zip(guards, run.switches.time, strict=True)
    ]
    chatters = (kinds == EventKind.CONTACT) & (speeds > 0.0)
    soft = [system._parts.now(own)[len(system._stops) :] for own in run.regimes]
    holds = [regime.holds for own in soft for regime in own]
    return not (any(halts) or chatters.any() or any(holds))


def _refuse_loosened(m: Machine, system: Any, run: Trajectory, z: Any) -> None:
    """Raise NoDerivative if friction rests at a closed stop, and the change would make it slip.

    The stop keeps the slip velocity, so that friction does not stop it: forces jump with its sign.
    """
    parts, s = system._automaton.parts, run.segments
    for regimes in {run.regimes[k] for k in s.mode[s.begin == 0.0].tolist()}:
        sticking = parts.grips(regimes)[1]
        for k, own in enumerate(parts.now(regimes)):
            if not own.sticks or k in sticking:
                continue
            row = m.rate(k)
            changes = row.imag * z.real + row.real * z.imag
            if abs(changes.sum()) > _ROUNDING * abs(changes).sum():
                raise NoDerivative(
                    "friction that rests at a closed stop would slip as the parameter changes: "
                    f"{system._elements[k]!r}"
                )


def _refuse_limits(m: Machine, system: Any, mode: Regimes, z: Any) -> None:
    """Raise NoDerivative if a slider that sticks from the start on would slide after the change.

    The force of its spring is at the limit, which changes: there the slider slides at once, and it
    stays where it is if the change has the other sign.
    """
    regimes = system._parts.now(mode.numbers)
    for k in m.sliders:
        watches = regimes[k].guards if regimes[k].anchored else ()
        for number in range(len(watches)):
            row = m.watched(mode, k, number)
            value, change = row.real * z.real, row.imag * z.real + row.real * z.imag
            at_limit = abs(value.sum()) <= _ROUNDING * abs(value).sum()
            if at_limit and abs(change.sum()) > _ROUNDING * abs(change).sum():
                raise NoDerivative(
                    "a slider starts at the limit of its spring, which changes with the parameter: "
                    f"{system._elements[k]!r}"
                )


def _row(m: Machine, system: Any, mode: Regimes, guard: Any) -> Any:
    """Row (D,) of the guard that is zero at the end of a mode."""
    guards = system._parts.now(mode.numbers)[guard.element].guards
    return m.watched(mode, guard.element, number_of(guards, guard.watch))


def _begun(m: Machine, system: Any, state: ImpactState) -> Any:
    """The state (D,) at a section, with the change that keeps its section coordinates."""
    n, turn = m.size, state._turn
    z = np.concatenate([state.position, state.velocity, state.sliders, turn, [1.0]]) + 0j
    if not system._strobed:
        stop = state.element
        (own,) = set(range(n)) - set(system._others[stop].tolist())
        for place, row in ((own, m.gap(stop)), (n + own, m.rate(stop))):
            z[place] -= 1j * (row @ z).imag / row[place].real
    return z


def _measures(m: Machine, system: Any, states: Sequence[ImpactState]) -> Array:
    """Units (D,) in which states are of order one."""
    length = max(float(abs(state.position).max()) for state in states)
    speed = max(float(abs(state.velocity).max()) for state in states)
    rate = max(float(system.natural_frequencies[-1]), system.frequency)
    length = max(length, speed / rate) or 1.0
    sizes = length, max(speed, rate * length), length, 1.0
    return np.repeat(sizes, (m.size, m.size, len(m.sliders), 3))


def _section(m: Machine, system: Any, run: Trajectory, mode: Regimes, z: Any) -> Array:
    """Change (d,) of the section coordinates by that of the state just before the section."""
    n, sliders = m.size, len(m.sliders)
    if system._strobed:
        return np.asarray(z[: 2 * n + sliders].imag / STEP)
    stop = run.final.element
    law, rate, piece = system._stops[stop].restitution, m.rate(stop) @ z, 0
    if isinstance(law, ImpactLaw):
        piece = law.piece(-float(rate.real))
    r, _ = m.rebound(stop, piece, rate)
    z = z - (1.0 + r) * rate * m.kick(mode, stop)
    others, far = system._others[stop], stop == 1 and system._faces
    sine, cosine = z[-3:-1]
    turned = cosine.real * sine.imag - sine.real * cosine.imag
    turned /= math.hypot(sine.real, cosine.real) ** 2
    speed = (r * rate if far else -r * rate).imag
    parts = [z[others].imag, z[n + others].imag, z[2 * n : 2 * n + sliders].imag, [speed, turned]]
    return np.concatenate(parts) / STEP
