"""Flows with resets: closed forms, walkers in the literature and in sixty digits, refusals."""

from __future__ import annotations

import pickle
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import sympy as sp
from flint import arb, ctx
from mpmath import mp

from dynkit import (
    Branch,
    Hyperplane,
    MapOrbit,
    NoConvergence,
    NoCrossing,
    PoincareMap,
    ResetMap,
    TangentCrossing,
    continue_orbit,
    periodic_orbit,
)
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.smooth_map import product_with_error
from dynkit.core.validation import Array
from dynkit.systems import CompassGait, Lorenz, SimplestWalker, SymbolicFlow, SymbolicHybridFlow
from dynkit.testing import FlowCheck, MapCheck, check_name, flow_checks, map_checks
from tests.flows.cases import BITS
from tests.flows.walkers import (
    ByHeight,
    DrivenFire,
    Fire,
    PlainWheel,
    Wheel,
    compass_accelerations,
    compass_reset,
    step_in_many_digits,
)

STRIDE, GAIT = [0.2, 0.4, -0.2, -0.016], [-0.323, 0.219, -0.377, -1.092]


def steps(walker: Any, angles: tuple[int, ...] = ()) -> Any:
    return ResetMap(walker, time_limit=10.0, angles=angles)


@cache
def gait(walker: Any) -> MapOrbit:
    start = STRIDE if isinstance(walker, SimplestWalker) else GAIT
    return periodic_orbit(steps(walker), start)


# --- the contracts --------------------------------------------------------------------------------

MAPS: dict[str, tuple[Any, list[list[float]]]] = {
    "simplest walker": (steps(SimplestWalker()), [STRIDE, [0.201, 0.39, -0.2, 0.01]]),
    "compass gait": (steps(CompassGait()), [GAIT, [-0.33, 0.22, -0.3, -1.1]]),
    "wheel": (steps(Wheel()), [[-0.18, 0.5], [-0.1, 0.4]]),
    "neuron": (steps(Fire()), [[0.0], [0.3]]),
    "driven neuron": (steps(DrivenFire(), (1,)), [[0.0, 1.0], [0.1, 6.0]]),
    "by the height of the foot": (steps(ByHeight()), [STRIDE]),
}


@pytest.mark.parametrize("check", map_checks, ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_the_map_from_reset_to_reset_is_a_map(name: str, check: MapCheck) -> None:
    system, states = MAPS[name]
    check(system, np.array(states))


def test_guard_and_reset_in_plain_python_have_differences() -> None:
    state, exact = np.array([-0.18, 0.5]), steps(Wheel())
    plain = steps(PlainWheel())
    assert plain.jacobian(state) == pytest.approx(exact.jacobian(state), abs=1e-9)
    for name in ("slope", "spoke"):
        found, known = (each.parameter_derivative(state, name) for each in (plain, exact))
        assert found == pytest.approx(known, abs=1e-8)


@pytest.mark.parametrize("check", flow_checks, ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_between_resets_it_is_a_flow(name: str, check: FlowCheck) -> None:
    system, states = MAPS[name]
    check(system.flow, np.array(states))


def test_it_is_sent_to_another_process() -> None:
    system, states = MAPS["compass gait"]
    sent = pickle.loads(pickle.dumps(system))
    assert np.array_equal(sent(np.array(states[0])), system(np.array(states[0])))


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.05, 0.2])
def test_the_wheel_rolls_as_in_closed_form(slope: float) -> None:
    # energy over a step, and the loss c at a spoke: w^2 = c^2 (w^2 + gained); the multiplier is c^2
    wheel = Wheel(slope=slope)
    c = np.cos(wheel.spoke)
    gained = 2.0 * (np.cos(slope - wheel.spoke / 2) - np.cos(slope + wheel.spoke / 2))
    orbit = periodic_orbit(steps(wheel), [slope - 0.26, 0.6])
    exact = np.array([slope - wheel.spoke / 2, np.sqrt(c**2 * gained / (1.0 - c**2))])
    assert np.linalg.norm(orbit.states[0] - exact) <= orbit.error < 1e-11
    assert orbit.multipliers.shape == (1,)
    assert abs(orbit.multipliers[0] - c**2) <= orbit.multipliers_error[0] < 1e-10


