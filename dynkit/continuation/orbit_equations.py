"""Equations of periodic orbits along a curve."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.newton import Correction, Equations, error_bound


class CurveEquations(Equations):
    """F(x, p) = 0, and further equations of a subclass; the unknowns are (x, own, p).

    Parameters
    ----------
    problem : Problem
    widths : (k,) array
        Units of the free parameters.
    """

    def __init__(self, problem: Problem, widths: Array) -> None:
        self.problem = problem
        self._widths = widths
        self._m, self._k = problem.size, len(widths)

    def split(self, y: Array) -> tuple[Array, Array, Array]:
        """Return the orbit's unknowns, additional unknowns of the subclass, and the parameters."""
        q = len(y)
        return y[: self._m], y[self._m : q - self._k], y[q - self._k :]

    def orbit_jacobian(self, y: Array) -> Array:
        """Return the derivative, (m, number of unknowns), of F."""
        x, _, p = self.split(y)
        m, q = self._m, len(y)
        matrix = np.zeros((m, q))
        matrix[:, :m] = self.problem.linearization(x, p)
        matrix[:, q - self._k :] = self.problem.parameter_derivative(x, p)
        return matrix

    def scale(self, y: Array) -> Array:
        x, own, _ = self.split(y)
        # the factor makes the arclength independent of the number of unknowns
        units = self.problem.scale(x) * self._m**0.5
        return np.concatenate([units, np.maximum(1.0, abs(own)), self._widths])

    def linearization_error(self, y: Array) -> Any:
        x, _, p = self.split(y)
        return self.problem.linearization_error(x, p)

    def apart(self, y: Array, other: Array) -> Array:
        """Return the difference of two solutions; it is zero for equivalent ones."""
        (x, _, p), (x_other, _, p_other) = self.split(y), self.split(other)
        return np.append(self.problem.apart(x, x_other), (p - p_other) / self._widths)

    def near(self, y: Array) -> Self:  # noqa: ARG002 (these equations are the same everywhere)
        """Return equations that are well conditioned near a solution; by default these."""
        return self

    def repetition(self, y: Array) -> float:
        """Return the distance from repeated orbits of a shorter period; infinite without period."""
        return self.problem.repetition(self.split(y)[0])


@final
class OrbitEquations(CurveEquations):
    """F(x, p) = 0 with one free parameter: the unknowns are (x, p), the parameter last."""

    def __init__(self, problem: Problem, width: float) -> None:
        super().__init__(problem, np.array([width]))

    def residual(self, y: Array) -> Array:
        return self.problem.residual(y[:-1], y[-1:])

    def rounding(self, y: Array) -> Array:
        return self.problem.rounding(y[:-1], y[-1:])

    def jacobian(self, y: Array) -> Array:
        return self.orbit_jacobian(y)

    def corrected(
        self, y: Array, scale: Array, row: Array, limits: tuple[float, int, int]
    ) -> Correction | None:
        found: Correction | None = self.problem.corrected(y, scale, row, limits)
        return found


def distance_from_curve(equations: Equations, jacobian: Array, y: Array) -> Array:
    """Return to first order the error of each unknown, (n + 1,), across the curve."""
    scale = equations.scale(y)
    tangent = np.linalg.svd(jacobian * scale)[2][-1]
    return error_bound(equations, jacobian, y, scale, tangent)
