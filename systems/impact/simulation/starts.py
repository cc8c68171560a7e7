"""Start states of an impact oscillator: default, given, or from another oscillator's state."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array, finite_array, finite_scalar
from dynkit.systems.impact.simulation.state import (
    TOUCHED,
    TWO_PI,
    ImpactState,
    Motion,
    along,
    apart,
    beside,
    placed,
    put_on,
    seen_along,
    state_at,
    sticking,
    touched,
    unlike,
    within,
)

if TYPE_CHECKING:
    from dynkit.systems.impact.elements.stops import HardStop
    from dynkit.systems.impact.modes.structure import Contact
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

# The first mode has a node at the contact mass if its displacement there is less than this part of
# the largest one: half of a double's digits, so that a smaller one may consist of rounding errors.
_NODE = 2.0**-26


def _rounding(place: float, amplitude: float, offset: float) -> float:
    """Bound of the rounding error of a zero gap."""
    return 4.0 * 2.0**-53 * (abs(place) + amplitude + abs(offset))


def default_position(
    oscillator: DrivenStructure, angle: float, length: float | None = None
) -> Array:
    """Shape of the first mode with modal amplitude one, if masses at rest can be there.

    Otherwise it is scaled, or moved at the contact, to a distance from the stop of one or half the
    play. If `length` is given, the shape's largest displacement and this distance of one are
    `length` instead.
    """
    shape = oscillator.modal_matrix[:, 0]
    if length is not None:
        shape = shape * (length / float(abs(shape).max()))
    unit = 1.0 if length is None else length
    if oscillator._strobed:
        return shape
    near = oscillator._stops[0]
    if oscillator._bent:
        return _clear(oscillator, shape, angle)
    contact, play = oscillator._contact, oscillator.play
    row = contact.row[: len(shape)]
    place = float(row @ shape)
    x: Array = shape * near.sign * (-1.0 if place < 0.0 else 1.0)
    turn = math.sin(angle), math.cos(angle)
    if oscillator._several:
        return np.asarray(_between(oscillator, x, turn, unit)[0])
    table = float(near.swing(*turn) + near.offset)
    gap = near.sign * (float(row @ x) - table)
    # rate of the gap of a mass at rest, which cannot be on a stop that moves towards it
    rate = -near.sign * near.swing_rate(oscillator.frequency, *turn)
    rounding = _rounding(place, oscillator.amplitude, near.offset)
    clear = gap > rounding or (gap >= 0.0 and rate >= 0.0)
    if clear and (gap < play - rounding or (gap <= play and rate <= 0.0)):
        return x
    lifted = table + near.sign * min(unit, 0.5 * play)
    if abs(place) > _NODE * float(abs(shape).max()):
        return shape * (lifted / place)
    x = beside(oscillator, x)
    contact.put(x, lifted)
    return x[: len(shape)]


def _clear(oscillator: DrivenStructure, shape: Array, angle: float) -> Array:
    """A multiple of the shape for which all gaps are positive, for stops along functions."""
    turn = math.sin(angle), math.cos(angle)
    for factor in (1.0, 0.5, 2.0, *(0.5 ** np.arange(2.0, _HALVINGS))):
        for x in (factor * shape, -factor * shape):
            if all(
                s.sign * (seen_along(c, x, x)[1] - s.swing(*turn) - s.offset) > 0.0
                for s, c in _stands(oscillator)
            ):
                return np.asarray(x)
    raise Refused("position must be given: multiples of the first mode are beyond a stop")


def _between(
    oscillator: DrivenStructure, x: Array, turn: tuple[float, float], unit: float
) -> Array:
    """Positions and velocities (2, N) with gaps of at least a unit, or a half, a quarter, ...

    The positions are the nearest ones to given positions, and the velocities are zero. If there is
    no room between the stops, the masses are on the stops and move with them.
    """
    rows = np.array([s.sign * c.row[: len(x)] for s, c in _stands(oscillator)])
    places = np.array([s.sign * (s.swing(*turn) + s.offset) for s in oscillator._stops])
    sizes = [stop.amplitude + abs(stop.offset) for stop in oscillator._stops]
    still = np.zeros(len(x))
    if (rows @ x > places).all():
        return np.stack([x, still])
    for margin in (*(unit * 0.5 ** np.arange(_HALVINGS)), 0.0):
        found = _nearest(rows, places + margin, x)
        found[abs(found) < _LEFT * abs(x).max()] = 0.0
        gaps, rounding = rows @ found - places, _LEFT * (abs(rows) @ abs(found) + sizes)
        if (gaps >= 0.5 * margin - rounding).all():
            w, on = oscillator.frequency, gaps <= rounding
            rates = np.array([s.sign * s.swing_rate(w, *turn) for s in oscillator._stops])
            return np.stack([found, _nearest(rows[on], rates[on], still)])
    limits = [
        f"{along(stop, 'position')} {'>=' if stop.sign > 0 else '<='} {stop.sign * place:.6g}"
        for stop, place in zip(oscillator._stops, places.tolist(), strict=True)
    ]
    at = f"at phase {math.atan2(*turn) % TWO_PI:.6g}"
    raise Refused(f"elements must leave room between their stops; got {' and '.join(limits)} {at}")


_HALVINGS, _LEFT = 40, 2.0**-51
"""Number of halvings of the room, and relative rounding error of a position."""


def _nearest(rows: Array, least: Array, x: Array) -> Array:
    """The positions (N,) nearest to `x` with ``rows @ positions >= least``.

    The rows are (k, N). If no positions satisfy the inequalities, the result does not either.

    References
    ----------
    C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, SIAM 1995, chapter 23 (least
    distance programming).
    """
    from scipy.optimize import nnls

    if not len(rows):
        return x
    lacking = least - rows @ x
    weights, _ = nnls(np.vstack([rows.T, lacking]), np.append(np.zeros(len(x)), 1.0))
    active = weights > 0.0
    return x + np.asarray(np.linalg.lstsq(rows[active], lacking[active])[0])


def _stands(oscillator: DrivenStructure) -> Iterable[tuple[HardStop, Contact]]:
    """The hard stops and their contacts."""
    return zip(oscillator._stops, oscillator._contacts, strict=True)


def _called(oscillator: DrivenStructure, stop: HardStop) -> str:
    """Name of the stop in messages."""
    if not oscillator.elements:
        return "the table"
    return f"stop {stop.name!r}" if stop.name else "the stop"


def start(
    oscillator: DrivenStructure,
    position: object,
    velocity: object,
    phase: object,
    sliders: object,
    length: float | None = None,
) -> ImpactState:
    """A start state, with defaults for None; ValueError if a mass is beyond a stop.

    The default position is that of `default_position`.
    """
    n, w = oscillator.degrees_of_freedom, oscillator.frequency
    angle = finite_scalar("phase", phase)
    given = default_position(oscillator, angle, length) if position is None else position
    x = finite_array("position", given, (n,))
    turn = np.array([math.sin(angle), math.cos(angle)])
    moving = np.zeros(n) if velocity is None else velocity
    if position is velocity is None and oscillator._several and not oscillator._bent:
        there = float(turn[0]), float(turn[1])
        moving = _between(oscillator, x, there, 1.0 if length is None else length)[1]
    v = finite_array("velocity", moving, (n,))
    on: dict[int, float] = {}
    first = 0.0
    for side, (stop, contact) in enumerate(_stands(oscillator)):
        swing, speed = stop.swing(*turn.tolist()), stop.swing_rate(w, *turn.tolist())
        (row, place, moving), table = seen_along(contact, x, v), swing + stop.offset
        gap, u = stop.sign * (place - table), stop.sign * (moving - speed)
        terms = float(abs(row) @ abs(x)) + stop.curved * (1.0 + abs(place))
        rounding = _rounding(terms, stop.amplitude, stop.offset)
        word = "below" if stop.sign > 0 else "above"
        if gap < -rounding:
            what = along(stop, "position")
            name = _called(oscillator, stop)
            raise Refused(f"{what} must not be {word} {name} at {table}; got {place}")
        if gap <= rounding:
            rounding = 4.0 * 2.0**-53 * (abs(row) @ abs(v) + abs(speed))
            if u < -rounding:
                what = along(stop, "velocity")
                name = _called(oscillator, stop)
                raise Refused(
                    f"{what} must not be {word} the velocity {speed} of {name} when the mass is "
                    f"on it; got {moving}"
                )
            on[side] = 0.0 if u <= rounding else u
        first = first if side else abs(u)
    # the first touched stop whose gap opens, if any; masses rest on others with a rate of zero
    element = max(on, key=lambda side: on[side] > 0.0, default=0)
    touching = (element, *apart(oscillator, element, on, x)) if on else ()
    sticks = sticking(oscillator, x, v, turn, touching)
    x, v = _sliding(oscillator, x, turn, sliders), beside(oscillator, v)
    if not on:
        return state_at(oscillator, x, v, turn, first, 0, Motion.FLIGHT, sticks)
    lain = (side for side, u in on.items() if side != element and u == 0.0)
    closed = (
        apart(oscillator, element, lain, x[:n])
        if oscillator._bent
        else unlike(oscillator, element, lain)
    )
    return state_at(oscillator, x, v, turn, on[element], element, Motion.TABLE, closed + sticks)


def own_start(oscillator: DrivenStructure, lengths: float = 1.0) -> ImpactState:
    """The default start, with this many characteristic lengths of the machine in place of one."""
    return start(oscillator, None, None, 0.0, None, lengths * oscillator._length)


def _sliding(oscillator: DrivenStructure, x: Array, turn: Array, given: object) -> Array:
    """Positions (N,) and sliders (J,); ValueError if sliders are not finite or beyond reach."""
    own = oscillator._sliders
    if given is None:
        middle = [element.offset + element.swing(*turn.tolist()) for element in own]
        return placed(oscillator, x, np.array(middle))
    places = finite_array("sliders", given, (len(own),))
    out = placed(oscillator, x, places)
    functions = [oscillator._functions[k] for k in oscillator._parts.sliders]
    sizes = np.array([abs(y.gradient(x)) @ abs(x) for y in functions])
    sizes += [e.curved * (1.0 + abs(float(y(x)))) for e, y in zip(own, functions, strict=True)]
    rounding = TOUCHED * (sizes + abs(places))  # slider positions may come from changes of basis
    for k in np.flatnonzero(abs(out[len(x) :] - places) > rounding)[:1].tolist():
        low, high = (float(part[k]) for part in within(oscillator, x))
        raise ValueError(f"sliders[{k}] must lie in [{low}, {high}]; got {places[k]}")
    return out


def entered(oscillator: DrivenStructure, start: ImpactState) -> ImpactState:
    """Convert a state of an oscillator with other parameters to a state of this one.

    A mass on the table is put onto this oscillator's table and keeps its relative velocity.
    Raises Refused if a mass is then beyond a stop.
    """
    if start._system is oscillator or start._system == oscillator:
        return start
    n, turn, u, stands = oscillator.degrees_of_freedom, start._turn, start.speed, oscillator._stops
    if start.position.shape != (n,):
        raise ValueError(f"start must have {n} masses; got {start.position.size}")
    if len(start.sliders) != len(oscillator._sliders):
        own = len(oscillator._sliders)
        raise ValueError(f"start must have {own} sliders; got {len(start.sliders)}")
    x, v = start.position.copy(), start.velocity.copy()
    if start.motion is Motion.FLIGHT:
        for stop, contact in _stands(oscillator):
            place, table = seen_along(contact, x, v)[1], stop.swing(*turn.tolist()) + stop.offset
            if stop.sign * (place - table) < 0.0:
                word = "below" if stop.sign > 0 else "above"
                name = _called(oscillator, stop)
                raise Refused(f"start must not be {word} {name} at {table}; got {place}")
        sticks = sticking(oscillator, x, v, turn, ())
        x, v = placed(oscillator, x, start.sliders), beside(oscillator, v)
        return state_at(oscillator, x, v, turn, u, 0, Motion.FLIGHT, sticks)
    if start.element >= len(stands):
        raise Refused(f"start must not be on a far stop without play; got {start!r}")
    closed = apart(oscillator, start.element, (k for k in start.closed if k < len(stands)), x)
    n, (x, v) = len(x), (beside(oscillator, part) for part in (x, v))
    put_on(oscillator, start.element, closed, (x, v), turn[0], turn[1], u)
    x, v = placed(oscillator, x[:n], start.sliders), v[:n]
    touched(oscillator, x[:n], v, turn, start.element)
    closed += sticking(oscillator, x[:n], v, turn, (start.element, *closed))
    v = beside(oscillator, v)
    # A mass just released by the other table has a contact force of zero there, but not here.
    return state_at(oscillator, x, v, turn, u, start.element, Motion.TABLE, tuple(closed))