def test_the_exponent_of_the_wheel_is_the_logarithm_of_its_multiplier() -> None:
    system = steps(Wheel())
    state = periodic_orbit(system, [-0.18, 0.5]).states[0]
    found = LyapunovSpectrum.of_map(system, state, iterations=128)
    assert found.exponents == pytest.approx([np.log(0.75)], abs=1e-12)
    per_time = np.log(0.75) / system.return_time(state)
    assert found.per_time == pytest.approx([per_time], abs=1e-12)


def test_a_wheel_that_is_too_slow_stops() -> None:
    with pytest.raises(NoCrossing, match=r"no crossing within 10\.0"):
        steps(Wheel(slope=0.01))([-0.25, 0.05])


class Falling(SymbolicHybridFlow):
    """A ball that falls with acceleration 1 onto a floor."""

    floor: float = 0.0

    def velocity(self, height: Any, speed: Any) -> Any:
        return speed, -1

    def guard(self, height: Any, speed: Any) -> Any:
        return height - self.floor

    def reset(self, height: Any, speed: Any) -> Any:
        return self.floor, -speed / 2


@pytest.mark.parametrize("speed", [0.5, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9])
def test_low_jumps_keep_their_digits(speed: float) -> None:
    bounces = steps(Falling())
    assert bounces.return_time(np.array([0.0, speed])) == pytest.approx(2.0 * speed, rel=1e-14)
    after = bounces([0.0, speed])
    assert after == pytest.approx([0.0, speed / 2], rel=1e-14, abs=0.0)


def test_jumps_too_low_for_rounding_are_named() -> None:
    # heights at 1 resolve 1e-16, and the jump is of 5e-19
    with pytest.raises(NoCrossing, match="the motion was never clearly before the section"):
        steps(Falling(floor=1.0))([1.0, 1e-9])


class Dribble(SymbolicHybridFlow):
    """A ball on a vibrating table: height, speed and the phase of the table."""

    def velocity(self, height: Any, speed: Any, phase: Any) -> Any:
        return speed, -1, 1

    def guard(self, height: Any, speed: Any, phase: Any) -> Any:
        return height - sp.sin(phase) / 10

    def reset(self, height: Any, speed: Any, phase: Any) -> Any:
        return height, -speed / 2 + 3 * sp.cos(phase) / 20, phase


@pytest.mark.parametrize("speed", [1e-2, 1e-4, 1e-5])
def test_errors_of_low_jumps_on_a_moving_table_hold(speed: float) -> None:
    table = steps(Dribble())
    for phase in np.linspace(0.0, 6.0, 12).tolist():
        state = np.array([0.1 * np.sin(phase), speed + 0.1 * np.cos(phase), phase])
        with mp.workdps(50):
            y, v, p = (mp.mpf(x) for x in state.tolist())
            falls = 1 - mp.sin(p) / 10
            time = mp.findroot(
                lambda t, y=y, v=v, p=p: y + v * t - t**2 / 2 - mp.sin(p + t) / 10,
                2 * (v - mp.cos(p) / 10) / falls,
            )
            exact = float((time - v) / 2 + 3 * mp.cos(p + time) / 20)
        (error,) = table.call_errors(state[None])
        assert abs(table(state)[1] - exact) <= error


class Fast(SymbolicHybridFlow):
    """A ball whose flights last for many periods of the table: height, speed and time."""

    def velocity(self, height: Any, speed: Any, t: Any) -> Any:
        return speed, -1

    def guard(self, height: Any, speed: Any, t: Any) -> Any:
        return height - sp.sin(60 * t) / 50

    def reset(self, height: Any, speed: Any, t: Any) -> Any:
        table = 6 * sp.cos(60 * t) / 5
        return height, table - (speed - table) * sp.Rational(4, 5), t


