"""Chatter: ratios of successive flight times before sticking."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import span
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative_integer,
    read_only,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.plotting.figures import DOTS, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
@dataclass(frozen=True, eq=False)
class ChatterRatios(Saved):
    """Ratios of successive flight times in a sticking event, which tend to the restitution.

    The event is the longest run of successively shorter flights.

    Parameters
    ----------
    flight_times : (n,) array_like
        Times between successive impacts. Differences of absolute times lose a digit each time the
        flights become ten times shorter, and have no digits when a flight is shorter than the
        rounding of the time. Flights that are computed one by one keep their digits.

    Attributes
    ----------
    cost : Cost
        Seconds, and number of flights, without the cost of their simulation.

    Raises
    ------
    ValueError
        When a flight time is not finite or negative, or when no two successive flights shorten.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, equation 13, figure 3.

    Examples
    --------
    Two flights that lengthen, then the bounces of a ball on a floor:

    >>> chatter = ChatterRatios([0.5, 1.0, 2.0, 1.6, 1.28, 1.024])
    >>> chatter.begin, chatter.ratios.round(12).tolist()
    (2, [0.8, 0.8, 0.8])
    >>> chatter.deviation(0.8, first=1, last=3) < 1e-15
    True
    """

    _stored: ClassVar = ("flight_times", "cost")
    flight_times: Array
    cost: Cost = field(init=False, repr=False)

    def __post_init__(self) -> None:
        began = time.perf_counter()
        times = finite_array("flight_times", self.flight_times, (None,)).copy()
        for i in np.flatnonzero(times < 0.0)[:1].tolist():
            raise ValueError(f"flight_times[{i}] must not be negative; got {float(times[i])}")
        if not (np.diff(times) < 0.0).any():
            raise ValueError("flight_times must hold two successive flights that shorten")
        object.__setattr__(self, "flight_times", read_only(times))
        cost = Cost(time.perf_counter() - began, {"flights": len(times)})
        object.__setattr__(self, "cost", cost)

    def __repr__(self) -> str:
        ratios = self.ratios
        return (
            f"<ChatterRatios: {len(ratios)}, {span(ratios)}, of {len(self.flight_times)} flights>"
        )

    @cached_property
    def _run(self) -> tuple[int, int]:
        shorter = np.concatenate([[False], np.diff(self.flight_times) < 0.0, [False]])
        edges = np.flatnonzero(~shorter)
        longest = int(np.argmax(np.diff(edges)))
        return int(edges[longest]), int(edges[longest + 1])

    @property
    def begin(self) -> int:
        """Index of the first flight of the event."""
        return self._run[0]

    @property
    def flights(self) -> Array:
        """Flight times of the event, (m,)."""
        return self.flight_times[slice(*self._run)]

    @property
    def ratios(self) -> Array:
        """Each flight time of the event over the one before, (m - 1,)."""
        return np.asarray(self.flights[1:] / self.flights[:-1])

    @cached_property
    def error(self) -> Array:
        """Bound of the errors of the ratios, (m - 1,), to first order, from the rounding of times.

        It assumes that the flights are differences of times since the first flight, each with an
        error of half a unit in its last place. Flights that are computed one by one are more
        accurate; times with larger errors, as in chaos, are less accurate.
        """
        begin, end = self._run
        clock = np.spacing(np.cumsum(self.flight_times))[begin:end]
        off = clock + 2.0**-53 * self.flights
        return np.asarray((off[1:] + self.ratios * off[:-1]) / self.flights[:-1])

    @property
    def bounces(self) -> Array:
        """Bounce numbers, (m - 1,), of the ratios; 1 belongs to the first two flights."""
        return np.arange(1.0, len(self.flights))

    def dataset(self) -> Dataset:
        """Return the ratios as a dataset over ``bounce``, and all flight times over ``flight``."""
        return Dataset(
            {"bounce": ("bounce", self.bounces)},
            {
                "ratio": ("bounce", self.ratios),
                "error": ("bounce", self.error),
                "flight_time": ("flight", self.flight_times),
            },
            described(
                "Ratios of successive flight times",
                cost=self.cost,
                error="bound of the error of a ratio, to first order",
                begin=float(self.begin),
            ),
        )

    def deviation(self, limit: float, *, first: int, last: int) -> float:
        """Return the largest distance of a ratio from the limit, over these bounce numbers.

        Raises
        ------
        ValueError
            When the event has fewer bounces, or the range of bounces is empty.
        """
        low, high = non_negative_integer("first", first), non_negative_integer("last", last)
        if not 1 <= low <= high:
            raise ValueError(f"first must lie in [1, last = {high}]; got {low}")
        if high > len(self.ratios):
            raise ValueError(
                f"last must not exceed the event's {len(self.ratios)} bounces; got {high}"
            )
        return float(abs(self.ratios[low - 1 : high] - finite_scalar("limit", limit)).max())

    @print_style()
    def plot(self, ax: Axes | None = None, *, label: str | None = None) -> Axes:
        """Draw the ratios against the bounce number.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        label : str, optional
            Text for a legend.
        """
        axes = shown_axes(ax)
        axes.plot(self.bounces, self.ratios, markersize=1.6, label=label, color=ink(), **DOTS)
        axes.set(
            xlabel="bounce number $n$",
            ylabel=r"ratio of flight times $\Delta t_{n+1} / \Delta t_n$",
        )
        return axes
