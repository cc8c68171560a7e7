"""What every integrated flow offers its user, whatever its velocity is."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from dynkit import Hyperplane, PoincareMap
from dynkit.core.validation import Array, finite_array
from dynkit.systems import IntegratedFlow
from tests.flows.cases import ROUNDING, STATES, Rotation
from tests.flows.integrated_flows import Lorenz


def test_the_tolerance_is_no_parameter() -> None:
    assert Lorenz(rho=20.0, tolerance=1e-6).parameters == {
        "sigma": 10.0,
        "rho": 20.0,
        "beta": 8.0 / 3.0,
    }


def test_replace_keeps_the_tolerance() -> None:
    assert Lorenz(tolerance=1e-6).replace(rho=20.0) == Lorenz(rho=20.0, tolerance=1e-6)


def test_the_tolerance_can_be_replaced() -> None:
    assert Lorenz(rho=20.0).replace(tolerance=1e-6) == Lorenz(rho=20.0, tolerance=1e-6)


def test_a_poincare_map_replaces_the_parameters_of_its_flow() -> None:
    system = PoincareMap(Rotation(), Hyperplane(np.eye(3)[1]), time_limit=10.0)
    faster = system.replace(frequency=2.0)
    assert faster.return_time(np.array([1.0, 0.0])) == pytest.approx(np.pi, rel=1e-11)


@pytest.mark.parametrize("tolerance", [1e-12, 1e-6])
def test_a_poincare_map_is_as_accurate_as_the_tolerance(tolerance: float) -> None:
    flow = Rotation(tolerance=tolerance)
    system = PoincareMap(flow, Hyperplane(np.eye(3)[1]), time_limit=10.0)
    assert system.accuracy == flow.accuracy == 20.0 * tolerance


def test_no_time_changes_nothing() -> None:
    start = STATES["lorenz"][0]
    assert Lorenz().advance(start, 0.0).tolist() == start.tolist()
    assert Lorenz().derivative(start, 0.0).tolist() == np.eye(3).tolist()
    assert Lorenz().advance_error(start, 0.0) == 0.0


def test_states_may_be_lists_of_integers() -> None:
    found = Rotation().advance([1, 0, 2], 1.0)  # type: ignore[arg-type]
    assert found == pytest.approx([np.cos(1.0), np.sin(1.0), 2.0 * np.exp(-0.3)], abs=1e-11)


def test_a_pickled_flow_moves_as_it_did() -> None:
    start, copy = STATES["lorenz"][0], pickle.loads(pickle.dumps(Lorenz(rho=20.0)))
    assert copy.advance(start, 1.0).tolist() == Lorenz(rho=20.0).advance(start, 1.0).tolist()


@pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
def test_errors_fall_with_the_tolerance(tolerance: float) -> None:
    """A turn and a half of the rotation, against its closed form."""
    found = Rotation(tolerance=tolerance).advance(np.array([1.0, 0.0, 1.0]), 3.0 * np.pi)
    expected = [-1.0, 0.0, np.exp(-0.9 * np.pi)]
    # some tens of steps, each off by the tolerance times (1 + |x|)
    assert np.linalg.norm(found - expected) <= 100.0 * tolerance


def test_rest_takes_no_time() -> None:
    # steps grow while nothing happens: a billion units of time are a few dozen steps
    found = Lorenz().advance(np.zeros(3), 1e9)
    assert found.tolist() == [0.0, 0.0, 0.0]


class Drift(IntegratedFlow):
    """No parameters, one coordinate, no dataclass of its own."""

    @property
    def dimension(self) -> int:
        return 1

    def velocity(self, state: Array) -> Array:
        return np.cos(finite_array("state", state, (1,)))

    def velocity_jacobian(self, state: Array) -> Array:
        return -np.sin(finite_array("state", state, (1,)))[:, None]


def test_a_flow_needs_no_parameters() -> None:
    assert dict(Drift().parameters) == {}
    # x' = cos x from 0: the Gudermannian function of t
    assert Drift().advance(np.zeros(1), 2.0) == pytest.approx(np.arctan(np.sinh(2.0)), abs=1e-11)


def test_a_flow_on_a_line_has_a_derivative() -> None:
    # d/dx of the flow of x' = f(x) is f(end) / f(start)
    end = Drift().advance(np.array([0.3]), 2.0)
    expected = np.cos(end) / np.cos(0.3)
    assert Drift().derivative(np.array([0.3]), 2.0)[0] == pytest.approx(expected, rel=1e-11)


def test_the_state_is_not_changed() -> None:
    start = STATES["lorenz"][0].copy()
    hit = Lorenz().next_crossing(start, Hyperplane(np.eye(3)[0], direction=-1), 10.0)
    assert start.tolist() == STATES["lorenz"][0].tolist()
    assert abs(hit.state[0]) <= 8.0 * ROUNDING * np.linalg.norm(hit.state)
