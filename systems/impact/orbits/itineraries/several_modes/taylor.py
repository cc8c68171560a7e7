"""Motions through several modes of structures with nonquadratic energies, by Taylor's method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from scipy.special import factorial

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.flying import TaylorFlights
from dynkit.systems.impact.orbits.itineraries.motion import ROUNDING
from dynkit.systems.impact.orbits.itineraries.several_modes import divided
from dynkit.systems.impact.orbits.itineraries.several_modes.shooting import ShootingSolution
from dynkit.systems.impact.orbits.machine import Numbers

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.taylor.mode import Path

_POINTS = 24
"""Number of Chebyshev points at which guards are interpolated in a step of Taylor's method."""

_SMALL = 2.0**-50
"""A Taylor series is summed if its last two terms are below this fraction of its largest one."""

_LEAST = 1e-4
"""Least duration, in radians of the phase, for derivatives of divided differences."""

_NORM = 4.0
"""Bound of the norm of the flow of one step: a series of order 19 whose last terms are rounding."""


@final
class TaylorSolution(ShootingSolution):
    """The motion of an itinerary whose flights are computed by Taylor's method.

    States (D,) are those of linear flights: positions, velocities, positions of sliders, sine and
    cosine of the phase, and 1. Rows of gaps and of their rates are the same as well. Flights, with
    derivatives by variational equations, contact forces, and kicks of a varying mass are different.
    """

    # --- flights ----------------------------------------------------------------------------------

    def _flight(self, i: int, z: Array, lasts: Any) -> tuple[Array, Array]:
        if self.course.sticks and not self.durations[i].real > 0.0:
            raise NoSolution("events must come one after the other")
        return super()._flight(i, z, lasts)

    @cached_property
    def _gained(self) -> Array:
        assert self._still is not None
        own = enumerate(zip(self._modes, self.durations.real.tolist(), strict=True))
        found = [
            flights.changed(self._still.begun(i), lasts - self._still._late(i))
            for i, (flights, lasts) in own
        ]
        return np.array(found)

    # --- guards between events --------------------------------------------------------------------

    def acceleration(self, i: int) -> tuple[float, float]:
        k = self.hits[i]
        _, row = self._modes[k].rate_of(int(self.sides[i]), self.after[k])
        terms = row * self._modes[k].rate(self.after[k])
        return float(terms.sum()), ROUNDING * float(abs(terms).sum())

    def _path(self, i: int) -> tuple[Path, float]:
        """The flight after event `i`, or after its chatter, and the duration of this chatter."""
        late = self._late(i)
        return self._modes[i].path(self.begun(i), float(self.durations[i]) - late), late

    def _curve(self, i: int, element: int, guard: int) -> Curve:
        (path, late), flights, found, size = self._path(i), self._modes[i], [], 0.0
        begins, ends = path.ends[:-1], np.append(path.ends[1:-1], path.reach)
        for begin, end in zip(begins, ends, strict=True):
            places = 0.5 * (begin + end) + 0.5 * (end - begin) * _PLACES
            z = flights.whole(path.states(places))
            values, rows = flights.seen(element, guard, z)
            size = max(size, float((abs(z) * abs(rows)).sum(axis=1).max()))
            found.append(_COEFFICIENTS @ values)
        off, scale = (-ends - begins) / (ends - begins), 2.0 / (ends - begins)
        series = np.zeros((3, _POINTS, len(begins)))
        for k in range(3):
            series[k, : _POINTS - k] = chebyshev.chebder(np.array(found).T, k, scale)

        def at(times: Array, count: int) -> Array:
            which = np.searchsorted(path.ends[1:-1], times, side="right")
            own = series[:count, :, which].swapaxes(0, 1)
            places = off[which] + scale[which] * times
            return np.asarray(chebyshev.chebval(places, own, tensor=False), dtype=float)

        lasts = float(self.durations[i]) - late
        inside = off + scale * np.linspace(begins, ends, 9)
        bend = float(abs(chebyshev.chebval(inside, series[2][:, None], tensor=False)).max())
        return Curve(at, lasts, (size, bend))

    @cached_property
    def norms(self) -> Array:
        return np.array([_NORM * (len(self._path(i)[0].ends) - 1) for i in range(self.events)])

    # --- divided differences ----------------------------------------------------------------------

    def _series(self, j: int, i: int) -> tuple[Array, bool]:
        """Taylor coefficients (k,) of the guard of event `i` at the begin of flight `j`.

        The second item says whether the series reaches the end of the flight.
        """
        if self.oscillator._elements[self.itinerary[i].element].curved:
            return self._series_along(j, i)
        row = self.guards[i]
        (path, _), w = self._path(j), self.oscillator.frequency
        order = np.arange(path.coefficients.shape[2])
        z, weights = path.coefficients[0].T, w**order / factorial(order)
        phase = np.arctan2(*self.after[j, -3:-1]) + 0.5 * np.pi * order
        sines, cosines = weights * np.sin(phase), weights * np.cos(phase)
        one = (order == 0) * 1.0
        x, v = path.chart.motion(z, sines, cosines, one)
        motion = np.concatenate([x[:, : v.shape[1]], v, x[:, v.shape[1] :]], axis=1)
        found = motion @ row[:-3] + sines * row[-3] + cosines * row[-2]
        found[0] += row[-1]
        if self.durations[j] > 0.0:
            return found, len(path.ends) == 2
        terms = abs(motion) @ abs(row[:-3]) * abs(self.durations[j]) ** order
        return found, bool(terms[-2:].max() <= _SMALL * terms.max())

    def _series_along(self, j: int, i: int) -> tuple[Array, bool]:
        """As `_series`, for an element along a function of the coordinates."""
        flights: TaylorFlights = self._modes[j]
        k, watch = self.itinerary[i].element, divided.watch_of(self.oscillator, self.itinerary[i])
        gap, rate = flights.mode.series(k, flights.short(self.after[j]))
        found = (watch.gap + watch.stretch) * gap + watch.rate * rate
        found[0] += watch.level
        terms = abs(found) * abs(self.durations[j]) ** np.arange(len(found))
        return found, bool(terms[-2:].max() <= _SMALL * terms.max())

    def quotient(self, j: int, i: int, q: int) -> Any:
        t = self.durations[j]
        if self._still is None:
            series, near = self._series(j, i)
            if near:
                return polynomial.polyval(t, series[q:])
        rise = self.rise(j, i)
        return (rise if q == 1 else rise - t * (self.guards[i] @ self._begun(j))) / t**q

    def _begun(self, j: int) -> Any:
        """Rate (D,) of the state after event `j`."""
        flights, z = self._modes[j], self.after[j]
        found = flights.rate(z.real)
        if self._still is None:
            return found
        by = flights.tangent(z.real) @ z.imag + STEP * flights.rate_changed(z.real)
        by[-3:-1] += self.clock.imag * np.array([z[-2].real, -z[-3].real])
        return found + 1j * by

    def quotient_change(self, j: int, i: int, q: int) -> tuple[Any, float]:
        t, row = float(self.durations[j]), self.guards[i]
        series, near = self._series(j, i)
        value, start = self.quotient(j, i, q), self.after[j]
        if near:
            late = polynomial.polyval(t, polynomial.polyder(series[q:]))
        else:
            begun = row @ self._begun(j) if q > 1 else 0.0
            moving = self.guard_at(i, self.reached[j])[1] @ self.moving[j]
            late = ((moving - begun) / t ** (q - 1) - q * value) / t
        least, end, flown = _LEAST / self.clock, self.reached[j], self.transitions[j]
        if abs(t) < least:  # the derivative hardly depends on so short a duration
            t = least
            end, flown = self._modes[j].passed(start, t)
        by_state = self.guard_at(i, end)[1] @ flown - self.guard_at(i, start)[1]
        if q > 1:
            by_state -= t * (row @ self._modes[j].tangent(start))
        return by_state / t**q, float(late)

    def quotient_rounding(self, j: int, i: int, q: int) -> float:
        (series, near), row = self._series(j, i), self.guards[i]
        t = abs(float(self.durations[j]))
        level = polynomial.polyval(t, abs(series[q:])) if near else 0.0
        size = float(abs(row) @ np.maximum(abs(self.after[j]), abs(self.reached[j])))
        return ROUNDING * float(level if near else size / t**q)

    def rise(self, j: int, i: int) -> Any:
        if self.oscillator._elements[self.itinerary[i].element].curved:
            return self.guard_at(i, self.reached[j])[0] - self.guard_at(i, self.after[j])[0]
        return self.guards[i] @ (self.reached[j] - self.after[j])

    def rise_change(self, j: int, i: int) -> Any:
        begin, end = (self.guard_at(i, z)[1] for z in (self.after[j], self.reached[j]))
        return end @ self.transitions[j] - begin

    # --- the motion -------------------------------------------------------------------------------

    def change(self, change: tuple[Array, Numbers]) -> Array | None:
        """Derivative (m,) of the residual by a change of all numbers."""
        modes = sorted({event.mode for event in self.itinerary})
        ends = np.cumsum([len(self.flights(mode).mode.numbers) for mode in modes])
        parts = dict(zip(modes, np.split(change[1].flights, ends[:-1]), strict=True))
        scene = self.scene._replace(machine=self.machine.changed(self.oscillator, change))
        given = scene, self.course, self.lap, self.pairs, self.driven
        return np.asarray(TaylorSolution(*given, self, parts).left.imag / STEP)


_PLACES = np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_PLACES, _POINTS - 1))
