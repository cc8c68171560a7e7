"""Contact with one stop: from the other coordinates of the structure to stuck and free states."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.simulation.state import ImpactState, Motion, state_of

if TYPE_CHECKING:
    from dynkit.systems.impact.impact_map import ImpactMap


def seen(ladder: Any, states: Array, order: int = 0) -> Any:
    """A gap or a force, (...), in states (..., 2, slots), or a derivative of it in time."""
    value = seen_change(ladder, states, order)
    return value + ladder.offset if order == 0 else value


def seen_change(ladder: Any, changes: Array, order: int = 0) -> Any:
    """What changes of states make of it."""
    row = ladder.rows[2 * order : 2 * order + 2]
    return (row * changes[..., : row.shape[1]]).sum(axis=(-2, -1))


@final
class Holding:
    """What happens on one stop of an oscillator.

    Places z (2N - 2,) are the positions and velocities of all coordinates but that in contact.

    Attributes
    ----------
    inward : (2N - 2, 2N - 2)
        Coordinates of the stuck modes, both rows in turn, by the places.
    outward : (2N - 2, 2N - 2)
        The inverse.
    force_row : (2N - 2,)
        Derivative of the contact force by the places.
    """

    def __init__(self, system: ImpactMap, side: int) -> None:
        self.system, self.side = system, side
        self.contact = system._automaton.held(side)
        self.mode = self.contact.mode
        modes = self.mode.layout.modes
        self._state, self._places = self._affine()
        both = np.append(modes, self.mode.layout.slots + modes)
        self.inward = self._state[both, :-3]
        self.outward = self._places[:, both]
        self.force_row = self._whole(self.contact.force.rows[:2])[both] @ self.inward

    def _affine(self) -> tuple[Array, Array]:
        """States by places, sine, cosine and one; places by states and one."""
        others, forced = self.system._contact.others, self.mode.forced
        half, count = len(others), 2 * len(others)
        x, v = np.zeros((2, count + 3, self.system.degrees_of_freedom))
        x[np.arange(half), others] = v[np.arange(half, count), others] = 1.0
        x[-1] -= forced.rest
        v[-1] -= forced.drift
        sine, cosine = np.eye(count + 3)[[count, count + 1]]
        states = self.mode.states(forced.coordinates(x, v, sine, cosine), sine, cosine)
        if self.mode.layout.constant >= 0:
            states[:-1, 0, self.mode.layout.constant] = 0.0

        x, v = self.mode.units()
        x, v = np.vstack([x, forced.rest]), np.vstack([v, forced.drift])
        places = np.concatenate([x[:, others], v[:, others]], axis=1)
        return states.reshape(count + 3, -1).T, places.T

    def _whole(self, row: Array) -> Array:
        """A row of the seen slots as one of all numbers of a state."""
        out = np.zeros((2, self.mode.layout.slots))
        out[:, : row.shape[1]] = row
        return out.ravel()

    # --- states (2, stuck slots) ------------------------------------------------------------------

    def state(self, z: Array, phase: float) -> Array:
        """The stuck state at places and a phase."""
        numbers = np.concatenate([z, [math.sin(phase), math.cos(phase), 1.0]])
        return np.asarray((self._state @ numbers).reshape(2, -1))

    def turned(self, phase: float) -> Array:
        """Derivative of `state` by the phase."""
        turn = np.array([math.cos(phase), -math.sin(phase)])
        return np.asarray((self._state[:, -3:-1] @ turn).reshape(2, -1))

    def places(self, states: Array) -> Array:
        """Places (..., 2N - 2) of stuck states (..., 2, slots)."""
        return self.change(states) + self._places[:, -1]

    def change(self, rates: Array) -> Array:
        """Rates of change of the places by those (..., 2, slots) of stuck states."""
        flat = rates.reshape(*rates.shape[:-2], -1)
        return np.asarray(flat @ self._places[:, :-1].T)

    def force(self, states: Array, order: int = 0) -> Any:
        """The contact force in states (..., 2, slots), or a derivative of it in time."""
        return seen(self.contact.force, states, order)

    # --- from and to free states (2, slots) -------------------------------------------------------

    def released(self, state: Array) -> Array:
        """The free state of a stuck one."""
        return _mapped(self.contact.to_free, state)

    def caught(self, state: Array) -> Array:
        """The stuck state that a free one becomes; its relative velocity is lost."""
        return _mapped(self.contact.to_stuck, state)

    def release(self, z: Array, phase: float) -> ImpactState:
        """The state of the oscillator that is released at places and a phase."""
        q, _, _ = self.system._free.parts(self.released(self.state(z, phase)))
        turn = np.array([math.sin(phase), math.cos(phase)])
        return state_of(self.system, q, turn, 0.0, self.side, Motion.RELEASE)


def _mapped(matrix: Array, state: Array) -> Array:
    """A state (2, slots) in the other basis, by a matrix of the kernels' `Stop`."""
    return np.asarray((matrix[:, :-1] @ state.ravel() + matrix[:, -1]).reshape(2, -1))
