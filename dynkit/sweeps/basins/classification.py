"""Simulation of single starts: label, a state of the orbit, and its distance from settling."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import Diverged, NoCrossing, NoMotion, Refused
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import Anything, Rows
from dynkit.labels.label import OrbitKind, OrbitLabel, empty_columns, put_label

UNSETTLED, RUNS_AWAY, NO_CROSSING, NO_STATE, NO_MOTION = -1, -2, -3, -4, -5

OTHER_ENDS = {
    UNSETTLED: "unsettled",
    RUNS_AWAY: "runs away",
    NO_CROSSING: "comes to no next crossing",
    NO_STATE: "no state of the system",
    NO_MOTION: "cannot be followed",
}
"""Outcomes of starts that lead to no attractor, by number."""

SETTLED = 1e-10
"""Largest recurrence of a settled periodic motion, relative to starts and states."""

# Largest number of states in which a labelled motion may settle.
_BUDGET = 20_000
# Largest ratio of successive recurrences that is distinguished from one, and relative rounding of a
# recurrence.
_SLOWEST, _ROUNDING = 0.9999, 1e-13


@final
@dataclass(frozen=True, eq=False)
class Look:
    """Simulation of starts, (n, s), to rows of the engine; small and picklable.

    Parameters
    ----------
    system : Map
    transient, keep : int
    scale : float
        The largest number of all starts.
    sizes : (int, int)
        Number of coordinates of a section state, and length of a packed state.
    """

    system: Map
    transient: int
    keep: int
    scale: float
    sizes: tuple[int, int]

    @property
    def entries(self) -> dict[str, str]:
        """Entries of a store that identify it."""
        return {"transient": str(self.transient), "keep": str(self.keep)}

    def motion(self, start: Array) -> Attractor:
        """Simulate from a start."""
        return self._moved(self.system.state_from(start), self.transient)

    def _moved(self, state: Any, transient: int) -> Attractor:
        """Simulate from a state.

        A motion near an unstable orbit leaves it, but slowly. A motion that is still there after
        `_BUDGET` more states lies on the orbit.
        """
        motion = self.system.attractor(start=state, transient=transient, keep=self.keep)
        if motion.label.stable is not False:
            return motion
        return self.system.attractor(start=motion.final, transient=_BUDGET, keep=self.keep)

    def states_after(self, state: Any, count: int) -> tuple[Array, Any]:
        """Return the next states, (count, d), after a state, and the start after the last state.

        There are fewer states when the motion ends.
        """
        motion = self.system.attractor(start=state, transient=1, keep=count)
        return self.states_of(motion), motion.final

    def states_of(self, motion: Attractor) -> Array:
        """Return the kept states, (n, d), of a motion, without the shift that has no effect."""
        return self.system.without_shift(motion.states)

    def __call__(self, starts: Array) -> Rows:
        """Return the rows of some starts."""
        began = time.perf_counter()
        return self._rows([self._seen(start) for start in starts], began)

    def rows_from(self, states: Sequence[Any]) -> Rows:
        """Return the rows of some states, without a transient."""
        began = time.perf_counter()
        return self._rows([self._followed(state, 0) for state in states], began)

    def _rows(self, seen: Sequence[Attractor | int], began: float) -> Rows:
        n = len(seen)
        arrays: dict[str, Anything] = {
            **empty_columns(n, UNSETTLED),
            "rest": np.full(n, np.nan),
            "state": np.full((n, self.sizes[0]), np.nan),
            "final": np.full((n, self.sizes[1]), np.nan),
        }
        endings, cost = [], Cost(0.0)
        for place, motion in enumerate(seen):
            if isinstance(motion, int):
                arrays["kind"][place] = motion
                endings.append(OTHER_ENDS[motion])
                continue
            label = motion.label
            put_label(arrays, place, label)
            if label.kind is OrbitKind.UNSETTLED:
                arrays["kind"][place] = UNSETTLED
            endings.append(str(motion.ending.value))
            cost = cost + Cost(0.0, motion.cost.counts)
            if label.kind in (OrbitKind.PERIODIC, OrbitKind.STICKING):
                state, final, rest = self._settled(motion, label)
            elif label.kind is OrbitKind.CHAOTIC:
                state, final, rest = self.states_of(motion)[-1], motion.final, np.nan
            elif label.kind is OrbitKind.QUASI_PERIODIC:
                states, final = self.states_after(motion.final, label.simulated)
                state, rest = states[-1], np.nan
            else:
                continue
            arrays["state"][place], arrays["rest"][place] = state, rest
            arrays["final"][place] = self.system.pack_state(final)
        return Rows(arrays, {"ending": endings}, cost + Cost(time.perf_counter() - began))

    def _seen(self, start: Array) -> Attractor | int:
        try:
            state = self.system.state_from(start)
        except Refused:
            return NO_STATE
        return self._followed(state, self.transient)

    def _followed(self, state: Any, transient: int) -> Attractor | int:
        """Return the labelled motion from a state, or the number in `OTHER_ENDS` of its outcome."""
        try:
            motion = self._moved(state, transient)
            _ = motion.label
        except NoCrossing:
            return NO_CROSSING
        except Diverged:
            return RUNS_AWAY
        except NoMotion:
            return NO_MOTION
        return motion

    def _settled(self, motion: Attractor, label: OrbitLabel) -> tuple[Array, Any, float]:
        """Simulate a periodic motion until it has settled.

        Returns
        -------
        state : (d,) array
            The settled state of the largest norm.
        final
            The start after the last state.
        rest : float
            Distance to the orbit, estimated from the decrease of the recurrence.
        """
        difference, window = self.system.difference, orbit_size(label)
        states, final, seen = self.states_of(motion), motion.final, 0
        later = label.simulated - len(states)
        if later > 0:  # the label describes later states; kept ones may lie near another orbit
            (_, final), states = self.states_after(final, later), states[:0]
        while True:
            if len(states) < 3 * window:
                states, final = self.states_after(final, 3 * window)
                seen += 3 * window
            early, middle, late = states[-3 * window :].reshape(3, window, -1)
            size = max(float(np.linalg.norm(late, axis=1).max()), self.scale)
            state, then = _farthest(late), _farthest(middle)
            found = float(np.linalg.norm(difference(middle, state), axis=1).min())
            before = float(np.linalg.norm(difference(early, then), axis=1).min())
            rest = found
            if found > _ROUNDING * size:
                rest /= 1.0 - min(found / before if before else 1.0, _SLOWEST)
            if found <= SETTLED * size or 2 * seen + 6 * window > _BUDGET:
                return state, final, rest
            _, final = self.states_after(final, max(seen, window))
            seen, states = seen + max(seen, window), states[:0]


def _farthest(states: Array) -> Array:
    """Return the state of a window with the largest norm: it is not part of a chatter."""
    return np.asarray(states[np.argmax(np.linalg.norm(states, axis=1))])


def orbit_size(label: OrbitLabel) -> int:
    """Return the number of successive states that include all states of a periodic orbit."""
    return label.iterates or label.simulated


def look_at(system: Map, rows: Array, transient: int, keep: int) -> Look:
    """Return the simulation of starts (n, s); ValueError when none of them is a state."""
    size = float(abs(rows).max()) or 1.0
    return Look(system, transient, keep, size, (system.dimension, _packed_size(system, rows)))


def _packed_size(system: Map, rows: Array) -> int:
    for row in rows:
        try:
            return len(system.pack_state(system.state_from(row)))
        except Refused as refusal:
            last = refusal
    raise ValueError(f"starts must hold a state of the system; got none ({last})")
