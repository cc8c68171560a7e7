"""Correlation sums: numbers of pairs of states within each radius."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias, final, get_args

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
    of_type,
    one_of,
    positive,
    read_only,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved

Norm: TypeAlias = Literal["maximum", "euclidean"]
"""Norm of the distance of two states."""

_SMALLEST, _LARGEST = 1e-150, 1e150  # numbers whose squares neither underflow nor overflow
_LEAST = 1e-130  # least size of the largest state: enough radii lie between it and _SMALLEST


@final
@dataclass(frozen=True, eq=False, repr=False)
class CorrelationSums(Saved):
    """Numbers of pairs of states within each radius.

    The counts are exact: they equal those of a comparison of each pair in double precision.

    Parameters
    ----------
    radii : (k,) array
        Ascending.
    pairs : (k,) array of int
        Number of pairs within each radius.
    total : int
        Number of all pairs.
    shares : (b, k) array of int
        For each block of time the number of pairs with a state in it, where pairs with both states
        in it count twice: the sum over all blocks is twice `pairs`. The blocks are successive.
    cost : Cost
        Seconds, computed distances, and examined pairs of boxes.
    """

    _stored: ClassVar = ("radii", "pairs", "total", "shares", "cost")
    radii: Array
    pairs: Counts
    total: int
    shares: Counts
    cost: Cost

    def dataset(self) -> Dataset:
        """Return the sums, their errors and the counts as a dataset over ``radius``."""
        return Dataset(
            {"radius": ("radius", self.radii)},
            {
                "correlation_sum": ("radius", self.values),
                "error": ("radius", self.error),
                "pairs": ("radius", self.pairs),
                "shares": (("block", "radius"), self.shares),
            },
            described(
                "Correlation sums",
                cost=self.cost,
                error="one standard error, relative, which covers about 68 %",
                total=float(self.total),
            ),
        )

    def __repr__(self) -> str:
        return (
            f"<CorrelationSums: {self.total} pairs at {len(self.radii)} radii {span(self.radii)}>"
        )

    @property
    def values(self) -> Array:
        """The correlation sum C(r), (k,): the fraction of all pairs."""
        return np.asarray(self.pairs / self.total)

    @property
    def error(self) -> Array:
        """One standard error of C(r), (k,), relative, from bootstrap over blocks of time.

        It covers about 68 %, and is not a bound; see `dynkit.analysis.dimension.errors`. Infinite
        where there are no pairs within the radius, or too few blocks.
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
    """Count the pairs of states within each radius.

    The method descends a tree of boxes in pairs of nodes; the pairs of points of two boxes are
    counted at once when all their distances lie between two successive radii. It uses all
    processors.

    Parameters
    ----------
    states : (n, d) array_like
        States in the order of time; n >= 2.
    radii : (k,) array_like
        Ascending, positive.
    norm : {"maximum", "euclidean"}
    theiler : int
        Theiler's window: states i and j count as a pair when abs(i - j) > theiler.
    angles : mapping of int to float, optional
        For each coordinate that is an angle, one turn of it. The distance of two angles is taken
        the shortest way around.

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
    """Return states, (n, d), after checks; n >= 2.

    Raises
    ------
    ValueError
        When there are fewer than two, or a number is not finite or too large.
    """
    array = finite_array("states", states, (None, None))
    if len(array) < 2 or array.shape[1] < 1:
        raise ValueError(
            f"states must hold two states of one coordinate or more; got shape {array.shape}"
        )
    if (largest := float(abs(array).max())) > _LARGEST:
        raise ValueError(f"states must not exceed {_LARGEST:g} in size; got {largest:g}")
    if 0.0 < largest < _LEAST:
        raise ValueError(
            f"states must be zero, or some of them at least {_LEAST:g} in size; got {largest:g}"
        )
    return array


def checked_theiler(theiler: object, n: int) -> int:
    """Return Theiler's window after a check that it leaves pairs of n states.

    Raises
    ------
    ValueError
        When the window is negative, not an integer, or too large.
    """
    window = non_negative_integer("theiler", theiler)
    if window > n - 2:
        raise ValueError(f"theiler must not exceed {n - 2} for {n} states; got {window}")
    return window


def checked_angles(angles: Mapping[int, float], d: int) -> Mapping[int, float]:
    """Return the angles among d coordinates: indices from 0 on, and their turns.

    Raises
    ------
    ValueError
        When there is no such coordinate, or a turn is not positive.
    """
    of_type("angles", angles, Mapping, "turns of coordinates by number, as {0: 2 * pi}")
    checked = {}
    for index, turn in angles.items():
        if isinstance(index, bool) or not isinstance(index, int | np.integer):
            raise ValueError(f"angles must name coordinates by number; got {index!r}")
        if not -d <= index < d:
            raise ValueError(f"angles must name coordinates in [{-d}, {d - 1}]; got {int(index)}")
        checked[int(index) % d] = positive(f"angles[{int(index)}]", turn)
    return checked


def wrapped(states: Array, angles: Mapping[int, float]) -> tuple[Array, Array]:
    """Return states with angles in [0, turn], and the turns, (d,), zero for other coordinates."""
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
    """Return the largest numbers whose computed square roots do not exceed the radii."""
    squares = radii * radii
    while (large := np.sqrt(squares) > radii).any():
        squares = np.where(large, np.nextafter(squares, 0.0), squares)
    while (small := np.sqrt(np.nextafter(squares, np.inf)) <= radii).any():
        squares = np.where(small, np.nextafter(squares, np.inf), squares)
    return np.asarray(squares)
