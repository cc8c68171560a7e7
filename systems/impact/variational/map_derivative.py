"""Exact derivative of the impact map, through contact and release where they occur."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.no_motion import NoCrossing, NoDerivative, TangentCrossing
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import HALT, IMPACT
from dynkit.systems.impact.elements.friction import FORWARD, STICKS
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.mode import Mode, transformed
from dynkit.systems.impact.simulation.parameters import changes_alone
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.variational.saltation import reset
from dynkit.systems.impact.variational.taylor_derivative import followed, hit, rubbed, rubs_on

_ORDERS = 16
"""Terms of Taylor series for the smallest step: the remainder is below 3e-17."""

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure
    from dynkit.systems.impact.simulation.trajectory import Trajectory


def impact_derivative(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Derivative (d, d) of the impact map in section coordinates.

    It is the product of the derivatives of: free coordinates by section coordinates; each mode on
    the way, up to the zero of its guard; the impact law. A mode that is entered at the start is
    entered for all neighbouring starts. The omitted bounces of a chatter lose the dependence on the
    relative velocity.
    """
    run = trajectory_of(oscillator, state, 1, store=True)
    if run.impacts < 1:
        raise NoCrossing(f"there is no next impact: {run.ending.value}")
    if run.ambiguous >= 0:
        raise NoDerivative("the outcome of the next impact is a choice of law")
    if oscillator._motion is not None:
        return _by_variations(oscillator, state, run)
    free, automaton, began = oscillator._free, oscillator._automaton, 0.0
    side, hit = run.final.element, not oscillator._strobed
    y, derivative = free.states(state._coordinates, *state._turn), _lift(oscillator, state)
    time = np.zeros(derivative.shape[1])
    times = np.append(run.switches.time, run.time).tolist()
    for k, number in enumerate(np.append(run.switches.guard, run.log.guard).tolist()):
        guard, ends, last = automaton.guards[number], times[k], k == len(run.switches.guard)
        mode = automaton.modes[guard.mode]
        if ends > began:  # else what happened just now brought it about
            reached = guard
            if hit and guard.watch.force and ends == times[-1]:  # by the impact that follows
                reached = automaton.guards[automaton.guard(guard.mode, side)]
            low = hit and began == 0.0 and _flies_low(state, reached, ends)
            y, derivative, risen, moved = _flight(mode, y, derivative, ends - began, low=low)
            rate, began = mode.rate(y).ravel(), ends
            row = _row(reached.sum, 0)
            own = _row(reached.sum, 2) @ risen
            speed = state.speed + float(own) if low else float(row @ rate)
            # a period ends when it does
            later = _later(row @ moved, speed) if hit or not last else -time
            # Time also moves the phase: it is part of the rate, through sine and cosine.
            derivative += np.outer(rate, later)
            time += later
        if not last:
            if guard.watch.event == HALT and ends == 0.0:
                derivative = _held_fast(oscillator, guard, derivative)
            if guard.scrapes and float(run.switches.speed[k]) > 0.0:
                y = _kept_slipping(oscillator, run, k, y, derivative)
            derivative = guard.change[:, :-1] @ derivative
            y = transformed(guard.change, y[None])[0]
    law: list[Array] = []
    kept: tuple[Any, Any]
    if hit:
        stop = oscillator._stops[side]
        before = _row(guard.sum, 2) @ derivative
        slope = _slope(stop, float(_row(guard.sum, 2) @ y.ravel()), float(run.log.speed[-1]))
        kick = mode.placed(stop.sign * mode.contact(stop.row(len(free.forced.rest))).kick[:2])
        rubs = [_scraped(part, slope, guard.sum, y, derivative) for part in guard.scrapes]
        derivative += sum(rubs, reset(slope, kick.ravel(), before))
        far = side == 1 and oscillator._faces
        kept = oscillator._others[side], oscillator._others[side]
        law.append((slope if far else -slope) * before)
    else:
        kept = oscillator._crossed.kept
    if guard.mode:
        derivative = free.seen_from(mode)[:, :-1] @ derivative

    q, by_sine, by_cosine = free.parts(derivative.T.reshape(-1, 2, free.layout.slots))
    places = free.forced.displacements(q, by_sine, by_cosine).T
    velocity = free.forced.speeds(q, by_sine, by_cosine).T[kept[1]]
    if hit and free.layout.table >= 0:
        sine, cosine = run.final._turn
        law.append(cosine * by_sine - sine * by_cosine)
    elif hit:
        law.append(oscillator.frequency * time + np.eye(len(time))[-1])
    sliders = places[oscillator.degrees_of_freedom :]
    return np.vstack([places[kept[0]], velocity, sliders, *law])


