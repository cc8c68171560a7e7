"""States of an impact oscillator, and its section coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import Diverged, Refused
from dynkit.core.validation import Array, all_finite, finite_array
from dynkit.exponential.sums import band
from dynkit.systems.impact.modes.constrained import rides
from dynkit.systems.impact.modes.curves import CurvedContact
from dynkit.systems.impact.modes.structure import independent

if TYPE_CHECKING:
    from dynkit.systems.impact.elements.element import Element
    from dynkit.systems.impact.elements.stops import HardStop
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

TWO_PI = 2.0 * math.pi

LARGE = 1e100
"""Modal coordinates with a smaller norm give finite positions and velocities."""


class Motion(Enum):
    """Phase of the motion of an impact oscillator; the value is the text that users read."""

    FLIGHT = "in flight"
    TABLE = "on the table"
    RELEASE = "just released by the table"


MOTIONS = (Motion.FLIGHT, Motion.TABLE, Motion.RELEASE, Motion.TABLE)
"""The phases of the motion at the first four values of `clock_kernels.MOTION`."""


@final
@dataclass(frozen=True, eq=False)
class ImpactState:
    """Positions, velocities and phase of an impact oscillator, from `state` or from a record.

    A simulation from a record's final state continues the record's simulation bit for bit.

    Attributes
    ----------
    speed : float
        Absolute value of the rate of the gap. After an impact it is stored, since the difference
        of two velocities would lose digits.
    element : int
        Number of the stop that was hit: 0 for the table, 1 for the far stop of a play; of
        ``elements`` the number among the hard stops. At a start in flight it is 0.
    motion : Motion
    closed : tuple of int
        Numbers of other stops that are in contact, and of friction elements that stick.
    """

    _stored: ClassVar = ("speed", "element", "motion", "closed", "_coordinates", "_turn")
    _given: ClassVar = "_system"
    speed: float
    element: int
    motion: Motion
    closed: tuple[int, ...]
    _system: DrivenStructure = field(repr=False)
    _coordinates: Array = field(repr=False)
    _turn: Array = field(repr=False)

    def _restored(self) -> Self:
        elements = len(self._system._elements)
        if self._coordinates.shape != (2, self._system._size) or self._turn.shape != (2,):
            raise ValueError(f"a state is {self._coordinates.shape} and {self._turn.shape}")
        if not all(0 <= k < elements for k in (self.element * bool(elements), *self.closed)):
            raise ValueError(f"elements {self.element} and {self.closed} of {elements}")
        return self

    @property
    def _numbers(self) -> tuple[Any, ...]:
        """All data of the state except its oscillator."""
        return self.speed, self.element, self.motion, self.closed, self._coordinates, self._turn

    @property
    def relative_velocity(self) -> float:
        """Section coordinate u: the speed; negative, or -0.0, at the far stop of a play."""
        return -self.speed if self.element == 1 and self._system._faces else self.speed

    @property
    def position(self) -> Array:
        """Positions (N,), read-only."""
        return self._place[0][: self._system.degrees_of_freedom]

    @property
    def velocity(self) -> Array:
        """Velocities (N,), read-only."""
        return self._place[1][: self._system.degrees_of_freedom]

    @property
    def sliders(self) -> Array:
        """Positions (J,) of the sliders of `Jenkins` elements, read-only."""
        return self._place[0][self._system.degrees_of_freedom :]

    @cached_property
    def phase(self) -> float:
        """Phase of the table in [0, 2 pi)."""
        return float(phases(self._turn[:1], self._turn[1:])[0])

    @cached_property
    def _place(self) -> tuple[Array, Array]:
        """Positions and velocities (N + J,); except in flight, they are put onto the stop."""
        system, q, (sine, cosine) = self._system, self._coordinates, self._turn
        forced = system._free.forced
        with np.errstate(over="ignore", invalid="ignore"):
            x, v = forced.positions(q, sine, cosine), forced.velocities(q, sine, cosine)
        if not (all_finite(x) and all_finite(v)):
            raise Diverged(f"the motion runs away: its positions are {x} and its velocities {v}")
        if self.motion is not Motion.FLIGHT:
            put_on(system, self.element, self.closed, (x, v), sine, cosine, self.speed)
        x.setflags(write=False)
        v.setflags(write=False)
        return x, v

    def __repr__(self) -> str:
        masses = len(self.position)
        at = f"phase {self.phase:.6g}, relative velocity {self.relative_velocity:.6g}"
        return f"<ImpactState of {masses} coordinates: {self.motion.value}, {at}>"


def state_of(
    oscillator: DrivenStructure,
    q: Array,
    turn: Array,
    speed: float,
    element: int,
    motion: Motion,
    closed: tuple[int, ...] = (),
) -> ImpactState:
    """The state with modal coordinates (2, N), and sine and cosine (2,) of the phase.

    Raises
    ------
    Diverged
        When positions or velocities of the state are infinite.
    """
    q, turn = q.copy(), turn.copy()
    q.setflags(write=False)
    turn.setflags(write=False)
    state = ImpactState(float(speed), element, motion, closed, oscillator, q, turn)
    if not np.vdot(q, q) < LARGE**2:
        _ = state.position
    return state


def phases(sine: Array, cosine: Array) -> Array:
    """Phases (n,) in [0, 2 pi) of sines and cosines (n,).

    The bits of one phase do not depend on the other ones. NumPy's arctan2 may round differently
    where arrays overlap in memory, or seem to.
    """
    return in_turn(list(map(math.atan2, sine.tolist(), cosine.tolist())))


def turning(angles: Array) -> Array:
    """Sines and cosines of phases (k,), and ones: (k, 3)."""
    out = np.ones((len(angles), 3))
    out[:, 0], out[:, 1] = np.sin(angles), np.cos(angles)
    return out


def whole_states(mode: Any, states: Array, angles: Array) -> Array:
    """Positions, velocities, slider positions and `turning` (k, D) of states (k, 2, slots)."""
    parts = *mode.motion(states), mode.sliders(states), turning(angles)
    return np.concatenate(parts, axis=1)


def on_stop(stop: HardStop, frequency: float, turn: Any, speed: Any) -> tuple[Any, Any]:
    """Contact coordinate and its rate on a stop, for a phase and a rate `speed` of the gap."""
    rate = stop.swing_rate(frequency, *turn) + stop.sign * speed
    return stop.swing(*turn) + stop.offset, rate


def put_on(
    oscillator: DrivenStructure,
    element: int,
    closed: Iterable[int],
    state: tuple[Array, Array],
    sine: Any,
    cosine: Any,
    speed: Any,
) -> None:
    """Put positions and velocities (..., N) onto a stop and other closed stops, in place."""
    stops, w, turn = oscillator._stops, oscillator.frequency, (sine, cosine)
    others = [k for k in closed if k < len(stops)]
    totals = [on_stop(stops[element], w, turn, speed)]
    totals += [on_stop(stops[k], w, turn, 0.0) for k in others]
    if oscillator._bent:  # the stops are met in turn; `element`, the last one, is met to rounding
        pairs = list(zip((element, *others), totals, strict=True))
        for k, total in [*pairs[1:], pairs[0]] * (_TURNS if others else 1):
            oscillator._contacts[k].put_both(*state, *total)
        return
    for x, own in zip(state, zip(*totals, strict=True), strict=True):
        if not others:
            oscillator._contacts[element].put(x, own[0])
        else:
            rows = np.array([oscillator._contacts[k].row for k in (element, *others)])
            kept = independent(rows)  # the other rows depend on these
            values = np.stack(own, axis=-1)[..., kept]
            oscillator._structure.holding(rows[kept]).put(x, values)


_TURNS = 40
"""Rounds in which positions are put onto each of several stops along functions in turn."""


def state_at(
    oscillator: DrivenStructure,
    x: Array,
    v: Array,
    turn: Array,
    speed: float,
    element: int,
    motion: Motion,
    closed: tuple[int, ...] = (),
) -> ImpactState:
    """The state at positions and velocities (N + J,), and sine and cosine (2,) of the phase."""
    with np.errstate(over="ignore", invalid="ignore"):
        q = oscillator._free.coordinates(x, v, *turn)
    if not all_finite(q):
        raise Refused(f"positions and velocities must not overflow; got {x} and {v}")
    return state_of(oscillator, q, turn, speed, element, motion, closed)


def without_shift(state: ImpactState) -> ImpactState:
    """The same state with its progression set to zero, for a machine that progresses."""
    system, along = state._system, state._system._progression
    if not along.shift.size:
        return state
    n, (x, v) = system.degrees_of_freedom, state._place
    z = along.removed(np.concatenate([x[:n], v[:n], x[n:]]))
    own = state.speed, state.element, state.motion, state.closed
    return state_at(system, np.append(z[:n], z[2 * n :]), v, state._turn, *own)


def beside(oscillator: DrivenStructure, x: Array) -> Array:
    """Positions or velocities (N,), followed by zeros for those of sliders: (N + J,)."""
    return np.pad(x, (0, len(oscillator._sliders))) if oscillator._sliders else x


def placed(oscillator: DrivenStructure, x: Array, sliders: Array) -> Array:
    """Positions (N,) and those of sliders (J,); sliders beyond their reach are moved to it."""
    if not oscillator._sliders:
        return x[: oscillator.degrees_of_freedom]
    low, high = within(oscillator, x)
    return np.concatenate([x, np.clip(sliders, low, high)])


def within(oscillator: DrivenStructure, x: Array) -> tuple[Array, Array]:
    """Lower and upper limits (J,) of the positions of sliders, at positions (N,)."""
    reach = [element.reach for element in oscillator._sliders]
    along = np.array([oscillator._functions[k](x) for k in oscillator._parts.sliders])
    return along - reach, along + reach


SHEET = 2.0 * TWO_PI
"""Offset of the phase among the section coordinates from one of several stops to the next."""


def section_of(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Section coordinates of a state on a stop.

    Without hard stops they are positions, velocities and sliders.
    """
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        kept = state.position[positions], state.velocity[velocities], state.sliders
        return np.concatenate(kept)
    others = oscillator._others[state.element]
    x, v = state.position[others], state.velocity[others]
    phase = state.phase + SHEET * state.element * oscillator._several
    return np.concatenate([x, v, state.sliders, [state.relative_velocity, phase]])


