"""Closed branches are gone round once, whatever the start and however angles are counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from dynkit import Map, continue_orbit, explore, periodic_orbit
from dynkit.continuation.results.membership import Trail
from dynkit.continuation.termination import Reason
from dynkit.core.validation import Array, finite_array
from dynkit.systems import ImpactChain
from tests.effort import some


@dataclass(frozen=True)
class Circle(Map):
    """x' = x + turn omega - k sin(s x) / s, s = 2 pi / turn: P(1) folds at 2 pi omega = +-k."""

    omega: float
    k: float
    turn: float

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x, s = finite_array("state", state, (1,)), 2.0 * np.pi / self.turn
        return np.asarray(x + self.turn * self.omega - self.k / s * np.sin(s * x))

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[1.0 - self.k * np.cos(2.0 * np.pi / self.turn * x)]])

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.asarray(a) - np.asarray(b)
        return np.asarray(gap - self.turn * np.rint(gap / self.turn))


def start(omega: float, k: float, turn: float, number: int) -> float:
    """One of the fixed points, some turns away."""
    s = 2.0 * np.pi / turn
    stable = float(np.arcsin(2.0 * np.pi * omega / k)) / s
    return (stable if number % 2 else 0.5 * turn - stable) + turn * (number // 2 - 4)


@pytest.mark.parametrize("turn", [2.0 * np.pi, 1.0])
@pytest.mark.parametrize("omega", [0.05, 0.1])
def test_a_branch_of_a_circle_map_is_gone_round_once_from_all_starts(
    omega: float, turn: float
) -> None:
    k = 0.9
    starts = some(range(17), 5)  # at stable and at unstable ones, turns before and after zero
    for number in starts:
        orbit = periodic_orbit(Circle(omega, k, turn), [start(omega, k, turn, number)])
        branch = continue_orbit(orbit, "omega", bounds=(-0.3, 0.3))
        assert [ending.reason.name for ending in branch.endings] == ["CLOSED", "CLOSED"]
        folds = sorted(b.value for b in branch.bifurcations)
        assert [b.kind for b in branch.bifurcations] == ["SN", "SN"]
        assert folds == pytest.approx([-k / (2.0 * np.pi), k / (2.0 * np.pi)], abs=1e-12)
        assert np.ptp(branch.unknowns[:, 0]) == pytest.approx(turn, abs=1e-5 * turn)
        again = periodic_orbit(Circle(omega, k, turn), [start(omega, k, turn, number + 4)])
        assert Trail(branch).holds(again)


@dataclass(frozen=True)
class Rotor(Map):
    """x' = x + 2 pi / 3 + p + e sin(3 x): orbits P(3), fold at p = +-e, closed in p."""

    p: float
    e: float

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.asarray(x + 2.0 * np.pi / 3.0 + self.p + self.e * np.sin(3.0 * x))

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[1.0 + 3.0 * self.e * np.cos(3.0 * x)]])

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.asarray(a) - np.asarray(b)
        return np.asarray(gap - 2.0 * np.pi * np.rint(gap / (2.0 * np.pi)))


@pytest.mark.parametrize("number", range(6))
def test_an_orbit_that_comes_again_from_another_state_on_closes_its_branch(number: int) -> None:
    # along the branch each state becomes the next one: a third of the turn is the whole branch
    x = (np.pi * (number % 2) + (1 - 2 * (number % 2)) * np.arcsin(-0.2)) / 3.0
    states = x + 2.0 * np.pi / 3.0 * np.arange(number, number + 3)
    orbit = periodic_orbit(Rotor(0.02, 0.1), states[:, None])
    assert orbit.label == "P(3)"
    branch = continue_orbit(orbit, "p", bounds=(-0.3, 0.3))
    assert [ending.reason.name for ending in branch.endings] == ["CLOSED", "CLOSED"]
    assert sorted((b.kind, round(b.value, 9)) for b in branch.bifurcations) == [
        ("SN", -0.1),
        ("SN", 0.1),
    ]
    assert np.ptp(branch.unknowns[:, 0]) == pytest.approx(2.0 * np.pi / 3.0, abs=1e-4)


def test_a_long_closed_branch_of_a_network_is_gone_round_once() -> None:
    chain = ImpactChain(masses=10, frequency=1.263)
    orbit = chain.periodic_orbit(impacts=2, periods=5, phases=[5.06, 26.95])
    problem = orbit.problem("frequency")
    # in units of the slow orbit that the branch was switched from, its steps are small
    small = problem.remade(sizes=(0.1, 0.03725)).orbit(orbit.unknowns, problem.values)
    network = explore(
        chain, "frequency", (0.14, 2.0), iterates=2, periods=5, seeds=[small], branches=1
    )
    (branch,) = network.branches
    assert [ending.reason for ending in branch.endings] == [Reason.CLOSED] * 2
    assert len(branch) > 2000
