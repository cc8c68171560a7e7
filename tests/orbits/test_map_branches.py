"""Branches and curves of maps that dynkit ships: bifurcations in closed form, to 1e-10."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from dynkit import (
    Bifurcation,
    Branch,
    Map,
    MapAttractor,
    MapOrbit,
    PoincareMap,
    Stroboscope,
    continue_curve,
    continue_orbit,
    periodic_orbit,
)
from dynkit.systems import BouncingBall, DelayedLogistic, Duffing, Henon, HighBounce, Logistic

TEN_DIGITS = 1e-10


def branch(
    system: Map, guess: list[float], parameter: str, bounds: tuple[float, float], n: int = 1
) -> Branch:
    orbit = periodic_orbit(system, guess, period=n)
    return continue_orbit(orbit, parameter, bounds=bounds, largest_step=0.3, points=400)


def only(found: Branch, kind: str) -> Bifurcation:
    (bifurcation,) = (b for b in found.bifurcations if b.kind == kind)
    return bifurcation


@pytest.fixture(scope="module")
def quadratic() -> Branch:
    return branch(Logistic(2.5), [0.6], "rate", (0.5, 4.0))


def test_the_fixed_point_of_the_logistic_map(quadratic: Branch) -> None:
    # it meets the fixed point zero at rate 1, and doubles its period at 3
    assert [b.kind for b in quadratic.bifurcations] == ["BP", "PD"]
    assert abs(only(quadratic, "BP").value - 1.0) < TEN_DIGITS
    assert abs(only(quadratic, "PD").value - 3.0) < TEN_DIGITS
    rate = quadratic.parameter
    assert quadratic.unknowns[:, 0] == pytest.approx(1.0 - 1.0 / rate, abs=1e-13)
    assert quadratic.multipliers[:, 0] == pytest.approx(2.0 - rate, abs=1e-12)


@pytest.mark.parametrize("guess", [0.1, -1e-9, 1e-200])
def test_the_fixed_point_at_zero_is_zero_and_can_be_followed(guess: float) -> None:
    orbit = periodic_orbit(Logistic(0.5), [guess])
    assert orbit.states.tolist() == [[0.0]]
    assert orbit.multipliers == pytest.approx(0.5, abs=1e-15)
    found = continue_orbit(orbit, "rate", bounds=(0.2, 3.5))
    assert [each.kind for each in found.bifurcations] == ["BP"]
    assert abs(only(found, "BP").value - 1.0) < TEN_DIGITS
    assert not found.unknowns.any()


def test_period_three_of_the_logistic_map() -> None:
    found = branch(Logistic(3.84), [0.15], "rate", (3.7, 4.0), n=3)
    assert abs(only(found, "SN").value - (1.0 + math.sqrt(8.0))) < TEN_DIGITS


@pytest.fixture(scope="module")
def henon() -> Branch:
    return branch(Henon(0.2), [0.6, 0.2], "a", (-0.5, 1.4))


def test_henons_map(henon: Branch) -> None:
    # M. Henon, Commun. Math. Phys. 50 (1976) 69-77
    assert [b.kind for b in henon.bifurcations] == ["SN", "PD"]
    assert abs(only(henon, "SN").value + 0.7**2 / 4.0) < TEN_DIGITS
    doubling = only(henon, "PD")
    assert abs(doubling.value - 3.0 * 0.7**2 / 4.0) < TEN_DIGITS
    (orbit,) = doubling.switch()
    # of period two: (1 - b)^2 + (1 + b)^2 / 4
    second = continue_orbit(orbit, "a", bounds=(0.2, 1.4))
    assert abs(only(second, "PD").value - (0.7**2 + 1.3**2 / 4.0)) < TEN_DIGITS


def test_high_bounces() -> None:
    found = branch(HighBounce(restitution=0.8, gamma=2.0), [4.1, 6.3], "gamma", (0.1, 5.0))
    born = 2.0 * math.pi * 0.2
    assert abs(only(found, "SN").value - born) < TEN_DIGITS
    assert abs(only(found, "PD").value - 2.0 * math.hypot(born / 2.0, 1.8)) < TEN_DIGITS


def test_a_ball_that_bounces_once_a_period() -> None:
    ball = BouncingBall(amplitude=0.1, frequency=3.2, restitution=0.7)
    found = branch(ball, [0.81, 1.0], "amplitude", (0.04, 0.13))
    born = math.pi * 0.3 / 1.7
    doubled = math.hypot(born, 2.0 * (1.0 + 0.7**2) / 1.7**2)
    assert abs(only(found, "SN").value - born / 3.2**2) < TEN_DIGITS
    assert abs(only(found, "PD").value - doubled / 3.2**2) < TEN_DIGITS


def test_a_neimark_sacker_bifurcation() -> None:
    found = branch(DelayedLogistic(1.9), [0.5, 0.5], "rate", (1.1, 2.2))
    border = only(found, "NS")
    assert abs(border.value - 2.0) < TEN_DIGITS
    assert border.multiplier == pytest.approx(np.exp(1j * np.pi / 3.0), abs=1e-9)


def test_duffings_oscillator_settles_on_what_branches_off() -> None:
    duffing = Duffing(force=0.25)
    stroboscopic = PoincareMap(duffing, Stroboscope(3), time_limit=10.0)
    found = branch(stroboscopic, [1.2, 0.1], "force", (0.25, 0.28))
    doubling = only(found, "PD")
    (orbit,) = doubling.switch()
    second = continue_orbit(
        orbit, "force", bounds=(0.25, 0.275), step=0.03, largest_step=0.5, points=8
    )
    place = int(np.argmax(second.parameter))
    force = float(second.parameter[place])
    assert force > doubling.value
    attractor = MapAttractor(stroboscopic.replace(force=force), np.array([1.0, 0.0]), 400, 20)
    states = second.orbit(place).states
    gaps = abs(states[:, None] - attractor.states[-2:][None]).max(axis=2)
    assert second.stable[place]
    assert gaps.min(axis=1).max() <= second.error[place] + attractor.error + 1e-9


@pytest.mark.parametrize(("kind", "factor"), [("SN", -0.25), ("PD", 0.75)])
def test_curves_of_henons_map(henon: Branch, kind: str, factor: float) -> None:
    curve = continue_curve(only(henon, kind), ("a", "b"), bounds=((-1.0, 2.0), (-0.9, 0.9)))
    a, b = curve.parameters.T
    assert b.min() < -0.5
    assert b.max() > 0.5
    assert a == pytest.approx(factor * (1.0 - b) ** 2, abs=TEN_DIGITS)


def test_branches_are_stored_and_gone_on_with(quadratic: Branch, tmp_path: Path) -> None:
    quadratic.save(tmp_path / "branch.h5")
    loaded = Branch.load(tmp_path / "branch.h5", periodic_orbit(Logistic(2.5), [0.6]))
    assert (loaded.unknowns == quadratic.unknowns).all()
    (orbit,) = only(loaded, "PD").switch()
    assert isinstance(orbit, MapOrbit)
    assert orbit.label == "P(2)"
