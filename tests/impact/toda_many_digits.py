"""Toda's chain above a table in many digits: Taylor series by recurrences, and Newton's law."""

from __future__ import annotations

from typing import Any

import mpmath as mp

_ORDER, _STEP = 24, "0.125"


class ManyDigits:
    """Impacts of a chain of unit masses and springs, in the digits that mpmath is set to."""

    def __init__(
        self, masses: int, frequency: float, damping: float, amplitude: float, restitution: float
    ) -> None:
        self.n, self.w, self.c = masses, mp.mpf(frequency), mp.mpf(damping)
        self.a, self.r = mp.mpf(amplitude), mp.mpf(restitution)

    def series(self, x: list[Any], v: list[Any]) -> list[list[Any]]:
        """Taylor coefficients of the positions."""
        n = self.n
        places, speeds = [[value] for value in x], [[value] for value in v]
        pulls: list[list[Any]] = [[mp.exp(x[i] - (x[i - 1] if i else 0))] for i in range(n)]
        for k in range(_ORDER):
            force = []
            for i in range(n):
                stretch = speeds[i][k] - (speeds[i - 1][k] if i else 0)
                force.append(pulls[i][k] - (1 if k == 0 else 0) + self.c * stretch)
            for i in range(n):
                total = (force[i + 1] if i + 1 < n else 0) - force[i]
                speeds[i].append(total / (k + 1))
                places[i].append(speeds[i][k] / (k + 1))
            for i in range(n):
                stretch = [
                    places[i][j] - (places[i - 1][j] if i else 0) for j in range(len(places[i]))
                ]
                total = sum(
                    (j * stretch[j] * pulls[i][k + 1 - j] for j in range(1, k + 2)), mp.mpf(0)
                )
                pulls[i].append(total / (k + 1))
        return places

    def next_impact(self, state: Any) -> list[Any]:
        """Section coordinates (2N,) of the next impact, and last the time, after those of one."""
        n = self.n
        state = [mp.mpf(value) for value in state]
        phase, u = state[-1], state[-2]
        x = [*state[: n - 1], self.a * mp.sin(phase)]
        v = [*state[n - 1 : 2 * n - 2], u + self.a * self.w * mp.cos(phase)]
        time, step, first = mp.mpf(0), mp.mpf(_STEP), True
        while True:
            places = self.series(x, v)

            def at(s: Any, i: int, given: Any = places) -> tuple[Any, Any]:
                found: tuple[Any, Any] = mp.polyval(given[i][::-1], s, derivative=1)
                return found

            def gap(s: Any, given: Any = at, begin: Any = time) -> tuple[Any, Any]:
                place, speed = given(s, n - 1)
                angle = phase + self.w * (begin + s)
                return place - self.a * mp.sin(angle), speed - self.a * self.w * mp.cos(angle)

            root = self._root(gap, step, first)
            if root is not None:
                values = [at(root, i) for i in range(n)]
                u = -self.r * gap(root)[1]
                kept = [p for p, _ in values[:-1]] + [q for _, q in values[:-1]]
                return [*kept, u, phase + self.w * (time + root), time + root]
            x, v = (list(part) for part in zip(*(at(step, i) for i in range(n)), strict=True))
            time, first = time + step, False

    @staticmethod
    def _root(gap: Any, step: Any, first: bool) -> Any:
        """The first zero of a gap within a step, by fine bisection and Newton's method."""
        pieces = 4
        for k in range(pieces):
            low, high = step * k / pieces, step * (k + 1) / pieces
            if (k or not first) and gap(low)[0] > 0 and gap(high)[0] <= 0:
                for _ in range(20):
                    middle = (low + high) / 2
                    low, high = (middle, high) if gap(middle)[0] > 0 else (low, middle)
                root = (low + high) / 2
                for _ in range(5):
                    value, rate = gap(root)
                    root -= value / rate
                return root
        return None


def run(chain: ManyDigits, state: Any, count: int) -> list[list[Any]]:
    """Section coordinates of impacts, and the time of the flight before each of them."""
    found = []
    for _ in range(count):
        found.append(chain.next_impact(state))
        state = found[-1][:-1]
    return found
