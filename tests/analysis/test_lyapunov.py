"""Lyapunov exponents against closed forms, published values and multipliers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from dynkit import Hyperplane, MapAttractor, PoincareMap, periodic_orbit
from dynkit.analysis.lyapunov import LyapunovSpectrum, kaplan_yorke
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.systems import (
    DelayedLogistic,
    Duffing,
    Henon,
    HighBounce,
    ImpactChain,
    Logistic,
    Lorenz,
    Rossler,
    StandardMap,
    SymbolicFlow,
    VanDerPol,
)
from tests.example_systems import CircleRotation, DampedRotation

# J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003, appendix A.
HENON, LORENZ = (0.41922, -1.62319), (0.9056, 0.0, -14.5723)
HENON_DIMENSION, LORENZ_DIMENSION = 1.25826, 2.06215


@cache
def henon() -> LyapunovSpectrum:
    return LyapunovSpectrum.of_map(Henon(), [0.1, 0.1], iterations=40_000)


@cache
def lorenz() -> LyapunovSpectrum:
    flow = Lorenz()
    return LyapunovSpectrum.of_flow(flow, [1.0, 1.0, 20.0], interval=0.2, iterations=1000)


# --- maps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.1, 0.2, 0.3, 0.4, 0.6])
def test_the_logistic_map_doubles_distances(start: float) -> None:
    spectrum = LyapunovSpectrum.of_map(Logistic(rate=4.0), [start], iterations=3000)
    assert abs(spectrum.exponents[0] - np.log(2.0)) < 2.0 * spectrum.error[0]
    assert spectrum.error[0] < 0.02
    assert spectrum.resolved


def test_exponents_of_henon() -> None:
    spectrum = henon()
    assert (abs(spectrum.exponents - HENON) < 3.0 * spectrum.error + 5e-6).all()
    assert spectrum.error.max() < 0.003
    assert spectrum.resolved


def test_the_dimension_of_henon() -> None:
    spectrum = henon()
    gap = abs(spectrum.dimension - HENON_DIMENSION)
    assert gap < 3.0 * spectrum.dimension_error + 5e-6
    assert spectrum.dimension_error < 0.002


def test_the_sum_is_the_logarithm_of_the_determinant() -> None:
    spectrum = henon()
    assert abs(spectrum.sum - np.log(0.3)) < spectrum.sum_error
    assert spectrum.sum_error < 1e-13
    ball = LyapunovSpectrum.of_map(HighBounce(0.6, 8.0), [0.1, 5.0], iterations=500)
    assert abs(ball.sum - np.log(0.6)) < 1e-13


def test_errors_are_standard_errors() -> None:
    # Of 40 runs; the root mean square of 40 normal deviates lies in [0.66, 1.34] by three of its
    # own standard errors, sqrt(1/80), and twice the error holds 36 of them or more.
    starts = Henon().iterate(np.array([0.1, 0.1]), 40)[1:] * [0.5, 0.5]
    runs = [LyapunovSpectrum.of_map(Henon(), start, iterations=256) for start in starts]
    deviates = np.array([(run.exponents[0] - HENON[0]) / run.error[0] for run in runs])
    assert 0.66 < np.sqrt((deviates**2).mean()) < 1.34
    assert (abs(deviates) <= 2.0).sum() >= 36


@pytest.mark.parametrize(("rate", "n"), [(2.8, 1), (3.2, 2), (3.5, 4)])
def test_exponents_of_cycles_are_logarithms_of_multipliers(rate: float, n: int) -> None:
    attractor = MapAttractor(Logistic(rate), np.array([0.3]), transient=500, iterations=20)
    spectrum = LyapunovSpectrum(attractor, 1000)
    multiplier = attractor.periodic_orbit().multipliers[0]
    assert spectrum.exponents[0] == pytest.approx(np.log(abs(multiplier)) / n, abs=1e-12)
    assert spectrum.dimension == 0.0


def test_a_superstable_cycle_has_an_exponent_of_minus_infinity() -> None:
    spectrum = LyapunovSpectrum.of_map(Logistic(rate=2.0), [0.5], iterations=200)
    assert spectrum.exponents[0] == -np.inf
    assert spectrum.error[0] == 0.0
    assert spectrum.sum == -np.inf
    assert spectrum.dimension == 0.0


def test_a_torus_has_an_exponent_of_zero() -> None:
    # Beyond its Neimark-Sacker bifurcation at 2 the map has an invariant circle.
    spectrum = LyapunovSpectrum.of_map(DelayedLogistic(2.1), [0.4, 0.4], iterations=8000)
    assert abs(spectrum.exponents[0]) <= 2.0 * spectrum.error[0]
    assert spectrum.error[0] < 1e-6
    assert spectrum.exponents[1] < -0.01
    assert spectrum.dimension == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("iterations", [128, 500, 2000])
def test_regular_motions_of_a_conservative_map_have_exponents_of_zero(iterations: int) -> None:
    # Around the centre of its island, at k < 0.6, disturbances grow in proportion to the time.
    random, covered = np.random.default_rng(0), 0
    for _ in range(20):
        start = [random.uniform(2.5, 3.7), random.uniform(-0.3, 0.3)]
        chart = StandardMap(random.uniform(0.05, 0.6))
        spectrum = LyapunovSpectrum.of_map(chart, start, iterations=iterations)
        covered += bool((abs(spectrum.exponents) <= 2.0 * spectrum.error).all())
        assert abs(spectrum.sum) <= spectrum.sum_error + 1e-15
        assert spectrum.sum_error < 1e-10
    assert covered == 20


def test_what_rounding_hides_is_no_number() -> None:
    @dataclass(frozen=True)
    class Flat(Map):
        dimension = 2

        def __call__(self, state: Array) -> Array:
            return finite_array("state", state, (2,)).copy()

        def jacobian(self, state: Array) -> Array:
            turn = np.array([[0.8, -0.6], [0.6, 0.8]])
            return np.asarray(turn @ np.diag([1.0, 1e-20]) @ turn)

    spectrum = LyapunovSpectrum.of_map(Flat(), [0.1, 0.1], iterations=200)
    assert np.isfinite(spectrum.exponents[0])
    assert np.isnan(spectrum.exponents[1])
    assert np.isnan(spectrum.error[1])


def test_a_rotation_in_closed_form() -> None:
    spectrum = LyapunovSpectrum.of_map(CircleRotation(1.0), [0.3, 0.2], iterations=200)
    assert spectrum.exponents == pytest.approx([0.0, np.log(0.5)], abs=1e-15)
    assert spectrum.dimension == 1.0


class Strips(Map):
    """A baker's map whose strips have these widths and are all contracted to a fifth."""

    dimension = 2

    def __init__(self, *widths: float) -> None:
        self.widths, self.edges = widths, np.append(0.0, np.cumsum(widths))

    def __call__(self, state: Array) -> Array:
        strip = self.strip(state)
        x = (state[0] - self.edges[strip]) / self.widths[strip]
        return np.array([x, 0.2 * state[1] + 0.3 * strip])

    def jacobian(self, state: Array) -> Array:
        return np.diag([1.0 / self.widths[self.strip(state)], 0.2])

    def strip(self, state: Array) -> int:
        return int(np.searchsorted(self.edges[1:-1], state[0], side="right"))


