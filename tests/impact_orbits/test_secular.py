"""Multipliers of many masses as roots of a secular equation."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.systems.impact.orbits.itineraries.one_mode.secular_kernels import simultaneous_roots


@pytest.mark.plain
def test_guesses_that_are_eigenvalues_to_the_last_bit_stay() -> None:
    # K = 1 - 3 / (z^2 - 1) is exactly zero at 2 and -2: blocks with eigenvalues 1 and -1
    x, y = np.array([2.0, -2.0]), np.zeros(2)
    own = np.zeros(1), np.ones(1), np.full((1, 1, 1), -3.0), np.zeros((1, 1, 1))
    work = np.empty((4, 1)), np.empty((2, 1, 1), dtype=complex)
    missing = simultaneous_roots(*own, x, y, np.ones(2, dtype=np.bool_), 9, 1e-14, 0.0, *work)
    assert not missing
    assert x.tolist() == [2.0, -2.0]
