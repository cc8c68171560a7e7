"""Impacts: the kernel, what surrounds it, growth with the number of masses, and elements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from dynkit import basins, parameter_map, sweep
from dynkit.analysis.work_precision.measuring import reference_impacts
from dynkit.systems import HardStop, ImpactChain, Jenkins, SingleImpactOscillator, SoftStop
from dynkit.systems.impact.simulation import ensemble_kernels, loop_kernels
from tests.benchmarks.peers.paper import PaperAlgorithm
from tests.benchmarks.report import Line, in_turns

SWEPT = np.linspace(0.14, 2.0, 931)
"""Frequencies of figure 4."""


def repeated(system: Any, impacts: int, runs: int = 5) -> tuple[float, Any]:
    """Return the seconds of an event of a long run after a transient, and the run's record."""
    start = system.simulate(impacts=1000).final
    call = partial(system.simulate, impacts=impacts, start=start)
    record = call()
    return in_turns(call, runs=runs)[0] / len(record.events), record


def kernel() -> float:
    """Seconds of an impact on P(1,3) of the chain of ten masses."""
    return repeated(ImpactChain(frequency=0.87), 20_000)[0]


def single_impacts() -> Iterator[Line]:
    """Impacts of the chain, beside the algorithm of the paper, which takes samples."""
    for frequency, motion, impacts in ((0.87, "P(1,3)", 300), (0.35, "chaos", 30)):
        chain = ImpactChain(frequency=frequency)
        start = chain.simulate(impacts=1000).final
        exact = reference_impacts(chain, start, impacts, 1e-12)
        peer = PaperAlgorithm().prepare(exact, 1e-12)
        ours, theirs = in_turns(
            partial(chain.simulate, impacts=20_000, start=start),
            lambda: [peer(10**9) for _ in range(10)],  # noqa: B023
        )
        yield Line(
            f"impact, 10 masses, {motion}, frequency {frequency}", ours / 20_000,
            "the paper's algorithm, compiled, 1e-12", theirs / 10 / impacts,
        )  # fmt: skip
    periodic = kernel()
    sticking, _ = repeated(ImpactChain(frequency=0.408), 20_000)
    yield Line(
        "impact, 10 masses, with sticking, frequency 0.408", sticking, "that of P(1,3)", periodic
    )


def shares(call: Callable[[], object], runs: int = 3) -> tuple[float, float]:
    """Least processor seconds of a call, and those of the kernels of impacts in it."""
    inside = 0.0

    def timed(plain: Any, *arguments: Any) -> Any:
        nonlocal inside
        began = process_time()
        try:
            return plain(*arguments)
        finally:
            inside += process_time() - began

    best = np.inf, np.inf
    kernels: Any = (loop_kernels, "run"), (ensemble_kernels, "arrive")
    plains = [getattr(module, name) for module, name in kernels]
    for (module, name), plain in zip(kernels, plains, strict=True):
        setattr(module, name, partial(timed, plain))
    try:
        for _ in range(runs):
            inside, began = 0.0, process_time()
            call()
            best = min(best, (process_time() - began, inside))
    finally:
        for (module, name), plain in zip(kernels, plains, strict=True):
            setattr(module, name, plain)
    return best


def around_the_kernel() -> Iterator[Line]:
    """Sweeps, cells of basins and points of planes beside the kernel's share; a short run."""
    chain = ImpactChain(frequency=0.87)
    one = SingleImpactOscillator(frequency=2.2, restitution=0.8)
    starts = np.zeros((120, 120, 3))
    starts[..., 0] = np.linspace(-1.5, -0.05, 120)[:, None]
    starts[..., 1] = np.linspace(-1.0, 1.0, 120)
    plane = {"frequency": np.linspace(0.2, 1.8, 12), "restitution": np.linspace(0.3, 0.9, 12)}
    cases: Any = (
        (
            "value of figure 4's sweep, 10 masses, 800 impacts", SWEPT.size, 1.5,
            partial(sweep, chain, "frequency", SWEPT, progress=False),
        ),
        (
            "point of a plane, 10 masses, 1000 impacts and a label", 144, 1.0 / 0.85,
            partial(parameter_map, chain, plane, transient=900, keep=100, progress=False),
        ),
        (
            "cell of a basin, one mass, until it arrives at P(1,1)", 14_400, None,
            partial(basins, one, starts, transient=200, keep=50, progress=False),
        ),
    )  # fmt: skip
    for what, count, most, call in cases:
        call()
        whole, inside = shares(call)
        yield Line(what, whole / count, "its impacts in the kernel", inside / count, most)
    start = chain.simulate(impacts=3000).final
    short = partial(chain.simulate, impacts=10, start=start)
    ten = in_turns(lambda: [short() for _ in range(300)])[0] / 300
    yield Line("`simulate(impacts=10)`, 10 masses", ten, "an impact of a long run", kernel(), 80)


def growth_with_size() -> Iterator[Line]:
    """A unit of time, from rest at frequency 0.35, and what a new frequency takes."""
    first = None
    for masses in (10, 100, 1000):
        chain = ImpactChain(masses=masses, frequency=0.35)
        chain.simulate(impacts=1)
        began = process_time()
        again = chain.replace(frequency=0.351)
        again.simulate(impacts=1)
        new = process_time() - began
        start = chain.state(np.zeros(masses), np.zeros(masses), phase=np.pi)
        start = chain.simulate(impacts=100, start=start).final
        count = max(100_000 // masses, 300)
        call = partial(chain.simulate, impacts=count, start=start)
        unit = in_turns(call, runs=3)[0] / float(call().time[-1])
        first = first or unit
        if masses > 10:
            yield Line(f"unit of time, {masses} masses, frequency 0.35", unit, "10 masses", first)
        if masses == 1000:
            yield Line("new frequency and its first impact, 1000 masses", new, "limit", 0.5, 1)


def elements() -> Iterator[Line]:
    """Further stops and sliders, beside the table alone."""
    for masses in (10, 2):
        last, forces = masses - 1, [0.0] * (masses - 1) + [0.5]
        beaten = partial(ImpactChain, masses=masses, frequency=0.9, harmonic_forces=forces)
        low = HardStop(last, offset=-0.3, restitution=0.7)
        across: Any = {"offset": 0.3, "side": "below"}
        alone, _ = repeated(beaten(elements=[low]), 10_000)
        for what, added in (
            ("a second hard stop", HardStop(last, restitution=0.7, **across)),
            ("a soft stop", SoftStop(last, stiffness=50.0, damping=0.2, **across)),
        ):
            each, _ = repeated(beaten(elements=[low, added]), 10_000)
            limit = 2.2 if "hard" in what else None
            yield Line(f"event, {masses} masses, with {what}", each, "one stop alone", alone, limit)
    sliders = [Jenkins(i, stiffness=1.0, force=0.05 + 0.01 * i) for i in range(10)]
    forces = [0.0] * 9 + [0.5]
    chain = ImpactChain(frequency=0.4, harmonic_forces=forces, elements=sliders)
    slip, _ = repeated(chain, 200, runs=3)
    yield Line("event, 10 masses and 10 sliders", slip, "limit, 50,000 a second", 2e-5, 1)


def impacts() -> Iterator[Line]:
    """All lines of this file."""
    yield from single_impacts()
    yield from around_the_kernel()
    yield from growth_with_size()
    yield from elements()
