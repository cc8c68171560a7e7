"""Searches for periodic orbits, against closed forms and plain searches from thousands of starts.

`CASES=10 python -m pytest tests/continuation/test_orbit_search.py` takes ten times as many random
maps.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from dynkit import Diverged, Map, NoConvergence, Refused, find_orbits, periodic_orbit
from dynkit.core.validation import Array, finite_array
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.search import OrbitSearch
from dynkit.systems import Henon, HighBounce, Logistic

MORE = int(os.environ.get("CASES", "1"))


def orbits_of(laps: int, period: int) -> int:
    """Orbits of least period n where the n-th iterate has laps^n periodic points."""
    shorter = sum(k * orbits_of(laps, k) for k in range(1, period) if period % k == 0)
    return int((laps**period - shorter) // period)


def counts(search: OrbitSearch[MapOrbit]) -> list[int]:
    return list(search.counts.values())


# --- one dimension --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Laps(Map):
    """k laps of random widths, each from 0 to 1 or from 1 to 0, straight in x^power.

    Falls and rises in turn make it continuous; otherwise it jumps.
    """

    ends: Array
    signs: Array
    power: float = 1.0

    @property
    def dimension(self) -> int:
        return 1

    def _at(self, state: Array) -> tuple[float, int, float]:
        (x,) = finite_array("state", state, (1,))
        y = float(np.clip(x, 0.0, 1.0)) ** self.power
        k = int(np.clip(np.searchsorted(self.ends, y, side="right") - 1, 0, len(self.signs) - 1))
        part = (y - self.ends[k]) / (self.ends[k + 1] - self.ends[k])
        return y, k, float(part if self.signs[k] > 0 else 1.0 - part)

    def __call__(self, state: Array) -> Array:
        *_, z = self._at(state)
        return np.array([max(z, 0.0) ** (1.0 / self.power)])

    def jacobian(self, state: Array) -> Array:
        y, k, z = self._at(state)
        if min(y, z) <= 0.0:  # the power has no slope there, or the ends have one of one side only
            y, z = max(y, 1e-300), max(z, 1e-300)
        slope = self.signs[k] / (self.ends[k + 1] - self.ends[k])
        inner = self.power * y ** (1.0 - 1.0 / self.power)
        return np.array([[slope * inner * z ** (1.0 / self.power - 1.0) / self.power]])


def random_laps(seed: int, jumps: bool) -> tuple[Laps, int]:
    random = np.random.default_rng(seed)
    k = int(random.integers(2, 6))
    widths = random.uniform(0.3, 1.0, k)
    ends = np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])
    ends[-1] = 1.0
    signs = np.array(random.choice((-1.0, 1.0), k) if jumps else (-1.0) ** np.arange(k), float)
    return Laps(ends, signs, float(random.uniform(0.6, 1.6))), k


@pytest.mark.parametrize("seed", range(8 * MORE))
def test_all_orbits_of_a_continuous_map_with_k_full_laps_are_found(seed: int) -> None:
    system, k = random_laps(seed, jumps=False)
    longest = 4 if k < 4 else 3
    search = find_orbits(system, longest, [(0.0, 1.0)])
    assert counts(search) == [orbits_of(k, n) for n in range(1, longest + 1)]
    assert search.resolved == longest


@dataclass(frozen=True, eq=False)
class Stairs(Map):
    """A map without turning points, that rises or falls in steps between flat parts."""

    places: Array
    steepness: float
    sign: float = 1.0

    @property
    def dimension(self) -> int:
        return 1

    def of(self, x: Array) -> Array:
        """The next states (k,) of states (k,)."""
        steps = np.tanh(self.steepness * (x[:, None] - self.places))
        return np.asarray(self.sign * (steps.mean(axis=1) + 0.1 * x))

    def __call__(self, state: Array) -> Array:
        return self.of(state)

    def jacobian(self, state: Array) -> Array:
        steps = np.cosh(self.steepness * (state - self.places)) ** -2.0
        return np.array([[self.sign * (self.steepness * steps.mean() + 0.1)]])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(20 * MORE))
def test_no_orbit_on_a_lap_of_many_steps_is_missed(sign: float, seed: int) -> None:
    """Rising, it has fixed points alone; falling, one of them, and pairs of P(2).

    They are where f^n(x) - x changes its sign on a fine grid.
    """
    random = np.random.default_rng(seed)
    places = np.sort(random.uniform(-1.0, 1.0, int(random.integers(1, 6))))
    system = Stairs(places, float(10.0 ** random.uniform(0.3, 1.8)), sign)
    low, high = -1.3 - random.uniform(0.0, 2.0, 2)
    search = find_orbits(system, 4, [(low, -high)])
    grid = np.linspace(low, -high, 100_003)
    once = system.of(grid)
    ones, twos = (int((np.diff(np.sign(y - grid)) != 0.0).sum()) for y in (once, system.of(once)))
    assert counts(search) == [ones, (twos - ones) // 2, 0, 0]
    assert search.resolved == 4


@dataclass(frozen=True, eq=False)
class Conjugate(Map):
    """The logistic map at 4 in other coordinates: y = h(x), h(x) = a + s (x + sum c_j sin(j pi x)).

    It has the orbits h(sin^2(pi k / (2^n -+ 1))).
    """

    shift: float
    size: float
    waves: Array

    @property
    def dimension(self) -> int:
        return 1

    def h(self, x: float, derivative: bool = False) -> float:
        waves = [(c, math.pi * j) for j, c in enumerate(self.waves.tolist(), start=1)]
        if derivative:
            return self.size * (1.0 + math.fsum(c * j * math.cos(j * x) for c, j in waves))
        return self.shift + self.size * (x + math.fsum(c * math.sin(j * x) for c, j in waves))

    def _inverse(self, y: float) -> float:
        x = (y - self.shift) / self.size
        for _ in range(60):
            step = (self.h(x) - y) / self.h(x, derivative=True)
            x -= step
            if abs(step) < 1e-16:
                break
        return x

    @property
    def accuracy(self) -> float:
        return 2.0**-48 * (1.0 + abs(self.shift / self.size))

    def __call__(self, state: Array) -> Array:
        (y,) = finite_array("state", state, (1,))
        x = self._inverse(y)
        return np.array([self.h(4.0 * x * (1.0 - x))])

    def jacobian(self, state: Array) -> Array:
        (y,) = finite_array("state", state, (1,))
        x = self._inverse(y)
        outer = self.h(4.0 * x * (1.0 - x), derivative=True)
        return np.array([[outer * (4.0 - 8.0 * x) / self.h(x, derivative=True)]])


@pytest.mark.parametrize("seed", range(4 * MORE))
def test_all_orbits_of_a_map_that_jumps_between_its_laps_are_found(seed: int) -> None:
    """But for 0 and 1, which one value of a jump belongs to, or none."""
    system, k = random_laps(seed, jumps=True)
    search = find_orbits(system, 3, [(0.0, 1.0)])
    inner = [o for o in search if o.states.min() > 1e-9 and o.states.max() < 1.0 - 1e-9]
    ends = [end for end, sign in ((0, system.signs[0]), (1, system.signs[-1])) if sign > 0]
    found = [sum(o.period == n for o in inner) for n in (1, 2, 3)]
    swapped = system.signs[0] < 0.0 and system.signs[-1] < 0.0
    assert found == [
        orbits_of(k, 1) - len(ends),
        orbits_of(k, 2) - int(swapped),
        orbits_of(k, 3),
    ]


@pytest.mark.parametrize("seed", range(8 * MORE))
def test_all_orbits_of_conjugates_of_the_logistic_map_are_found(seed: int) -> None:
    random = np.random.default_rng(seed)
    # sum of j pi |c_j| below one half: h is monotone, by a factor of three at most
    waves = random.uniform(-1.0, 1.0, 3) / (6.0 * np.pi * np.arange(1, 4))
    system = Conjugate(random.uniform(-1.0, 1.0), 10.0 ** random.uniform(-1.0, 1.0), waves)
    search = find_orbits(system, 5, [(system.h(0.0), system.h(1.0))])
    assert counts(search) == [orbits_of(2, n) for n in range(1, 6)]
    exact = [
        system.h(float(np.sin(np.pi * k / (2.0**5 + sign)) ** 2))
        for sign in (-1, 1)
        for k in range(1, 16)
        if (sign, k) != (1, 11)  # 11/33 is that of a fixed point
    ]
    found = np.concatenate([orbit.states[:, 0] for orbit in search if orbit.period == 5])
    assert max(abs(found - x).min() for x in exact) < 1e-9 * system.size * (1 + abs(system.shift))


@cache
def logistic_at_four() -> OrbitSearch[MapOrbit]:
    return find_orbits(Logistic(rate=4.0), 10, [(0.0, 1.0)])


def test_the_logistic_map_at_four_has_as_many_orbits_as_there_are_necklaces() -> None:
    assert counts(logistic_at_four()) == [2, 1, 2, 3, 6, 9, 18, 30, 56, 99]
    assert logistic_at_four().resolved == 10


def test_orbits_of_the_logistic_map_are_those_of_the_closed_form() -> None:
    for orbit in logistic_at_four():
        n, x = orbit.period, orbit.states[:, 0]
        angle = np.arcsin(np.sqrt(np.clip(x, 0.0, 1.0))) / np.pi
        off = [abs(angle * m - np.rint(angle * m)).max() / m for m in (2**n - 1, 2**n + 1)]
        # an angle near 1/2 is as wrong as the root of the error of sin^2
        assert min(off) < 1e-7


def test_both_orbits_of_a_pair_are_found_just_after_its_birth() -> None:
    """The window of period three begins at 1 + sqrt 8."""
    born = 1.0 + 8.0**0.5
    for beyond, pair in ((-1e-7, 0), (1e-7, 2), (1e-10, 2)):
        assert counts(find_orbits(Logistic(rate=born + beyond), 3, [(0.0, 1.0)]))[2] == pair


def test_orbits_that_leave_the_box_are_found_where_iterates_of_the_box_go() -> None:
    search = find_orbits(Logistic(rate=4.0), 5, [(0.4, 0.8)])
    assert search.region.tolist() == [[0.0, 1.0]]
    assert counts(search) == [2, 1, 2, 3, 6]


def test_a_budget_resolves_what_it_reaches_and_says_so() -> None:
    search = find_orbits(Logistic(rate=4.0), 12, [(0.0, 1.0)], calls=6_000)
    assert 3 <= search.resolved < 12
    resolved = counts(search)[: search.resolved]
    assert resolved == [orbits_of(2, n) for n in range(1, search.resolved + 1)]
    assert search.message.endswith("; the budget of 6000 calls was used up")
    assert search.cost.counts["calls"] <= 6_000


def test_a_budget_that_is_used_up_on_the_grid_resolves_nothing() -> None:
    search = find_orbits(Logistic(rate=4.0), 2, [(0.0, 1.0)], calls=100)
    assert (len(search), search.resolved) == (0, 0)
    assert "not all turning points were looked for" in search.message


# --- two dimensions -------------------------------------------------------------------------------

# At a = 1.4, b = 0.3: O. Biham, W. Wenzel, Phys. Rev. Lett. 63 (1989) 819-822, and Z. Galias, Int.
# J. Bifurcation Chaos 11 (2001) 2427-2450, table 3, beside the fixed point off the attractor.
HENON = [2, 1, 0, 1, 0, 2, 4]
BOX = [(-2.0, 2.0), (-1.0, 1.0)]


def test_henon_has_as_many_orbits_as_were_proved() -> None:
    search = find_orbits(Henon(), 7, BOX)
    assert counts(search) == HENON
    assert search.resolved == 7


def test_henon_has_all_orbits_of_the_horseshoe() -> None:
    """Devaney and Nitecki, Commun. Math. Phys. 67 (1979) 137-146: a > (5 + 2 sqrt 5)(1 + b)^2/4."""
    search = find_orbits(Henon(a=4.1, b=0.3), 5, BOX)
    assert counts(search) == [orbits_of(2, n) for n in range(1, 6)]


def plain_search(system: Map, period: int, box: list[tuple[float, float]], grid: int) -> list[int]:
    """Orbits of each least period from Newton's method for f^n from each of grid^2 starts."""
    found: list[list[Array]] = [[] for _ in range(period + 1)]
    places = np.stack(np.meshgrid(*(np.linspace(*side, grid) for side in box)), -1).reshape(-1, 2)
    for n in range(1, period + 1):
        for place in places:
            x = _newton(system, place, n)
            if x is None or any(_near(x, row) for rows in found for row in rows):
                continue
            states = system.iterate(x, n - 1)
            if not _near(system(states[-1]), x) or any(_near(x, s) for s in states[1:]):
                continue
            found[n] += list(states)
    return [len(rows) // n for n, rows in enumerate(found) if n]


def _near(x: Array, y: Array) -> bool:
    return bool(abs(x - y).max() < 1e-7)


def _newton(system: Map, x: Array, n: int) -> Array | None:
    for _ in range(40):
        slope, y = np.eye(2), x
        for _ in range(n):
            slope, y = system.jacobian(y) @ slope, system(y)
            if abs(y).max() > 1e6:
                return None
        try:
            step = np.linalg.solve(slope - np.eye(2), x - y)
        except np.linalg.LinAlgError:
            return None
        x = x + step
        if abs(step).max() < 1e-13:
            return x
    return None


@pytest.mark.parametrize("seed", range(5 * MORE))
def test_no_orbit_of_henon_is_missed_that_a_plain_search_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    system = Henon(a=float(random.uniform(0.2, 2.0)), b=float(random.uniform(-0.5, 0.5)))
    plain = plain_search(system, 4, [(-2.0, 2.0), (-1.0, 1.0)], 16)
    found = counts(find_orbits(system, 4, BOX))
    assert all(a >= b for a, b in zip(found, plain, strict=True))
    # all are real: each fixed point of f^n is one of 2^n at most
    assert all(a <= orbits_of(2, n) for n, a in enumerate(found, start=1))


def test_orbits_of_a_map_with_an_angle_are_found_round_the_turn() -> None:
    """High bounces: v = 2 pi n, cos phi = -2 pi n (1 - r) / gamma; a pair for each n."""
    ball = HighBounce(restitution=0.5, gamma=4.0)
    search = find_orbits(ball, 1, [(0.0, 2.0 * np.pi), (-5.0, 9.0)])
    found = sorted(orbit.states[0].tolist() for orbit in search)
    cosine = [-2.0 * np.pi * n * 0.5 / 4.0 for n in (-1, 0, 1)]
    exact = [(s * np.arccos(c) % (2.0 * np.pi), 2.0 * np.pi * n)
             for n, c in zip((-1, 0, 1), cosine, strict=True) for s in (1.0, -1.0)]  # fmt: skip
    assert len(found) == 6
    assert np.allclose(found, sorted(exact), rtol=0.0, atol=1e-12)


# --- more dimensions ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lattice(Map):
    """Four logistic maps, each with a part of the next one's image."""

    rate: float
    coupling: float

    @property
    def dimension(self) -> int:
        return 4

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (4,))
        images = self.rate * x * (1.0 - x)
        return np.asarray((1.0 - self.coupling) * images + self.coupling * np.roll(images, 1))

    def jacobian(self, state: Array) -> Array:
        x = finite_array("state", state, (4,))
        mixed = (1.0 - self.coupling) * np.eye(4) + self.coupling * np.roll(np.eye(4), 1, axis=0)
        return np.asarray(mixed * (self.rate * (1.0 - 2.0 * x)))


