"""The plan of a sweep: its values are points of the engine."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion, Refused
from dynkit.core.validation import Array, finite_array, read_only
from dynkit.data.store import identity_of
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import Anything, Columns, Findings, Points, Rows
from dynkit.labels.label import OrbitKind, OrbitLabel

KIND = "sweep"

NONE = OrbitKind.NO_MOTION.value
"""How the ending begins at a value without a motion."""

_MOST_RUNS = 16
"""Largest number of runs in which a displaced motion may leave an orbit. With the default 800
states a run they suffice where the largest multiplier exceeds 1.0014 per state."""


@final
@dataclass(frozen=True, eq=False)
class Plan(Points):
    """The arguments of a sweep, checked by `sweep`.

    Parameters
    ----------
    system : Map or None
        None for a sweep that was loaded without its system.
    kind : str
        Full name of the system's class.
    parameter : str
    values : (k,) array, read-only
    transient, keep : int
    observables : tuple of str
    start : array
        The packed start; empty for the default start of the system.
    follow : bool
        Whether each value starts from the last state of the value before it.
    """

    system: Map | None
    kind: str
    parameter: str
    values: Array
    transient: int
    keep: int
    observables: tuple[str, ...]
    start: Array
    follow: bool
    # in `work` alone: the system at the value simulated last, and that value with its last state
    _known: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def names(self) -> tuple[str]:
        """Names of the parameters: one."""
        return (self.parameter,)

    @property
    def chained(self) -> bool:
        return self.follow

    @property
    def work(self) -> Callable[[Any], Rows]:
        return replace(self, values=self.values[:1])  # the first value is needed for the start

    def task(self, first: int, last: int, found: Findings) -> Any:
        if not self.follow or not first:
            return self.values[first:last], None
        before = float(self.values[first - 1]), found.arrays["final"][first - 1]
        return self.values[first:last], before

    @property
    def entries(self) -> Mapping[str, str]:
        return {
            "kind": KIND,
            "system": self.kind,
            "parameter": self.parameter,
            "follow": str(self.follow),
            "start": start_of(self.start),
            **identity_of(self.system_at(float(self.values[0]))),
            "transient": str(self.transient),
            "keep": str(self.keep),
            "observables": json.dumps(self.observables),
        }

    @property
    def inputs(self) -> Mapping[str, Anything]:
        return {"values": self.values, "start": self.start}

    @property
    def columns(self) -> Columns:
        observables = dict.fromkeys(self.observables, ("f", (self.keep,)))
        return {
            "count": ("i", ()),
            "displaced": ("b", ()),
            "final": ("f", (None,)),
            **{f"observables/{name}": column for name, column in observables.items()},
        }

    def __call__(self, task: tuple[Array, tuple[float, Array] | None]) -> Rows:
        """Simulate some values, where each may follow the value before it."""
        (values, before), began = task, time.perf_counter()
        shape, work = (len(values), self.keep), Counter[str]()
        kept = {name: np.full(shape, np.nan) for name in self.observables}
        counts, displaced, finals, endings = [], [], [], []
        start, note = self.start_after(before), None
        for place, value in enumerate(values.tolist()):
            try:
                # a system at another value may know what does not depend on the parameter
                system = self._known["system"] = self.system_at(value, self._known.get("system"))
                if self.follow:
                    motion, moved = self.following(system, start)
                else:
                    motion, moved = self.motion(system, start), False
                found = {name: motion.observable(name) for name in kept}
            except Exception as error:
                if not isinstance(error, NoMotion) or isinstance(error, Refused):
                    error.add_note(f"at {self.parameter} {value}")
                    raise
                counts.append(0)
                displaced.append(False)
                # the next value of a following sweep has the start of this one
                finals.append(system.pack_state(system.default_start if start is None else start))
                endings.append(f"{NONE}: {error}")
                continue
            for name, rows in kept.items():
                rows[place, : len(found[name])] = found[name]
            counts.append(len(found[self.observables[0]]))
            displaced.append(moved)
            finals.append(system.pack_state(motion.final))
            endings.append(str(motion.ending.value))
            for name, count in motion.cost.counts.items():
                work[name] += count
            if self.follow:  # the next task need not unpack this state from the rows of the engine
                self._known["last"] = value, motion.final
                note = partial(self._note, value, motion)
        arrays: dict[str, Anything] = {f"observables/{name}": rows for name, rows in kept.items()}
        arrays |= {
            "final": np.array(finals),
            "count": np.array(counts, dtype=np.int64),
            "displaced": np.array(displaced, dtype=np.bool_),
        }
        return Rows(arrays, {"ending": endings}, Cost(time.perf_counter() - began, work), note)

    def _note(self, value: float, motion: Attractor) -> str:
        """Return a value and its label from the kept states: a full label would cost too much."""
        label = motion.label_within(self.keep)
        name = "..." if label.kind is OrbitKind.UNSETTLED else str(label)
        return f"{self.parameter} {value:.6g}: {name}"

    def start_after(self, before: tuple[float, Array] | None) -> Any:
        """Return the start after a value and its packed last state; that of the first for None."""
        if before is None:
            if not len(self.start):  # the default start of the system
                return None
            return self.system_at(float(self.values[0])).unpack_state(self.start)
        value, packed = before
        known, state = self._known.get("last", (None, None))
        return state if known == value else self.system_at(value).unpack_state(packed)

    def system_at(self, value: float, known: Map | None = None) -> Map:
        """Return the system at a value, made from the system `known` at another value, if given."""
        system = known or self.system
        if system is None:
            raise ValueError("system must be given to load a sweep that is to simulate; got None")
        return system.replace(**{self.parameter: value})

    def motion(self, system: Map, start: Any) -> Attractor:
        """Simulate a system of the sweep."""
        return system.attractor(start=start, transient=self.transient, keep=self.keep)

    def following(self, system: Map, start: Any) -> tuple[Attractor, bool]:
        """Simulate and leave unstable orbits; return the motion, and whether it was displaced.

        Only the kept states are examined. Where they recur, and neither norms nor multipliers prove
        that the orbit is stable, the last state is displaced and the motion simulated from there,
        until disturbances of this size have had time to grow to the size of the motion. Where the
        multipliers prove neither stability nor instability, and the displaced motion remains near
        the orbit, the orbit is not unstable: the motion before the displacement is returned.
        """
        motion = self.motion(system, start)
        if motion._stays:
            return motion, False
        label = motion.label_within(self.keep)
        if label.kind not in (OrbitKind.PERIODIC, OrbitKind.STICKING) or label.stable:
            return motion, False
        # geometric mean of the error of an iterate, relative to the motion's size, and of that size
        size = math.sqrt(system.accuracy)
        away = system.displaced(motion, size)
        for _ in range(self._runs_to_leave(label, size)):
            away = self.motion(system, away).final
        left = self.motion(system, away)
        if label.stable is None and _near(motion, left, size):
            return motion, False
        return left, True

    def _runs_to_leave(self, label: OrbitLabel, size: float) -> int:
        """Return the number of runs, of transient + keep states each, for growth to size one."""
        if label.stable is None:
            return 0
        states = (label.iterates or 1) * -math.log(size) / math.log(label.multiplier)
        return min(math.ceil(states / (self.transient + self.keep)), _MOST_RUNS)


def swept_values(name: str, values: object) -> Array:
    """Return values of a parameter as a new read-only array, (k,).

    Raises
    ------
    ValueError
        When they are not finite numbers, or there is none.
    """
    array = finite_array(name, values, (None,)).copy()
    if not len(array):
        raise ValueError(f"{name} must hold at least one number; got none")
    return read_only(array)


def packed_start(system: Map, start: object) -> Array:
    """Return a start as numbers; an empty array for the default start of the system.

    Raises
    ------
    ValueError
        When the system refuses the start, or has no default start.
    """
    if start is not None:
        return system.pack_state(start)
    if system.default_start is None:
        raise ValueError(f"start must be a state of the map, ({system.dimension},); got None")
    return np.empty(0)


def start_of(packed: Array) -> str:
    """Return the entry of a store for a packed start."""
    return "given" if len(packed) else "the system's own"


def known_names(known: Sequence[str], asked: object) -> tuple[str, ...]:
    """Return the names of the observables to keep, by default the first.

    Raises
    ------
    ValueError
        When no name is given, or one is not known.
    """
    if asked is None:
        return (known[0],)
    if isinstance(asked, str) or not isinstance(asked, Sequence) or not len(asked):
        raise ValueError(f"observables must be a sequence of names; got {asked!r}")
    for name in asked:
        if name not in known:
            raise ValueError(f"observables must be among {', '.join(known)}; got {name!r}")
    return tuple(dict.fromkeys(asked))


def _near(orbit: Attractor, other: Attractor, size: float) -> bool:
    """Whether the last state of another motion is near an orbit, relative to the orbit's size."""
    states, there = (orbit.system.without_shift(o.states) for o in (orbit, other))
    nearest = float(np.linalg.norm(orbit.system.difference(states, there[-1]), axis=1).min())
    return nearest <= size * (float(np.linalg.norm(states, axis=1).max()) or 1.0)
