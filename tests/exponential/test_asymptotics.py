"""What becomes of driven and of drifting terms for ever, against the motion itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from dynkit.core.jit import kernel
from dynkit.core.validation import Array
from dynkit.exponential.asymptotics import Responses
from dynkit.exponential.bound_kernels import stays_in_band, tail
from dynkit.exponential.evaluation_kernels import START, STATES, Ladder
from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import Propagators, ladder
from tests.exponential.test_modes import generator, oscillators

TIMES = np.concatenate([[0.0], np.logspace(-3, 4, 400)])
ROTATION, CONSTANT = Pairs.rotation(1.3), Pairs.constant()
TABLE, ONE = 2, 3
"""Slots of the two that drive."""


@kernel(entry=True)
def tail_of(sums: Ladder, states: Array) -> float:
    return tail(sums, sums.links, states, START)


@kernel(entry=True)
def in_band(sums: Ladder, states: Array, band: float) -> bool:
    return stays_in_band(sums, sums.links, states, START, band)


MODES: dict[str, tuple[Pairs, Pairs]] = {
    "at resonance, damped": (oscillators(1.3, 1e-3), oscillators(0.4, 0.1)),
    "near resonance": (oscillators(1.3001, 0.0), oscillators(2.0, 0.0)),
    "dragged": (oscillators(0.0, 0.3), oscillators(1.3, 0.02)),
    "hardly dragged": (oscillators(0.0, 1e-9), oscillators(0.9, 0.0)),
    "rigid": (oscillators(0.0, 0.0), oscillators(1.3, 0.01)),
}
DRIVEN: dict[str, list[tuple[int, int]]] = {
    "alone": [],
    "by the table": [(1, TABLE)],
    "by weights": [(0, ONE)],
    "by both": [(1, TABLE), (0, ONE), (1, ONE)],
    "one by the other": [(0, 1), (1, TABLE)],
}
CASES = [(mode, drive) for mode in MODES for drive in DRIVEN]


def scene(mode: str, drive: str) -> Pairs:
    pairs = Pairs.join(*MODES[mode], ROTATION, CONSTANT)
    rng = np.random.default_rng(5)
    for link in DRIVEN[drive]:
        push = rng.normal(size=2) * [1.0, link[1] != ONE]
        pairs = pairs.linked(np.array([link]).T, np.array([[0.0, 0.0, *push]]).T)
    return pairs


def random_state(rng: np.random.Generator) -> Array:
    """Two pairs of any size, a phase, and the number one."""
    state = np.zeros((2, 4))
    state[:, :2] = rng.normal(size=(2, 2)) * 10.0 ** rng.uniform(-3, 1)
    angle = rng.uniform(0.0, 6.28)
    state[:, TABLE] = np.sin(angle), np.cos(angle)
    state[0, ONE] = 1.0
    return state


@pytest.mark.parametrize(("mode", "drive"), CASES)
def test_no_sum_falls_below_its_tail(mode: str, drive: str) -> None:
    pairs = scene(mode, drive)
    propagators = Propagators.of(pairs)
    flows = expm(generator(pairs) * TIMES[:, None, None])
    rng = np.random.default_rng(7)
    for _ in range(40):
        row = np.zeros((2, 4))
        row[0] = rng.normal(size=4)
        sums = ladder(row, float(rng.normal()), propagators, TABLE)
        states = np.zeros((STATES, 2, propagators.step.shape[2]))
        states[START, :, :4] = random_state(rng)
        low = tail_of(sums, states)
        start = states[START, :, :4].T.ravel()
        flown = flows @ start
        values = flown @ row.T.ravel() + sums.offset
        # Exponentials of long times by squaring: so many roundings.
        rounding = 1e-15 * (1.0 + TIMES) * (1.0 + abs(flown).max())
        assert (values >= low - rounding).all()
        band = abs(values).max() * 0.999
        assert not in_band(sums, states, band)


@pytest.mark.parametrize("mode", ["at resonance, damped", "dragged"])
@pytest.mark.parametrize("drive", ["by the table", "by weights"])
@pytest.mark.plain
def test_in_the_end_the_tail_is_steady_motion_and_drift(mode: str, drive: str) -> None:
    pairs = scene(mode, drive)
    propagators = Propagators.of(pairs)
    row = np.zeros((2, 4))
    row[0, 1], row[0, TABLE] = 1.0, 0.5
    sums = ladder(row, 0.0, propagators, TABLE)
    states = np.zeros((STATES, 2, propagators.step.shape[2]))
    start = random_state(np.random.default_rng(1)).T.ravel()
    later = expm(generator(pairs) * 1e5) @ start
    states[START, :, :4] = later.reshape(4, 2).T
    turns = [expm(generator(pairs) * t) @ later for t in np.linspace(0.0, 6.28 / 1.3, 400)]
    lowest = min(float(turn @ row.T.ravel()) for turn in turns)
    # 400 points of a turn miss its minimum by 2e-5 of it; 1e5 times rounding is less.
    assert tail_of(sums, states) == pytest.approx(lowest, rel=1e-4, abs=0.0)


@pytest.mark.plain
def test_a_steady_response_moves_with_what_drives_it() -> None:
    pairs = scene("at resonance, damped", "by both")
    responses = Responses.of(pairs)
    matrix = generator(pairs)
    assert sorted(map(tuple, responses.slots.tolist())) == [(0, ONE), (1, TABLE), (1, ONE)]
    for (target, driver), response in zip(responses.slots, responses.matrices, strict=True):
        own = matrix[2 * target : 2 * target + 2, 2 * target : 2 * target + 2]
        drive = matrix[2 * driver : 2 * driver + 2, 2 * driver : 2 * driver + 2]
        push = matrix[2 * target : 2 * target + 2, 2 * driver : 2 * driver + 2]
        size = abs(response).max() * (abs(own).max() + abs(drive).max())
        assert abs(response @ drive - own @ response - push).max() <= 1e-14 * size


@pytest.mark.plain
def test_no_mode_has_a_steady_response_to_a_push_that_it_cannot_hold() -> None:
    responses = Responses.of(scene("dragged", "by weights"))
    assert not len(responses.slots)
    assert responses.pairs.links.tolist() == [[0], [ONE]]
