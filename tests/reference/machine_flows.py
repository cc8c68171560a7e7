"""The motion in one set of regimes: Taylor series, and exponentials where nothing happens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from flint import arb

from tests.reference.rows import Row, row_reaches


@dataclass(frozen=True, eq=False)
class Flow:
    """The motion in one set of regimes: its generator, what is watched, and how far to look."""

    matrix: Any
    rows: list[tuple[int, Row]]
    step: float

    @cached_property
    def exponential(self) -> Any:
        """The change of the state in a step."""
        return (self.matrix * arb(self.step)).exp().mid()

    @cached_property
    def screen(self) -> tuple[Any, Any]:
        """Bernstein coefficients of all rows within a step, and of their sizes, by the state."""
        given = np.array([row.numbers for _, row in self.rows])
        return row_reaches(given, as_floats(self.matrix) * self.step)

    def clear(self, z: Any) -> list[bool]:
        """Of each row, whether doubles say that it stays positive for a step."""
        if not self.rows:
            return []
        numbers, sizes = self.screen
        state = np.array([float(x) for x in z.entries()])
        least = (numbers @ state - 1e-12 * (sizes @ abs(state))).min(axis=1)
        return [bool(x) for x in least > 0.0]

    def series(self, z: Any, step: float) -> list[Any]:
        """Taylor's series, in units of a step."""
        terms, matrix = [z], (self.matrix * arb(step)).mid()
        sizes = [most(z)]
        while len(terms) < 5 or sizes[-1] + sizes[-2] > 1e-58 * sizes[0]:
            terms.append(((matrix * terms[-1]) / len(terms)).mid())
            sizes.append(most(terms[-1]))
        return terms


def at(terms: list[Any], x: Any) -> Any:
    """The value of a series."""
    value = terms[-1]
    for term in reversed(terms[:-1]):
        value = (value * x + term).mid()
    return value


def step_of(matrix: Any) -> float:
    """A step within which forty terms of the exponential's series are all that doubles see."""
    numbers = as_floats(matrix)
    power = np.linalg.matrix_power(numbers, 8)
    step: float = 4.0 / max(float(np.linalg.norm(power)) ** 0.125, 1e-3)
    scaled, factor = np.linalg.matrix_power(numbers * step, 36), 1.0
    for k in range(2, 37):
        factor *= k
    while abs(scaled).max() / factor > 1e-17:
        step, scaled = 0.5 * step, scaled * 0.5**36
    return step


def as_floats(matrix: Any) -> Any:
    return np.array([[float(x) for x in row] for row in matrix.table()])


def most(z: Any) -> float:
    """Largest entry, about."""
    sizes: list[float] = [abs(float(x)) for x in z.entries()]
    return max(sizes)