def test_the_error_of_the_dimension_covers_an_exponent_that_may_be_zero() -> None:
    # The largest exponent is the entropy of the widths; it is small, and so are 300 iterates.
    random, widths, covered = np.random.default_rng(0), (0.99, 0.01), []
    exact = 1.0 - sum(p * np.log(p) for p in widths) / np.log(5.0)
    for start in random.uniform(size=(40, 2)):
        spectrum = LyapunovSpectrum.of_map(Strips(*widths), start, iterations=300)
        if np.ptp(spectrum._run[0][:, 0]) > 0.0:  # some starts never come to the narrow strip
            covered.append(abs(spectrum.dimension - exact) <= 2.0 * spectrum.dimension_error)
    assert len(covered) >= 30
    assert sum(covered) >= 0.9 * len(covered)


# --- flows ---------------------------------------------------------------------------------------


def test_exponents_of_lorenz() -> None:
    spectrum = lorenz()
    assert (abs(spectrum.exponents - LORENZ) < 3.0 * spectrum.error + 5e-5).all()
    assert spectrum.error.max() < 0.03
    assert (spectrum.per_time == spectrum.exponents).all()


def test_volumes_of_lorenz_shrink_evenly() -> None:
    spectrum = lorenz()
    assert abs(spectrum.sum + 10.0 + 1.0 + 8.0 / 3.0) < spectrum.sum_error
    assert spectrum.sum_error < 1e-4


def test_the_dimension_of_lorenz() -> None:
    spectrum = lorenz()
    assert abs(spectrum.dimension - LORENZ_DIMENSION) < 3.0 * spectrum.dimension_error + 5e-6


