"""Arguments of the textbook maps that are refused, by name, limit and value."""

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from dynkit import Hyperplane, Map, PoincareMap, equilibrium, periodic_orbit
from dynkit.systems import Henon, HighBounce, IntegratedFlow, Logistic

NAN, INF = math.nan, math.inf

REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: Logistic(NAN), "rate must be a finite number; got nan"),
    (lambda: Logistic(INF), "rate must be a finite number; got inf"),
    (lambda: Logistic(True), "rate must be a finite number; got True"),
    (lambda: Logistic("4"), "rate must be a finite number; got '4'"),  # type: ignore[arg-type]
    (lambda: Logistic(None), "rate must be a finite number; got None"),  # type: ignore[arg-type]
    (lambda: Logistic().replace(a=1.0), "parameter must be one of: rate; got 'a'"),
    (lambda: Logistic().replace(rate=NAN), "rate must be a finite number; got nan"),
    (lambda: Logistic()(np.array([NAN])), "state[0] must be a finite number; got nan"),
    (lambda: Logistic()(np.zeros(2)), "state must have shape (1,); got shape (2,)"),
    (lambda: Logistic().jacobian(np.array(0.5)), "state must have shape (1,); got shape ()"),
    (lambda: Logistic().iterate(np.array([0.1]), -1), "n must be zero or a positive integer"),
    (lambda: Henon(a=NAN), "a must be a finite number; got nan"),
    (lambda: Henon(b=-INF), "b must be a finite number; got -inf"),
    (lambda: Henon(b=1j), "b must be a finite number; got 1j"),  # type: ignore[arg-type]
    (lambda: Henon().replace(c=1.0), "parameter must be one of: a, b; got 'c'"),
    (lambda: Henon()(np.array([0.0, INF])), "state[1] must be a finite number; got inf"),
    (lambda: Henon().jacobian(np.zeros((2, 2))), "state must have shape (2,); got shape (2, 2)"),
    (lambda: Henon()(np.array(["a", "b"])), "state must be an array of real numbers"),
    (lambda: HighBounce(1.1, 1.0), "restitution must lie in [0, 1]; got 1.1"),
    (lambda: HighBounce(-0.1, 1.0), "restitution must lie in [0, 1]; got -0.1"),
    (lambda: HighBounce(NAN, 1.0), "restitution must be a finite number; got nan"),
    (lambda: HighBounce(0.5, -1.0), "gamma must not be negative; got -1.0"),
    (lambda: HighBounce(0.5, INF), "gamma must be a finite number; got inf"),
    (lambda: HighBounce(0.5, [1]), "gamma must be a finite number; got [1]"),  # type: ignore[arg-type]
    (
        lambda: HighBounce(0.5, 1.0).replace(amplitude=1.0),
        "parameter must be one of: restitution, gamma; got 'amplitude'",
    ),
    (lambda: HighBounce(0.5, 1.0)(np.zeros(3)), "state must have shape (2,); got shape (3,)"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_refusals_name_argument_limit_and_value(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


@pytest.mark.parametrize("number", [2, np.float64(2.0), np.int64(2)], ids=repr)
def test_parameters_are_kept_as_floats(number: Any) -> None:
    assert type(Logistic(number).rate) is float


RETURNED = [0.5, np.array([0.5]), np.array([[0.5], [0.5]]), np.array([0.5, 0.1j]), None]
"""What is no state of two coordinates; NumPy would make such states of the first two."""


@pytest.mark.parametrize("given", RETURNED)
def test_a_map_that_returns_no_state_is_named(given: Any) -> None:
    class Wrong(Map):
        dimension = 2

        def __call__(self, state: Any) -> Any:
            del state
            return given

    with pytest.raises(ValueError, match=r"Wrong must return 2 real numbers, \(2,\); got"):
        Wrong().iterate(np.array([0.1, 0.1]), 3)
    with pytest.raises(ValueError, match=r"Wrong must return 2 real numbers, \(2,\); got"):
        periodic_orbit(Wrong(), [0.1, 0.1])


@pytest.mark.parametrize("given", RETURNED)
def test_a_flow_whose_velocity_is_no_rate_of_its_state_is_named(given: Any) -> None:
    class Wrong(IntegratedFlow):
        dimension = 2

        def velocity(self, state: Any) -> Any:
            del state
            return given

    flow, state = Wrong(), np.array([0.1, 0.1])
    returns = PoincareMap(flow, Hyperplane(np.array([1.0, 0.0])), time_limit=1.0)
    runs = partial(flow.advance, state, 1.0), partial(returns, state[:1])
    for run in (*runs, partial(equilibrium, flow, state)):
        with pytest.raises(ValueError, match=r"Wrong.velocity must return 2 real numbers, \(2,\)"):
            run()
