"""Observables of elements in a motion, by name: gaps, rates, forces and impulses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynkit.core.validation import Array, one_of
from dynkit.systems.impact.elements.element import Element, EventKind
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.taylor.mode import TaylorMode
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.simulation.sampling import states_at
from dynkit.systems.impact.simulation.trajectory import Ending

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.simulation.trajectory import Trajectory

_OF_FRICTION = "slip_velocity", "friction_force"
_OF_STOPS = "gap", "relative_velocity", "contact_force"
_OF_JOINTS = "stretch", "spring_force"


class Jumps(NamedTuple):
    """Changes at the ends of the first k segments of a motion.

    Attributes
    ----------
    place : (k, N) positions
    before, after : (k, N) velocities
    momentum : (k, N) changes of momentum
    turn : (2, k) sine and cosine of the phase
    hits : (k,) whether the segment ends with an impact, or with omitted bounces
    impulse : (k, elements) impulse of each element, towards its side
    """

    place: Array
    before: Array
    after: Array
    momentum: Array
    turn: Array
    hits: Any
    impulse: Array


def names_along(system: ImpactMap) -> tuple[str, ...]:
    """Names of the observables of elements, which resemble those of their parameters."""
    return tuple(
        f"{name}.{what}"
        for name, element in zip(element_names(system), system._elements, strict=True)
        for what in _of(element)
    )


def _of(element: Element) -> tuple[str, ...]:
    if element.slider:
        return _OF_JOINTS
    if any(regime.sticks for regime in element.regimes):
        return _OF_FRICTION
    return (*_OF_STOPS, "impulse") if isinstance(element, HardStop) else _OF_STOPS


def along_at(system: ImpactMap, run: Trajectory, name: str, times: Array) -> Array:
    """One of `names_along`, except an impulse, at times (k,) within a run."""
    known = [known for known in names_along(system) if not known.endswith(".impulse")]
    return _values(system, run, one_of("name", name, known), times)


def along_impacts(system: ImpactMap, run: Trajectory, name: str) -> Array:
    """One of `names_along` just after the impacts, or at the beginnings of periods, (n,)."""
    number, what = _split(system, name)
    if what == "impulse":
        found = jumps(system, run).impulse[:, number]
        return np.asarray(found[np.searchsorted(run.segments.point, range(1, run.impacts + 1)) - 1])
    out = _values(system, run, name, run.time)
    if what == "relative_velocity":
        hit = (run.element == number) & (not system._strobed)
        out[hit] = run.log.speed[hit]  # the stored value has more digits
    return out


def _split(system: ImpactMap, name: str) -> tuple[int, str]:
    element, _, what = name.rpartition(".")
    return element_names(system).index(element), what


def _values(system: ImpactMap, run: Trajectory, name: str, times: Array) -> Array:
    """One of `names_along` at times (k,)."""
    out, automaton = np.empty(len(times)), system._automaton
    number, what = _split(system, name)
    element = system._elements[number]
    turned = element.sign if what in _OF_FRICTION else 1
    for now, mode, here, states in _settled(system, run, times):
        regimes = now.regimes[automaton.modes.index(mode)]
        if what.endswith("_force"):
            out[here] = turned * forces_on(system, mode, regimes, states)[number]
            continue
        regime = automaton.parts.now(regimes)[number]
        gap, rate, _ = gap_of(system, mode, number, states)
        still = regime.holds or regime.sticks
        out[here] = 0.0 if still else gap if what in ("gap", "stretch") else turned * rate
    return out


def _settled(system: ImpactMap, run: Trajectory, times: Array) -> Iterator[Any]:
    """Runs, modes, indices of the times (k,) in each mode, and states there.

    A run ends with an impact, or a period. For a time equal to its end, the simulation is continued
    by one impact, since the regimes just after an event are decided only then.
    """
    ends = (times == run.duration) & (run.ending is Ending.COUNT_REACHED)
    before = np.flatnonzero(~ends)
    for mode, here, states in states_at(run, times[before]):
        yield run, mode, before[here], states
    if ends.any():
        more = system._run(run.final, 1, store=True)
        for mode, _, states in states_at(more, np.zeros(1)):
            yield more, mode, ends, states


def gap_of(system: ImpactMap, mode: Any, number: int, states: Array) -> tuple[Array, Array, Array]:
    """Gap of an element, its rate, and the velocity of the element itself, towards its side.

    For an element with a slider, the stretch of the spring to the slider takes the place of the
    gap.
    """
    x, v = mode.motion(states)
    _, sine, cosine = mode.parts(states)
    element, slider = system._elements[number], system._automaton.parts.sliders.get(number)
    function, sign = system._functions[number], element.sign
    own = element.swing_rate(system.frequency, sine, cosine) + element.drift
    place = element.offset + element.swing(sine, cosine)
    if slider is not None:
        place = mode.sliders(states)[:, slider - mode.bodies]
    gap, rate = function(x) - place, (v * function.gradient(x)).sum(axis=1) - own
    return sign * gap, sign * rate, sign * (own + 0.0 * gap)


def applied(system: ImpactMap, mode: Any, states: Array) -> Array:
    """The harmonic and constant forces on the structure, (k, N)."""
    _, sine, cosine = mode.parts(states)
    excitation = system._excitation
    turning = np.outer(sine, excitation.harmonic.real) + np.outer(cosine, excitation.harmonic.imag)
    return np.asarray(turning + excitation.constant)[:, : mode.bodies]


def forces_on(system: ImpactMap, mode: Any, regimes: tuple[int, ...], states: Array) -> Array:
    """Forces (elements, k) on the structure, towards the side of each element.

    Elements that hold or stick have the forces that balance mass times acceleration. Friction that
    rests on a row that a closed stop holds has no force.
    """
    if isinstance(mode, TaylorMode):
        found = [mode.balance(state)[1] for state in states]
        return np.array(found).reshape(-1, len(system._elements)).T
    (x, v), elements, automaton = mode.motion(states), system._elements, system._automaton
    out, rows = np.zeros((len(elements), len(states))), []
    held = sorted(sum(automaton.parts.grips(regimes), ()))
    slips = automaton.parts.tractions(regimes)
    missing = applied(system, mode, states) - v @ system.damping_matrix - x @ system.stiffness
    for k, (element, regime) in enumerate(zip(elements, automaton.parts.now(regimes), strict=True)):
        row = element.sign * element.row(x.shape[1])
        if k in held:
            by_it = [(t, j) for j, stop, t in slips if stop == k]
            rubs = (t * element.sign * elements[j].row(x.shape[1]) for t, j in by_it)
            rows.append(sum(rubs, row))
        elif regime.acts:
            gap, rate, _ = gap_of(system, mode, k, states)
            out[k] = regime.push - regime.stiffness * gap - regime.damping * rate
            missing += np.outer(out[k], row)
    if held:
        pushed = _accelerations(mode, states) @ system.mass - missing
        out[held] = np.linalg.lstsq(np.array(rows).T, pushed.T)[0]
    for k, stop, traction in slips:
        out[k] += elements[k].sign * elements[stop].sign * traction * out[stop]
    return out


def _accelerations(mode: Any, states: Array) -> Array:
    """Accelerations (k, N) of states."""
    rates = mode.rate(states)
    return np.asarray(mode.motion(rates)[1] - mode.motion(0.0 * rates)[1])


def jumps(system: ImpactMap, run: Trajectory) -> Jumps:
    """Changes at the events from the start to the last impact."""
    s = run.segments
    last = int(np.searchsorted(s.point, run.impacts))
    before, after, momentum, place = np.zeros((4, last, system.degrees_of_freedom))
    turn, impulse = np.zeros((2, last)), np.zeros((last, len(system._elements)))
    durations = np.diff(s.begin)[:last]
    mode: Any
    for mode, here in run.modes(s.mode[:last]):
        (some,) = np.nonzero(here)
        ends = mode.after(s.of(mode, some), np.arange(len(some)), durations[some])
        before[some] = mode.motion(ends)[1]
    for mode, here in run.modes(s.mode[1 : last + 1]):
        (some,) = np.nonzero(here)
        states = s.of(mode, some + 1)
        (place[some], after[some]), turn[:, some] = mode.motion(states), mode.parts(states)[1:]
        change = after[some] - before[some]
        smooth = isinstance(mode, TaylorMode)
        momentum[some] = mode.momenta(states, change) if smooth else change @ system.mass
    kinds = s.kind[1 : last + 1]
    hits = (kinds == EventKind.CONTACT) | ((kinds == EventKind.IMPACT) & (not system._strobed))
    pairs = np.stack([s.mode[:last], s.element[1 : last + 1]], axis=1)
    for number, element in np.unique(pairs[hits], axis=0).tolist():
        here = hits & (pairs == (number, element)).all(axis=1)
        parts = system._automaton.parts
        held = [k for k in parts.grips(run.regimes[number])[0] if k != element]
        held += [k for k, stop in parts.normal.items() if stop == element]
        stops = [system._elements[k] for k in (element, *held)]
        if any(stop.curved for stop in stops):
            own = [(system._elements[k].sign, system._functions[k]) for k in (element, *held)]
            for i in np.flatnonzero(here).tolist():
                along = np.array([sign * function.gradient(place[i]) for sign, function in own])
                impulse[i, [element, *held]] = np.linalg.lstsq(along.T, momentum[i])[0]
            continue
        rows = np.array([stop.sign * stop.row(before.shape[1]) for stop in stops])
        solved = np.linalg.lstsq(rows.T, momentum[here].T)[0].T
        impulse[np.ix_(here, (element, *held))] = solved
    return Jumps(place, before, after, momentum, turn, hits, impulse)
