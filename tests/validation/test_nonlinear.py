"""Machines whose springs are not linear: near grazing, and with Coulomb friction along functions.

Here some of them; errors elsewhere are in `test_errors`.
"""

from __future__ import annotations

import pytest

from tests.reference.nonlinear_machines import random_rubbing
from tests.validation.nonlinear import compared, grazing


@pytest.mark.parametrize("number", [0, 1, 3, 4, 7, 30])
@pytest.mark.parametrize("depth", [1e-6, 1e-9, 1e-12, -1e-12])
def test_a_stop_that_is_just_touched_is_hit_to_within_the_error(number: int, depth: float) -> None:
    hit, worst = grazing(number, depth)
    assert hit is (depth > 0.0)
    assert worst <= 1.0


@pytest.mark.parametrize("number", [1, 2, 4])
def test_friction_at_a_contact_along_functions_is_right_to_within_the_error(number: int) -> None:
    found = compared(*random_rubbing(number))
    assert len(found) > 1
    assert all(max(late, off) <= error for late, off, error in found)
