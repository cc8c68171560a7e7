"""Rossler's equations: fixed points, volumes, and periodic orbits of the literature."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit import Flow, Hyperplane, MapAttractor, PoincareMap
from dynkit.core.validation import Array
from dynkit.systems import Rossler
from tests.flows.cases import ROUNDING, STATES

PARAMETERS = [(0.2, 0.2, 5.7), (0.1, 0.1, 14.0), (0.36, 0.4, 4.5)]


def fixed_point(rossler: Rossler, sign: float) -> Array:
    """The roots of x^2 - c x + a b = 0, y = -z, z = x/a."""
    root = np.sqrt(rossler.c**2 - 4.0 * rossler.a * rossler.b)
    x = (rossler.c + root) / 2.0
    if sign < 0.0:
        x = rossler.a * rossler.b / x  # without the cancellation of c - root
    return np.array([x, -x / rossler.a, x / rossler.a])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("a", "b", "c"), PARAMETERS)
def test_fixed_points_are_in_closed_form(a: float, b: float, c: float, sign: float) -> None:
    rossler = Rossler(a=a, b=b, c=c)
    flow: Flow = rossler
    # terms are below c^2 / a
    allowed = 4.0 * ROUNDING * c**2 / a
    assert flow.velocity(fixed_point(rossler, sign)) == pytest.approx(0.0, abs=allowed)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("a", "b", "c"), PARAMETERS)
def test_fixed_points_have_their_characteristic_polynomial(
    a: float, b: float, c: float, sign: float
) -> None:
    # det(lambda - J) with J = [[0, -1, -1], [1, a, 0], [z, 0, x - c]], by hand
    rossler = Rossler(a=a, b=b, c=c)
    x, _, z = fixed_point(rossler, sign)
    expected = [1.0, c - a - x, 1.0 + z + a * (x - c), c - x - a * z]
    found = np.poly(rossler.velocity_jacobian(fixed_point(rossler, sign)))
    # the eigenvalues are right to rounding times the matrix, whose entries are below c / a
    assert found == pytest.approx(expected, abs=1e-13 * (c / a) ** 2)


@pytest.mark.parametrize("place", range(3))
def test_volumes_change_at_the_divergence_along_the_motion(place: int) -> None:
    """Liouville's formula: ln det = integral of a + x - c, by Gauss's rule."""
    rossler, start, duration = Rossler(), STATES["rossler"][place], 1.0
    nodes, weights = np.polynomial.legendre.leggauss(24)
    path = [rossler.advance(start, duration * (1.0 + t) / 2.0) for t in nodes]
    trace = [rossler.a + state[0] - rossler.c for state in path]
    expected = np.exp(duration / 2.0 * float(weights @ np.array(trace)))
    derivative = rossler.derivative(start, duration)
    # an entry's error counts as often as its cofactor, below |J|^2, is large
    allowed = 100.0 * rossler.accuracy * float(np.linalg.norm(derivative)) ** 3
    assert np.linalg.det(derivative) == pytest.approx(expected, abs=allowed)


# The shortest periodic orbit at a = b = 0.2, c = 5.7, where it crosses x = 0 with y < 0: its period
# and its derivative over a period, from the example PoincareMap of CAPD (T. Kapela, M. Mrozek,
# D. Wilczak, P. Zgliczynski, Commun. Nonlinear Sci. Numer. Simul. 101 (2021) 105578).
ORBIT = np.array([0.0, -8.3809417428297994, 0.029590060630665001])
PERIOD = 5.8810884555538996
MONODROMY = np.array(
    [
        [0.50685970275960168, -2.4490247655232884, 0.4263784329575836],
        [-0.59178625525395556, -1.9133051621539718, 1.8817251176642307],
        [0.0016796765683430427, -0.010279868615685349, 0.0024919275429165304],
    ]
)
RETURN = np.array(
    [
        [-2.404845565855263, 1.9673029484873146],
        [-0.0010904289144987797, 0.00089203400377833864],
    ]
)
PLANE = Hyperplane(np.array([1.0, 0.0, 0.0]))


def returns() -> PoincareMap:
    return PoincareMap(Rossler(), PLANE, time_limit=50.0)


def test_the_shortest_periodic_orbit_returns_as_in_capd() -> None:
    assert returns()(ORBIT[1:]) == pytest.approx(ORBIT[1:], abs=1e-11)


def test_its_period_is_that_of_capd() -> None:
    assert returns().return_time(ORBIT[1:]) == pytest.approx(PERIOD, abs=1e-12)


def test_its_monodromy_matrix_is_that_of_capd() -> None:
    found = Rossler().derivative(ORBIT, PERIOD)
    assert found == pytest.approx(MONODROMY, abs=1e-11)


def test_its_derivative_on_the_plane_is_that_of_capd() -> None:
    assert returns().jacobian(ORBIT[1:]) == pytest.approx(RETURN, abs=1e-11)


def test_its_multiplier_is_that_of_chaosbook() -> None:
    # P. Cvitanovic et al., Chaos: Classical and Quantum, exercises on Rossler flow: the 1-cycle
    # has T = 5.88108845586, Lambda = -2.403953527
    found = np.linalg.eigvals(returns().jacobian(ORBIT[1:]))
    assert found[np.argmax(np.abs(found))] == pytest.approx(-2.403953527, abs=5e-9)


def test_it_crosses_upwards_where_chaosbook_says() -> None:
    # x = 0, y = 6.09176831742, z = 1.29973195919, with x falling
    flow, falling = Rossler(), Hyperplane(np.array([1.0, 0.0, 0.0]), direction=-1)
    hit = flow.next_crossing(ORBIT, falling, time_limit=10.0)
    assert hit.state == pytest.approx([0.0, 6.09176831742, 1.29973195919], abs=5e-8)


@pytest.mark.parametrize(("c", "label"), [(2.5, "P(1)"), (3.5, "P(2)"), (4.0, "P(4)")])
def test_the_period_doubles_as_c_grows(c: float, label: str) -> None:
    # S. H. Strogatz, Nonlinear Dynamics and Chaos, 1994, section 10.6, after Olsen and Degn (1985)
    system = PoincareMap(Rossler(c=c), PLANE, time_limit=50.0)
    attractor = MapAttractor(system, np.array([-3.5, 0.05]), transient=100, iterations=40)
    assert str(attractor.label) == label