def test_no_jump_on_a_fast_table_is_missed() -> None:
    table, state = ResetMap(Fast(), time_limit=100.0), np.array([0.5, 1.0, 0.0])
    for _ in range(30):
        lasts = table.return_time(state)
        times = np.linspace(0.0, lasts, 20_001)[1:-1]
        gaps = state[0] + state[1] * times - times**2 / 2 - np.sin(60.0 * (state[2] + times)) / 50
        assert gaps[gaps.argmax() :].min() > -1e-12  # the highest place comes after the begin
        state = table(state)
    assert state[2] > 100.0


def test_the_neuron_fires_as_in_closed_form() -> None:
    neuron = steps(Fire(current=1.3))
    assert neuron.return_time([0.0]) == pytest.approx(np.log(1.3 / 0.3), rel=1e-15)
    orbit = periodic_orbit(neuron, [0.2])
    assert (orbit.states.tolist(), orbit.multipliers.size, orbit.stable) == ([[0.0]], 0, True)


def test_the_tongue_of_the_driven_neuron_is_that_of_the_closed_form() -> None:
    # locked 1:1 with the period T, (1 - exp(-T)) (current + force cos(shift) / sqrt(1 + w^2)) = 1;
    # the folds are where the cosine is 1 or -1
    system = steps(DrivenFire(), (1,))
    orbit = system.attractor(start=[0.0, 0.0]).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(5.0, 6.4))
    assert branch.closed
    found = sorted(branch.bifurcations, key=lambda fold: fold.value)
    assert [fold.kind.value for fold in found] == ["SN", "SN"]
    for fold, sign in zip(found, (-1.0, 1.0), strict=True):
        w = fold.value
        level = 1.5 + sign * 0.3 / np.sqrt(1.0 + w**2)
        off = (1.0 - np.exp(-2.0 * np.pi / w)) * level - 1.0
        slope = np.exp(-2.0 * np.pi / w) * 2.0 * np.pi / w**2 * level
        assert abs(off) <= max(fold.error, 1e-11) * slope


# --- the simplest walker --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("guess", "published", "time"),
    [
        # P. A. Bhounsule, Numerical accuracy of two benchmark models of walking: the rimless spoked
        # wheel and the simplest walker, Dynamics of Continuous, Discrete and Impulsive Systems B 21
        # (2014) 137-148; the numbers are those of his program simplestwalker.m, to 1e-12 there
        ((0.2, -0.2), (0.200310900563820, -0.199832473025474, -0.015822999949030), 3.882),
        ((0.19, -0.2), (0.193937369810188, -0.203866927442012, -0.015144260853193), 3.096),
    ],
)
def test_gaits_of_the_simplest_walker_are_the_published_ones(
    guess: tuple[float, float], published: tuple[float, ...], time: float
) -> None:
    theta, rate = guess
    start = [theta, 2 * theta, rate, rate * (1.0 - np.cos(2 * theta))]
    system = steps(SimplestWalker(slope=0.009))
    orbit = periodic_orbit(system, start)
    found = orbit.states[0]
    assert found[[0, 2, 3]] == pytest.approx(published, abs=1e-10)
    assert found[1] == pytest.approx(2.0 * found[0], abs=1e-14)
    assert system.return_time(found) == pytest.approx(time, abs=1e-3)
    assert orbit.stable == (time > 3.5)


def test_steps_of_small_slopes_tend_to_the_published_ones() -> None:
    # Garcia et al. 1998, appendix A.2: theta = 0.970956 g^(1/3), and its rate -1.045203 times that,
    # six digits; the next terms are smaller by g^(2/3), and extrapolation takes three of them away
    found = []
    for slope in 5e-4 / 8.0 ** np.arange(4):
        theta, rate = 0.970956 * slope ** (1.0 / 3.0), -1.014846 * slope ** (1.0 / 3.0)
        start = [theta, 2 * theta, rate, rate * (1.0 - np.cos(2 * theta))]
        state = periodic_orbit(steps(SimplestWalker(slope=slope)), start).states[0]
        found.append(state[[0, 2]] / slope ** (1.0 / 3.0))
    for power in (4.0, 16.0, 64.0):
        found = [(power * fine - rough) / (power - 1.0) for rough, fine in pairwise(found)]
    assert found[0] == pytest.approx([0.970956, -1.045203 * 0.970956], abs=2e-6)


