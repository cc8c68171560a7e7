"""Random impact oscillators, and their impacts to 50 digits, kept in `random_cases.npz`.

python -m tests.reference.random_cases

A case is made of its number alone, by Python's own generator, whose numbers are the same
everywhere; every number of it is rounded to a few digits, so that no last digit of a library
matters. Structures are networks of 1 to 10 masses: springs and dashpots between any two and to the
ground, masses that are coupled, weights, harmonic forces; contact anywhere, from either side, with
one stop or two; restitutions from 0 to 1; frequencies over three decades. A third of the starts is
just before a grazing impact, or on the table.
"""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Final

import mpmath
import numpy as np
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.simulation.state import ImpactState
from tests.reference.general_oscillator import GeneralOscillator, History

FILE: Final = Path(__file__).with_name("random_cases.npz")
CASES: Final = 3150
STARTS: Final = 4
KEPT: Final = 3
"""Impacts that are kept of a case, the last one among them."""

BITS: Final = 320
STICK_BELOW: Final = "1e-20"
SECONDS: Final = 10
ISOLATED, SLOWEST = 3e-4, mpf("1e-4")
"""Impacts are kept so far from the one before, as a part of the mean distance, and so fast."""

Matrix = list[list[float]]


@dataclass(frozen=True)
class RandomCase:
    """Arguments of a `MatrixOscillator`, and a start; on the table with `u` where it is given."""

    number: int
    arguments: dict[str, Any]
    position: list[float]
    velocity: list[float]
    phase: float
    u: float | None
    impacts: int

    def system(self) -> MatrixOscillator:
        return MatrixOscillator(**self.arguments)

    def start(self, system: MatrixOscillator) -> ImpactState:
        if self.u is None:
            return system.state(self.position, self.velocity, self.phase)
        others = [i for i in range(len(self.position)) if i != self.arguments["contact"]]
        y = [self.position[i] for i in others] + [self.velocity[i] for i in others]
        return system.impact_state(np.array([*y, self.u, self.phase]))

    def exact(self, bits: int = BITS) -> History:
        """Its impacts to 50 digits.

        Raises
        ------
        ArithmeticError
            When so many bits do not tell whether it grazes.
        """
        a = self.arguments
        sign = 1 if a["side"] == "above" else -1
        far = None if a["play"] == math.inf else a["offset"] + sign * a["play"]
        return GeneralOscillator(
            a["M"],
            a["C"],
            a["K"],
            a["frequency"],
            a["restitution"],
            a["amplitude"],
            a["offset"],
            contact=a["contact"],
            side=a["side"],
            harmonic_forces=a["harmonic_forces"],
            constant_forces=a["constant_forces"],
            far_stop=far,
            bits=bits,
            stick_below=STICK_BELOW,
        ).simulate(self.position, self.velocity, self.phase, self.impacts, relative_velocity=self.u)


# --- how cases are made ---------------------------------------------------------------------------


