"""Time series of one coordinate, and what is known about motions that are sampled."""

from __future__ import annotations

import math
import time
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from dynkit.analysis.motions import source_of
from dynkit.core.cost import Cost
from dynkit.core.reprs import span
from dynkit.core.validation import Array, finite_array
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.dynamics.attractor import Attractor
from dynkit.plotting.points import displacement, draw_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TWO_PI = 2.0 * math.pi

# Of the default time series: table periods, and samples in each.
_PERIODS, _SAMPLES = 12, 100


@final
class TimeSeries(Saved):
    """One coordinate of a motion against time.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (k,) array_like
        An attractor is sampled exactly, also beyond the states that it kept; an array holds the
        values.
    times : (k,) array_like, optional
        Ascending. For an attractor they count from the last state that was skipped, and are by
        default 100 in each of the first 12 periods of the forcing, or those of the kept states
        where nothing is forced. An array needs them.
    coordinate : int, optional
        Which number of an attractor's time series: of impact oscillators the positions come first,
        then the velocities. By default the contact coordinate, or the first where there is none.

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
        self._attractor: Attractor | None = None
        self.coordinate = None
        self.name = "value"
        source = source_of(source)
        if isinstance(source, Attractor):
            self._attractor = source
            self.times = default_times(source) if times is None else ascending("times", times)
            states = source.time_series(self.times)
            self.coordinate = checked_coordinate(source, coordinate, states.shape[1])
            self.values = states[:, self.coordinate].copy()
            self.name = coordinate_name(source, self.coordinate)
        else:
            if coordinate is not None:
                raise ValueError(f"coordinate must be left out with an array; got {coordinate!r}")
            self.times, self.values = given_samples(times, source, (None,))
        self.cost = Cost(time.perf_counter() - began, {"samples": len(self.times)})
        for array in (self.times, self.values):
            array.setflags(write=False)

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
        """Place of the table, (k,); None where there is none."""
        system = getattr(self._attractor, "system", None)
        if system is None or not is_impact_oscillator(system):
            return None
        phase = self._attractor.record.start.phase  # type: ignore[union-attr]
        angle = system.frequency * self.times + phase
        return np.asarray(system.amplitude * np.sin(angle) + system.offset)

    @cached_property
    def impacts(self) -> Array:
        """Times of the impacts within the times, (p,)."""
        record = record_until(self._attractor, float(self.times.max(initial=0.0)))
        if record is None or not len(self.times):
            return np.empty(0)
        at: Array = record.time
        return np.asarray(at[(at >= self.times[0]) & (at <= self.times[-1])])

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the values, that of the attractor's states.

        Of an array it is zero: nothing was added to what the values have.
        """
        return motion_error(self._attractor, float(self.times.max(initial=0.0)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the values against time, the stops dashed, the impacts as dots.

        The stops and the impacts are drawn with the contact coordinate only.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure of column width.

        Returns
        -------
        Axes
        """
        if self._contacts is None:
            return draw_motion(ax, self.times, self.values, self.name)
        stops, at = self._contacts
        return draw_motion(ax, self.times, self.values, self.name, stops, (self.impacts, at))

    @cached_property
    def _contacts(self) -> tuple[tuple[Array, ...], Array] | None:
        """Places of the stops, (k,) each, and of the impacts; None of another coordinate."""
        attractor, table = self._attractor, self.table
        if attractor is None or table is None or self.coordinate != contact_coordinate(attractor):
            return None
        system: Any = attractor.system
        play = getattr(system, "play", math.inf)
        other = () if play == math.inf else (table + (play if system.side == "above" else -play),)
        return (table, *other), attractor.time_series(self.impacts)[:, self.coordinate]

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


# --- what is known about motions ------------------------------------------------------------------


def is_impact_oscillator(system: object) -> bool:
    """Whether a system has a coordinate that hits a moving table."""
    names = ("contact", "degrees_of_freedom", "frequency", "amplitude", "offset")
    return all(hasattr(system, name) for name in names)


def contact_coordinate(attractor: Attractor) -> int:
    """Return the number of the contact coordinate, 0 where there is none."""
    system: Any = attractor.system
    if not is_impact_oscillator(system):
        return 0
    return int(system.contact % system.degrees_of_freedom)


def coordinate_name(attractor: Attractor, coordinate: int) -> str:
    """Return how a coordinate of the time series is written on an axis."""
    system: Any = attractor.system
    if not is_impact_oscillator(system):
        return f"coordinate {coordinate}"
    n = system.degrees_of_freedom
    if coordinate < n:
        return displacement(coordinate)
    return f"velocity $v_{{{coordinate - n + 1}}}$"


def checked_coordinate(attractor: Attractor, coordinate: object, dimension: int) -> int:
    """Return which of the numbers of a time series is meant.

    Raises
    ------
    ValueError
        When there is no such number.
    """
    if coordinate is None:
        return contact_coordinate(attractor)
    return checked_index("coordinate", coordinate, dimension)


def checked_index(name: str, value: object, length: int) -> int:
    """Return an index from 0 on; ValueError where the value is none of an array so long."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        index = int(value)
        if -length <= index < length:
            return index % length
    raise ValueError(f"{name} must lie in [{-length}, {length - 1}]; got {value!r}")


def forcing_frequency(attractor: Attractor) -> float:
    """Return the angular frequency of the table and the forces.

    Raises
    ------
    ValueError
        When the system has none.
    """
    if not hasattr(attractor.system, "frequency"):
        raise ValueError(f"source must be driven at one frequency; got {attractor.system!r}")
    return float(attractor.system.frequency)


def ascending(name: str, times: object) -> Array:
    """Return the times as a new array; ValueError where they do not ascend."""
    array = finite_array(name, times, (None,)).copy()
    for i in np.flatnonzero(np.diff(array) <= 0.0)[:1].tolist():
        raise ValueError(f"{name}[{i + 1}] must exceed {name}[{i}]; got {float(array[i + 1])}")
    return array


def given_samples(times: object, source: object, shape: tuple[None, ...]) -> tuple[Array, Array]:
    """Return times, (k,), and what was given at them, (k, ...), as new arrays.

    Raises
    ------
    ValueError
        When times are missing, do not ascend or are of another number.
    """
    values = finite_array("source", source, shape).copy()
    if times is None:
        raise ValueError("times must be given with an array")
    at = ascending("times", times)
    if len(at) != len(values):
        raise ValueError(f"times must have shape ({len(values)},); got shape {at.shape}")
    return at, values


def record_until(attractor: Attractor | None, latest: float) -> Any:
    """Return the record of impacts up to a time at least, None where there are no impacts."""
    known: Any = attractor
    return known.record_until(latest) if hasattr(attractor, "record_until") else None


def motion_error(attractor: Attractor | None, latest: float) -> float:
    """Return the error of an attractor's motion up to a time, zero where there is no attractor."""
    if attractor is None:
        return 0.0
    record: Any = getattr(attractor, "record", None)
    longer = record_until(attractor, latest)
    if longer is record:
        return attractor.error
    return max(attractor.error, float(longer.error.max(initial=0.0)))


def default_times(attractor: Attractor) -> Array:
    """Return times of a series, (k,), that shows what a motion looks like."""
    if not hasattr(attractor.system, "frequency"):
        return np.arange(len(attractor.states), dtype=np.float64)
    end = _PERIODS * TWO_PI / forcing_frequency(attractor)
    return np.asarray(np.arange(_PERIODS * _SAMPLES) * (end / (_PERIODS * _SAMPLES)))
