"""Periodic orbits of one mass above a table from a dense grid of starts, in plain NumPy.

x'' + c x' + k x = 0 between impacts with the table A sin(phase), in closed form. The state is the
relative velocity u and the phase just after an impact. Of dynkit only the chain's numbers are used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynkit.systems import ImpactChain

Array = NDArray[np.float64]
TWO_PI = 2.0 * np.pi
# The gap is looked at so often in a period of the table, and its first zero is bisected so often.
_SAMPLES, _BISECTIONS = 200, 50
_STEPS, _CONVERGED, _SAME = 25, 1e-11, 1e-7


class Mass(NamedTuple):
    """Damping c, stiffness k, restitution r, amplitude A and frequency w of the table."""

    c: float
    k: float
    r: float
    a: float
    w: float

    @staticmethod
    def of(chain: ImpactChain) -> Mass:
        """The numbers of a chain of one mass."""
        c, k = float(chain.damping_matrix[0, 0]), float(chain.stiffness[0, 0])
        return Mass(c, k, chain.restitution, chain.amplitude, chain.frequency)

    def flow(self, t: Array) -> Array:
        """Transition matrices, (..., 2, 2), of place and velocity."""
        h = 0.5 * self.c
        s = np.sqrt(self.k - h * h)
        cosine, sine, decay = np.cos(s * t), np.sin(s * t) / s, np.exp(-h * t)
        rows = [[cosine + h * sine, sine], [-self.k * sine, cosine - h * sine]]
        return np.asarray(decay[..., None, None] * np.moveaxis(np.array(rows), (0, 1), (-2, -1)))

    def after(self, z: Array, t: Array) -> tuple[Array, Array, Array]:
        """Gap, its rate and its second derivative at times t (K,) after impacts z (K, 2)."""
        u, phase = z.T
        turn = phase + self.w * t
        start = np.stack([self.a * np.sin(phase), u + self.a * self.w * np.cos(phase)], axis=-1)
        x, v = np.einsum("...ij,...j->i...", self.flow(t), start)
        gap = x - self.a * np.sin(turn)
        rate = v - self.a * self.w * np.cos(turn)
        return gap, rate, -self.c * v - self.k * x + self.a * self.w**2 * np.sin(turn)

    def next(self, z: Array, periods: int) -> tuple[Array, Array]:
        """Next impacts (K, 2), phases not wrapped, and derivatives (K, 2, 2).

        NaN where there is none within so many periods of the table.
        """
        dt = TWO_PI / self.w / _SAMPLES
        low, high = np.zeros(len(z)), np.full(len(z), np.nan)
        for i in range(1, periods * _SAMPLES + 1):
            gap, *_ = self.after(z, np.array(i * dt))
            hit = np.isnan(high) & (gap < 0.0)
            high[hit], low[hit] = i * dt, (i - 1) * dt
            if not np.isnan(high).any():
                break
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            below = self.after(z, middle)[0] < 0.0
            low, high = np.where(below, low, middle), np.where(below, middle, high)
        _, rate, second = self.after(z, high)
        after = np.stack([-self.r * rate, z[:, 1] + self.w * high], axis=-1)
        # derivatives at a fixed time, then by the time at which the gap is zero
        first, turn = z[:, 1], after[:, 1]
        zero, one = np.zeros(len(z)), np.ones(len(z))
        by = np.array(
            [
                [zero, self.a * np.cos(first)],
                [one, -self.a * self.w * np.sin(first)],
            ]
        )
        moved = self.flow(high) @ np.moveaxis(by, -1, 0)
        moved[:, 0, 1] -= self.a * np.cos(turn)
        moved[:, 1, 1] += self.a * self.w * np.sin(turn)
        later = -moved[:, 0] / rate[:, None]
        speeds = -self.r * (moved[:, 1] + second[:, None] * later)
        phases = self.w * later + np.array([0.0, 1.0])
        return after, np.stack([speeds, phases], axis=1)

    def iterated(self, z: Array, impacts: int, periods: int) -> tuple[Array, Array, Array]:
        """States (K, n + 1, 2), derivatives (K, 2, 2) of the last, and smallest velocities (K,)."""
        states, slope = [z], np.broadcast_to(np.eye(2), (len(z), 2, 2))
        for _ in range(impacts):
            z, by = self.next(z, periods)
            slope = by @ slope
            states.append(z)
        path = np.stack(states, axis=1)
        return path, slope, path[:, :, 0].min(axis=1)


def brute_force(
    mass: Mass, impacts: int, periods: int, fastest: float, grid: tuple[int, int]
) -> dict[tuple[int, int], list[Array]]:
    """States (n, 2) of orbits P(n,m), phases in [0, 2 pi), that Newton's method finds.

    Parameters
    ----------
    mass : Mass
    impacts, periods : int
        The largest n and m.
    fastest : float
        Largest relative velocity of a start.
    grid : (int, int)
        How many velocities and phases.
    """
    speeds = fastest * (np.arange(grid[0]) + 0.5) / grid[0]
    phases = TWO_PI * (np.arange(grid[1]) + 0.5) / grid[1]
    starts = np.stack(np.meshgrid(speeds, phases), axis=-1).reshape(-1, 2)
    found: dict[tuple[int, int], list[Array]] = {}
    with np.errstate(all="ignore"):
        for n in range(1, impacts + 1):
            for path in _converged(mass, starts, n, periods):
                _keep(found, path, n, periods)
    return found


def _converged(mass: Mass, starts: Array, n: int, periods: int) -> Array:
    z = starts
    for _ in range(_STEPS):
        path, slope, slowest = mass.iterated(z, n, periods)
        gap = path[:, -1] - z
        gap[:, 1] -= TWO_PI * np.rint(gap[:, 1] / TWO_PI)
        good = np.isfinite(gap).all(axis=1) & np.isfinite(slope).all(axis=(1, 2)) & (slowest > 0.0)
        z, gap, slope = z[good], gap[good], slope[good]
        done = (abs(gap) <= _CONVERGED).all(axis=1)
        if not len(z) or done.all():
            break
        slope = slope - np.eye(2)
        # by Cramer's rule: a singular matrix gives infinity, not an exception
        (a, b), (c, d) = np.moveaxis(slope, 0, -1)
        step = np.stack([b * gap[:, 1] - d * gap[:, 0], c * gap[:, 0] - a * gap[:, 1]], axis=-1)
        z = z + step / (a * d - b * c)[:, None]
    path, *_ = mass.iterated(z, n, periods)
    gap = path[:, -1] - z
    gap[:, 1] -= TWO_PI * np.rint(gap[:, 1] / TWO_PI)
    return path[(abs(gap) <= 10.0 * _CONVERGED).all(axis=1)]


def _keep(found: dict[tuple[int, int], list[Array]], path: Array, n: int, periods: int) -> None:
    m = round((path[-1, 1] - path[0, 1]) / TWO_PI)
    states = path[:-1].copy()
    states[:, 1] %= TWO_PI
    if not 1 <= m <= periods or any(near(states[0], state) for state in states[1:]):
        return
    known = found.setdefault((n, m), [])
    if not any(near(states[0], state) for orbit in known for state in orbit):
        known.append(states)


def near(a: Array, b: Array) -> bool:
    """Whether two states are one."""
    turn = (a[1] - b[1] + np.pi) % TWO_PI - np.pi
    return bool(max(abs(a[0] - b[0]), abs(turn)) < _SAME)
