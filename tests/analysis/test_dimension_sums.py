"""Correlation sums: exact counts of pairs, whatever the norm, the window and the coordinates."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from dynkit.analysis.dimension.counting import count
from dynkit.analysis.dimension.sums import Norm, correlation_sums
from dynkit.core.validation import Array
from dynkit.systems import Henon

TURN = 2.0 * np.pi
RADII = np.array([0.05, 0.1, 0.25, 0.5, 0.7, 1.0, 1.1, 2.0, 3.0])


def distances(states: Array, norm: Norm, angles: Mapping[int, float]) -> Array:
    """All distances, (n, n), coordinate by coordinate."""
    total = np.zeros((len(states), len(states)))
    for k, column in enumerate(states.T):
        turned = column % angles[k] if k in angles else column
        gap = abs(turned[:, None] - turned)
        if k in angles:
            gap = np.minimum(gap, angles[k] - gap)
        total = total + gap * gap if norm == "euclidean" else np.maximum(total, gap)
    return np.sqrt(total) if norm == "euclidean" else total


def naive_pairs(
    states: Array,
    radii: Array,
    norm: Norm = "maximum",
    theiler: int = 0,
    angles: Mapping[int, float] | None = None,
) -> list[int]:
    later, earlier = np.tril_indices(len(states), -theiler - 1)
    found = distances(states, norm, angles or {})[later, earlier]
    return [int((found <= r).sum()) for r in radii]


def scattered(n: int, d: int, kind: str) -> Array:
    states = np.random.default_rng(n + 31 * d).normal(size=(n, d))
    if kind == "lattice":  # many distances lie on radii
        return np.asarray(np.round(4.0 * states) / 4.0)
    if kind == "repeated":
        states[n // 2 :] = states[: n - n // 2]
    if kind == "flat":
        states[:, 0] = 1.0
    return states


# --- counts against the naive algorithm ---------------------------------------------------------


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
@pytest.mark.parametrize("theiler", [0, 1, 40])
@pytest.mark.parametrize("kind", ["plain", "lattice", "repeated", "flat"])
@pytest.mark.parametrize("d", [1, 2, 7, 20])
def test_counts_are_those_of_the_naive_algorithm(
    norm: Norm, theiler: int, kind: str, d: int
) -> None:
    states = scattered(700, d, kind)
    sums = correlation_sums(states, RADII, norm=norm, theiler=theiler)
    assert sums.pairs.tolist() == naive_pairs(states, RADII, norm, theiler)


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
@pytest.mark.parametrize("angles", [{0: TURN}, {3: 1.0}, {1: 0.5, 4: TURN}])
@pytest.mark.plain
def test_counts_with_angles_are_those_of_the_naive_algorithm(
    norm: Norm, angles: dict[int, float]
) -> None:
    states = 5.0 * scattered(500, 6, "plain")
    radii = np.linspace(0.02, 6.0, 60)
    sums = correlation_sums(states, radii, norm=norm, theiler=3, angles=angles)
    assert sums.pairs.tolist() == naive_pairs(states, radii, norm, 3, angles)


@pytest.mark.parametrize("n", [2, 3, 63, 64, 65, 129])
@pytest.mark.plain
def test_counts_of_few_states_are_those_of_the_naive_algorithm(n: int) -> None:
    states = scattered(n, 2, "plain")
    assert correlation_sums(states, RADII).pairs.tolist() == naive_pairs(states, RADII)


@settings(max_examples=60)
@given(
    states=st.lists(st.tuples(*[st.integers(-6, 6)] * 3), min_size=2, max_size=150),
    norm=st.sampled_from(["maximum", "euclidean"]),
    wrapped=st.booleans(),
)
def test_counts_on_lattices_are_those_of_the_naive_algorithm(
    states: list[tuple[int, int, int]], norm: Norm, wrapped: bool
) -> None:
    array = np.array(states, dtype=np.float64)
    radii = np.array([0.5, 1.0, np.sqrt(2.0), 2.0, 3.0, 5.0])
    angles = {1: 5.0} if wrapped else {}
    sums = correlation_sums(array, radii, norm=norm, angles=angles)
    assert sums.pairs.tolist() == naive_pairs(array, radii, norm, 0, angles)


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
def test_counts_at_radii_of_every_size_are_those_of_the_naive_algorithm(norm: Norm) -> None:
    factors = np.random.default_rng(2).uniform(0.2, 1.0, size=(400, 2))
    states = np.asarray(np.cumprod(factors, axis=0), dtype=np.float64)
    radii = 2.0 ** np.arange(-400.0, 2.0, 0.125)
    assert correlation_sums(states, radii, norm=norm).pairs.tolist() == naive_pairs(
        states, radii, norm
    )


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
@pytest.mark.plain
def test_distance_that_equals_a_radius_is_counted(norm: Norm) -> None:
    states = scattered(200, 3, "plain")
    radii = np.unique(distances(states, norm, {})[np.tril_indices(200, -1)])
    sums = correlation_sums(states, radii, norm=norm)
    assert sums.pairs.tolist() == naive_pairs(states, radii, norm)


@pytest.mark.plain
def test_angle_beyond_a_turn_counts_as_within_it() -> None:
    sums = correlation_sums(
        np.array([[0.1], [0.1 + 3.0 * TURN]]), np.array([1e-9, 1e-3]), angles={0: TURN}
    )
    assert sums.pairs[-1] == 1


@pytest.mark.plain
def test_last_coordinate_can_be_named_from_the_end() -> None:
    states = scattered(100, 3, "plain")
    named = [correlation_sums(states, RADII, angles={k: 1.0}).pairs.tolist() for k in (2, -1)]
    assert named[0] == named[1]


def test_total_is_the_number_of_pairs_outside_of_the_window() -> None:
    states = scattered(90, 2, "plain")
    sums = correlation_sums(states, np.array([1e3]), theiler=11)
    assert sums.total == sums.pairs[0] == len(np.tril_indices(90, -12)[0])


def test_values_are_the_part_of_all_pairs() -> None:
    sums = correlation_sums(np.array([[0.0], [1.0], [3.0]]), np.array([1.0, 3.0]))
    assert sums.values.tolist() == [1.0 / 3.0, 1.0]


# --- shares of blocks ---------------------------------------------------------------------------


@pytest.mark.parametrize("theiler", [0, 5])
@pytest.mark.plain
def test_shares_count_the_pairs_of_each_block(theiler: int) -> None:
    states = scattered(640, 2, "plain")
    shares = correlation_sums(states, RADII, theiler=theiler).shares
    near = distances(states, "maximum", {})[None] <= RADII[:, None, None]
    index = np.arange(640)
    near &= abs(index[:, None] - index) > theiler
    assert np.array_equal(shares, near.sum(axis=2).reshape(len(RADII), 64, 10).sum(axis=2).T)


def test_shares_of_whole_boxes_are_counted_too() -> None:
    # two far clusters: one bin holds all distances between them
    states = np.repeat([0.0, 1.0], 300)[:, None] + 1e-3 * scattered(600, 1, "plain")
    sums = correlation_sums(states, np.array([0.5, 2.0]))
    assert sums.cost.counts["distances"] == 0
    assert sums.shares[:, 0].sum() == 2 * sums.pairs[0] == 2 * 300 * 299


# --- threads ------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [2, 3, 7])
@pytest.mark.parametrize("euclidean", [False, True])
@pytest.mark.parametrize("kind", ["plain", "lattice", "repeated"])
def test_counts_do_not_depend_on_the_number_of_threads(
    threads: int, euclidean: bool, kind: str
) -> None:
    states = scattered(5000, 4, kind) % 3.0
    turns, edges = np.array([0.0, 3.0, 0.0, 0.0]), np.append(RADII, np.inf)
    alone, shared = (
        count(states, turns, edges, 20, euclidean=euclidean, threads=number)
        for number in (1, threads)
    )
    assert np.array_equal(alone.shares, shared.shares)
    assert (alone.box_pairs, alone.distances) == (shared.box_pairs, shared.distances)


# --- work ---------------------------------------------------------------------------------------


def test_distances_grow_slower_than_pairs() -> None:
    # on a ring, whose boxes shrink as points are added, more and more of them fit between two radii
    places = np.random.default_rng(0).uniform(size=(64_000, 1))
    radii = 0.05 * 2.0 ** np.arange(-20.0, 0.125, 0.125)
    sums = [correlation_sums(places[:n], radii, angles={0: 1.0}) for n in (4000, 16_000, 64_000)]
    parts = [each.cost.counts["distances"] / each.pairs[-1] for each in sums]
    assert parts[0] > parts[1] > parts[2]


def test_far_pairs_are_not_measured() -> None:
    states = np.random.default_rng(0).uniform(size=(4000, 2))
    sums = correlation_sums(states, np.array([1e-3]))
    assert sums.cost.counts["distances"] < sums.total / 20


def test_distances_are_counted_for_the_window() -> None:
    counts = [
        correlation_sums(scattered(100, 2, "plain"), RADII, theiler=w).cost.counts["distances"]
        for w in (0, 7)
    ]
    assert counts[1] - counts[0] == sum(100 - lag for lag in range(1, 8))


def test_states_of_a_map_are_counted_like_any_others() -> None:
    states = Henon().iterate(np.array([0.1, 0.1]), 500)
    assert correlation_sums(states, RADII).pairs.tolist() == naive_pairs(states, RADII)


# --- refusals -----------------------------------------------------------------------------------

STATES = [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"states": [[0.0]]}, r"states must hold two states .*; got shape \(1, 1\)"),
        ({"states": np.zeros((3, 0))}, r"states must hold two states .*; got shape \(3, 0\)"),
        (
            {"states": [0.0, 1.0]},
            r"states must have 2 dimensions; got shape \(2,\); .* states\[:, None\]",
        ),
        ({"states": [[0.0], [np.nan]]}, r"states\[1, 0\] must be a finite number; got nan"),
        ({"states": [[0.0], [1e200]]}, r"states must not exceed 1e\+150 in size; got 1e\+200"),
        (
            {"states": [[0.0], [1e-200]]},
            "states must be zero, or some of them at least 1e-130 in size; got 1e-200",
        ),
        ({"radii": []}, "radii must hold at least one; got none"),
        ({"radii": [1.0, 1.0]}, r"radii\[1\] must exceed radii\[0\]; got 1.0"),
        ({"radii": [0.0, 1.0]}, r"radii\[0\] must lie in \[1e-150, 1e\+150\]; got 0.0"),
        ({"norm": "taxi"}, "norm must be one of: maximum, euclidean; got 'taxi'"),
        ({"theiler": 2}, "theiler must not exceed 1 for 3 states; got 2"),
        ({"theiler": -1}, "theiler must be zero or a positive integer; got -1"),
        ({"angles": {2: 1.0}}, r"angles must name coordinates in \[-2, 1\]; got 2"),
        ({"angles": {"x": 1.0}}, "angles must name coordinates by number; got 'x'"),
        ({"angles": {0: 0.0}}, r"angles\[0\] must be positive; got 0.0"),
    ],
)
def test_argument_is_refused(given: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"states": STATES, "radii": [1.0], **given}
    with pytest.raises(ValueError, match=f"^{message}$"):
        correlation_sums(arguments.pop("states"), arguments.pop("radii"), **arguments)
