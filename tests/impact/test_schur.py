"""Schur forms to 30 digits, before and after their blocks are put into another order."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, strategies as st
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.schur_forms.schur import SchurForm
from dynkit.systems.structure.double_double import DoubleDouble

DOUBLE_DOUBLE = 2.0**-104


def exact(x: DoubleDouble) -> Any:
    return mpmath.matrix(x.high.tolist()) + mpmath.matrix(x.low.tolist())


def defects(form: SchurForm, matrix: Array, order: list[int]) -> tuple[float, float]:
    """Largest entries of A V - V T and of V'V - 1."""
    with mp.workdps(50):
        vectors, small = map(exact, form.lead(order))
        invariance = mpmath.matrix(matrix.tolist()) * vectors - vectors * small
        orthogonality = vectors.T * vectors - mpmath.eye(vectors.cols)
        return float(max(map(abs, invariance))), float(max(map(abs, orthogonality)))


def tolerance(matrix: Array) -> float:
    """Each entry takes part in some 10 n reflections, of n sums of rounded products."""
    return 10.0 * len(matrix) ** 2 * DOUBLE_DOUBLE


def form_of(matrix: Array) -> SchurForm:
    return SchurForm(DoubleDouble(matrix, np.zeros_like(matrix)), 0)


def check(matrix: Array, seed: int) -> None:
    form, random = form_of(matrix), np.random.default_rng(seed)
    for _ in range(3):
        order = random.permutation(len(form.size)).tolist()
        invariance, orthogonality = defects(form, matrix, order)
        assert invariance <= tolerance(matrix) * np.linalg.norm(matrix)
        assert orthogonality <= tolerance(matrix)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_a_form_in_any_order_is_that_of_the_matrix(seed: int, n: int) -> None:
    check(np.random.default_rng(seed).normal(size=(n, n)), seed)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_equal_eigenvalues_change_places_without_loss(seed: int, n: int) -> None:
    # Small integers: eigenvalues agree, many of them without vectors of their own.
    check(np.random.default_rng(seed).integers(-1, 2, size=(n, n)).astype(float), seed)


@pytest.mark.plain
def test_jordan_blocks_of_complex_eigenvalues_change_places_without_loss() -> None:
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    matrix = np.kron(np.eye(3), turn) + np.kron(np.eye(3, k=1), np.eye(2))
    check(matrix, 1)


@pytest.mark.plain
def test_complex_eigenvalues_take_blocks_of_two() -> None:
    matrix = np.diag([3.0, 2.0, 0.0, 0.0]) + np.kron([[0, 0], [0, 1.0]], [[1.0, 1.0], [-1.0, 1.0]])
    assert sorted(form_of(matrix).size) == [1, 1, 2]


@pytest.mark.parametrize("number", range(4))
@pytest.mark.plain
def test_the_block_that_leads_keeps_its_eigenvalue(number: int) -> None:
    form = form_of(np.diag([1.0, 2.0, 3.0, 4.0]) + np.triu(np.ones((4, 4)), 1))
    before = [form.lead([k])[1].high[0, 0] for k in range(4)]
    assert form.lead([number])[1].high[0, 0] == pytest.approx(before[number], abs=1e-15)


@pytest.mark.plain
def test_rows_before_the_start_stay_triangular() -> None:
    matrix = np.array([[0.0, 1.0, 2.0], [0.0, 3.0, 1.0], [0.0, 1.0, 4.0]])
    form = SchurForm(DoubleDouble(matrix, np.zeros((3, 3))), 1)
    vectors, small = form.lead([0])
    assert vectors.high[:, 0].tolist() == [1.0, 0.0, 0.0]
    assert small.high[0, 0] == 0.0
