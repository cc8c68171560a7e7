"""Motions that go on from an attractor."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

from dynkit.core.no_motion import NoMotion
from dynkit.dynamics.attractor import Attractor


@runtime_checkable
class OffersAttractor(Protocol):
    """A motion that is no `Attractor` and gives itself as one, such as a record of impacts."""

    def as_attractor(self) -> Attractor:
        """Return the motion as an attractor that skips nothing."""
        ...


def source_of(given: object) -> object:
    """Return what a measure is taken of: the attractor of what offers one, else what was given."""
    return given.as_attractor() if isinstance(given, OffersAttractor) else given


def attractor_of(given: object) -> Attractor:
    """Return the attractor that was given, or offered.

    Raises
    ------
    ValueError
        When it is none, or has no state.
    """
    attractor = source_of(given)
    if not isinstance(attractor, Attractor):
        raise ValueError(f"attractor must be an Attractor; got {given!r}")
    if not len(attractor.states):
        raise ValueError("attractor must have a state; got one that came to rest")
    return attractor


@contextmanager
def going_on_for(iterates: int) -> Iterator[None]:
    """Say of a motion that ends that it must go on for so many iterates.

    Raises
    ------
    ValueError
        When it ends.
    """
    try:
        yield
    except NoMotion as end:
        raise ValueError(f"attractor must go on for {iterates} iterates; {end}") from end
