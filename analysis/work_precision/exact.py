"""Exact impacts: the reference for methods."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, final

import numpy as np

from dynkit.core.reprs import system_repr
from dynkit.core.validation import Array, finite_array, finite_scalar, non_negative, positive

_DOUBLE, _PAIR = 2.0**-53, 2.0**-105


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ExactImpacts:
    """A start of a system, and all impacts and releases up to a time, from a reference.

    Numbers with more digits than a double are ``Decimal`` or text; 32 digits are kept.

    Parameters
    ----------
    system : object
        The simulated system. The methods of dynkit require an `ImpactOscillator`, or an object with
        its attributes.
    position, velocity : (N,) array_like
        The start, in doubles.
    phase : float
        Phase of the table at the start.
    until : float
        Time after the start up to which impacts are compared.
    times : (n,) array_like
        Times of the impacts, ascending.
    positions, velocities : (n, k) array_like
        Positions at the impacts, and velocities just after them.
    coordinates : sequence of int
        Indices of these k coordinates; by default all.
    releases : (m,) array_like
        Times at which a sticking mass leaves the table.
    chatters : (l, 2) array_like
        Intervals with too many bounces for comparison: they contain no exact impacts, and impacts
        found there are ignored.
    conditioning : float, optional
        Approximate factor from relative disturbances of the start to errors of the impacts; the
        rounding of the start causes an error of this times 2^-53.
    period : float, optional
        Unit of errors of times; by default the period of the table.
    error : float, optional
        Estimate of the largest error of these impacts, in the norm of `errors`; by default their
        `rounding`.

    Raises
    ------
    ValueError
        When an argument is refused; the message names argument, limit and value.

    Examples
    --------
    A ball that falls by one unit of length in one unit of time:

    >>> exact = ExactImpacts(
    ...     system="a ball", position=[1.0], velocity=[0.0], until=1.5, period=1.0,
    ...     times=["1.0"], positions=[["0.0"]], velocities=[["1.6"]],
    ... )
    >>> exact.errors([1.25], [[0.0]], [[1.6]])
    array([0.25])
    """

    system: Any
    position: Any
    velocity: Any
    phase: float = 0.0
    until: float
    times: Any
    positions: Any
    velocities: Any
    coordinates: tuple[int, ...] = ()
    releases: Any = ()
    chatters: Any = ()
    conditioning: float = math.nan
    period: float = math.nan
    error: float = math.nan
    _pairs: dict[str, Array] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        position = finite_array("position", self.position, (None,))
        n = len(position)
        self._set("position", position)
        self._set("velocity", finite_array("velocity", self.velocity, (n,)))
        self._set("phase", finite_scalar("phase", self.phase))
        self._set("until", positive("until", self.until))
        if math.isnan(self.period):
            self._set("period", 2.0 * math.pi / positive("frequency", self.system.frequency))
        self._set("period", positive("period", self.period))
        self._set("coordinates", tuple(self.coordinates) or tuple(range(n)))
        for k in self.coordinates:
            if not 0 <= k < n:
                raise ValueError(f"coordinates must lie in [0, {n - 1}]; got {k}")
        chatters = self.chatters if len(self.chatters) else np.zeros((0, 2))
        self._set("chatters", finite_array("chatters", chatters, (None, 2)))
        self._pair("times", (None,))
        count, width = len(self.times), len(self.coordinates)
        self._pair("positions", (count, width))
        self._pair("velocities", (count, width))
        self._pair("releases", (None,))
        for name in ("times", "releases"):
            moments = getattr(self, name)
            if (np.diff(moments) < 0.0).any():
                raise ValueError(f"{name} must ascend; got {moments.tolist()}")
            for moment in moments[(moments < 0.0) | (moments > self.until)][:1].tolist():
                raise ValueError(f"{name} must lie in [0, until = {self.until}]; got {moment}")
        if math.isnan(self.error):
            self._set("error", self.rounding)
        self._set("error", non_negative("error", self.error))

    def __repr__(self) -> str:
        system = self.system if isinstance(self.system, str) else system_repr(self.system, 6)
        parts = [f"{len(self.times)} impacts", f"{len(self.releases)} releases"]
        parts += [f"{len(self.chatters)} chatters"] if len(self.chatters) else []
        return f"<ExactImpacts of {system}: {', '.join(parts)} up to {self.until:g}>"

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _pair(self, name: str, shape: tuple[int | None, ...]) -> None:
        """Store numbers as pairs: doubles, and their remainders."""
        numbers = np.array(getattr(self, name), dtype=object)
        if not numbers.size:
            numbers = numbers.reshape([length or 0 for length in shape])
        try:
            high = np.array([float(x) for x in numbers.flat]).reshape(numbers.shape)
        except (TypeError, ValueError):
            raise ValueError(f"{name} must hold numbers; got {getattr(self, name)!r}") from None
        finite_array(name, high, shape)
        low = [_rest(x, y) for x, y in zip(numbers.flat, high.flat, strict=True)]
        high.setflags(write=False)
        self._set(name, high)
        self._pairs[name] = np.array(low).reshape(high.shape)

    @property
    def rounding(self) -> float:
        """Relative rounding of the given numbers: that of doubles, or of pairs of doubles."""
        return _PAIR if any(part.any() for part in self._pairs.values()) else _DOUBLE

    @property
    def size(self) -> tuple[float, float]:
        """Largest position and largest velocity of the impacts: the units of errors."""
        sizes = (float(abs(x).max(initial=0.0)) for x in (self.positions, self.velocities))
        first, second = (x or 1.0 for x in sizes)
        return first, second

    def errors(
        self, times: object, positions: object, velocities: object, which: object = None
    ) -> Array:
        """Return the error of each impact, (n,).

        It is the largest of three: the error of the time over the period, of positions over the
        largest position of all impacts, and of velocities over the largest velocity.

        Parameters
        ----------
        times : (n,) array_like
        positions, velocities : (n, N) array_like
            Positions and velocities of all coordinates.
        which : (n,) array_like of int, optional
            Indices of the exact impacts; by default 0 to n - 1.
        """
        t, kept = np.asarray(times, dtype=np.float64), list(self.coordinates)
        chosen = np.arange(len(t)) if which is None else np.asarray(which, dtype=np.intp)
        x, v = (np.asarray(part, dtype=np.float64) for part in (positions, velocities))
        late = abs(self._off("times", t, chosen)) / self.period
        parts = [
            abs(self._off(name, part[:, kept], chosen)).max(axis=1, initial=0.0) / size
            for name, part, size in zip(("positions", "velocities"), (x, v), self.size, strict=True)
        ]
        return np.asarray(np.max([late, *parts], axis=0))

    def lateness(self, releases: object, which: object) -> Array:
        """Return errors of release times relative to the period, (m,); arguments as in `errors`."""
        found, chosen = np.asarray(releases, dtype=np.float64), np.asarray(which, dtype=np.intp)
        return np.asarray(abs(self._off("releases", found, chosen)) / self.period)

    def _off(self, name: str, found: Array, which: Any) -> Array:
        # the first difference is exact where it is small
        return np.asarray((found - getattr(self, name)[which]) - self._pairs[name][which])


def _rest(number: Any, double: float) -> float:
    if isinstance(number, float | int | np.generic):
        return 0.0
    return float(Decimal(str(number)) - Decimal(double))
