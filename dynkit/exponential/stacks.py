"""Growing arrays of exponential sums, for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from operator import gt
from typing import Any, final

import numpy as np


@final
class Stack:
    """Arrays (k, ...) by name, each a stack of arrays padded with zeros to the largest of them.

    A stack has spare capacity, so that most additions do not copy earlier arrays.
    """

    def __init__(self) -> None:
        self._rooms: dict[str, Any] = {}

    def put(self, name: str, k: int, given: Any) -> None:
        """Write arrays (m, ...) of one shape as numbers k, k + 1, ... of this name."""
        arrays, room = np.asarray(given), self._rooms.get(name)
        if k == 0 and room is None:
            self._rooms[name] = arrays  # the first ones are not copied
            return
        end, (_, *shape) = k + len(arrays), arrays.shape
        if room is None or end > len(room) or any(map(gt, shape, room.shape[1:])):
            self._widen(name, end, arrays)
        self._rooms[name][(slice(k, end), *map(slice, shape))] = arrays

    def _widen(self, name: str, count: int, like: Any) -> None:
        """Extend the capacity to `count` arrays, each at least as large as those of `like`."""
        old = self._rooms.get(name, like[:0])
        shape = list(map(max, old.shape, (count, *like.shape[1:])))
        if count > len(old):
            shape[0] = max(count, 4 * len(old))
        self._rooms[name] = np.zeros(shape, old.dtype)
        self._rooms[name][tuple(map(slice, old.shape))] = old

    def take(self, name: str, count: int) -> Any:
        """Return the first `count` arrays of this name; zeros where none was put."""
        if count > len(self._rooms[name]):
            self._widen(name, count, self._rooms[name])
        return self._rooms[name][:count]

    def all(self, count: int) -> dict[str, Any]:
        """Return the first `count` arrays of every name."""
        return {name: self.take(name, count) for name in self._rooms}

    def drop(self, name: str) -> None:
        """Delete the arrays of this name."""
        self._rooms.pop(name, None)


@final
class LadderStack:
    """Groups of exponential sums; the sums of a group have the same state."""

    def __init__(self) -> None:
        self._stack, self._groups, self._sums = Stack(), 0, 0

    def add(self, sums: Sequence[Any]) -> None:
        """Add a group of one or more sums of equal sizes."""
        for name, arrays in stacked(sums, self._groups)._asdict().items():
            of_sums = name in _OF_SUMS
            self._stack.put(name, self._sums if of_sums else self._groups, arrays)
        self._groups, self._sums = self._groups + 1, self._sums + len(sums)

    @property
    def ladders(self) -> Any:
        """The `Ladders` of all groups."""
        from dynkit.exponential.stack_kernels import Ladders

        counts = {k: self._sums if k in _OF_SUMS else self._groups for k in Ladders._fields}
        return Ladders(**{name: self._stack.take(name, count) for name, count in counts.items()})


def stacked(sums: Sequence[Any], group: int = 0) -> Any:
    """Return the `Ladders` of a group of one or more sums, which have equal sizes."""
    from dynkit.exponential.stack_kernels import Ladders

    one, whole = sums[0], ("step", "generator", "links", "link_step", "smallest")
    return Ladders(
        **{name: np.asarray(getattr(one, name))[None] for name in whole},
        sizes=np.array([(len(one.step), len(one.links))]),
        cell=np.array([s.cell for s in sums]) if len(sums) > 1 else one.cell[None],
        rows=np.array([s.rows for s in sums]) if len(sums) > 1 else one.rows[None],
        integers=np.array(
            [(group, len(s.cell), s.smooth, s.apart, s.grows, s.steady) for s in sums]
        ),
        numbers=np.array([(s.offset, s.window, s.swing) for s in sums]),
    )


_OF_SUMS = "cell", "rows", "integers", "numbers"
"""Fields of `Ladders` with one array for each sum; the others have one for each group."""
