"""Periodic orbits of textbook maps in closed form or in many digits."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.systems import Henon, Logistic

DIGITS = 60


def cycles_at_four(n: int) -> list[tuple[Array, float]]:
    """All cycles of period n of the logistic map at rate 4, and their multipliers.

    x = sin^2(t) is mapped to sin^2(2 t), so the points of period n are t = k pi / (2^n -+ 1); the
    derivative of the n-th iterate is +-2^n there, but 4^n at x = 0.
    """
    found: dict[frozenset[int], tuple[Array, float]] = {}
    for sign in (1, -1):
        order = 2**n - sign
        for k in range(0 if sign == 1 else 1, (order + 1) // 2):
            steps = [k * 2**i % order for i in range(n)]
            angles = [min(step, order - step) for step in steps]
            if angles[0] not in angles[1:]:
                states = np.sin(np.pi * np.array(angles) / order) ** 2
                multiplier = float(sign * 2**n if k else 4**n)
                found.setdefault(frozenset([-sign, *angles]), (states, multiplier))
    return list(found.values())


def exact_orbit(orbit: MapOrbit) -> tuple[Array, Any]:
    """The orbit that is near, and the matrix of its n iterates, in 60 digits.

    By mpmath's own Newton method on all equations of the same parameters.
    """
    system = orbit.system
    n = orbit.period
    with mpmath.workdps(DIGITS):
        if isinstance(system, Logistic):
            rate = mpmath.mpf(system.rate)

            def equations(*x: Any) -> list[Any]:
                return [rate * x[i] * (1 - x[i]) - x[(i + 1) % n] for i in range(n)]

            def derivative(x: Any) -> Any:
                return mpmath.matrix([[rate * (1 - 2 * x)]])

            places = list(range(n))
            start = [mpmath.mpf(x) for x in orbit.states[:, 0]]
        else:
            assert isinstance(system, Henon)
            a, b = mpmath.mpf(system.a), mpmath.mpf(system.b)

            def equations(*x: Any) -> list[Any]:
                return [1 - a * x[i] ** 2 + b * x[i - 1] - x[(i + 1) % n] for i in range(n)]

            def derivative(x: Any) -> Any:
                return mpmath.matrix([[-2 * a * x, 1], [b, 0]])

            places = [(i - 1) % n for i in range(n)]
            start = [mpmath.mpf(x) for x in orbit.states[:, 0]]
        x = list(mpmath.findroot(equations, start, tol=mpmath.mpf(10) ** (8 - 2 * DIGITS)))
        product = mpmath.eye(system.dimension)
        for value in x:
            product = derivative(value) * product
        columns = [np.array([float(value) for value in x])]
        if isinstance(system, Henon):
            columns.append(np.array([float(b * x[k]) for k in places]))
        return np.stack(columns, axis=1), product


def eigenvalues(matrix: Any) -> Any:
    """Of a matrix in many digits: complex, the largest modulus first."""
    with mpmath.workdps(DIGITS):
        # of a number mpmath makes lists
        found = list(matrix) if matrix.rows == 1 else mpmath.eig(matrix, left=False, right=False)
        values = np.array([complex(value) for value in found])
    return values[np.lexsort((-values.imag, -abs(values)))]
