"""The map of Henon: fixed points, multipliers and the trapping region of his paper."""

import numpy as np
import pytest

from dynkit import MapAttractor
from dynkit.core.no_motion import Diverged
from dynkit.core.validation import Array
from dynkit.systems.maps.henon import Henon

ROUNDING = 2.0**-52
PARAMETERS = [(1.4, 0.3), (0.2, 0.3), (0.9, -0.5), (3.0, 1.0)]


def fixed_point(a: float, b: float, sign: float) -> Array:
    """M. Henon, Commun. Math. Phys. 50 (1976) 69-77: a x^2 + (1 - b) x - 1 = 0, y = b x."""
    x = (-(1.0 - b) + sign * np.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
    return np.array([x, b * x])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("a", "b"), PARAMETERS)
def test_fixed_points_are_the_roots_of_a_quadratic(a: float, b: float, sign: float) -> None:
    state = fixed_point(a, b, sign)
    # a few roundings of terms that are below 1 + a x^2
    allowed = 8.0 * ROUNDING * (1.0 + a * state[0] ** 2)
    assert Henon(a, b)(state) == pytest.approx(state, abs=allowed)


def test_the_fixed_point_is_where_henon_says() -> None:
    # Henon 1976, section 3: x = 0.63135448, y = 0.18940634
    assert fixed_point(1.4, 0.3, 1.0) == pytest.approx([0.63135448, 0.18940634], abs=5e-9)


def test_its_multipliers_are_henons() -> None:
    # Henon 1976, section 3: 0.15594632 and -1.92373886
    found = np.linalg.eigvals(Henon().jacobian(fixed_point(1.4, 0.3, 1.0)))
    assert sorted(found.real) == pytest.approx([-1.92373886, 0.15594632], abs=5e-9)


@pytest.mark.parametrize("b", [-0.5, 0.0, 0.3, 0.9])
def test_fixed_points_meet_with_multiplier_1(b: float) -> None:
    a = -((1.0 - b) ** 2) / 4.0
    x = -(1.0 - b) / (2.0 * a)
    trace = np.trace(Henon(a, b).jacobian(np.array([x, b * x])))
    # lambda = 1: 1 - trace + determinant = 0
    assert 1.0 - trace - b == pytest.approx(0.0, abs=16.0 * ROUNDING)


@pytest.mark.parametrize("b", [-0.5, 0.0, 0.3, 0.9])
def test_the_first_period_doubling_is_at_three_quarters(b: float) -> None:
    a = 3.0 * (1.0 - b) ** 2 / 4.0
    trace = np.trace(Henon(a, b).jacobian(fixed_point(a, b, 1.0)))
    # lambda = -1: 1 + trace + determinant = 0
    assert 1.0 + trace - b == pytest.approx(0.0, abs=16.0 * ROUNDING)


@pytest.mark.parametrize(("a", "label"), [(0.35, "P(1)"), (0.385, "P(2)"), (1.4, "chaotic")])
def test_labels_change_at_the_first_period_doubling(a: float, label: str) -> None:
    # 3 (1 - b)^2 / 4 = 0.3675 at b = 0.3
    attractor = MapAttractor(Henon(a), np.zeros(2), transient=1000, iterations=1000)
    assert str(attractor.label) == label


@pytest.mark.parametrize(("a", "b"), PARAMETERS)
def test_the_determinant_is_minus_b(a: float, b: float) -> None:
    for state in np.random.default_rng(0).normal(size=(5, 2)):
        assert np.linalg.det(Henon(a, b).jacobian(state)) == pytest.approx(-b, rel=4.0 * ROUNDING)


def test_lyapunov_exponents_on_the_attractor_sum_up_to_the_logarithm_of_b() -> None:
    system, n = Henon(), 2000
    frame, logarithms = np.eye(2), np.zeros((n, 2))
    for i, state in enumerate(system.iterate(np.zeros(2), n)[:-1]):
        frame, upper = np.linalg.qr(system.jacobian(state) @ frame)
        logarithms[i] = np.log(np.abs(np.diag(upper)))
    assert logarithms[:, 0].mean() > 0.0
    # relative, a step's determinant is exact to a rounding times the condition number, |J|^2 / b
    condition = (2.0 * 1.4 * 1.33) ** 2 / 0.3
    assert logarithms.sum(axis=1) == pytest.approx(np.log(0.3), abs=8.0 * ROUNDING * condition)


def test_the_trapping_region_is_mapped_into_itself() -> None:
    # Henon 1976, section 3: A (-1.33, 0.42), B (1.32, 0.133), C (1.245, -0.14), D (-1.06, -0.5)
    corners = np.array([[-1.33, 0.42], [1.32, 0.133], [1.245, -0.14], [-1.06, -0.5]])
    sides = np.roll(corners, -1, axis=0) - corners
    for corner, side in zip(corners, sides, strict=True):
        for part in np.linspace(0.0, 1.0, 200):
            image = Henon()(corner + part * side)
            offsets = image - corners
            # the corners go round clockwise: inside is to the right of every side
            left = sides[:, 0] * offsets[:, 1] - sides[:, 1] * offsets[:, 0]
            assert left.max() < 0.0


def test_far_states_run_away() -> None:
    with pytest.raises(Diverged, match=r"^the motion runs away: state\[0\] is -inf after"):
        MapAttractor(Henon(), np.array([5.0, 5.0]), transient=100, iterations=1)
