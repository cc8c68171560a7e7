"""Growth of disturbances along iterates, in machine code and step by step."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from dynkit import Hyperplane, PoincareMap, ResetMap, Stroboscope
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.systems import (
    Henon,
    HenonHeiles,
    Logistic,
    SimplestWalker,
    StandardMap,
    SymbolicMap,
)
from tests.flows.symbolic_flows import Kicked
from tests.flows.test_growth_on_the_way import LOSS, Growing


@pytest.mark.parametrize("system", [Logistic(rate=3.9), Henon(), StandardMap(k=2.0)])
def test_growth_in_machine_code_is_that_of_single_steps(system: SymbolicMap) -> None:
    state = np.full(system.dimension, 0.3)
    fast, slow = system._growth(state, 25), SmoothMap._growth(system, state, 25)
    assert fast == pytest.approx(slow, abs=1e-6)  # chaos parts the motions, from the last digits
    assert fast[:5] == pytest.approx(slow[:5], abs=1e-12)
    assert state.tolist() == [0.3] * system.dimension


def test_of_a_superstable_orbit_all_growth_is_lost() -> None:
    assert (Logistic(rate=2.0)._growth(np.array([0.5]), 9) == -np.inf).all()


def test_a_direction_that_nearly_vanishes_has_a_logarithm() -> None:
    """Its first coordinate is lost but for rounding, and its second one is multiplied by b."""
    system = Henon(a=1.4, b=1e-17)
    logs = system._growth(np.array([3.0**0.5 / (2.8 * 2.0**0.5), 0.0]), 2)
    assert np.isfinite(logs).all()
    assert logs[0] < -34.0


PLANE = Hyperplane(np.array([0.0, 1.0, 0.0, 0.0]))
RETURNS: dict[str, tuple[Any, list[float]]] = {
    "kicked pendulum": (PoincareMap(Kicked(frequency=1.0), Stroboscope(3), 10.0), [0.5, 0.0]),
    "on a level": (
        PoincareMap(HenonHeiles(), PLANE, 50.0, level=("energy", 0.1)),
        [0.1, 0.1, 0.4],
    ),
    "walker": (ResetMap(SimplestWalker(), time_limit=10.0), [0.2, 0.4, -0.2, -0.016]),
}


@pytest.mark.parametrize("name", RETURNS)
def test_growth_over_returns_is_that_of_the_product_of_jacobians(name: str) -> None:
    returns, start = RETURNS[name]
    found = returns._growth(np.array(start), 5)
    expected = SmoothMap._growth(_Plain(returns), np.array(start), 5)
    assert found == pytest.approx(expected, abs=1e-11)


class _Plain(SmoothMap):
    """A map of which only calls and jacobians are known."""

    def __init__(self, given: SmoothMap) -> None:
        self.given = given

    @property
    def dimension(self) -> int:
        return self.given.dimension

    def __call__(self, state: Array) -> Array:
        return np.asarray(self.given(state))

    def jacobian(self, state: Array) -> Array:
        return self.given.jacobian(state)


def test_growth_over_periods_that_undo_it_is_that_in_closed_form() -> None:
    """Disturbances grow e^12 times within each period, and decay by exp(-2 pi LOSS) over it."""
    returns = PoincareMap(Growing(), Stroboscope(2, phase=-0.5 * np.pi), 10.0)
    assert returns._growth(np.array([-1.0]), 20) == pytest.approx(-2.0 * np.pi * LOSS, abs=1e-7)


def test_growth_over_a_return_takes_one_crossing_and_one_derivative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Counter[str]()

    def counted(plain: Any) -> Any:
        def call(*arguments: Any) -> Any:
            made[plain.__name__] += 1
            return plain(*arguments)

        return call

    for name in ("next_crossing", "derivative"):
        monkeypatch.setattr(Kicked, name, counted(getattr(Kicked, name)))
    PoincareMap(Kicked(frequency=1.0), Stroboscope(3), 10.0)._growth(np.array([0.5, 0.0]), 7)
    assert made == {"next_crossing": 7, "derivative": 7}
