"""Periodic orbits of the logistic map and of Henon's, against closed forms and many digits."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp

from dynkit import MapAttractor, MapOrbit, periodic_orbit
from dynkit.core.no_motion import Diverged, Refused
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.orbits.newton import NoConvergence
from dynkit.systems import DelayedLogistic, Henon, HighBounce, Logistic, SymbolicMap
from tests.example_systems import CircleRotation
from tests.orbits.references import cycles_at_four, eigenvalues, exact_orbit

ROUNDING = 2.0**-52


def assert_right_within_its_error(orbit: MapOrbit) -> None:
    """States within the orbit's error, multipliers within what that and rounding make of them."""
    states, matrix = exact_orbit(orbit)
    assert abs(orbit.states - states).max() <= orbit.error
    assert orbit.error < 1e-10
    exact = eigenvalues(matrix)
    # by differences: how the multipliers change with the states, all of them off by the error
    system, change = orbit.system, 1e-6
    rng = np.random.default_rng(0)
    slopes = []
    for _ in range(5):
        moved = states + change * rng.choice([-1.0, 1.0], states.shape)
        product = np.linalg.multi_dot(
            [np.eye(system.dimension)] * 2 + [system.jacobian(state) for state in moved[::-1]]
        )
        slopes.append(abs(np.sort(abs(np.linalg.eigvals(product))) - np.sort(abs(exact))) / change)
    allowed = 10.0 * np.max(slopes) * orbit.error + 100.0 * ROUNDING * orbit.period * abs(exact)
    assert (abs(orbit.multipliers - exact) <= allowed).all()


# --- the logistic map -----------------------------------------------------------------------------


@pytest.mark.parametrize("n", range(1, 9))
def test_all_cycles_of_the_logistic_map_at_four(n: int) -> None:
    cycles = cycles_at_four(n)
    # 2^n points come back after n iterates; those of the divisors of n are left out (the number of
    # necklaces of two colours without symmetry)
    assert len(cycles) == [2, 1, 2, 3, 6, 9, 18, 30][n - 1]
    for states, multiplier in cycles:
        # a disturbance grows by 2^n in a round: smaller than what leads to a neighbour
        orbit = periodic_orbit(Logistic(4.0), (states + 1e-3 / 2**n)[:, None])
        assert orbit.label == f"P({n})"
        assert not orbit.stable
        assert abs(orbit.states[:, 0] - states).max() <= orbit.error + ROUNDING
        assert orbit.error < 1e-12
        # relative to 4 - 8 x, of which it is the product
        slopes = abs(4.0 - 8.0 * states)
        allowed = np.sum(8.0 * (orbit.error + ROUNDING) / slopes) + n * ROUNDING
        assert orbit.multipliers[0] == pytest.approx(multiplier, rel=2.0 * float(allowed))


@pytest.mark.parametrize("rate", [2.5, 3.0 + 1e-6, 3.2, 1.0 + np.sqrt(6.0), 3.7])
def test_the_cycle_of_two_of_the_logistic_map(rate: float) -> None:
    root = np.sqrt(complex((rate - 3.0) * (rate + 1.0)))
    if root.imag:
        fixed = periodic_orbit(Logistic(rate), [0.55], period=2)
        assert fixed.label == "P(1)"
        return
    exact = np.sort([(rate + 1.0 + sign * root.real) / (2.0 * rate) for sign in (1, -1)])
    orbit = periodic_orbit(Logistic(rate), exact[:, None] + [[1e-5], [-1e-5]])
    # near the doubling at 3 its closed form loses digits as its derivative does
    assert np.sort(orbit.states[:, 0]) == pytest.approx(exact, abs=orbit.error + 4 * ROUNDING)
    multiplier = 4.0 + 2.0 * rate - rate**2
    assert orbit.multipliers[0] == pytest.approx(multiplier, abs=50.0 * (orbit.error + ROUNDING))
    assert orbit.stable == (abs(orbit.multipliers[0]) < 1.0)


