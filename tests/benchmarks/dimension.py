"""Correlation sums, beside SciPy's tree and nolds, and of large sets."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.sums import CorrelationSums, Norm, correlation_sums
from dynkit.systems import Henon, ImpactChain, Lorenz
from tests.benchmarks.report import Line, in_turns

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


def radii_of(states: Array, angles: dict[int, float], norm: Norm) -> Array:
    """8 to the octave, 30 octaves down from a tenth of the diameter."""
    top = 0.1 * CorrelationDimension(states, angles=angles, norm=norm).diameter
    return np.asarray(top * 2.0 ** np.arange(-30.0, 0.125, 0.125))


def beside_the_tree_of_scipy(
    name: str, states: Array, angles: dict[int, float], norm: Norm
) -> Line:
    """The same counts by a tree of SciPy."""
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

    mine, other = in_turns(count, count_by_peer, runs=2)
    # a distance that rounds to a radius may fall on either side of it
    assert abs((theirs[0] - PEER) // 2 - ours[0].pairs).max() <= 1
    what = f"correlation sums, {PEER:,} states, {norm} norm, {name}"
    return Line(what, mine, "cKDTree of SciPy", other)


def large_sets() -> dict[str, Array]:
    """A million states in three dimensions, and 1e5 in twenty without any structure."""
    flow = Lorenz()
    states = np.empty((LARGE, 3))
    states[0] = flow.advance(np.array([1.0, 2.0, 20.0]), 20.0)
    for i in range(1, LARGE):
        states[i] = flow.advance(states[i - 1], 0.05)
    scattered = np.random.default_rng(0).normal(size=(STATES, 20))
    return {"Lorenz, 3 coordinates": states, "normal numbers, 20 coordinates": scattered}


def beside_nolds(states: Array, radii: Array) -> Iterator[Line]:
    """The sums of one coordinate embedded in three; nolds has no tree."""
    try:
        nolds: Any = importlib.import_module("nolds")
    except ModuleNotFoundError:
        return
    column = states[:3000, 0]
    embedded = np.column_stack([column[i : i - 3 or None] for i in range(3)])
    ours, theirs = in_turns(
        lambda: correlation_sums(embedded, radii),
        lambda: nolds.corr_dim(column, 3, rvals=radii.tolist()),
        runs=1,
    )
    yield Line("correlation sums, 3000 states, 3 coordinates", ours, "nolds", theirs)


def dimensions() -> Iterator[Line]:
    """The lines of this file."""
    for name, (states, angles) in sets().items():
        for norm in get_args(Norm):
            correlation_sums(states[:100], np.array([1.0]), norm=norm)  # compiles
            yield beside_the_tree_of_scipy(name, states, angles, norm)
        dimension = CorrelationDimension(states, angles=angles)
        (whole,) = in_turns(lambda: dimension.value, runs=1)  # noqa: B023
        (sums,) = in_turns(
            lambda: correlation_sums(states, radii_of(states, angles, "maximum"), angles=angles),  # noqa: B023
            runs=1,
        )
        yield Line(f"correlation dimension, {STATES:,} states, {name}", whole, "its sums", sums)
    for name, states in large_sets().items():
        radii = radii_of(states[:PEER], {}, "maximum")
        (seconds,) = in_turns(lambda: correlation_sums(states, radii), runs=1)  # noqa: B023
        limit = 60.0 if len(states) == LARGE else 10.0
        what = f"correlation sums, {len(states):,} states, {name}"
        yield Line(what, seconds, f"limit, {limit:.0f} s of two processors", 2.0 * limit, 1)
        if len(states) == LARGE:
            yield from beside_nolds(states, radii)
