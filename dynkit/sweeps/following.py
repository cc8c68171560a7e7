"""The iteration of a following sweep: what is to be done, its points, and what was found so far."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.attractors import Attractor
from dynkit.labels import OrbitKind, OrbitLabel
from dynkit.maps import Map
from dynkit.no_motion import located
from dynkit.sweeps.sweepable import (
    Sweepable,
    SweptAttractor,
    SweptMap,
    as_attractor,
    sweepable,
)
from dynkit.validation import (
    Array,
    boolean,
    finite_array,
    non_negative_integer,
    positive_integer,
    within_memory,
)

_MOST_RUNS = 16
"""Runs in which a displaced motion may leave an orbit: it does so where the largest multiplier, per
state, exceeds 1.0014 after the default 800 states."""


@final
@dataclass(frozen=True, eq=False)
class Plan:
    """What a sweep is to do, checked by `plan_of`.

    Parameters
    ----------
    family : Sweepable or None
        None for a sweep that was loaded without its system.
    kind : str
        The class of the system, as the user knows it.
    parameter : str
    values : (k,) array, read-only
    transient, keep : int
    observables : tuple of str
    start : array
        The packed first state; empty for the system's own.
    follow : bool
        Whether each value starts where the last ended, and not where the first does.
    """

    family: Sweepable | None
    kind: str
    parameter: str
    values: Array
    transient: int
    keep: int
    observables: tuple[str, ...]
    start: Array
    follow: bool = True

    def system(self, place: int) -> Sweepable:
        """Return the system at one of the values."""
        return self.system_at(float(self.values[place]))

    def system_at(self, value: float) -> Sweepable:
        """Return the system at a value."""
        if self.family is None:
            raise ValueError("system must be given to load a sweep that is to simulate; got None")
        return self.family.replace(**{self.parameter: value})

    def motion(self, system: Sweepable, start: Any) -> SweptAttractor:
        """Simulate at the value that the system has."""
        return system.attractor(transient=self.transient, impacts=self.keep, start=start)

    def following(self, system: Sweepable, start: Any) -> "tuple[SweptAttractor, bool]":
        """Simulate, and leave an unstable orbit; say whether the state was displaced.

        Only the kept states are looked at. Where they recur, and the multipliers do not prove that
        the orbit attracts, the last of them is displaced and the motion simulated again from there,
        until disturbances of this size have had the time to grow to that of the motion. Where the
        multipliers prove nothing either way, and the displaced motion comes back or stays, the
        orbit is not unstable: the motion that was not displaced is returned.
        """
        motion = self.motion(system, start)
        label = motion.label_within(self.keep)
        if label.kind not in (OrbitKind.PERIODIC, OrbitKind.STICKING) or label.stable:
            return motion, False
        attractor = as_attractor(motion)
        # The geometric mean of rounding, or the error of one iterate, and of the motion: as far
        # above the one as below the other.
        size = math.sqrt(attractor.system.accuracy)
        away = system.displaced(motion, size)
        for _ in range(self._runs_to_leave(label, size)):
            away = self.motion(system, away).final
        left = self.motion(system, away)
        if label.stable is None and _near(attractor, as_attractor(left), size):
            return motion, False
        return left, True

    def _runs_to_leave(self, label: OrbitLabel, size: float) -> int:
        """Runs, one of transient and keep each, in which a disturbance grows to one."""
        if label.stable is None:
            return 0
        states = (label.impacts or 1) * -math.log(size) / math.log(label.multiplier)
        return min(math.ceil(states / (self.transient + self.keep)), _MOST_RUNS)

    def start_at(self, place: int, finals: Array) -> Any:
        """Return the state from which a value starts, from the packed final ones."""
        if place > 0 and self.follow:
            return self.system(place - 1).unpack_state(finals[place - 1])
        return self.system(0).unpack_state(self.start) if len(self.start) else None


def plan_of(
    system: Sweepable | Map,
    parameter: str,
    values: object,
    *,
    transient: int,
    keep: int,
    observables: Sequence[str] | None,
    start: object,
    follow: bool = True,
) -> Plan:
    """Check everything that can be checked without simulating.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.
    """
    family = sweepable(system)
    if parameter not in family.parameters:
        known = ", ".join(family.parameters) or "none"
        raise ValueError(f"parameter must be one of: {known}; got {parameter!r}")
    array = finite_array("values", values, (None,)).copy()
    array.setflags(write=False)
    if not len(array):
        raise ValueError("values must hold at least one number; got none")
    skipped = non_negative_integer("transient", transient)
    kept = positive_integer("keep", keep)
    names = known_names(family.observables, observables)
    within_memory("keep", kept, 8.0 * kept * len(array) * len(names))
    for place, value in enumerate(array.tolist()):
        try:
            family.replace(**{parameter: value})
        except ValueError as refusal:
            raise ValueError(f"{refusal} in values[{place}]") from refusal
    packed = np.empty(0)
    if start is not None:
        packed = family.replace(**{parameter: float(array[0])}).pack_state(start)
    elif isinstance(family, SweptMap):
        raise ValueError(f"start must be a state of the map, ({family.map.dimension},); got None")
    following = boolean("follow", follow)
    return Plan(family, kind_of(system), parameter, array, skipped, kept, names, packed, following)


def kind_of(system: object) -> str:
    """Return the full name of the system's class."""
    return f"{type(system).__module__}.{type(system).__qualname__}"