def random_case(number: int) -> RandomCase:
    """The case of this number; `STARTS` in a row are of the same oscillator."""
    random = Random(number // STARTS)
    n = random.choice((1, 1, 2, 2, 3, 3, 4, 5, 7, 10))
    loose = n > 1 and random.random() < 0.1
    mass, damping, stiffness = _structure(random, n, loose=loose)
    contact, side = random.randrange(n), random.choice(("above", "below"))
    sign = 1.0 if side == "above" else -1.0
    amplitude = 0.0 if random.random() < 0.15 else _decades(random, -1.5, 0.3)
    weights = [0.0] * n
    if loose or random.random() < 0.3:
        weights = [-sign * _decades(random, -1.5, 0.0) for _ in range(n)]
    forces = [0j] * n
    if random.random() < 0.4:
        forces = [complex(_normal(random), _normal(random)) for _ in range(n)]
    restitution = random.choice((0.0, 1.0, 0.85, 0.5, few(random.random()), few(random.random())))
    arguments = {
        "M": mass,
        "C": damping,
        "K": stiffness,
        "frequency": _decades(random, -1.3, 1.5),
        "restitution": restitution,
        "amplitude": amplitude,
        "offset": few(0.3 * _normal(random)),
        "contact": contact,
        "side": side,
        "play": few(random.uniform(0.3, 3.0)) if random.random() < 0.25 else math.inf,
        "harmonic_forces": forces,
        "constant_forces": weights,
    }
    impacts = 40 if restitution < 0.3 else 12
    if 0.3 <= restitution <= 0.6 and random.random() < 0.15:
        impacts = 100
    return _started(Random(4000 + number), number, arguments, impacts)


def _started(random: Random, number: int, arguments: dict[str, Any], impacts: int) -> RandomCase:
    n, c = len(arguments["M"]), arguments["contact"]
    w, amplitude = arguments["frequency"], arguments["amplitude"]
    sign = 1.0 if arguments["side"] == "above" else -1.0
    position = [few(0.5 * _normal(random)) for _ in range(n)]
    velocity = [few(0.5 * _normal(random)) for _ in range(n)]
    phase = few(random.uniform(0.0, 6.28))
    table = amplitude * math.sin(phase) + arguments["offset"]
    kind = random.random()
    if kind < 0.12:
        u = few(random.choice((0.0, 1.0, 1.0)) * _decades(random, -3.0, 0.0))
        return RandomCase(number, arguments, position, velocity, phase, u, impacts)
    gap = few(min(1e-3 + 0.5 * abs(_normal(random)), 0.7 * arguments["play"]))
    if kind < 0.35:  # a gap, and a rate at which it nearly closes
        gap = _decades(random, -6.0, -2.0)
        acceleration = _acceleration(arguments, [*position], [*velocity], phase, table) * sign
        rate = math.sqrt(2.0 * gap * abs(acceleration)) * (1.0 + _near(random))
        velocity[c] = amplitude * w * math.cos(phase) - sign * rate
    # so that the same doubles are found everywhere
    position[c], velocity[c] = grid(table + sign * gap, 40), grid(velocity[c], 40)
    return RandomCase(number, arguments, position, velocity, phase, None, impacts)


def _structure(random: Random, n: int, *, loose: bool) -> tuple[Matrix, Matrix, Matrix]:
    """Mass, damping and stiffness of a network that hangs together, held or not; sums are exact."""
    spread = random.choice((0.0, 0.0, 0.3, 0.8))
    links = [(i, random.randrange(i) if i else n) for i in range(n)]
    links += [
        (random.randrange(n), random.randrange(n + 1)) for _ in range(n) if random.random() < 0.3
    ]
    if loose:
        links = [(i, j) for i, j in links if j < n]
    mass = [[0.0] * n for _ in range(n)]
    for i in range(n):
        mass[i][i] = grid(_decades(random, -spread, spread))
    springs = [grid(_decades(random, -spread, spread)) for _ in links]
    stiffness = network(links, springs, n)
    if random.random() < 0.2:  # a body whose inertia couples its coordinates
        heavy = [grid(_decades(random, -1.5, 0.0)) if j < n else 0.0 for _, j in links]
        mass = _sum(mass, network(links, heavy, n))
    kind = random.choice(("none", "springs", "springs", "dashpots", "few"))
    size = grid(_decades(random, -3.3, 0.0))
    if kind == "none":
        damping = [[0.0] * n for _ in range(n)]
    elif kind == "springs":
        damping = [[size * k for k in row] for row in stiffness]
    else:
        part = 1.0 if kind == "dashpots" else 0.4
        dashpots = [size * grid(random.random()) * (random.random() < part) for _ in links]
        damping = network(links, dashpots, n)
    return mass, damping, stiffness


def network(links: list[tuple[int, int]], values: list[float], n: int) -> Matrix:
    """Of elements between two coordinates, or one and the ground, n."""
    matrix = [[0.0] * n for _ in range(n)]
    for (i, j), value in zip(links, values, strict=True):
        if i == j:
            continue
        matrix[i][i] += value
        if j < n:
            matrix[j][j] += value
            matrix[i][j] -= value
            matrix[j][i] -= value
    return matrix


def _sum(a: Matrix, b: Matrix) -> Matrix:
    return [[x + y for x, y in zip(p, q, strict=True)] for p, q in zip(a, b, strict=True)]


def _acceleration(
    arguments: dict[str, Any], x: list[float], v: list[float], phase: float, table: float
) -> float:
    """Of the gap, but for its sign, about."""
    mass, c = np.array(arguments["M"]), arguments["contact"]
    x[c] = table
    v[c] = arguments["amplitude"] * arguments["frequency"] * math.cos(phase)
    turn = complex(math.cos(phase), math.sin(phase))
    force = (np.array(arguments["harmonic_forces"]) * turn).imag + arguments["constant_forces"]
    force -= np.array(arguments["C"]) @ v + np.array(arguments["K"]) @ x
    own: float = np.linalg.solve(mass, force)[c].item()
    return own + float(arguments["amplitude"] * arguments["frequency"] ** 2 * math.sin(phase))


def _near(random: Random) -> float:
    exponent = random.uniform(-7.0, -0.5)
    return float(random.choice((1.0, -1.0)) * math.pow(10.0, exponent))


def _normal(random: Random) -> float:
    return few(sum(random.random() for _ in range(12)) - 6.0)


def _decades(random: Random, low: float, high: float) -> float:
    return few(10.0 ** random.uniform(low, high))


def few(x: float) -> float:
    """Rounded to six digits."""
    return float(f"{x:.6g}")


def grid(x: float, bits: int = 12) -> float:
    """Rounded to a multiple of 2^-bits: sums of a few are exact."""
    return float(round(x * 2.0**bits) / 2.0**bits)


# --- what is kept of their motions ----------------------------------------------------------------


@dataclass(frozen=True)
class Kept:
    """Exact impacts of cases: time and section coordinates as sums of two numbers, 23 digits.

    Attributes
    ----------
    number, after, place : (k,) arrays of int
        The case; after how many releases, and the how manieth impact since the last of them.
    begins : (k,) array of int
        Where the time, and then the section coordinates, stand in the next two.
    high, low : (m,) arrays
    """

    number: Any
    after: Any
    place: Any
    begins: Any
    high: Any
    low: Any

    @staticmethod
    def of(rows: list[tuple[int, int, int, list[Any]]]) -> Kept:
        numbers = [x for row in rows for x in row[3]]
        with mp.workprec(BITS):
            high = np.array([float(x) for x in numbers])
            low = [float(x - mpf(h)) for x, h in zip(numbers, high.tolist(), strict=True)]
        number, after, place = np.array([row[:3] for row in rows], dtype=np.int32).reshape(-1, 3).T
        begins = np.cumsum([0, *(len(row[3]) for row in rows[:-1])], dtype=np.int32)
        return Kept(number, after, place, begins, high, np.array(low, dtype=np.float32))

    @staticmethod
    def load(path: Path = FILE) -> Kept:
        with np.load(path) as file:
            return Kept(**{name: file[name] for name in Kept.__annotations__})

    def save(self, path: Path = FILE) -> None:
        np.savez_compressed(path, **{name: getattr(self, name) for name in Kept.__annotations__})

    def numbers(self, row: int) -> tuple[Array, Array]:
        """Time and section coordinates of a row, their high and low parts, (2N + 1,)."""
        end = self.begins[row + 1] if row + 1 < len(self.begins) else len(self.high)
        part = slice(self.begins[row], end)
        return self.high[part], self.low[part].astype(np.float64)


def rows_of(number: int) -> list[tuple[int, int, int, list[Any]]]:
    """What is kept of a case: up to `KEPT` impacts, none in the depth of a chatter."""
    case = random_case(number)
    try:
        history = case.exact()
    except ArithmeticError:
        history = case.exact(2 * BITS)
    c = case.arguments["contact"]
    rows = []
    for i, after, place in chosen(history, on_table=case.u is not None):
        impact = history.impacts[i]
        others = [j for j in range(len(impact.position)) if j != c]
        with mp.workprec(BITS):
            u = -impact.relative_velocity if impact.side == "far" else impact.relative_velocity
            state = [impact.position[j] for j in others] + [impact.velocity[j] for j in others]
            rows.append((number, after, place, [impact.time, *state, u, impact.phase]))
    return rows


def chosen(history: History, *, on_table: bool) -> list[tuple[int, int, int]]:
    """Some impacts, the last one too: place, releases before, number since the last of them.

    Those so near to the one before that a simulation may replace them by contact are left out.
    """
    times = [impact.time for impact in history.impacts]
    releases = [contact.release for contact in history.contacts if contact.release != mpmath.inf]
    if not times:
        return []
    mean = max([*times, *releases]) / len(times)
    found = []
    for i, time in enumerate(times):
        after = sum(release <= time for release in releases)
        begin = releases[after - 1] if after else mpf(0)
        place = sum(begin <= earlier < time for earlier in times)
        before = times[i - 1] if i else mpf(0) if on_table else -mpmath.inf
        before = max(before, begin) if after else before
        u = history.impacts[i].relative_velocity
        if time - before > ISOLATED * mean and (u == 0 or u > SLOWEST):
            found.append((i, after, place))
    last = max(len(found) - 1, 0)
    return [found[i] for i in sorted({round(k * last / (KEPT - 1)) for k in range(KEPT)})]


def kept(numbers: Iterator[int], tell: Callable[[int, str], object]) -> Kept:
    """Of the cases of these numbers, but for those that are not decided, or take too long."""
    rows = []
    for number in numbers:
        try:
            with at_most(SECONDS):
                rows += rows_of(number)
        except (ArithmeticError, TimeoutError) as failure:
            tell(number, str(failure))
    return Kept.of(rows)


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"it takes longer than {seconds} s of the processor")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


if __name__ == "__main__":
    kept(iter(range(CASES)), lambda number, why: sys.stderr.write(f"{number}: {why}\n")).save()