def sheet_of(phase: Any) -> Any:
    """Number of the stop of section coordinates, from the last coordinate; for several stops."""
    return np.rint((phase - math.pi) / SHEET)


def on_section(oscillator: DrivenStructure, coordinates: object) -> ImpactState:
    """The state just after an impact with these section coordinates; ValueError if there is none.

    Sliders beyond their reach are moved to it.
    """
    y = finite_array("state", coordinates, (oscillator.dimension,))
    n, stands = oscillator.degrees_of_freedom, oscillator._stops
    if oscillator._strobed:
        positions, velocities = oscillator._crossed.kept
        ends = np.cumsum([len(positions), len(velocities)])
        turn, (x, v) = np.array([0.0, 1.0]), np.zeros((2, oscillator._size))
        x[positions], v[velocities], sliders = np.split(y, ends)
        oscillator._crossed.put(x, v)
        sticks = sticking(oscillator, x[:n], v[:n], turn, ())
        x = placed(oscillator, x[:n], sliders)
        return state_at(oscillator, x, v, turn, 0.0, 0, Motion.FLIGHT, sticks)
    u, phase = float(y[-2]), float(y[-1])
    if not oscillator._faces:
        if u < 0.0:
            raise Refused(f"state[{len(y) - 2}] must not be negative; got {u}")
        u += 0.0
    # The sign of the relative velocity, also that of a zero, identifies the stop of a play.
    element, speed = int(math.copysign(1.0, u) < 0.0), abs(u)
    if oscillator._several:
        element = int(sheet_of(phase))
        if not 0 <= element < len(stands):
            raise Refused(
                f"state[{len(y) - 1}] must be a phase and 4 pi times the number of one of "
                f"{len(stands)} stops; got {phase}"
            )
        phase -= SHEET * element
    turn = np.array([math.sin(phase), math.cos(phase)])
    x, v = np.zeros((2, n))
    others = oscillator._others[element]
    m = len(others)
    x[others], v[others] = y[:m], y[m : 2 * m]
    x, v = (beside(oscillator, part) for part in (x, v))
    put_on(oscillator, element, (), (x, v), turn[0], turn[1], speed)
    x = placed(oscillator, x[:n], y[2 * m : -2])
    closed = touched(oscillator, x[:n], v[:n], turn, element)
    closed += sticking(oscillator, x[:n], v[:n], turn, (element, *closed))
    return state_at(oscillator, x, v, turn, speed, element, Motion.TABLE, closed)


