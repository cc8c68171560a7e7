"""A ball on a vibrating table: Holmes's orbits of the exact map, rest, sticking, lift-off."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.labels.label import OrbitKind
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import Ending
from dynkit.systems.maps.high_bounce import HighBounce
from tests.impact.one_mass import DIGITS, Real, flight_matrix, next_impact_derivative

ROUNDING = 2.0**-52


def make(strength: float, restitution: float, frequency: float = 3.0, **more: Any) -> BouncingBall:
    """By the table's largest acceleration over gravity."""
    gravity = more.get("gravity", 1.0)
    amplitude = strength * gravity / frequency**2
    return BouncingBall(amplitude=amplitude, frequency=frequency, restitution=restitution, **more)


# --- a bounce every n periods of the table --------------------------------------------------------


def birth(restitution: float, n: int) -> float:
    """Strength of the table at which bounces of n periods appear."""
    return math.pi * n * (1.0 - restitution) / (1.0 + restitution)


def doubling(restitution: float, n: int) -> float:
    """Strength at which their period doubles."""
    force = 2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2
    return math.hypot(birth(restitution, n), force)


def bounce(ball: BouncingBall, n: int, sign: int = 1) -> tuple[Real, Real]:
    """(u, phase); the sign is that of sin(phase)."""
    r, w, g = mpf(ball.restitution), mpf(ball.frequency), mpf(ball.gravity)
    cosine = mp.pi * n * (1 - r) / (1 + r) * g / (mpf(ball.amplitude) * w * w)
    return 2 * mp.pi * n * g * r / ((1 + r) * w), sign * mpmath.acos(cosine)


def state_of(ball: BouncingBall, n: int, sign: int = 1) -> Array:
    with mp.workdps(DIGITS):
        u, phase = bounce(ball, n, sign)
        return np.array([float(u), float(phase % (2 * mp.pi))])


def at(share: float, restitution: float, n: int, **more: Any) -> BouncingBall:
    """A ball whose table is that share of the way from birth to doubling."""
    born, doubled = birth(restitution, n), doubling(restitution, n)
    return make(born + share * (doubled - born), restitution, **more)


BOUNCES = [(r, n) for r in (0.2, 0.5, 0.8, 0.95) for n in (1, 2, 5)]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_the_closed_form_solves_the_equations_of_motion(
    restitution: float, n: int, sign: int
) -> None:
    ball = at(0.5, restitution, n, gravity=9.81)
    with mp.workdps(DIGITS):
        u, phase = bounce(ball, n, sign)
        a, w, g, r = map(mpf, (ball.amplitude, ball.frequency, ball.gravity, restitution))
        time = 2 * mp.pi * n / w
        table = a * w * mpmath.cos(phase)
        assert abs((table + u) * time - g * time * time / 2) < mpf(10) ** -35
        assert abs(r * (g * time - u) - u) < mpf(10) ** -35


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_periodic_bounces_are_fixed_points(restitution: float, n: int, sign: int) -> None:
    ball = at(0.5, restitution, n)
    state = state_of(ball, n, sign)
    steepest = abs(ball.jacobian(state)).max()
    # The state is rounded, and the height of a bounce, n^2 g T^2 / 8, is the largest length.
    size = 1.0 + abs(state).max() + (math.pi * n / ball.frequency) ** 2 / 2.0
    allowed = 4.0 * ROUNDING * (1.0 + steepest) * size
    assert abs(ball.difference(ball(state), state)).max() <= allowed


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_the_jacobian_is_the_closed_form(restitution: float, n: int, sign: int) -> None:
    ball = at(0.5, restitution, n)
    with mp.workdps(DIGITS):
        u, phase = bounce(ball, n, sign)
        r, w = mpf(restitution), mpf(ball.frequency)
        strength = mpf(ball.amplitude) * w * w
        second = strength * mpmath.sin(phase) - mpf(ball.gravity)
        flight = flight_matrix(0, 0, 2 * mp.pi * n / w)
        exact = next_impact_derivative(flight, (u, second), (-u / r, second), r, w)
        trace, determinant = exact[0, 0] + exact[1, 1], mpmath.det(exact)
        # In closed form: r^2, and all of the table's acceleration in the trace.
        assert abs(determinant - r * r) < mpf(10) ** -35
        assert abs(trace + 2 * r + (1 + r) ** 2 * second / mpf(ball.gravity)) < mpf(10) ** -35
    found = ball.jacobian(state_of(ball, n, sign))
    expected = np.array(exact.tolist(), dtype=float)
    # Elements change by about their squares over u when the impact is shifted, and by b when the
    # phase is, for the table's acceleration.
    size = abs(expected).max() ** 2 / float(u) + birth(restitution, n)
    allowed = 8.0 * ROUNDING * (1.0 + size)
    assert abs(found - expected).max() <= allowed


