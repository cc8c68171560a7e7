"""The methods that come with dynkit: their orders, what they miss, and when they give up."""

from __future__ import annotations

import pytest

from dynkit.analysis import ExactImpacts
from dynkit.analysis.work_precision.methods import GaveUp, Unsuited
from dynkit.analysis.work_precision.solve_ivp import SolveIVP, Solver
from dynkit.analysis.work_precision.standard_methods import ExactMaps
from dynkit.systems import PlayOscillator
from tests.analysis.work_precision_cases import (
    bounces,
    errors,
    forced,
    grazing,
    mirrored,
    order_of,
    outcome,
    sticking,
)

# --- orders ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "Radau", "LSODA"])
@pytest.mark.parametrize("exact", [bounces, sticking])
def test_errors_of_solve_ivp_fall_with_the_tolerance(solver: Solver, exact: object) -> None:
    assert callable(exact)
    tolerances = [1e-4, 1e-8]
    found = errors(SolveIVP(solver), exact(), tolerances)
    assert found[1] < 1e-6
    assert order_of(tolerances, found) > 0.7


@pytest.mark.parametrize("exact", [bounces, sticking])
def test_dynkit_reaches_rounding(exact: object) -> None:
    assert callable(exact)
    (found,) = errors(ExactMaps(), exact(), [0.0])
    assert found < 1e-13


def test_a_mass_below_its_table_is_its_mirror_image() -> None:
    above, below = mirrored()
    method = SolveIVP("DOP853")
    beside = outcome(method, above, method.tolerances[-1]).error
    assert outcome(method, below, method.tolerances[-1]).error == pytest.approx(beside, abs=1e-11)


def test_forces_act_in_solve_ivp_as_in_dynkit() -> None:
    assert outcome(SolveIVP("DOP853"), forced(), 1e-11).error < 1e-8


# --- grazing --------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, -1e-9, -1e-6])
def test_dynkit_neither_misses_nor_invents_a_grazing(depth: float) -> None:
    assert outcome(ExactMaps(), grazing(depth), 0.0).right


def test_what_samples_misses_a_grazing() -> None:
    assert outcome(SolveIVP("DOP853"), grazing(1e-9), 1e-10).missed == 1
    assert outcome(SolveIVP("DOP853"), grazing(-1e-9), 1e-10).right


# --- refusals -------------------------------------------------------------------------------------


def test_more_work_than_the_budget_is_not_done() -> None:
    method = SolveIVP("RK45", budget=100)
    with pytest.raises(GaveUp, match="more evaluations than allowed"):
        method.prepare(bounces(), 1e-9)(method.budget)


def test_what_solve_ivp_is_not_made_for_is_said() -> None:
    play = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0)
    exact = ExactImpacts(
        system=play, position=[0.0], velocity=[0.5], until=1.0, times=[], positions=[],
        velocities=[],
    )  # fmt: skip
    with pytest.raises(Unsuited, match="not made for it: a second stop"):
        SolveIVP("RK45").prepare(exact, 1e-6)


def test_dynkit_has_no_tolerance() -> None:
    with pytest.raises(ValueError, match=r"tolerance must be 0, as there is none; got 0.1"):
        ExactMaps().prepare(bounces(), 0.1)
