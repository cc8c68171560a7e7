"""Compiled kernels read and write numbers of arrays as NumPy does."""

import numpy as np
import pytest

from dynkit.core.jit import kernel
from dynkit.core.validation import Array

LAST, FIRST = -1, 0


@kernel(entry=True)
def moved(numbers: Array, i: int, j: int, flags: Array, whole: Array) -> float:
    """Copy numbers of arrays; `numbers` and `whole` are modified in place."""
    numbers[i, j] = whole[LAST]
    whole[FIRST] = 3
    flags[j] = not flags[i]
    row = numbers[i]
    place = FIRST
    while row[place] == 0.0:
        place = place + 1
    if flags[LAST]:
        place = LAST
    found: float = row[place] + numbers[i][j]
    return found


@pytest.mark.plain
@pytest.mark.parametrize("layout", ["C", "F", "strided"])
@pytest.mark.parametrize(("i", "j"), [(0, 1), (1, 2), (-1, -2), (-2, 0)])
def test_indices_and_types_are_those_of_numpy(layout: str, i: int, j: int) -> None:
    arrays = {"C": np.zeros((2, 3)), "F": np.zeros((3, 2)).T, "strided": np.zeros((2, 6))[:, ::2]}
    numbers = arrays[layout]
    numbers[:, 2] = 0.5
    flags, whole = np.array([True, False, False]), np.array([7, 8, 9])
    expected, expected_flags = numbers.copy(), flags.copy()
    expected[i, j] = 9.0
    expected_flags[j] = not flags[i]
    found = moved(numbers, i, j, flags, whole)
    assert numbers.tolist() == expected.tolist()
    assert flags.tolist() == expected_flags.tolist()
    assert whole.tolist() == [3, 8, 9]
    row = expected[i]
    place = -1 if expected_flags[-1] else int(np.flatnonzero(row)[0])
    assert found == row[place] + 9.0