@pytest.mark.parametrize(
    ("rate", "n"), [(2.8, 1), (3.3, 2), (3.84, 3), (3.5, 4), (3.7389, 5), (3.6275, 6), (3.55, 8)]
)
def test_stable_cycles_of_the_logistic_map(rate: float, n: int) -> None:
    # windows of periods 3, 5, 6: R. M. May, Nature 261 (1976) 459-467, table 3
    motion = Logistic(rate).iterate(np.array([0.5]), 500)
    orbit = periodic_orbit(Logistic(rate), motion[-n:].round(3))
    assert orbit.label == f"P({n})"
    assert orbit.stable
    assert_right_within_its_error(orbit)


# --- Henon's map ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("a", "b"), [(1.4, 0.3), (0.2, 0.3), (0.3, -0.9), (5.0, 1.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_fixed_points_of_henons_map(a: float, b: float, sign: float) -> None:
    x = (b - 1.0 + sign * np.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
    orbit = periodic_orbit(Henon(a, b), [x + 0.01, b * x - 0.01])
    assert orbit.label == "P(1)"
    # 4 a may be much larger than the root's other term, but nothing cancels in these cases
    assert orbit.states[0] == pytest.approx([x, b * x], abs=orbit.error + 8 * ROUNDING * abs(x))
    root = np.sqrt(complex((a * x) ** 2 + b))
    exact = sorted([-a * x + root, -a * x - root], key=lambda z: (-abs(z), -z.imag))
    assert orbit.multipliers == pytest.approx(np.array(exact), abs=1e-13)


@pytest.mark.parametrize(("a", "b"), [(1.4, 0.3), (0.5, 0.3), (2.0, -0.5)])
def test_the_cycle_of_two_of_henons_map(a: float, b: float) -> None:
    root = np.sqrt(4.0 * a - 3.0 * (1.0 - b) ** 2)
    x = (1.0 - b + np.array([1.0, -1.0]) * root) / (2.0 * a)
    orbit = periodic_orbit(Henon(a, b), np.stack([x, b * x[::-1]], axis=1) + 0.003)
    assert orbit.label == "P(2)"
    assert orbit.states[:, 0] == pytest.approx(x, abs=orbit.error + 8 * ROUNDING)
    trace, determinant = 4.0 * a**2 * x[0] * x[1] + 2.0 * b, b * b
    assert orbit.multipliers.sum() == pytest.approx(trace, rel=1e-13)
    assert orbit.multipliers.prod() == pytest.approx(determinant, rel=1e-13)


def henon_cycles(n: int) -> list[MapOrbit]:
    """What Newton's method finds from the 400 best recurrences of a long chaotic motion."""
    states = Henon().iterate(np.array([0.1, 0.1]), 20_000)[100:]
    gaps = abs(states[n:] - states[:-n]).max(axis=1)
    found: dict[tuple[float, ...], MapOrbit] = {}
    for i in np.argsort(gaps)[:400].tolist():
        try:
            orbit = periodic_orbit(Henon(), states[i : i + n])
        except NoConvergence:
            continue
        if orbit.period == n:
            found[tuple(np.sort(orbit.states[:, 0]).round(9).tolist())] = orbit
    return list(found.values())


@pytest.mark.parametrize(
    ("n", "count"), [(1, 1), (2, 1), (3, 0), (4, 1), (5, 0), (6, 2), (7, 4), (8, 7)]
)
def test_all_cycles_in_henons_attractor(n: int, count: int) -> None:
    # O. Biham, W. Wenzel, Phys. Rev. Lett. 63 (1989) 819-822, table I; of the two fixed points one
    # is not in the attractor
    orbits = henon_cycles(n)
    assert len(orbits) == count
    for orbit in orbits:
        assert not orbit.stable
        assert_right_within_its_error(orbit)
        assert abs(orbit.multipliers.prod()) == pytest.approx(0.3**n, rel=1e-13)


def test_small_multipliers_are_right_relative_to_themselves() -> None:
    for orbit in henon_cycles(8):
        _, matrix = exact_orbit(orbit)
        large, small = eigenvalues(matrix)
        # a product that is formed has rounding of the large one in the small one
        assert abs(small) < 1e-6 * abs(large)
        assert orbit.multipliers[1] == pytest.approx(small, rel=1e-12)


# --- Newton's method ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("system", "guess", "n"),
    [
        (Logistic(3.9), [0.187], 3),
        (Henon(), [0.62, 0.18], 1),
        (Henon(), [0.97, -0.13], 2),
        (HighBounce(restitution=0.8, gamma=2.0), [4.0, 6.3], 1),
    ],
)
def test_it_converges_quadratically(system: Map, guess: list[float], n: int) -> None:
    history = np.array(periodic_orbit(system, np.array(guess), period=n).history)
    assert history[-1] < 1e-14
    # the order from residuals of the asymptotic regime that are above rounding
    clear = history[(history < 0.05) & (history > 1e-13)]
    orders = np.log(clear[2:] / clear[1:-1]) / np.log(clear[1:-1] / clear[:-2])
    assert len(orders) > 0
    assert orders[-1] == pytest.approx(2.0, abs=0.25)


