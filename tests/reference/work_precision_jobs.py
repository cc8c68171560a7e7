"""Writes the standard jobs of error against run time: starts, and their impacts to 30 digits.

python -m tests.reference.work_precision_jobs

Source: `impact_chain` and `general_oscillator`, every impact proved in interval arithmetic. Starts
are numbers of four decimals: of the motion that the job is named after, or random ones.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import mpmath
import numpy as np
from mpmath import mp, mpf
from scipy.linalg import eigh

from tests.reference.brute_force import chain_matrices
from tests.reference.extremes import ExtremeCase
from tests.reference.general_oscillator import BITS, History, Impact

FILE: Final = Path(__file__).parents[1] / "benchmarks" / "work_precision" / "jobs.json"
DIGITS: Final = 30
DISTURBANCE: Final = mpf("1e-20")
"""Relative, of the start: by it the conditioning is found."""

BOUNCE: Final = 0.01
"""Part of the period: impacts that come sooner after the one before are the depth of a chatter."""

DIPS: Final = 100
LEAST, MOST = 1e-9, 1e-3
"""How deep the first dips of near-grazing starts are, or by how much they miss."""

ABOUT: Final = (
    "The standard jobs of error against run time and their exact impacts, written by "
    "tests/reference/work_precision_jobs.py. Numbers of systems and starts are doubles; those of "
    f"impacts have {DIGITS} digits, from proved roots in 50-digit arithmetic."
)


@dataclass(frozen=True)
class Start:
    """A chain, where it starts, up to when, and which coordinates are written (all by default)."""

    job: str
    case: ExtremeCase
    until: float
    coordinates: tuple[int, ...] = ()

    @property
    def period(self) -> float:
        return 2.0 * math.pi / self.case.frequency

    def simulate(self, disturbance: Any = 0, seed: int = 0) -> History:
        """The motion to beyond ``until``, from a start that is relatively disturbed."""
        signs = random.Random(seed)
        with mp.workprec(BITS):
            parts = [[mpf(x) for x in part] for part in (self.case.position, self.case.velocity)]
            sizes = [max(map(abs, part)) for part in parts]
            moved = [
                tuple(x + signs.choice((-1, 1)) * disturbance * size for x in part)
                for part, size in zip(parts, sizes, strict=True)
            ]
        count = 4
        while True:
            found = replace(
                self.case, position=moved[0], velocity=moved[1], impacts=count
            ).simulate()
            if found.ending != "count" or found.impacts[-1].time > self.until:
                return found
            count *= 2


# --- the jobs -------------------------------------------------------------------------------------


def chain(name: str, position: Any, velocity: Any, **arguments: Any) -> ExtremeCase:
    n = len(position)
    return ExtremeCase(
        name, (1.0,) * n, arguments.pop("springs", (1.0,) * n), tuple(position), tuple(velocity),
        **arguments,
    )  # fmt: skip


@cache
def starts() -> tuple[Start, ...]:
    """All starts, job by job."""
    ten = [round(0.09 * i, 2) for i in range(1, 11)]
    rest = [0.0] * 10
    far = [round(0.3 + 0.6 * i / 99, 4) for i in range(100)]
    return (
        Start("periodic", chain(
            "P(1,3)",
            [-0.0017, 0.0017, 0.0016, -0.0023, -0.0012, 0.0027, -0.0076, -0.0339, -0.0193, 0.1665],
            [-0.0004, -0.0021, 0.0031, 0.003, -0.0067, -0.0087, -0.0047, 0.0012, 0.0804, 0.0948],
            frequency=0.87, phase=0.7636,
        ), 225.0),
        Start("chaos", chain(
            "chaos",
            [0.0081, 0.0117, 0.0104, 0.0065, 0.0024, 0.0004, 0.0063, 0.0318, 0.071, 0.1095],
            [-0.0052, -0.0047, 0.0006, 0.0057, 0.0092, 0.0116, 0.017, 0.0218, 0.0079, -0.0104],
            frequency=0.35, phase=1.8177,
        ), 212.0),
        Start("chatter", chain(
            "chatter",
            [0.0795, 0.1587, 0.2421, 0.3368, 0.4444, 0.555, 0.6556, 0.7409, 0.8045, 0.8384],
            [-0.0533, -0.0916, -0.1014, -0.0784, -0.0355, 0.0074, 0.0454, 0.0782, 0.1004, 0.112],
            frequency=0.408, phase=5.9256,
        ), 77.0),
        Start("damping", chain(
            "damping 1e4", [round(0.005 * i, 3) for i in range(1, 11)], rest,
            frequency=0.87, phase=3.1416, damping=1e4,
        ), 9.0),
        Start("stiffness", chain(
            "stiffness ratio 1e8", ten, rest, frequency=0.87,
            springs=(1.0,) * 4 + (1e8,) + (1.0,) * 5,
        ), 60.0),
        Start("size", chain(
            "N = 100", far, [0.0] * 99 + [-1.0], frequency=0.87,
        ), 240.0, tuple(range(0, 100, 11))),
        *near_grazing(),
    )  # fmt: skip


def near_grazing() -> Iterator[Start]:
    """Starts whose first dip is a little too deep, or not quite deep enough, in pairs of depths."""
    noise = random.Random(1)
    n, w, amplitude = 10, 0.87, 0.1
    mass, damper, stiffness = chain_matrices(np.ones(n), np.ones(n), 0.1)
    squares, shape = eigh(stiffness, mass)
    decay = 0.5 * np.diagonal(shape.T @ damper @ shape)
    turn = np.sqrt(squares - decay * decay)

    def gap(position: Any, velocity: Any, t: Any) -> Any:
        q, dq = shape.T @ position, shape.T @ velocity
        angle = np.multiply.outer(t, turn)
        parts = q * np.cos(angle) + (dq + decay * q) / turn * np.sin(angle)
        tip = (np.exp(-np.multiply.outer(t, decay)) * parts) @ shape[-1]
        return tip - amplitude * np.sin(w * t)

    grid = np.linspace(0.0, 9.0, 901)
    depths = np.geomspace(LEAST, MOST, DIPS)
    signed = [sign * float(depth) for depth in depths for sign in (1.0, -1.0)]
    while signed:
        position, velocity = ([round(noise.gauss(0.0, 0.3), 4) for _ in range(n)] for _ in "xv")
        sampled = gap(position, velocity, grid)
        k = int(np.argmin(sampled))
        if not 50 < k < 801:
            continue
        near = np.linspace(grid[k] - 0.01, grid[k] + 0.01, 4001)
        lowest = gap(position, velocity, near)
        depth = signed.pop(0)
        at, offset = float(near[np.argmin(lowest)]), float(lowest.min()) + depth
        case = chain("near grazing", position, velocity, frequency=w, offset=offset)
        yield Start("grazing", case, at + 0.5, (0, n - 1))


# --- what is written ------------------------------------------------------------------------------


def entry_of(start: Start) -> dict[str, Any]:
    """The entry of a start, with its exact impacts and their conditioning computed anew."""
    history = start.simulate()
    until, _, kept = _compared(history, start)
    releases = [c.release for c in history.contacts if c.release <= until]
    return {**values_of(start), "conditioning": _conditioning(start, history, kept, releases)}


def values_of(start: Start) -> dict[str, Any]:
    """The same without the conditioning, which takes two more simulations."""
    case, history = start.case, start.simulate()
    until, intervals, kept = _compared(history, start)
    chosen = list(start.coordinates) or list(range(len(case.position)))
    releases = [c.release for c in history.contacts if c.release <= until]
    arguments = {
        "masses": len(case.masses),
        "springs": 1.0 if set(case.springs) == {1.0} else list(case.springs),
        "damping": case.damping,
        "restitution": case.restitution,
        "amplitude": case.amplitude,
        "offset": case.offset,
        "frequency": case.frequency,
    }
    with mp.workprec(BITS):
        return {
            "job": start.job,
            "system": arguments,
            "position": list(case.position),
            "velocity": list(case.velocity),
            "phase": case.phase,
            "until": until,
            "coordinates": chosen,
            "times": [_text(impact.time) for impact in kept],
            "positions": [[_text(impact.position[i]) for i in chosen] for impact in kept],
            "velocities": [[_text(impact.velocity[i]) for i in chosen] for impact in kept],
            "releases": [_text(release) for release in releases],
            "chatters": intervals,
        }


def write(path: Path = FILE) -> None:
    """Write the file, one start a line."""
    lines = ",\n".join(json.dumps(entry_of(start)) for start in starts())
    path.write_text(f'{{"about": {json.dumps(ABOUT)},\n"starts": [\n{lines}\n]}}\n')


def _text(x: Any) -> str:
    return str(mpmath.nstr(x, DIGITS))


def _compared(history: History, start: Start) -> tuple[float, list[list[float]], list[Impact]]:
    """Up to when impacts are compared, the intervals in which they are not, and those that are.

    The end lies midway between two events; so does the beginning of an interval, which ends at a
    release.
    """
    times = [float(impact.time) for impact in history.impacts]
    releases = [float(c.release) for c in history.contacts if c.release != mpmath.inf]
    events = sorted([0.0, *times, *releases])
    last = max(t for t in events if t <= start.until)
    later = [t for t in events if t > start.until]
    until = start.until if start.job == "grazing" else 0.5 * (last + min(later))
    contacts = [(float(c.start), float(c.release)) for c in history.contacts]
    intervals, hidden = [], set()
    for begin, release in contacts:
        deep = [
            i
            for i in range(1, len(times))
            if times[i] <= begin and times[i] - times[i - 1] < BOUNCE * start.period
            and not any(times[i - 1] < other <= times[i] for other in releases)
            and all(t >= release or t <= begin for t in times[i:])
        ]  # fmt: skip
        # those of this chatter: in a row, up to its end
        row: list[int] = []
        for i in reversed(deep):
            if not row or i == row[-1] - 1:
                row.append(i)
        if row and times[row[-1] - 1] < until:
            first = row[-1]
            intervals.append([0.5 * (times[first - 1] + times[first]), release])
            hidden.update(row)
    kept = [p for i, p in enumerate(history.impacts) if i not in hidden and times[i] <= until]
    return until, intervals, kept


def _conditioning(start: Start, history: History, kept: list[Impact], releases: list[Any]) -> float:
    """How many times a relative disturbance of the start is found in the errors, to two digits."""
    if not kept:
        return 1.0
    places = [history.impacts.index(impact) for impact in kept]
    sizes = [
        max(abs(x) for impact in kept for x in getattr(impact, name)) or mpf(1)
        for name in ("position", "velocity")
    ]
    worst = mpf(0)
    for seed in (1, 2):
        other = start.simulate(DISTURBANCE, seed)
        if start.job != "grazing" and history.contacts:
            # bounces in the depth of a chatter may be one more or one less
            places = [_nearest(other, impact) for impact in kept]
        for impact, place in zip(kept, places, strict=True):
            beside = other.impacts[place]
            off = [abs(impact.time - beside.time) / start.period]
            for name, size in zip(("position", "velocity"), sizes, strict=True):
                pairs = zip(getattr(impact, name), getattr(beside, name), strict=True)
                off += [abs(a - b) / size for a, b in pairs]
            worst = max(worst, *off)
        for release, contact in zip(releases, other.contacts, strict=False):
            worst = max(worst, abs(release - contact.release) / start.period)
    return float(f"{float(worst / DISTURBANCE):.1e}")


def _nearest(history: History, impact: Impact) -> int:
    return min(
        range(len(history.impacts)), key=lambda i: abs(history.impacts[i].time - impact.time)
    )


if __name__ == "__main__":
    write()
