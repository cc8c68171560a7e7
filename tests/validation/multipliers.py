"""Floquet multipliers of orbits of maps and of impact oscillators against 100 digits and more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from random import Random
from typing import Any

import numpy as np
from flint import acb_mat, arb, arb_mat, ctx
from scipy.optimize import linear_sum_assignment

from dynkit import continue_orbit, periodic_orbit
from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.systems import Henon, Logistic
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact_orbits.exact_orbits import exact_orbit, size
from tests.maps.without_jacobian import without_jacobian
from tests.validation.branches import BRANCHES
from tests.validation.maps import orbits_of_maps
from tests.validation.orbits import orbits_of_one_impact, sticking_orbits

BITS = 400
EXACT = 1e-40
"""The last step of Newton's method: what is left is about its square."""


def of_maps(every: int) -> Iterator[tuple[float, float]]:
    """Of periods 1 to 8 of the logistic map and of Henon's."""
    for orbit in orbits_of_maps(every):
        yield from _pairs(orbit.multipliers, _exact(orbit), orbit.multipliers_error)


def of_maps_without_jacobian(every: int) -> Iterator[tuple[float, float]]:
    """The same where derivatives are differences."""
    for given in orbits_of_maps(every):
        orbit = periodic_orbit(without_jacobian(given.system), given.states)
        yield from _pairs(orbit.multipliers, _exact(orbit), orbit.multipliers_error)


def of_oscillators(every: int) -> Iterator[tuple[float, float]]:
    """Of P(1,m), m = 1 to 3, by differences of the impact map with a step of 2^-200."""
    for orbit in orbits_of_one_impact(3 * every):
        yield from of_orbit(orbit)


def of_orbit(orbit: ImpactOrbit) -> Iterator[tuple[float, float]]:
    """The same of one orbit."""
    with suppress(ArithmeticError):  # it only grazes
        exact = exact_orbit(orbit).multipliers
        yield from _pairs(orbit.multipliers, exact, orbit.multipliers_error)


def of_sticking_orbits(every: int) -> Iterator[tuple[float, float]]:
    """Of the map between releases, those that are not zero by their nature."""
    for orbit, _, exact in sticking_orbits(every):
        count = len(exact)
        yield from _pairs(orbit.multipliers[:count], exact, orbit.multipliers_error[:count])


def of_branches(every: int) -> Iterator[tuple[float, float]]:
    """Of fixed points of Henon's map at the parameter that has the coordinate x of a point."""
    for number in range(0, BRANCHES, every):
        b = round(Random(number).uniform(-0.8, 0.8), 6)
        start = periodic_orbit(Henon(a=0.5, b=b), [1.0, b])
        branch = continue_orbit(start, "a", bounds=(0.2, 3.0))
        claims = branch.multipliers_error
        for i in range(0, len(branch), 10):
            with ctx.workprec(BITS):
                beta, x = arb(b), arb(branch.unknowns[i, 0].item())
                a = (1 - (1 - beta) * x) / x**2
                exact = _eigenvalues(arb_mat([[-2 * a * x, 1], [beta, 0]]))
            yield from _pairs(branch.multipliers[i], exact, claims[i])


def _pairs(found: Any, exact: Any, claimed: Array) -> Iterator[tuple[float, float]]:
    """True and claimed error of each, paired so that the sum of the distances is smallest."""
    apart = abs(np.subtract.outer(found, exact))
    true = apart[linear_sum_assignment(apart)]
    # The exact ones are rounded to doubles.
    claims = claimed + 2.0**-53 * abs(found)
    yield from zip(true.tolist(), claims.tolist(), strict=True)


def _exact(orbit: MapOrbit) -> Any:
    """Of what Newton's method makes of the orbit."""
    with ctx.workprec(BITS):
        n, d = orbit.states.shape
        y = [arb(x) for x in orbit.states.ravel().tolist()]
        for _ in range(12):
            left, matrix = [], arb_mat(n * d, n * d)
            for i in range(n):
                here, later = y[i * d : i * d + d], (i + 1) % n * d
                image, derivative = _step(orbit.system, here)
                left += [u - v for u, v in zip(image, y[later : later + d], strict=True)]
                for a in range(d):
                    for b in range(d):
                        matrix[i * d + a, i * d + b] += derivative[a][b]
                    matrix[i * d + a, later + a] -= 1
            step = matrix.mid().solve(arb_mat([[z.mid()] for z in left])).entries()
            y = [(u - v).mid() for u, v in zip(y, step, strict=True)]
            if size(step) < EXACT:
                break
        product = arb_mat(np.eye(d).tolist())
        for i in range(n):
            product = arb_mat(_step(orbit.system, y[i * d : i * d + d])[1]) * product
        return _eigenvalues(product)


def _step(system: Any, s: list[Any]) -> tuple[list[Any], list[list[Any]]]:
    """Image and derivative."""
    if isinstance(system, Logistic):
        rate = arb(system.rate)
        return [rate * s[0] * (1 - s[0])], [[rate * (1 - 2 * s[0])]]
    assert isinstance(system, Henon)
    a, b = arb(system.a), arb(system.b)
    return [1 - a * s[0] ** 2 + s[1], b * s[0]], [[-2 * a * s[0], arb(1)], [b, arb(0)]]


def _eigenvalues(matrix: Any) -> Any:
    found = acb_mat(matrix.mid()).eig(algorithm="approx")
    return np.array([complex(float(z.real.mid()), float(z.imag.mid())) for z in found])