def test_an_orbit_is_found_again_from_itself() -> None:
    orbit = periodic_orbit(Henon(), [0.6, 0.2])
    again = periodic_orbit(Henon(), orbit.states)
    assert len(again.history) == 1
    assert (again.states == orbit.states).all()


@pytest.mark.parametrize("multiple", [2, 3, 6])
def test_a_multiple_of_the_period_gives_the_orbit_with_its_own(multiple: int) -> None:
    single = periodic_orbit(Logistic(3.2), [[0.51], [0.80]])
    orbit = periodic_orbit(Logistic(3.2), np.tile([[0.51], [0.80]], (multiple, 1)))
    assert orbit.label == "P(2)"
    assert orbit.states == pytest.approx(single.states, abs=orbit.error + single.error)
    assert orbit.multipliers == pytest.approx(single.multipliers, abs=1e-13)
    assert orbit.history[0] > 1e-3 > 1e-14 > orbit.history[-1]


def test_next_to_a_doubling_the_two_states_are_told_apart() -> None:
    # their distance is sqrt((r - 3) (r + 1)) / r
    rate = 3.0 + 1e-9
    distance = np.sqrt(1e-9 * 4.0) / 3.0
    middle = 1.0 - 1.0 / rate
    guess = [[middle + 0.45 * distance], [middle - 0.45 * distance]]
    orbit = periodic_orbit(Logistic(rate), np.array(guess))
    assert orbit.label == "P(2)"
    assert abs(orbit.states[0, 0] - orbit.states[1, 0]) == pytest.approx(distance, rel=1e-3)


# --- what it offers -------------------------------------------------------------------------------


def test_its_states_follow_one_another() -> None:
    orbit = periodic_orbit(Henon(), [0.6, 0.2], period=7)
    assert orbit.states.shape == (7, 2)
    following = np.array([orbit.system(state) for state in orbit.states])
    assert following == pytest.approx(np.roll(orbit.states, -1, axis=0), abs=8 * ROUNDING)
    assert not orbit.states.flags.writeable
    assert orbit.admissible


def test_samples_repeat_the_states() -> None:
    orbit = periodic_orbit(Logistic(3.9), [0.181], period=3)
    found = orbit.sample([0, 4, -1, 3_000_000_002])
    assert (found == orbit.states[[0, 1, 2, 2]]).all()


def test_observables_are_the_coordinates() -> None:
    orbit = periodic_orbit(Henon(), [0.97, -0.13], period=2)
    assert (orbit.observable("state[1]") == orbit.states[:, 1]).all()
    with pytest.raises(ValueError, match=r"name must be one of: state\[0\], state\[1\]; got 'x'"):
        orbit.observable("x")


