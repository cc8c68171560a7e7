"""What measures are taken of: attractors, what is known about their motions, and given samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array, ascending, finite_array, read_only
from dynkit.dynamics.attractor import Attractor
from dynkit.plotting.points import displacement

# Of the default time series: table periods, and samples in each.
_PERIODS, _SAMPLES = 12, 100


@runtime_checkable
class OffersAttractor(Protocol):
    """A motion that is no `Attractor` and gives itself as one, such as a record of impacts."""

    def as_attractor(self) -> Attractor:
        """Return the motion as an attractor that skips nothing."""
        ...


def source_of(given: object) -> object:
    """Return what a measure is taken of: the attractor of what offers one, else what was given."""
    return given.as_attractor() if isinstance(given, OffersAttractor) else given


def motion_of(given: object) -> Attractor | None:
    """Return the attractor that was given, or offered; None of numbers."""
    found = source_of(given)
    return found if isinstance(found, Attractor) else None


def attractor_of(given: object) -> Attractor:
    """Return the attractor that was given, or offered.

    Raises
    ------
    ValueError
        When it is none, or has no state.
    """
    attractor = motion_of(given)
    if attractor is None:
        raise ValueError(f"attractor must be an Attractor; got {given!r}")
    if not len(attractor.states):
        raise ValueError("attractor must have a state; got one that came to rest")
    return attractor


@contextmanager
def going_on_for(iterates: int) -> Iterator[None]:
    """Say of a motion that ends that it must go on for so many iterates.

    Raises
    ------
    ValueError
        When it ends.
    """
    try:
        yield
    except NoMotion as end:
        raise ValueError(f"attractor must go on for {iterates} iterates; {end}") from end


# --- sampled motions ------------------------------------------------------------------------------


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


def given_samples(times: object, source: object, shape: tuple[None, ...]) -> tuple[Array, Array]:
    """Return times, (k,), and what was given at them, (k, ...), as new arrays, read-only.

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
    return read_only(at), read_only(values)


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


def sampled(attractor: Attractor, times: object) -> tuple[Array, Array]:
    """Return times of a series, (k,), read-only, and an attractor's time series at them, (k, d).

    By default they are times that show what a motion looks like.
    """
    at = read_only(_default_times(attractor) if times is None else ascending("times", times))
    return at, attractor.time_series(at)


def _default_times(attractor: Attractor) -> Array:
    if not hasattr(attractor.system, "frequency"):
        return np.arange(len(attractor.states), dtype=np.float64)
    end = _PERIODS * math.tau / forcing_frequency(attractor)
    return np.asarray(np.arange(_PERIODS * _SAMPLES) * (end / (_PERIODS * _SAMPLES)))