def touched(
    oscillator: DrivenStructure, x: Array, v: Array, turn: Array, element: int
) -> tuple[int, ...]:
    """Other stops on which a structure rests, to rounding; Refused if it is beyond one of them."""
    if not oscillator._several:
        return ()
    found = []
    stands = zip(oscillator._stops, oscillator._contacts, strict=True)
    for k, (stop, contact) in enumerate(stands):
        row, *seen = seen_along(contact, x, v)
        prescribed = on_stop(stop, oscillator.frequency, turn, 0.0)
        gap, rate = (stop.sign * (a - b) for a, b in zip(seen, prescribed, strict=True))
        near = TOUCHED * (_rounding(row, x) + stop.amplitude + abs(stop.offset))
        slow = TOUCHED * (_rounding(row, v) + abs(prescribed[1]))
        if k != element and gap < -near:
            raise Refused(f"{along(stop, 'position')} must not be beyond stop {k}, by {-gap}")
        if k != element and gap <= near and abs(rate) <= slow:
            found.append(k)
    return apart(oscillator, element, found, x)


def seen_along(contact: Any, x: Array, v: Array) -> tuple[Array, float, float]:
    """Row (N,) of a contact, and its coordinate and rate, at positions and velocities (N,)."""
    if isinstance(contact, CurvedContact):
        row = contact.function.gradient(x)
        return row, float(contact.function(x)), float(row @ v)
    row = contact.row[: len(x)]
    return row, float(row @ x), float(row @ v)


