"""Streams: long motions in blocks, of which one is in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, final

from dynkit.core.no_motion import NoCrossing
from dynkit.core.reprs import system_repr
from dynkit.core.validation import non_negative_integer, positive_integer
from dynkit.dynamics.attractor import Attractor


@final
@dataclass(frozen=True, eq=False, repr=False)
class Stream:
    """The states of a motion after its transient, in successive blocks; made by `Map.stream`.

    Each block is an `Attractor` that continues the one before. The states are, bit for bit, those
    of one attractor of all states. For machines with soft stops, friction or sliders they are the
    same to rounding, because each block begins with a change of coordinates. Each iteration begins
    at the start.

    Parameters
    ----------
    system : Map
    start : start or None
        As for `Map.attractor`.
    transient, keep, block : int
        Numbers of states to skip, to keep, and in a block.

    Raises
    ------
    ValueError
        When a number is not a count.
    """

    system: Any
    start: Any
    transient: int
    keep: int
    block: int

    def __post_init__(self) -> None:
        non_negative_integer("transient", self.transient)
        positive_integer("keep", self.keep)
        positive_integer("block", self.block)

    def __iter__(self) -> Iterator[Attractor]:
        return self.blocks_after(0)

    def blocks_after(self, done: int, last: Any = None) -> Iterator[Attractor]:
        """Yield the blocks after a number of states, from the `final` of the last block.

        Raises
        ------
        ValueError
            When the start is refused.
        NoMotion
            When the motion has no next state; the states before have been yielded.
        """
        count = done
        while count < self.keep:
            size = min(self.block - count % self.block, self.keep - count)
            if count:
                part = self.system.following(last, size)
            else:
                part = self.system.attractor(start=self.start, transient=self.transient, keep=size)
            if part._kept:
                yield part
            if part._kept < size:
                raise NoCrossing(f"there is no next state: {part.ending.value}")
            count, last = count + size, part.final

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that determines the states of all blocks."""
        start = self.system.default_start if self.start is None else self.start
        packed = tuple(self.system.pack_state(start).tolist())
        own: dict[str, object] = {"start": packed, "transient": self.transient}
        own |= {"block": self.block}
        return {**self.system.identity, **{f"stream.{name}": own[name] for name in own}}

    def __repr__(self) -> str:
        size = f"{self.keep} states after {self.transient}, in blocks of {self.block}"
        return f"<Stream of {system_repr(self.system, 6)}: {size}>"