def test_in_four_dimensions_nothing_is_resolved_and_said_to_be() -> None:
    search = find_orbits(Lattice(rate=3.4, coupling=0.2), 2, 4 * [(0.0, 1.0)])
    assert search.resolved == 0
    assert search.message.startswith("P(1) to P(2) with states in [0, 1] x")
    assert "20 random guesses" in search.message
    # the stable orbit, all sites alike, is among them
    assert any(orbit.stable and np.ptp(orbit.states, axis=1).max() < 1e-9 for orbit in search)


# --- what is found --------------------------------------------------------------------------------


def test_orbits_come_by_rising_periods_each_with_its_error() -> None:
    search = find_orbits(Logistic(rate=4.0), 4, [(0.0, 1.0)])
    assert [orbit.period for orbit in search] == [1, 1, 2, 3, 3, 4, 4, 4]
    assert search.error.shape == (8,)
    assert search.error.max() < 1e-12
    assert repr(search).startswith("<8 orbits of Logistic(); P(1) to P(4) with states in [0, 1]: ")


FAULTS = (ValueError, ZeroDivisionError, RuntimeError, TypeError, np.linalg.LinAlgError)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("where", ["call", "jacobian"])
@pytest.mark.parametrize("plain", [Logistic, Henon])
def test_a_fault_of_a_map_reaches_the_user(
    plain: type[Logistic | Henon], where: str, fault: type[Exception]
) -> None:
    class Faulty(plain):  # type: ignore[misc, valid-type]
        def __call__(self, state: Array) -> Array:
            if where == "call":
                raise fault("a fault")
            return np.asarray(super().__call__(state))

        def jacobian(self, state: Array) -> Array:
            if where == "jacobian":
                raise fault("a fault")
            return np.asarray(super().jacobian(state))

    with pytest.raises(fault, match="a fault"):
        find_orbits(Faulty(), 1, BOX[: Faulty().dimension])


