"""Growing arrays of exponential sums, for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from operator import gt
from typing import Any, final

import numpy as np


@final
class Stack:
    """Named arrays (k, ...) of stacked arrays, padded with zeros to the largest of them.

    They have spare capacity, so that most additions copy no earlier arrays.
    """

    def __init__(self) -> None:
        self._rooms: dict[str, Any] = {}

    def put(self, name: str, k: int, given: Any) -> None:
        """Write an array as number k of this name."""
        array, room = np.asarray(given), self._rooms.get(name)
        if k == 0 and room is None:
            self._rooms[name] = array[None]  # a single array is not copied
            return
        if room is None or k >= len(room) or any(map(gt, array.shape, room.shape[1:])):
            self._widen(name, k + 1, array)
        self._rooms[name][(k, *map(slice, array.shape))] = array

    def _widen(self, name: str, count: int, like: Any) -> None:
        """Extend the capacity to `count` arrays, each at least as large as `like`."""
        old = self._rooms.get(name, np.zeros((0, *like.shape), like.dtype))
        shape = list(map(max, old.shape, (count, *like.shape)))
        if count > len(old):
            shape[0] = max(count, 2 * len(old))
        self._rooms[name] = np.zeros(shape, old.dtype)
        self._rooms[name][tuple(map(slice, old.shape))] = old

    def take(self, name: str, count: int) -> Any:
        """Return the first `count` arrays of this name; zeros where none was put."""
        if count > len(self._rooms[name]):
            self._widen(name, count, self._rooms[name][0])
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
        """Add a group of one or more sums."""
        first, g = sums[0], self._groups
        for name in _OF_GROUPS:
            self._stack.put(name, g, getattr(first, name))
        self._stack.put("sizes", g, (len(first.step), len(first.links)))
        for k, each in enumerate(sums, start=self._sums):
            for name in _OF_SUMS:
                self._stack.put(name, k, getattr(each, name))
            self._stack.put("integers", k, _integers(g, each))
            self._stack.put("numbers", k, _numbers(each))
        self._groups, self._sums = g + 1, self._sums + len(sums)

    @property
    def ladders(self) -> Any:
        """The `Ladders` of all groups."""
        from dynkit.exponential.stack_kernels import Ladders

        counts = dict.fromkeys(Ladders._fields, self._sums)
        counts |= dict.fromkeys((*_OF_GROUPS, "sizes"), self._groups)
        return Ladders(**{name: self._stack.take(name, count) for name, count in counts.items()})


def _integers(group: int, one: Any) -> tuple[int, ...]:
    return group, len(one.cell), one.smooth, int(one.apart), int(one.grows), one.steady


def _numbers(one: Any) -> tuple[float, ...]:
    return one.offset, one.window, one.swing


def stacked(sums: Sequence[Any]) -> Any:
    """Return the `Ladders` of one group of sums of equal sizes, as by `LadderStack`."""
    from dynkit.exponential.stack_kernels import Ladders

    first, each = sums[0], {name: np.array([getattr(s, name) for s in sums]) for name in _OF_SUMS}
    return Ladders(
        **{name: np.asarray(getattr(first, name))[None] for name in _OF_GROUPS},
        **each,
        sizes=np.array([(len(first.step), len(first.links))]),
        integers=np.array([_integers(0, one) for one in sums]),
        numbers=np.array([_numbers(one) for one in sums]),
    )


_OF_GROUPS = "step", "generator", "links", "link_step", "smallest"
_OF_SUMS = "cell", "rows"