def apart(
    oscillator: DrivenStructure, element: int, others: Iterable[int], x: Array
) -> tuple[int, ...]:
    """Of other stops, those whose rows are independent of the stop's row and of earlier ones.

    Rows are taken at positions `x` (N,).
    """
    found, stops = [element], oscillator._stops
    if oscillator._bent:
        every = [element, *(k for k in others if k != element)]
        rows = [seen_along(oscillator._contacts[k], x, x)[0] for k in every]
        return tuple(every[k] for k in independent(np.array(rows)) if k)
    for k in others if len(stops) > 1 else ():
        if rides(oscillator._structure, [stops[j] for j in found], stops[k]) is False:
            found.append(k)
    return tuple(found[1:])


def unlike(oscillator: DrivenStructure, element: int, others: Iterable[int]) -> tuple[int, ...]:
    """Of other stops, those whose rows differ from the row of the stop and of each earlier one."""
    found, stops = [element], oscillator._stops
    for k in others:
        if all(rides(oscillator._structure, [stops[j]], stops[k]) is False for j in found):
            found.append(k)
    return tuple(found[1:])


def sticking(
    oscillator: DrivenStructure, x: Array, v: Array, turn: Array, touched: tuple[int, ...]
) -> tuple[int, ...]:
    """Friction elements that do not slip, to rounding, on rows that the touched stops do not hold.

    Also soft stops with a preload on which a mass rests, if no other element that may hold or stick
    acts along the same row.
    """
    found, elements, normal = [], oscillator._elements, oscillator._automaton.parts.normal
    parts = oscillator._automaton.parts
    for k, element in enumerate(elements):
        off = normal.get(k, -1) not in (-1, *touched)
        if any(regime.sticks for regime in element.regimes) and not off:
            row = oscillator._functions[k].gradient(x)
            speed = element.drift + element.swing_rate(oscillator.frequency, *turn.tolist())
            slip, size = abs(float(row @ v) - speed), _rounding(row, v) + abs(speed)
            still = slip <= TOUCHED * size or slip <= _hidden(oscillator, k, slip, x, v, turn)
            if still and parts.along(touched, k) is False:
                found.append(k)
        elif any(regime.holds for regime in element.regimes) and k >= len(oscillator._stops):
            rows = [f.gradient(x) for f in oscillator._functions]
            others = [
                r for r, e in zip(rows, elements, strict=True) if e is not element and _binds(e)
            ]
            alone = all(np.linalg.matrix_rank(np.array([rows[k], r])) > 1 for r in others)
            if alone and parts.along(touched, k) is False:
                found += [k] * _rests(oscillator, k, x, v, turn)
    return tuple(found)