def test_a_section_has_the_flow_s_exponents_but_the_zero() -> None:
    flow = Lorenz()
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), offset=27.0, direction=-1)
    section = PoincareMap(flow, plane, time_limit=10.0)
    attractor = MapAttractor(section, np.array([2.0, 2.0]), transient=20, iterations=1)
    spectrum = LyapunovSpectrum(attractor, 128)
    assert (abs(spectrum.per_time - [LORENZ[0], LORENZ[2]]) < 3.0 * spectrum.per_time_error).all()
    assert spectrum.per_time_error.max() < 0.2
    # the volume shrinks evenly in time
    total = float(spectrum.per_time.sum())
    assert total == pytest.approx(-41.0 / 3.0, abs=3.0 * float(spectrum.per_time_error.max()))
    assert spectrum.dimension + 1.0 == pytest.approx(LORENZ_DIMENSION, abs=0.02)


def test_a_driven_oscillator_has_a_zero_for_its_phase() -> None:
    flow = Duffing()
    spectrum = LyapunovSpectrum.of_flow(flow, [1.0, 0.0, 0.0], interval=1.0, iterations=2000)
    assert spectrum.sum == pytest.approx(-0.3, abs=1e-5)
    assert spectrum.exponents[0] > 3.0 * spectrum.error[0]
    assert abs(spectrum.exponents[1]) < 3.0 * spectrum.error[1]
    # a time and its phase: the section of one phase leaves out the zero alone
    assert spectrum.dimension == pytest.approx(
        2.0 + spectrum.exponents[0] / (0.3 + spectrum.exponents[0]),
        abs=3.0 * spectrum.dimension_error,
    )


def test_what_falls_to_1e_14_in_a_return_is_known() -> None:
    # The volume in the section of Rossler's attractor: by the divergence a - c + x along the motion
    # and the normal velocity x at both ends.
    plane = Hyperplane(np.array([0.0, 1.0, 0.0]), direction=-1)
    section = PoincareMap(Rossler(), plane, time_limit=20.0)
    state = section(np.array([-5.0, 0.0]))
    found = section.stretching(state, 3)
    assert found.times is not None

    def velocity(_: float, both: Array) -> list[float]:
        x, y, z, _ = both
        return [-y - z, x + 0.2 * y, 0.2 + z * (x - 5.7), 0.2 - 5.7 + x]

    span, start = (0.0, float(found.times.sum())), np.append(plane.lift(state), 0.0)
    end = integrate.solve_ivp(velocity, span, start, method="DOP853", rtol=1e-12, atol=1e-12)
    volume = end.y[3, -1] + np.log(start[0] / end.y[0, -1])
    assert found.logs[:, 1].mean() < np.log(1e-13)
    # each of three returns is right to 1e-3
    assert found.logs.sum() == pytest.approx(volume, abs=3e-3)


def test_a_linear_flow_in_closed_form() -> None:
    flow = DampedRotation()
    spectrum = LyapunovSpectrum.of_flow(flow, [1.0, 0.0, 0.5], interval=0.3, iterations=200)
    assert spectrum.exponents == pytest.approx([-0.1, -0.1, -0.3], abs=1e-13)


# --- the rest ------------------------------------------------------------------------------------


def test_kaplan_and_yorke_in_closed_form() -> None:
    assert kaplan_yorke(np.array([-1.0])) == 0.0
    assert kaplan_yorke(np.array([0.3])) == 1.0
    assert kaplan_yorke(np.array([0.5, -1.0])) == 1.5
    assert kaplan_yorke(np.array([0.5, 0.25, -3.0])) == 2.25
    assert kaplan_yorke(np.array([0.0, -1.0])) == 1.0
    assert kaplan_yorke(np.array([0.5, -1.0, np.nan])) == 1.5
    assert np.isnan(kaplan_yorke(np.array([0.5, np.nan])))


def test_all_is_worked_out_once_and_on_demand() -> None:
    calls = []

    @dataclass(frozen=True)
    class Counted(Logistic):
        def jacobian(self, state: Array) -> Array:
            calls.append(1)
            return super().jacobian(state)

    spectrum = LyapunovSpectrum.of_map(Counted(4.0), [0.3], iterations=400)
    assert not calls
    assert repr(spectrum) == "<LyapunovSpectrum of Counted: 400 iterates, not computed yet>"
    assert not calls
    _ = spectrum.exponents, spectrum.error, spectrum.dimension, spectrum.sum, repr(spectrum)
    assert len(calls) == 500
    assert spectrum.cost.counts == {"iterates": 500}
    assert spectrum.cost.seconds > 0.0


def test_the_same_motion_has_the_same_exponents_bit_for_bit() -> None:
    attractor = ImpactChain(frequency=1.346).attractor(transient=1000)
    a, b = (LyapunovSpectrum(attractor, 500).exponents for _ in range(2))
    assert (a == b).all()
    assert not a.flags.writeable


