"""Growth of a frame of directions against QR decompositions by LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.core.smooth_map import stretched


def lapack(matrices: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    lengths = []
    for matrix in matrices:
        frame, triangle = np.linalg.qr(matrix @ frame)
        lengths.append(abs(triangle.diagonal()))
    return np.array(lengths), frame


@pytest.mark.parametrize(("d", "k"), [(1, 1), (3, 3), (6, 2), (12, 12)])
def test_lengths_and_directions_are_those_of_lapack(d: int, k: int) -> None:
    rng = np.random.default_rng(d + k)
    matrices = rng.standard_normal((40, d, d)) * np.exp(rng.uniform(-3.0, 3.0, (40, 1, d)))
    frame = np.linalg.qr(rng.standard_normal((d, k)))[0]
    lengths, last = lapack(matrices, frame)
    off = np.full(40, 1e-14)
    logs, errors = stretched([(m[None], off[[i]]) for i, m in enumerate(matrices)], frame)
    assert logs == pytest.approx(np.log(lengths), abs=1e-9)
    assert errors == pytest.approx(1e-14 / lengths, rel=1e-9)
    assert abs(frame.T @ frame - np.eye(k)).max() < 1e-14
    assert abs(frame @ frame.T - last @ last.T).max() < 1e-9


def test_logarithms_of_several_factors_of_a_step_add_up() -> None:
    rng = np.random.default_rng(3)
    matrices, off = rng.standard_normal((12, 4, 4)), np.full(12, 1e-13)
    one, whole = np.eye(4), np.eye(4)
    logs, errors = stretched([(m[None], off[:1]) for m in matrices], one)
    steps = [(matrices[:5], off[:5]), (matrices[5:6], off[5:6]), (matrices[6:], off[6:])]
    found = stretched(steps, whole)
    for each, alone in zip(found, (logs, errors), strict=True):
        assert each == pytest.approx(np.add.reduceat(alone, [0, 5, 6]))
    assert one == pytest.approx(whole)


@pytest.mark.parametrize("size", [1.0, 1e-200, 1e200])
def test_what_is_lost_has_no_length(size: float) -> None:
    """Directions that a factor is known to take are rounding in QR, not lengths."""
    rng = np.random.default_rng(5)
    matrix = size * rng.standard_normal((5, 3)) @ rng.standard_normal((3, 5))
    frame = np.eye(5)
    logs, errors = stretched([(matrix[None], np.array([1e-15 * size]), 2)], frame)
    lengths = lapack(matrix[None], np.eye(5))[0][0]
    assert np.isneginf(logs[0, 3:]).all()
    assert not errors[0, 3:].any()
    assert logs[0, :3] == pytest.approx(np.log(lengths[:3]))
    assert abs(frame.T @ frame - np.eye(5)).max() < 1e-14
    # where that is not known, what is not clear of its error has no logarithm
    logs, _ = stretched([(matrix[None], np.array([1e-15 * size]))], np.eye(5))
    assert np.isnan(logs[0, 3:]).all()
    nothing, _ = stretched([(np.zeros((1, 5, 5)), np.zeros(1))], frame)
    assert np.isneginf(nothing).all()
    assert abs(frame.T @ frame - np.eye(5)).max() < 1e-14
