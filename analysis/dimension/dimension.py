"""The correlation dimension of an attractor."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf, nan
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, final, get_args

import numpy as np

from dynkit.analysis.dimension.coordinates import angles_of, correlation_time, extents_of
from dynkit.analysis.dimension.counting import BLOCKS
from dynkit.analysis.dimension.drawing import draw_slopes, draw_sums
from dynkit.analysis.dimension.errors import error_by_lags
from dynkit.analysis.dimension.scaling import (
    STEPS,
    Estimate,
    LocalSlopes,
    Outcome,
    Scaling,
    ScalingRegion,
    find_scaling,
    local_slopes,
    takens,
)
from dynkit.analysis.dimension.sums import (
    CorrelationSums,
    Norm,
    checked_angles,
    checked_states,
    checked_theiler,
    correlation_sums,
    wrapped,
)
from dynkit.analysis.motions import source_of
from dynkit.analysis.regimes import RegimeChange, regime_change
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    finite_scalar,
    non_negative_integer,
    one_of,
    positive,
    read_only,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.dynamics.attractor import Attractor

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Largest radii that are tried, relative to the diameter. With 0.3, a range of some sets of many
# dimensions, whose sums bend everywhere, would look straight.
_PARTS = 0.1, 0.2
_ROUNDING = 2.0**-42  # smallest distance above rounding, relative to the largest coordinate
_LEAST_SPAN = 128.0  # least ratio of the largest radius to the rounding of the states


def search_scaling(
    sums_at: Callable[[Array], CorrelationSums],
    states: Array,
    diameter: float,
    largest: float | None,
    least_ratio: float,
) -> tuple[CorrelationSums, Scaling, Cost]:
    """Return the sums of states (n, d), their scaling, and the cost of all trials.

    The sums are those up to the first of several largest radii below which a range scales, or up to
    the first one when no range scales.

    Parameters
    ----------
    sums_at : callable
        Function that returns the correlation sums at radii, (k,).
    states : (n, d) array
    diameter : float
        Largest distance of two states.
    largest : float, optional
        Largest radius, at most the diameter; by default fractions of it are tried.
    least_ratio : float
        As for `find_scaling`.

    Raises
    ------
    ValueError
        When the largest radius is near the rounding of the states.
    """
    tried: list[tuple[CorrelationSums, Scaling]] = []
    cost = Cost(0.0)
    for radii in _ladders(states, diameter, largest):
        sums = sums_at(radii)
        began = time.perf_counter()
        tried.append((sums, find_scaling(sums, states, least_ratio)))
        cost = cost + sums.cost + Cost(time.perf_counter() - began)
        if tried[-1][1].region is not None:
            return *tried[-1], cost
    return *tried[0], cost


def _ladders(states: Array, diameter: float, largest: float | None) -> Iterator[Array]:
    """Yield radii down to the rounding of the states, for each largest radius to try."""
    finest = max(_ROUNDING * float(abs(states).max()), 1e-140)
    least = _LEAST_SPAN * finest
    if largest is not None and largest < least:
        raise ValueError(
            f"largest must not be less than {least:.3g}, near the rounding of the states; "
            f"got {largest!r}"
        )
    # beyond the diameter any set looks like one point
    asked = [part * diameter for part in _PARTS] if largest is None else [min(largest, diameter)]
    tops = [max(float(top), least) for top in asked]
    for top in dict.fromkeys(tops):
        count = ceil(STEPS * np.log2(top / finest))
        yield top * 2.0 ** (np.arange(-count, 1) / STEPS)


_WINDOW = 100  # default of Theiler's window; excludes chatter, which autocorrelations do not show


@final
@dataclass(frozen=True, eq=False, repr=False)
class CorrelationDimension(Saved):
    """The correlation dimension of a set of states, after Grassberger and Procaccia.

    C(r) is the fraction of all pairs of states whose distance is at most r; where it is a power of
    r, the exponent is the dimension. Results are computed when they are first read, and once.

    The result is the dimension of the set as far as the states resolve it. A periodic orbit meets a
    section in finitely many points, whose dimension is 0. (The orbit itself has dimension 1.)
    Where no range of radii scales, `outcome` says so and `value` is NaN.

    Local slopes may drift over all radii, for example where the density has square-root
    singularities (the logistic map at 4, most maps with a smooth hump). Then `outcome` and the repr
    say that there is no plateau. `value` is the slope of the straightest range, and `error` covers
    the limit of small radii as far as the drift shows it. A weak drift also increases `error`. So
    does a possible drift, if slopes over few octaves cannot exclude it. Data rounded to a grid are
    searched only above 8 steps of the grid.

    In quasi-periodic motion all pairs of states of one lag have similar distances, and `error` is
    that of independent lags: more than the actual one. Surfaces of two dimensions need 10,000
    states or more. The label of the attractor tells whether its states are on curves.

    A coordinate whose extent is below the radii of the scaling region does not count, and `error`
    does not cover it. If some extents are far smaller than others, such as positions of 1e-9 beside
    a phase, give an array in units in which all extents are similar.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (n, d) array_like
        States in the order of time, 64 or more, in their given units. A record is converted to its
        attractor.
    norm : {"maximum", "euclidean"}
    theiler : int, optional
        Theiler's window: states i and j count as a pair when abs(i - j) > theiler. By default 100,
        or three times the lag at which the autocorrelation falls below 1/e where that is more; at
        most a twentieth of the states.
    angles : mapping of int to float, optional
        For an array: each coordinate that is an angle, and one turn of it. For an attractor the
        system determines them.
    largest : float, optional
        Largest radius, at most the diameter of the states or, in the Euclidean norm, the diagonal
        of the bounding box; by default a tenth of it. Few states in many dimensions have too few
        pairs there: where no range scales, a fifth is tried.
    least_ratio : float
        Least ratio of the largest to the smallest radius of a scaling region: any smooth curve is
        straight over a short range.

    Raises
    ------
    ValueError
        When an argument is refused.

    References
    ----------
    P. Grassberger, I. Procaccia, Physica D 9 (1983) 189-208. J. Theiler, Phys. Rev. A 34 (1986)
    2427-2432. F. Takens, in Lecture Notes in Mathematics 1125 (1985) 99-106.

    Examples
    --------
    >>> turn = np.random.default_rng(0).uniform(size=2000)
    >>> ring = CorrelationDimension(turn[:, None], angles={0: 1.0})
    >>> ring.outcome.value
    'there is a scaling region'
    >>> abs(ring.value - 1.0) < 2.0 * ring.error
    True
    >>> ring.bounds
    (1, 3)
    >>> points = CorrelationDimension(np.tile([[0.0], [1.0], [3.0]], (100, 1)))
    >>> points.value, points.outcome.name
    (0.0, 'FINITE')
    """

    _stored: ClassVar = (
        *("norm", "least_ratio", "states", "turns", "window", "diameter", "_found", "change"),
        *("_by_lags", "_apart", "takens"),
    )
    source: Attractor | Array
    norm: Norm = "maximum"
    theiler: int | None = None
    angles: Mapping[int, float] | None = None
    largest: float | None = None
    least_ratio: float = 4.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", source_of(self.source))
        if self.theiler is not None:
            non_negative_integer("theiler", self.theiler)
        if isinstance(self.source, Attractor):
            if self.angles is not None:
                raise ValueError(
                    f"angles must be left to the system of an attractor; got {self.angles!r}"
                )
        else:
            states = read_only(checked_states(self.source).copy())
            _refuse_few(states)
            object.__setattr__(self, "source", states)
            angles = checked_angles(self.angles or {}, states.shape[1])
            object.__setattr__(self, "angles", MappingProxyType(dict(angles)))
            if self.theiler is not None:
                checked_theiler(self.theiler, len(states))
        one_of("norm", self.norm, get_args(Norm))
        if self.largest is not None:
            positive("largest", self.largest)
        object.__setattr__(self, "least_ratio", _checked_ratio(self.least_ratio))

    @cached_property
    def states(self) -> Array:
        """The states, (n, d)."""
        if isinstance(self.source, Attractor):
            states = checked_states(self.source.states)
            _refuse_few(states)
            return states
        assert isinstance(self.source, np.ndarray)
        return self.source

    @cached_property
    def turns(self) -> Mapping[int, float]:
        """Each coordinate that is an angle, and one turn of it."""
        if isinstance(self.source, Attractor):
            return MappingProxyType(dict(angles_of(self.source.system, self.states)))
        assert self.angles is not None
        return self.angles

    @cached_property
    def window(self) -> int:
        """Theiler's window, in states."""
        if self.theiler is not None:
            return checked_theiler(self.theiler, len(self.states))
        wanted = max(3 * correlation_time(self.states, self.turns), _WINDOW)
        return min(wanted, len(self.states) // 20)

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two states; in the Euclidean norm the bounding box's diagonal."""
        extents = extents_of(self.states, self.turns)
        return float(extents.max() if self.norm == "maximum" else np.linalg.norm(extents))

    @property
    def sums(self) -> CorrelationSums:
        """The correlation sums: at 8 radii to the octave, down to the rounding of the states."""
        return self._found[0]

    @cached_property
    def _found(self) -> tuple[CorrelationSums, Scaling, Cost]:
        """Sums up to a largest radius, their scaling, and the cost of all trials."""
        sums_at = partial(
            correlation_sums, self.states, norm=self.norm, theiler=self.window, angles=self.turns
        )
        return search_scaling(sums_at, self.states, self.diameter, self.largest, self.least_ratio)

    @cached_property
    def local_slopes(self) -> LocalSlopes:
        """The local slopes d ln C / d ln r."""
        return local_slopes(self.sums)

    @property
    def outcome(self) -> Outcome:
        """Whether there is a scaling region; the value of the member says it in words."""
        return self._found[1].outcome

    @property
    def region(self) -> ScalingRegion | None:
        """The scaling region, chosen by `dynkit.analysis.dimension.scaling.find_scaling`.

        For a finite set it is the range of radii over which the sum is constant. None where there
        is none.
        """
        return self._found[1].region

    def region_over(self, least_ratio: float) -> ScalingRegion | None:
        """Return the scaling region for another least ratio, from the same sums.

        It allows comparison with published regions that are shorter than `least_ratio`.

        Parameters
        ----------
        least_ratio : float
            Least ratio of the largest to the smallest radius, at least 1.5.

        Returns
        -------
        ScalingRegion or None
            The region chosen as for `region`; None when no range scales.

        Examples
        --------
        >>> turn = np.random.default_rng(0).uniform(size=2000)
        >>> ring = CorrelationDimension(turn[:, None], angles={0: 1.0})
        >>> ring.region_over(1e6) is None, ring.region_over(2.0) is None
        (True, False)
        """
        return find_scaling(self.sums, self.states, _checked_ratio(least_ratio)).region

    @property
    def value(self) -> float:
        """The correlation dimension; NaN when there is no scaling region.

        When the outcome is a drift it is the slope of the straightest range of radii.
        """
        return nan if self.region is None else self.region.slope

    @property
    def error(self) -> float:
        """One standard error of the dimension; infinite when there is no scaling region.

        One standard error covers about 68 %, and two about 95 %; it is not a bound. It has two
        parts. One is the statistical error of the slope, from a bootstrap over blocks of time; this
        accounts for the pairs shared by neighbouring radii and successive states. The other is the
        additional scatter of the slopes of the region's quarters. The error is at least that of
        independent lags in time: see `dynkit.analysis.dimension.errors.error_by_lags`. Where the
        local slopes drift with the radius, or the curve is a staircase, as for sets with wide gaps,
        it includes the distance to the limit of small radii: see
        `dynkit.analysis.dimension.scaling.ScalingRegion`. Where the motion changes its regime it
        also covers the dimension of the last regime.
        """
        if self.region is None:
            return inf
        return max(self.region.error, self._by_lags) + self._apart

    @cached_property
    def _by_lags(self) -> float:
        """One standard error of the dimension, where lags in time are independent."""
        if self.region is None or self.outcome is Outcome.FINITE:
            return 0.0
        sums = self.sums
        inside = (sums.radii >= self.region.low) & (sums.radii <= self.region.high)
        radii, pairs = sums.radii[inside], sums.pairs[inside]
        logs = np.log(radii) - np.log(radii).mean()
        lags = np.arange(self.window + 1, len(self.states))
        states = wrapped(self.states, self.turns)
        euclidean = self.norm == "euclidean"
        return error_by_lags(pairs, logs / (logs @ logs), radii, *states, lags, euclidean=euclidean)

    @cached_property
    def change(self) -> RegimeChange | None:
        """The change of regime of the attractor's states; None where no change is detected.

        A transient longer than the run looks like sustained chaos: see
        `dynkit.analysis.regimes.regime_change`. None for an array, whose order is not tested.
        """
        return regime_change(self.states) if isinstance(self.source, Attractor) else None

    @cached_property
    def _apart(self) -> float:
        """Distance of the dimension of the last regime from that of all states, with its error."""
        if self.change is None:
            return 0.0
        last = self.states[self.change.at :]
        if len(last) < BLOCKS:
            return inf
        other = replace(self, source=last, angles=self.turns)
        return inf if other.region is None else abs(other.value - self.value) + other.error

    @cached_property
    def takens(self) -> Estimate:
        """Takens' maximum-likelihood estimate, from the pairs below the region's largest radius.

        See `dynkit.analysis.dimension.scaling.takens`; NaN when there is no scaling region.
        """
        return Estimate(nan, inf) if self.region is None else takens(self.sums, self.region)

    @property
    def bounds(self) -> tuple[int, int] | None:
        """Bounds [d] and 2 [d] + 1 of the dimension of a phase space that can contain the set.

        [d] is the least integer that d minus its error does not exceed. None when there is no
        scaling region.

        References
        ----------
        J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, table 1. T. Sauer,
        J. A. Yorke, M. Casdagli, J. Stat. Phys. 65 (1991) 579-616: the upper one.
        """
        if self.region is None:
            return None
        least = max(ceil(self.value - self.error), 0)
        return least, 2 * least + 1

    @property
    def points(self) -> int | None:
        """Number of points of a finite set, if all are visited equally often; None for other sets.

        Measurements rounded to a grid may also be such a set: they are then too coarse, or too
        many, to show another dimension.
        """
        if self.outcome is not Outcome.FINITE or self.region is None:
            return None
        return round(1.0 / float(self.sums.values[self.sums.radii <= self.region.high][-1]))

    def dataset(self) -> Dataset:
        """Return the correlation sums and their local slopes as a dataset over the radius."""
        sums, slopes = self.sums, self.local_slopes
        return Dataset(
            {"radius": ("radius", sums.radii), "slope_radius": ("slope_radius", slopes.radii)},
            {
                "correlation_sum": ("radius", sums.values),
                "correlation_sum_error": ("radius", sums.error),
                "local_slope": ("slope_radius", slopes.values),
                "local_slope_error": ("slope_radius", slopes.errors),
            },
            described(
                "Correlation dimension",
                cost=self.cost,
                error="one standard error, which covers about 68 %",
                dimension=self.value,
                dimension_error=self.error,
                outcome=self.outcome.value,
                window=float(self.window),
            ),
        )

    @property
    def cost(self) -> Cost:
        """Cost of all sums and searches for the scaling region."""
        return self._found[2]

    def __repr__(self) -> str:
        used = f"{len(self.states)} states, {self.norm} norm, Theiler window {self.window}"
        if self.region is None:
            ratio = f"{self.least_ratio:g}:1 or more"
            return f"CorrelationDimension(none: {self.outcome.value} of {ratio}; {used})"
        found = f"{Estimate(self.value, self.error)}, r from {self.region.low:.3g} to "
        found += f"{self.region.high:.3g}, {self.region.ratio:.3g}:1"
        if self.outcome is Outcome.DRIFT:
            found += f"; {self.outcome.value}"
        count = "" if self.points is None else f"; finite, {self.points} points or so"
        doubt = "" if self.change is None else f"; {self.change}"
        return f"CorrelationDimension({found}{count}; {used}{doubt})"

    def plot(self, ax: Axes | None = None, *, label: str | None = None) -> Axes:
        """Draw the correlation sum against the radius, and the scaling region with its line.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        label : str, optional
            Text for a legend.
        """
        return draw_sums(self.sums, self._found[1], self.error, ax, label)

    def plot_slopes(self, ax: Axes | None = None, *, label: str | None = None) -> Axes:
        """Draw the local slopes with one standard error, the scaling region and both estimates.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        label : str, optional
            Text for a legend.
        """
        scaling, error = self._found[1], self.error
        return draw_slopes(self.local_slopes, scaling, self.takens, error, ax, label)


def _checked_ratio(least_ratio: float) -> float:
    if (ratio := finite_scalar("least_ratio", least_ratio)) < 1.5:
        raise ValueError(f"least_ratio must be at least 1.5; got {least_ratio!r}")
    return ratio


def _refuse_few(states: Array) -> None:
    if len(states) < BLOCKS:
        raise ValueError(f"source must have {BLOCKS} states or more; got {len(states)}")