def test_the_repr_is_one_line_and_says_when_the_run_is_too_short() -> None:
    assert lorenz().resolved
    _ = lorenz().exponents
    assert repr(lorenz()).startswith("<LyapunovSpectrum of Lorenz: 0.")
    assert "\n" not in repr(lorenz())
    # where a period doubles, motions take for ever to settle
    slow = LyapunovSpectrum.of_map(Logistic(rate=3.0), [0.3], iterations=400)
    _ = slow.exponents
    assert "too short for its errors" in repr(slow)


@pytest.mark.parametrize("transient", [0, 300, 3000])
@pytest.mark.parametrize("place", [3.0, 1.0 + np.sqrt(6.0)])
def test_errors_cover_motions_that_still_settle_beside_a_period_doubling(
    place: float, transient: int
) -> None:
    """P(1) has the multiplier 2 - rate, P(2) the multiplier 4 + 2 rate - rate^2.

    Without what is left to settle, two of five are off by more than two errors, and up to 16.
    """
    for distance in 10.0 ** np.linspace(-6.0, -2.0, 13):
        rate = float(place - distance)
        multipliers = {1: 2.0 - rate, 2: 4.0 + 2.0 * rate - rate**2}
        period = 1 if place == 3.0 else 2
        exact = np.log(abs(multipliers[period])) / period
        start = np.array([0.3])
        motion = MapAttractor(Logistic(rate=rate), start, transient=transient, iterations=1)
        for iterations in (2000, 10_000):
            spectrum = LyapunovSpectrum(motion, iterations)
            assert abs(spectrum.exponents[0] - exact) < 2.0 * spectrum.error[0]


class HopfForm(SymbolicFlow):
    """A cycle of radius sqrt(mu), with the exponents 0 and -2 mu."""

    mu: float = 0.1

    def velocity(self, x: Any, y: Any) -> tuple[Any, Any]:
        growth = self.mu - x**2 - y**2
        return growth * x - 1.3 * y, 1.3 * x + growth * y


@pytest.mark.parametrize("radius", [0.03, 0.3, 1.0])
@pytest.mark.parametrize("mu", [1e-5, 1e-4, 1e-3, 1e-2, 0.05])
def test_errors_cover_a_flow_that_still_settles_on_a_weak_cycle(mu: float, radius: float) -> None:
    for iterations in (400, 1000):
        spectrum = LyapunovSpectrum.of_flow(
            HopfForm(mu=mu), [radius, 0.0], interval=0.7, iterations=iterations
        )
        assert (abs(spectrum.exponents - [0.0, -2.0 * mu]) < 2.0 * spectrum.error).all()


@pytest.mark.parametrize("fraction", [0.5, 0.500001, 1.0 + 1e-9, 1.0001, 0.25001])
def test_errors_cover_intervals_near_a_simple_fraction_of_the_period(fraction: float) -> None:
    plane = Hyperplane(np.array([0.0, 1.0]), 0.0, -1)
    section = PoincareMap(VanDerPol(), plane, time_limit=50.0)
    orbit = periodic_orbit(section, [2.0])
    exact = [0.0, np.log(abs(orbit.multipliers[0])) / orbit.duration]
    start = [orbit.states[0, 0], 0.0]
    for iterations in (128, 500, 2000):
        spectrum = LyapunovSpectrum.of_flow(
            VanDerPol(), start, interval=fraction * orbit.duration, iterations=iterations
        )
        assert (abs(spectrum.exponents - exact) < 3.0 * spectrum.error).all()
        assert spectrum.error.max() < 10.0 / iterations


def test_the_plot_ends_in_the_exponents() -> None:
    from dynkit.plotting.figures import new_figure

    _, (axes,) = new_figure()
    assert henon().plot(axes) is axes
    ends = sorted(float(np.asarray(line.get_ydata())[-1]) for line in axes.lines)
    assert ends == pytest.approx(sorted(henon().exponents), abs=1e-3)


class TimedLogistic(Logistic):
    def return_time(self, state: Array) -> float:
        return 2.0


class TimedParabola(Map):
    rate: float = 4.0
    dimension = 1

    def __call__(self, state: Array) -> Array:
        return self.rate * state * (1.0 - state)

    def return_time(self, state: Array) -> float:
        return 2.0


@pytest.mark.parametrize("system", [TimedLogistic(rate=4.0), TimedParabola(rate=4.0)])
def test_a_map_with_times_of_its_own_has_exponents_per_time(system: Map) -> None:
    spectrum = LyapunovSpectrum.of_map(system, [0.3], iterations=200)
    assert spectrum.per_time == pytest.approx(0.5 * spectrum.exponents, rel=1e-12)


