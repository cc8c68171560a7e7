"""Sources of measures: attractors with their motions, and given samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, Self, final, runtime_checkable

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, ascending, finite_array, read_only
from dynkit.dynamics.attractor import Attractor, MapAttractor
from dynkit.plotting.points import displacement

# Default time series: periods of the forcing, and samples per period.
_PERIODS, _SAMPLES = 12, 100


@runtime_checkable
class OffersAttractor(Protocol):
    """A motion that can be converted to an `Attractor`, such as a record of impacts."""

    def as_attractor(self) -> Attractor:
        """Return the motion as an attractor without a transient."""
        ...


def source_of(given: object) -> object:
    """Return the source as an attractor where it can be converted, otherwise unchanged.

    Raises
    ------
    ValueError
        When the source is a system or a sweep, which has attractors.
    """
    if hasattr(given, "attractor"):
        kinds = "an attractor, a record or an array"
        raise ValueError(f"source must be {kinds}; got {given!r}, whose attractor() gives one")
    return given.as_attractor() if isinstance(given, OffersAttractor) else given


def attractor_of(given: object) -> Attractor:
    """Return the source as an attractor.

    Raises
    ------
    ValueError
        When the source is not an attractor, or has no state.
    """
    attractor = source_of(given)
    if not isinstance(attractor, Attractor):
        raise ValueError(f"attractor must be an Attractor; got {given!r}")
    if not len(attractor.states):
        raise ValueError("attractor must have a state; got one without impacts")
    return attractor


@contextmanager
def going_on_for(iterates: int) -> Iterator[None]:
    """Convert the end of a motion inside the context into a ValueError.

    Raises
    ------
    ValueError
        When the motion ends; the message names the required number of iterates.
    """
    try:
        yield
    except NoMotion as end:
        raise ValueError(f"attractor must go on for {iterates} iterates; {end}") from end


# --- sampled motions ------------------------------------------------------------------------------


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of an attractor, for measures that sample it.

    Parameters
    ----------
    attractor : Attractor
    """

    attractor: Attractor

    @classmethod
    def of(cls, given: object) -> Self | None:
        """Return the motion of a source; None for an array."""
        found = source_of(given)
        return cls(found) if isinstance(found, Attractor) else None

    @property
    def system(self) -> Any:
        """The system of the attractor."""
        return self.attractor.system

    @property
    def has_masses(self) -> bool:
        """Whether it is a motion of masses, one of which may hit a stop."""
        names = ("contact", "degrees_of_freedom", "frequency", "amplitude", "offset")
        return all(hasattr(self.system, name) for name in names)

    @property
    def table(self) -> Any:
        """The hard stop at which the motion is examined, if it limits one coordinate, or None."""
        return getattr(self.system, "_table", None)

    @property
    def contact(self) -> int:
        """Index of the contact coordinate; 0 where there is none."""
        return int(self.system.contact % self.system.degrees_of_freedom) if self.has_masses else 0

    @property
    def frequency(self) -> float | None:
        """Angular frequency of the table and the forces; None where there is none.

        The time of a map counts iterates: no parameter of it is a frequency in that time.
        """
        found = getattr(self.system, "frequency", None)
        return None if found is None or isinstance(self.attractor, MapAttractor) else float(found)

    @property
    def forcing_frequency(self) -> float:
        """Angular frequency of the table and the forces.

        Raises
        ------
        ValueError
            When the system has no such frequency.
        """
        if self.frequency is None:
            raise ValueError(f"source must be driven at one frequency; got {self.system!r}")
        return self.frequency

    def coordinate(self, asked: object, dimension: int) -> int:
        """Return the index of a coordinate of the time series; by default the contact coordinate.

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        return self.contact if asked is None else checked_index("coordinate", asked, dimension)

    def name_of(self, coordinate: int) -> str:
        """Return the axis title of a coordinate of the time series."""
        if not self.has_masses:
            return f"coordinate {coordinate}"
        behind = coordinate - self.system.degrees_of_freedom
        return displacement(coordinate) if behind < 0 else f"velocity $v_{{{behind + 1}}}$"

    def sampled(self, times: object) -> tuple[Array, Array]:
        """Return times, (k,), read-only, and the time series at them, (k, d).

        By default there are 100 times in each of 12 periods of the forcing, or those of the kept
        states without forcing.
        """
        at = read_only(self._default_times() if times is None else ascending("times", times))
        return at, self.attractor.time_series(at)

    def _default_times(self) -> Array:
        if self.frequency is None:
            return np.arange(len(self.attractor.states), dtype=np.float64)
        end = _PERIODS * math.tau / self.forcing_frequency
        return np.asarray(np.arange(_PERIODS * _SAMPLES) * (end / (_PERIODS * _SAMPLES)))

    def record_until(self, latest: float) -> Any:
        """Return the record of impacts at least up to a time; None where there are no impacts."""
        known: Any = self.attractor
        return known.record_until(latest) if hasattr(known, "record_until") else None

    def error_until(self, times: Array) -> float:
        """Return the error of the motion up to the latest of times (k,)."""
        latest = float(times.max(initial=0.0))
        if isinstance(self.attractor, MapAttractor):
            return self.attractor.error_until(int(latest))
        longer = self.record_until(latest)
        if longer is getattr(self.attractor, "record", None):
            return self.attractor.error
        return max(self.attractor.error, float(longer.error.max(initial=0.0)))


def checked_index(name: str, value: object, length: int) -> int:
    """Return an index from 0 on; ValueError where it is not an index of an array of this length."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        index = int(value)
        if -length <= index < length:
            return index % length
    raise ValueError(f"{name} must lie in [{-length}, {length - 1}]; got {value!r}")


def given_samples(times: object, source: object, shape: tuple[None, ...]) -> tuple[Array, Array]:
    """Return given times, (k,), and samples, (k, ...), as new arrays, read-only.

    Raises
    ------
    ValueError
        When times are missing, do not ascend or differ in number from the samples.
    """
    values = finite_array("source", source, shape).copy()
    if times is None:
        raise ValueError("times must be given with an array")
    at = ascending("times", times)
    if len(at) != len(values):
        raise ValueError(f"times must have shape ({len(values)},); got shape {at.shape}")
    return read_only(at), read_only(values)
