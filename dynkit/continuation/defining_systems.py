"""Extended systems: the equations of an orbit with the condition of a bifurcation."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import abstractmethod
from contextlib import suppress
from typing import Any, Self, final

import numpy as np

from dynkit.continuation.orbit_equations import CurveEquations
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import NOISE, Problem
from dynkit.orbits.events import Condition
from dynkit.orbits.newton import ROUNDING, NoSolution
from dynkit.orbits.spectrum import Spectrum

DIFFERENCE = 2.0 ** (-52.0 / 3.0)
"""Step of central differences, in scaled unknowns: it balances rounding and curvature."""

RESONANCES = tuple(sorted({j / k for k in range(3, 7) for j in range(1, k) if 2 * j < k}))
"""Angles of multipliers, in turns, at which orbits of three to six periods are born."""

# Largest change of a condition, which is of order one, over a step of differences. After a larger
# change the step is divided by 16, at most _SHORTER times. A step of a frequency causes such a
# change if the period contains many oscillations.
_CHANGE, _SHORTER = 1e-2, 4
# Relative step of a multiplier for the derivative of D.
_DISTURBED = 1e-7
# _BESIDE is a number that is not a critical multiplier. Where two events of an orbit merge, D(mu)
# is singular for every mu: the least singular value of D(_BESIDE) is then below _SINGULAR times
# its value at a near orbit.
_BESIDE, _SINGULAR = 0.3 + 0.7j, 1e-8
# Largest magnitude of the unfolding unknown at a branch point, where it is zero up to errors.
_UNFOLDED = 1e-9


class CriticalMultiplier(Condition):
    """The condition that the orbit has a given critical multiplier: D(mu) is singular.

    The number g of the bordered system [D b; c^H 0] [v; g] = [0; 1] is zero if and only if D is
    singular (W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000,
    section 3.3). The borders b and c are null vectors at a near solution. `widths`, (k,), are the
    units of the free parameters.
    """

    unknowns = 0

    def __init__(self, problem: Problem, x: Array, own: Array, p: Array, widths: Array) -> None:
        self._problem = problem
        self._units, self._widths = problem.scale(x), widths
        matrix = self._scaled(x, p, self.multiplier(own))
        left, _, right = np.linalg.svd(matrix)
        # D = left sizes right: the last row is already the conjugate of a null vector
        self._left, self._right = left[:, -1], right[-1]
        self._made_of = x, own, p, matrix
        off = problem.linearization_error(x, p)
        self.noise = float(np.sum(np.outer(abs(self._left), abs(self._right)) * off * self._units))
        # in this unit the noise is at most `NOISE`
        self.unit = max(1.0, self.noise / NOISE)

    @cached_property
    def rounding(self) -> float:  # type: ignore[override]  # expensive, so computed when needed
        """Rounding error of g: from the elements of D, and from the factors of the monodromy.

        An error of these factors acts like an error of the multiplier mu, on which D and g depend.
        The dependence is strong where mu is close to a multiplier of the motion without impacts.
        """
        x, own, p, matrix = self._made_of
        mu, factors = self.multiplier(own), self._problem.factors(x, p)
        off = 16.0 * ROUNDING
        if factors is not None and not self.noise:
            sizes = np.linalg.norm(factors[0], axis=(1, 2))
            # a factor that is zero has no critical multiplier
            off = float((factors[1][sizes > 0.0] / sizes[sizes > 0.0]).sum())
        size = mu
        if self._problem.stability is Spectrum.EIGENVALUES:
            # the error of an eigenvalue is relative to the norm of the matrix, that of a multiplier
            # to the multiplier
            size = 1.0 if factors is None else float(np.linalg.norm(factors[0]))
        ends = [self._scaled(x, p, mu + s * _DISTURBED * size) for s in (1.0, -1.0)]
        slope = self._left.conj() @ (ends[0] - ends[1]) @ self._right.conj() / (2.0 * _DISTURBED)
        own_rounding = 16.0 * ROUNDING * max(1.0, float(abs(matrix).max()))
        return (own_rounding + off * float(abs(slope)) + self.noise) / self.unit

    @abstractmethod
    def multiplier(self, own: Array) -> complex:
        """Return the critical multiplier."""

    def direction(self, x: Array, own: Array, p: Array) -> Any:
        """Return the critical null vector, (m,), of unit length in scaled unknowns."""
        null = _last_column(self._bordered(x, own, p))[:-1]
        return null / np.linalg.norm(null) * self._units

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        g = _last_column(self._bordered(x, own, p))[-1]
        # g is real for a real multiplier
        return np.array([g.real, g.imag])[: 1 + self.unknowns] / self.unit

    def _bordered(self, x: Array, own: Array, p: Array) -> Any:
        matrix = self._scaled(x, p, self.multiplier(own))
        m = len(matrix)
        bordered = np.zeros((m + 1, m + 1), dtype=matrix.dtype)
        bordered[:m, :m] = matrix
        bordered[:m, m] = self._left
        bordered[m, :m] = self._right
        return bordered

    def _scaled(self, x: Array, p: Array, multiplier: complex) -> Any:
        return self._problem.pencil(x, p, multiplier) * self._units


def _last_column(matrix: Any) -> Any:
    """Return the last column of the inverse of a square matrix."""
    target = np.zeros(len(matrix))
    target[-1] = 1.0
    return np.linalg.solve(matrix, target)


@final
class Fold(CriticalMultiplier):
    """SN: a multiplier is 1, or an eigenvalue 0, and the branch turns back."""

    def multiplier(self, own: Array) -> complex:
        return self._problem.stability.neutral


@final
class PeriodDoubling(CriticalMultiplier):
    """PD: a multiplier is -1."""

    def multiplier(self, own: Array) -> complex:
        return -1.0


@final
class NeimarkSacker(CriticalMultiplier):
    """NS: a pair of multipliers is exp(±i theta); theta is an unknown."""

    unknowns = 1

    def multiplier(self, own: Array) -> complex:
        return complex(np.exp(1j * own[0]))


@final
class Resonance(CriticalMultiplier):
    """RS: a pair of multipliers is rho exp(±2 pi i j/k), with the modulus rho as an unknown.

    On a level of an integral rho is one beside the resonance, too. A condition with rho = 1 would
    therefore be one equation too many. The fraction j/k is the one of `RESONANCES` that is nearest
    to the angle of the multipliers of a near solution.
    """

    unknowns = 1

    def __init__(self, problem: Problem, x: Array, own: Array, p: Array, widths: Array) -> None:
        angles = abs(np.angle(problem.spectrum(x, p)[:1])) / (2.0 * np.pi)
        self.fraction = min(RESONANCES, key=lambda each: abs(each - angles[0]))
        super().__init__(problem, x, own, p, widths)

    def multiplier(self, own: Array) -> complex:
        return complex(own[0] * np.exp(2j * np.pi * self.fraction))


@final
class Hopf(CriticalMultiplier):
    """HB: a pair of eigenvalues is ±i omega; omega is an unknown."""

    unknowns = 1

    def multiplier(self, own: Array) -> complex:
        return complex(1j * own[0])


@final
class BranchPoint(CriticalMultiplier):
    """BP: a multiplier is 1, or an eigenvalue 0, and another branch crosses.

    The derivative of F by all unknowns and the first parameter has a rank defect. Therefore an
    unfolding term, a vector times an additional unknown, is added to the orbit's equations; this
    unknown is zero at the solution.
    """

    unknowns = 1

    def __init__(self, problem: Problem, x: Array, own: Array, p: Array, widths: Array) -> None:
        super().__init__(problem, x, own, p, widths)
        self.unfolding = self._left

    def multiplier(self, own: Array) -> complex:
        return self._problem.stability.neutral

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        *null, g = _last_column(self._bordered(x, own, p).T)
        slope = self._problem.parameter_derivative(x, p)[:, 0] * self._widths[0]
        return np.array([g, null @ slope]) / self.unit


@final
class BifurcationEquations(CurveEquations):
    """F(x, p) = 0 and a condition; the unknowns are (x, own, p).

    With one free parameter there are as many equations as unknowns, with two one equation less.

    Parameters
    ----------
    problem : Problem
    condition : Condition
    widths : (k,) array
        Units of the free parameters.
    """

    def __init__(self, problem: Problem, condition: Condition, widths: Array) -> None:
        super().__init__(problem, widths)
        self.condition = condition
        self._last: tuple[Array | None, Array] = None, np.empty(0)

    def near(self, y: Array) -> Self:
        """Return the equations whose borders are null vectors at a solution."""
        if not isinstance(self.condition, CriticalMultiplier):
            return self
        condition = type(self.condition)(self.problem, *self.split(y), self._widths)
        return type(self)(self.problem, condition, self._widths)

    def residual(self, y: Array) -> Array:
        x, own, p = self.split(y)
        f = self.problem.residual(x, p)
        if self.condition.unfolding is not None:
            f = f + own[0] * self.condition.unfolding
        self._last = y, f
        return np.concatenate([f, self._condition(y)])

    def is_unfolded(self, y: Array) -> bool:
        """Whether the unfolding term is not zero: then y does not solve the orbit's equations."""
        return self.condition.unfolding is not None and bool(abs(self.split(y)[1][0]) > _UNFOLDED)

    def jacobian(self, y: Array) -> Array:
        """Return a derivative that is exact along the steps of Newton's method and the tangents.

        The condition is differentiated along the null vectors of the orbit's equations, and along
        the step to their solution. All steps and tangents are combinations of these directions.
        """
        orbit, scale = self._orbit_rows(y), self.scale(y)
        m = self._m
        frame, triangle = np.linalg.qr((orbit * scale).T, mode="complete")
        directions = list(frame[:, m:].T)
        f = self._last[1] if self._last[0] is y else self.residual(y)[:m]
        with suppress(np.linalg.LinAlgError):
            step = frame[:, :m] @ np.linalg.solve(triangle[:m].T, f)
            size = float(np.sqrt(step @ step))
            if 0.0 < size < np.inf:
                directions.append(step / size)
        return np.concatenate([orbit, self._along(y, scale, directions)])

    def full_jacobian(self, y: Array) -> Array:
        """Return the complete derivative."""
        directions = list(np.eye(len(y)))
        return np.concatenate([self._orbit_rows(y), self._along(y, self.scale(y), directions)])

    def _orbit_rows(self, y: Array) -> Array:
        matrix = self.orbit_jacobian(y)
        if self.condition.unfolding is not None:
            matrix[:, self._m] = self.condition.unfolding
        return matrix

    def _along(self, y: Array, scale: Array, directions: list[Array]) -> Array:
        """Return a derivative of the condition, exact along orthonormal scaled directions."""
        rows = np.zeros((self.condition.unknowns + 1, len(y)))
        for direction in directions:
            rows += np.outer(self._slope(y, scale * direction), direction)
        return rows / scale

    def _slope(self, y: Array, way: Array) -> Array:
        """Return the derivative of the condition along a direction."""
        step = max(DIFFERENCE, self.condition.noise ** (1.0 / 3.0))
        change = self._change(y, step * way)
        for _ in range(_SHORTER):
            if abs(change).max() <= _CHANGE:
                break
            step /= 16.0
            change = self._change(y, step * way)
        return np.asarray(change / step)

    def _change(self, y: Array, step: Array) -> Array:
        """Return the change of the condition over a step, to second order."""
        try:
            ahead = self._condition(y + step)
        except NoMotion:
            # at the edge of the domain
            return -self._change_ahead(y, -step)
        try:
            return 0.5 * (ahead - self._condition(y - step))
        except NoMotion:
            return self._change_ahead(y, step)

    def _change_ahead(self, y: Array, step: Array) -> Array:
        here, ahead, further = (self._condition(y + i * step) for i in range(3))
        return np.asarray(2.0 * ahead - 1.5 * here - 0.5 * further)

    def rounding(self, y: Array) -> Array:
        x, _, p = self.split(y)
        of_orbit = self.problem.rounding(x, p)
        of_states = float(of_orbit.max()) / self.condition.unit
        own = max(self.condition.rounding, of_states)
        return np.concatenate([of_orbit, np.full(self.condition.unknowns + 1, own)])

    def _condition(self, y: Array) -> Array:
        try:
            return self.condition.residual(*self.split(y))
        except np.linalg.LinAlgError:
            raise NoSolution("the bordered system is singular") from None


def null_vector(problem: Problem, x: Array, p: Array, multiplier: float) -> Array:
    """Return the right singular vector, (m,), of D(multiplier) with the least singular value."""
    units = problem.scale(x)
    rows = np.linalg.svd(problem.pencil(x, p, multiplier) * units)[2]
    return np.asarray(rows[-1] * units)


def merges(problem: Problem, at: Array, p: Array, near: Array, p_near: Array) -> bool:
    """Whether two events merge in the orbit `at`, (m,), but not in one near it.

    The equations are then singular although no multiplier is critical.
    """
    least = [
        np.linalg.svd(problem.pencil(x, q, _BESIDE) * problem.scale(x), compute_uv=False)[-1]
        for x, q in ((at, p), (near, p_near))
    ]
    return bool(least[0] < _SINGULAR * least[1])