@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_bounces_are_born_with_multiplier_1(restitution: float, n: int) -> None:
    ball = make(birth(restitution, n) * (1.0 + 4.0 * ROUNDING), restitution)
    trace = np.trace(ball.jacobian(state_of(ball, n)))
    # sin(phase) is the square root of the rounding by which the strength is beyond birth
    allowed = (1.0 + restitution) ** 2 * math.sqrt(16.0 * ROUNDING) * birth(restitution, n)
    assert 1.0 - trace + restitution**2 == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_bounces_double_their_period_with_multiplier_minus_1(restitution: float, n: int) -> None:
    ball = make(doubling(restitution, n), restitution)
    jacobian = ball.jacobian(state_of(ball, n))
    # An error of cos(phase) changes the strength times sin(phase) by b / 2 times as much.
    allowed = 8.0 * ROUNDING * (1.0 + birth(restitution, n)) ** 2
    assert 1.0 + np.trace(jacobian) + restitution**2 == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize(("share", "stable"), [(0.01, True), (0.99, True), (1.01, False)])
@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_bounces_are_stable_between_birth_and_doubling(
    restitution: float, n: int, share: float, stable: bool
) -> None:
    ball = at(share, restitution, n)
    sizes = abs(np.linalg.eigvals(ball.jacobian(state_of(ball, n))))
    assert (sizes.max() < 1.0) == stable


@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_their_twins_are_saddles(restitution: float, n: int) -> None:
    ball = at(0.5, restitution, n)
    sizes = np.sort(abs(np.linalg.eigvals(ball.jacobian(state_of(ball, n, -1)))))
    assert sizes[0] < 1.0 < sizes[1]


@pytest.mark.parametrize(("restitution", "n"), [(0.2, 1), (0.5, 1), (0.5, 2), (0.8, 1), (0.8, 2)])
@pytest.mark.parametrize(("share", "bounces"), [(0.5, 1), (1.02, 2)])
def test_labels_tell_bounces_from_doubled_ones(
    restitution: float, n: int, share: float, bounces: int
) -> None:
    ball = at(share, restitution, n)
    start = ball.impact_state(state_of(ball, n) * [1.0, 1.001])
    attractor = ball.attractor(transient=3000, impacts=100, start=start)
    assert str(attractor.label) == f"P({bounces},{bounces * n})"


@pytest.mark.parametrize(("restitution", "n"), BOUNCES)
def test_stable_bounces_are_kept(restitution: float, n: int) -> None:
    ball = at(0.5, restitution, n)
    state = state_of(ball, n)
    record = ball.simulate(impacts=1000, start=ball.impact_state(state))
    assert abs(ball.difference(record.states, state)).max() < 1e-12


# --- its limit of high bounces --------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.5, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_high_bounces_are_those_of_holmess_map(restitution: float, phase: float) -> None:
    gamma = 4.0
    high = HighBounce(restitution, gamma)
    ball = make(gamma / (2.0 * (1.0 + restitution)), restitution, frequency=2.0)
    unit = ball.gravity / (2.0 * ball.frequency)  # of velocities in Holmes's map
    swing = ball.amplitude * ball.frequency
    height = 10.0 ** np.arange(2.0, 5.5, 0.5)
    off = []
    for v in height:
        # Holmes's table is half a turn behind.
        own = phase + math.pi
        u, arrival = ball(np.array([v * unit - swing * math.cos(own), own]))
        exact = np.array([arrival - math.pi, (u + swing * math.cos(arrival)) / unit])
        off.append(abs(high.difference(exact, high(np.array([phase, v])))))
    late = 2.0 * gamma / ((1.0 + restitution) * height)  # the documented bound of the phase
    assert (np.array(off)[:, 0] <= 1.1 * late).all()
    assert (np.array(off)[:, 1] <= 1.1 * (2.0 * restitution + gamma) * late).all()


