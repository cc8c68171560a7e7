"""What correlation sums cost: beside SciPy's tree, and as the number of states grows.

Seconds are those of all processors together, but where they are said to pass.
"""

from __future__ import annotations

import importlib
import tracemalloc
from collections.abc import Callable
from functools import partial
from time import perf_counter, process_time
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.sums import CorrelationSums, Norm, correlation_sums
from dynkit.systems import Henon, ImpactChain
from tests.benchmarks.report import table
from tests.flows.symbolic_flows import SymbolicLorenz

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
STATES, LARGE = 100_000, 1_000_000
PEER = 10_000
"""States for the comparison: the peer takes a minute for 1e5."""


def sets() -> dict[str, tuple[Array, dict[int, float]]]:
    """States and angles by name."""
    chains = {
        "impacts, frequency 1.346": ImpactChain(frequency=1.346),
        "impacts, frequency 0.36, damping 0.001": ImpactChain(frequency=0.36, damping=0.001),
    }
    found: dict[str, tuple[Array, dict[int, float]]] = {
        name: (chain.attractor(transient=5000, impacts=STATES).states, {19: TURN})
        for name, chain in chains.items()
    }
    return {"Henon": (Henon().iterate(np.array([0.1, 0.1]), STATES - 1), {}), **found}


def seconds_of(call: Callable[[], object]) -> float:
    began = process_time()
    call()
    return process_time() - began


def radii_of(states: Array, angles: dict[int, float], norm: Norm) -> Array:
    """8 to the octave, 30 octaves down from a tenth of the diameter."""
    top = 0.1 * CorrelationDimension(states, angles=angles, norm=norm).diameter
    return np.asarray(top * 2.0 ** np.arange(-30.0, 0.125, 0.125))


def beside_the_tree_of_scipy(states: Array, angles: dict[int, float], norm: Norm) -> float:
    """The peer's time over ours, for the same counts."""
    few = states[:PEER].copy()
    boxes = np.zeros(few.shape[1])
    for index, turn in angles.items():
        few[:, index] %= turn
        boxes[index] = turn
    few[:, boxes == 0.0] -= few[:, boxes == 0.0].min(axis=0)  # coordinates with boxes start at zero
    radii = radii_of(few, angles, norm)
    ours: list[CorrelationSums] = []
    theirs: list[Array] = []

    def count() -> None:
        ours.append(correlation_sums(few, radii, norm=norm, angles=angles))

    def count_by_peer() -> None:
        tree = cKDTree(few, boxsize=boxes if angles else None)
        found = tree.count_neighbors(tree, radii, p=np.inf if norm == "maximum" else 2.0)
        theirs.append(np.asarray(found, dtype=np.float64))

    ratio = min(seconds_of(count_by_peer) for _ in range(2)) / min(
        seconds_of(count) for _ in range(3)
    )
    # a distance that rounds to a radius may fall on either side of it
    assert abs((theirs[0] - PEER) // 2 - ours[0].pairs).max() <= 1
    return ratio


def large_sets() -> dict[str, Array]:
    """A million states in three dimensions, and 1e5 in twenty without any structure."""
    flow = SymbolicLorenz()
    states = np.empty((LARGE, 3))
    states[0] = flow.advance(np.array([1.0, 2.0, 20.0]), 20.0)
    for i in range(1, LARGE):
        states[i] = flow.advance(states[i - 1], 0.05)
    scattered = np.random.default_rng(0).normal(size=(STATES, 20))
    return {"Lorenz, 3 coordinates": states, "normal numbers, 20 coordinates": scattered}


def nolds_seconds(states: Array, radii: Array) -> str:
    """Seconds of nolds for the sums of 3000 states at as many radii; it has no tree."""
    try:
        nolds: Any = importlib.import_module("nolds")
    except ModuleNotFoundError:
        return "not installed"
    column = states[:3000, 0]
    return f"{seconds_of(partial(nolds.corr_dim, column, 3, rvals=radii.tolist())):.1f}"


def large() -> None:
    """Print what sums of large sets cost, and cKDTree for the same counts of fewer states."""
    rows = []
    for name, states in large_sets().items():
        for norm in get_args(Norm):
            radii = radii_of(states[:PEER], {}, norm)
            correlation_sums(states[:100], radii, norm=norm)
            began, passed = process_time(), perf_counter()
            sums = correlation_sums(states, radii, norm=norm)
            cost, passed = process_time() - began, perf_counter() - passed
            ratio = beside_the_tree_of_scipy(states, {}, norm)
            pairs = f"{sums.pairs[-1]:.2e}"
            row = (name, norm, len(states), pairs, f"{cost:.1f}", f"{passed:.1f}", f"{ratio:.0f}")
            rows.append((*row, nolds_seconds(states, radii)))
    head = ("set", "norm", "states", "pairs within", "s", "passed (s)",
            f"cKDTree / sums, {PEER:,} states", "nolds, 3,000 states (s)")  # fmt: skip
    table("Correlation sums of large sets, radii up to a tenth of the diameter", head, rows)


def dimensions() -> None:
    rows = []
    growth = []
    for name, (states, angles) in sets().items():
        norms: tuple[Norm, ...] = ("maximum", "euclidean")
        for norm in norms:
            correlation_sums(states[:100], np.array([1.0]), norm=norm)  # compiles
            radii = radii_of(states, angles, norm)
            ratio = beside_the_tree_of_scipy(states, angles, norm)
            costs = []
            for n in (STATES // 16, STATES // 4, STATES):
                began, passed = process_time(), perf_counter()
                sums = correlation_sums(states[:n], radii, norm=norm, angles=angles)
                costs.append(process_time() - began)
                passed = perf_counter() - passed
                growth.append(
                    (name, norm, n, f"{costs[-1]:.2f}", f"{sums.cost.counts['distances']:.2e}")
                )
            tracemalloc.start()
            dimension = CorrelationDimension(states, norm=norm, angles=angles)
            whole = seconds_of(partial(getattr, dimension, "value"))
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            found = "none"
            if dimension.region is not None:
                found = f"{dimension.value:.2f} +- {dimension.error:.2f}"
                found += f", {dimension.region.ratio:.3g}:1"
            rows.append(
                (
                    name,
                    norm,
                    states.shape[1],
                    f"{costs[-1]:.1f}",
                    f"{passed:.1f}",
                    f"{whole:.1f}",
                    f"{peak / 1e6:.0f}",
                    f"{ratio:.0f}",
                    found,
                )
            )
    head = ("set", "norm", "coordinates", "sums (s)", "sums, passed (s)", "dimension (s)", "MB",
            f"cKDTree / sums, {PEER:,} states", "dimension")  # fmt: skip
    table(f"Correlation sums of {STATES:,} states, radii up to a tenth of the diameter", head, rows)
    table("Growth of correlation sums", ("set", "norm", "states", "s", "distances"), growth)
    large()
