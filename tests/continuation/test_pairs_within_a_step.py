"""Two bifurcations of one kind within one step: no test function changes its sign over the step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import continue_orbit, equilibrium, periodic_orbit
from dynkit.systems import ImpactChain, SymbolicFlow, SymbolicMap
from tests.continuation.starts import flat

NARROW = 1e-4
"""Square of half the distance between the two; a step is ten times as long as that distance."""


class Doubling(SymbolicMap):
    p: float = -0.93

    def next_state(self, x: Any) -> Any:
        return (-(1.0 + NARROW - self.p**2) * x + x**3,)


class Turning(SymbolicMap):
    p: float = -0.93

    def next_state(self, x: Any, y: Any) -> Any:
        size = 1.0 + NARROW - self.p**2 - x**2 - y**2
        return size * (0.6 * x - 0.8 * y), size * (0.8 * x + 0.6 * y)


class DoublingBesideTurning(SymbolicMap):
    """A pair of PD, and NS at p = `turning`."""

    p: float = -0.93
    turning: float = 0.0

    def next_state(self, x: Any, y: Any, z: Any) -> Any:
        size = 1.0 + self.p - self.turning - y**2 - z**2
        line = -(1.0 + NARROW - self.p**2) * x + x**3
        return line, size * (0.6 * y - 0.8 * z), size * (0.8 * y + 0.6 * z)


class Oscillating(SymbolicFlow):
    p: float = -0.93

    def velocity(self, x: Any, y: Any, z: Any) -> Any:
        growth = NARROW - self.p**2 - x**2 - y**2
        return growth * x - y, x + growth * y, -z


class Folding(SymbolicFlow):
    p: float = -0.3

    def velocity(self, x: Any) -> Any:
        return (self.p + 1e-2 * x - x**3,)


def started(system: Any) -> Any:
    at_rest = np.zeros(system.dimension)
    found = equilibrium if isinstance(system, SymbolicFlow) else periodic_orbit
    return found(system, at_rest)


@pytest.mark.parametrize(
    ("system", "kind"), [(Doubling(), "PD"), (Turning(), "NS"), (Oscillating(), "HB")]
)
@pytest.mark.parametrize("start", [-0.93, -0.9, -0.87, 0.71])
def test_both_of_a_pair_are_found_wherever_the_branch_begins(
    system: Any, kind: str, start: float
) -> None:
    branch = continue_orbit(started(system.replace(p=start)), "p", bounds=(-1.0, 1.0))
    assert [str(found.kind) for found in branch.bifurcations] == [kind, kind]
    exact = np.array([-1.0, 1.0]) * np.sqrt(NARROW)
    assert [found.value for found in branch.bifurcations] == pytest.approx(exact, abs=1e-10)
    between = abs(branch.parameter) < np.sqrt(NARROW)
    assert not branch.stable[between].any()
    assert between.sum() > 0
    assert len(branch) < 60


@pytest.mark.parametrize("start", [-0.93, -0.9, -0.87, 0.71])
@pytest.mark.parametrize("turning", [-0.03, -0.014, -0.003, 0.006, 0.025])
def test_a_pair_is_found_beside_a_bifurcation_of_another_kind(turning: float, start: float) -> None:
    system = DoublingBesideTurning(p=start, turning=turning)
    branch = continue_orbit(started(system), "p", bounds=(-1.0, 1.0))
    narrow = np.sqrt(NARROW)
    exact = sorted([(-narrow, "PD"), (narrow, "PD"), (turning, "NS")])
    assert [str(found.kind) for found in branch.bifurcations] == [kind for _, kind in exact]
    values = [value for value, _ in exact]
    assert [found.value for found in branch.bifurcations] == pytest.approx(values, abs=1e-10)
    assert len(branch) < 70


def test_two_folds_that_are_nearly_one() -> None:
    branch = continue_orbit(equilibrium(Folding(), [-0.7]), "p", bounds=(-0.5, 0.5))
    x = np.sqrt(1e-2 / 3.0)
    exact = np.array([1.0, -1.0]) * (2e-2 / 3.0 * x)
    assert [str(found.kind) for found in branch.bifurcations] == ["SN", "SN"]
    assert [found.value for found in branch.bifurcations] == pytest.approx(exact, abs=1e-10)


@pytest.mark.parametrize("p", [-0.6, -0.57, 0.55])
def test_two_grazings_that_are_nearly_one(p: float) -> None:
    border = -np.sqrt(1.0 - NARROW)  # the lowest point of the circle is beyond it
    start = flat("circle", -np.sqrt(1.0 - p * p), p, 1.0, border=border)
    branch = continue_orbit(start, "p", bounds=(-0.7, 0.7))
    assert [str(found.kind) for found in branch.bifurcations] == ["GR", "GR"]
    exact = np.array([-1.0, 1.0]) * np.sqrt(NARROW)
    assert [found.value for found in branch.bifurcations] == pytest.approx(exact, abs=1e-10)
    assert not branch.admissible.all()
    alone = continue_orbit(start, "p", bounds=(-0.7, 0.7), inadmissible=False)
    assert abs(alone.parameter[abs(alone.parameter).argmin()]) >= np.sqrt(NARROW) - 1e-10
    assert alone.admissible.all()


def test_a_branch_has_the_same_bifurcations_wherever_it_begins() -> None:
    found = []
    for frequency in (0.9, 1.3, 1.9):
        (orbit,) = ImpactChain(frequency=frequency).periodic_orbits(periods=1)
        branch = continue_orbit(orbit, "frequency", bounds=(0.8, 2.0))
        found.append(sorted((each.value, str(each.kind)) for each in branch.bifurcations))
    values, kinds = zip(*(zip(*each, strict=True) for each in found), strict=True)
    assert kinds[0][-2:] == ("NS", "NS")
    assert kinds[0] == kinds[1] == kinds[2]
    assert np.ptp(values, axis=0).max() < 1e-9
