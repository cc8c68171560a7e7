"""Contacts along functions of the coordinates."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.systems.structure.functions import CoordinateFunction

_STEPS, _ROUNDING = 50, 2.0**-44
"""Largest number of Newton steps; rounding error of y, relative to one plus its absolute terms."""


@final
class Along:
    """The linear function y = J x, with the methods of a `CoordinateFunction`."""

    def __init__(self, row: Array) -> None:
        self.row = row

    def __call__(self, x: Array) -> Any:
        """Values (...) at positions (..., N)."""
        return x @ self.row

    def gradient(self, x: Array) -> Array:
        """Gradients (..., N) at positions (..., N)."""
        return np.broadcast_to(self.row, x.shape)

    def bend(self, x: Array, v: Array) -> Array:  # noqa: ARG002
        """Second derivatives of y times velocities (..., N): zero."""
        return np.zeros(x.shape)


@final
class CurvedContact:
    """A function y(x) of coordinates along which a stop acts.

    Attributes
    ----------
    function : CoordinateFunction or Along
    others : (N,)
        Numbers of the coordinates that sections keep: all of them.
    """

    def __init__(self, function: CoordinateFunction | Along, size: int) -> None:
        self.function, self.others = function, np.arange(size)

    def put_both(self, x: Array, v: Array, place: Any, speed: Any) -> None:
        """Give y and its rate prescribed values (...), at positions and velocities (..., N).

        Positions and velocities change along the gradient of y, in place. Entries beyond the N
        coordinates, those of sliders, do not change.

        Raises
        ------
        Refused
            When y does not reach its prescribed value along the gradient.
        """
        n, shape = len(self.others), x.shape[:-1]
        x, v = x[..., :n], v[..., :n]
        places, speeds = (np.broadcast_to(given, shape).ravel() for given in (place, speed))
        positions, velocities = x.reshape(-1, n), v.reshape(-1, n)
        for k, (at, moving) in enumerate(zip(positions, velocities, strict=True)):
            self.put(at, float(places[k]))
            self.push(at, moving, float(speeds[k]))
        x[...], v[...] = positions.reshape(x.shape), velocities.reshape(v.shape)

    def push(self, x: Array, v: Array, speed: float) -> None:
        """Give y a rate at positions (N,), by a change of the velocities (N,) in place."""
        row = self.function.gradient(x)
        v += row * ((speed - row @ v) / (row @ row))

    def put(self, x: Array, place: float) -> None:
        """Give y a value, by a change of positions (N,) along the initial gradient, in place.

        Raises
        ------
        Refused
            As `put_both`.
        """
        way, start, last = self.function.gradient(x), x.copy(), np.inf
        for _ in range(_STEPS):
            off, row = place - float(self.function(x)), self.function.gradient(x)
            near = _ROUNDING * (1.0 + float(abs(row) @ abs(x)) + abs(place))
            if off == 0.0 or (abs(off) <= near and abs(off) >= last):
                return
            slope, last = float(row @ way), abs(off)
            if slope == 0.0 or not np.isfinite(off / slope):
                break
            x += way * (off / slope)
        raise Refused(f"the stop at {place} is not reached from {start.tolist()}")

    @property
    def row(self) -> Array:
        """Row (N,) of a linear function."""
        assert isinstance(self.function, Along)
        return self.function.row

    def lifted(self, x: Array, v: Array, changes: Any) -> tuple[Array, Array]:
        """Tangent map of `put_both`, at positions and velocities that it would not change.

        Returns changes (d, N) of positions and velocities. `changes` consists of their changes
        (d, N) before, and of the changes (d,) of the prescribed place and speed.
        """
        by_x, by_v, place, speed = changes
        row, bend = self.function.gradient(x), self.function.bend(x, v)
        along = row / float(row @ row)
        by_x = by_x + np.outer(place - by_x @ row, along)
        return by_x, by_v + np.outer(speed - by_x @ bend - by_v @ row, along)
