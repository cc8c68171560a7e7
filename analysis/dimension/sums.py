"""Correlation sums: how many pairs of states are near to one another, at every radius."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, final, get_args

import numpy as np

from dynkit.analysis.dimension.counting import Counts, count
from dynkit.analysis.dimension.errors import standard_errors
from dynkit.core.cost import Cost
from dynkit.core.reprs import span
from dynkit.core.validation import (
    Array,
    ascending,
    finite_array,
    non_negative_integer,
    one_of,
    positive,
    read_only,
)

Norm: TypeAlias = Literal["maximum", "euclidean"]
"""How the distance of two states is measured."""

_SMALLEST, _LARGEST = 1e-150, 1e150  # what has a square


@final
@dataclass(frozen=True, eq=False)
class CorrelationSums:
    """Pairs of states that are at most a radius apart, at every radius.

    The counts are exact: they are those that comparing each pair would give, in double precision.

    Parameters
    ----------
    radii : (k,) array
        Ascending.
    pairs : (k,) array of int
        How many pairs are at most so far apart.
    total : int
        How many pairs there are.
    shares : (b, k) array of int
        For each block of time the pairs with a state in it, those with both states in it twice: so
        the sum over all blocks is twice `pairs`. The blocks follow one another.
    cost : Cost
        Distances that were measured one by one, and pairs of boxes that were looked at.
    """

    radii: Array
    pairs: Counts
    total: int
    shares: Counts
    cost: Cost

    def __repr__(self) -> str:
        return (
            f"<CorrelationSums: {self.total} pairs at {len(self.radii)} radii {span(self.radii)}>"
        )

    @property
    def values(self) -> Array:
        """The correlation sum C(r), (k,): the part of all pairs."""
        return np.asarray(self.pairs / self.total)

    @property
    def error(self) -> Array:
        """One standard error of C(r), (k,), relative, from bootstrap over blocks of time.

        It covers about 68 %, and is no bound.
        See `dynkit.analysis.dimension.errors`. Infinite where no pair is so near, and where there
        are too few blocks to tell.
        """
        errors = np.full(len(self.radii), np.inf)
        there = self.pairs > 0
        errors[there] = standard_errors(
            self.pairs[there], self.shares[:, there], np.eye(int(there.sum()))
        )
        return np.where(np.isnan(errors), np.inf, errors)


def correlation_sums(
    states: Array,
    radii: Array,
    *,
    norm: Norm = "maximum",
    theiler: int = 0,
    angles: Mapping[int, float] | None = None,
) -> CorrelationSums:
    """Count the pairs of states that are at most a radius apart, at every radius at once.

    Two trees of boxes are descended together; the pairs of two boxes are counted at once when all
    their distances lie between two successive radii. The work is done on all processors.

    Parameters
    ----------
    states : (n, d) array_like
        One after the other in time; n >= 2.
    radii : (k,) array_like
        Ascending, positive.
    norm : {"maximum", "euclidean"}
    theiler : int
        Theiler's window: states i and j count as a pair when abs(i - j) > theiler.
    angles : mapping of int to float, optional
        For each coordinate that is an angle one turn of it. The distance of two angles is the
        shortest way.

    Returns
    -------
    CorrelationSums

    Raises
    ------
    ValueError
        When an argument is refused.

    References
    ----------
    P. Grassberger, I. Procaccia, Physica D 9 (1983) 189-208, equation 1.9. J. Theiler, Phys. Rev. A
    34 (1986) 2427-2432: the window. A. G. Gray, A. W. Moore, NIPS 13 (2000) 521-527: two trees.

    Examples
    --------
    >>> sums = correlation_sums([[0.0], [1.0], [3.0]], [0.5, 1.0, 2.0])
    >>> sums.pairs.tolist(), sums.total
    ([0, 1, 2], 3)
    >>> correlation_sums([[0.1], [6.2]], [0.5], angles={0: 6.283185307179586}).pairs.tolist()
    [1]
    """
    began = time.perf_counter()
    array = checked_states(states)
    ladder = _checked_radii(radii)
    one_of("norm", norm, get_args(Norm))
    window = checked_theiler(theiler, len(array))
    points, turns = wrapped(array, checked_angles(angles or {}, array.shape[1]))
    edges = np.append(_squares(ladder) if norm == "euclidean" else ladder, np.inf)
    counted = count(points, turns, edges, window, euclidean=norm == "euclidean")
    shares = read_only(np.cumsum(counted.shares[:, :-1], axis=1))
    pairs = read_only(shares.sum(axis=0) // 2)
    others = len(array) - window
    work = {"distances": counted.distances, "box pairs": counted.box_pairs}
    cost = Cost(time.perf_counter() - began, work)
    return CorrelationSums(ladder, pairs, others * (others - 1) // 2, shares, cost)


def checked_states(states: object) -> Array:
    """Return states, (n, d), of which there are two or more.

    Raises
    ------
    ValueError
        When they are refused.
    """
    array = finite_array("states", states, (None, None))
    if len(array) < 2 or array.shape[1] < 1:
        raise ValueError(
            f"states must hold two states of one coordinate or more; got shape {array.shape}"
        )
    if (largest := float(abs(array).max())) > _LARGEST:
        raise ValueError(f"states must not exceed {_LARGEST:g} in size; got {largest:g}")
    return array


def checked_theiler(theiler: object, n: int) -> int:
    """Return a window that leaves pairs of n states.

    Raises
    ------
    ValueError
        When it does not.
    """
    window = non_negative_integer("theiler", theiler)
    if window > n - 2:
        raise ValueError(f"theiler must not exceed {n - 2} for {n} states; got {window}")
    return window


def checked_angles(angles: Mapping[int, float], d: int) -> Mapping[int, float]:
    """Return the angles among d coordinates: numbers from 0 on, and their turns.

    Raises
    ------
    ValueError
        When there is no such coordinate, or a turn is not positive.
    """
    checked = {}
    for index, turn in angles.items():
        if isinstance(index, bool) or not isinstance(index, int | np.integer):
            raise ValueError(f"angles must name coordinates by number; got {index!r}")
        if not -d <= index < d:
            raise ValueError(f"angles must name coordinates in [{-d}, {d - 1}]; got {int(index)}")
        checked[int(index) % d] = positive(f"angles[{int(index)}]", turn)
    return checked


def wrapped(states: Array, angles: Mapping[int, float]) -> tuple[Array, Array]:
    """Return states with angles in [0, turn], and the turns, (d,): zero where there is no angle."""
    points, turns = states.copy(), np.zeros(states.shape[1])
    for index, turn in angles.items():
        points[:, index] %= turn
        turns[index] = turn
    return points, turns


def _checked_radii(radii: object) -> Array:
    ladder = finite_array("radii", radii, (None,))
    if not len(ladder):
        raise ValueError("radii must hold at least one; got none")
    for i in np.flatnonzero((ladder < _SMALLEST) | (ladder > _LARGEST))[:1].tolist():
        raise ValueError(
            f"radii[{i}] must lie in [{_SMALLEST:g}, {_LARGEST:g}]; got {float(ladder[i])!r}"
        )
    return read_only(ascending("radii", ladder))


def _squares(radii: Array) -> Array:
    """The largest numbers whose square roots, as computed, do not exceed the radii."""
    squares = radii * radii
    while (large := np.sqrt(squares) > radii).any():
        squares = np.where(large, np.nextafter(squares, 0.0), squares)
    while (small := np.sqrt(np.nextafter(squares, np.inf)) <= radii).any():
        squares = np.where(small, np.nextafter(squares, np.inf), squares)
    return np.asarray(squares)
