"""The references of impact oscillators agree with each other."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.systems.impact.oscillators.chain import ImpactChain
from tests.impact.exact import ExactMotion
from tests.reference.general_oscillator import GeneralOscillator, chain_of
from tests.reference.impact_chain import ReferenceChain
from tests.reference.test_general_invariants import CLOSE, distance


@pytest.mark.parametrize("damping", [0.0, 0.1, 3.0])
@pytest.mark.parametrize("frequency", [0.35, 0.87])
def test_the_paper_chain_is_that_of_the_modal_reference(frequency: float, damping: float) -> None:
    modal = ReferenceChain(10, damping=damping, frequency=frequency)
    oscillator = chain_of([1.0] * 10, [1.0] * 10, damping, frequency=frequency,
                          restitution=0.85, amplitude=0.1)  # fmt: skip
    start = modal.paper_start()
    expected = modal.simulate(15).impacts
    found = oscillator.simulate(*start, impacts=15).impacts
    assert max(map(distance, expected, found)) < CLOSE


def test_unequal_elements_are_those_of_the_modal_reference() -> None:
    masses, springs = [0.5, 3.0, 1.25], [2.0, 0.125, 8.0]
    modal = ReferenceChain(masses, springs, damping=0.7, frequency=1.3, offset=-0.1)
    oscillator = chain_of(masses, springs, 0.7, frequency=1.3, restitution=0.85,
                          amplitude=0.1, offset=-0.1)  # fmt: skip
    start = [0.25, -0.5, 0.75], [1.0, 0.0, -0.5], 0.4
    expected = modal.simulate(12, *start).impacts
    assert max(map(distance, expected, oscillator.simulate(*start, impacts=12).impacts)) < CLOSE


def test_chatter_and_contact_are_those_of_the_modal_reference() -> None:
    # That one cuts the chatter at u = 1e-23, where 2 u^2 / (a (1 - r)) is 1e-43 and less.
    modal = ReferenceChain(2, frequency=0.408, restitution=0.3)
    oscillator = chain_of([1.0] * 2, [1.0] * 2, 0.1, frequency=0.408, restitution=0.3,
                          amplitude=0.1)  # fmt: skip
    start = modal.paper_start()
    expected, found = modal.simulate(65), oscillator.simulate(*start, impacts=80)
    start_of, end_of = expected.contacts[0]
    assert abs(found.contacts[0].start - start_of) < mpf("1e-40")
    assert abs(found.contacts[0].release - end_of) < mpf("1e-40")
    after, alike = (
        [p for p in history.impacts if p.time > end_of][:3] for history in (expected, found)
    )
    assert len(after) == 3
    assert max(map(distance, after, alike)) < mpf("1e-38")


@pytest.mark.parametrize("damping", [(0.5, 0.0), (0.02, 1.7, 0.3), (8.0, 0.1, 0.0)])
def test_dashpots_apart_follow_the_exact_motion(damping: tuple[float, ...]) -> None:
    # `ExactMotion` starts from the times of a record and has 40 digits of its own.
    chain = ImpactChain(masses=len(damping), damping=damping, amplitude=0.3, frequency=0.8)
    oscillator = GeneralOscillator(
        chain.mass.tolist(), chain.damping_matrix.tolist(), chain.stiffness.tolist(),
        frequency=0.8, restitution=0.85, amplitude=0.3,
    )  # fmt: skip
    n = len(damping)
    history = oscillator.simulate([1.0] * n, [0.0] * n, impacts=6)
    record = SimpleNamespace(
        start=SimpleNamespace(position=np.ones(n), velocity=np.zeros(n), phase=0.0),
        time=np.array([float(p.time) for p in history.impacts]),
        sticking=np.zeros((0, 2)),
    )
    with mp.workdps(40):
        exact = ExactMotion(chain).follow(record)  # type: ignore[arg-type]
        for (time, state, _), impact in zip(exact, history.impacts, strict=True):
            ours = impact.position + impact.velocity
            assert abs(time - impact.time) < mpf("1e-30")
            assert max(abs(a - b) for a, b in zip(state[: 2 * n], ours, strict=True)) < 1e-30
