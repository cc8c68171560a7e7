"""From a bifurcation to the branches that leave it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.results.branch import Branch
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.orbits.newton import NoConvergence, NoSolution
from dynkit.orbits.periodic_orbit import periodic_orbit
from tests.continuation.families import CycleProblem
from tests.continuation.starts import delayed_logistic, flat, henon, logistic
from tests.example_systems import ShiftedLogistic


def at(branch: Branch, kind: str) -> Bifurcation:
    (found,) = (b for b in branch.bifurcations if b.kind == kind)
    return found


def test_a_doubled_orbit_is_no_orbit_run_through_twice() -> None:
    branch = continue_orbit(logistic(), "rate", bounds=(2.0, 3.5))
    (orbit,) = at(branch, "PD").switch()
    assert orbit.label == "P(2)"
    assert np.ptp(orbit.states) > 1e-4
    assert orbit.residual < 1e-14


def test_doublings_of_the_logistic_map_accumulate() -> None:
    # the ratio of successive intervals tends to 4.669...: M. J. Feigenbaum, Quantitative
    # universality for a class of nonlinear transformations, J. Stat. Phys. 19 (1978) 25-52. The
    # places are those of K. M. Briggs, A precise calculation of the Feigenbaum constants, Math.
    # Comp. 57 (1991) 435-439, of x' = 1 - a x^2, with a = r (r - 2) / 4.
    orbit, values = logistic(), []
    branch = continue_orbit(orbit, "rate", bounds=(2.0, 3.6))
    for _ in range(4):
        doubling = at(branch, "PD")
        values.append(doubling.value)
        (start,) = doubling.switch()
        branch = continue_orbit(start, "rate", bounds=(2.0, 3.6), largest_step=0.01)
    a = [r * (r - 2.0) / 4.0 for r in values]
    known = [0.75, 1.25, 1.3680989394, 1.3940461566]
    assert np.allclose(a, known, rtol=0.0, atol=1e-10)


def test_the_doubled_orbits_of_henon_are_the_known_ones() -> None:
    branch = continue_orbit(henon(), "a", bounds=(-0.1, 0.6), points=200)
    (orbit,) = at(branch, "PD").switch()
    twofold = continue_orbit(orbit, "a", bounds=(-0.1, 0.6))
    # both x are roots of a^2 x^2 - a (1 - b) x + (1 - b)^2 - a = 0
    a, x = twofold.parameter[:, None], twofold.unknowns[:, ::2]
    # whose derivatives by x and a are below 2 and 3; x is measured in units of 2, the root of m
    wrong = abs(a**2 * x**2 - 0.7 * a * x + 0.49 - a).max(axis=1)
    assert (wrong <= 7.0 * twofold.error).all()
    assert wrong[1:].max() < 1e-12


def test_the_critical_direction_is_the_null_vector() -> None:
    doubling = at(continue_orbit(henon(), "a", bounds=(0.05, 0.6)), "PD")
    jacobian = doubling.orbit.system.jacobian(doubling.orbit.states[0])
    assert abs(jacobian @ doubling.direction + doubling.direction).max() < 1e-12
    torus = at(continue_orbit(delayed_logistic(), "rate", bounds=(1.5, 2.5)), "NS")
    jacobian = torus.orbit.system.jacobian(torus.orbit.states[0])
    assert abs(jacobian @ torus.direction - torus.multiplier * torus.direction).max() < 1e-12


@pytest.mark.parametrize(("shape", "power"), [("pitchfork", 2), ("transcritical", 1)])
def test_the_crossing_branch_is_found(shape: str, power: int) -> None:
    branch = continue_orbit(flat(shape, 0.0, 0.3), "p", bounds=(-1.0, 1.0))
    (orbit,) = at(branch, "BP").switch()
    other = continue_orbit(orbit, "p", bounds=(-1.0, 1.0))
    # whose derivatives are 1 and, at most, 2; the parameter is measured in its range, at most 2
    wrong = abs(other.parameter - other.unknowns[:, 0] ** power)
    assert (wrong <= 4.0 * other.error + 1e-15).all()
    assert np.median(wrong) < 1e-15
    assert abs(other.parameter[[0, -1]]).min() == 1.0


def test_a_branch_through_a_pitchfork_is_followed_on_the_other_side() -> None:
    # x and -x are different orbits: the branch does not retrace
    branch = continue_orbit(flat("pitchfork", 0.5, 0.25), "p", bounds=(-1.0, 1.0))
    assert [ending.reason.name for ending in branch.endings] == ["BOUND", "BOUND"]
    assert [b.kind for b in branch.bifurcations] == ["BP"]
    assert branch.unknowns[0, 0] * branch.unknowns[-1, 0] == -1.0


def test_from_the_crossing_branch_one_comes_back() -> None:
    branch = continue_orbit(flat("pitchfork", 0.5, 0.25), "p", bounds=(-1.0, 1.0))
    (orbit,) = at(branch, "BP").switch()
    assert abs(orbit.unknowns[0]) < 1e-15


def test_a_branch_too_bent_to_reach_is_refused_with_its_reason() -> None:
    # the logistic map in y = 1e3 (x - 1e3): the motion's extent is a millionth of x
    system = ShiftedLogistic(rate=2.9, offset=1e3, size=1e-3)
    branch = continue_orbit(periodic_orbit(system, [1000.00065]), "rate", bounds=(2.8, 3.2))
    with pytest.raises(NoConvergence, match=r"from 1e-02 down to 3e-07 relative to the size"):
        at(branch, "PD").switch()


def test_nothing_leaves_a_fold_or_a_torus() -> None:
    fold = continue_orbit(flat("circle", 1.0, 0.0, 1.0), "p", bounds=(-2.0, 2.0)).bifurcations[0]
    torus = at(continue_orbit(delayed_logistic(), "rate", bounds=(1.5, 2.5)), "NS")
    assert fold.switch() == torus.switch() == []


def test_a_grazing_offers_what_its_problem_knows() -> None:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    grazing = at(continue_orbit(start, "p", bounds=(0.1, 1.5)), "GR")
    (orbit,) = grazing.switch()
    # the small family offers the mirror image of the orbit that grazes, at the opposite parameter
    assert abs(orbit.unknowns[0] + 1.05) < 1e-14


def grazing() -> Bifurcation:
    start = flat("cusp", 1.2, 1.2**3 - 1.2, 1.0, border=1.05)
    return at(continue_orbit(start, "p", bounds=(-1.0, 1.0)), "GR")


def test_a_branch_with_several_guesses_is_returned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def guesses(problem: CycleProblem, event: int, x: Array, p: Array) -> list[Any]:
        aside = 1e-6 * abs(p)
        return [(problem, np.full(1, np.nan), p), (problem, x, p + aside), (problem, x, p - aside)]

    found = grazing()
    monkeypatch.setattr(CycleProblem, "neighbours", guesses)
    (orbit,) = found.switch()
    assert orbit.system.parameters["p"] == found.value * (1.0 + 1e-6)


def test_a_neighbour_whose_equations_are_not_defined_is_skipped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def undefined(*_: object) -> None:
        raise NoSolution("there is no next state")

    found = grazing()
    monkeypatch.setattr(CycleProblem, "neighbours", undefined)
    assert found.switch() == []


@dataclass(frozen=True, kw_only=True)
class Exchange(Map):
    """x' = x + p x / unit - x^2 of a pair (x, y), y' = 0.5 y + x: a branch point at p = 0."""

    p: float
    unit: float
    dimension = 2

    def __call__(self, state: Any) -> Array:
        x, y = finite_array("state", state, (2,))
        return np.array([x + self.p / self.unit * x - x**2, 0.5 * y + x])


@dataclass(frozen=True, kw_only=True)
class Doubled(Map):
    """x' = -(1 + p / unit) x + 0.3 x^2 + x^3: a period doubling at p = 0."""

    p: float
    unit: float
    dimension = 1

    def __call__(self, state: Any) -> Array:
        x = finite_array("state", state, (1,))
        return np.asarray(-(1.0 + self.p / self.unit) * x + 0.3 * x**2 + x**3)


@pytest.mark.parametrize("unit", [2.0**-30, 2.0**30])
@pytest.mark.parametrize("kind", [Exchange, Doubled])
def test_a_bifurcation_at_zero_is_left_in_all_units_of_the_parameter(
    kind: Any, unit: float
) -> None:
    system = kind(p=-0.5 * unit, unit=unit)
    orbit = periodic_orbit(system, np.zeros((1, system.dimension)))
    (bifurcation,) = continue_orbit(orbit, "p", bounds=(-0.5 * unit, 0.5 * unit)).bifurcations
    assert abs(bifurcation.value) <= 1e-13 * unit
    (other,) = bifurcation.switch()
    x, p = other.states[:, 0], other.system.p / unit
    assert abs(x).max() > 1e-6
    # on the exchanging branch x = p; the mean of the two states squared is p / (1 + 0.3^2)
    exact = p if kind is Exchange else p / (1.0 + 0.3**2)
    born = x[0] if kind is Exchange else -x[0] * x[1]
    assert abs(born - exact) <= 0.02 * abs(exact)