def test_its_cost_counts_the_steps() -> None:
    orbit = periodic_orbit(Henon(), [0.6, 0.2])
    assert orbit.cost.counts == {"newton steps": len(orbit.history) - 1}
    assert orbit.cost.seconds > 0.0


def test_it_says_what_it_is() -> None:
    assert repr(periodic_orbit(Logistic(2.5), [0.5])) == "<P(1) of Logistic(rate=2.5): stable>"


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda orbit: pickle.loads(pickle.dumps(orbit))])
def test_copies_are_the_same_and_read_only(copied: Callable[[MapOrbit], MapOrbit]) -> None:
    orbit = periodic_orbit(Henon(), [0.97, -0.13], period=2)
    other = copied(orbit)
    assert other.states.tobytes() == orbit.states.tobytes()
    assert other.history == orbit.history
    assert other.cost == orbit.cost
    assert not other.states.flags.writeable
    assert not other.unknowns.flags.writeable


@pytest.mark.parametrize("turns", [-3, 0, 2])
def test_angles_are_where_the_map_has_them(turns: int) -> None:
    ball = HighBounce(restitution=0.8, gamma=2.0)
    phase = 2.0 * np.pi - np.arccos(-2.0 * np.pi * 0.2 / 2.0)
    orbit = periodic_orbit(ball, [phase + 0.1 + 2.0 * np.pi * turns, 2.0 * np.pi - 0.1])
    assert orbit.states[0] == pytest.approx([phase, 2.0 * np.pi], abs=orbit.error + 1e-14)


def test_an_orbit_that_turns_a_whole_turn() -> None:
    # a rotation by a third of a turn comes back after three, whatever the angle: any will do
    third = CircleRotation(2.0 * np.pi / 3.0)
    orbit = periodic_orbit(third, third.iterate(np.array([1.0, 0.0]), 2))
    assert orbit.label == "P(3)"
    assert orbit.multipliers == pytest.approx([1.0, 0.125], abs=8 * ROUNDING)


def test_multipliers_of_a_focus_are_a_pair() -> None:
    # fixed point x = y = 1 - 1/r with trace 1 and determinant r - 1 (Aronson et al. 1982)
    orbit = periodic_orbit(DelayedLogistic(1.9), [0.4, 0.5])
    exact = 0.5 + 1j * np.sqrt(0.9 - 0.25)
    assert orbit.multipliers == pytest.approx([exact, np.conj(exact)], abs=1e-14)
    assert orbit.stable
    assert not periodic_orbit(DelayedLogistic(2.1), [0.5, 0.5]).stable


# --- refusals -------------------------------------------------------------------------------------


