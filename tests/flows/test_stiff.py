"""Stiff flows: an implicit method goes where explicit ones take millions of steps."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynkit import Hyperplane, PoincareMap
from dynkit.core.validation import Array, finite_array
from dynkit.systems import IntegratedFlow, VanDerPol
from dynkit.testing import check_flow
from tests.flows.integrated_flows import Duffing
from tests.validation.cycles import VanDerPol as Relaxing


@dataclass(frozen=True, kw_only=True)
class Pulled(IntegratedFlow):
    """x' = -rate (x - cos t) - sin t: every motion ends on cos t."""

    rate: float = 1e6
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, t = finite_array("state", state, (2,))
        return np.array([-self.rate * (x - np.cos(t)) - np.sin(t), 1.0])

    def velocity_jacobian(self, state: Array) -> Array:
        _, t = finite_array("state", state, (2,))
        return np.array([[-self.rate, -self.rate * np.sin(t) - np.cos(t)], [0.0, 0.0]])


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_a_closed_form_is_met_within_the_estimate(tolerance: float) -> None:
    flow = Pulled(method="Radau", tolerance=tolerance)
    found = flow.advance(np.array([1.0, 0.0]), 3.0)
    off = abs(found[0] - np.cos(3.0))
    assert off <= min(flow.advance_error(np.array([1.0, 0.0]), 3.0), flow.accuracy)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("seed", range(3))
def test_relaxation_is_that_of_taylors_method_within_the_estimate(
    tolerance: float, seed: int
) -> None:
    draw = np.random.default_rng(seed)
    start, duration = draw.uniform(-2.0, 2.0, 2), float(draw.uniform(20.0, 200.0))
    flow = Relaxing(mu=100.0, method="Radau", tolerance=tolerance)
    exact = VanDerPol(mu=100.0).advance(start, duration)
    off = np.linalg.norm(flow.advance(start, duration) - exact)
    assert off <= flow.advance_error(start, duration)


def test_its_cycle_crosses_where_that_of_taylors_method_does() -> None:
    plane = Hyperplane(np.array([1.0, 0.0]))
    found, exact = (
        PoincareMap(flow, plane, time_limit=400.0).crossing(np.array([1.0]))
        for flow in (Relaxing(mu=100.0, method="Radau", tolerance=1e-8), VanDerPol(mu=100.0))
    )
    assert found.time == pytest.approx(exact.time, rel=1e-6)
    assert found.state == pytest.approx(exact.state, rel=1e-6, abs=1e-12)


def test_it_keeps_the_contract_where_nothing_is_stiff() -> None:
    duffing = Duffing(method="Radau", tolerance=1e-10)
    check_flow(duffing, np.array([[0.5, 0.2, 0.1], [-1.1, 0.4, 2.0]]))
    assert duffing.replace(force=0.2).method == "Radau"
    assert "method" not in duffing.parameters


def test_another_method_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="method must be one of: DOP853, Radau; got 'LSODA'"):
        Duffing(method="LSODA")
