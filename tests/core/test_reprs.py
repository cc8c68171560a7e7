"""What objects say of themselves in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynkit import MapAttractor, PoincareMap, Stroboscope
from dynkit.analysis import ExactImpacts, FoundImpacts
from dynkit.analysis.work_precision.measurement import Measurement
from dynkit.dynamics.map import Map
from dynkit.systems import (
    BouncingBall,
    Duffing,
    Henon,
    ImpactChain,
    Logistic,
    Lorenz,
    MatrixOscillator,
)
from dynkit.systems.structure.chain import Chain
from tests.project.test_costs_and_errors import RESULTS

EYE = np.eye(6)

SYSTEMS: dict[str, Any] = {
    "Lorenz()": Lorenz(),
    "Logistic(rate=3.3)": Logistic(rate=3.3),
    "ImpactChain(frequency=0.9)": ImpactChain(frequency=0.9),
    "ImpactChain(frequency=0.1, masses=(1.0, 2.0))": ImpactChain(masses=(1.0, 2.0), frequency=0.1),
    "BouncingBall(frequency=3.0, gravity=2.0)": BouncingBall(frequency=3.0, gravity=2.0),
    "PoincareMap(flow=Duffing(force=0.3), section=Stroboscope(3, 0.0), time_limit=9.0)": (
        PoincareMap(Duffing(force=0.3), Stroboscope(3), 9.0)
    ),
    "Chain(masses=<30 numbers>, springs=<30 numbers>, dashpots=<30 numbers>)": Chain(30),
    "MatrixOscillator(frequency=1.0, M=<6 x 6 numbers>, C=<6 x 6 numbers>, K=<6 x 6 numbers>)": (
        MatrixOscillator(M=EYE, C=0.0 * EYE, K=EYE, frequency=1.0)
    ),
}


@pytest.mark.parametrize("text", SYSTEMS)
def test_systems_show_what_differs_from_their_defaults(text: str) -> None:
    assert repr(SYSTEMS[text]) == text


@pytest.mark.parametrize(
    "system", [ImpactChain(masses=(0.1, 2.0), frequency=2.0**0.5, damping=1.0 / 3.0), Henon(a=0.1)]
)
def test_short_systems_are_made_again_from_their_line(system: object) -> None:
    assert eval(repr(system)) == system


def test_systems_of_users_show_themselves_too() -> None:
    @dataclass(frozen=True)
    class Tapered(ImpactChain):
        taper: float = 1.0

    class Doubling(Map):
        dimension = 1

        def __call__(self, state: Any) -> Any:
            return 2.0 * state % 1.0

        def jacobian(self, state: Any) -> Any:
            return np.array([[2.0]])

    @dataclass(frozen=True)
    class Named(Logistic):
        def __repr__(self) -> str:
            return "mine"

    @dataclass(frozen=True)
    class Grandchild(Named):
        more: float = 2.0

    assert repr(Tapered(frequency=1.5, taper=0.5)) == "Tapered(frequency=1.5, taper=0.5)"
    assert repr(Doubling()) == "Doubling()"
    assert repr(Grandchild()) == repr(Named()) == "mine"


@pytest.mark.parametrize("make", RESULTS.values(), ids=RESULTS)
def test_results_say_in_one_short_line_what_they_are(make: Callable[[], Any]) -> None:
    shown = repr(make())
    assert "\n" not in shown
    assert " object at 0x" not in shown
    assert len(shown) < 160


def test_states_say_where_they_are() -> None:
    state = ImpactChain(masses=30, frequency=0.9).state()
    assert repr(state).startswith("<ImpactState of 30 coordinates: in flight, phase 0, ")


def test_an_attractor_shows_its_label_once_it_is_known() -> None:
    attractor = MapAttractor(Logistic(rate=3.2), np.array([0.3]), 100, 20)
    assert repr(attractor) == "<MapAttractor of Logistic(rate=3.2): 20 states after 100>"
    assert repr(attractor.label).startswith("<OrbitLabel P(2): error ")
    assert repr(attractor) == "<MapAttractor of Logistic(rate=3.2): P(2), 20 states after 100>"


def exact_fall(system: object) -> ExactImpacts:
    """A ball that falls by 1 and comes up again."""
    return ExactImpacts(
        system=system,
        position=[1.0],
        velocity=[0.0],
        until=1.5,
        period=1.0,
        times=["1.0"],
        positions=[["0.0"]],
        velocities=[["1.6"]],
    )


def test_impacts_say_how_many_there_are() -> None:
    found = FoundImpacts([1.0, 2.0], [[0.0], [0.0]], [[1.0], [1.0]], [], {"root_searches": 7})
    assert repr(found) == "<FoundImpacts: 2 impacts, 0 releases, 7 root searches>"
    assert repr(exact_fall("a ball")) == "<ExactImpacts of a ball: 1 impacts, 0 releases up to 1.5>"
    chain = ImpactChain(masses=1, frequency=2.0**0.5)
    assert repr(exact_fall(chain)) == (
        "<ExactImpacts of ImpactChain(frequency=1.41421, masses=1): "
        "1 impacts, 0 releases up to 1.5>"
    )


@pytest.mark.parametrize(
    ("measured", "text"),
    [
        (
            Measurement(job="fall", method="DOP853", tolerance=1e-6, error=2e-15, seconds=0.25),
            "<Measurement of DOP853 at 1e-06 on fall: error 2.0e-15, 0.25 s>",
        ),
        (
            Measurement(
                job="fall",
                method="paper",
                tolerance=0.0,
                seconds=0.1,
                lost=1,
                impacts=9,
                missed=2,
                remark="lost",
            ),
            "<Measurement of paper on fall: 2 missed, 0 invented of 9, 0.1 s, lost>",
        ),
        (
            Measurement(
                job="fall", method="heyoka", tolerance=float("nan"), remark="not installed"
            ),
            "<Measurement of heyoka on fall: not installed>",
        ),
    ],
)
def test_measurements_say_what_was_measured(measured: Measurement, text: str) -> None:
    assert repr(measured) == text