def known_names(known: Sequence[str], asked: object) -> tuple[str, ...]:
    """Return the names of the observables that were asked for, by default the first.

    Raises
    ------
    ValueError
        When there are none, or one is not known.
    """
    if asked is None:
        return (known[0],)
    if isinstance(asked, str) or not isinstance(asked, Sequence) or not len(asked):
        raise ValueError(f"observables must be a sequence of names; got {asked!r}")
    for name in asked:
        if name not in known:
            raise ValueError(f"observables must be among {', '.join(known)}; got {name!r}")
    return tuple(dict.fromkeys(asked))


@final
@dataclass(frozen=True, eq=False)
class Point:
    """The motion at one value of a sweep, its packed final state, and the seconds it took.

    `displaced` says whether a state was displaced for it to leave an unstable orbit.
    """

    place: int
    motion: SweptAttractor
    packed: Array
    seconds: float
    displaced: bool


@final
@dataclass(eq=False)
class Findings:
    """What a sweep has found: of k rows the first `finished`, filled in place.

    What an observable has not got, because a motion ended early, is NaN.
    """

    observables: dict[str, Array]
    finals: Array
    counts: NDArray[np.int64]
    ending_codes: NDArray[np.int64]
    displaced: NDArray[np.bool_]
    endings: list[str] = field(default_factory=list)
    finished: int = 0
    seconds: float = 0.0
    work: dict[str, int] = field(default_factory=dict)

    @staticmethod
    def none_yet(plan: Plan) -> "Findings":
        """Room for all rows."""
        k = len(plan.values)
        return Findings(
            {name: np.full((k, plan.keep), np.nan) for name in plan.observables},
            np.empty((k, 0)),
            np.zeros(k, dtype=np.int64),
            np.zeros(k, dtype=np.int64),
            np.zeros(k, dtype=np.bool_),
        )

    def add(self, point: Point) -> None:
        """Add the next row; an interrupt on the way leaves the rows before it as they were."""
        row, motion = point.place, point.motion
        if not self.finals.size:
            self.finals = np.empty((len(self.counts), len(point.packed)))
        self.finals[row], self.displaced[row] = point.packed, point.displaced
        for name, rows in self.observables.items():
            found = motion.observable(name)
            rows[row, : len(found)] = found
            self.counts[row] = len(found)
        text = str(motion.ending.value)
        if text not in self.endings:
            self.endings.append(text)
        self.ending_codes[row] = self.endings.index(text)
        work = dict(self.work)
        for name, count in motion.cost.counts.items():
            work[name] = work.get(name, 0) + count
        self.work, self.seconds, self.finished = work, self.seconds + point.seconds, row + 1


def _near(orbit: Attractor, other: Attractor, size: float) -> bool:
    """Whether the last state of another motion is this near to an orbit, relative to its size."""
    gaps = orbit.system.difference(orbit.states, other.states[-1])
    nearest = float(np.linalg.norm(gaps, axis=1).min())
    return nearest <= size * (float(np.linalg.norm(orbit.states, axis=1).max()) or 1.0)


def follow(plan: Plan, findings: Findings) -> Iterator[Point]:
    """Simulate value by value from the first one that is not finished, each from the last state.

    Raises
    ------
    NoMotion
        When there is no motion at a value, or the system refuses the start there; a note of the
        exception says where, as of every exception.
    """
    first = findings.finished
    began = time.perf_counter()
    start = plan.start_at(first, findings.finals)
    for place in range(first, len(plan.values)):
        with located(f"at {plan.parameter} {float(plan.values[place])}"):
            system = plan.system(place)
            motion, displaced = plan.following(system, start)
        start = motion.final
        packed = system.pack_state(start)
        ended = time.perf_counter()
        yield Point(place, motion, packed, ended - began, displaced)
        began = time.perf_counter()
