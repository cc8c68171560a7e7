"""Error against run time: what is compared, counted, timed and shown."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from dynkit.analysis import (
    ExactImpacts,
    FoundImpacts,
    ImpactMethod,
    WorkPrecision,
    impact_methods,
)
from dynkit.analysis.work_precision import measurement
from dynkit.analysis.work_precision.measurement import compare, matched
from dynkit.analysis.work_precision.measuring import reference_impacts
from dynkit.analysis.work_precision.methods import OverBudget, Simulation, Unsuited
from dynkit.analysis.work_precision.solve_ivp import SolveIVP
from dynkit.systems import ImpactChain
from tests.analysis.work_precision_cases import bounces, sticking

PERIOD = 2.0


def three(**changed: Any) -> ExactImpacts:
    """Impacts of a system that no method of dynkit knows."""
    arguments: dict[str, Any] = {
        "system": "a clock",
        "position": [0.0],
        "velocity": [0.0],
        "until": 10.0,
        "period": PERIOD,
        "times": [1.0, 3.0, 5.0],
        "positions": [[4.0], [-2.0], [1.0]],
        "velocities": [[0.5], [0.25], [0.125]],
    }
    return ExactImpacts(**{**arguments, **changed})


def found(times: list[float], releases: Any = ()) -> FoundImpacts:
    states = np.zeros((len(times), 1))
    return FoundImpacts(np.array(times), states, states, releases)


class Shifted(ImpactMethod):
    """The exact impacts, late by the tolerance; without the last one where that is large."""

    name = "shifted"
    tolerances: Sequence[float] = (4e-2, 1e-3)

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        kept = slice(None, -1 if tolerance > 0.01 else None)
        return lambda budget: FoundImpacts(
            exact.times[kept] + tolerance,
            exact.positions[kept],
            exact.velocities[kept],
            work={"looks": 7},
        )


class Slow(Shifted):
    name = "slow"
    tolerances = (1e-3,)


class Tired(Shifted):
    name = "tired"
    tolerances = (1e-3,)

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        def simulate(budget: int) -> FoundImpacts:
            raise OverBudget("looks")

        return simulate


class Absent(Shifted):
    name = "absent"

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        raise Unsuited("absent is not installed")


# --- errors and matches ---------------------------------------------------------------------------


def test_errors_are_relative_to_period_and_sizes() -> None:
    exact = three()
    moved = exact.errors(
        exact.times + np.array([0.5, 0.0, 0.0]),
        exact.positions + np.array([[0.0], [1.0], [0.0]]),
        exact.velocities + np.array([[0.0], [0.0], [0.25]]),
    )
    np.testing.assert_allclose(moved, [0.5 / PERIOD, 1.0 / 4.0, 0.25 / 0.5], rtol=1e-15)


def test_numbers_beyond_doubles_count() -> None:
    third = Decimal(1) / Decimal(3)
    exact = three(times=[third, "3", "5"])
    off = float(abs(Decimal(1.0 / 3.0) - third))
    error = exact.errors([1.0 / 3.0, 3.0, 5.0], exact.positions, exact.velocities)
    assert error[0] == pytest.approx(off / PERIOD, rel=1e-12)
    assert 0.0 < error[0] < 2.0**-53
    assert exact.rounding < 1e-30 < three().rounding


@pytest.mark.parametrize(
    ("given", "exact", "pairs"),
    [
        ([1.0, 2.0], [1.01, 2.01], [(0, 0), (1, 1)]),
        ([1.0, 1.02], [1.01], [(0, 0)]),  # one of two that are as near
        ([2.0], [1.0, 2.05, 3.0], [(0, 1)]),
        ([1.09, 1.2], [1.0, 1.1], [(0, 0), (1, 1)]),  # more pairs go before nearer ones
        ([1.0], [1.2], []),
        ([], [1.0], []),
    ],
)
def test_events_are_matched_in_order_each_with_one_at_most(
    given: list[float], exact: list[float], pairs: list[tuple[int, int]]
) -> None:
    ours, theirs = matched(np.array(given), np.array(exact), 0.101)
    assert len(ours) == len(pairs)
    assert theirs.tolist() == [j for _, j in pairs]


@pytest.mark.parametrize(
    ("times", "missed", "invented"),
    [
        ([1.0, 3.0, 5.0], 0, 0),
        ([1.0, 5.0], 1, 0),
        ([1.0, 2.0, 3.0, 5.0], 0, 1),
        ([1.0, 3.5, 5.0], 1, 1),
        ([1.0, 3.0, 5.0, 10.5, 11.0], 0, 0),  # after the end
        ([], 3, 0),
    ],
)
def test_missed_and_invented_impacts_are_counted(
    times: list[float], missed: int, invented: int
) -> None:
    outcome = compare(found(times), three())
    assert (outcome.missed, outcome.invented) == (missed, invented)


def test_bounces_in_the_depth_of_a_chatter_are_not_compared() -> None:
    exact = three(chatters=[(3.2, 4.5)], releases=[4.5])
    outcome = compare(found([1.0, 3.0, 3.3, 3.9, 5.0], [4.5]), exact)
    assert outcome.right
    assert compare(found([1.0, 3.0, 5.0]), exact).missed == 1


def test_a_release_has_an_error() -> None:
    exact = three(releases=[4.5], positions=[[0.0]] * 3, velocities=[[0.0]] * 3)
    assert compare(found([1.0, 3.0, 5.0], [4.51]), exact).error == pytest.approx(0.01 / PERIOD)


# --- measurements ---------------------------------------------------------------------------------


def test_a_users_system_and_method_are_measured() -> None:
    coarse, fine = WorkPrecision({"clock": three()}, [Shifted()]).measurements
    assert fine.error == pytest.approx(1e-3 / PERIOD)
    assert (fine.missed, fine.invented, fine.impacts, fine.work) == (0, 0, 3, {"looks": 7})
    assert fine.seconds >= 0.0
    assert math.isnan(coarse.error)
    assert (coarse.missed, coarse.remark) == (1, "lost")


def test_starts_of_a_job_count_together() -> None:
    measured = WorkPrecision({"clocks": [three(), three(times=[2.0, 3.0, 5.0])]}, [Shifted()])
    coarse, fine = measured
    assert (fine.starts, fine.impacts, fine.work) == (2, 6, {"looks": 14})
    assert (coarse.lost, coarse.missed, coarse.remark) == (2, 2, "2 of 2 starts lost")


def test_a_method_that_gives_up_says_so() -> None:
    (one,) = WorkPrecision({"clock": three()}, [Tired()])
    assert one.remark == "gave up after 1000000 looks"
    assert math.isnan(one.error)
    assert math.isnan(one.seconds)


def test_a_method_that_is_not_installed_is_skipped_with_a_word() -> None:
    (one,) = WorkPrecision({"clock": three()}, [Absent()])
    assert (one.remark, one.starts) == ("absent is not installed", 0)


@pytest.mark.parametrize("name", ["dynkit", "RK45"])
def test_methods_say_of_what_is_no_impact_oscillator_that_they_are_not_made_for_it(
    name: str,
) -> None:
    (one,) = WorkPrecision({"clock": three()}, impact_methods([name]))
    assert one.remark.startswith("not made for it: ")


def test_measurements_are_made_once_and_as_they_are_asked_for() -> None:
    class Counted(Shifted):
        prepared = 0

        def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
            self.prepared += 1
            return super().prepare(exact, tolerance)

    method = Counted()
    measured = WorkPrecision({"clock": three()}, [method])
    next(iter(measured))
    assert method.prepared == 1
    assert measured.measurements == tuple(measured)
    assert method.prepared == 2


def test_the_time_of_a_run_is_the_shortest_of_its_repetitions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(measurement, "_ENOUGH", 0.2)
    ends = np.cumsum([0.0, 0.09, 0.0, 0.05, 0.0, 0.07, 0.0, 0.01])  # the last is not begun
    monkeypatch.setattr(measurement, "_now", iter(ends.tolist()).__next__)
    (one,) = WorkPrecision({"three": three()}, [Slow()]).measurements
    assert one.seconds == pytest.approx(0.05, rel=1e-12)


def test_cost_counts_measurements_and_the_error_is_that_of_the_reference() -> None:
    measured = WorkPrecision({"clock": three()}, [Shifted()])
    assert measured.cost.counts == {"measurements": 2}
    assert measured.error == 2.0**-53


def test_the_cost_counts_the_seconds_of_the_runs_that_it_asks_for() -> None:
    assert WorkPrecision({"clock": three()}, [Shifted()]).cost.seconds > 0.0


def test_what_was_measured_is_the_same_when_loaded(tmp_path: Path) -> None:
    measured = WorkPrecision({"clock": three(conditioning=64.0)}, [Shifted(), Absent()])
    measured.save(tmp_path / "x.h5")
    loaded = WorkPrecision.load(tmp_path / "x.h5")
    assert repr(loaded.measurements) == repr(measured.measurements) == repr(tuple(loaded))
    assert loaded.table() == measured.table()
    assert (loaded.floors, loaded.error) == (measured.floors, measured.error)
    lines = [each.figure().axes[0].get_lines() for each in (measured, loaded)]
    for line, again in zip(*lines, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), again.get_xydata())


def test_the_floor_is_what_rounding_the_start_costs() -> None:
    measured = WorkPrecision({"clock": three(conditioning=64.0)}, [Shifted()])
    assert measured.floors == {"clock": 2.0**-47}


# --- a user's own oscillator ----------------------------------------------------------------------


def test_own_impacts_are_as_wrong_as_they_say() -> None:
    exact = bounces()
    start = exact.system.state(exact.position, exact.velocity)
    own = reference_impacts(exact.system, start, len(exact.times), 1e-3)
    wrong = exact.errors(own.times, own.positions, own.velocities)
    assert wrong.max() <= own.error < 1e-11


def test_errors_count_from_dynkits_own_impacts_whose_error_is_said() -> None:
    exact = bounces()
    measured = WorkPrecision.of(
        exact.system,
        start=exact.system.state(exact.position, exact.velocity),
        impacts=len(exact.times),
        methods=impact_methods(["dynkit", "DOP853"]),
        progress=False,
    )
    own, *others = measured
    assert (own.error, own.reference, own.remark) == (0.0, measured.error, "not known better")
    beside = WorkPrecision({"exact": exact}, impact_methods(["DOP853"])).measurements
    for one, other in zip(others, beside, strict=True):
        assert abs(one.error - other.error) <= measured.error + beside[0].reference
    assert f"< {measured.error:.1e}" in measured.table()


def test_a_chatter_is_no_list_of_bounces() -> None:
    exact = sticking()
    start = exact.system.state(exact.position, exact.velocity)
    own = reference_impacts(exact.system, start, 80, 1e-3)
    np.testing.assert_allclose(own.releases[:1], exact.releases, rtol=1e-9)
    (begin, end), *_ = own.chatters.tolist()
    assert begin < exact.chatters[0, 1] == pytest.approx(end)
    assert not ((begin < own.times) & (own.times < end)).any()
    measured = WorkPrecision({"own": own}, [SolveIVP("DOP853", (1e-3, 1e-9))])
    assert [(one.missed, one.invented) for one in measured] == [(0, 0), (0, 0)]


def test_a_motion_that_begins_in_a_chatter_invents_nothing() -> None:
    chain = ImpactChain(masses=2, frequency=0.408, restitution=0.3)
    record = chain.attractor().record
    weak = (record.relative_velocity > 1e-4) & (record.relative_velocity < 1e-3)
    first = int(np.flatnonzero(weak)[0])  # a bounce in a chatter, the same on any processor
    state = chain.state(record.position[first], record.velocity[first], record.phase[first])
    own = reference_impacts(chain, state, 20, 1e-3)
    assert own.chatters[0, 0] == 0.0
    (one,) = WorkPrecision({"own": own}, [SolveIVP("DOP853", (1e-9,))])
    assert (one.missed, one.invented) == (0, 0)


def test_a_mass_without_restitution_has_impacts_and_no_chatter() -> None:
    chain = ImpactChain(masses=2, frequency=0.87, restitution=0.0)
    own = reference_impacts(chain, None, 3, 1e-3)
    assert len(own.times) == 3
    assert len(own.chatters) == 0


def test_the_error_of_the_reference_is_a_band() -> None:
    measured = WorkPrecision({"clock": three(error=1e-9)}, [Shifted()])
    axes = measured.plot(Figure().subplots())
    (band,) = [part for part in axes.patches if part.get_label() == "error of the reference"]
    assert band.get_extents().transformed(axes.transData.inverted()).y1 == pytest.approx(1e-9)
    assert measured.error == 1e-9


@pytest.mark.parametrize(
    ("system", "changed", "message"),
    [
        ("a clock", {}, "system must be an ImpactOscillator; got 'a clock'"),
        (ImpactChain(masses=2, frequency=0.87), {"impacts": 0}, "impacts must be a positive"),
        (ImpactChain(masses=2, frequency=0.87), {"methods": []}, "methods must hold at least one"),
        (ImpactChain(masses=2, frequency=0.87), {"methods": ["RK45"]}, "methods must be Impact"),
        (
            ImpactChain(masses=1, frequency=0.87, amplitude=0.0, offset=-9.0),
            {},
            "start must lead to an impact",
        ),
        (
            ImpactChain(frequency=1.346),
            {"impacts": 2000},
            "impacts must be so few that dynkit's own error stays below the size of the motion; g",
        ),
    ],
)
def test_what_gives_no_reference_is_refused(
    system: Any, changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        WorkPrecision.of(system, **changed)


# --- the table and the figure ---------------------------------------------------------------------


def test_the_table_has_a_line_for_each_measurement() -> None:
    head, rule, coarse, fine, absent = (
        WorkPrecision({"clock": three()}, [Shifted(), Absent()]).table().splitlines()
    )
    columns = [cell.strip() for cell in head.split("|")[1:-1]]
    assert columns[:4] == ["job", "method", "tolerance", "error"]
    assert len({len(part) for part in (head, rule, fine)}) == 1
    assert re.match(r"\| clock \| shifted +\| 1e-03 +\| 5\.0e-04 +\|", fine)
    assert re.match(r"\| clock \| shifted +\| 4e-02 +\| - +\|", coarse)
    assert coarse.split("|")[-2].strip() == "lost"
    assert absent.split("|")[-2].strip() == "absent is not installed"


def test_the_plot_is_log_log_and_has_a_line_for_each_method_that_ran() -> None:
    measured = WorkPrecision({"clock": three()}, [Shifted(), Tired(), Absent()])
    axes = Figure().subplots()
    assert measured.plot(axes) is axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    (line,) = axes.lines
    assert line.get_label() == "shifted"
    heights = np.asarray(line.get_ydata())
    assert heights[1] == pytest.approx(1e-3 / PERIOD)
    assert heights[0] > 1.0  # lost: above all errors


def test_lines_are_told_apart_without_colours() -> None:
    names = [f"method {k}" for k in range(12)]

    def named(name: str) -> ImpactMethod:
        method = Shifted()
        method.name = name
        return method

    axes = WorkPrecision({"clock": three()}, [named(name) for name in names]).plot(
        Figure().subplots()
    )
    assert len({str(line.get_marker()) for line in axes.lines}) == len(names)


def test_the_figure_has_a_panel_for_each_job() -> None:
    jobs: dict[str, Any] = {
        "one": three(),
        "two": [three(), three()],
        "three": three(conditioning=8.0),
    }
    figure = WorkPrecision(jobs, [Shifted()]).figure()
    shown = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title() for axes in shown] == list(jobs)
    assert shown[1].get_ylabel() == "starts lost, of 2"


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"until": 0.0}, "until must be positive; got 0.0"),
        ({"times": [1.0, 5.0, 3.0]}, r"times must ascend; got \[1.0, 5.0, 3.0\]"),
        ({"times": [1.0, 3.0, 11.0]}, r"times must lie in \[0, until = 10.0\]; got 11.0"),
        ({"times": [1.0, 3.0, math.nan]}, r"times\[2\] must be a finite number; got nan"),
        ({"positions": [[1.0]]}, r"positions must have shape \(3, 1\); got shape \(1, 1\)"),
        ({"velocity": [0.0, 1.0]}, r"velocity must have shape \(1,\); got shape \(2,\)"),
        ({"coordinates": [1]}, r"coordinates must lie in \[0, 0\]; got 1"),
        (
            {"chatters": [[1.0, 2.0, 3.0]]},
            r"chatters must have shape \(n, 2\), for any n; got shape \(1, 3\)",
        ),
        ({"times": ["one", "3", "5"]}, "times must hold numbers; got \\['one', '3', '5'\\]"),
    ],
)
def test_bad_exact_impacts_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        three(**changed)


@pytest.mark.parametrize(
    ("jobs", "methods", "message"),
    [
        ({}, None, "jobs must hold at least one; got none"),
        ({"clock": []}, None, r"jobs\['clock'\] must be one or more ExactImpacts; got \[\]"),
        ({"clock": [1.0]}, None, r"jobs\['clock'\] must be one or more ExactImpacts; got \[1.0\]"),
        ({"clock": three()}, [], "methods must hold at least one; got none"),
        ({"clock": three()}, ["RK45"], r"methods must be ImpactMethods, as .* returns; got 'RK45'"),
    ],
)
def test_bad_jobs_and_methods_are_refused(jobs: Any, methods: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WorkPrecision(jobs, methods)


def test_an_unknown_method_or_job_is_refused() -> None:
    with pytest.raises(ValueError, match=r"methods must hold names among dynkit, .*; got 'RK54'"):
        impact_methods(["RK54"])
    with pytest.raises(ValueError, match="job must be one of: clock; got 'watch'"):
        WorkPrecision({"clock": three()}, [Shifted()]).plot(job="watch")


def test_found_impacts_of_other_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match=r"positions must have shape \(2, n\)"):
        FoundImpacts([1.0, 2.0], [[0.0]], [[0.0], [0.0]])


def test_a_chain_gives_its_own_period() -> None:
    assert isinstance(bounces().system, ImpactChain)
    assert bounces().period == pytest.approx(2.0 * math.pi / 0.87)
