"""Many points that do not depend on one another, done in chunks: what is to be done, and found."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost

Anything: TypeAlias = NDArray[Any]
Columns: TypeAlias = Mapping[str, tuple[str, tuple[int | None, ...]]]
"""Of arrays by name: the kind of their numbers, and the shape of a row; None where it is any."""

# Points of a chunk, at most; and so many chunks, at least, as long as there are points.
_MOST, _CHUNKS = 32, 256

MOST_POINTS = 10_000_000
"""What is found at so many points takes a gigabyte; at a millisecond each they take three hours."""


class Points(ABC):
    """Points that can be done in any order, by anybody.

    A subclass owes:

    1. ``len(points)``, how many there are.
    2. `work`, a function that is given what is to be done in a chunk and returns its `Rows`. It is
       picklable, small, and depends on nothing else: the same bits wherever it is called.
    3. ``task(first, last, found)``, what is to be done in a chunk: the points of these numbers, the
       last left out. Of a chain `found` holds the rows of all points before.
    4. `entries` and `inputs`, texts and arrays by name that set the points apart from all others:
       a store made with others is refused. ``entries["kind"]`` says what the store holds.
    5. `columns`, what the arrays of its rows are; what a store holds must be that.

    and may offer:

    6. `chained`, whether a point needs the rows of the one before it: such points are done one by
       one, in their order, and by no executor.
    """

    @abstractmethod
    def __len__(self) -> int: ...

    @property
    def chained(self) -> bool:
        """Whether a point needs the rows of the one before it."""
        return False

    @property
    @abstractmethod
    def work(self) -> Callable[[Any], Rows]:
        """What finds the rows of a chunk."""

    @abstractmethod
    def task(self, first: int, last: int, found: Findings) -> Any:
        """Return what is to be done in a chunk."""

    @property
    @abstractmethod
    def entries(self) -> Mapping[str, str]:
        """Texts that set these points apart, by name."""

    @property
    @abstractmethod
    def columns(self) -> Columns:
        """Kinds of numbers (NumPy's letters) and shapes of what is found at a point, by name."""

    @property
    @abstractmethod
    def inputs(self) -> Mapping[str, Anything]:
        """Arrays that set these points apart, by name."""


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """What was found at n points.

    Parameters
    ----------
    arrays : mapping of str to (n, ...) array
    texts : mapping of str to list of n str
    cost : Cost
        Of all of them.
    note : callable, optional
        Returns what the bar says beside its count; of a chain only.
    """

    arrays: Mapping[str, Anything]
    texts: Mapping[str, list[str]]
    cost: Cost
    note: Callable[[], str] | None = None


def chunks_of(count: int, *, chained: bool = False) -> list[tuple[int, int]]:
    """Return first and last number of each chunk; they depend on nothing but the count.

    The chunks of a chain are single points.

    Examples
    --------
    >>> chunks_of(3), len(chunks_of(40_000)), chunks_of(40_000)[-1]
    ([(0, 1), (1, 2), (2, 3)], 1250, (39968, 40000))
    """
    size = 1 if chained else min(max(count // _CHUNKS, 1), _MOST)
    return [(first, min(first + size, count)) for first in range(0, count, size)]


@final
class Tasks(Sequence[Any]):
    """What is to be done in some chunks, made when it is asked for."""

    def __init__(self, points: Points, chunks: Sequence[tuple[int, int]], found: Findings) -> None:
        self._points = points
        self._chunks = chunks
        self._found = found

    def __len__(self) -> int:
        return len(self._chunks)

    def __getitem__(self, number: Any) -> Any:
        first, last = self._chunks[number]
        return self._points.task(first, last, self._found)


@final
@dataclass(eq=False)
class Findings:
    """What was found so far, filled in place: of count rows those whose chunks are done."""

    count: int
    done: NDArray[np.bool_] = field(init=False)
    arrays: dict[str, Anything] = field(default_factory=dict)
    texts: dict[str, list[str]] = field(default_factory=dict)
    cost: Cost = field(default_factory=lambda: Cost(0.0))

    def __post_init__(self) -> None:
        self.done = np.zeros(self.count, dtype=np.bool_)

    def add(self, places: NDArray[np.intp], rows: Rows) -> None:
        """Add the rows of these points; an interrupt on the way leaves all others as they were."""
        for name, array in rows.arrays.items():
            if name not in self.arrays:
                self.arrays[name] = np.zeros((self.count, *array.shape[1:]), array.dtype)
            self.arrays[name][places] = array
        for name, texts in rows.texts.items():
            every = self.texts.setdefault(name, [""] * self.count)
            for place, text in zip(places.tolist(), texts, strict=True):
                every[place] = text
        self.cost = self.cost + rows.cost
        self.done[places] = True

    def rows(self) -> Rows:
        """Return what was found, in the order of the points."""
        arrays = {name: array[self.done] for name, array in self.arrays.items()}
        places = np.flatnonzero(self.done).tolist()
        texts = {name: [every[i] for i in places] for name, every in self.texts.items()}
        return Rows(arrays, texts, self.cost)
