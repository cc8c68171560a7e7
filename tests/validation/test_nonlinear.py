"""Machines whose springs are not linear, near grazing: impacts of 1e-3 to 1e-6, and none.

Here some of them; errors elsewhere are in `test_errors`.
"""

from __future__ import annotations

import pytest

from tests.validation.nonlinear import grazing


@pytest.mark.parametrize("number", [0, 1, 3, 4, 7, 10])
@pytest.mark.parametrize("depth", [1e-6, 1e-9, 1e-12, -1e-12])
def test_a_stop_that_is_just_touched_is_hit_to_within_the_error(number: int, depth: float) -> None:
    hit, worst = grazing(number, depth)
    assert hit is (depth > 0.0)
    assert worst <= 1.0