def tangent(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Orthonormal disturbances (d, d - 2) of section coordinates that stay on a stop.

    The stop acts along a function of the coordinates. Without a stop, (d, d - 1).
    """
    n, d, hit = oscillator.degrees_of_freedom, oscillator.dimension, not oscillator._strobed
    lifted = _lift(oscillator, state).reshape(2, -1, d)
    first = lifted[0, :n], lifted[1, :n], lifted[0, n:-1]
    put = np.concatenate([*first, np.eye(d)[d - 2 * hit :]])
    return np.asarray(np.linalg.svd(put)[0][:, : d - 1 - hit])


def _by_variations(oscillator: DrivenStructure, state: ImpactState, run: Trajectory) -> Array:
    """The same where the energies are not quadratic."""
    side, n = run.final.element, oscillator.degrees_of_freedom
    out, end = followed(oscillator, run, _lift(oscillator, state))
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        return np.vstack([out[positions], out[n + velocities], out[2 * n : -1]])
    guard = oscillator._automaton.guards[int(run.log.guard[-1])]
    mode = oscillator._automaton.modes[guard.mode]
    stop, (sine, cosine) = oscillator._stops[side], end[:, -1].tolist()
    rate, speed = float(mode.gap(side, *end[:, :n], sine, cosine)[1]), float(run.log.speed[-1])
    slope = _slope(stop, rate, speed)
    if isinstance(stop.restitution, float):
        r, rate = slope, -speed / slope if slope else rate
    else:
        r = -speed / rate
    rubs = rubbed(oscillator, guard, end, out, slope, r, rate)
    out, before = hit(mode, side, end, out, slope, r)
    out = out + rubs
    own = slope if side == 1 and oscillator._faces else -slope
    others = oscillator._others[side]
    return np.vstack([out[others], out[n + others], out[2 * n : -1], own * before, out[-1]])


def parameter_derivative(
    oscillator: DrivenStructure, state: ImpactState, name: str
) -> Array | None:
    """Derivative (2N,) of the impact map in section coordinates by a parameter of a stop.

    Such a parameter does not change the structure or its propagators. It changes the position and
    velocity of the stop at the begin and end of the flight. The result is None where no closed form
    is known: for parameters that change others, for the frequency of harmonic forces, and where the
    motion enters another mode.
    """
    forced = bool(oscillator._excitation.harmonic.any())
    if (
        oscillator._motion is not None
        or oscillator._strobed
        or oscillator._several
        or oscillator._sliders
        or oscillator._automaton.parts.normal
        or not changes_alone(oscillator, name)
        or (forced and name == "frequency")
    ):
        return None
    run = trajectory_of(oscillator, state, 1, store=True)
    if run.impacts < 1:
        raise NoCrossing(f"there is no next impact: {run.ending.value}")
    if len(run.switches.guard):
        return None
    contact, free = oscillator._contact, oscillator._free
    side, time = run.final.element, float(run.time[0])
    gap, sign = oscillator._gaps[side], oscillator._stops[side].sign

    x, v = np.zeros((2, 1, len(contact.row)))
    place, moving = _stop_by(oscillator, name, state, 0.0)
    contact.put(x, place)
    contact.put(v, moving)
    none = np.zeros(1)
    column = free.states(free.forced.coordinates(x, v, none, none), none, none)[0]
    if free.layout.constant >= 0:
        column[0, free.layout.constant] = 0.0
    end, flow = _flow(free, free.states(state._coordinates, *state._turn), time)
    change, rate = flow @ column.ravel(), free.rate(end).ravel()
    place, speed = _stop_by(oscillator, name, run.final, time)
    before = float(_row(gap, 2) @ end.ravel())
    later = -(_row(gap, 0) @ change - sign * place) / before
    change += later * rate
    before_by = _row(gap, 2) @ change - sign * speed
    r = _slope(oscillator._stops[side], before, float(run.log.speed[-1]))
    law_by = before if name == "restitution" else 0.0
    kick = free.placed(sign * contact.kick[:2])
    change += reset(r, kick.ravel(), before_by)[:, 0] - law_by * kick.ravel()

    q, by_sine, by_cosine = free.parts(change.reshape(1, 2, -1))
    others = contact.others
    position = free.forced.displacements(q, by_sine, by_cosine)[0, others]
    velocity = free.forced.speeds(q, by_sine, by_cosine)[0, others]
    speed_by = -r * before_by - law_by
    phase = oscillator.frequency * later + (time if name == "frequency" else 0.0)
    return np.array([*position, *velocity, speed_by if side == 0 else -speed_by, phase])


def _scraped(part: Any, restitution: float, gap: Any, y: Array, derivative: Array) -> Array:
    """Change of a derivative (2 slots, d) by friction at an impact, by that before the impact.

    It takes `ratio` times the change of the gap's rate from the slip velocity, or all of that.
    """
    w, kick = float(_row(part.slip, 0) @ y.ravel()) + part.slip.offset, part.kick[:2].ravel()
    by_rate = (1.0 + restitution) * part.ratio * _row(gap, 2)
    if abs(w) <= abs(float(by_rate @ y.ravel())):
        return -np.outer(kick, _row(part.slip, 0) @ derivative)
    return np.outer(kick, np.sign(w) * by_rate @ derivative)


def _held_fast(oscillator: DrivenStructure, guard: Any, derivative: Array) -> Array:
    """The derivative after friction that sticks from the start on has stopped what slips beside it.

    A neighbouring start slips at a small velocity, until an impulse of the friction has taken it:
    along the row of this friction, and along those of other friction, which goes on to stick.
    """
    automaton, mode = oscillator._automaton, oscillator._automaton.modes[guard.mode]
    sticking = [*automaton.parts.grips(automaton.regimes[guard.mode])[1], guard.element]
    rows = np.array([oscillator._elements[k].row(oscillator._size) for k in sticking])
    pushes = np.array([mode.pushed(row) for row in rows]).T
    kicks = [mode.placed(mode.contact(row).kick[:2]).ravel() for row in rows]
    kick = np.linalg.solve(rows @ pushes, np.eye(len(rows))[-1]) @ kicks
    slip = _row(guard.sum, 0) / (guard.watch.rate * oscillator._elements[guard.element].sign)
    return np.asarray(derivative - np.outer(kick, slip @ derivative))


def _kept_slipping(
    oscillator: DrivenStructure, run: Any, k: int, y: Array, derivative: Array
) -> Array:
    """The state after friction in bounces that contact replaces; `derivative` changes in place.

    What slips gets back what contact takes too much; of what sticks nothing is left.
    """
    automaton = oscillator._automaton
    guard = automaton.guards[int(run.switches.guard[k])]
    for part in guard.scrapes:
        to = rubs_on(automaton, run.switches.time[k:], run.switches.guard[k:], part.element)
        if to == STICKS:
            by = -_row(part.slip, 0)
            change = float(by @ y.ravel()) - part.slip.offset
        else:
            by = (1.0 if to == FORWARD else -1.0) * part.ratio * _row(guard.sum, 2)
            change = float(by @ y.ravel())
        derivative += np.outer(part.kick[:2], by @ derivative)
        y = y + change * part.kick[:2]
    return y


def _slope(stop: HardStop, rate: float, speed: float) -> float:
    """Slope of the velocity with which a stop is left over that of the approach, at an impact."""
    law = stop.restitution
    if not isinstance(law, ImpactLaw):
        return law
    (approach,) = law.approach(np.array([-rate]), np.array([speed])).tolist()
    if law.jumps(approach):
        raise NoDerivative(f"the impact law jumps at the approach velocity {approach}")
    return float(law.slope(np.array([approach]))[0])


def _stop_by(
    oscillator: DrivenStructure, name: str, state: ImpactState, time: float
) -> tuple[float, float]:
    """Derivatives of a stop's position and velocity by a parameter, at a time after an impact.

    The state is on this stop at the impact, and the phase of the impact is fixed.
    """
    (sine, cosine), near, w = state._turn, oscillator._stops[0], oscillator.frequency
    if name == "amplitude":
        return float(sine), float(w * cosine)
    if name == "frequency":
        turned = near.swing(cosine, -sine)
        return float(time * turned), float(turned - w * time * near.swing(sine, cosine))
    if name == "offset":
        return 1.0, 0.0
    if name == "play" and state.element == 1:
        return float(near.sign), 0.0
    return 0.0, 0.0


def _lift(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Derivative (2 slots, d) of the free state, table included, by the section coordinates."""
    free, n, d = oscillator._free, oscillator.degrees_of_freedom, oscillator.dimension
    x, v = np.zeros((2, d, oscillator._size))
    by_sine, by_cosine = np.zeros((2, d))
    sliders = range(n, oscillator._size)
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        ends = np.cumsum([len(positions), len(velocities)])
        x[: ends[0], positions] = np.eye(len(positions))
        v[ends[0] : ends[1], velocities] = np.eye(len(velocities))
        x[ends[1] :, sliders] = np.eye(len(sliders))
        oscillator._crossed.put_changes(x, v, state.position, state.velocity)
    else:
        contact, stop = oscillator._contacts[state.element], oscillator._stops[state.element]
        sine, cosine = state._turn
        others = oscillator._others[state.element]
        m = len(others)
        x[np.arange(m), others] = 1.0
        v[np.arange(m) + m, others] = 1.0
        x[2 * m : -2, sliders] = np.eye(len(sliders))
        place, moving = np.zeros((2, d))
        far = state.element == 1 and oscillator._faces
        moving[-2] = -stop.sign if far else stop.sign
        # a quarter of a turn on
        place[-1] = stop.swing(cosine, -sine)
        moving[-1] = stop.swing_rate(oscillator.frequency, cosine, -sine)
        if oscillator._bent:
            moved = x[:, :n], v[:, :n], place, moving
            x[:, :n], v[:, :n] = contact.lifted(state.position, state.velocity, moved)
        else:
            contact.put(x, place)
            contact.put(v, moving)
        by_sine[-1], by_cosine[-1] = cosine, -sine
    q = free.coordinates(x, v, by_sine, by_cosine, np.zeros(d))
    out = free.states(q, by_sine, by_cosine)
    if free.layout.constant >= 0:
        out[:, 0, free.layout.constant] = 0.0
    return np.asarray(out.reshape(d, -1).T)


def _flow(mode: Mode, y: Array, duration: float) -> tuple[Array, Array]:
    """The state after a duration, and its derivative (2 slots, 2 slots) by the state before."""
    slots, lasts = np.arange(y.shape[1]), np.array([duration])
    end = mode.flown(y, lasts)[0]
    return end, mode.transitions(lasts, slots).matrices(slots)[0]


def _later(risen: Array, speed: float) -> Array:
    """Derivatives (d,) of the time of an event whose guard falls at a speed."""
    if not speed:
        raise TangentCrossing("an event of the motion grazes, to rounding")
    return -risen / speed


def _flies_low(state: ImpactState, guard: Any, duration: float) -> bool:
    """Whether a flight from a stop to the same one is shorter than the smallest step of its gap.

    The gap and its rate would be differences, of which rounding leaves nothing after low bounces.
    """
    again = guard.watch.event == IMPACT and guard.element == state.element
    return again and state.speed > 0.0 and duration < guard.sum.smallest


def _flight(
    mode: Mode, y: Array, derivative: Array, duration: float, *, low: bool
) -> tuple[Array, Array, Array, Array]:
    """A state and its derivative (2 slots, d) after a flight, and parts of them, both flat.

    From these parts the gap and its rate follow: of low flights they are the changes, by Taylor
    series.
    """
    if not low:
        y, flow = _flow(mode, y, duration)
        derivative = flow @ derivative
        return y, derivative, y.ravel(), derivative
    term = np.concatenate([y[None], derivative.T.reshape(-1, *y.shape)])
    total = np.zeros_like(term)
    for k in range(1, _ORDERS):
        term = mode.rate(term) * (duration / k)
        total += term
    moved = total[1:].reshape(derivative.shape[1], -1).T
    return y + total[0], derivative + moved, total[0].ravel(), moved


def _row(ladder: Any, order: int) -> Array:
    """The row of f (0) or f' (2) of an exponential sum, (2 slots,)."""
    row = np.zeros((2, ladder.step.shape[2]))
    row[:, : ladder.rows.shape[1]] = ladder.rows[order : order + 2]
    return row.ravel()
