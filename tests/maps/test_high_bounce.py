"""Holmes's map for high bounces: his closed forms, and the exact ball that it approximates."""

import numpy as np
import pytest
from scipy.optimize import brentq

from dynkit import MapAttractor
from dynkit.core.validation import Array
from dynkit.systems.maps.high_bounce import HighBounce

ROUNDING = 2.0**-52
TURN = 2.0 * np.pi


def fixed_point(ball: HighBounce, n: int, sign: float) -> Array:
    """Guckenheimer and Holmes 1983, section 2.4; sign is that of sin phi."""
    cosine = -TURN * n * (1.0 - ball.restitution) / ball.gamma
    return np.array([(sign * np.arccos(cosine)) % TURN, TURN * n])


def first_doubling(restitution: float, n: int) -> float:
    """Guckenheimer and Holmes 1983, section 2.4."""
    return float(2.0 * np.hypot(np.pi * n * (1.0 - restitution), 1.0 + restitution))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("n", [-1, 0, 1, 2])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8, 1.0])
def test_fixed_points_are_holmess(restitution: float, n: int, sign: float) -> None:
    ball = HighBounce(restitution, gamma=14.0)
    state = fixed_point(ball, n, sign)
    # roundings of phases up to three turns, multiplied by gamma
    allowed = 15.0 * 8.0 * ROUNDING * TURN * 3
    assert ball.difference(ball(state), state) == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8])
def test_pairs_of_fixed_points_are_born_with_multiplier_1(restitution: float, n: int) -> None:
    ball = HighBounce(restitution, TURN * n * (1.0 - restitution))
    trace = np.trace(ball.jacobian(np.array([np.pi, TURN * n])))
    allowed = 16.0 * ROUNDING * TURN * n * ball.gamma
    assert 1.0 - trace + restitution == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize("n", [0, 1, 2])
@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8, 1.0])
def test_the_first_period_doubling_has_multiplier_minus_1(restitution: float, n: int) -> None:
    ball = HighBounce(restitution, first_doubling(restitution, n))
    trace = np.trace(ball.jacobian(fixed_point(ball, n, -1.0)))
    # an error of cos phi changes sin phi by 1/tan phi times it
    allowed = 16.0 * ROUNDING * (1.0 + TURN * n) * ball.gamma * (1.0 + np.pi * n)
    assert 1.0 + trace + restitution == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize(("share", "stable"), [(0.02, True), (0.98, True), (1.02, False)])
@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_fixed_point_is_stable_between_birth_and_doubling(
    n: int, share: float, stable: bool
) -> None:
    born, doubled = TURN * n * 0.2, first_doubling(0.8, n)
    ball = HighBounce(0.8, born + share * (doubled - born))
    sizes = np.abs(np.linalg.eigvals(ball.jacobian(fixed_point(ball, n, -1.0))))
    assert (sizes.max() < 1.0) == stable


@pytest.mark.parametrize("n", [0, 1, 2])
def test_its_twin_is_a_saddle(n: int) -> None:
    ball = HighBounce(0.8, 4.0)
    sizes = np.sort(np.abs(np.linalg.eigvals(ball.jacobian(fixed_point(ball, n, 1.0)))))
    assert sizes[0] < 1.0 < sizes[1]


@pytest.mark.parametrize(("factor", "label"), [(0.98, "P(1)"), (1.02, "P(2)")])
def test_labels_change_at_the_first_period_doubling(factor: float, label: str) -> None:
    ball = HighBounce(0.5, factor * first_doubling(0.5, 1))
    start = fixed_point(ball, 1, -1.0) + np.array([1e-3, 0.0])
    attractor = MapAttractor(ball, start, transient=1000, iterations=1000)
    assert str(attractor.label) == label