@cache
def walking(walker: Any, end: float) -> Branch:
    return continue_orbit(gait(walker), "slope", bounds=(walker.slope, end))


def test_the_simplest_walker_doubles_its_period_where_it_is_published() -> None:
    # Garcia et al. 1998, section 5.1: gaits of one step are stable for slopes up to 0.0151
    (doubling,) = walking(SimplestWalker(), 0.018).bifurcations
    assert doubling.kind.value == "PD"
    assert abs(doubling.value - 0.0151) < 5e-5
    assert doubling.error < 1e-9


def test_a_foot_that_scuffs_is_ignored() -> None:
    state = gait(SimplestWalker()).states[0]
    for walker in (SimplestWalker(), ByHeight()):
        assert steps(walker)(state) == pytest.approx(state, abs=1e-12)

    class Unaware(ByHeight):
        def armed(self, stance: Any, swing: Any, u: Any, v: Any) -> Any:
            return 1

    assert steps(Unaware()).return_time(state) < 0.6 * steps(ByHeight()).return_time(state)


# --- the compass gait -----------------------------------------------------------------------------
# A. Goswami, B. Thuilot, B. Espiau, INRIA report 2996 (1996); its numbers are taken from a public
# transcription, references_goswami.py of github.com/nyasuto/crane, as are those of Garcia et al.


def test_the_compass_obeys_lagrange_and_keeps_two_angular_momenta() -> None:
    random = np.random.default_rng(3)
    for _ in range(5):
        masses = dict(zip(("hip_mass", "leg_mass"), random.integers(1, 9, 2).tolist(), strict=True))
        walker: Any = CompassGait(slope=0.1, foot_to_mass=0.25, mass_to_hip=0.75, **masses)
        state = random.uniform(-1.0, 1.0, 4)
        exact = compass_accelerations(walker)(*map(arb, state.tolist()))
        assert walker.velocity(state)[2:] == pytest.approx([float(x) for x in exact], rel=1e-12)
        after = compass_reset(walker, state.tolist(), np.sin, np.cos)
        assert walker.reset(state) == pytest.approx(after, rel=1e-11, abs=1e-12)


def test_the_gait_of_the_compass_is_the_published_one() -> None:
    # Goswami et al. 1996 at 3 degrees: the moduli of the eigenvalues over two steps are 0.332,
    # 0.332, 0.014 (equation 3.44); figures C.4 and C.5, read to 2 %: a step takes 0.735 s, and the
    # legs are 0.271 rad from the normal of the slope
    orbit = gait(CompassGait())
    assert steps(CompassGait()).return_time(orbit.states[0]) == pytest.approx(0.735, rel=0.02)
    assert orbit.states[0, 1] + np.radians(3.0) == pytest.approx(0.271, rel=0.02)
    twice = abs(orbit.multipliers) ** 2
    assert twice[:2] == pytest.approx([0.332, 0.332], abs=0.005)
    assert twice[2] == pytest.approx(0.014, abs=0.005)


def test_the_compass_doubles_its_period_where_it_is_published() -> None:
    # Goswami et al. 1996, section 4.2: 4.37 degrees, then 4.9 degrees; here 4.391 and 4.914
    (first,) = walking(CompassGait(), 0.08).bifurcations
    assert first.kind.value == "PD"
    assert np.degrees(first.value) == pytest.approx(4.37, abs=0.03)
    (doubled,) = first.switch()
    branch = continue_orbit(doubled, "slope", bounds=(0.0765, 0.0865))
    second = [found for found in branch.bifurcations if found.kind.value == "PD"]
    assert np.degrees([found.value for found in second]) == pytest.approx([4.9], abs=0.05)


def test_the_compass_is_chaotic_where_it_is_published() -> None:
    # Goswami et al. 1996, section 4.2.5: chaos at 5.2 degrees
    walker = CompassGait(slope=float(np.radians(5.2)))
    found = LyapunovSpectrum.of_map(steps(walker), gait(CompassGait()).states[0], iterations=200)
    assert found.exponents[0] > 5.0 * found.error[0] > 0.0
    assert found.exponents.shape == (3,)


