"""Multipliers of strongly stable cycles: right relative to themselves, or said not to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynkit import (
    Hyperplane,
    PoincareMap,
    Stroboscope,
    periodic_orbit,
)
from dynkit.analysis.lyapunov import LyapunovSpectrum
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.systems import IntegratedFlow, Logistic
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler
from tests.validation.cycles import VAN_DER_POL, VanDerPol, exact_multiplier, van_der_pol

TOP = Hyperplane(np.array([0.0, 1.0]), direction=-1)


def test_the_kept_multipliers_are_those_of_forty_digits() -> None:
    assert exact_multiplier(3.0) == pytest.approx(VAN_DER_POL[3.0], rel=1e-15)


@pytest.mark.parametrize("mu", [2.0, 3.0])
def test_small_multipliers_are_right_to_a_millionth(mu: float) -> None:
    orbit = van_der_pol(mu, 1e-12)
    assert orbit.multipliers[0].real == pytest.approx(VAN_DER_POL[mu], rel=1e-6)
    assert orbit.multipliers_error[0] < 1e-6 * VAN_DER_POL[mu]


@pytest.mark.parametrize("mu", [0.1, 1.0, 3.0, 5.0])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_no_multiplier_is_farther_off_than_its_error(mu: float, tolerance: float) -> None:
    orbit = van_der_pol(mu, tolerance)
    off = abs(orbit.multipliers[0] - VAN_DER_POL[mu])
    assert off <= orbit.multipliers_error[0]
    assert orbit.multipliers_resolved.all()
    assert orbit.multipliers[0].real > 0.0


def test_the_jacobian_is_the_product_of_its_factors() -> None:
    section = PoincareMap(VanDerPol(mu=3.0, tolerance=1e-9), TOP, time_limit=20.0)
    state = np.array([2.1])
    factors, errors = section.jacobian_factors(state)
    assert len(factors) > 5
    assert errors.shape == (len(factors),)
    assert section.jacobian(state)[0, 0] == pytest.approx(float(np.prod(factors)), rel=1e-14)
    # Liouville's formula: the divergence along the way, and the speed across the section
    hit = section.crossing(state)
    path = solve_ivp(
        lambda _, y: [y[1], 3.0 * (1.0 - y[0] ** 2) * y[1] - y[0], 3.0 * (1.0 - y[0] ** 2)],
        (0.0, hit.time),
        [2.1, 0.0, 0.0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
    )
    expected = np.exp(path.y[2, -1]) * 2.1 / hit.state[0]
    assert float(np.prod(factors)) == pytest.approx(expected, rel=1e-5)


# --- not resolved ---------------------------------------------------------------------------------


def test_a_multiplier_that_a_rough_flow_hides_is_not_resolved() -> None:
    orbit = van_der_pol(5.0, 1e-4)
    assert not orbit.multipliers_resolved.any()
    assert orbit.multipliers_error[0] < 1.0
    assert repr(orbit).endswith("stable; 1 of 1 multipliers not resolved>")
    assert "not resolved" in orbit._repr_html_()


def test_the_repr_claims_no_stability_that_errors_leave_open() -> None:
    def shown(rate: float) -> str:
        return repr(periodic_orbit(Logistic(rate=rate), [1.0 - 1.0 / rate]))

    assert shown(2.9).endswith(": stable>")
    assert shown(3.0).endswith(": stability not resolved>")  # its multiplier is -1
    assert shown(3.1).endswith(": unstable>")


def test_a_multiplier_below_the_smallest_double_is_not_resolved() -> None:
    section = PoincareMap(VanDerPol(mu=16.0, tolerance=1e-6), TOP, time_limit=100.0)
    orbit = periodic_orbit(section, [2.0])
    assert abs(orbit.multipliers[0]) < 1e-300
    assert 0.0 < orbit.multipliers_error[0] < 1e-300
    assert not orbit.multipliers_resolved[0]
    assert orbit.stable


@dataclass(frozen=True)
class Hidden(Map):
    """One direction, which shrinks to less than its error."""

    dimension = 1

    def __call__(self, state: Array) -> Array:
        return 1e-20 * finite_array("state", state, (1,))

    def jacobian(self, state: Array) -> Array:
        finite_array("state", state, (1,))
        return np.array([[1e-20]])

    def jacobian_factors(self, state: Array) -> tuple[Array, Array]:
        return self.jacobian(state)[None], np.array([1e-16])


def test_a_single_direction_that_errors_hide_has_no_exponent() -> None:
    spectrum = LyapunovSpectrum.of_map(Hidden(), [0.1], iterations=128)
    assert np.isnan(spectrum.exponents).all()
    orbit = periodic_orbit(Hidden(), [0.1])
    assert orbit.stable
    assert not orbit.multipliers_resolved.any()


# --- Lyapunov exponents ---------------------------------------------------------------------------


def test_the_exponent_of_a_strongly_stable_cycle() -> None:
    section = PoincareMap(VanDerPol(mu=3.0, tolerance=1e-6), TOP, time_limit=20.0)
    start = van_der_pol(3.0, 1e-6).states[0]
    spectrum = LyapunovSpectrum.of_map(section, start, iterations=128)
    off = abs(spectrum.exponents[0] - np.log(VAN_DER_POL[3.0]))
    assert off <= spectrum.error[0] < 0.01


@pytest.mark.parametrize("tolerance", [1e-8, 1e-12])
def test_each_logarithm_is_as_right_as_it_says(tolerance: float) -> None:
    orbit = van_der_pol(3.0, tolerance)
    found = orbit.system.stretching(orbit.states[0], 1)
    # the state is off, too; its effect is among the errors of the multiplier
    allowed = found.errors[0, 0] + orbit.multipliers_error[0] / VAN_DER_POL[3.0]
    assert abs(found.logs[0, 0] - np.log(VAN_DER_POL[3.0])) <= allowed
    assert found.errors[0, 0] < 1e4 * tolerance


# --- three dimensions -----------------------------------------------------------------------------


def _plane(axis: int, offset: float, direction: int, *angles: int) -> Hyperplane:
    return Hyperplane(np.eye(3)[axis], offset, direction, angles)


ORBITS: dict[str, tuple[PoincareMap, list[list[float]]]] = {
    "rossler, P(1)": (
        PoincareMap(Rossler(c=2.5, tolerance=1e-9), _plane(0, 0.0, 1), 50.0),
        [[-4.341557, 0.057863]],
    ),
    "rossler, P(2)": (
        PoincareMap(Rossler(c=3.5, tolerance=1e-9), _plane(0, 0.0, 1), 50.0),
        [[-4.400875, 0.046246], [-6.481939, 0.043297]],
    ),
    "rossler, P(4)": (
        PoincareMap(Rossler(c=4.0, tolerance=1e-9), _plane(0, 0.0, 1), 50.0),
        [
            [-5.096765, 0.041114],
            [-7.438673, 0.038705],
            [-4.232640, 0.042178],
            [-6.966071, 0.039145],
        ],
    ),
    "lorenz, window": (
        PoincareMap(Lorenz(rho=100.5, tolerance=1e-9), _plane(2, 99.5, -1), 10.0),
        [[2.884667, -27.831971], [-11.668900, -1.493949], [-9.327962, 7.767061]],
    ),
    "lorenz, one turn": (
        PoincareMap(Lorenz(rho=350.0, tolerance=1e-9), _plane(2, 349.0, -1), 10.0),
        [[-22.349760, 52.378416], [22.349760, -52.378416]],
    ),
    "duffing, strobed": (
        PoincareMap(Duffing(force=0.28, tolerance=1e-9), Stroboscope(3), 10.0),
        [[0.586298, 0.382584], [0.245750, 0.237443]],
    ),
    "duffing, damped": (
        PoincareMap(Duffing(damping=5.0, tolerance=1e-9), Stroboscope(3), 10.0),
        [[1.002072, 0.101139]],
    ),
    "duffing, maxima": (
        PoincareMap(Duffing(damping=5.0, tolerance=1e-9), _plane(1, 0.0, -1, 2), 10.0),
        [[1.078052, 1.462895]],
    ),
}
"""Maps, and the states of attractors at which motions were seen to settle, to six digits."""


@pytest.mark.parametrize("name", ORBITS)
def test_the_product_of_the_multipliers_is_that_of_liouvilles_formula(name: str) -> None:
    system, states = ORBITS[name]
    orbit = periodic_orbit(system, states)
    assert orbit.stable
    assert orbit.period == len(states)
    assert abs(orbit.states - states).max() < 1e-5
    logs = np.log(abs(orbit.multipliers)).sum()
    error = (orbit.multipliers_error / abs(orbit.multipliers)).sum()
    assert error < 0.02
    total = sum(_divergence(system, state) for state in orbit.states)
    assert bool(abs(logs - total) <= error)


def _divergence(system: PoincareMap, state: Array) -> float:
    """Its integral over a return, by another integration."""
    flow, d = system.flow, 3
    assert isinstance(flow, IntegratedFlow)
    path = solve_ivp(
        lambda _, y: np.append(flow.velocity(y[:d]), np.trace(flow.velocity_jacobian(y[:d]))),
        (0.0, system.return_time(state)),
        np.append(system.section.lift(state), 0.0),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    return float(path.y[d, -1])
