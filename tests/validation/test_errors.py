"""True errors exceed the claimed ones in at most 1 of 1000 random cases, which are close to them.

Here some of the cases; `python -m tests.validation` takes all.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference.random_cases import CASES, STARTS, Kept, rows_of
from tests.validation.quantities import QUANTITIES
from tests.validation.ratios import Ratios
from tests.validation.records import missing_impacts

FEWEST = 20
"""Cases of each claim."""


@pytest.fixture(scope="module", params=QUANTITIES)
def found(request: pytest.FixtureRequest) -> Ratios:
    """One quantity, measured once: its tests follow each other, in one process."""
    return Ratios.of(QUANTITIES[request.param].tested_pairs())


def test_one_in_a_thousand_is_off_by_more_than_is_claimed(found: Ratios) -> None:
    assert len(found) >= FEWEST
    assert found.exceedances <= len(found) / 1000.0


def test_a_claim_of_no_error_would_exceed(found: Ratios) -> None:
    """Half of the true errors, or more, are not zero: a sample can fail."""
    assert np.count_nonzero(found.true) >= 0.5 * len(found)


def test_what_is_claimed_is_of_use(found: Ratios) -> None:
    """Half of the claims are no more than 10,000 times too large, and few are none at all."""
    assert np.median(found.ratios) > 1e-4
    assert found.lost <= 0.1 * len(found)


def test_impacts_are_missed_only_where_that_is_claimed() -> None:
    assert not missing_impacts(8)


@pytest.mark.parametrize("number", [0, 401, 1202, 2403])
def test_kept_impacts_are_those_that_are_computed_anew(number: int) -> None:
    kept = Kept.load()
    rows = np.flatnonzero(kept.number == number)
    anew = Kept.of(rows_of(number))
    assert kept.place[rows].tolist() == anew.place.tolist()
    for new, row in enumerate(rows.tolist()):
        for now, before in zip(anew.numbers(new), kept.numbers(row), strict=True):
            assert now == pytest.approx(before, rel=1e-6, abs=1e-30)


def test_there_are_three_thousand_cases_of_records() -> None:
    numbers = np.unique(Kept.load().number)
    assert len(numbers) >= 3000
    assert numbers[-1] < CASES
    assert len(np.unique(numbers // STARTS)) > 700
