"""Dimensions where local slopes drift, and of data that were rounded to a grid.

Exact: 1 for the logistic map at 4, d for products of d arcsines, whose densities have square-root
singularities; Cantor sets of similarity 1/3 with weights p and q have -ln(p^2 + q^2) / ln 3.
"""

from collections.abc import Callable

import numpy as np
import pytest

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.coordinates import grid_of
from dynkit.analysis.dimension.scaling import Outcome
from dynkit.figures import new_figure
from dynkit.systems import Henon
from dynkit.validation import Array

RUNS = 20
# nine runs in ten, less two standard errors of a part of so many runs
COVERED = 0.9 - 2.0 * np.sqrt(0.9 * 0.1 / RUNS)
UNEVEN = -np.log(0.7**2 + 0.3**2) / np.log(3.0)
SIZE = 4000


def logistic(seed: int, n: int) -> Array:
    # x = sin^2(angle) doubles the angle; its binary digits come by chance, so none is lost
    digits = np.random.default_rng(seed).integers(0, 2, size=n + 52)
    turns = np.convolve(digits, 2.0 ** -np.arange(52.0, 0.0, -1.0), "valid")[:n]
    return np.sin(np.pi * turns[:, None]) ** 2


def sheared(seed: int, n: int) -> Array:
    orbit = logistic(seed, n + 1)[:, 0]
    return np.stack([orbit[1:] + 0.7 * orbit[:-1], orbit[:-1] + 0.4 * orbit[1:]], axis=1)


def arcsines(seed: int, n: int) -> Array:
    return np.sin(2.0 * np.pi * np.random.default_rng(seed).uniform(size=(n, 2)))


def cusp(seed: int, n: int) -> Array:
    """A density |x|^-0.5 on both sides of zero."""
    chance = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(n, 1))
    return np.asarray(np.sign(chance) * chance**2)


def uneven_cantor(seed: int, n: int) -> Array:
    digits = np.random.default_rng(seed).random((n, 36)) > 0.7
    return (digits @ (2.0 * 3.0 ** -np.arange(1.0, 37.0)))[:, None]


def ring(seed: int, n: int) -> Array:
    turns = 2.0 * np.pi * np.random.default_rng(seed).uniform(size=n)
    return np.stack([np.cos(turns), np.sin(turns)], axis=1)


def noise(seed: int, n: int) -> Array:
    return np.random.default_rng(seed).normal(size=(n, 2))


def henon(seed: int, n: int) -> Array:
    start = np.random.default_rng(seed).uniform(-0.1, 0.1, size=2)
    return Henon().iterate(start, n + 99)[100:]


@pytest.mark.parametrize(
    ("states", "n", "least", "most"),
    [
        (logistic, 1000, 1.0, 1.0),
        (sheared, SIZE, 1.0, 1.0),
        (cusp, SIZE, 1.0, 1.0),
        (arcsines, SIZE, 2.0, 2.0),
        (uneven_cantor, 1000, UNEVEN, UNEVEN),
        (ring, 1000, 1.0, 1.0),
        (noise, 1000, 2.0, 2.0),
        (henon, 1000, 1.21, 1.22),  # the sources beside `test_dimension_errors.HENON`
    ],
)
def test_two_errors_cover_nine_runs_in_ten(
    states: Callable[[int, int], Array], n: int, least: float, most: float
) -> None:
    found = [CorrelationDimension(states(seed, n)) for seed in range(RUNS)]
    known = [each for each in found if each.region is not None]
    covered = [least - 2.0 * each.error <= each.value <= most + 2.0 * each.error for each in known]
    assert len(known) >= 0.9 * RUNS
    assert np.mean(covered) >= COVERED


@pytest.mark.parametrize("states", [uneven_cantor, ring, noise, henon])
def test_sets_with_a_plateau_are_seldom_said_to_have_none(
    states: Callable[[int, int], Array],
) -> None:
    outcomes = [CorrelationDimension(states(seed, 1000)).outcome for seed in range(RUNS)]
    assert outcomes.count(Outcome.FOUND) >= 0.9 * RUNS


def test_drift_is_named_wherever_the_dimension_is_shown() -> None:
    found = CorrelationDimension(sheared(1, 20_000))
    assert found.outcome is Outcome.DRIFT
    assert found.region is not None
    assert found.region.drift > 2.0 * found.region.scatter
    assert "the local slopes drift: there is no plateau" in repr(found)
    for draw in (found.plot, found.plot_slopes):
        _, (axes,) = new_figure()
        assert found.outcome.value in draw(axes).get_title()


def test_dimension_plus_its_drift_is_no_larger_than_the_number_of_coordinates() -> None:
    found = CorrelationDimension(logistic(0, SIZE))
    assert found.region is not None
    assert found.value + found.region.drift <= 1.0 + 1e-12


# --- grids ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(RUNS))
def test_grid_is_found_in_any_unit_and_from_any_origin(seed: int) -> None:
    random = np.random.default_rng(seed)
    unit, origin = 10.0 ** random.uniform(-8.0, 8.0), 100.0 * random.normal()
    states = np.round(random.normal(size=(1000, 2)), 2)
    assert grid_of(unit * (states + origin)) == pytest.approx(0.01 * unit, rel=1e-6)


@pytest.mark.parametrize("states", [logistic, sheared, uneven_cantor, ring, noise, henon])
def test_states_that_were_not_rounded_have_no_grid(states: Callable[[int, int], Array]) -> None:
    assert grid_of(states(0, 1000)) == 0.0


@pytest.mark.parametrize("unit", [1.0, 1e-6, 3e5])
@pytest.mark.parametrize("seed", range(10))
def test_no_region_reaches_below_eight_steps_of_a_grid(unit: float, seed: int) -> None:
    states = np.round(10.0 * np.random.default_rng(seed).normal(size=(3000, 2)), 2)
    found = CorrelationDimension(unit * (states + 7.0))
    assert found.region is not None
    assert found.region.low >= 0.08 * unit * (1.0 - 1e-9)
    assert abs(found.value - 2.0) < 3.0 * found.error


def test_too_coarse_a_grid_leaves_no_region() -> None:
    states = np.round(np.random.default_rng(0).uniform(size=(1000, 2)), 2)
    assert CorrelationDimension(states).outcome in (Outcome.NONE, Outcome.FINITE)
