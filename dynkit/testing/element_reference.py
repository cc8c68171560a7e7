"""Slow reference motions of a machine with one element: SciPy's integration between guards."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from dynkit.core.validation import Array

# Relative tolerance of the integration; samples of each integration; largest number of events.
_TOLERANCE, _SAMPLES, _MOST = 1e-11, 20, 20
# A guard at an event with a magnitude below this is zero: the difference is error of integration.
_TINY = 1e-9


class SlowMotion:
    """Positions of a machine with a single element, through the regimes of the element.

    The equations are M x'' + C x' + K x = f(t) + J^T F. The force F, towards the side of the
    element, depends on the regime: p - k g - c g', or the force that keeps the gap's rate at zero.

    Attributes
    ----------
    times, positions : (k,), (k, N)
        Samples of the motion, up to the last event that the integration can pass.
    events : list of (float, int)
        Times of the events, and the regimes that begin there.
    """

    def __init__(self, machine: Any) -> None:
        (self.element,) = machine.elements
        self.w, self.n = machine.frequency, machine.degrees_of_freedom
        self.mass, self.damping, self.stiffness = (
            np.asarray(part) for part in (machine.mass, machine.damping_matrix, machine.stiffness)
        )
        self.harmonic = np.array(machine.harmonic_forces or [0j] * self.n)
        self.constant = np.array(machine.constant_forces or [0.0] * self.n)
        self.row = self.element.sign * self.element.row(self.n)
        self._inverse = np.linalg.inv(self.mass)
        self._response = self._inverse @ self.row
        self._kick = self._response / (self.row @ self._response)
        self._turn = 0.0
        self.times, self.positions = np.empty(0), np.empty((0, self.n))
        self.events: list[tuple[float, int]] = []

    def run(self, start: Any) -> Self:
        """Integrate from a state up to the first contact that lasts, or a number of events."""
        from scipy.integrate import solve_ivp

        y = np.concatenate([start.position, start.velocity])
        self._turn, now = start.phase, 0.0
        regime = self._settled(0.0, y, 0)
        period = 2.0 * np.pi / self.w
        times, places = [], []
        while len(self.events) < _MOST and now < 12.0 * period:
            if regime is None or self.element.regimes[regime].holds:
                break
            guards = [g for g in self.element.regimes[regime].guards if not g.at_once]
            watched = [_event(self, regime, guard) for guard in guards]
            # After an event its guard is zero: integrate past the event for a very short time.
            given: Any = {"method": "DOP853", "rtol": _TOLERANCE, "atol": 1e-13}
            first: Any = solve_ivp(self._rate(regime), (now, now + 1e-6 * period), y, **given)
            now, y = float(first.t[-1]), first.y[:, -1]
            found: Any = solve_ivp(
                self._rate(regime),
                (now, now + 2.0 * period),
                y,
                events=watched,
                dense_output=True,
                max_step=0.02 * period,
                **given,
            )
            ends = float(found.t[-1])
            grid = np.linspace(now, ends, _SAMPLES)
            times += grid.tolist()
            places += found.sol(grid)[: self.n].T.tolist()
            now, y = ends, found.y[:, -1].copy()
            hit = [k for k, t in enumerate(found.t_events) if len(t)]
            if found.status == 1 and hit:
                guard = guards[hit[0]]
                regime = self._after(now, y, regime, guard)
                self.events.append((now, -1 if regime is None else regime))
        self.times, self.positions = np.array(times), np.array(places).reshape(-1, self.n)
        return self

    # --- the element ------------------------------------------------------------------------------

    def _phase(self, t: float) -> tuple[float, float]:
        angle = self._turn + self.w * t
        return float(np.sin(angle)), float(np.cos(angle))

    def _seen(self, t: float, y: Array) -> tuple[float, float]:
        """Return the gap and its rate."""
        element, (sine, cosine) = self.element, self._phase(t)
        place = element.offset + element.swing(sine, cosine)
        speed = element.drift + element.swing_rate(self.w, sine, cosine)
        x, v = y[: self.n], y[self.n :]
        return float(self.row @ x - element.sign * place), float(
            self.row @ v - element.sign * speed
        )

    def _force(self, t: float, y: Array, regime: int) -> float:
        """Return the force towards the side of the element."""
        doing = self.element.regimes[regime]
        if doing.holds or doing.sticks:
            sine, cosine = self._phase(t)
            own = -(self.w**2) * self.element.sign * self.element.swing(sine, cosine)
            free = float(self._response @ self._others(t, y))
            return float((own - free) / (self.row @ self._response))
        gap, rate = self._seen(t, y)
        return float(doing.push - doing.stiffness * gap - doing.damping * rate)

    def watched(self, t: float, y: Array, regime: int, guard: Any) -> float:
        """Return the value of a guard: its combination of gap, rate, force and level."""
        gap, rate = self._seen(t, y)
        force = self._force(t, y, regime) if guard.force else 0.0
        return float(guard.gap * gap + guard.rate * rate + guard.force * force + guard.level)

    def _others(self, t: float, y: Array) -> Array:
        """Return all forces but that of the element, (N,)."""
        sine, cosine = self._phase(t)
        outer = self.harmonic.real * sine + self.harmonic.imag * cosine + self.constant
        x, v = y[: self.n], y[self.n :]
        return np.asarray(outer - self.stiffness @ x - self.damping @ v)

    def _rate(self, regime: int) -> Any:
        def rate(t: float, y: Array) -> Array:
            own = self._force(t, y, regime) * self._response
            others = self._inverse @ self._others(t, y)
            return np.concatenate([y[self.n :], others + own])

        return rate

    def _after(self, t: float, y: Array, regime: int, guard: Any) -> int | None:
        """Return the regime that follows a zero of a guard; the state is modified in place.

        None where the integration ends, as for a chatter.
        """
        rate = self._seen(t, y)[1]
        if guard.hits:
            y[self.n :] -= (1.0 + self.element.restitution) * rate * self._kick
            return regime if abs(rate) > 1e-4 else None
        if self.element.regimes[guard.to].sticks:
            y[self.n :] -= rate * self._kick
        return self._settled(t, y, guard.to)

    def _settled(self, t: float, y: Array, regime: int) -> int | None:
        """Return the regime, followed from the given one, in which no guard is negative.

        None where there is no such regime.
        """
        for _ in range(2 * len(self.element.regimes)):
            for guard in self.element.regimes[regime].guards:
                if guard.hits or guard.halts:
                    continue
                if self.watched(t, y, regime, guard) < -_TINY:
                    regime = guard.to
                    break
            else:
                return regime
        return None


def _event(motion: SlowMotion, regime: int, guard: Any) -> Any:
    def event(t: float, y: Array) -> float:
        return motion.watched(t, y, regime, guard)

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    return event
