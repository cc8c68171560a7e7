"""Comparison of motions: orbits by a state, chaos and closed curves by distances of many states."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.engine.collecting import Rows, chunks_of
from dynkit.labels.label import KINDS, OrbitKind, OrbitLabel, label_in
from dynkit.sweeps.basins.classification import UNSETTLED, Look, orbit_size

if TYPE_CHECKING:
    from collections.abc import Iterator

# Orbits are equal when the distance of a state of one to the other is at most NEAR, relative to
# starts and states, plus _ERRORS times the distances of both motions from their orbits. A motion
# further than _MOST, relative, from its orbit is unsettled.
NEAR, _ERRORS, _MOST = 1e-8, 3.0, 1e-4

# _REFERENCE is the number of states that represent a chaotic or quasi-periodic attractor. _SAMPLE
# states of another motion are compared with them. If these are not on the attractor, _FURTHER ones
# are compared: intermittent chaos may stay in a rarely visited region for a long time.
_REFERENCE, _SAMPLE, _FURTHER = 2000, 64, 1024
# A state is on the attractor if its distance from the nearest state of the attractor does not
# exceed the distance of that state to its neighbour of this number. Of other states with the same
# density, on a line or in a plane, an eighth is farther away.
_NEIGHBOUR = 3

# Largest number of coordinates of differences that are computed together.
_TOGETHER = 1 << 16


@final
@dataclass(frozen=True, eq=False)
class Found:
    """An attractor: the index of the first start that leads there, and states, (n, d)."""

    place: int
    label: OrbitLabel
    ending: str
    states: Array


@final
@dataclass(frozen=True, eq=False)
class Basin:
    """An attractor, and the fraction of the starts that lead to it.

    Parameters
    ----------
    number : int
        Number of the attractor in `Basins.numbers`.
    label : OrbitLabel
        Label of the motion from the first start in the basin.
    ending : str
        Why the simulation of that start ended; for a motion without impacts, why there are none.
    states : (n, d) array
        The states of the orbit, in their order, read-only. Chaotic and quasi-periodic motions have
        a sample of their states, motions without impacts have none.
    start : tuple of int
        Index of the first start in the basin.
    count : int
        Number of starts in the basin.
    fraction, error : float
        The fraction of all starts, and its standard error if the starts were drawn at random.
    """

    number: int
    label: OrbitLabel
    ending: str
    states: Array
    start: tuple[int, ...]
    count: int
    fraction: float
    error: float

    def __repr__(self) -> str:
        return f"<Basin {self.number}: {self.label}, of {self.count} starts>"


def group_starts(
    look: Look, rows: Rows, starts: Array, shape: tuple[int, ...], finish: Finish
) -> tuple[NDArray[np.int64], tuple[Basin, ...]]:
    """Return the number of each start's attractor, and the basins in the order of the starts.

    Numbers below zero are those of `dynkit.sweeps.basins.classification.OTHER_ENDS`.
    """
    chaos, rows = _filled(OrbitKind.CHAOTIC, look, rows, finish)
    curves, rows = _filled(OrbitKind.QUASI_PERIODIC, look, rows, finish)
    groups = [*chaos, *curves, *orbits_in(look, rows, starts), *_rests(rows)]
    kinds: NDArray[np.int64] = rows.arrays["kind"]
    numbers = np.where(kinds < 0, kinds, UNSETTLED)
    groups.sort(key=lambda group: group[0].place)
    basins = []
    for number, (found, members) in enumerate(groups):
        numbers[members] = number
        found.states.setflags(write=False)
        place = tuple(int(i) for i in np.unravel_index(found.place, shape))
        part = len(members) / len(numbers)
        error = float(np.sqrt(part * (1.0 - part) / len(numbers)))
        who = found.label, found.ending, found.states
        basins.append(Basin(number, *who, place, len(members), part, error))
    return numbers.reshape(shape), tuple(basins)


Finish: TypeAlias = Callable[["_Compared", list[Array]], list[Array]]
"""Function (work, tasks) that returns the results of all tasks, perhaps by workers, with a bar."""

_Group = tuple[Found, NDArray[np.intp]]


def _places(rows: Rows, *asked: OrbitKind) -> NDArray[np.intp]:
    return np.flatnonzero(np.isin(rows.arrays["kind"], [KINDS.index(kind) for kind in asked]))


def label_at(rows: Rows, place: int) -> OrbitLabel:
    """Return the label of a start that has a motion."""
    kind = int(rows.arrays["kind"][place])
    kinds = OrbitKind.UNSETTLED if kind == UNSETTLED else KINDS[kind]
    return label_in(rows.arrays, place, kinds)


def orbits_in(look: Look, rows: Rows, starts: Array) -> Iterator[_Group]:
    """Yield periodic and sticking orbits with their members, from the rows of some starts (n, s).

    The first member of an orbit that has ended early, without a final state, is simulated again.
    """
    left = _places(rows, OrbitKind.PERIODIC, OrbitKind.STICKING)
    while len(left):
        first = int(left[0])
        if np.isnan(rows.arrays["final"][first]).any():
            rows = _changed(rows, {first: look(starts[[first]])})
        states, rests = rows.arrays["state"], rows.arrays["rest"]
        label = label_at(rows, first)
        if label.kind not in (OrbitKind.PERIODIC, OrbitKind.STICKING):
            left = left[1:]  # after rounding errors the motion leads elsewhere: unsettled
            continue
        start = look.system.unpack_state(rows.arrays["final"][first])
        orbit, _ = look.states_after(start, orbit_size(label))
        size = size_of(look, orbit)
        if not rests[first] <= _MOST * size:
            left = left[1:]  # too far from its orbit: unsettled
            continue
        allowed = NEAR * size + _ERRORS * (rests[left] + rests[first])
        same = nearest(look, orbit, states[left]) <= np.minimum(allowed, _MOST * size)
        same[0] = True
        yield Found(first, label, rows.texts["ending"][first], orbit), left[same]
        left = left[~same]


def size_of(look: Look, orbit: Array) -> float:
    """Return the largest norm of the states (n, d), or the largest number of all starts."""
    return max(float(np.linalg.norm(orbit, axis=1).max()), look.scale)


def nearest(look: Look, reference: Array, states: Array) -> Array:
    """Return the distance (k,) of each state (k, d) to the nearest of the reference (n, d)."""
    found = [gaps.min(axis=1) for gaps in _distances(look, reference, states)]
    return np.concatenate([np.empty(0), *found])


def _distances(look: Look, reference: Array, states: Array) -> Iterator[Array]:
    """Yield the distances (m, n) of some states after others to all states of the reference."""
    size = max(1, _TOGETHER // reference.size)
    for low in range(0, len(states), size):
        gaps = look.system.difference(reference, states[low : low + size, None])
        # it takes a quarter of the time of NumPy's norm, which is slow for few coordinates
        yield np.sqrt(np.einsum("ijk,ijk->ij", gaps, gaps))


def _filled(kind: OrbitKind, look: Look, rows: Rows, finish: Finish) -> tuple[list[_Group], Rows]:
    """Return the attractors of a kind, chaotic or quasi-periodic, and the updated rows.

    A row changes if the later motion, after the states of the attractor, has another kind.
    """
    finals, groups, ended = rows.arrays["final"], [], {}
    left = _places(rows, kind)
    while len(left):
        first = int(left[0])
        start = look.system.unpack_state(finals[first])
        label = label_at(rows, first)
        # of a torus near a resonance many states are needed to fill the curve
        keep = label.simulated if label.curves else _REFERENCE
        motion = look.system.attractor(start=start, transient=1, keep=max(keep, _REFERENCE))
        later = look.rows_from([motion.final])
        if later.arrays["kind"][0] != KINDS.index(kind):
            ended[first] = later
            left = left[1:]
            continue
        reference = look.states_of(motion)
        if len(reference) > _REFERENCE:
            some = np.random.default_rng(0).choice(len(reference), _REFERENCE, replace=False)
            reference = reference[np.sort(some)]
        same = _median_ratios(look, reference, finals[left], finish) <= 1.0
        same[0] = True
        found = Found(first, label, rows.texts["ending"][first], reference)
        groups.append((found, left[same]))
        left = left[~same]
    return groups, _changed(rows, ended)


def _changed(rows: Rows, changes: Mapping[int, Rows]) -> Rows:
    arrays = {name: array.copy() for name, array in rows.arrays.items()}
    texts = {name: list(every) for name, every in rows.texts.items()}
    for place, later in changes.items():
        for name, array in arrays.items():
            array[place] = later.arrays[name][0]
        for name, every in texts.items():
            every[place] = later.texts[name][0]
    return Rows(arrays, texts, rows.cost)


def _median_ratios(look: Look, reference: Array, finals: Array, finish: Finish) -> Array:
    """Return the medians (k,) of `_Compared` for motions from packed states (k, p)."""
    gaps = _distances(look, reference, reference)
    spacing = np.concatenate([np.partition(g, _NEIGHBOUR, axis=1)[:, _NEIGHBOUR] for g in gaps])
    tasks = [finals[slice(*chunk)] for chunk in chunks_of(len(finals))]
    return np.concatenate(finish(_Compared(look, reference, spacing), tasks))


@final
@dataclass(frozen=True, eq=False)
class _Compared:
    """Function from packed states (k, p) to medians over the motions from them, (k,).

    Each median is that of ratios: the distance of a state to the nearest state of an attractor,
    divided by the spacing (n,) of the attractor at that state.
    """

    look: Look
    reference: Array
    spacing: Array

    def __call__(self, finals: Array) -> Array:
        medians = []
        for packed in finals:
            state, median = self.look.system.unpack_state(packed), np.inf
            for count in (_SAMPLE, _FURTHER):
                if median > 1.0:
                    states, state = self.look.states_after(state, count)
                    median = float(np.median(self._ratios(states))) if len(states) else np.inf
            medians.append(median)
        return np.array(medians)

    def _ratios(self, states: Array) -> Array:
        found = []
        for gaps in _distances(self.look, self.reference, states):
            near, least = gaps.argmin(axis=1), gaps.min(axis=1)
            # the ratio is zero at a state of the attractor, even where the spacing is zero
            found.append(least / np.maximum(self.spacing[near], np.finfo(float).tiny))
        return np.concatenate(found)


def _rests(rows: Rows) -> Iterator[_Group]:
    endings: Sequence[str] = rows.texts["ending"]
    left = _places(rows, OrbitKind.NO_IMPACTS)
    for ending in dict.fromkeys(endings[place] for place in left.tolist()):
        members = np.array([place for place in left.tolist() if endings[place] == ending])
        first = int(members[0])
        none = np.empty((0, rows.arrays["state"].shape[1]))
        yield Found(first, label_at(rows, first), ending, none), members
