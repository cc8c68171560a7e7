"""States of an impact oscillator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.no_motion import Diverged, Refused
from dynkit.core.validation import Array, finite_array, finite_scalar

if TYPE_CHECKING:
    from dynkit.systems.impact.driven import DrivenStructure
    from dynkit.systems.impact.elements import HardStop

TWO_PI = 2.0 * math.pi

# Coordinates below this make no infinite positions.
_LARGE = 1e100


class Motion(Enum):
    """Where in its motion an impact oscillator is; the value is what the user reads."""

    FLIGHT = "in flight"
    TABLE = "on the table"
    RELEASE = "just released by the table"


@final
@dataclass(frozen=True, eq=False)
class ImpactState:
    """Positions, velocities and phase of an impact oscillator, from its `state` or a record.

    A simulation that starts from a record's final state goes on bit for bit.

    Attributes
    ----------
    speed : float
        Rate of the gap, not negative; exact after an impact, where the difference of two velocities
        would have lost digits. In flight its absolute value.
    element : int
        The stop that it is at: 0 for the table, also in flight, and 1 for the far stop of a play.
    motion : Motion
    """

    speed: float
    element: int
    motion: Motion
    _system: DrivenStructure = field(repr=False)
    _coordinates: Array = field(repr=False)
    _turn: Array = field(repr=False)

    @property
    def relative_velocity(self) -> float:
        """Section coordinate: the speed, negative, if only its zero, on the far side of a play."""
        return -self.speed if self.element == 1 else self.speed

    @property
    def position(self) -> Array:
        """Positions (N,), read-only."""
        return self._place[0]

    @property
    def velocity(self) -> Array:
        """Velocities (N,), read-only."""
        return self._place[1]

    @cached_property
    def phase(self) -> float:
        """Phase of the table in [0, 2 pi)."""
        return float(phases(self._turn[:1], self._turn[1:])[0])

    @cached_property
    def _place(self) -> tuple[Array, Array]:
        """Positions and velocities; on the table those of the contact mass are the table's."""
        system, q, (sine, cosine) = self._system, self._coordinates, self._turn
        forced = system._free.forced
        with np.errstate(over="ignore", invalid="ignore"):
            x, v = forced.positions(q, sine, cosine), forced.velocities(q, sine, cosine)
        if not np.isfinite([x, v]).all():
            raise Diverged(f"the motion runs away: its positions are {x} and its velocities {v}")
        if self.motion is not Motion.FLIGHT:
            place, moving = on_stop(system, self.element, sine, cosine, self.speed)
            system._contact.put(x, place)
            system._contact.put(v, moving)
        x.setflags(write=False)
        v.setflags(write=False)
        return x, v

    def __repr__(self) -> str:
        masses = len(self.position)
        at = f"phase {self.phase:.6g}, relative velocity {self.relative_velocity:.6g}"
        return f"<ImpactState of {masses} coordinates: {self.motion.value}, {at}>"


def state_of(
    oscillator: DrivenStructure, q: Array, turn: Array, speed: float, element: int, motion: Motion
) -> ImpactState:
    """The state with modal coordinates (2, N), and sine and cosine (2,) of the phase.

    Raises
    ------
    Diverged
        When its positions or velocities are infinite.
    """
    q, turn = q.copy(), turn.copy()
    q.setflags(write=False)
    turn.setflags(write=False)
    state = ImpactState(float(speed), element, motion, oscillator, q, turn)
    if not np.vdot(q, q) < _LARGE**2:
        _ = state.position
    return state


def phases(sine: Array, cosine: Array) -> Array:
    """Phases (n,) in [0, 2 pi), of sines and cosines (n,): the same bits in any company.

    NumPy's arctan2 rounds in another way where vectors overlap in memory, or seem to.
    """
    return in_turn(list(map(math.atan2, sine.tolist(), cosine.tolist())))


def in_turn(angles: Any) -> Array:
    """Angles in [0, 2 pi); one that is below zero by less than a turn is rounded to is zero."""
    turned = np.asarray(angles) % TWO_PI
    return np.where(turned < TWO_PI, turned, 0.0)


