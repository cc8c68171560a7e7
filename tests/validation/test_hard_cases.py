"""Single cases whose errors come from what others do not have."""

from __future__ import annotations

import pytest

from tests.reference.random_cases import STARTS, random_case
from tests.reference.random_sticking import sticking_orbit
from tests.validation import branches
from tests.validation.averages import powers_of
from tests.validation.borders import borders_near, borders_of, off
from tests.validation.multipliers import of_orbit


@pytest.mark.parametrize("number", [247, 614, 967])
def test_positions_of_short_motions_are_rounded_as_the_terms_are_that_cancel(number: int) -> None:
    """Of 614, by a thousandth of a period between touches, terms of 2 leave a position of 0.005."""
    ((true, claimed),) = powers_of(number)
    assert true <= claimed


@pytest.mark.parametrize("number", [611, 1742])
def test_impacts_on_a_fast_table_are_late_and_push_by_what_rounding_leaves(number: int) -> None:
    ((true, claimed),) = powers_of(number)
    assert true <= 0.7 * claimed


def test_an_acceleration_is_rounded_as_fast_modes_are_although_the_table_is_slow() -> None:
    pairs = list(branches.borders_of(937))
    assert pairs
    assert all(true <= 0.5 * claimed for true, claimed in pairs)


@pytest.mark.parametrize("number", [489, 678])
def test_multipliers_move_with_the_rounded_period_in_which_modes_turn_often(number: int) -> None:
    orbits = random_case(STARTS * number).system().periodic_orbits(periods=2)
    pairs = [pair for orbit in orbits[:1] for pair in of_orbit(orbit)]
    assert pairs
    assert all(true <= claimed for true, claimed in pairs)


@pytest.mark.parametrize("number", [272, 427])
def test_only_multipliers_that_are_zero_by_their_nature_have_no_error(number: int) -> None:
    """Others of these orbits are smaller than what rounding leaves of them."""
    orbit = sticking_orbit(number)
    assert orbit is not None
    assert (orbit.multipliers_error[-2:] == 0.0).all()
    assert (orbit.multipliers_error[:-2] > 1e-17).all()


def test_a_border_that_is_halved_to_is_as_wrong_in_a_narrow_range_as_in_a_wide_one() -> None:
    """Rounding of the orbit moves the border; the range that is followed has no part in it."""
    (wide,), (narrow,) = borders_of(2364), borders_near(2364, 0.0219)
    for found in (wide, narrow):
        true, claimed = off(found)
        assert true <= claimed
    assert 0.1 < narrow.error / wide.error < 10.0


@pytest.mark.parametrize("number", [319, 552])
def test_a_chatter_that_only_just_completes_is_a_border_where_it_does(number: int) -> None:
    """Beyond it there is no orbit, and steps cannot be halved to the end."""
    (found,) = borders_of(number)
    true, claimed = off(found)
    assert true <= claimed < 1e-5
