"""Dimensions where local slopes drift, and of data that were rounded to a grid.

How often two errors cover the dimensions of known sets: `tests/validation/test_dimensions.py`.
"""

from collections.abc import Callable

import numpy as np
import pytest

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.coordinates import grid_of
from dynkit.analysis.dimension.scaling import Outcome
from dynkit.core.validation import Array
from dynkit.plotting.figures import new_figure
from tests.validation.dimensions import (
    arcsines,
    henon,
    logistic,
    normal,
    ring,
    sheared,
    uneven_cantor,
)

RUNS, SIZE = 20, 4000
NOISE = normal(2)


def test_drift_is_named_wherever_the_dimension_is_shown() -> None:
    found = CorrelationDimension(arcsines(1, 20_000))
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


@pytest.mark.parametrize("ratio", [30.0, 100.0])
def test_octaves_without_a_new_pair_are_gaps_of_a_set(ratio: float) -> None:
    # copies that are smaller by a large ratio leave whole octaves without any distance
    digits = np.random.default_rng(3).random((1000, 8)) > 0.5
    found = CorrelationDimension(((ratio - 1.0) * digits @ ratio ** -np.arange(1.0, 9.0))[:, None])
    assert found.outcome is Outcome.FOUND
    assert abs(found.value - np.log(2.0) / np.log(ratio)) < 2.0 * found.error


# --- grids ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(RUNS))
def test_grid_is_found_in_any_unit_and_from_any_origin(seed: int) -> None:
    random = np.random.default_rng(seed)
    unit, origin = 10.0 ** random.uniform(-8.0, 8.0), 100.0 * random.normal()
    states = np.round(random.normal(size=(1000, 2)), 2)
    assert grid_of(unit * (states + origin)) == pytest.approx(0.01 * unit, rel=1e-6)


@pytest.mark.parametrize("states", [logistic, sheared, uneven_cantor, ring, NOISE, henon])
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
