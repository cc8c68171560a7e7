"""Step control of continuation."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol, final

import numpy as np

from dynkit.continuation.points import Point, rescaled
from dynkit.core.validation import positive


class StepControl(Protocol):
    """Step sizes, in scaled unknowns."""

    @property
    def first(self) -> float:
        """The first step."""
        ...

    @property
    def smallest(self) -> float:
        """The smallest step; the curve ends where only smaller steps succeed."""
        ...

    def shorter(self, step: float) -> float:
        """Return the step to try after a step that failed."""
        ...

    def next(self, before: Point, after: Point, taken: float) -> float:
        """Return the next step after a step `taken` from one point to another."""
        ...


@final
@dataclass(frozen=True)
class AdaptiveSteps:
    """Steps that aim at a number of Newton steps, and at an angle, in radians, between tangents.

    Raises
    ------
    ValueError
        When a number is not positive, or the first step is larger than the largest.
    """

    first: float = 0.01
    largest: float = 0.05
    smallest: float = 1e-9
    newton_steps: float = 3.0
    angle: float = 0.15

    def __post_init__(self) -> None:
        for entry in fields(self):
            positive(entry.name, getattr(self, entry.name))
        if self.first > self.largest:
            raise ValueError(f"first must be at most largest, {self.largest}; got {self.first}")

    def shorter(self, step: float) -> float:
        """Return half of the step."""
        return 0.5 * step

    def next(self, before: Point, after: Point, taken: float) -> float:
        """Return a step of 0.3 to 2 times the last one."""
        cosine = float(after.tangent @ rescaled(before, after.scale))
        angle = float(np.arccos(min(cosine, 1.0)))
        by_newton = 2.0 ** ((self.newton_steps - after.iterations) / 2.0)
        by_angle = self.angle / max(angle, 1e-3)
        factor = float(min(max(min(by_newton, by_angle), 0.3), 2.0))
        return min(taken * factor, self.largest)