# --- sixty digits ---------------------------------------------------------------------------------


@pytest.mark.parametrize("walker", [SimplestWalker(), CompassGait()], ids=["simplest", "compass"])
def test_a_gait_is_as_accurate_as_it_says(walker: Any) -> None:
    system, orbit = steps(walker), gait(walker)
    state = orbit.states[0]
    hit = system.crossing(state)
    time, after = step_in_many_digits(walker, [arb(x) for x in state.tolist()], hit.time)
    off = np.array([float(x) for x in after]) - system(state)
    assert np.linalg.norm(off) <= system.accuracy * (1.0 + np.linalg.norm(state))
    assert abs(float(time - arb(hit.time))) <= 10.0 * system.accuracy
    # one step of Newton's method, with the residual in sixty digits
    residual = np.array([float(x - y) for x, y in zip(after, state.tolist(), strict=True)])
    moved = np.linalg.solve(np.eye(4) - system.jacobian(state), residual)
    assert np.linalg.norm(moved) <= orbit.error


@pytest.mark.parametrize("walker", [SimplestWalker(), CompassGait()], ids=["simplest", "compass"])
def test_the_jacobian_is_that_of_sixty_digits(walker: Any) -> None:
    system, state = steps(walker), gait(walker).states[0]
    time, small, along = system.return_time(state), 1e-12, [1.0, -0.5, 2.0, 0.75]
    with ctx.workprec(BITS):
        ends = []
        for sign in (1, -1):
            starts = zip(state.tolist(), along, strict=True)
            start = [arb(x) + sign * arb(small) * arb(w) for x, w in starts]
            ends.append(step_in_many_digits(walker, start, time)[1])
        exact = [float((p - q) / (2 * arb(small))) for p, q in zip(*ends, strict=True)]
    jacobian = system.jacobian(state)
    allowed = 10.0 * system.accuracy * np.linalg.norm(jacobian)
    assert np.linalg.norm(jacobian @ along - exact) <= allowed


@pytest.mark.parametrize("walker", [SimplestWalker(), CompassGait()], ids=["simplest", "compass"])
def test_multipliers_are_the_eigenvalues_of_the_jacobian_but_one(walker: Any) -> None:
    orbit = gait(walker)
    known = sorted(np.linalg.eigvals(steps(walker).jacobian(orbit.states[0])), key=abs)[1:]
    assert np.poly(orbit.multipliers) == pytest.approx(np.poly(np.array(known)), abs=1e-11)


# --- refusals -------------------------------------------------------------------------------------


class Twisted(Wheel):
    def guard(self, rate: Any, angle: Any) -> Any:  # type: ignore[override]
        return 1 - angle


class Short(Wheel):
    def reset(self, angle: Any, rate: Any) -> Any:
        return (angle,)


class Worded(PlainWheel):
    def guard(self, state: Array) -> Any:
        return "below"


class Disarmed(PlainWheel):
    def armed(self, state: Array) -> Any:
        return None


class Crossed(PlainWheel):
    def guard(self, state: Array) -> Any:
        return state[0] < 0


class Conditional(PlainWheel):
    least: float = 0.0

    def armed(self, state: Array) -> Any:
        return state[1] > self.least


def test_a_condition_arms_a_guard() -> None:
    start = np.array([0.2, 1.0])
    assert np.array_equal(steps(Conditional())(start), steps(PlainWheel())(start))
    with pytest.raises(NoCrossing):
        steps(Conditional().replace(least=9.0))(start)


