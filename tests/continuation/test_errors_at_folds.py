"""Errors of the orbits of a branch at their values of the parameter, near folds."""

from typing import Any

import mpmath
import numpy as np
import pytest

from dynkit import Branch, continue_orbit, periodic_orbit
from dynkit.systems import BouncingBall, Henon

RESTITUTION, FREQUENCY = 0.5, 3.0


def _henon() -> Branch:
    orbit = periodic_orbit(Henon(a=0.5, b=0.3), [0.9, 0.2])
    return continue_orbit(orbit, "a", bounds=(-0.2, 1.0), largest_step=0.02)


def _ball() -> Branch:
    ball = BouncingBall(amplitude=0.13, frequency=FREQUENCY, restitution=RESTITUTION)
    return continue_orbit(
        ball.periodic_orbit(impacts=1, periods=1), "amplitude", bounds=(0.05, 0.4)
    )


def _henon_apart(state: Any, value: float) -> Any:
    """Distance of x from the nearer fixed point a x^2 + (1 - b) x - 1 = 0."""
    a, b = mpmath.mpf(value), mpmath.mpf(0.3)
    root = mpmath.sqrt((1 - b) ** 2 + 4 * a)
    return min(abs(state[0] - (-(1 - b) + sign * root) / (2 * a)) for sign in (1, -1))


def _ball_apart(state: Any, value: float) -> Any:
    """Distance of the phase from the nearer one of cos(phase) = b / Gamma."""
    r, w = mpmath.mpf(RESTITUTION), mpmath.mpf(FREQUENCY)
    phase = mpmath.acos(mpmath.pi * (1 - r) / (1 + r) / (mpmath.mpf(value) * w**2))
    turned = mpmath.mpf(state[1]) - 2 * mpmath.pi * round(state[1] / (2 * np.pi))
    return min(abs(turned - own) for own in (phase, -phase))


@pytest.mark.parametrize(("branch", "apart"), [(_henon, _henon_apart), (_ball, _ball_apart)])
def test_orbit_errors_bound_the_error_at_the_parameter_up_to_a_fold(
    branch: Any, apart: Any
) -> None:
    found = branch()
    (fold,) = (own.value for own in found.bifurcations if own.kind == "SN")
    with mpmath.workdps(40):
        actual = [
            float(apart(found.orbit(k).states[0], value))
            for k, value in enumerate(found.parameter.tolist())
        ]
    assert (actual <= found.orbit_errors).all()
    nearest = abs(found.parameter - fold).argmin()
    assert found.orbit_errors[nearest] > 10.0 * found.error[nearest]
