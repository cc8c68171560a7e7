import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import (
    finite_array,
    finite_scalar,
    in_interval,
    non_negative,
    non_negative_integer,
    positive,
    positive_integer,
)

Check = Callable[[str, object], Any]


def in_unit_interval(name: str, value: object) -> float:
    return in_interval(name, value, 0, 1)


SCALARS: list[Check] = [finite_scalar, positive, non_negative, in_unit_interval]
INTEGERS: list[Check] = [positive_integer, non_negative_integer]
NO_NUMBERS = [
    True,
    np.True_,
    "1",
    None,
    1j,
    [1.0],
    np.array([1.0]),
    float("nan"),
    np.float32("nan"),
    float("inf"),
    10**400,
]


@pytest.mark.parametrize("check", [*SCALARS, *INTEGERS])
@pytest.mark.parametrize("value", [1, np.int32(1), np.uint8(1)])
def test_integers_are_accepted(check: Check, value: object) -> None:
    assert check("size", value) == 1


@pytest.mark.parametrize("check", SCALARS)
@pytest.mark.parametrize("value", [0.5, np.float64(0.5), np.float32(0.5)])
def test_floats_are_accepted_and_become_plain_floats(check: Check, value: object) -> None:
    found = check("size", value)
    assert (found, type(found)) == (0.5, float)


@pytest.mark.parametrize("check", SCALARS)
@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: repr(value)[:12])
def test_what_is_no_finite_number_is_refused(check: Check, value: object) -> None:
    with pytest.raises(ValueError, match=r"^size must be a finite number; got "):
        check("size", value)


@pytest.mark.parametrize("value", [*NO_NUMBERS[:-1], 1.0, -1], ids=lambda value: repr(value)[:12])
@pytest.mark.parametrize("check", INTEGERS)
def test_what_is_no_count_is_refused(check: Check, value: object) -> None:
    with pytest.raises(ValueError, match=r"^size must be .*positive integer; got "):
        check("size", value)


@pytest.mark.parametrize(
    ("check", "value", "message"),
    [
        (positive, 0.0, "size must be positive; got 0.0"),
        (positive, np.float64(-0.5), "size must be positive; got -0.5"),
        (non_negative, -1, "size must not be negative; got -1"),
        (in_unit_interval, 1.2, "size must lie in [0, 1]; got 1.2"),
        (in_unit_interval, -1e-300, "size must lie in [0, 1]; got -1e-300"),
        (positive_integer, 0, "size must be a positive integer; got 0"),
        (non_negative_integer, -1, "size must be zero or a positive integer; got -1"),
    ],
)
def test_a_refusal_names_argument_limit_and_value(
    check: Check, value: object, message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        check("size", value)


@pytest.mark.parametrize(("check", "value"), [(non_negative, 0.0), (in_unit_interval, 1.0)])
def test_limits_that_belong_are_accepted(check: Check, value: float) -> None:
    assert check("size", value) == value


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        ([1.0, np.nan], (2,), "x[1] must be a finite number; got nan"),
        ([[1.0, 2.0], [-np.inf, 0.0]], (2, 2), "x[1, 0] must be a finite number; got -inf"),
        (np.inf, (), "x must be a finite number; got inf"),
        ([1.0], (2,), "x must have shape (2,); got shape (1,)"),
        ([[1.0]], (None, 3), "x must have shape (n, 3), for any n; got shape (1, 1)"),
        (1.0, (1,), "x must have shape (1,); got shape ()"),
        ([True, False], (2,), "x must be an array of real numbers; got [True, False]"),
        (["1"], (1,), "x must be an array of real numbers; got ['1']"),
        ([1j], (1,), "x must be an array of real numbers; got [1j]"),
        (
            [[1.0], [1.0, 2.0]],
            (2, 2),
            "x must be an array of real numbers; got [[1.0], [1.0, 2.0]]",
        ),
    ],
)
def test_a_refused_array_names_its_element_or_shape(
    value: object, shape: tuple[int | None, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        finite_array("x", value, shape)


def test_an_array_that_fits_is_not_copied() -> None:
    array = np.zeros((3, 2))
    assert finite_array("x", array, (None, 2)) is array


def test_integers_become_floats() -> None:
    assert finite_array("x", [1, 2], (2,)).dtype == np.float64


def test_an_empty_array_is_finite() -> None:
    assert finite_array("x", [], (None,)).shape == (0,)


def test_finite_numbers_whose_sum_is_not_are_accepted_as_they_are() -> None:
    state = np.array([1e308, 1e308, -1e308])
    assert finite_array("state", state, (3,)) is state
