"""Compiled calls are short: an interrupt is heard. Results do not depend on how short."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, strategies as st

from dynkit.analysis.dimension import counting
from dynkit.exponential import stacks, sums
from dynkit.exponential.evaluation_kernels import CHANGE, DEATH, LEAP, SEARCH
from dynkit.exponential.propagators import cells_of_a_call
from dynkit.exponential.sums import ExponentialSum, RootKind
from dynkit.systems import DryFriction, HardStop, ImpactChain, ImpactDuffing, SoftStop
from dynkit.systems.impact.modes import mode
from dynkit.systems.impact.simulation import (
    automaton,
    clock_kernels,
    joined_modes,
    loop_kernels as kernels,
    runs,
    trajectory,
)
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.taylor import automaton as taylor_automaton
from dynkit.systems.impact.simulation.trajectory import Trajectory
from dynkit.systems.impact.variational import tangents
from tests.effort import share
from tests.impact.any_oscillator import Begin, begins

ROOT = Path(__file__).parents[2]


def numbers(found: Trajectory) -> tuple[Any, ...]:
    """Every bit of a run but for its seconds."""
    return (
        *(array.tobytes() for array in vars(found.log).values()),
        *(array.tobytes() for array in vars(found.switches).values()),
        found.final._coordinates.tobytes(),
        found.final._turn.tobytes(),
        (found.final.relative_velocity, found.final.motion, found.final.element),
        (found.impacts, found.ending, found.chatter_error, found.cells, found.touches),
        found.longest,
    )


def in_pieces(pause: int, start: ImpactState, system: Any, **arguments: Any) -> Trajectory:
    with patch.object(runs, "cells_of_a_call", lambda slots: pause):
        return trajectory_of(system, start, **arguments)


@share(0.2)
@given(
    begin=begins(),
    pause=st.sampled_from([1, 2, 5, 16, 100]),
    noise=st.sampled_from([0.0, 2e-15]),
)
def test_a_run_in_pieces_is_the_same_run_bit_for_bit(
    begin: Begin, pause: int, noise: float
) -> None:
    asked: dict[str, Any] = {
        "count": 30,
        "store": True,
        "noise": noise,
        "seed": 3,
        "most_cells": 3000,
    }
    whole = trajectory_of(begin.system, begin.state, **asked)
    assert numbers(in_pieces(pause, begin.state, begin.system, **asked)) == numbers(whole)


@pytest.mark.parametrize("frequency", [0.408, 0.35, 0.87])
@pytest.mark.parametrize("pause", [1, 3, 64])
def test_chatter_contact_and_release_in_pieces_are_the_same(frequency: float, pause: int) -> None:
    chain = ImpactChain(masses=2, frequency=frequency, restitution=0.6)
    asked: dict[str, Any] = {"count": 200, "store": True, "noise": 0.0, "seed": 1}
    whole = trajectory_of(chain, chain.state(), **asked)
    assert numbers(in_pieces(pause, chain.state(), chain, **asked)) == numbers(whole)


@pytest.mark.plain
@pytest.mark.parametrize(
    ("chain", "needed"),
    [
        (ImpactChain(frequency=0.87), set()),
        (ImpactChain(frequency=0.35), {LEAP}),
        (ImpactChain(masses=2, frequency=0.408, restitution=0.6), {CHANGE}),
        (ImpactChain(frequency=0.87, damping=30.0), {SEARCH}),
        (ImpactChain(masses=2, amplitude=0.0, offset=-0.3, frequency=1.0), {DEATH}),
    ],
    ids=["ordinary", "long flights", "chatter", "overdamped", "table at rest"],
)
def test_a_run_pauses_for_code_that_it_needs(chain: ImpactChain, needed: set[int]) -> None:
    known: dict[Any, int] = {}
    with patch.object(runs, "_ADDRESSES", known):
        first = trajectory_of(chain, chain.state(), 60, store=True)
        assert {place for place, _ in known} == needed
        again = trajectory_of(chain, chain.state(), 60, store=True)
    assert numbers(first) == numbers(again)


def hardly_reached() -> tuple[ImpactChain, ImpactState]:
    """Two undamped modes, their ratio the golden one: they reach the stop when both are lowest."""
    chain = ImpactChain(masses=2, damping=0.0, amplitude=0.0, frequency=1.0)
    shape = chain.modal_matrix.T
    lowest = float(abs(shape[:, -1]).sum())
    chain = chain.replace(offset=-lowest * (1.0 - 1e-10))
    return chain, chain.state(shape.sum(axis=0), np.zeros(2))


def spied(calls: list[tuple[int, int]]) -> Any:
    """The kernel, which notes the impacts and cells of each call."""
    compiled = kernels.run

    def noted(mechanics: Any, clock: Any, *others: Any) -> tuple[int, int]:
        before = clock[clock_kernels.CELLS]
        done: tuple[int, int] = compiled(mechanics, clock, *others)
        calls.append((done[0], int(clock[clock_kernels.CELLS] - before)))
        return done

    return patch.object(kernels, "run", noted)


@pytest.mark.parametrize("masses", [1, 40])
def test_a_call_makes_a_bounded_number_of_impacts(masses: int) -> None:
    chain, calls = ImpactChain(masses=masses, frequency=0.87), list[tuple[int, int]]()
    impacts = 200_000 if masses == 1 else 10_000
    most = cells_of_a_call(chain._free.layout.slots)
    with spied(calls):
        chain.attractor(transient=impacts, impacts=1)
    assert sum(done for done, _ in calls) == impacts + 1
    assert max(done * kernels.PER_EVENT + cells for done, cells in calls) <= 2 * most
    assert len(calls) > 4


def test_a_search_of_many_cells_is_done_in_pieces() -> None:
    (chain, start), calls = hardly_reached(), list[tuple[int, int]]()
    with spied(calls):
        record = chain.simulate(impacts=1, start=start)
    most = cells_of_a_call(chain._free.layout.slots)
    assert record.cost.counts["cells"] > most
    assert len(calls) >= record.cost.counts["cells"] // most


@pytest.mark.parametrize("pause", [1, 1000])
def test_the_first_root_of_a_sum_is_the_same_in_pieces(pause: int) -> None:
    # Two tones that nearly cancel: the dips come down to the offset after some hundred beats.
    f = ExponentialSum([1.0, 1.0], [0.0, 0.0], [1.0, 1.41421], [0.0, 0.0], offset=1.99999)
    whole = f.first_root(limit=20_000)
    with patch.object(sums, "cells_of_a_call", lambda slots: pause):
        pieces = f.first_root(limit=20_000)
    assert whole.kind is RootKind.ROOT
    assert (pieces.time, pieces.rate, pieces.error) == (whole.time, whole.rate, whole.error)
    assert pieces.cost.counts == whole.cost.counts


@pytest.mark.parametrize("masses", [1, 3])
def test_what_is_computed_of_a_record_is_the_same_in_pieces(masses: int) -> None:
    chain = ImpactChain(masses=masses, frequency=0.408 if masses == 1 else 0.87)

    def computed() -> list[Any]:
        record = chain.simulate(impacts=500)
        moments = record.second_moments(batches=3)
        times = np.linspace(0.0, float(record.time[-1]), 777)
        spread = chain.stretching(record.states[-1], 100)
        found = (
            *record.sample(times),
            moments.products,
            moments.sums,
            spread.logs,
            spread.times,
            spread.state,
        )
        return [np.asarray(part).tobytes() for part in (*found, moments.error)]

    whole = computed()
    with (
        patch.object(mode, "cells_of_a_call", lambda slots: 7),
        patch.object(tangents, "_PRODUCTS_OF_A_CALL", 1),
        patch.object(trajectory, "_ROWS", 7),
    ):
        assert computed() == whole


@pytest.mark.parametrize("euclidean", [False, True])
def test_pairs_counted_in_pieces_are_the_same(euclidean: bool) -> None:
    points = np.random.default_rng(1).uniform(0.0, 1.0, (3000, 2))
    edges = np.append(np.geomspace(1e-3, 0.5, 20) ** (2 if euclidean else 1), np.inf)

    def counted() -> tuple[bytes, int, int]:
        found = counting.count(points, np.zeros(2), edges, 40, euclidean=euclidean)
        return found.shares.tobytes(), found.box_pairs, found.distances

    whole = counted()
    with patch.object(counting, "_PAIRS_OF_A_CALL", 50):
        assert counted() == whole


def rubbing() -> ImpactChain:
    """A chain with a table, a belt and a soft stop, which has not moved."""
    return ImpactChain(
        masses=2,
        frequency=0.9,
        elements=[
            HardStop(1, amplitude=0.1, restitution=0.4),
            DryFriction(0, force=0.02, static=0.03, velocity=0.02),
            SoftStop((0, 1), offset=-0.01, stiffness=20.0, damping=0.1),
        ],
    )


def nonlinear() -> ImpactDuffing:
    """A nonlinear spring with a table and friction, which has not moved."""
    elements = HardStop(0, offset=-0.5, restitution=0.3), DryFriction(0, force=0.02)
    return ImpactDuffing(frequency=1.2, force=0.4, elements=elements)


def lines_of(run: Callable[[], object], *, until: int = -1) -> list[tuple[str, int]]:
    """Lines of the modules that join modes, in order, in a run; the run is interrupted at one."""
    files, seen = {module.__file__ for module in JOINING}, list[tuple[str, int]]()

    def line(frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            if len(seen) == until:
                raise KeyboardInterrupt
            seen.append((frame.f_code.co_filename, frame.f_lineno))
        return line

    before = sys.gettrace()
    sys.settrace(lambda frame, *_: line if frame.f_code.co_filename in files else None)
    try:
        run()
    finally:
        sys.settrace(before)
    return seen


JOINING = automaton, joined_modes, stacks, taylor_automaton


@pytest.mark.parametrize("made", [rubbing, nonlinear])
def test_after_an_interrupt_a_machine_moves_as_before(made: Callable[[], Any]) -> None:
    def moved(machine: Any) -> tuple[Any, ...]:
        found = trajectory_of(machine, machine.state(), 10, store=True)
        return numbers(replace(found, cells=0))  # a search that pauses for a mode begins again

    whole = moved(made())
    lines = lines_of(partial(moved, made()))
    assert len(set(lines)) > 20
    last = {line: place for place, line in enumerate(lines)}
    for place in last.values():
        machine = made()
        with pytest.raises(KeyboardInterrupt):
            lines_of(partial(moved, machine), until=place)
        assert moved(machine) == whole, lines[place]


ENDLESS = """
import os, signal, threading
from dynkit.systems import ImpactChain
from dynkit.systems.impact.simulation import clock_kernels, loop_kernels as kernels

# shells let what runs in the background ignore it
signal.signal(signal.SIGINT, signal.default_int_handler)
chain = ImpactChain(masses=1, frequency=0.87)
chain.simulate(impacts=10)  # compiles
compiled, calls, at_signal = kernels.run, [0], [None]

def noted(*given):
    calls[0] += 1
    return compiled(*given)

def interrupt():
    at_signal[0] = calls[0]
    os.kill(os.getpid(), signal.SIGINT)

kernels.run = noted
threading.Timer(0.3, interrupt).start()
try:
    chain.attractor(transient=10**12, impacts=1)
except KeyboardInterrupt:
    print("interrupted after", calls[0] - at_signal[0], "calls more")
"""


def test_an_interrupt_ends_a_run_of_a_million_million_impacts() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENDLESS],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.stdout.startswith("interrupted after "), done.stderr
    assert int(done.stdout.split()[2]) <= 2
