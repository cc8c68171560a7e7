"""Curves of bifurcations, and all numbers of bifurcations, against 50 digits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from random import Random
from typing import Any, NamedTuple

import numpy as np

from dynkit import (
    Bifurcation,
    Branch,
    NoConvergence,
    continue_curve,
    continue_orbit,
    periodic_orbit,
)
from dynkit.core.validation import Array
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems import Henon, HighBounce, ImpactChain, MatrixOscillator
from tests.maps.without_jacobian import without_jacobian
from tests.reference.random_cases import STARTS, random_case
from tests.validation.exact_impacts import Impacts
from tests.validation.random_maps import (
    Ball,
    branch_points_of,
    distance_to,
    equations_of,
    random_polynomial,
)

MAPS, OSCILLATORS = 1400, 2400
POINTS = 4
"""Of a curve in each direction."""

BIFURCATING = (283, 276, 682, 500, 745, 913, 731, 1144, 1970, 843, 1669)
"""Oscillators, of every seventh, whose orbits bifurcate two times or more, and soon."""

WITHOUT_JACOBIAN = (100, 200, 300, 500, 800, 1100, 1300)
"""Maps, of every hundredth, whose bifurcations take few differences each."""

Bounds = tuple[float, float]


class Case(NamedTuple):
    """A bifurcation, where its curve is to go, and what is zero there, of some free parameters."""

    found: Bifurcation
    second: str
    bounds: tuple[Bounds, Bounds]
    zeros: Callable[[tuple[str, ...]], Callable[[list[Ball]], list[Ball]]]


# --- what is compared -----------------------------------------------------------------------------


def points_of_maps(every: int) -> Iterator[tuple[float, float]]:
    """Distance of points of SN, PD, NS and BP from the curve."""
    return _points(_maps, range(0, MAPS, every))


def points_of_oscillators(every: int, numbers: Sequence[int] = ()) -> Iterator[tuple[float, float]]:
    """The same of SN, PD, NS, GR and CB of P(n,m)."""
    return _points(_oscillators, numbers or range(0, OSCILLATORS, every))


def values_of_maps(every: int) -> Iterator[tuple[float, float]]:
    """Error of the parameter."""
    for off, found in _offs(_maps, range(0, MAPS, every)):
        yield float(off[-1]), found.error


def values_without_jacobian(
    every: int, numbers: Sequence[int] = ()
) -> Iterator[tuple[float, float]]:
    """The same of maps whose derivatives are differences."""
    for off, found in _offs(_maps_without_jacobian, numbers or range(0, MAPS, every)):
        yield float(off[-1]), found.error


def values_of_oscillators(every: int, numbers: Sequence[int] = ()) -> Iterator[tuple[float, float]]:
    """The same of P(n,m)."""
    for off, found in _offs(_oscillators, numbers or range(0, OSCILLATORS, every)):
        yield float(off[-1]), found.error


def unknowns(every: int, numbers: Sequence[int] = ()) -> Iterator[tuple[float, float]]:
    """Of the unknowns of each bifurcation that which is worst, beside what is claimed of it."""
    for off, found in _all_offs(every, numbers):
        true, claimed = off[: len(found.unknowns)], found.unknowns_error
        worst = int(np.argmax(true / np.maximum(claimed, 1e-300)))
        yield float(true[worst]), float(claimed[worst])


def angles(every: int, numbers: Sequence[int] = ()) -> Iterator[tuple[float, float]]:
    """Of NS the angle of the multipliers, of GR the phase at which a gap only touches."""
    for off, found in _all_offs(every, numbers):
        if found.kind != "BP":
            yield from zip(off[len(found.unknowns) : -1].tolist(), found.own_error, strict=True)


def _points(
    cases: Callable[[int], list[Case]], numbers: Sequence[int]
) -> Iterator[tuple[float, float]]:
    for number in numbers:
        for place, (found, second, bounds, zeros) in enumerate(cases(number)):
            names = (found.parameter, second)
            if _off(cases, number, place) is None:  # nor do they tell its curve
                continue
            try:
                curve = continue_curve(found, names, bounds=bounds, points=POINTS)
            except ValueError:  # at the end of what the system allows
                continue
            ranges, asked = np.ptp(curve.parameters, axis=0), np.ptp(bounds, axis=1)
            widths = np.where(ranges > 1e-8 * asked, ranges, asked)
            for i in sorted({0, len(curve) // 2, len(curve) - 1}):
                x, own, p = curve.unknowns[i], curve.own[i], curve.parameters[i]
                units = [found.problem.scale(x), np.maximum(1.0, abs(own)), widths]
                scale = np.concatenate(units)
                off = distance_to(zeros(names), [*x.tolist(), *own.tolist(), *p.tolist()], scale)
                if off is not None:
                    yield float(abs(off).max()), float(curve.error[i])


def _all_offs(every: int, numbers: Sequence[int]) -> Iterator[tuple[Array, Bifurcation]]:
    yield from _offs(_maps, range(0, MAPS, every))
    yield from _offs(_oscillators, numbers or range(0, OSCILLATORS, every))


def _offs(
    cases: Callable[[int], list[Case]], numbers: Sequence[int]
) -> Iterator[tuple[Array, Bifurcation]]:
    for number in numbers:
        for i, case in enumerate(cases(number)):
            off = _off(cases, number, i)
            if off is not None:
                yield off, case.found


@cache
def _off(cases: Callable[[int], list[Case]], number: int, i: int) -> Array | None:
    """Errors (m + e + 1,) of unknowns, own ones and the parameter."""
    found, *_, zeros = cases(number)[i]
    y = np.concatenate([found.unknowns, found.own, [found.value]])
    scale = np.maximum(1e-3, abs(y))
    off = distance_to(zeros((found.parameter,)), y.tolist(), scale)
    return None if off is None else abs(scale * off)


# --- maps -----------------------------------------------------------------------------------------


@cache
def _maps(number: int) -> list[Case]:
    return _maps_of(number, lambda orbit: orbit)


@cache
def _maps_without_jacobian(number: int) -> list[Case]:
    return _maps_of(
        number, lambda orbit: periodic_orbit(without_jacobian(orbit.system), orbit.states)
    )


def _maps_of(number: int, taken: Callable[[PeriodicOrbit], PeriodicOrbit]) -> list[Case]:
    random = Random(number)
    family = random.choices((_polynomial, _henon, _bounce), (3, 1, 1))[0]
    try:
        orbit, names, bounds = family(random)
    except (ValueError, NoConvergence):  # there is none near the guess
        return []
    branch = continue_orbit(taken(orbit), names[0], bounds=bounds[0], points=40)
    found = [*branch.bifurcations, *_of_doubled(branch, bounds[0], 25)[:2]]
    return [_of_map(each, names[1], bounds) for each in found]


def _of_doubled(branch: Branch, bounds: Bounds, points: int) -> list[Bifurcation]:
    """What happens on the branches of twice the period that leave."""
    out = []
    for found in branch.bifurcations:
        for doubled in found.switch() if found.kind == "PD" else ():
            if not bounds[0] <= doubled.system.value_of(branch.name) <= bounds[1]:
                continue
            other = continue_orbit(doubled, branch.name, bounds=bounds, points=points)
            out += [each for each in other.bifurcations if abs(each.value - found.value) > 1e-6]
    return out


def _of_map(found: Bifurcation, second: str, bounds: tuple[Bounds, Bounds]) -> Case:
    system: Any = found.orbit.system

    def zeros(names: tuple[str, ...]) -> Callable[[list[Ball]], list[Ball]]:
        n = len(found.unknowns) // system.dimension
        if found.kind == "BP" and n == 1:
            return branch_points_of(system, names)
        return equations_of(system, names, found.kind, n)

    return Case(found, second, bounds, zeros)


Family = tuple[PeriodicOrbit, tuple[str, str], tuple[Bounds, Bounds]]


def _polynomial(random: Random) -> Family:
    system = random_polynomial(random)
    middle, width = system.middles, system.widths
    off = [random.choice((-1.0, 1.0)) * random.uniform(0.005, 0.05), random.uniform(-0.05, 0.05)]
    p, q = (middle + width * off).tolist()
    guess = [random.gauss(0.0, 0.1) for _ in range(system.dimension)]
    orbit = periodic_orbit(system.replace(p=p, q=q), system.middle + system.size * guess)
    low, high = middle - 0.3 * width, middle + 0.3 * width
    return orbit, ("p", "q"), ((low[0], high[0]), (low[1], high[1]))


def _henon(random: Random) -> Family:
    system = Henon(a=random.uniform(0.0, 1.6), b=random.choice((-1.0, 1.0)) * random.random())
    guess = [random.uniform(-0.5, 1.0), random.uniform(-0.2, 0.2)]
    orbit = periodic_orbit(system, guess, period=random.choice((1, 1, 2, 3, 4)))
    bounds = {"a": (-1.0, 2.5), "b": (-1.2, 1.2)}
    first, second = random.sample(("a", "b"), 2)
    return orbit, (first, second), (bounds[first], bounds[second])


def _bounce(random: Random) -> Family:
    r = random.uniform(0.1, 1.0)
    turns, gamma = random.choice((0, 1, 1, 2)), random.uniform(0.5, 8.0)
    phase = np.arccos(np.clip(-2.0 * np.pi * turns * (1.0 - r) / gamma, -1.0, 1.0))
    guess = [random.choice((-1.0, 1.0)) * phase, 2.0 * np.pi * turns]
    orbit = periodic_orbit(HighBounce(restitution=r, gamma=gamma), guess)
    bounds = {"gamma": (0.1, 20.0), "restitution": (0.05, 1.0)}
    first, second = random.sample(("gamma", "restitution"), 2)
    return orbit, (first, second), (bounds[first], bounds[second])


# --- oscillators ----------------------------------------------------------------------------------


@cache
def _oscillators(number: int) -> list[Case]:
    random = Random(number)
    system, names = _oscillator(random, number)
    if system is None:
        return []
    first, second = random.sample(names, 2)
    bounds = (_around(system, first, 0.4), _around(system, second, 0.2))
    several = 2 if np.isfinite(system.play) and number % 2 else 1
    try:
        orbits = system.periodic_orbits(impacts=several, periods=1 + number % 3)
    except ValueError:  # not driven, or not held
        return []
    if not orbits:
        return []
    branch = continue_orbit(random.choice(orbits), first, bounds=bounds[0], points=40)
    found = list(branch.bifurcations)
    if number % 2:
        found += _of_doubled(branch, bounds[0], 15)[:2]
    return [
        _of_oscillator(each, second, bounds)
        for each in found
        # Of what is only bisected, as two impacts that vanish at once, they have no single root.
        if each.kind != "BP" and not (each.kind in ("GR", "CB") and len(each.history) == 1)
    ]


def _oscillator(random: Random, number: int) -> tuple[Any, list[str]]:
    arguments = random_case(STARTS * (50_000 + number)).arguments
    if len(arguments["M"]) > 4:  # whose branches take long
        return None, []
    if number % 4 == 0:
        system: Any = ImpactChain(
            masses=len(arguments["M"]),
            damping=random.choice((0.0, 0.1, random.random())),
            springs=random.uniform(0.5, 2.0),
            frequency=random.uniform(0.3, 6.0),
            restitution=random.choice((0.0, 1.0, random.random(), random.random())),
            amplitude=random.uniform(0.1, 2.0),
            offset=random.gauss(0.0, 0.3),
        )
    else:
        system = MatrixOscillator(**arguments)
    names = ["offset", "frequency"]
    # Without rebound there are other borders: branches do not pass restitution 0.
    names += ["restitution"] if system.restitution > 0.0 else []
    names += [name for name in ("amplitude", "damping", "springs") if getattr(system, name, 0.0)]
    return system, names + (["play"] if np.isfinite(system.play) else [])


def _around(system: Any, name: str, part: float) -> Bounds:
    value = float(system.value_of(name))
    if name == "offset":
        return value - part, value + part
    if name == "restitution":
        return max(0.5 * value, value - part), min(1.0, value + part)
    return value * (1.0 - 0.5 * part), value * (1.0 + 0.5 * part)


def _of_oscillator(found: Bifurcation, second: str, bounds: tuple[Bounds, Bounds]) -> Case:
    system: Any = found.orbit.system
    problem: Any = found.problem

    def zeros(names: tuple[str, ...]) -> Impacts:
        sides = tuple(problem.sides.tolist())
        return Impacts(system, names, problem.periods, sides, found.kind, found.event)

    return Case(found, second, bounds, zeros)
