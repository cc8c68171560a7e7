"""Lorenz's equations: fixed points, their bifurcations, symmetry, and a periodic orbit."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit import Flow, Hyperplane, MapAttractor, PoincareMap
from dynkit.core.validation import Array
from dynkit.systems import Lorenz
from tests.flows.cases import ROUNDING, STATES

PARAMETERS = [(10.0, 28.0, 8.0 / 3.0), (10.0, 15.0, 8.0 / 3.0), (16.0, 45.92, 4.0)]
MIRROR = np.diag([-1.0, -1.0, 1.0])


def fixed_point(lorenz: Lorenz, sign: float) -> Array:
    """E. N. Lorenz, J. Atmos. Sci. 20 (1963) 130-141, section 6."""
    x = sign * np.sqrt(lorenz.beta * (lorenz.rho - 1.0))
    return np.array([x, x, lorenz.rho - 1.0])


@pytest.mark.parametrize("sign", [1.0, -1.0, 0.0])
@pytest.mark.parametrize(("sigma", "rho", "beta"), PARAMETERS)
def test_fixed_points_are_lorenzs(sigma: float, rho: float, beta: float, sign: float) -> None:
    lorenz = Lorenz(sigma=sigma, rho=rho, beta=beta)
    state = fixed_point(lorenz, sign) if sign else np.zeros(3)
    flow: Flow = lorenz
    # terms are below x rho
    assert flow.velocity(state) == pytest.approx(0.0, abs=4.0 * ROUNDING * rho * 15.0)


@pytest.mark.parametrize(("sigma", "rho", "beta"), PARAMETERS)
def test_eigenvalues_of_the_origin_are_in_closed_form(
    sigma: float, rho: float, beta: float
) -> None:
    # Sparrow 1982, section 1.2: lambda^2 + (sigma + 1) lambda + sigma (1 - rho) = 0, and -beta
    root = np.sqrt((sigma - 1.0) ** 2 + 4.0 * sigma * rho)
    expected = sorted([(-sigma - 1.0 - root) / 2.0, (-sigma - 1.0 + root) / 2.0, -beta])
    jacobian = Lorenz(sigma=sigma, rho=rho, beta=beta).velocity_jacobian(np.zeros(3))
    assert sorted(np.linalg.eigvals(jacobian).real) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("sigma", "rho", "beta"), PARAMETERS)
def test_the_other_fixed_points_have_lorenzs_characteristic_polynomial(
    sigma: float, rho: float, beta: float, sign: float
) -> None:
    # Lorenz 1963, equation 34
    lorenz = Lorenz(sigma=sigma, rho=rho, beta=beta)
    found = np.poly(lorenz.velocity_jacobian(fixed_point(lorenz, sign)))
    expected = [1.0, sigma + beta + 1.0, (rho + sigma) * beta, 2.0 * sigma * beta * (rho - 1.0)]
    assert found == pytest.approx(expected, rel=1e-12)


def hopf_value(sigma: float, beta: float) -> float:
    """Lorenz 1963, section 6: 470/19 = 24.74 for his parameters."""
    return sigma * (sigma + beta + 3.0) / (sigma - beta - 1.0)


def test_the_hopf_value_is_lorenzs() -> None:
    assert hopf_value(10.0, 8.0 / 3.0) == pytest.approx(470.0 / 19.0, rel=4.0 * ROUNDING)


@pytest.mark.parametrize(("sigma", "beta"), [(10.0, 8.0 / 3.0), (16.0, 4.0)])
def test_a_pair_of_eigenvalues_is_imaginary_at_the_hopf_value(sigma: float, beta: float) -> None:
    lorenz = Lorenz(sigma=sigma, rho=hopf_value(sigma, beta), beta=beta)
    found = np.linalg.eigvals(lorenz.velocity_jacobian(fixed_point(lorenz, 1.0)))
    frequency = np.sqrt(beta * (sigma + lorenz.rho))
    pair = found[np.abs(found.imag) > 1.0]
    assert pair.real == pytest.approx(0.0, abs=1e-12)
    assert np.abs(pair.imag) == pytest.approx(frequency, rel=1e-12)


@pytest.mark.parametrize(("rho", "shrinks"), [(24.0, True), (25.5, False)])
def test_oscillations_about_a_fixed_point_die_out_below_the_hopf_value(
    rho: float, shrinks: bool
) -> None:
    lorenz = Lorenz(rho=rho)
    centre = fixed_point(lorenz, 1.0)
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), rho - 1.0)
    start = centre[:2] + np.array([0.05, 0.1])
    end = PoincareMap(lorenz, plane, time_limit=10.0).iterate(start, 20)[-1]
    ratio = np.linalg.norm(end - centre[:2]) / np.linalg.norm(start - centre[:2])
    assert (ratio < 1.0) == shrinks


@pytest.mark.parametrize("place", range(3))
def test_volumes_shrink_at_a_constant_rate(place: int) -> None:
    # Lorenz 1963, section 5: the divergence is -(sigma + beta + 1)
    lorenz, duration = Lorenz(), 0.4
    derivative = lorenz.derivative(STATES["lorenz"][place], duration)
    # an entry's error counts as often as its cofactor, below |J|^2, is large
    allowed = 100.0 * lorenz.accuracy * float(np.linalg.norm(derivative)) ** 3
    expected = np.exp(-(10.0 + 8.0 / 3.0 + 1.0) * duration)
    assert np.linalg.det(derivative) == pytest.approx(expected, abs=allowed)


@pytest.mark.parametrize("place", range(3))
def test_the_mirrored_state_moves_as_the_mirror_image(place: int) -> None:
    lorenz, state = Lorenz(), STATES["lorenz"][place]
    mirrored = lorenz.advance(MIRROR @ state, 1.0)
    # signs change without rounding
    assert mirrored.tolist() == (MIRROR @ lorenz.advance(state, 1.0)).tolist()


# The shortest periodic orbit, AB, once around either fixed point. D. Viswanath, The fractal
# property of the Lorenz attractor, Physica D 190 (2004) 115-128; these digits are those of the
# examples of TIDES (A. Abad, R. Barrio, F. Blesa, M. Rodriguez, ACM TOMS 39 (2012) 5).
AB = np.array([-13.763610682134200525, -19.578751942451795539, 27.0])
AB_PERIOD = 1.5586522107161747276


def half_turns() -> PoincareMap:
    """Upwards through z = 27: AB crosses at a point and at its mirror image."""
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), 27.0)
    return PoincareMap(Lorenz(), plane, time_limit=10.0)


def test_the_shortest_periodic_orbit_is_that_of_viswanath() -> None:
    end = Lorenz().advance(AB, AB_PERIOD)
    # the error of 3e-12 over a unit of time, and the multiplier 4.7
    assert end == pytest.approx(AB, abs=2e-11)


def test_its_period_is_that_of_viswanath() -> None:
    system = half_turns()
    there = system.crossing(AB[:2])
    back = system.crossing(system.section.reduce(there.state))
    assert there.state == pytest.approx(MIRROR @ AB, abs=1e-11)
    assert there.time + back.time == pytest.approx(AB_PERIOD, abs=1e-12)


def test_half_of_it_and_the_mirror_have_the_root_of_its_multiplier() -> None:
    # the derivative over the whole period has the multipliers and 1, along the orbit
    whole = np.linalg.eigvals(Lorenz().derivative(AB, AB_PERIOD))
    half = np.linalg.eigvals(-half_turns().jacobian(AB[:2]))
    assert np.abs(half).max() ** 2 == pytest.approx(np.abs(whole).max(), rel=1e-9)


def test_the_multipliers_of_it_multiply_to_the_loss_of_volume() -> None:
    # over half a period
    found = np.linalg.eigvals(half_turns().jacobian(AB[:2]))
    expected = np.exp(-(10.0 + 8.0 / 3.0 + 1.0) * AB_PERIOD / 2.0)
    # the small one is a difference of entries of order one: right to their error
    assert abs(np.prod(found)) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(("rho", "label"), [(160.0, "P(4)"), (350.0, "P(2)")])
def test_labels_are_those_of_sparrow(rho: float, label: str) -> None:
    # Sparrow 1982, chapters 4 and 5: periodic orbits attract above 313 and around 160
    lorenz = Lorenz(rho=rho)
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), rho - 1.0)
    system = PoincareMap(lorenz, plane, time_limit=10.0)
    start = fixed_point(lorenz, 1.0)[:2] + np.array([1.0, 2.0])
    assert str(MapAttractor(system, start, 200, 100).label) == label
