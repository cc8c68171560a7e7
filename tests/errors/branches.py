"""Branches and bifurcations against closed forms."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from random import Random

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx

from dynkit import Bifurcation, Branch, NoConvergence, continue_orbit, periodic_orbit
from dynkit.continuation.arclength import OrbitEquations
from dynkit.systems import Henon, MatrixOscillator
from tests.errors.maps import exact_residual
from tests.impact_orbits.exact_orbits import ImpactMap
from tests.reference.random_cases import STARTS, random_case

BITS = 400
MAPS, OSCILLATORS = 400, 100


@cache
def _branch(number: int) -> Branch:
    """Fixed points of Henon's map as a changes, with its fold and its doubling."""
    b = round(Random(number).uniform(-0.8, 0.8), 6)
    orbit = periodic_orbit(Henon(a=0.1, b=b), [0.8, 0.1])
    return continue_orbit(orbit, "a", bounds=(-1.0, 3.5))


def points_of_branches(every: int) -> Iterator[tuple[float, float]]:
    """Distance of points from the curve: the shortest step onto it, from exact residuals."""
    for number in range(0, MAPS, 4 * every):
        branch = _branch(number)
        equations = OrbitEquations(branch.problem, float(np.ptp(branch.parameter)))
        b = branch.system.value_of("b")
        for x, p, claimed in zip(
            branch.unknowns, branch.parameter.tolist(), branch.error.tolist(), strict=True
        ):
            left = exact_residual(Henon(a=p, b=b), x.reshape(1, 2))
            matrix = np.array([[-2.0 * p * x[0] - 1.0, 1.0, -(x[0] ** 2)], [b, -1.0, 0.0]])
            step = np.linalg.pinv(matrix * equations.scale(np.append(x, p))) @ left
            yield float(abs(step).max()), claimed


def bifurcations_of_maps(every: int) -> Iterator[tuple[float, float]]:
    """SN and PD of Henon's map, PD of its period two, and NS where it keeps areas.

    At a = -(1 - b)^2 / 4, 3 (1 - b)^2 / 4, (1 - b)^2 + (1 + b)^2 / 4, and b = -1.
    """
    for number in range(0, MAPS, every):
        branch = _branch(number)
        b = Fraction(branch.system.value_of("b"))
        second = (1 - b) ** 2 + (1 + b) ** 2 / 4
        exact = {"SN": -((1 - b) ** 2) / 4, "PD": 3 * (1 - b) ** 2 / 4}
        for found in branch.bifurcations:
            yield _off(found, exact[found.kind])
            if found.kind == "PD":
                (doubled,) = found.switch()
                bounds = (found.value - 0.05, float(second) + 0.1)
                for other in continue_orbit(doubled, "a", bounds=bounds).bifurcations:
                    if other.kind == "PD" and abs(other.value - found.value) > 1e-6:
                        yield _off(other, second)
        a = round(Random(-number - 1).uniform(-0.8, 2.8), 6)
        turning = periodic_orbit(Henon(a=a, b=-0.9), [0.5, -0.4])
        for found in continue_orbit(turning, "b", bounds=(-1.2, -0.8)).bifurcations:
            if found.kind == "NS":
                yield _off(found, Fraction(-1))


def _off(found: Bifurcation, exact: Fraction) -> tuple[float, float]:
    rounding = 2.0**-53 * abs(found.value)
    return abs(float(Fraction(found.value) - exact)), found.error + rounding


def bifurcations_of_oscillators(every: int) -> Iterator[tuple[float, float]]:
    """SN and GR of P(1,1) as the offset of the table changes, in closed form."""
    for number in range(0, OSCILLATORS, every):
        arguments = random_case(STARTS * (20_000 + number)).arguments
        if len(arguments["M"]) > 2:  # whose branches take long
            continue
        system = MatrixOscillator(**{**arguments, "play": np.inf})
        try:
            orbits = system.periodic_orbits(periods=1)
        except ValueError:  # not driven, or not held
            continue
        if not orbits:
            continue
        exact, middle, span = _folds_and_grazings(system)
        if not np.isfinite(span):  # elastic and undamped: there is no fold
            continue
        low, high = min(middle - span, system.offset - 0.1), max(middle + span, system.offset + 0.1)
        try:
            branch = continue_orbit(orbits[0], "offset", bounds=(low, high))
        except NoConvergence:
            continue
        for found in branch.bifurcations:
            vanishes = found.kind == "GR" and abs(found.orbit.unknowns[1]) < 1e-6
            if found.kind == "SN" or vanishes:
                with ctx.workprec(BITS):
                    off = min(float(abs(arb(found.value) - x).mid()) for x in exact[found.kind])
                yield off, found.error + 2.0**-53 * abs(found.value)


def _folds_and_grazings(system: MatrixOscillator) -> tuple[dict[str, list[arb]], float, float]:
    """Offsets of SN and GR, the middle between them, and how far to look.

    P(1,1) has a gap of zero and the rate r/(1 + r) J after an impulse J: with D the amplitude of
    the gap without impacts, d its mean and s J the complex answer to an impulse, |i d + s J| = D.
    Its roots J merge where |d| |Re s| = |s| D, and one is zero where |d| = D.
    """
    with ctx.workprec(BITS):
        impacts = ImpactMap(system)
        n, c, w, r = impacts.size, impacts.contact, impacts.frequency, impacts.restitution
        free = arb_mat([[impacts.rates[i, j] for j in range(2 * n)] for i in range(2 * n)])
        one = arb_mat(np.eye(2 * n).tolist())
        kick = arb_mat([[arb(0)]] * n + [[k] for k in impacts.kick])
        kicked = ((one - (free * (2 * arb.pi() / w)).exp()).inv() * kick).mid()
        forcing = [[impacts.rates[i, 2 * n + j] for j in range(3)] for i in range(2 * n)]
        force = acb_mat([[acb(row[0], row[1])] for row in forcing])
        steady = (acb_mat(one) * acb(0, w) - acb_mat(free)).inv() * force
        rest = (-free.inv() * arb_mat([[row[2]] for row in forcing]))[c, 0]
        swing = abs(steady[c, 0] - impacts.amplitude)
        rate, place = (kicked[n + c, 0] - r / (1 + r)) / w, kicked[c, 0]
        fold = (rate * rate + place * place).sqrt() * swing / abs(rate)
        exact = {"GR": [rest - swing, rest + swing], "SN": [rest - fold, rest + fold]}
        return exact, float(rest.mid()), 2.6 * float(fold.max(swing).mid())
