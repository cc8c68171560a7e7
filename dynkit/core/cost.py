"""The cost of a result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType
from typing import final

from dynkit.core.validation import non_negative, non_negative_integer

_SMALL = 2**32
"""Python integers from 0 to this, and floats, skip the full check: a sweep makes many counts."""


@final
@dataclass(frozen=True)
class Cost:
    """What a result cost: wall-clock seconds and counted work.

    Parameters
    ----------
    seconds : float
        Wall-clock time.
    counts : mapping of str to int
        Work by name, for instance ``{"impacts": 800, "cells": 5120}``; copied, read-only.

    Raises
    ------
    ValueError
        When the seconds or a count are negative.

    Examples
    --------
    >>> Cost(0.5, {"impacts": 800}) + Cost(0.25, {"impacts": 100, "cells": 9})
    Cost(seconds=0.75, counts={'impacts': 900, 'cells': 9})
    """

    seconds: float
    counts: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        counts = {
            name: count
            if type(count) is int and 0 <= count < _SMALL
            else non_negative_integer(f"counts[{name!r}]", count)
            for name, count in self.counts.items()
        }
        if not (type(self.seconds) is float and 0.0 <= self.seconds < inf):
            object.__setattr__(self, "seconds", non_negative("seconds", self.seconds))
        object.__setattr__(self, "counts", MappingProxyType(counts))

    def __add__(self, other: "Cost") -> "Cost":
        """Add the seconds, and the counts name by name."""
        counts = dict(self.counts)
        for name, count in other.counts.items():
            counts[name] = counts.get(name, 0) + count
        return Cost(self.seconds + other.seconds, counts)

    def __hash__(self) -> int:
        return hash((self.seconds, frozenset(self.counts.items())))

    def __reduce__(self) -> tuple[type["Cost"], tuple[float, dict[str, int]]]:
        # a mapping proxy cannot be pickled, and costs travel between processes
        return (Cost, (self.seconds, dict(self.counts)))

    def __repr__(self) -> str:
        return f"Cost(seconds={self.seconds!r}, counts={dict(self.counts)!r})"
