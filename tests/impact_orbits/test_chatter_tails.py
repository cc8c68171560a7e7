"""Tails of chatters: what flights and impacts make of changes, against plain products."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from dynkit.core.differences import STEP
from dynkit.systems.impact.orbits.exponentials import carried, changed, gained, lifted
from dynkit.systems.impact.orbits.itineraries.several_modes.chatter_kernels import carry


@pytest.mark.plain
def test_a_kernel_carries_changes_as_products_of_matrices_do() -> None:
    random, n, d = np.random.default_rng(0), 3, 4
    flown, hits = random.normal(size=(n, d, d)), random.normal(size=(2, d, d))
    movings, delays, more = random.normal(size=(3, n, d))
    delay, which = random.normal(size=n), np.array([1, 0, 1])
    changes = random.normal(size=(d, 2))
    expected, late = changes.copy(), np.zeros(2)
    for i in range(n):
        later = delays[i] @ expected + delay[i]
        moved = hits[which[i]] @ (expected + flown[i] @ expected)
        expected = moved + np.outer(movings[i], later) + more[i][:, None]
        late += later
    delayed = np.empty((2, 2))
    carry(flown, hits, which, movings, delays, delay, more, changes, np.empty((d, 2)), delayed)
    assert changes == pytest.approx(expected, rel=1e-12)
    assert delayed[1] == pytest.approx(late, rel=1e-12)


@pytest.mark.parametrize("leading", [6, 2, 0], ids=["all", "two coordinates", "none"])
def test_changes_of_a_flow_are_those_of_its_exponential(leading: int) -> None:
    random = np.random.default_rng(1)
    flow, change = random.normal(size=(2, 6, 6))
    flow[:leading, leading:] = change[:, leading:] = 0.0
    states, times = random.normal(size=(4, 6)), np.array([2.0, 0.5, 1e-3, 1e-9])
    both, complex_flow = np.block([[flow, np.zeros((6, 6))], [change, flow]]), flow + 0j
    complex_flow.imag = STEP * change
    found = carried(complex_flow, states, times)
    units = np.array([1.0, 2.0, 3.0, 1.0, 0.5, 1.0])
    long = gained(np.stack([complex_flow] * 4), states, times, units)
    for z, t, *own, less_one in zip(states, times, found, long, lifted(flow, times), strict=True):
        exact = expm(both * t)
        for each in own:
            assert each == pytest.approx(exact[6:, :6] @ z, rel=1e-12, abs=1e-13 * t)
        assert less_one == pytest.approx(exact[:6, :6] - np.eye(6), rel=1e-12, abs=1e-14)


def test_changes_of_flights_keep_their_digits_however_short_they_are() -> None:
    w, times = 3.0, np.array([1e-12, 1e-5, 0.3, 40.0])
    flow = np.array([[0.0, 1.0], [-w * w, 0.0]])
    found = changed(np.stack([flow] * len(times)), times, np.array([1.0, w]))
    for t, own in zip(times, found, strict=True):
        less, s = -2.0 * np.sin(0.5 * w * t) ** 2, np.sin(w * t)
        assert own == pytest.approx(np.array([[less, s / w], [-w * s, less]]), rel=1e-13)