@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_the_difference_falls_as_the_height_grows(restitution: float) -> None:
    # v is a whole number of turns: the table's phase at arrival does not change with the height.
    gamma, phase = 4.0, 1.0
    high = HighBounce(restitution, gamma)
    ball = make(gamma / (2.0 * (1.0 + restitution)), restitution, frequency=2.0)
    unit, swing = ball.gravity / (2.0 * ball.frequency), ball.amplitude * ball.frequency
    own = phase + math.pi
    turns = 2.0 ** np.arange(6.0, 14.0)
    shift = math.pi / 2.0  # the table is elsewhere than where the ball started
    off = []
    for v in 2.0 * math.pi * turns + shift:
        arrival = ball(np.array([v * unit - swing * math.cos(own), own]))[1]
        following = high(np.array([phase, v]))
        off.append(abs(high.difference(np.array([arrival - math.pi, 0.0]), following))[0])
    exponent = np.polyfit(np.log(turns), np.log(off), 1)[0]
    # The next order is smaller by 1 / v < 1 / 400.
    assert exponent == pytest.approx(-1.0, abs=1e-2)


# --- a table at rest ------------------------------------------------------------------------------

RESTING = [0.1, 0.5, 0.8, 0.9]
GRAVITY, SPEED = 0.7, 1.3


def thrown(restitution: float, tolerance: float = 1e-16) -> tuple[BouncingBall, ImpactState]:
    ball = BouncingBall(
        gravity=GRAVITY,
        amplitude=0.0,
        frequency=1.0,
        restitution=restitution,
        chatter_tolerance=tolerance,
    )
    return ball, ball.impact_state(np.array([SPEED, 0.5]))


@pytest.mark.parametrize("restitution", RESTING)
def test_bounces_on_a_table_at_rest_are_geometric(restitution: float) -> None:
    ball, start = thrown(restitution, 0.0)
    count = int(-280.0 / math.log10(restitution)) // 10  # speeds down to 1e-28
    record = ball.simulate(impacts=count, start=start)
    powers = restitution ** np.arange(1.0, count + 1.0)
    times = 2.0 * SPEED / GRAVITY * (1.0 - powers) / (1.0 - restitution)
    # A rounding or two per bounce; the rounding of r enters its k-th power k times.
    assert record.relative_velocity == pytest.approx(
        SPEED * powers, rel=2.0 * ROUNDING * count, abs=0.0
    )
    assert record.time == pytest.approx(times, rel=2.0 * ROUNDING / (1.0 - restitution), abs=0.0)


@pytest.mark.parametrize("restitution", RESTING)
def test_bounces_end_at_zenos_time(restitution: float) -> None:
    ball, start = thrown(restitution)
    record = ball.simulate(impacts=1000, start=start)
    with mp.workdps(DIGITS):
        zeno = 2 * mpf(SPEED) / (mpf(GRAVITY) * (1 - mpf(restitution)))
        # 1 - r is exact for the bounces too; the rest are roundings that decay with them
        allowed = 2.0 * ROUNDING / (1.0 - restitution)
        assert abs(mpf(float(record.sticking[0, 0])) / zeno - 1) < allowed


@pytest.mark.parametrize("restitution", RESTING)
def test_after_zenos_time_the_ball_lies_for_ever(restitution: float) -> None:
    ball, start = thrown(restitution)
    record = ball.simulate(impacts=1000, start=start)
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert math.isinf(record.sticking[0, 1])
    position, velocity = record.sample([40.0, 1e6])
    assert not position.any()
    assert not velocity.any()


def test_an_elastic_ball_bounces_for_ever() -> None:
    ball, start = thrown(1.0)
    record = ball.simulate(impacts=100_000, start=start)
    flight = 2.0 * SPEED / GRAVITY
    # Roundings without bias: their sum grows as the square root of their number.
    assert record.relative_velocity == pytest.approx(SPEED, rel=316.0 * ROUNDING, abs=0.0)
    assert record.time[-1] == pytest.approx(100_000 * flight, rel=316.0 * ROUNDING, abs=0.0)


# --- sticking to a moving table -------------------------------------------------------------------


def resting(ball: BouncingBall) -> ImpactState:
    """On the table at its middle, going up with it."""
    return ball.state([0.0], [ball.amplitude * ball.frequency], 0.0)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8, 1.0])
