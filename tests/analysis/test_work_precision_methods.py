"""The methods beside dynkit: their orders, what they miss, and when they give up."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from dynkit.analysis import ExactImpacts, ImpactMethod, WorkPrecision
from dynkit.analysis.work_precision.comparing import Comparison, compare
from dynkit.analysis.work_precision.exact_maps import ExactMaps
from dynkit.analysis.work_precision.heyoka import Heyoka
from dynkit.analysis.work_precision.methods import GaveUp, Unsuited
from dynkit.analysis.work_precision.moreau import MoreauTimeStepping
from dynkit.analysis.work_precision.paper import PaperAlgorithm
from dynkit.analysis.work_precision.siconos import Siconos
from dynkit.analysis.work_precision.solve_ivp import SolveIVP, Solver
from dynkit.systems import ImpactChain, MatrixOscillator, PlayOscillator
from tests.analysis.work_precision_cases import bounces, exact_of, sticking


def outcome(method: ImpactMethod, exact: ExactImpacts, tolerance: float) -> Comparison:
    return compare(method.prepare(exact, tolerance)(method.budget), exact)


def errors(method: ImpactMethod, exact: ExactImpacts, tolerances: list[float]) -> np.ndarray:
    outcomes = [outcome(method, exact, tolerance) for tolerance in tolerances]
    assert all(each.right for each in outcomes)
    return np.array([each.error for each in outcomes])


def order(tolerances: list[float], found: np.ndarray) -> float:
    return float(np.polyfit(np.log(tolerances), np.log(found), 1)[0])


# --- orders ---------------------------------------------------------------------------------------


def test_time_stepping_has_the_first_order() -> None:
    steps = [1e-3 * 2.0**-k for k in range(6)]
    found = errors(MoreauTimeStepping(), bounces(), steps)
    assert order(steps, found) == pytest.approx(1.0, abs=0.25)


def test_time_stepping_sticks_and_lets_go() -> None:
    # the release is that of the run of steps with impulses; its error has the first order too
    found = errors(MoreauTimeStepping(), sticking(), [1e-3, 1e-5])
    assert found[1] < 0.1 * found[0]


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "Radau", "LSODA"])
@pytest.mark.parametrize("exact", [bounces, sticking])
def test_errors_of_solve_ivp_fall_with_the_tolerance(solver: Solver, exact: object) -> None:
    assert callable(exact)
    tolerances = [1e-4, 1e-8]
    found = errors(SolveIVP(solver), exact(), tolerances)
    assert found[1] < 1e-6
    assert order(tolerances, found) > 0.7


@pytest.mark.parametrize("exact", [bounces, sticking])
def test_errors_of_taylor_s_method_fall_to_rounding(exact: object) -> None:
    assert callable(exact)
    tolerances = [1e-3, 1e-9, 2.0**-52]
    found = errors(Heyoka(), exact(), tolerances)
    assert (np.diff(found) < 0.0).all()
    assert found[2] < 1e-13


@pytest.mark.parametrize("exact", [bounces, sticking])
def test_the_paper_reaches_rounding_where_it_finds_the_impacts(exact: object) -> None:
    assert callable(exact)
    (found,) = errors(PaperAlgorithm(), exact(), [1e-12])
    assert found < 1e-11


@pytest.mark.parametrize("exact", [bounces, sticking])
def test_dynkit_reaches_rounding(exact: object) -> None:
    assert callable(exact)
    (found,) = errors(ExactMaps(), exact(), [0.0])
    assert found < 1e-13


def test_damping_beyond_critical_is_motion_like_other_for_the_paper() -> None:
    exact = exact_of(1, masses=3, damping=3.0, frequency=0.87)
    assert outcome(PaperAlgorithm(), exact, 1e-12).error < 1e-12


@pytest.mark.parametrize(
    "method",
    [SolveIVP("DOP853"), MoreauTimeStepping(), PaperAlgorithm(), Heyoka()],
    ids=lambda m: m.name,
)
def test_a_mass_below_its_table_is_its_mirror_image(method: ImpactMethod) -> None:
    above = exact_of(3, frequency=0.87)
    system = above.system.replace(side="below")
    below = ExactImpacts(
        system=system,
        position=-above.position,
        velocity=-above.velocity,
        phase=math.pi,
        until=above.until,
        times=above.times,
        positions=-above.positions,
        velocities=-above.velocities,
    )
    tolerance = method.tolerances[-1]
    beside = outcome(method, above, tolerance).error
    assert outcome(method, below, tolerance).error == pytest.approx(beside, abs=1e-11)


def test_forces_act_in_the_peers_as_in_dynkit() -> None:
    system = MatrixOscillator(
        M=[[1, 0], [0, 2]], C=[[0.1, 0], [0, 0.3]], K=[[2, -1], [-1, 2]], frequency=1.1,
        harmonic_forces=[0.2 + 0.1j, 0.3], constant_forces=[0.0, -0.5], amplitude=0.05, contact=0,
    )  # fmt: skip
    record = system.simulate(impacts=6, start=system.state([0.6, 0.2]))
    exact = ExactImpacts(
        system=system,
        position=[0.6, 0.2],
        velocity=[0.0, 0.0],
        until=float(record.time[4:].mean()),
        times=record.time[:5],
        positions=record.position[:5],
        velocities=record.velocity[:5],
    )
    assert outcome(SolveIVP("DOP853"), exact, 1e-11).error < 1e-8
    assert outcome(MoreauTimeStepping(), exact, 1e-5).error < 1e-2
    assert outcome(Heyoka(), exact, 1e-12).error < 1e-11
    with pytest.raises(Unsuited, match="forces"):
        PaperAlgorithm().prepare(exact, 1e-6)


# --- grazing --------------------------------------------------------------------------------------


def grazing(depth: float) -> ExactImpacts:
    """One undamped mass that swings from 1 to the table at rest, which is this deep in its way."""
    offset = -1.0 + depth
    hit = depth > 0.0
    at, speed = (math.acos(offset), math.sqrt(depth * (2.0 - depth))) if hit else (0.0, 0.0)
    system = ImpactChain(masses=1, damping=0.0, amplitude=0.0, offset=offset, frequency=1.07)
    return ExactImpacts(
        system=system,
        position=[1.0],
        velocity=[0.0],
        until=4.0,
        times=[at] if hit else [],
        positions=[[offset]] if hit else np.zeros((0, 1)),
        velocities=[[0.85 * speed]] if hit else np.zeros((0, 1)),
    )


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, -1e-9, -1e-6])
def test_dynkit_neither_misses_nor_invents_a_grazing(depth: float) -> None:
    assert outcome(ExactMaps(), grazing(depth), 0.0).right


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [(SolveIVP("DOP853"), 1e-10), (PaperAlgorithm(), 1e-12)],
    ids=["solve_ivp", "paper"],
)
def test_what_samples_misses_a_grazing(method: ImpactMethod, tolerance: float) -> None:
    assert outcome(method, grazing(1e-9), tolerance).missed == 1
    assert outcome(method, grazing(-1e-9), tolerance).right


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "tolerance", "message"),
    [
        (SolveIVP("RK45", budget=100), 1e-9, "more evaluations than allowed"),
        (PaperAlgorithm(budget=20), 1e-6, "more samples than allowed"),
        (MoreauTimeStepping(budget=1000), 1e-4, "more steps than allowed"),
        (Heyoka(budget=5), 1e-9, "more steps than allowed"),
    ],
    ids=["solve_ivp", "paper", "Moreau", "heyoka"],
)
def test_more_work_than_the_budget_is_not_done(
    method: ImpactMethod, tolerance: float, message: str
) -> None:
    with pytest.raises(GaveUp, match=message):
        method.prepare(bounces(), tolerance)(method.budget)


@pytest.mark.parametrize(
    ("method", "module"), [(Heyoka(), "heyoka"), (Siconos(), "siconos")], ids=["heyoka", "Siconos"]
)
def test_a_library_that_is_not_installed_is_named(
    method: ImpactMethod, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    (one,) = WorkPrecision({"bounces": bounces()}, [method])
    assert one.remark.startswith(f"{method.name} is not installed")


def test_what_a_peer_is_not_made_for_is_said() -> None:
    play = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0)
    exact = ExactImpacts(
        system=play, position=[0.0], velocity=[0.5], until=1.0, times=[], positions=[],
        velocities=[],
    )  # fmt: skip
    with pytest.raises(Unsuited, match="not made for it: a second stop"):
        SolveIVP("RK45").prepare(exact, 1e-6)
    apart = exact_of(1, frequency=0.87)
    coupled = ExactImpacts(
        system=ImpactChain(masses=2, damping=(0.5, 0.0), frequency=0.87),
        position=apart.position,
        velocity=apart.velocity,
        until=1.0,
        times=[],
        positions=np.zeros((0, 2)),
        velocities=np.zeros((0, 2)),
    )
    with pytest.raises(Unsuited, match="dashpots that couple the modes"):
        PaperAlgorithm().prepare(coupled, 1e-6)


def test_dynkit_has_no_tolerance() -> None:
    with pytest.raises(ValueError, match=r"tolerance must be 0, as there is none; got 0.1"):
        ExactMaps().prepare(bounces(), 0.1)
