"""Streams: blocks that follow one another are one motion, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import Diverged, NoCrossing, Stream
from dynkit.systems import Henon, ImpactChain, Logistic, MatrixOscillator, SoftStop
from tests.example_systems import Ricker

SOFT = ImpactChain(
    masses=2, frequency=0.9, elements=[SoftStop(1, amplitude=0.1, stiffness=50.0, damping=0.2)]
)
MOTIONS: dict[str, tuple[Any, Any]] = {
    "logistic": (Logistic(rate=4.0), [0.3]),
    "ricker": (Ricker(growth=3.0), [0.3]),
    "henon": (Henon(), [0.1, 0.1]),
    "chaos of a chain": (ImpactChain(frequency=1.346), None),
    "chatter and sticking": (ImpactChain(frequency=0.408), None),
    "soft stop": (SOFT, None),
}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("block", [1, 17, 150, 200])
def test_blocks_are_one_motion_bit_for_bit(name: str, block: int) -> None:
    system, start = MOTIONS[name]
    whole = system.attractor(start=start, transient=20, keep=150)
    stream = system.stream(start=start, transient=20, keep=150, block=block)
    blocks = list(stream)
    assert [len(each.states) for each in blocks[:-1]] == [block] * (len(blocks) - 1)
    assert np.concatenate([each.states for each in blocks]).tobytes() == whole.states.tobytes()
    assert sum(each.duration for each in blocks) == pytest.approx(whole.duration, rel=1e-13)


def test_each_iteration_begins_at_the_start() -> None:
    stream = Logistic(rate=4.0).stream(start=[0.3], keep=30, block=10)
    one, other = ([block.states.tobytes() for block in stream] for _ in range(2))
    assert one == other


def test_blocks_after_a_packed_state_are_the_same() -> None:
    system = ImpactChain(frequency=1.346)
    stream = system.stream(keep=100, block=25)
    first, *rest = stream
    last = system.unpack_state(system.pack_state(first.final))
    again = list(stream.blocks_after(25, last))
    assert [a.states.tobytes() for a in again] == [b.states.tobytes() for b in rest]


def test_an_interrupted_block_is_filled_before_the_next_one() -> None:
    stream = Logistic(rate=4.0).stream(start=[0.3], keep=30, block=10)
    blocks = stream.blocks_after(13, np.array([0.3]))
    assert [len(block.states) for block in blocks] == [7, 10]


def test_the_states_before_the_end_of_a_motion_come_first() -> None:
    undriven = MatrixOscillator(
        M=[[1.0]], C=[[0.2]], K=[[1.0]], frequency=1.0, amplitude=0.0, restitution=0.5
    )
    start = undriven.state([2.0], [0.0])
    found = undriven.attractor(start=start, transient=0, keep=10_000)
    assert 0 < len(found.states) < 10_000
    blocks = iter(undriven.stream(start=start, transient=0, keep=10_000, block=3))
    seen = [next(blocks).states for _ in range(-(-len(found.states) // 3))]
    with pytest.raises(NoCrossing, match="there is no next state: "):
        next(blocks)
    assert np.concatenate(seen).tobytes() == found.states.tobytes()


def test_a_motion_that_runs_away_says_so() -> None:
    with pytest.raises(Diverged, match="the motion runs away"):
        list(Logistic(rate=4.0).stream(start=[1.5], transient=0, keep=100, block=2))


def test_it_says_what_it_is() -> None:
    stream = Henon().stream(start=[0.1, 0.1], keep=30, block=10)
    assert repr(stream) == "<Stream of Henon(): 30 states after 700, in blocks of 10>"
    assert isinstance(stream, Stream)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"keep": 0}, "keep must be a positive integer; got 0"),
        ({"keep": 10, "block": 2.5}, "block must be a positive integer; got 2.5"),
        ({"keep": 10, "transient": -1}, "transient must be zero or a positive integer; got -1"),
    ],
)
def test_bad_numbers_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Logistic(rate=4.0).stream(start=[0.3], **arguments)


def test_a_missing_start_is_refused() -> None:
    with pytest.raises(ValueError, match="start must be a state of the map"):
        list(Logistic(rate=4.0).stream(keep=10))


# --- frames ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MOTIONS)
def test_a_frame_goes_on(name: str) -> None:
    system, start = MOTIONS[name]
    state = system.attractor(start=start, transient=20, keep=1).states[0]
    whole = system.stretching(state, 60)
    first = system.stretching(state, 23)
    last = system.unpack_state(system.pack_state(first.final))
    rest = system.stretching(last, 37, first.frame)
    logs = np.concatenate([first.logs, rest.logs])
    finite = np.isfinite(whole.logs)
    assert (np.isfinite(logs) == finite).all()
    # times of flight are differences of times: the last digits of an impact oscillator differ
    assert logs[finite] == pytest.approx(whole.logs[finite], rel=0.0, abs=1e-9)
    if name in ("logistic", "ricker", "henon"):
        assert logs.tobytes() == whole.logs.tobytes()


def test_a_frame_that_is_given_is_not_changed() -> None:
    systems: list[tuple[Any, Any]] = [(Henon(), [0.1, 0.1]), (ImpactChain(frequency=0.9), None)]
    for system, start in systems:
        state = system.attractor(start=start, keep=1).states[0]
        frame = np.eye(system.dimension)
        system.stretching(state, 5, frame)
        assert (frame == np.eye(system.dimension)).all()
