"""Schur forms of large matrices, which begin with LAPACK's, and bases of single blocks."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.schur_forms.refinement import refined_schur
from dynkit.systems.impact.modes.schur_forms.schur import SchurForm
from dynkit.systems.structure.double_double import DoubleDouble
from dynkit.systems.structure.symmetric import product

UNIT = 2**200
DOUBLE_DOUBLE = 2.0**-104


def chain(n: int) -> Array:
    """State matrix of a chain of n masses with unequal dashpots."""
    springs = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    dashpots = np.random.default_rng(0).uniform(0.05, 0.15, n)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-springs, -dashpots * springs]])


def hidden_jordan_blocks(n: int) -> Array:
    """One chain of vectors for n equal pairs of eigenvalues, in other coordinates of integers."""
    jordan = np.kron(np.eye(n), [[0.0, 1.0], [-1.0, 0.0]]) + np.kron(np.eye(n, k=1), np.eye(2))
    shear = np.zeros((2 * n, 2 * n))
    shear[::2, 1::2] = np.random.default_rng(1).integers(-1, 2, (n, n))
    return np.asarray((np.eye(2 * n) + shear) @ jordan @ (np.eye(2 * n) - shear))


def integers(x: Array) -> Any:
    return np.array([int(Fraction(a) * UNIT) for a in x.ravel().tolist()], object).reshape(x.shape)


def defects(form: tuple[DoubleDouble, DoubleDouble], matrix: Array) -> tuple[float, float]:
    """Largest entries of A V - V T and of V'V - 1, in exact arithmetic."""
    vectors, small = (integers(part.high) + integers(part.low) for part in form)
    invariance = integers(matrix) @ vectors - vectors @ small
    orthogonality = vectors.T @ vectors - UNIT * integers(np.eye(vectors.shape[1]))
    return float(abs(invariance).max() / UNIT**2), float(abs(orthogonality).max() / UNIT**2)


def form_of(matrix: Array, start: int = 0) -> SchurForm:
    return SchurForm(DoubleDouble(matrix, np.zeros_like(matrix)), start)


def tolerance(matrix: Array) -> float:
    """As of small forms, see `test_schur.py`."""
    return 10.0 * len(matrix) ** 2 * DOUBLE_DOUBLE


def everything(form: SchurForm) -> tuple[DoubleDouble, DoubleDouble]:
    return form.lead(list(form.order))


@pytest.mark.parametrize("matrix", [chain(40), hidden_jordan_blocks(30)], ids=["chain", "Jordan"])
def test_large_forms_have_all_digits(matrix: Array) -> None:
    invariance, orthogonality = defects(everything(form_of(matrix)), matrix)
    assert invariance <= tolerance(matrix) * np.linalg.norm(matrix)
    assert orthogonality <= tolerance(matrix)


def test_eigenvalues_that_merge_are_not_refined() -> None:
    matrix = hidden_jordan_blocks(30)
    assert refined_schur(DoubleDouble(matrix, np.zeros_like(matrix))) is None


def test_low_parts_of_a_matrix_count() -> None:
    matrix = chain(30)
    low = np.ldexp(np.random.default_rng(2).uniform(-1.0, 1.0, matrix.shape), -54) * matrix
    refined = refined_schur(DoubleDouble(matrix, low))
    assert refined is not None
    form, vectors = (integers(part.high) + integers(part.low) for part in refined)
    residual = (integers(matrix) + integers(low)) @ vectors - vectors @ form
    assert abs(residual).max() / UNIT**2 <= tolerance(matrix) * np.linalg.norm(matrix)


def test_two_steps_suffice_where_eigenvalues_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, products = chain(60), []

    def counted(*args: Any) -> DoubleDouble:
        products.append(args)
        return product(*args)

    monkeypatch.setattr(f"{refined_schur.__module__}.product", counted)
    assert refined_schur(DoubleDouble(matrix, np.zeros_like(matrix))) is not None
    assert len(products) == 6


def test_first_columns_that_are_triangular_remain_in_large_forms() -> None:
    matrix = np.zeros((62, 62))
    matrix[2:, 2:] = chain(30)
    matrix[:2, 2:] = np.random.default_rng(3).normal(size=(2, 60))
    form = form_of(matrix, 2)
    vectors, small = form.lead([0, 1])
    assert np.array_equal(vectors.high, np.eye(62)[:, :2])
    assert not small.high.any()
    invariance, _ = defects(everything(form), matrix)
    assert invariance <= tolerance(matrix) * np.linalg.norm(matrix)


@pytest.mark.plain
def test_bases_of_single_blocks_have_all_digits() -> None:
    # Real and complex eigenvalues.
    matrix = np.random.default_rng(4).normal(size=(12, 12))
    form = form_of(matrix)
    assert {1, 2} == set(form.size)
    for number in range(len(form.size)):
        invariance, orthogonality = defects(form.lead([number]), matrix)
        assert invariance <= tolerance(matrix) * np.linalg.norm(matrix)
        assert orthogonality <= tolerance(matrix)