@pytest.mark.parametrize("strength", [0.0, 0.5, 0.999])
def test_a_weak_table_never_throws_the_ball(strength: float, restitution: float) -> None:
    ball = make(strength, restitution)
    record = ball.simulate(impacts=100, start=resting(ball))
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert len(record) == 0


@pytest.mark.parametrize("frequency", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("strength", [1.000001, 1.1, 1.5, 3.0, 100.0])
def test_a_ball_is_lifted_off_where_the_table_falls_with_gravity(
    strength: float, frequency: float
) -> None:
    ball = make(strength, 0.3, frequency)
    record = ball.simulate(impacts=1, start=resting(ball))
    phase = frequency * record.sticking[0, 1]
    with mp.workdps(DIGITS):
        exact = float(mpmath.asin(1 / (mpf(ball.amplitude) * mpf(frequency) ** 2)))
    # The force g (1 - G sin(phase)) is rounded, and rises by g sqrt(G^2 - 1) per phase.
    allowed = 8.0 * ROUNDING * (1.0 + 1.0 / math.sqrt(strength**2 - 1.0))
    assert phase == pytest.approx(exact, abs=allowed)


@pytest.mark.parametrize("restitution", [0.0, 0.3])
@pytest.mark.parametrize("strength", [1.1, 1.5, 3.0])
def test_the_flight_after_lift_off_is_that_of_a_thrown_ball(
    strength: float, restitution: float
) -> None:
    # Mehta & Luck 1990: sin(p) = sin(q) + (p - q) cos(q) - (p - q)^2 / (2 G), sin(q) = 1 / G.
    ball = make(strength, restitution)
    record = ball.simulate(impacts=1, start=resting(ball))
    with mp.workdps(DIGITS):
        big = mpf(ball.amplitude) * mpf(ball.frequency) ** 2
        start = mpmath.asin(1 / big)

        def gap(passed: Real) -> Real:
            thrown = passed * mpmath.cos(start) - passed * passed / (2 * big)
            # three times zero at lift-off, which is divided out
            return (mpmath.sin(start) + thrown - mpmath.sin(start + passed)) / passed**3

        ends = (mpf("0.5"), 2 * mp.pi * strength)
        passed = mpmath.findroot(gap, ends, solver="anderson")
        speed = big * (mpmath.cos(start + passed) - mpmath.cos(start)) + passed
        u = float(mpf(restitution) * speed / ball.frequency)
    assert ball.frequency * record.time[0] == pytest.approx(
        float(start + passed), rel=1e-13, abs=0.0
    )
    assert record.relative_velocity[0] == pytest.approx(u, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("restitution", [0.0, 0.1, 0.3])
def test_a_ball_thrown_softly_comes_to_rest_in_every_period(restitution: float) -> None:
    ball = make(1.2, restitution)
    attractor = ball.attractor(transient=100, impacts=100)
    assert str(attractor.label) == "P(inf,1)"
    # lift-off is at one phase, whatever the bounces were
    record = ball.simulate(impacts=100)
    phases = ball.frequency * record.sticking[:, 1] % (2.0 * math.pi)
    assert phases == pytest.approx(math.asin(1.0 / 1.2), abs=1e-13 * record.time[-1])


def test_chatter_locks_the_bounces_of_a_strong_table() -> None:
    # Luck & Mehta 1993: once the ball has come to rest on the table, all that follows is periodic.
    assert make(10.0, 0.5).attractor().label.kind is OrbitKind.STICKING


# --- units ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [0.1, 9.81])
def test_gravity_is_a_unit_of_time(gravity: float) -> None:
    one = BouncingBall(amplitude=0.2, frequency=3.0, restitution=0.6)
    rate = math.sqrt(gravity)
    other = one.replace(gravity=gravity, frequency=3.0 * rate)
    slow, fast = one.simulate(impacts=30), other.simulate(impacts=30)
    allowed = slow.error + fast.error / rate
    assert (abs(fast.relative_velocity / rate - slow.relative_velocity) <= allowed).all()


def test_the_default_start_is_at_rest_at_height_one() -> None:
    start = BouncingBall(frequency=2.0).state()
    assert start.position.tolist() == [1.0]
    assert start.velocity.tolist() == [0.0]
