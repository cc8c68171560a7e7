"""Single cases whose errors come from what others do not have."""

from __future__ import annotations

import pytest

from tests.errors.averages import powers_of
from tests.errors.borders import borders_of, off


@pytest.mark.parametrize("number", [247, 614, 967])
def test_positions_of_short_motions_are_rounded_as_the_terms_are_that_cancel(number: int) -> None:
    """Of 614, by a thousandth of a period between touches, terms of 2 leave a position of 0.005."""
    ((true, claimed),) = powers_of(number)
    assert true <= claimed


@pytest.mark.parametrize("number", [611, 1742])
def test_impacts_on_a_fast_table_are_late_and_push_by_what_rounding_leaves(number: int) -> None:
    ((true, claimed),) = powers_of(number)
    assert true <= 0.7 * claimed


@pytest.mark.parametrize("number", [319, 552])
def test_a_chatter_that_only_just_completes_is_a_border_where_it_does(number: int) -> None:
    """Beyond it there is no orbit, and steps cannot be halved to the end."""
    (found,) = borders_of(number)
    true, claimed = off(found)
    assert true <= claimed < 1e-5