class Choosing(Wheel):
    def guard(self, angle: Any, rate: Any) -> Any:
        return angle if rate > 0 else -angle


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: steps(Lorenz()), "flow must be a HybridFlow, with guard and reset"),
        (lambda: ResetMap(Wheel(), 0.0), "time_limit must be positive"),
        (lambda: ResetMap(Wheel(), 1.0, angles=(2,)), r"angles\[0\] must"),
        (
            lambda: PoincareMap(Wheel(), Hyperplane(np.array([1.0, 0.0])), 1.0),
            "flow must have no resets",
        ),
        (
            lambda: LyapunovSpectrum.of_flow(Wheel(), [0.0, 1.0], interval=1.0),
            "flow must have no resets",
        ),
        (lambda: CompassGait(leg_mass=0.0), "leg_mass must be positive"),
        (lambda: SimplestWalker(slope=float("nan")), "slope must be a finite number"),
        (lambda: steps(Short())([0.0, 1.0]), r"Short\.reset must return 2 expressions"),
        (
            lambda: steps(Worded())([0.2, 1.0]),
            r"Worded\.guard must return a real number; got 'below'",
        ),
        (
            lambda: steps(Disarmed())([0.2, 1.0]),
            r"Disarmed\.armed must return a real number; got None",
        ),
        (lambda: steps(Crossed())([0.2, 1.0]), r"Crossed\.guard must return a real number; got "),
        (lambda: steps(Wheel())([0.0]), r"state must have shape \(2,\)"),
        (lambda: steps(Wheel()).parameter_derivative([0.0, 1.0], "mass"), "parameter must be one"),
    ],
)
def test_wrong_input_is_refused(wrong: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (Twisted, r"Twisted\.guard must take the coordinates of velocity, angle, rate"),
        (Choosing, r"Choosing\.guard must not compare symbols"),
    ],
)
def test_wrong_methods_are_refused(wrong: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        steps(wrong())([0.0, 1.0])


def test_a_motion_that_touches_the_guard_has_no_derivative() -> None:
    class Touching(PlainWheel):
        def guard_gradient(self, state: Array) -> Array:
            return np.zeros_like(state)

    with pytest.raises(TangentCrossing, match="the motion is tangent to the guard"):
        steps(Touching()).parameter_derivative([0.2, 1.0], "slope")


def test_a_guess_that_falls_is_no_gait() -> None:
    with pytest.raises(NoConvergence, match="no crossing within"):
        periodic_orbit(steps(CompassGait()), [0.3, -0.3, 5.0, 5.0])


def test_parameters_that_the_velocity_does_not_hold() -> None:
    class Late(SymbolicFlow):
        rate: float = 2.0
        unused: float = 1.0

        def velocity(self, x: Any, y: Any) -> Any:
            return self.rate * y, -x

    flow: Any = Late()
    assert flow.advance([1.0, 0.0], 0.5)[0] == pytest.approx(np.cos(np.sqrt(2.0) * 0.5))
    assert flow.parameter_derivative([1.0, 0.0], 0.5, "unused").tolist() == [0.0, 0.0]
    assert flow.derivative([1.0, 0.0], 0.5).shape == (2, 2)


class Ball(SymbolicHybridFlow):
    """A ball under gravity above a plate that drives it, with heights in a unit of their own."""

    unit: float = 1.0

    def velocity(self, height: Any, speed: Any) -> Any:
        return self.unit * speed, -1

    def guard(self, height: Any, speed: Any) -> Any:
        return height

    def reset(self, height: Any, speed: Any) -> Any:
        return 0, 0.1 - 0.8 * speed


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e8, 1e100])
def test_derivatives_in_other_units_of_one_coordinate(unit: float) -> None:
    """The ball falls at the speed root(v^2 + 2 x); a parabola has many short steps there."""
    roll = ResetMap(Ball(unit=unit), time_limit=100.0)
    found = roll.jacobian(np.array([0.1 * unit, 0.4]))
    np.testing.assert_allclose(found[1], [0.8 / 0.6 / unit, 0.8 * 0.4 / 0.6], rtol=1e-6)
    assert not found[0].any()


def test_the_error_of_a_product_has_the_units_of_its_entries() -> None:
    """Of 200 shears in one unit of length and another; a bound by norms is 1e1600 in one."""
    random, count = np.random.default_rng(0), 200
    shears = np.tile([[0.9, 1e8], [0.0, 0.9]], (count, 1, 1))
    off = np.full(count, 1e-14)
    product, bound = product_with_error(shears, off)
    assert bound < 1.0
    for _ in range(20):
        changed = shears + 1e-14 * random.choice([-1.0, 1.0], shears.shape)
        assert abs(product_with_error(changed, off)[0] - product).max() <= bound