def test_strong_shaking_is_chaotic() -> None:
    attractor = MapAttractor(HighBounce(0.5, 10.0), np.array([1.0, 1.0]), 1000, 2000)
    assert str(attractor.label) == "chaotic"


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8, 1.0])
def test_the_determinant_is_the_restitution(restitution: float) -> None:
    ball = HighBounce(restitution, 7.0)
    for state in np.random.default_rng(0).normal(size=(5, 2)) * 10.0:
        # terms of the determinant are below gamma + r
        allowed = 8.0 * ROUNDING * (ball.gamma + 1.0)
        assert np.linalg.det(ball.jacobian(state)) == pytest.approx(restitution, abs=allowed)


def test_velocities_on_the_attractor_are_bounded() -> None:
    # |v'| <= r |v| + gamma
    ball = HighBounce(0.8, 10.0)
    velocities = ball.iterate(np.array([0.0, 1e3]), 500)[200:, 1]
    assert np.abs(velocities).max() <= 10.0 / 0.2 + 1e3 * 0.8**200


@pytest.mark.parametrize("whole", [-3, 1, 4])
def test_a_phase_is_an_angle(whole: int) -> None:
    ball = HighBounce(0.8, 5.0)
    state, turned = np.array([1.0, 2.0]), np.array([1.0 + whole * TURN, 2.0])
    assert ball.difference(turned, state) == pytest.approx(0.0, abs=8.0 * ROUNDING * TURN)
    allowed = 5.0 * 8.0 * ROUNDING * TURN * 5
    assert ball.difference(ball(turned), ball(state)) == pytest.approx(0.0, abs=allowed)


def test_the_phase_stays_in_one_turn() -> None:
    phases = HighBounce(0.9, 10.0).iterate(np.array([0.0, -50.0]), 300)[1:, 0]
    assert ((phases >= 0.0) & (phases <= TURN)).all()


# --- the ball that it stands for ------------------------------------------------------------------

RESTITUTION, AMPLITUDE, FREQUENCY, GRAVITY = 0.7, 0.01, 30.0, 9.81


def exact_bounce(phase: float, speed: float) -> tuple[float, float]:
    """Phase passed and velocity after the next impact, for a table at -A sin(w t)."""

    def gap(time: float) -> float:
        table = -AMPLITUDE * np.sin(phase + FREQUENCY * time)
        start = -AMPLITUDE * np.sin(phase)
        return float(start + speed * time - GRAVITY * time**2 / 2.0 - table)

    flight = 2.0 * speed / GRAVITY
    slack = 3.0 * AMPLITUDE / speed
    time = brentq(gap, flight - slack, flight + slack, xtol=1e-15)
    table_velocity = -AMPLITUDE * FREQUENCY * np.cos(phase + FREQUENCY * time)
    incoming = speed - GRAVITY * time
    return FREQUENCY * time, float(table_velocity + RESTITUTION * (table_velocity - incoming))


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("v", [1e3, 1e4, 1e5])
def test_the_exact_ball_departs_from_it_as_the_inverse_velocity(v: float, phase: float) -> None:
    """This holds for the documented units alone: v = 2 w V / g, gamma = 2 w^2 (1 + r) A / g."""
    gamma = 2.0 * FREQUENCY**2 * (1.0 + RESTITUTION) * AMPLITUDE / GRAVITY
    ball = HighBounce(RESTITUTION, gamma)
    unit = GRAVITY / (2.0 * FREQUENCY)  # of velocities
    passed, speed = exact_bounce(phase, v * unit)
    exact = np.array([phase + passed, speed / unit])
    off = np.abs(ball.difference(exact, ball(np.array([phase, v]))))
    # half as much again for what is not of leading order; rounding of v turns
    late = 1.5 * 2.0 * gamma / ((1.0 + RESTITUTION) * v) + 16.0 * ROUNDING * v
    # a late impact changes the incoming velocity by twice its phase, and the table's phase
    assert off[0] <= late
    assert off[1] <= (2.0 * RESTITUTION + gamma) * late
