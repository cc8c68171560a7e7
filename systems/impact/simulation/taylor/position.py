"""The present state of a run by Taylor's method: its mode, coordinates, phase and clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import IMPACT, JUMP, SWITCH
from dynkit.systems.impact.elements.friction import LANDED
from dynkit.systems.impact.modes.curves import CurvedContact
from dynkit.systems.impact.modes.taylor.mode import horner
from dynkit.systems.impact.modes.taylor.signs import ROUNDING
from dynkit.systems.impact.simulation.clock_kernels import BOUNCED, BOUNCES, FLIGHT, SWITCHED
from dynkit.systems.impact.simulation.state import TOUCHED, TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.taylor.chart import Chart
    from dynkit.systems.impact.modes.taylor.mode import TaylorMode
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

ABOVE = 1e-300
"""Gap just after an impact. It is not zero because heyoka's root search would report an exact zero
as the next root."""

_RELEASED = 2.0**-80
"""Gap after a release, and slip after a halt, relative to the largest coordinate and the largest of
its Taylor terms over a period."""

_TERMS = 3
"""Highest order of the Taylor terms in `_above`: velocities and accelerations may be zero."""

_ROUNDS = 4
"""Rounds from coordinates to positions and back at most; then rounding changes nothing."""

_STEPS = 16.0
"""Number of Taylor steps whose rounding errors are covered by the disturbance of one event."""

_AHEAD = 1e-7, 1e-5, 1e-3
"""Parts of a period after which the sign of a guard that is zero to rounding is determined."""


class Position:
    """The present state of a run: the mode, its coordinates, the phase and the clock."""

    def __init__(
        self, oscillator: DrivenStructure, start: ImpactState, *, noise: float, seed: int
    ) -> None:
        self._oscillator, self._start, self._noise = oscillator, start, noise
        self._random = np.random.default_rng(seed)
        self._late = float(self._random.choice((-1.0, 1.0)))
        self._automaton: Any = oscillator._automaton
        self._motion = [FLIGHT] * len(oscillator._elements)
        self._speed = [0.0] * len(oscillator._elements)
        self._turn = float(start._turn[0]), float(start._turn[1])
        self._time, self._low, self._longest = 0.0, 0.0, 0.0
        self._steps, self._left, self._latest = 0, start.element, start.element
        self._frequency = oscillator.frequency
        self._period, self._remaining = TWO_PI / oscillator.frequency, math.inf
        self._number = 0

    def _enter(self, x: Array, v: Array) -> None:
        """Convert positions and velocities to the coordinates of the present mode."""
        self._mode: TaylorMode = self._automaton.modes[self._number]
        v = v[: self._mode.bodies]
        for k in (*self._mode.held, *self._mode.sticking):
            if k in self._mode.scene.curves:
                x, v = self._onto(k, x, v, 0.0)
        state = self._mode.state(x, v, *self._turn)
        self._mode.check(state)
        for k in self._mode.scene.normal:
            if self._automaton.regimes[self._number][k] == LANDED:
                self._motion[k] = FLIGHT
        self._chart: Chart = self._mode.chart(self._left, state)
        self._z = self._chart.coordinates(x, v, *self._turn)
        self._mode.settled(self._chart, self._z)
        self._touch()
        self._kicks: dict[int, Array | None] = {}
        self._first = self._automaton.guard(self._number, -1)
        self._fixed = self._mode.constant_kicks
        events = [self._automaton.guards[self._first + i] for i in range(len(self._mode.guards))]
        self._plain = all(guard.watch.event == IMPACT for guard in events)

    def _touch(self) -> None:
        """Set the gaps of stops that were just left to zero (`_above`), with their known rates.

        Likewise, the stretch that remains until a slider slides is set to zero if it is zero to
        rounding: the slider is about to slide, or has just halted.
        """
        size = TOUCHED * float(abs(self._z[: self._half]).max())
        for k, place in self._chart.springs.items():
            if self._mode.regimes[k].anchored and abs(self._z[place]) <= size:
                self._z[place] = self._above(SWITCHED)
                if self._motion[k] == SWITCHED and not math.isnan(self._speed[k]):
                    self._z[self._half + self._chart.speeds[k]] = 0.0
        for k, motion in enumerate(self._motion[: len(self._oscillator._stops)]):
            if motion != FLIGHT and k in self._chart.places and k not in self._mode.held:
                self._z[self._chart.places[k]] = self._above(motion if self._speed[k] else SWITCHED)
                self._z[self._half + self._chart.speeds[k]] = self._speed[k]

    def _afresh(self) -> None:
        """Take the coordinates with which a run from this state begins.

        They may differ by rounding if some coordinates are redundant.
        """
        soft = any(k >= len(self._oscillator._stops) for k in self._mode.scene.curves)
        carried = self._chart.springs or self._mode.scene.dragged or soft
        for _ in range(_ROUNDS if carried else 0):
            before = self._z
            self._enter(*self._place())
            if (self._z == before).all():
                break

    @property
    def _half(self) -> int:
        """Number of position coordinates, which are followed by as many velocities."""
        return len(self._z) // 2

    def _above(self, motion: int) -> float:
        """Positive value of a zero gap or slip, far larger than changes by rounding errors.

        After a switch, and where the rate is zero, it is relative to the coordinates and to their
        changes over a period, since all coordinates vanish at rest at the origin.
        """
        if motion != SWITCHED:
            return ABOVE
        terms = self._chart.coefficients(self._z, *self._turn)[:, : _TERMS + 1]
        return _RELEASED * float((abs(terms) * self._period ** np.arange(terms.shape[1])).max())

    def _place(self) -> tuple[Array, Array]:
        """Positions, with those of sliders, (N + J,), and velocities (N,)."""
        return self._chart.motion(self._z, *self._turn)

    def _bodies(self) -> tuple[Array, Array]:
        """Positions and velocities (N,)."""
        x, v = self._place()
        return x[: len(v)], v

    def _state(self) -> Array:
        """The state (2, N + J + 1)."""
        return self._mode.state(*self._place(), *self._turn)

    def _disturb(self) -> None:
        """Change all coordinates by pseudo-random parts of themselves, and disturb the phase.

        The parts grow with the number of steps of the last flight, each of which has rounding
        errors.
        """
        if self._noise:
            noise = self._noise * max(1.0, self._steps / _STEPS)
            self._z *= 1.0 + noise * self._random.uniform(-1.0, 1.0, self._z.shape)
            s, c = self._turn
            angle = noise * float(self._random.uniform(-1.0, 1.0))
            self._turn = s + angle * c, c - angle * s

    def _pass(self, duration: float) -> None:
        """Advance the time, in double-double, and the phase by a duration."""
        self._remaining -= duration
        self._longest = max(self._longest, duration)
        total = self._time + duration
        back = total - self._time
        low = self._low + ((self._time - (total - back)) + (duration - back))
        self._time = total + low
        self._low = low - (self._time - total)
        angle = self._frequency * duration
        sine, cosine = math.sin(angle), math.cos(angle)
        s = self._turn[0] * cosine + self._turn[1] * sine
        c = self._turn[1] * cosine - self._turn[0] * sine
        factor = 1.5 - 0.5 * (s * s + c * c)
        self._turn = s * factor, c * factor

    def _onto(self, k: int, x: Array, v: Array, speed: float) -> tuple[Array, Array]:
        """Put positions (N + J,) and velocities (N,) onto an element along a function.

        The gap of a stop becomes zero with the rate `speed`. For friction, only the slip velocity
        is set, and positions stay.
        """
        x, v, scene = x.copy(), v.copy(), self._mode.scene
        place, moving, _ = scene.prescribed(k, *self._turn)
        contact, bodies = CurvedContact(scene.curves[k], len(v)), x[: len(v)]
        if not any(regime.sticks for regime in scene.elements[k].regimes):
            contact.put(bodies, place)
        contact.push(bodies, v, moving + scene.elements[k].sign * speed)
        return x, v

    def _hold(self, k: int, still: Sequence[int]) -> None:
        """Put the state exactly onto a stop that is hit, and stop the slip of friction exactly."""
        curved = [j for j in (k, *still) if j in self._mode.scene.curves]
        if not curved:
            return
        place = self._place()
        for j in (*curved, *curved[:-1]):  # gradients need not be at right angles
            place = self._onto(j, *place, self._speed[k] if j == k else 0.0)
        self._z = self._chart.coordinates(*place, *self._turn)
        self._touch()

    def _again(self, element: int) -> None:
        """After a change of mode at an element, decide again what other elements do.

        Masses may come to rest on stops where they did not before. Slip that began at the same time
        halts where the forces in the new mode would reverse it.
        """
        for k, motion in enumerate(self._motion):
            if motion == BOUNCES and k != element:
                self._motion[k] = BOUNCED
        others = {k for k, motion in enumerate(self._motion) if motion == SWITCHED and k != element}
        for i, (k, watch) in enumerate(self._mode.guards if others else ()):
            if k in others and watch.halts and k in self._chart.speeds and self._falls(i):
                speed = self._above(SWITCHED) * watch.rate
                self._z[self._half + self._chart.speeds[k]] = speed  # the next event halts it

    def _canonical(self, k: int) -> None:
        """Take the coordinates with which a simulation would begin from this state.

        All other elements are in flight there. Element `k` was hit.
        """
        self._motion = [m if j == k else FLIGHT for j, m in enumerate(self._motion)]
        state = self._place()
        self._z = self._chart.coordinates(*state, *self._turn)
        self._mode.settled(self._chart, self._z)
        self._touch()
        self._afresh()

    def _gaps(self) -> dict[int, tuple[float, float]]:
        """Gaps of stops in flight, and their rates; from positions they would have fewer digits."""
        chart, z, held = self._chart, self._z, self._mode.held
        flying = (k for k in chart.places if self._motion[k] == FLIGHT and k not in held)
        return {
            k: (float(z[chart.places[k]]), float(z[self._half + chart.speeds[k]])) for k in flying
        }

    def _keep(self, gaps: dict[int, tuple[float, float]]) -> None:
        """Set these gaps and rates in another mode, for stops that do not hold there."""
        chart = self._chart
        for k, (gap, rate) in gaps.items():
            if k in chart.places and k not in self._mode.held:
                self._z[chart.places[k]], self._z[self._half + chart.speeds[k]] = gap, rate

    def _kick(self, k: int) -> Array | None:
        """Change (N,) of the velocity coordinates by a unit jump of the rate of a gap.

        None if no other velocity coordinate changes.
        """
        if k in self._kicks:
            return self._kicks[k]
        kick: Array | None
        x = self._bodies()[0]
        kick = self._chart.kicked(x, self._mode.kick(k, x, math.atan2(*self._turn)))
        if not np.delete(kick, self._chart.speeds[k]).any():
            kick = None
        if self._mode.constant_kicks:
            self._kicks[k] = kick
        return kick

    def _where(self) -> tuple[Array, float]:
        """Positions (N,) and phase."""
        return self._bodies()[0], math.atan2(*self._turn)

    def _rate_of(self, k: int) -> float:
        """Rate of the gap of a stop."""
        if k in self._chart.places:
            return float(self._z[self._half + self._chart.speeds[k]])
        return float(self._mode.scene.gap(k, *self._bodies(), *self._turn)[1])

    # --- guards that are zero at an event ---------------------------------------------------------

    def _falls(self, i: int) -> bool:
        """Whether a guard that is zero to rounding becomes negative, without a sign change."""
        return self._ahead(i)[0] < 0.0

    def _ahead(self, i: int) -> tuple[float, float]:
        """Value of a guard that is zero to rounding, soon after, and when; zero if it stays so."""
        coefficients = self._chart.coefficients(self._z, *self._turn)
        for part in _AHEAD:
            time = part * self._period
            angle = self._oscillator.frequency * time
            turn = self._turn[0] + angle * self._turn[1], self._turn[1] - angle * self._turn[0]
            z = horner(coefficients, np.array([time]))[0]
            state = self._mode.state(*self._chart.motion(z, *turn), *turn)
            value, band = self._mode.watched(i, state)
            if abs(value) > band:
                return value, time
        return 0.0, time

    def _passes(self, i: int) -> bool:
        """Advance over a zero of a guard until it is clearly positive; not if it falls below."""
        value, time = self._ahead(i)
        if value >= 0.0:
            time = min(time, self._remaining)
            self._z = horner(self._chart.coefficients(self._z, *self._turn), np.array([time]))[0]
            self._mode.settled(self._chart, self._z)
            self._pass(time)
        return value >= 0.0

    def _jumped(self, apart: Sequence[int]) -> int | None:
        """A guard that is negative at a start, or just after an event; None if none.

        Guards of the element of the latest event are tested first: if an element that has just
        halted slips on, others may stick that would not do so if it stuck. Sliders whose springs
        are at their limits slide last, since derivatives need the forces of all other elements.
        """
        state, guards, count = self._state(), self._mode.guards, len(self._motion)
        slides = None
        for i in sorted(range(len(guards)), key=lambda i: (guards[i][0] - self._latest) % count):
            k, watch = guards[i]
            if watch.event not in (SWITCH, JUMP) or self._motion[k] == SWITCHED or k in apart:
                continue
            value, band = self._mode.watched(i, state)
            falls = watch.event == SWITCH and abs(value) <= band and self._falls(i)
            jumps = watch.event == JUMP or k not in self._chart.springs or not watch.rate
            if falls and k in self._chart.springs:
                slides = int(self._first + i) if slides is None else slides
            elif (value < -band and jumps) or falls:  # a slider that halts at a jump still moves
                return int(self._first + i)
        return slides

    def _presses(self, k: int) -> bool:
        """Whether a stop with a zero gap and rate holds, by the sign of the next derivative."""
        found = self._chart.coefficients(self._z, *self._turn)[self._chart.places[k]]
        a, pushes, given = self._mode.balance(self._state())
        x, v = self._bodies()
        row, bend = self._mode.scene.rows_at(x)[k], self._mode.scene.bends(x, v)[k]
        size = float(abs(row) @ abs(a) + abs(bend)) + float(abs(given).max(initial=0.0))
        size += float(abs(pushes).max(initial=0.0))
        drive = self._mode.scene.excitation
        size += float((abs(drive.harmonic) + abs(drive.constant)).sum())
        if abs(found[2]) > ROUNDING * size:
            return bool(found[2] < 0.0)
        w = self._oscillator.frequency
        if abs(found[3]) > ROUNDING * size * (1.0 + w):
            return bool(found[3] < 0.0)
        return True

    def _slow(self, k: int, change: float, stops: bool) -> None:
        """Change the slip velocity of friction by an impulse, which may stop the slip."""
        kick, place = self._kick(k), self._half + self._chart.speeds[k]
        if kick is None:
            self._z[place] += change
        else:
            self._z[self._half :] += change * kick
        self._motion[k] = FLIGHT
        if stops:
            self._z[place] = 0.0

    def _appear(self, before: int) -> None:
        """Where friction no longer holds a mass at an open stop, set the gap to zero, at rest."""
        lain = [
            self._automaton.parts.lain(self._automaton.regimes[m]) for m in (before, self._number)
        ]
        for k, (was, lies) in enumerate(zip(*lain, strict=True)):
            if was and not lies:
                self._motion[k], self._speed[k] = BOUNCED, 0.0

    def _slide(self, before: int, *, halts: bool) -> None:
        """Mark the sliders whose regimes change with the mode; their speed is zero if one halts."""
        regimes = self._automaton.regimes
        for j in self._automaton.parts.sliders:
            if regimes[before][j] != regimes[self._number][j]:
                self._motion[j], self._speed[j] = SWITCHED, 0.0 if halts else math.nan