def on_stop(
    oscillator: DrivenStructure, element: Any, sine: Any, cosine: Any, speed: Any
) -> tuple[Any, Any]:
    """What a stop acts along, and its rate, on the stop: by phase and rate of the gap."""
    offset, sign = np.array([(stop.offset, stop.sign) for stop in oscillator._stops])[element].T
    swings = oscillator._stops[0]
    moving = swings.velocity(oscillator.frequency, sine, cosine)
    return swings.swing(sine, cosine) + offset, moving + sign * speed


def state_at(
    oscillator: DrivenStructure,
    x: Array,
    v: Array,
    turn: Array,
    speed: float,
    element: int,
    motion: Motion,
) -> ImpactState:
    """The state at positions and velocities (N,), and sine and cosine (2,) of the phase."""
    forced = oscillator._free.forced
    with np.errstate(over="ignore", invalid="ignore"):
        q = forced.coordinates(x - forced.rest, v - forced.drift, *turn)
    if not np.isfinite(q).all():
        raise Refused(f"positions and velocities must not overflow; got {x} and {v}")
    return state_of(oscillator, q, turn, speed, element, motion)


# The first mode has a node at the contact mass where that moves less than this part of the largest:
# half of a double's digits, so that its displacement there is not all rounding.
_NODE = 2.0**-26


def _rounding(place: float, amplitude: float, offset: float) -> float:
    """What rounding leaves of a gap of zero."""
    return 4.0 * 2.0**-53 * (abs(place) + amplitude + abs(offset))


def default_position(oscillator: DrivenStructure, angle: float) -> Array:
    """The shape of the first mode, of modal amplitude one where a mass at rest may be there."""
    near, shape = oscillator._stops[0], oscillator.modal_matrix[:, 0]
    contact, play = oscillator._contact, oscillator.play
    place = float(contact.row @ shape)
    x: Array = shape * near.sign * (-1.0 if place < 0.0 else 1.0)
    turn = math.sin(angle), math.cos(angle)
    table = float(near.swing(*turn) + near.offset)
    gap = near.sign * (float(contact.row @ x) - table)
    # rate of the gap of a mass at rest: on a stop that moves towards it, it cannot be
    rate = -near.sign * near.velocity(oscillator.frequency, *turn)
    rounding = _rounding(place, oscillator.amplitude, near.offset)
    clear = gap > rounding or (gap >= 0.0 and rate >= 0.0)
    if clear and (gap < play - rounding or (gap <= play and rate <= 0.0)):
        return x
    lifted = table + near.sign * min(1.0, 0.5 * play)
    if abs(place) > _NODE * float(abs(shape).max()):
        return shape * (lifted / place)
    contact.put(x, lifted)
    return x


def start(
    oscillator: DrivenStructure, position: object, velocity: object, phase: object
) -> ImpactState:
    """A state to start from, at the defaults where None is given; ValueError beyond a stop."""
    n = oscillator.degrees_of_freedom
    angle = finite_scalar("phase", phase)
    given = default_position(oscillator, angle) if position is None else position
    x = finite_array("position", given, (n,))
    v = finite_array("velocity", np.zeros(n) if velocity is None else velocity, (n,))
    turn = np.array([math.sin(angle), math.cos(angle)])
    row, near = oscillator._contact.row, oscillator._stops[0]
    sine, cosine = turn.tolist()
    middle, speed = near.swing(sine, cosine), near.velocity(oscillator.frequency, sine, cosine)
    place, moving = float(row @ x), float(row @ v)
    for side, stop in enumerate(oscillator._stops):
        table = middle + stop.offset
        gap, u = stop.sign * (place - table), stop.sign * (moving - speed)
        rounding = _rounding(float(abs(row) @ abs(x)), oscillator.amplitude, stop.offset)
        word = "below" if stop.sign > 0 else "above"
        if gap < -rounding:
            what = _along(stop, "position")
            raise Refused(f"{what} must not be {word} the table at {table}; got {place}")
        if gap <= rounding:
            rounding = 4.0 * 2.0**-53 * (abs(row) @ abs(v) + abs(speed))
            if u < -rounding:
                what = _along(stop, "velocity")
                raise Refused(
                    f"{what} must not be {word} the table's {speed} when the mass is on "
                    f"the table; got {moving}"
                )
            u = 0.0 if u <= rounding else u
            return state_at(oscillator, x, v, turn, u, side, Motion.TABLE)
    u = oscillator._stops[0].sign * (moving - speed)
    return state_at(oscillator, x, v, turn, abs(u), 0, Motion.FLIGHT)


