"""Contact with one stop: from the other coordinates of the structure to stuck and free states."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.systems.impact.motion import evolve, transformed
from dynkit.systems.impact.state import ImpactState, Motion, state_of
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator


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
    """

    def __init__(self, system: ImpactOscillator, side: int) -> None:
        self.system, self.side = system, side
        self.contact = system._contacts[side]
        self.regime = self.contact.regime
        self._others = system._structure.others
        count = 2 * len(self._others)
        x, v = np.zeros((2, count, system.degrees_of_freedom))
        half = np.arange(len(self._others))
        x[half, self._others] = v[half + len(half), self._others] = 1.0
        none = np.zeros(count)
        self.inward = self.regime.forced.coordinates(x, v, none, none).reshape(count, count).T
        units = np.eye(count).reshape(count, 2, len(half))
        self.outward = self._places(units, none, none, still=False).T

    def _places(self, q: Array, sine: Any, cosine: Any, *, still: bool) -> Array:
        """Places (..., 2N - 2) of coordinates (..., 2, N - 1), or their linear part."""
        forced = self.regime.forced
        x, v = forced.displacements(q, sine, cosine), forced.speeds(q, sine, cosine)
        if still:
            x, v = x + forced.rest, v + forced.drift
        return np.concatenate([x[..., self._others], v[..., self._others]], axis=-1)

    # --- states (2, stuck slots) ------------------------------------------------------------------

    def state(self, z: Array, phase: float) -> Array:
        """The stuck state at places and a phase."""
        return self._state(z, math.sin(phase), math.cos(phase), still=True)

    def turned(self, phase: float) -> Array:
        """Derivative of `state` by the phase."""
        return self._state(np.zeros(len(self.inward)), math.cos(phase), -math.sin(phase))

    def _state(self, z: Array, sine: float, cosine: float, *, still: bool = False) -> Array:
        forced, n = self.regime.forced, self.system.degrees_of_freedom
        x, v = np.zeros((2, n))
        x[self._others], v[self._others] = z.reshape(2, -1)
        if still:
            x, v = x - forced.rest, v - forced.drift
        state = self.regime.states(forced.coordinates(x, v, sine, cosine), sine, cosine)
        if not still and self.regime.layout.constant >= 0:
            state[0, self.regime.layout.constant] = 0.0
        return np.asarray(state)

    def places(self, state: Array) -> Array:
        """Places of a stuck state."""
        return self._places(*self.regime.parts(state), still=True)

    def change(self, rates: Array) -> Array:
        """Rates of change of the places by those (2, slots) of a stuck state."""
        return self._places(*self.regime.parts(rates), still=False)

    def force(self, states: Array, order: int = 0) -> Any:
        """The contact force in states (..., 2, slots), or a derivative of it in time."""
        ladder = self.contact.force
        row = ladder.rows[2 * order : 2 * order + 2]
        value = (row * states[..., : row.shape[1]]).sum(axis=(-2, -1))
        return value + ladder.offset if order == 0 else value

    def force_slope(self, change: Array) -> float:
        """Change of the contact force by a change of the stuck state."""
        row = self.contact.force.rows[:2]
        return float((row * change[:, : row.shape[1]]).sum())

    @property
    def force_row(self) -> Array:
        """Derivative (2N - 2,) of the contact force by the places."""
        row = np.zeros((2, self.regime.layout.slots))
        seen = self.contact.force.rows[:2]
        row[:, : seen.shape[1]] = seen
        return np.asarray(row[:, self.regime.layout.modes].ravel() @ self.inward)

    def release(self, z: Array, phase: float) -> ImpactState:
        """The state of the oscillator that is released at places and a phase."""
        free = self.system._free
        q, _, _ = free.parts(self.released(self.state(z, phase)))
        turn = np.array([math.sin(phase), math.cos(phase)])
        return state_of(self.system, q, turn, math.copysign(0.0, 0.5 - self.side), Motion.RELEASE)

    # --- from and to free states (2, slots) -------------------------------------------------------

    def released(self, state: Array) -> Array:
        """The free state of a stuck one."""
        return np.asarray(transformed(self.contact.to_free, state[None])[0])

    def caught(self, state: Array) -> Array:
        """The stuck state that a free one becomes; its relative velocity is lost."""
        return np.asarray(transformed(self.contact.to_stuck, state[None])[0])

    def after(self, state: Array, durations: Array) -> Array:
        """Stuck states (k, 2, slots) at durations (k,) after one."""
        which = np.zeros(len(durations), dtype=np.intp)
        return evolve(self.contact.force, state[None], which, durations)
