"""Criticality: the side of a bifurcation on which orbits are born, and their stability."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar, TypeAlias, final

import numpy as np
from scipy.linalg import eig

from dynkit.continuation.bifurcations.switching import Place, width_of
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.core.cost import Cost
from dynkit.core.differences import extrapolated
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.orbits.equations import Problem
from dynkit.orbits.newton import ROUNDING
from dynkit.orbits.problem import PeriodicProblem
from dynkit.orbits.spectrum import Spectrum

# First step of differences, in scaled unknowns. Numbers at the last _SMALLEST steps differ by
# rounding alone: _SCATTER times the largest difference bounds it. After the last _FEW of them there
# are too few smaller steps to bound their own rounding.
_FIRST, _SMALLEST, _SCATTER, _FEW = 0.1, 5, 4.0, 2
# _MARGIN is the safety factor of errors that are estimated by trials; _DERIVATIVES is the error of
# second derivatives, in units of the accuracy of the map.
_MARGIN, _DERIVATIVES = 4.0, 1e3
# Multipliers or eigenvalues are equal if they differ by this part of the critical one; eigenvalues,
# too, if they differ by the part _DOUBLE of the largest one: the rounding of a double one.
_SAME, _DOUBLE = 1e-6, 2.0**-26
# A multiplier with abs(mu^k - 1) below this, k = 1 to 4, is at a strong resonance: cubic terms do
# not determine the criticality.
_RESONANT = 1e-6


@final
@dataclass(frozen=True, repr=False)
class Criticality(Saved):
    """The orbits born at a bifurcation: their side and their stability.

    Parameters
    ----------
    coefficient : float
        Coefficient of the normal form. SN: b of ``xi -> xi + b xi^2``, or of ``xi' = b xi^2``. PD:
        c of ``xi -> -xi + c xi^3``. In both the unit of xi is the bifurcation's `direction`. NS:
        the real part of d of ``z -> exp(i theta) z (1 + d |z|^2)``. HB: the real part of c of
        ``z' = i omega z + c z |z|^2``, the first Lyapunov coefficient times omega. In both the
        critical eigenvector has unit length in the coordinates of the state. At NS this is the
        orbit's first state, and for sticking orbits the state in contact at the first release.
    error : float
        Estimate of the error of the coefficient.
    side : int
        1 where the orbits are born at larger values of the parameter, -1 at smaller ones; 0 where
        that is not certain. At SN these are the two orbits that meet, at NS an invariant curve.
    supercritical : bool or None
        Whether they are born where the critical multiplier or eigenvalue is unstable; None at SN,
        and where the coefficient does not certainly differ from zero.
    stable : bool or None
        Whether they are stable near the bifurcation; at SN whether one of the two is. None where
        the coefficient does not certainly differ from zero.
    cost : Cost

    References
    ----------
    Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 4th ed., Springer 2023, sections 3.5,
    4.7 and 5.4.

    Examples
    --------
    >>> from dynkit import continue_orbit, periodic_orbit
    >>> from dynkit.systems import Logistic
    >>> orbit = periodic_orbit(Logistic(rate=2.5), [0.6])
    >>> (doubling,) = continue_orbit(orbit, "rate", bounds=(2.0, 3.2)).bifurcations
    >>> print(doubling, doubling.criticality)
    <PD at rate 3> supercritical, stable, at larger values
    """

    _stored: ClassVar = ("coefficient", "error", "side", "supercritical", "stable", "cost")
    coefficient: float
    error: float
    side: int
    supercritical: bool | None
    stable: bool | None
    cost: Cost = field(compare=False)

    def dataset(self) -> Dataset:
        """Return the coefficient, its error and the side as a dataset of one ``bifurcation``."""
        each = "bifurcation"
        return Dataset(
            {},
            {
                "coefficient": (each, [self.coefficient]),
                "error": (each, [self.error]),
                "side": (each, [self.side]),
            },
            described(
                "Criticality of a bifurcation",
                cost=self.cost,
                error="estimate of the error of the coefficient",
                orbits=str(self),
            ),
        )

    def __repr__(self) -> str:
        return f"<Criticality: {self}; coefficient {self.coefficient:.6g}, error {self.error:.1e}>"

    def __str__(self) -> str:
        if self.stable is None:
            return "not certain"
        if self.supercritical is None:
            words = "one of them stable" if self.stable else "both unstable"
        else:
            words = "supercritical" if self.supercritical else "subcritical"
            words += ", stable" if self.stable else ", unstable"
        where = {1: "at larger values", -1: "at smaller values", 0: "on a side not certain"}
        return f"{words}, {where[self.side]}"


NormalForm: TypeAlias = "Callable[[Place, Array, float], tuple[float, float] | None]"
"""(place, unknowns and parameter, accuracy of the system) -> coefficient and its error."""


def criticality(place: Place, value: complex, form: NormalForm, sign: int) -> Criticality | None:
    """Return the criticality of a bifurcation; None where its normal form is not known.

    Parameters
    ----------
    place : Place
    value : complex
        The critical multiplier or eigenvalue.
    form : callable
        Computes the coefficient of the normal form.
    sign : int
        Sign of the coefficient of a supercritical bifurcation; 0 at SN.
    """
    began = time.perf_counter()
    x, p, kind = place.y[:-1], place.y[-1:], place.problem.stability
    if kind is Spectrum.CONSERVATIVE:
        return None  # two multipliers become critical together: these normal forms assume one
    spectrum = np.asarray(place.problem.spectrum(x, p))
    if np.count_nonzero(_equal(spectrum, value, kind)) > 1:
        return None  # several critical multipliers, as in a symmetric system
    accuracy = ROUNDING
    if isinstance(place.problem, PeriodicProblem):
        accuracy = place.problem.orbit(x, p).system.accuracy
    random = np.random.default_rng(0)
    moved = place.y + place.error * random.choice([-1.0, 1.0], len(place.y))
    try:
        found, probe = form(place, place.y, accuracy), form(place, moved, accuracy)
    except (NoMotion, np.linalg.LinAlgError):
        return None
    if found is None or probe is None:
        return None
    coefficient, error = found
    error += _MARGIN * abs(probe[0] - coefficient)
    supercritical = stable = None
    side = 0
    if abs(coefficient) > error:
        others = spectrum
        for critical in {value, value.conjugate()}:
            others = np.delete(others, np.argmin(abs(others - critical)))
        stable = bool(np.all(kind.stable(others)))
        side = _unstable_side(place, value) if sign else _fold_side(place)
        if sign:
            supercritical = coefficient * sign > 0.0
            stable &= supercritical
            side *= 1 if supercritical else -1
    cost = Cost(time.perf_counter() - began, {})
    return Criticality(coefficient, error, side, supercritical, stable, cost)


def _equal(spectrum: Any, value: complex, kind: Spectrum) -> Any:
    """Return which of the numbers are equal to the critical value up to errors, of bool."""
    rounding = 0.0 if kind.periodic else _DOUBLE * float(abs(spectrum).max())
    return abs(spectrum - value) <= max(_SAME * abs(value), rounding)


def _unit(problem: Problem, x: Array, p: Array) -> float:
    """Return the unit of the spectrum: one for multipliers, the largest of eigenvalues."""
    if problem.stability.periodic:
        return 1.0
    return float(abs(np.asarray(problem.spectrum(x, p))).max()) or 1.0


# --- from the equations of the orbit --------------------------------------------------------------


def fold(place: Place, y: Array, accuracy: float) -> tuple[float, float] | None:
    """Return the coefficient b at SN, and its error."""
    problem, way, neutral = place.problem, place.direction, place.problem.stability.neutral
    x, p = y[:-1], y[-1:]
    left, unit = _left(problem, x, p, neutral), _unit(problem, x, p)

    def coefficient(h: float) -> float:
        first = _slope(lambda z: problem.pencil(z, p, neutral), x, way, h)
        by_value = _slope(lambda mu: problem.pencil(x, p, mu * unit), neutral, 1.0, h)
        return float(-0.5 * unit * (left @ first @ way) / (left @ by_value @ way))

    return _limit(coefficient, 1, accuracy, unit)


def flip(place: Place, y: Array, accuracy: float) -> tuple[float, float] | None:
    """Return c at PD, from the symmetric branch in the equations of twice the period."""
    assert isinstance(place.problem, PeriodicProblem)
    problem, x, way = place.problem.doubled(y[:-1], place.direction)
    p, scale = y[-1:], problem.scale(x)
    here, left = problem.linearization(x, p), _left(problem, x, p, 1.0)
    m = len(x)
    bordered = np.zeros((m + 1, m + 1))
    bordered[:m, :m], bordered[:m, m], bordered[m, :m] = here * scale, left, way / scale

    def coefficient(h: float) -> float:
        first, second = _both(lambda z: problem.linearization(z, p), x, here, way, h)
        by_value = _slope(lambda mu: problem.linearization(x, p, mu), 1.0, 1.0, h)
        mean = scale * np.linalg.solve(bordered, np.append(-0.5 * (first @ way), 0.0))[:m]
        cubic = left @ (second @ way / 6.0 + first @ mean)
        return float(0.5 * cubic / (left @ by_value @ way))

    return _limit(coefficient, 2, accuracy, 1.0)


def _left(problem: Problem, x: Array, p: Array, value: complex) -> Any:
    """Return the left null vector of D at a value of the spectrum."""
    return np.linalg.svd(problem.pencil(x, p, value) * problem.scale(x))[0][:, -1].conj()


def _fold_side(place: Place) -> int:
    """Return the side of a fold on which the branch is: the sign of the second derivative of p."""
    problem, way, x, p = place.problem, place.direction, place.y[:-1], place.y[-1:]
    neutral = problem.stability.neutral
    left = _left(problem, x, p, neutral)
    slope = np.sign(left @ problem.parameter_derivative(x, p)[:, 0])

    def bend(h: float) -> float:
        first = _slope(lambda z: problem.pencil(z, p, neutral), x, way, h)
        return -float(slope * (left @ first @ way))

    return _sign(bend)


def _unstable_side(place: Place, value: complex) -> int:
    """Return the side, 1 or -1, on which the critical multiplier or eigenvalue is unstable."""
    problem, y, way = place.problem, place.y, place.direction
    left = _left(problem, y[:-1], y[-1:], value)
    equations = OrbitEquations(problem, width_of(place))
    scale = equations.scale(y)
    # the tangent of the place is a chord, along which a critical multiplier may change otherwise
    tangent = np.linalg.svd(equations.jacobian(y) * scale)[2][-1] * scale

    def growth(h: float) -> float:
        first = _slope(lambda z: problem.pencil(z[:-1], z[-1:], value), y, tangent, h)
        by_value = _slope(lambda mu: problem.pencil(y[:-1], y[-1:], mu * value), 1.0, 1.0, h)
        speed = -(left @ first @ way) / (left @ by_value @ way)  # in units of the value
        return float((speed if problem.stability.periodic else speed * value / abs(value)).real)

    return _sign(growth) * int(np.sign(tangent[-1]))


def _sign(estimate: Callable[[float], float]) -> int:
    number, error = _limit(estimate, 1, ROUNDING, 1.0)
    return int(np.sign(number)) if abs(number) > error else 0


# --- from the return map, or the velocity ---------------------------------------------------------


def rotation(place: Place, y: Array, accuracy: float) -> tuple[float, float] | None:
    """Return the real part of d at NS, or of c at HB, and its error."""
    problem, angle = place.problem, float(place.own[0])
    returns = isinstance(problem, PeriodicProblem)
    value = complex(np.exp(1j * angle)) if returns else complex(0.0, angle)
    if returns and min(abs(value**k - 1.0) for k in range(1, 5)) < _RESONANT:
        return None
    jacobian, state = (
        problem.returns(y[:-1], y[-1:])
        if isinstance(problem, PeriodicProblem)
        else _velocity(problem, y)
    )
    here = jacobian(state)
    found: Any = eig(here, left=True)
    values, lefts, rights = found
    k = int(np.argmin(abs(values - value)))
    # beside the place, within its error, the critical multiplier may differ by more
    if y is place.y and not _equal(values, value, problem.stability)[k]:
        return None  # the orbit is inadmissible, or the return map is that of another orbit
    q, adjoint = rights[:, k], lefts[:, k].conj()
    adjoint = adjoint / (adjoint @ q)
    value, square = values[k], (values[k] ** 2 if returns else 2.0 * values[k])
    unit = np.eye(len(q))
    still, twice = here - problem.stability.neutral * unit, here - square * unit
    size = float(problem.scale(y[:-1]).max())

    def coefficient(h: float) -> float:
        ways = q.real, q.imag
        (a, aa), (b, bb) = (_both(jacobian, state, here, way, h * size) for way in ways)
        twisted = a + 1j * b  # B(q, .)
        mean = np.linalg.solve(still, twisted @ q.conj())
        double = np.linalg.solve(twice, twisted @ q)
        cubic = (aa + bb) @ q - 2.0 * twisted @ mean - twisted.conj() @ double
        number = 0.5 * (adjoint @ cubic)
        return float((number / value if returns else number).real)

    return _limit(coefficient, 2, accuracy, abs(value) / size**2)


def _velocity(problem: Problem, y: Array) -> tuple[Callable[[Array], Array], Array]:
    """Return the derivative of the velocity as a function, and the equilibrium."""

    def jacobian(x: Array) -> Array:
        known = problem.factors(x, y[-1:])
        assert known is not None
        matrix: Array = known[0][0]
        return matrix

    return jacobian, y[:-1]


# --- differences ----------------------------------------------------------------------------------


def _slope(function: Callable[[Any], Any], place: Any, way: Any, h: float) -> Any:
    """Return the central difference of a function along a direction."""
    return (function(place + h * way) - function(place - h * way)) / (2.0 * h)


def _both(
    function: Callable[[Any], Any], place: Any, here: Any, way: Any, h: float
) -> tuple[Any, Any]:
    """Return first and second differences along a direction; `here` is the value at the place."""
    ahead, behind = function(place + h * way), function(place - h * way)
    return (ahead - behind) / (2.0 * h), (ahead - 2.0 * here + behind) / h**2


def _limit(
    estimate: Callable[[float], float], order: int, accuracy: float, unit: float
) -> tuple[float, float]:
    """Return the limit of an even function of the step at step zero, and its error.

    The function consists of differences of an order, and the unit is a typical size of what they
    are differences of. Its rounding error is measured: it grows in solutions of linear systems.
    """

    @cache
    def number(h: float) -> float:
        with suppress(NoMotion), np.errstate(all="ignore"):
            return estimate(h)
        return np.nan

    def row(h: float) -> tuple[Array, Array, float]:
        return np.array([number(h)]), np.zeros(1), h**order

    # second differences at smaller steps are dominated by rounding
    count = int(np.log2(accuracy ** (-1.0 / 3.0)))
    steps = _FIRST / 2.0 ** np.arange(count)
    last = steps[-_SMALLEST:]
    finest = np.array([number(h) for h in last.tolist()])
    scatter = abs(np.diff(finest)) * last[1:] ** order
    noise = _SCATTER * np.fmax.reduce(scatter, initial=accuracy * unit)
    found, error = extrapolated(map(row, steps.tolist()), 4.0, noise)
    if not np.isfinite(found[0]):
        return np.nan, np.inf
    # Where rounding errors grow with the step, those of the limit exceed the noise. The distance to
    # the numbers at the smallest steps shows this. Differences at no larger steps bound their own.
    own = _SCATTER * np.maximum(np.append(scatter[:1], scatter), accuracy * unit)
    own = np.maximum.accumulate(own[::-1])[::-1]
    own[-_FEW:] = noise
    apart = abs(finest - found[0]) - own / last**order
    apart = np.fmax.reduce(apart, initial=error[0])
    wrong = _MARGIN * apart + _DERIVATIVES * accuracy * abs(found[0])
    return float(found[0]), float(wrong)
