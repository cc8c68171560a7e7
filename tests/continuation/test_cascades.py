"""Cascades of period doublings: every branch is of the period that its label says.

`CASES=10 python -m pytest tests/continuation/test_cascades.py` takes ten times as many random maps.
"""

from __future__ import annotations

import os
from itertools import pairwise

import numpy as np
import pytest

from dynkit import Branch, Map, continue_orbit, explore, periodic_orbit
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems import Henon, ImpactChain, Logistic
from tests.continuation.cascades import Hump, Sine, cascade, random_hump
from tests.example_systems import Ricker

MORE = int(os.environ.get("CASES", "1"))

# K. M. Briggs, A precise calculation of the Feigenbaum constants, Math. Comp. 57 (1991) 435-439.
FEIGENBAUM = 4.669201609102990

# Doublings of x' = r x (1 - x): OEIS A098587 for P(4), A091517 for the limit 3.5699456718; the
# first two are 3 and 1 + sqrt(6).
LOGISTIC = [
    3.0,
    3.449489742783178,
    3.544090359551568,
    3.564407266095,
    3.568759419544,
    3.569691609801,
    3.569891259378,
]


def least_period(branch: Branch, x: np.ndarray) -> int:
    """Least number of iterates after which the states come again, by comparing them."""
    states = np.reshape(x, (-1, branch.system.dimension))
    return min(
        k
        for k in range(1, len(states) + 1)
        if abs(np.roll(states, -k, axis=0) - states).max() < 1e-9
    )


def assert_own_period(branch: Branch) -> None:
    periods = {least_period(branch, x) for x in branch.unknowns}
    assert {f"P({n})" for n in periods} == {branch.label}


def order(x: np.ndarray) -> tuple[int, ...]:
    """In which order an orbit visits its states: the same all along a branch of a map of a line."""
    ranks = np.argsort(np.argsort(x))
    return tuple(np.roll(ranks, -int(np.argmin(ranks))).tolist())


def assert_a_cascade(
    system: Map, guess: list[float], name: str, bounds: tuple[float, float], doublings: int
) -> list[float]:
    places: list[float] = []
    for k, (branch, doubling) in enumerate(cascade(system, guess, name, bounds, doublings)):
        assert branch.label == f"P({2**k})"
        assert_own_period(branch)
        if system.dimension == 1:
            assert len({order(x) for x in branch.unknowns}) == 1
        # the orbit that doubles, by brute force: -1 is an eigenvalue of the product
        product = np.eye(system.dimension)
        for state in doubling.orbit.states:
            product = doubling.orbit.system.jacobian(state) @ product
        assert abs(np.linalg.eigvals(product) + 1.0).min() < 1e-6
        for meeting in (b for b in branch.bifurcations if b.kind == "BP" and k):
            assert abs(meeting.value - places[-1]) < 1e-9
        places.append(doubling.value)
    return places


def test_the_cascade_of_the_logistic_map_is_that_of_the_literature() -> None:
    found = assert_a_cascade(Logistic(rate=2.9), [0.6], "rate", (2.8, 3.6), len(LOGISTIC))
    assert found == pytest.approx(LOGISTIC, abs=2e-12)


@pytest.mark.parametrize(
    ("system", "guess", "name", "bounds"),
    [
        (Henon(a=0.2, b=0.3), [0.8, 0.2], "a", (0.1, 1.2)),
        (Sine(0.6), [0.6], "p", (0.55, 0.9)),
        (Ricker(1.8), [1.0], "growth", (1.5, 2.75)),
    ],
)
def test_distances_of_doublings_tend_to_the_ratio_of_feigenbaum(
    system: Map, guess: list[float], name: str, bounds: tuple[float, float]
) -> None:
    found = assert_a_cascade(system, guess, name, bounds, 5)
    steps = np.diff(found)
    # the ratios come nearer by about the same factor each time
    assert steps[-2] / steps[-1] == pytest.approx(FEIGENBAUM, rel=1e-2)


@pytest.mark.parametrize("number", range(MORE))
def test_an_exploration_follows_the_cascade_of_a_random_hump(number: int) -> None:
    system, bounds = random_hump(100 + number), (2.0, 4.2)
    expected = [doubling.value for _, doubling in cascade(system, [0.5], "p", bounds, 4)]
    seeds = [periodic_orbit(system, [0.5])]
    network = explore(system, "p", bounds, iterates=8, seeds=seeds)
    found = []
    for k in range(4):
        (branch,) = network.find(f"P({2**k})")
        assert_own_period(branch)
        found += [b.value for b in branch.bifurcations if b.kind == "PD"]
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("number", range(2 * MORE))
def test_random_humps_double_their_periods(number: int) -> None:
    system = random_hump(number)
    found = assert_a_cascade(system, [0.5], "p", (2.0, 4.2), 5)
    steps = np.diff(found)
    assert steps[-2] / steps[-1] == pytest.approx(FEIGENBAUM, rel=3e-2)


def test_a_switched_orbit_is_near_where_its_branch_begins() -> None:
    # in units of its own size: an eighth of the way to its own doubling, about
    places = list(cascade(Logistic(rate=2.9), [0.6], "rate", (2.8, 3.6), 6))
    for (_, first), (branch, second) in pairwise(places):
        (orbit,) = first.switch()
        assert (
            0.0 < orbit.system.value_of("rate") - first.value < 0.2 * (second.value - first.value)
        )
        assert abs(orbit.multipliers - 1.0).min() < 0.25
        assert branch.parameter.min() >= first.value - 1e-9


def test_from_where_a_period_doubles_the_single_orbit_is_continued_as_such() -> None:
    single = continue_orbit(periodic_orbit(Logistic(rate=2.9), [0.6]), "rate", bounds=(2.8, 3.3))
    (orbit,) = single.bifurcations[0].switch()
    doubled = continue_orbit(orbit, "rate", bounds=(2.8, 3.3))
    (meeting,) = (b for b in doubled.bifurcations if b.kind == "BP")
    assert_own_period(continue_orbit(meeting.orbit, "rate", bounds=(2.8, 3.3)))


def test_impacts_of_a_mass_double_their_periods() -> None:
    # each doubled branch is of its own label, and its doubling one of its own orbits
    chain = ImpactChain(masses=1, frequency=0.9)
    orbit: PeriodicOrbit = chain.periodic_orbit(impacts=1, periods=1)
    n = 1
    branch = continue_orbit(orbit, "frequency", bounds=(0.3, 1.2))
    for _ in range(2):
        doubling = next(b for b in branch.bifurcations if b.kind == "PD")
        (orbit,) = doubling.switch()
        n *= 2
        assert orbit.label == f"P({n},{n})"
        assert abs(orbit.multipliers - 1.0).min() < 0.25
        branch = continue_orbit(orbit, "frequency", bounds=(0.3, 1.2), points=60)
        assert branch.label == f"P({n},{n})"
        once = [branch.problem.shortest(x)[0] is branch.problem for x in branch.unknowns]
        assert all(once)


def test_the_hump_without_more_is_the_logistic_map() -> None:
    assert Hump(3.2)(np.array([0.3])) == Logistic(3.2)(np.array([0.3]))
