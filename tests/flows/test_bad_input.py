"""Arguments of the textbook flows that are refused, by name, limit and value."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dynkit import Hyperplane, PoincareMap, Stroboscope
from dynkit.core.no_motion import CannotFollow, NoCrossing, Refused
from dynkit.core.validation import Array
from dynkit.systems import IntegratedFlow
from dynkit.systems.flows import integration
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler

NAN, INF = math.nan, math.inf
STATE = np.array([1.0, 2.0, 3.0])
PLANE = Hyperplane(np.eye(3)[0])

REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: Duffing(damping=NAN), "damping must be a finite number; got nan"),
    (lambda: Duffing(stiffness=INF), "stiffness must be a finite number; got inf"),
    (lambda: Duffing(cubic="1"), "cubic must be a finite number; got '1'"),  # type: ignore[arg-type]
    (lambda: Duffing(force=True), "force must be a finite number; got True"),
    (lambda: Duffing(frequency=0.0), "frequency must be positive; got 0.0"),
    (lambda: Duffing(frequency=-1.2), "frequency must be positive; got -1.2"),
    (lambda: Lorenz(sigma=None), "sigma must be a finite number; got None"),  # type: ignore[arg-type]
    (lambda: Lorenz(rho=-INF), "rho must be a finite number; got -inf"),
    (lambda: Lorenz(beta=[1.0]), "beta must be a finite number; got [1.0]"),  # type: ignore[arg-type]
    (lambda: Rossler(a=NAN), "a must be a finite number; got nan"),
    (lambda: Rossler(b=NAN), "b must be a finite number; got nan"),
    (lambda: Rossler(c=NAN), "c must be a finite number; got nan"),
    (lambda: Lorenz(tolerance=0.0), "tolerance must lie in [1e-13, 0.01]; got 0.0"),
    (lambda: Lorenz(tolerance=1e-16), "tolerance must lie in [1e-13, 0.01]; got 1e-16"),
    (lambda: Lorenz(tolerance=1.0), "tolerance must lie in [1e-13, 0.01]; got 1.0"),
    (lambda: Lorenz(tolerance=NAN), "tolerance must be a finite number; got nan"),
    (
        lambda: Lorenz().replace(frequency=1.0),
        "parameter must be one of: sigma, rho, beta; got 'frequency'",
    ),
    (lambda: Lorenz().replace(rho=NAN), "rho must be a finite number; got nan"),
    (lambda: Lorenz().replace(tolerance=2.0), "tolerance must lie in [1e-13, 0.01]; got 2.0"),
    (lambda: Lorenz().advance(STATE, -1.0), "duration must not be negative; got -1.0"),
    (lambda: Lorenz().advance(STATE, NAN), "duration must be a finite number; got nan"),
    (lambda: Lorenz().advance(STATE, INF), "duration must be a finite number; got inf"),
    (lambda: Lorenz().advance_error(STATE, -1.0), "duration must not be negative; got -1.0"),
    (lambda: Lorenz().derivative(STATE, -1.0), "duration must not be negative; got -1.0"),
    (lambda: Lorenz().advance(STATE[:2], 1.0), "state must have shape (3,); got shape (2,)"),
    (lambda: Lorenz().derivative(STATE[None], 1.0), "state must have shape (3,); got shape (1, 3)"),
    (lambda: Lorenz().velocity([1.0, NAN, 0.0]), "state[1] must be a finite number; got nan"),  # type: ignore[arg-type]
    (
        lambda: Lorenz().velocity_jacobian([1.0, 0.0, INF]),  # type: ignore[arg-type]
        "state[2] must be a finite number; got inf",
    ),
    (
        lambda: Lorenz().next_crossing(STATE[:2], PLANE, 1.0),
        "state must have shape (3,); got shape (2,)",
    ),
    (
        lambda: Lorenz().next_crossing(np.array([NAN, 0.0, 0.0]), PLANE, 1.0),
        "state[0] must be a finite number; got nan",
    ),
    (
        lambda: Lorenz().next_crossing(STATE, Hyperplane(np.eye(2)[0]), 1.0),
        "section must have the flow's dimension 3; got 2",
    ),
    (lambda: Lorenz().next_crossing(STATE, PLANE, 0.0), "time_limit must be positive; got 0.0"),
    (
        lambda: Lorenz().next_crossing(STATE, PLANE, INF),
        "time_limit must be a finite number; got inf",
    ),
    (
        lambda: PoincareMap(Duffing(), Stroboscope(2), time_limit=1.0),
        "section must have the flow's dimension 3; got 2",
    ),
    (
        lambda: PoincareMap(Duffing(), Stroboscope(3), 10.0)(np.zeros(3)),
        "state must have shape (2,); got shape (3,)",
    ),
]


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_refusals_name_argument_limit_and_value(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


@pytest.mark.parametrize("flow", [Duffing, Lorenz, Rossler])
def test_parameters_have_no_order(flow: type) -> None:
    with pytest.raises(TypeError, match="positional argument"):
        flow(1.0)


@pytest.mark.parametrize("scale", [1e-300, 1e-30])
@pytest.mark.parametrize("flow", [Duffing(), Lorenz(), Rossler()], ids=repr)
def test_tiny_states_are_followed(flow: IntegratedFlow, scale: float) -> None:
    assert np.isfinite(flow.advance(scale * STATE, 0.1)).all()


@pytest.mark.parametrize("scale", [1e30, 1e100])
@pytest.mark.parametrize("flow", [Duffing(), Lorenz(), Rossler()], ids=repr)
def test_motions_too_fast_to_be_followed_are_refused(
    flow: IntegratedFlow, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # they turn 1e30 times in a unit of time, and more; the pace as it ships is judged below
    monkeypatch.setattr(integration, "_PACE", 500)
    with pytest.raises(CannotFollow, match=r"^the motion from .* cannot be followed for 0\.1: b"):
        flow.advance(scale * STATE, 0.1)


def test_a_section_too_far_for_the_motions_pace_is_not_crossed() -> None:
    plane = Hyperplane(np.array([0.0, 0.0, 1.0]), -1.0)  # below the attractor
    with pytest.raises(NoCrossing, match=r"0 would take more than 100000000 steps$"):
        Lorenz(tolerance=1e-2).next_crossing(STATE, plane, 1e12)


class Backwards(IntegratedFlow):
    """x' = -x + cos(phase), with a phase that shrinks."""

    dimension = 2

    def velocity(self, state: Array) -> Array:
        return np.array([np.cos(state[1]) - state[0], -1.3])


def test_a_stroboscope_refuses_a_phase_that_shrinks() -> None:
    # its value, the sine of the phase, rises half a period away from the flashes
    returns = PoincareMap(Backwards(), Stroboscope(2), time_limit=20.0)
    message = r"^the phase, the last coordinate, must grow .*; got the rate -1\.3 at \[0\.5, 0"
    for call in (returns, returns.return_time, returns.jacobian_factors):
        with pytest.raises(Refused, match=message):
            call(np.array([0.5]))
