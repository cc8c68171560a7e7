"""Points to evaluate in chunks, and the findings at them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost

Anything: TypeAlias = NDArray[Any]
Columns: TypeAlias = Mapping[str, tuple[str, tuple[int | None, ...]]]
"""For each array, by name: NumPy's kind letter, and the shape of a row; None for any length."""

# There are at least _FEW chunks, of up to _SIZE points each, if there are enough points. For very
# many points there are at most about _MANY larger chunks, because each takes an executor some time.
_FEW, _SIZE, _MANY = 256, 32, 2048

MOST_POINTS = 10_000_000
"""The findings at this many points take a gigabyte; at a millisecond each they take three hours."""


class Points(ABC):
    """Points that can be evaluated in any order, by any process.

    A subclass must implement:

    1. ``len(points)``, the number of points.
    2. `work`, a function from the task of a chunk to its `Rows`. It is picklable, small, and
       depends on nothing else: it returns the same bits in every process.
    3. ``task(first, last, found)``, the task of a chunk: the points first, ..., last - 1. For a
       chain, `found` holds the rows of all earlier points.
    4. `entries` and `inputs`, texts and arrays by name that identify the points: a store with
       others is refused. ``entries["kind"]`` is the kind of the store.
    5. `columns`, the kinds and shapes of the arrays of its rows; those of a store must agree.

    A subclass may implement:

    6. `chained`, whether a point needs the rows of the one before it: such points are evaluated one
       by one, in their order, without an executor.
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
        """Function from the task of a chunk to its rows."""

    @abstractmethod
    def task(self, first: int, last: int, found: Findings) -> Any:
        """Return the task of a chunk."""

    @property
    @abstractmethod
    def entries(self) -> Mapping[str, str]:
        """Texts that identify these points, by name."""

    @property
    @abstractmethod
    def columns(self) -> Columns:
        """Kinds of numbers (NumPy's letters) and shapes of the findings at a point, by name."""

    @property
    @abstractmethod
    def inputs(self) -> Mapping[str, Anything]:
        """Arrays that identify these points, by name."""


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Findings at n points.

    Parameters
    ----------
    arrays : mapping of str to (n, ...) array
    texts : mapping of str to list of n str
    cost : Cost
        Cost of all n points.
    note : callable, optional
        Returns a text beside the count of the progress bar; for chains only.
    """

    arrays: Mapping[str, Anything]
    texts: Mapping[str, list[str]]
    cost: Cost
    note: Callable[[], str] | None = None


def chunks_of(count: int, *, chained: bool = False) -> list[tuple[int, int]]:
    """Return the range (first, last + 1) of each chunk; it depends on the count only.

    The chunks of a chain are single points.

    Examples
    --------
    >>> chunks_of(3), len(chunks_of(40_000)), chunks_of(40_000)[-1]
    ([(0, 1), (1, 2), (2, 3)], 1250, (39968, 40000))
    """
    size = 1 if chained else max(1, min(count // _FEW, _SIZE), count // _MANY)
    return [(first, min(first + size, count)) for first in range(0, count, size)]


@final
@dataclass(eq=False)
class Findings:
    """The findings so far, filled in place: the rows, among `count`, of finished chunks."""

    count: int
    done: NDArray[np.bool_] = field(init=False)
    arrays: dict[str, Anything] = field(default_factory=dict)
    texts: dict[str, Anything] = field(default_factory=dict)
    cost: Cost = field(default_factory=lambda: Cost(0.0))

    def __post_init__(self) -> None:
        self.done = np.zeros(self.count, dtype=np.bool_)

    def add(self, places: slice | NDArray[np.intp], rows: Rows) -> None:
        """Add the rows of these points; an interruption leaves all other rows unchanged."""
        for name, array in rows.arrays.items():
            if name not in self.arrays:
                self.arrays[name] = np.zeros((self.count, *array.shape[1:]), array.dtype)
            self.arrays[name][places] = array
        for name, texts in rows.texts.items():
            if name not in self.texts:
                self.texts[name] = np.full(self.count, "", dtype=object)
            self.texts[name][places] = texts
        self.cost = self.cost + rows.cost
        self.done[places] = True

    def rows(self) -> Rows:
        """Return the finished rows, in the order of the points."""
        arrays = {name: array[self.done] for name, array in self.arrays.items()}
        texts = {name: every[self.done].tolist() for name, every in self.texts.items()}
        return Rows(arrays, texts, self.cost)
