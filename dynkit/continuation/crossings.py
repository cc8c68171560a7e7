"""Examined points of a branch, and bifurcations between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.events import Event
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.spectrum import Spectrum


@final
class Crossing(NamedTuple):
    """A bifurcation within a step: its kind, for GR and CB the index of the event.

    `ends` is whether the branch ends there.
    """

    kind: BifurcationKind
    event: int = -1
    ends: bool = False


@final
class Located(NamedTuple):
    """A located bifurcation: all unknowns and their errors.

    `errors`, (m + e + 1,), are those of `x`, `own` and `p`. If `solved` is False, Newton's method
    found no solution, and the bifurcation was only enclosed between two points of the branch.
    """

    crossing: Crossing
    x: Array
    own: Array
    p: Array
    errors: Array
    multiplier: complex | None
    direction: Any
    history: tuple[float, ...]
    seconds: float
    steps: int
    solved: bool = True

    @property
    def place(self) -> Array:
        """Unknowns and parameter, (m + 1,)."""
        return np.append(self.x, self.p)


@final
@dataclass(frozen=True, slots=True)
class Seen:
    """Properties of the orbit of a point; `crossings` are those since the previous point.

    `branch_point` is the located BP among the crossings, if any. If the branch folds at the BP,
    because it is symmetric about the branch that it meets, `flat` is its tangent in scaled
    unknowns.
    """

    kind: Spectrum
    spectrum: Any
    admissible: bool
    events: tuple[Event, ...]
    flip: bool
    pairs: int
    inside: int
    crossings: tuple[Crossing, ...] = ()
    branch_point: Located | None = None
    flat: Array | None = None
