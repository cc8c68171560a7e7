"""Bounds of what becomes of terms, against the motion of all of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs

pytestmark = pytest.mark.plain

TIMES = np.concatenate([[0.0], np.logspace(-3, 2, 60)])


def generator(pairs: Pairs) -> Array:
    """Matrix (2n, 2n) of y' = A y, the two numbers of a pair side by side."""
    n = pairs.count
    matrix = np.zeros((2 * n, 2 * n))
    for k in range(n):
        matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = pairs.generator[:, k].reshape(2, 2)
    for k, (t, s) in enumerate(pairs.links.T.tolist()):
        matrix[2 * t : 2 * t + 2, 2 * s : 2 * s + 2] += pairs.coupling[:, k].reshape(2, 2)
    return matrix


def oscillators(frequency: float, decay: float) -> Pairs:
    low = np.zeros(1)
    pairs, _ = Pairs.oscillators(np.array([frequency]), low, np.array([decay]), low)
    return pairs


KINDS = {
    "turns": oscillators(1.3, 0.0),
    "decays": oscillators(2.0, 0.3),
    "two exponentials": oscillators(1.0, 4.0),
    "rigid": oscillators(0.0, 0.0),
    "rigid under drag": oscillators(0.0, 0.6),
    "table": Pairs.rotation(0.7),
    "constant": Pairs.constant(),
}

ORDERS = [
    list(KINDS),
    list(KINDS)[::-1],
    ["rigid under drag", "table"],
    ["table", "rigid under drag"],
    ["rigid under drag"],
    ["rigid", "constant", "rigid under drag", "two exponentials"],
]


def scenes() -> list[Pairs]:
    """Pairs side by side, in several orders, and the same with some driven by others."""
    out = []
    for names in ORDERS:
        pairs = Pairs.join(*(KINDS[name] for name in names))
        out.append(pairs)
        rng = np.random.default_rng(len(names))
        links = [(t, s) for t in range(pairs.count) for s in range(t + 1, pairs.count)]
        kept = [link for link in links if rng.random() < 0.4]
        if kept:
            out.append(pairs.linked(np.array(kept).T, rng.normal(size=(4, len(kept)))))
    return out


@pytest.mark.parametrize("order", [0, 1, 4, 6, 12])
@pytest.mark.parametrize(
    "pairs", scenes(), ids=lambda p: f"{p.count} pairs, {p.links.shape[1]} links"
)
def test_derivatives_stay_within_their_bounds(pairs: Pairs, order: int) -> None:
    rng = np.random.default_rng(order)
    matrix = generator(pairs)
    for window in (0.01, 1.0, 100.0, np.inf):
        times = TIMES[window >= TIMES]
        flows = [expm(matrix * t) for t in times]
        for _ in range(10):
            row = rng.normal(size=(2, pairs.count)) * (rng.random((2, pairs.count)) < 0.6)
            weights = pairs.bound(row, order, window)
            derivative = pairs.derivative_rows(row, order).T.ravel()
            state = rng.normal(size=2 * pairs.count) * (rng.random(2 * pairs.count) < 0.6)
            used = np.where(state != 0.0, weights.T.ravel(), 0.0)  # infinite times zero
            bound = used @ abs(state)
            for flow in flows:
                terms = derivative * (flow @ state)
                rounding = 1e-12 * (1.0 + abs(terms).sum())
                assert abs(terms.sum()) <= bound + rounding


def test_bounds_of_pairs_that_grow_hold_within_their_window() -> None:
    # One that grows drives one that decays; the bounds are those of matrix exponentials.
    random = np.random.default_rng(3)
    for growth in (0.05, 0.7):
        own = np.array([[growth, -0.2], [1.5, 0.9], [-1.5, -0.9], [growth, -0.2]])
        coupling = random.normal(size=(4, 1))
        pairs = Pairs(
            own,
            np.zeros((4, 2)),
            np.ones(2),
            np.array([[1], [0]]),
            coupling,
            growth=np.array([growth, 0.0]),
        )
        assert pairs.grows
        assert not pairs.independent
        assert pairs.steadily == 1.0 / growth
        matrix = generator(pairs)
        windows = np.array([0.5, 4.0])
        for _ in range(20):
            row, state = random.normal(size=(2, 2)), random.normal(size=4)
            bounds = pairs.bounds(row[None], windows)[:, 0]
            for window, weights in zip(windows, bounds, strict=True):
                most = float((weights.T.ravel() * abs(state)).sum())
                times = np.linspace(0.0, window, 41)
                values = [row.T.ravel() @ expm(matrix * t) @ state for t in times]
                assert max(map(abs, values)) <= most * (1.0 + 1e-12)
            assert np.isinf(pairs.bound(row, 0)).any()
