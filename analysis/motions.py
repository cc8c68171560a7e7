"""Motions that go on from an attractor."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dynkit.attractors import Attractor
from dynkit.no_motion import NoMotion
from dynkit.validation import Array


def last_state(attractor: object) -> Array:
    """Return the state, (d,), that an attractor ends in.

    Raises
    ------
    ValueError
        When it is no attractor, or has no state.
    """
    if not isinstance(attractor, Attractor):
        raise ValueError(f"attractor must be an Attractor; got {attractor!r}")
    if not len(attractor.states):
        raise ValueError("attractor must have a state; got one that came to rest")
    return np.asarray(attractor.states[-1])


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