def _binds(element: Element) -> bool:
    return any(regime.holds or regime.sticks for regime in element.regimes)


def _rests(oscillator: DrivenStructure, k: int, x: Array, v: Array, turn: Array) -> bool:
    """Whether the gap of element `k` and its rate are zero, to rounding."""
    element, function = oscillator._elements[k], oscillator._functions[k]
    row, swing = function.gradient(x), float(element.swing(*turn.tolist()))
    speed = float(element.swing_rate(oscillator.frequency, *turn.tolist()))
    pairs = (x, function(x), (swing, element.offset)), (v, row @ v, (speed,))
    return all(
        abs(float(seen) - sum(own)) <= TOUCHED * (_rounding(row, part) + sum(map(abs, own)))
        for part, seen, own in pairs
    )


def _rounding(row: Array, part: Array) -> float:
    """Size that scales the rounding errors of a sum along a row.

    It contains the largest of all coordinates, since changes of basis mix them.
    """
    return float(abs(row).sum() * abs(part).max())


def _hidden(
    oscillator: DrivenStructure, k: int, slip: float, x: Array, v: Array, turn: Array
) -> float:
    """Slip velocity that rounding hides in the exponential sum of the slip; 0 for fast slip.

    Even if all masses are at rest, this sum may have large terms: those of the steady response.
    """
    free, automaton = oscillator._free, oscillator._automaton
    slow = oscillator.frequency * abs(x).max() + abs(v).max()
    if oscillator._motion is not None or slip > _SLOW * (slow + abs(free.forced.turning).max()):
        return 0.0
    more = np.zeros(oscillator._size - len(x))
    q = free.coordinates(np.append(x, more), np.append(v, more), *turn)
    return 2.0 * band(automaton.guards[automaton.guard(0, k)].sum, free.states(q, *turn))


_SLOW = 1e-6
"""Slip faster than this part of the machine's velocities is never hidden by rounding."""

TOUCHED = 2.0**-46
"""Relative size below which a gap or rate counts as zero, relative to the terms of its difference.
Rounding errors of a change of basis are smaller."""


def along(stop: HardStop, name: str) -> str:
    """Name of the coordinate along which a stop acts, for "position" or "velocity"."""
    given = stop.coordinate
    if isinstance(given, str):
        return f"{given} of the {name}"
    if isinstance(given, int):
        return f"{name}[{given}]"
    if isinstance(given[0], int):
        return f"{name}[{given[1]}] - {name}[{given[0]}]"
    return f"{name} along {given}"


def packed(state: ImpactState) -> Array:
    """All numbers of a state, (2N + 2J + 5,), and one for each of `_holding` elements.

    N and J are the numbers of coordinates and of sliders.
    """
    motion = tuple(Motion).index(state.motion)
    own = [motion, state.element, state.speed, *state._turn.tolist()]
    closed = [k in state.closed for k in range(state._system._holding)]
    return np.concatenate([own, state._coordinates.ravel(), closed])


def unpacked(oscillator: DrivenStructure, numbers: object) -> ImpactState:
    """The state with these numbers, made by `packed`."""
    n = oscillator._size
    array = finite_array("packed", numbers, (5 + 2 * n + oscillator._holding,))
    motion, element = tuple(Motion)[int(array[0])], int(array[1])
    q, turn = array[5 : 5 + 2 * n].reshape(2, n), array[3:5]
    closed = tuple(np.flatnonzero(array[5 + 2 * n :]).tolist())
    return state_of(oscillator, q, turn, float(array[2]), element, motion, closed)
