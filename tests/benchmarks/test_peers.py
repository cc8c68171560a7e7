"""The peers of dynkit: their orders, what they miss, and when they give up."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from dynkit.analysis import ExactImpacts, ImpactMethod, WorkPrecision
from dynkit.analysis.work_precision.methods import GaveUp, Unsuited
from dynkit.systems import ImpactChain
from tests.analysis.work_precision_cases import (
    bounces,
    errors,
    exact_of,
    forced,
    grazing,
    mirrored,
    order_of,
    outcome,
    sticking,
)
from tests.benchmarks.peers import all_methods
from tests.benchmarks.peers.heyoka import Heyoka
from tests.benchmarks.peers.moreau import MoreauTimeStepping
from tests.benchmarks.peers.paper import PaperAlgorithm
from tests.benchmarks.peers.siconos import Siconos

# --- orders ---------------------------------------------------------------------------------------


def test_time_stepping_has_the_first_order() -> None:
    steps = [1e-3 * 2.0**-k for k in range(6)]
    found = errors(MoreauTimeStepping(), bounces(), steps)
    assert order_of(steps, found) == pytest.approx(1.0, abs=0.25)


def test_time_stepping_sticks_and_lets_go() -> None:
    # the release is that of the run of steps with impulses; its error has the first order too
    found = errors(MoreauTimeStepping(), sticking(), [1e-3, 1e-5])
    assert found[1] < 0.1 * found[0]


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


def test_damping_beyond_critical_is_motion_like_other_for_the_paper() -> None:
    exact = exact_of(1, masses=3, damping=3.0, frequency=0.87)
    assert outcome(PaperAlgorithm(), exact, 1e-12).error < 1e-12


@pytest.mark.parametrize(
    "method", [MoreauTimeStepping(), PaperAlgorithm(), Heyoka()], ids=lambda m: m.name
)
def test_a_mass_below_its_table_is_its_mirror_image(method: ImpactMethod) -> None:
    above, below = mirrored()
    beside = outcome(method, above, method.tolerances[-1]).error
    assert outcome(method, below, method.tolerances[-1]).error == pytest.approx(beside, abs=1e-11)


def test_forces_act_in_the_peers_as_in_dynkit() -> None:
    exact = forced()
    assert outcome(MoreauTimeStepping(), exact, 1e-5).error < 1e-2
    assert outcome(Heyoka(), exact, 1e-12).error < 1e-11
    with pytest.raises(Unsuited, match="forces"):
        PaperAlgorithm().prepare(exact, 1e-6)


# --- grazing --------------------------------------------------------------------------------------


def test_what_samples_misses_a_grazing() -> None:
    assert outcome(PaperAlgorithm(), grazing(1e-9), 1e-12).missed == 1
    assert outcome(PaperAlgorithm(), grazing(-1e-9), 1e-12).right


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "tolerance", "message"),
    [
        (PaperAlgorithm(budget=20), 1e-6, "more samples than allowed"),
        (MoreauTimeStepping(budget=1000), 1e-4, "more steps than allowed"),
        (Heyoka(budget=5), 1e-9, "more steps than allowed"),
    ],
    ids=["paper", "Moreau", "heyoka"],
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


def test_what_the_paper_is_not_made_for_is_said() -> None:
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


@pytest.mark.parametrize("name", ["paper", "Moreau"])
def test_peers_say_of_what_is_no_impact_oscillator_that_they_are_not_made_for_it(name: str) -> None:
    clock = ExactImpacts(
        system="a clock", position=[0.0], velocity=[0.0], until=10.0, period=2.0,
        times=[1.0], positions=[[4.0]], velocities=[[0.5]],
    )  # fmt: skip
    (one,) = WorkPrecision({"clock": clock}, all_methods([name]))
    assert one.remark.startswith("not made for it: ")