# --- maps that have no next state in a part of the box --------------------------------------------


def _infinite(state: Array) -> Array:
    return np.asarray([*state[:-1], np.inf])


def _not_a_number(state: Array) -> Array:
    return np.asarray(np.nan * state)


def _diverged(state: Array) -> Array:
    raise Diverged(f"the motion runs away from {state.tolist()}")


def _refused(state: Array) -> Array:
    raise Refused(f"state must be outside of the gap; got {state.tolist()}")


ENDS = (_infinite, _not_a_number, _diverged, _refused)


@cache
def without_gap(system: Map) -> OrbitSearch[MapOrbit]:
    return find_orbits(system, 4, [(0.0, 1.0)] if system.dimension == 1 else BOX)


@pytest.mark.parametrize("seed", range(24 * MORE))
def test_orbits_that_avoid_where_a_map_has_no_next_state_are_found(seed: int) -> None:
    """All orbits of the same map without the gap that have no state in the gap, and no others."""
    random = np.random.default_rng(seed)
    end, box = ENDS[seed % 4], [(0.0, 1.0)] if seed % 3 else BOX
    plain: Map = Logistic(rate=4.0) if seed % 3 else Henon()
    low = float(random.uniform(*box[0]))
    high = low + float(random.uniform(0.02, 0.3))
    if not seed % 3:
        high = np.inf  # the right part of the attractor is missing

    class Gap(type(plain)):  # type: ignore[misc]
        def __call__(self, state: Array) -> Array:
            if low < state[0] < high:
                return end(state)
            return np.asarray(super().__call__(state))

    whole = without_gap(plain)
    left = [o for o in whole if not ((o.states[:, 0] > low) & (o.states[:, 0] < high)).any()]
    found = find_orbits(Gap(**plain.parameters), 4, box)
    assert found.resolved == whole.resolved
    assert [o.period for o in found] == [o.period for o in left]
    for orbit, same in zip(found, left, strict=True):
        gap = abs(orbit.states[:, None] - same.states).max(axis=2).min(axis=1)
        assert (gap <= orbit.error + same.error).all()