def test_a_map_without_times_has_no_exponents_per_time() -> None:
    spectrum = LyapunovSpectrum.of_map(Henon(), [0.1, 0.1], iterations=200)
    with pytest.raises(ValueError, match="system must have return times; got Henon"):
        _ = spectrum.per_time


@pytest.mark.parametrize(
    ("iterations", "message"),
    [
        (127, "iterations must be at least 128; got 127"),
        (0, "iterations must be a positive integer; got 0"),
        (1e4, "iterations must be a positive integer; got 10000.0"),
    ],
)
def test_too_few_iterations_are_refused(iterations: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LyapunovSpectrum.of_map(Henon(), [0.1, 0.1], iterations=iterations)


def test_what_is_no_attractor_map_or_flow_is_refused() -> None:
    with pytest.raises(
        ValueError,
        match=r"got Henon.*, whose attractor\(\) gives one",
    ):
        LyapunovSpectrum(Henon())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="system must be a Map; got Lorenz"):
        LyapunovSpectrum.of_map(Lorenz(), [1.0, 1.0, 1.0])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="flow must be a Flow; got Henon"):
        LyapunovSpectrum.of_flow(Henon(), [1.0, 1.0], interval=1.0)  # type: ignore[arg-type]


def test_bad_starts_and_intervals_are_refused() -> None:
    with pytest.raises(ValueError, match=r"start must have shape \(2,\)"):
        LyapunovSpectrum.of_map(Henon(), [0.1])
    with pytest.raises(ValueError, match=r"interval must be positive; got 0\.0"):
        LyapunovSpectrum.of_flow(Lorenz(), [1.0, 1.0, 1.0], interval=0.0)


def test_a_motion_that_ends_is_refused_in_one_line() -> None:
    system = ImpactChain(masses=2, frequency=0.7, offset=-10.0)
    spectrum = LyapunovSpectrum.of_map(system, [-10.0, 0.0, 0.5, 0.0], iterations=200)
    with pytest.raises(ValueError, match="attractor must go on for 250 iterates; there is no next"):
        _ = spectrum.exponents


def test_an_attractor_at_rest_is_refused() -> None:
    system = ImpactChain(masses=2, frequency=0.7, offset=-10.0)
    with pytest.raises(ValueError, match="attractor must have a state"):
        LyapunovSpectrum(system.attractor(transient=10, impacts=10))


@dataclass(frozen=True)
class OneIsHiddenAndOneIsLost(Map):
    """Exponents log 2, log 1e-14, which errors of the derivatives hide, and minus infinity."""

    dimension = 3

    def __call__(self, state: Array) -> Array:
        x, y, _ = finite_array("state", state, (3,))
        return np.array([2.0 * x % 1.0, 1e-14 * y, 0.0])

    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        return np.diag([2.0, 1e-14, 0.0])[None], np.array([1e-15])


def test_a_hidden_exponent_stands_before_one_that_is_minus_infinity() -> None:
    # The dimension is 1 + log 2 / log 1e14, and not the 1 of a hidden exponent in the last place.
    spectrum = LyapunovSpectrum.of_map(OneIsHiddenAndOneIsLost(), [0.1, 0.1, 0.1], iterations=128)
    assert spectrum.exponents == pytest.approx([np.log(2.0), np.nan, -np.inf], nan_ok=True)
    assert np.isnan(spectrum.dimension)


@dataclass(frozen=True)
class ChaosThatEnds(Map):
    """Exponents 0.4, -0.1 and -0.3 for 1000 iterates; after these the first is -0.2."""

    dimension = 3

    def __call__(self, state: Array) -> Array:
        count, *_ = finite_array("state", state, (3,))
        return np.array([count + 1.0, 0.0, 0.0])

    def jacobian(self, state: Array) -> Array:
        count = float(state[0])
        first = 0.4 + 0.2 * np.cos(count**2) if count < 1000.0 else -0.2
        return np.diag(np.exp([first, -0.1, -0.3]))


def test_the_error_of_the_dimension_covers_those_before_and_after_a_change() -> None:
    # At least 2.8 before the change, where the sum of the exponents is near 0; 0 after it.
    spectrum = LyapunovSpectrum.of_map(ChaosThatEnds(), [0.0, 0.0, 0.0], iterations=1600)
    assert spectrum.change is not None
    assert abs(spectrum.exponents[0]) < 2.0 * spectrum.error[0]
    assert abs(spectrum.dimension - 2.8) <= spectrum.dimension_error
    assert spectrum.dimension <= spectrum.dimension_error