def _along(stop: HardStop, name: str) -> str:
    """Of positions or velocities, by name, what a stop acts along."""
    given = stop.coordinate
    if isinstance(given, int):
        return f"{name}[{given}]"
    if isinstance(given[0], int):
        return f"{name}[{given[1]}] - {name}[{given[0]}]"
    return f"{name} along {given}"


def entered(oscillator: DrivenStructure, start: ImpactState) -> ImpactState:
    """A state of this oscillator, from one of an oscillator with other parameters.

    On the table the contact mass is put onto the table of this oscillator, with the same relative
    velocity.
    """
    if start._system is oscillator or start._system == oscillator:
        return start
    n, contact = oscillator.degrees_of_freedom, oscillator._contact
    if start.position.shape != (n,):
        raise ValueError(f"start must have {n} masses; got {start.position.size}")
    turn = start._turn
    x, v, u = start.position.copy(), start.velocity.copy(), start.speed
    stands = oscillator._stops
    if start.motion is Motion.FLIGHT:
        place = float(contact.row @ x)
        for stop in stands:
            table = stop.swing(*turn.tolist()) + stop.offset
            if stop.sign * (place - table) < 0.0:
                word = "below" if stop.sign > 0 else "above"
                raise Refused(f"start must not be {word} the table at {table}; got {place}")
        return state_at(oscillator, x, v, turn, u, 0, Motion.FLIGHT)
    if start.element >= len(stands):
        raise Refused(f"start must not be on a far stop without play; got {start!r}")
    place, moving = on_stop(oscillator, start.element, turn[0], turn[1], u)
    contact.put(x, place)
    contact.put(v, moving)
    # Where the table released it under other parameters, its contact force is not zero here.
    return state_at(oscillator, x, v, turn, u, start.element, Motion.TABLE)


def section_of(oscillator: DrivenStructure, state: ImpactState) -> Array:
    """Section coordinates (2N,) of a state on the table."""
    others = oscillator._contact.others
    x, v = state.position[others], state.velocity[others]
    return np.concatenate([x, v, [state.relative_velocity, state.phase]])


def on_section(oscillator: DrivenStructure, coordinates: object) -> ImpactState:
    """The state just after an impact with these section coordinates (2N,); ValueError for none."""
    y = finite_array("state", coordinates, (oscillator.dimension,))
    n, stands = oscillator.degrees_of_freedom, oscillator._stops
    others = oscillator._contact.others
    u, phase = float(y[-2]), float(y[-1])
    if len(stands) == 1:
        if u < 0.0:
            raise Refused(f"state[{2 * n - 2}] must not be negative; got {u}")
        u += 0.0
    # the sign of a section coordinate, and that of its zero, tells the stop
    element, speed = int(math.copysign(1.0, u) < 0.0), abs(u)
    turn = np.array([math.sin(phase), math.cos(phase)])
    x, v = np.empty(n), np.empty(n)
    x[others], v[others] = y[: n - 1], y[n - 1 : -2]
    place, moving = on_stop(oscillator, element, turn[0], turn[1], speed)
    oscillator._contact.put(x, place)
    oscillator._contact.put(v, moving)
    return state_at(oscillator, x, v, turn, speed, element, Motion.TABLE)


def packed(state: ImpactState) -> Array:
    """All numbers of a state, (2N + 5,)."""
    motion = tuple(Motion).index(state.motion)
    own = [motion, state.element, state.speed, *state._turn.tolist()]
    return np.concatenate([own, state._coordinates.ravel()])


def unpacked(oscillator: DrivenStructure, numbers: object) -> ImpactState:
    """The state that `packed` turned into numbers."""
    n = oscillator.degrees_of_freedom
    array = finite_array("packed", numbers, (5 + 2 * n,))
    motion, element = tuple(Motion)[int(array[0])], int(array[1])
    q, turn = array[5:].reshape(2, n), array[3:5]
    return state_of(oscillator, q, turn, float(array[2]), element, motion)
