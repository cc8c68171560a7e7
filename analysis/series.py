"""Time series of one coordinate."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from dynkit.analysis.motions import Motion, given_samples
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import span
from dynkit.core.validation import Array, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.plotting.points import draw_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
class TimeSeries(Saved):
    """One coordinate of a motion against time.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (k,) array_like
        An attractor is sampled exactly, also beyond its kept states; an array contains the values.
    times : (k,) array_like, optional
        Ascending times; required for an array. For an attractor they count from the last skipped
        state. By default there are 100 in each of the first 12 periods of the forcing, or, without
        forcing, those of the kept states.
    coordinate : int, optional
        Index of a coordinate in an attractor's time series; for impact oscillators the positions
        come first, then the velocities. By default the contact coordinate, or the first where there
        is none.

    Attributes
    ----------
    times, values : (k,) arrays, read-only
    coordinate : int or None
    cost : Cost
        Seconds and samples.

    Raises
    ------
    ValueError
        When times do not ascend, lengths differ, a number is not finite, or there is no such
        coordinate.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> series = TimeSeries(ImpactChain(frequency=0.87).attractor())
    >>> len(series.values), len(series.impacts)
    (1200, 3)
    """

    def __init__(
        self, source: object, times: object = None, *, coordinate: int | None = None
    ) -> None:
        began = time.perf_counter()
        motion = self._motion = Motion.of(source)
        self.coordinate, self.name = None, "value"
        if motion is not None:
            self.times, states = motion.sampled(times)
            self.coordinate = motion.coordinate(coordinate, states.shape[1])
            self.values = read_only(states[:, self.coordinate].copy())
            self.name = motion.name_of(self.coordinate)
        else:
            if coordinate is not None:
                raise ValueError(f"coordinate must be left out with an array; got {coordinate!r}")
            self.times, self.values = given_samples(times, source, (None,))
        self.cost = Cost(time.perf_counter() - began, {"samples": len(self.times)})

    _stored: ClassVar = (
        *("times", "values", "name", "coordinate", "cost", "table", "impacts", "error"),
        "_contacts",
    )
    times: Array
    values: Array
    name: str
    coordinate: int | None
    cost: Cost

    def __repr__(self) -> str:
        which = "" if self.coordinate is None else f" of coordinate {self.coordinate}"
        return f"<TimeSeries{which}: {len(self.values)} samples, times {span(self.times)}>"

    @cached_property
    def table(self) -> Array | None:
        """Position of the table, or of the first hard stop, (k,); None if it limits no mass."""
        motion = self._motion
        if motion is None or motion.table is None:
            return None
        angle = motion.system.frequency * self.times + motion.record_until(0.0).start.phase
        return np.asarray(motion.table.swing(np.sin(angle), np.cos(angle)) + motion.table.offset)

    @cached_property
    def impacts(self) -> Array:
        """Times of the impacts between the first and the last time, (p,)."""
        latest = float(self.times.max(initial=0.0))
        record = None if self._motion is None else self._motion.record_until(latest)
        if record is None or not len(self.times):
            return np.empty(0)
        at: Array = record.time[record.element >= 0]  # states once a period have no element
        return np.asarray(at[(at >= self.times[0]) & (at <= self.times[-1])])

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the values, from the attractor; zero for an array."""
        return 0.0 if self._motion is None else self._motion.error_until(self.times)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the values against time, with stops as dashed lines and impacts as dots.

        Stops and impacts are drawn for the contact coordinate only.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.

        Returns
        -------
        Axes
        """
        if self._contacts is None:
            return draw_motion(ax, self.times, self.values, self.name)
        stops, at = self._contacts
        named = dict(zip(("table", "far stop"), stops, strict=False))
        return draw_motion(ax, self.times, self.values, self.name, named, (self.impacts, at))

    @cached_property
    def _contacts(self) -> tuple[tuple[Array, ...], Array] | None:
        """Positions of the stops, (k,) each, and of the impacts; None for another coordinate."""
        motion, table = self._motion, self.table
        if motion is None or table is None or self.coordinate != motion.contact:
            return None
        play = getattr(motion.system, "play", math.inf)
        side = 1.0 if motion.system.side == "above" else -1.0
        stops = (table,) if play == math.inf else (table, table + side * play)
        return stops, motion.attractor.time_series(self.impacts)[:, self.coordinate]

    def dataset(self) -> Dataset:
        """Return the values as a dataset over time, with the table and the times of impacts."""
        table = {} if self.table is None else {"table": ("time", self.table)}
        return Dataset(
            {"time": ("time", self.times)},
            {"value": ("time", self.values), **table, "impact_time": ("impact", self.impacts)},
            described(
                f"Time series of {self.name}",
                cost=self.cost,
                error="estimate of the largest error of the values",
                value_error=self.error,
            ),
        )