def test_the_same_search_finds_the_same_bits() -> None:
    once, again = (find_orbits(Henon(), 4, BOX) for _ in range(2))
    assert [orbit.unknowns.tobytes() for orbit in once] == [o.unknowns.tobytes() for o in again]
    assert once.message == again.message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"system": 5}, "system must be a Map; got 5"),
        ({"period": 0}, "period must be a positive integer; got 0"),
        ({"box": [(1.0, 0.0)]}, "box.0. must be .low, high. with low < high"),
        ({"calls": 0}, "calls must be a positive integer; got 0"),
    ],
)
def test_bad_input_is_refused(options: dict[str, object], message: str) -> None:
    given: dict[str, object] = {
        "system": Logistic(),
        "period": 2,
        "box": [(0.0, 1.0)],
        **options,
    }
    with pytest.raises(ValueError, match=message):
        find_orbits(**given)  # type: ignore[arg-type]


def test_an_orbit_of_the_search_is_the_one_that_newton_s_method_finds() -> None:
    for orbit in find_orbits(Henon(), 4, BOX):
        try:
            again = periodic_orbit(Henon(), orbit.states)
        except NoConvergence:
            pytest.fail("an orbit is no solution")
        assert abs(again.states - orbit.states).max() <= 2.0 * orbit.error
