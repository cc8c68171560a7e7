"""Branches and bifurcations against closed forms."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import cache
from random import Random

import numpy as np
from flint import arb, ctx

from dynkit import Bifurcation, Branch, NoConvergence, continue_orbit, periodic_orbit
from dynkit.continuation.orbit_equations import OrbitEquations
from dynkit.systems import Henon, MatrixOscillator
from tests.impact_orbits.exact_orbits import ImpactMap, answers
from tests.reference.random_cases import STARTS, random_case
from tests.validation.maps import exact_residual

BITS = 400
MAPS, BRANCHES, OSCILLATORS = 360, 100, 560


@cache
def branch_of_henon(number: int, points: int) -> Branch:
    """Fixed points of Henon's map as a changes, with its fold and its doubling."""
    b = round(Random(number).uniform(-0.8, 0.8), 6)
    orbit = periodic_orbit(Henon(a=0.1, b=b), [0.8, 0.1])
    return continue_orbit(orbit, "a", bounds=(-1.0, 3.5), points=points)


def points_of_branches(
    every: int, numbers: Sequence[int] = range(BRANCHES), points: int = 2000
) -> Iterator[tuple[float, float]]:
    """Distance of points from the curve: the shortest step onto it, from exact residuals.

    Of every so manieth point of every so manieth branch, of so many points in each direction.
    """
    for number in numbers[::every]:
        branch = branch_of_henon(number, points)
        equations = OrbitEquations(branch.problem, float(np.ptp(branch.parameter)))
        b = branch.system.value_of("b")
        for x, p, claimed in zip(
            branch.unknowns[::every],
            branch.parameter[::every].tolist(),
            branch.error[::every].tolist(),
            strict=True,
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
        random = Random(number)
        b = round(random.uniform(-0.8, 0.8), 6)
        near = random.uniform(0.002, 0.02)
        short = 1 - Fraction(b)
        fold, first = -(short**2) / 4, 3 * short**2 / 4
        second = short**2 + (1 + Fraction(b)) ** 2 / 4
        yield from _of_henon(float(fold) + near, b, "a", "SN", fold)
        flipped = _near_henon(float(first) - near, b, "a", "PD", float(first))
        for found in flipped:
            yield _off(found, first)
            for doubled in found.switch():
                bounds = (found.value - 0.02, float(second) + 0.02)
                for other in continue_orbit(doubled, "a", bounds=bounds).bifurcations:
                    if other.kind == "PD" and abs(other.value - found.value) > 1e-6:
                        yield _off(other, second)
        a = round(random.uniform(-0.8, 2.8), 6)
        yield from _of_henon(a, -1.0 + near, "b", "NS", Fraction(-1))


def _of_henon(
    a: float, b: float, name: str, kind: str, exact: Fraction
) -> Iterator[tuple[float, float]]:
    for found in _near_henon(a, b, name, kind, float(exact)):
        yield _off(found, exact)


def _near_henon(a: float, b: float, name: str, kind: str, exact: float) -> list[Bifurcation]:
    """What happens to a fixed point near the place where it is known to happen."""
    start = (b - 1.0 + np.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
    orbit = periodic_orbit(Henon(a=a, b=b), [start, b * start])
    branch = continue_orbit(orbit, name, bounds=(exact - 0.025, exact + 0.025))
    return [found for found in branch.bifurcations if found.kind == kind]


def _off(found: Bifurcation, exact: Fraction) -> tuple[float, float]:
    rounding = 2.0**-53 * abs(found.value)
    return abs(float(Fraction(found.value) - exact)), found.error + rounding


def bifurcations_of_oscillators(every: int) -> Iterator[tuple[float, float]]:
    """SN and GR of P(1,m), m = 1 to 3, as the offset of the table changes, in closed form."""
    for number in range(0, OSCILLATORS, every):
        yield from _of_oscillator(number, ("SN", "GR"))


def borders_of_contact(every: int) -> Iterator[tuple[float, float]]:
    """CB of P(1,m) without rebound: where the gap does not open after the impact."""
    for number in range(0, 4 * OSCILLATORS, every):
        yield from borders_of(number)


def borders_of(number: int) -> Iterator[tuple[float, float]]:
    """The same of one oscillator."""
    yield from _of_oscillator(number, ("CB",), restitution=0.0)


def _of_oscillator(
    number: int, kinds: tuple[str, ...], **changed: float
) -> Iterator[tuple[float, float]]:
    arguments = random_case(STARTS * (20_000 + number)).arguments
    periods = 1 + number % 3
    if len(arguments["M"]) > 5:  # whose branches take long
        return
    system = MatrixOscillator(**{**arguments, "play": np.inf, **changed})
    try:
        system.periodic_orbits(periods=periods)
    except ValueError:  # not driven
        return
    if system.natural_frequencies[0] == 0.0:  # not held: these have no such form
        return
    exact, width = _closed_forms(system, periods)
    if not np.isfinite(width):  # elastic and undamped: there is no fold
        return
    for kind in kinds:
        for i, place in enumerate(exact[kind]):
            for branch in _near(system, periods, float(place.mid()), width):
                for found in branch.bifurcations:
                    impulse = float(found.orbit.unknowns[1])
                    meant = {"GR": abs(impulse) < 1e-6, "CB": impulse > 0.0}.get(kind, True)
                    if found.kind == kind and meant:
                        with ctx.workprec(BITS):
                            offs = [float(abs(arb(found.value) - x).mid()) for x in exact[kind]]
                        if min(offs) == offs[i]:
                            yield offs[i], found.error + 2.0**-53 * abs(found.value)


def _near(system: MatrixOscillator, periods: int, place: float, width: float) -> Iterator[Branch]:
    """The branch of the weakest impact near an offset, from either side, if it is there."""
    for start in (place - 0.01 * width, place + 0.01 * width):
        there = system.replace(offset=start)
        orbits = there.periodic_orbits(periods=periods)
        if not orbits:
            continue
        weakest = min(orbits, key=lambda orbit: float(orbit.impulses[0]))
        bounds = (place - 0.02 * width, place + 0.02 * width)
        with suppress(NoConvergence):
            yield continue_orbit(weakest, "offset", bounds=bounds)
            return


def _closed_forms(system: MatrixOscillator, periods: int) -> tuple[dict[str, list[arb]], float]:
    """Offsets of SN, GR and CB of P(1,m), and how far the folds are apart.

    P(1,m) has a gap of zero and the rate r/(1 + r) J after an impulse J: with D the amplitude of
    the gap without impacts, d its mean and s J the complex answer to an impulse, |i d + s J| = D.
    Its roots J merge where |d| |Re s| = |s| D, and one is zero where |d| = D. The acceleration a J
    of the answer undoes that of the table where |Re s + i a / w^2| J = D.
    """
    with ctx.workprec(BITS):
        impacts = ImpactMap(system)
        n, c, w, r = impacts.size, impacts.contact, impacts.frequency, impacts.restitution
        free, kicked, steady, places = answers(impacts, periods)
        rest = places[c, 0]
        swing = abs(steady[c, 0] - impacts.amplitude)
        rate, place = (kicked[n + c, 0] - r / (1 + r)) / w, kicked[c, 0]
        bend = (free * kicked)[n + c, 0] / w**2
        fold = (rate * rate + place * place).sqrt() * swing / abs(rate)
        impulse = impacts.signs[0] * swing / (rate * rate + bend * bend).sqrt()
        exact = {
            "GR": [rest - swing, rest + swing],
            "SN": [rest - fold, rest + fold],
            "CB": [rest + impulse * (place + bend)],
        }
        return exact, float(fold.max(swing).mid())
