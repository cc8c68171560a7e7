"""Two errors of correlation dimensions cover nine runs in ten, of sets of every kind.

Here some of the runs; `python -m tests.validation` takes 100 of each set.
"""

import numpy as np
import pytest

from tests.validation.dimensions import WITH_PLATEAU
from tests.validation.quantities import STATISTICS

RUNS = 20
# nine runs in ten, less two standard errors of a part of so many runs
COVERED = 0.9 - 2.0 * np.sqrt(0.9 * 0.1 / RUNS)


@pytest.mark.parametrize("name", STATISTICS)
def test_two_errors_cover_nine_runs_in_ten(name: str) -> None:
    found = STATISTICS[name](RUNS)
    assert found.none <= 0.1 * RUNS
    assert found.covered >= COVERED * (RUNS - found.none)


@pytest.mark.parametrize("name", WITH_PLATEAU)
def test_sets_with_a_plateau_are_seldom_said_to_have_none(name: str) -> None:
    found = STATISTICS[f"`CorrelationDimension.error`, {name}"](RUNS)
    assert found.drifts + found.none <= 0.1 * RUNS