class NoFixedPoint(Map):
    """x' = x + 1 + x^2, up to ten."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        if x[0] > 10.0:
            raise Refused(f"state[0] must be at most 10; got {x[0]}")
        return x + 1.0 + x * x

    def jacobian(self, state: Array) -> Array:
        return np.array([[1.0 + 2.0 * finite_array("state", state, (1,))[0]]])


def test_where_there_is_no_orbit_the_failure_says_so() -> None:
    with pytest.raises(NoConvergence, match=r"residual .*; for period 1 from \[0\.3\] of NoFix"):
        periodic_orbit(NoFixedPoint(), [0.3])


def test_where_the_map_refuses_the_failure_says_why() -> None:
    with pytest.raises(NoConvergence, match=r"state\[0\] must be at most 10; got 11\.0"):
        periodic_orbit(NoFixedPoint(), [11.0])


@pytest.mark.parametrize(
    ("guess", "period", "message"),
    [
        ([0.1, 0.2, 0.3], None, r"guess must have shape \(2,\); got shape \(3,\)"),
        ([[0.1], [0.2]], None, r"guess must have shape \(n, 2\), for any n; got shape \(2, 1\)"),
        ([[0.1, 0.2], [0.3]], None, "guess must be an array of real numbers; got"),
        ("near", None, "guess must be an array of real numbers; got 'near'"),
        ([[np.nan, 0.2]], None, r"guess\[0, 0\] must be a finite number; got nan"),
        (np.zeros((0, 2)), None, "guess must have one state at least; got none"),
        ([0.1, 0.2], 0, "period must be a positive integer; got 0"),
        ([0.1, 0.2], 2.0, r"period must be a positive integer; got 2\.0"),
        ([[0.1, 0.2]] * 2, 3, "period must be the number of states, 2; got 3"),
    ],
)
def test_bad_guesses_are_refused(guess: object, period: int | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        periodic_orbit(Henon(), guess, period=period)


def test_a_guess_that_runs_away_is_no_guess() -> None:
    with pytest.raises(Diverged, match=r"guess must have 19 iterates; got \[9\.0, 9\.0\]"):
        periodic_orbit(Henon(), [9.0, 9.0], period=20)


@pytest.mark.parametrize("iterates", [[0.5], [np.nan], 3])
def test_samples_are_at_whole_iterates(iterates: object) -> None:
    orbit = periodic_orbit(Logistic(2.5), [0.5])
    with pytest.raises(ValueError, match="iterates"):
        orbit.sample(iterates)


class FarLogistic(SymbolicMap):
    """The logistic map in small units, far from the origin."""

    rate: float = 3.2
    size: float = 1e-3
    origin: float = 1e6

    def next_state(self, x: sp.Expr) -> tuple[sp.Expr]:
        u = (x - self.origin) / self.size
        return (self.origin + self.size * self.rate * u * (1 - u),)


# multipliers of P(2) at 3.2 and P(3) at 3.83: 4 + 2 r - r^2, and in 60 digits
@pytest.mark.parametrize(("rate", "n", "multiplier"), [(3.2, 2, 0.16), (3.83, 3, 0.3298817)])
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_an_orbit_far_from_the_origin_keeps_its_period(
    rate: float, n: int, multiplier: float, size: float
) -> None:
    # its states differ by 1e-10 of their size, and the rounding is a millionth of that
    system = FarLogistic(rate=rate, size=size)
    start = np.array([1e6 + 0.3123 * size])
    attractor = MapAttractor(system, start, transient=3000, iterations=60)
    orbit = attractor.periodic_orbit()
    assert orbit.label == f"P({n})"
    assert orbit.multipliers[0].real == pytest.approx(multiplier, abs=3e-4)


class Parabola(SymbolicMap):
    """x^2 + c; for c > 1/4 it has no fixed point."""

    c: float = -0.5

    def next_state(self, x: sp.Symbol) -> tuple[sp.Expr]:
        return (x**2 + self.c,)


@pytest.mark.parametrize("far", [1e4, 1e8, 1e12])
def test_an_orbit_from_a_far_guess_is_as_accurate_as_from_a_near_one(far: float) -> None:
    orbit = periodic_orbit(Parabola(), [far])
    assert abs(orbit.states[0, 0] - (1.0 + np.sqrt(3.0)) / 2.0) <= orbit.error < 1e-14


@pytest.mark.parametrize("far", [1.0, 1e8, 1e10, 1e12])
def test_a_far_guess_finds_no_orbit_where_there_is_none(far: float) -> None:
    with pytest.raises(NoConvergence):
        periodic_orbit(Parabola(c=1.0), [far])


class Cubic(Map):
    """A linear map and products of the coordinates: the origin is a fixed point."""

    dimension = 2

    def __call__(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        return np.array([0.3 * x - 0.7 * y + 0.9 * x * y, 1.3 * x + 0.2 * y - 0.4 * x**2])


@pytest.mark.parametrize("period", [1, 2, 3])
@pytest.mark.parametrize("far", [1e-6, 0.1])
def test_a_fixed_point_at_the_origin_is_found(far: float, period: int) -> None:
    guess = far * np.array([[1.0, -0.7], [0.4, 0.9], [-0.8, 0.3]])[:period]
    orbit = periodic_orbit(Cubic(), guess)
    assert orbit.label == "P(1)"
    assert (orbit.states == 0.0).all()
