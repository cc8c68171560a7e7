"""Branches of orbits that stick: their borders, found again by simulation; stores, drawings."""

from __future__ import annotations

from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from dynkit import continue_orbit
from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.results.branch import Branch
from dynkit.core.validation import Array
from dynkit.orbits.solving import solve
from dynkit.systems.impact.orbits.itineraries.several_modes.crossings import held_directions
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.simulation.state import TWO_PI
from tests.continuation.doublings import growth_of_born
from tests.impact_orbits.sticking_cases import differences, orbit_of, releases_of, returned

if TYPE_CHECKING:
    from collections.abc import Callable

BRANCHES: dict[str, tuple[ImpactChain, int, str, tuple[float, float]]] = {
    "P(inf,2)": (ImpactChain(frequency=0.408), 2, "frequency", (0.39, 0.42)),
    "P(inf,1)": (ImpactChain(frequency=0.202), 1, "frequency", (0.19, 0.21)),
    "unstable": (ImpactChain(frequency=0.408, restitution=0.0), 1, "frequency", (0.38, 0.43)),
    "grazing": (
        ImpactChain(masses=3, frequency=0.36, restitution=0.0),
        1,
        "frequency",
        (0.34, 0.365),
    ),
    "quasi-periodic": (
        ImpactChain(masses=3, frequency=0.408, restitution=0.3, damping=0.011),
        1,
        "damping",
        (0.008, 0.0115),
    ),
    "doubling": (
        ImpactChain(masses=3, contact=1, frequency=0.4, restitution=0.5, damping=0.06),
        1,
        "damping",
        (0.045, 0.06),
    ),
}
"""Oscillator, periods, parameter and bounds."""


@cache
def branch_of(name: str) -> Branch:
    system, periods, parameter, bounds = BRANCHES[name]
    orbit = system.periodic_orbit(sticking=True, periods=periods)
    return continue_orbit(orbit, parameter, bounds=bounds)


def near(found: Bifurcation, offset: float) -> ImpactOrbit:
    """The orbit of a branch at the value of a bifurcation and so much more."""
    p = np.array([found.value + offset])
    x, history = solve(found.problem, found.unknowns, p)
    orbit = found.problem.solution(x, p, history)
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.sticks
    return orbit


def crossing(measured: Callable[[float], float], step: float) -> float:
    """Zero of the parabola through what is measured at one, two and three steps."""
    offsets = step * np.arange(1.0, 4.0)
    parabola = np.polyfit(offsets, [measured(x) for x in offsets.tolist()], 2)
    roots = np.roots(parabola)
    return float(roots[np.argmin(abs(roots))].real)


# --- borders of chatter ---------------------------------------------------------------------------

# Found before by bisection of simulations in frequency.
BORDERS = {
    "P(inf,2)": (0.40255359351, 0.41326053861),
    "P(inf,1)": (0.19632412261, 0.20341060364),
}


@pytest.mark.parametrize("name", BORDERS)
def test_branches_of_the_paper_chain_end_where_chatter_completes_last(name: str) -> None:
    branch = branch_of(name)
    ends = sorted(b.value for b in branch.bifurcations if b.kind == "CB")
    assert ends == pytest.approx(BORDERS[name], abs=1e-10)
    assert ends[0] < branch.parameter.min() < branch.parameter.max() < ends[1]
    assert [ending.reason.name for ending in branch.endings] == ["BORDER", "BORDER"]


@pytest.mark.parametrize("name", BORDERS)
def test_no_chatter_completes_beyond_a_border(name: str) -> None:
    for border in branch_of(name).bifurcations:
        inside = 1.0 if border.value < branch_of(name).parameter.mean() else -1.0
        orbits = [near(border, inside * d) for d in (1e-7, 2e-7)]
        states = [orbit.states[0] for orbit in orbits]
        counts = []
        for k in (0.01, -0.01):
            state = states[0] + (k - 1.0) * (states[1] - states[0])
            p = {border.parameter: border.value + inside * k * 1e-7}
            system = orbits[0].system.replace(**p)
            record = system.simulate(impacts=400, start=system.impact_state(state))
            ends = record.sticking[:, 1]
            counts.append(int((abs(ends - orbits[0].period) < 0.05 * orbits[0].period).sum()))
        assert counts == [1, 0]


def landing_force(orbit: ImpactOrbit) -> float:
    """The force of the table where contact begins, without rebound."""
    releases, _, phase = releases_of(orbit)
    begin = orbit.contacts[0, 0]
    x, v = (part[0] for part in orbit.sample([begin]))
    places = np.concatenate([x[releases.others], v[releases.others]])
    return releases.force(places, phase + orbit.system.frequency * begin)


def force_near(border: Bifurcation, offset: float) -> float:
    return landing_force(near(border, offset))


def test_without_rebound_the_force_where_contact_begins_is_zero_at_the_border() -> None:
    branch = branch_of("unstable")
    borders = [b for b in branch.bifurcations if b.kind == "CB"]
    assert len(borders) == 2
    for border in borders:
        inside = 1.0 if border.value < branch.parameter.mean() else -1.0
        off = crossing(partial(force_near, border), inside * 2e-5)
        assert abs(off) < 1e-9


def test_an_unstable_branch_is_followed_to_both_ends() -> None:
    branch = branch_of("unstable")
    assert not branch.stable.any()
    assert branch.admissible.all()
    assert [ending.reason.name for ending in branch.endings] == ["BORDER", "BORDER"]


def scaled_velocities(orbit: ImpactOrbit) -> Array:
    """u j / a^2 after the impacts, where the gap would be u s - a s^2 / 2 + j s^3 / 6."""
    system, c = orbit.system, orbit.system.contact
    times, phases, speeds = orbit.bounces.T
    x, v = orbit.sample(times)
    a, w = system.amplitude, system.frequency
    v[:, c] = a * w * np.cos(phases) + speeds
    inverse = np.linalg.inv(system.mass)
    push = -(v @ system.damping_matrix + x @ system.stiffness) @ inverse
    jerk = -(push @ system.damping_matrix + v @ system.stiffness) @ inverse
    pressing = -(push[:, c] + a * w**2 * np.sin(phases))
    rising = jerk[:, c] + a * w**3 * np.cos(phases)
    return np.asarray(speeds * rising / pressing**2)


def after_a_bounce(w: float, restitution: float) -> float:
    """The scaled velocity after the next impact."""
    s = 3.0 * (0.5 - np.sqrt(0.25 - 2.0 * w / 3.0))
    return float(restitution * (s - s * s / 2.0 - w) / (1.0 - s) ** 2)


@pytest.mark.parametrize("name", BORDERS)
def test_near_a_border_bounces_stay_ever_longer_near_those_that_never_end(name: str) -> None:
    branch = branch_of(name)
    r = BRANCHES[name][0].restitution
    critical = brentq(lambda w: after_a_bounce(w, r) - w, 1e-3, 0.3333)
    for border in branch.bifurcations:
        inside = 1.0 if border.value < branch.parameter.mean() else -1.0
        near_it = []
        for distance in (1e-5, 1e-7, 1e-9):
            w = scaled_velocities(near(border, inside * distance))
            near_it.append(int((abs(w / critical - 1.0) < 0.3).sum()))
        assert near_it[0] < near_it[1] < near_it[2]


# --- grazing --------------------------------------------------------------------------------------


def smallest_gap(orbit: ImpactOrbit) -> float:
    """Of the minima of the gap in simulated flight, by samples and a search."""
    system = orbit.system
    record = system.simulate(impacts=40, start=system.impact_state(orbit.states[0]))
    phase = float(orbit.phases[0])

    def gap(times: Array) -> Array:
        tip = record.sample(times)[0][:, system.contact]
        table = system.amplitude * np.sin(phase + system.frequency * times) + system.offset
        return np.asarray(tip - table)

    events = np.concatenate([[0.0], record.time[record.time < orbit.contacts[0, 0] + 1e-9]])
    found = []
    for begin, end in pairwise(events.tolist()):
        times = np.linspace(begin, end, 2001)
        values = gap(times)
        inner = np.flatnonzero((values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:])) + 1
        for k in inner:
            best = minimize_scalar(
                lambda t: float(gap(np.array([t]))[0]),
                bounds=(times[k - 1], times[k + 1]),
                method="bounded",
                options={"xatol": 1e-9},
            )
            found.append(float(best.fun))
    return min(found)


def test_a_flight_touches_the_table_at_grazing() -> None:
    (touch,) = [b for b in branch_of("grazing").bifurcations if b.kind == "GR"]
    sides = [near(touch, d).admissible for d in (-1e-6, 1e-6)]
    assert sorted(sides) == [False, True]
    inside = 1.0 if sides[1] else -1.0
    off = crossing(lambda d: smallest_gap(near(touch, d)), inside * 1e-5)
    assert abs(off) < 1e-9
    assert touch.error < 1e-10


def test_a_touch_leads_to_an_orbit_with_an_impact_more() -> None:
    (touch,) = [b for b in branch_of("grazing").bifurcations if b.kind == "GR"]
    others = touch.switch()
    assert others
    for other in others:
        assert isinstance(other, ImpactOrbit)
        assert other.sticks
        assert other.label == "P(inf,1)"
        assert other.residual < 1e-13
        assert len(other.impulses) == len(touch.orbit.impulses) + 1


def test_errors_of_borders_cover_what_another_continuation_finds() -> None:
    """From another orbit, in other steps."""
    system, periods, parameter, _ = BRANCHES["P(inf,1)"]
    orbit = system.replace(frequency=0.199).periodic_orbit(sticking=True, periods=periods)
    other = continue_orbit(orbit, parameter, bounds=(0.185, 0.215), largest_step=0.03)
    borders = [branch_of("P(inf,1)").bifurcations, other.bifurcations]
    for here, there in zip(*borders, strict=True):
        assert here.kind == there.kind == "CB"
        assert abs(here.value - there.value) <= here.error + there.error


# --- folds ----------------------------------------------------------------------------------------


@cache
def folded() -> Branch:
    """What leaves where an orbit of three masses grazes: it folds soon."""
    system = ImpactChain(masses=3, frequency=0.36, restitution=0.3)
    branch = continue_orbit(
        system.periodic_orbit(sticking=True), "frequency", bounds=(0.345, 0.365)
    )
    (touched,) = [found for found in branch.bifurcations if found.kind == "GR"]
    (orbit,) = touched.switch()
    return continue_orbit(orbit, "frequency", bounds=(0.345, 0.355))


def value_at(found: Bifurcation, unknown: int, offset: float) -> float:
    """The parameter where one of the unknowns is that of a fold and so much more."""
    problem, x, p = found.problem, found.unknowns.copy(), np.array([found.value])
    x[unknown] += offset
    others = np.delete(np.arange(len(x)), unknown)
    for _ in range(6):
        by_unknowns = np.asarray(problem.linearization(x, p))[:, others]
        derivative = np.column_stack([by_unknowns, problem.parameter_derivative(x, p)])
        step = np.linalg.solve(derivative, -problem.residual(x, p))
        x[others] += step[:-1]
        p += step[-1:]
        if abs(problem.residual(x, p)).max() < 1e-14:
            break  # further steps are rounding
    assert abs(problem.residual(x, p)).max() < 1e-14
    return float(p[0])


def test_a_fold_is_the_largest_value_along_its_branch() -> None:
    (fold,) = [found for found in folded().bifurcations if found.kind == "SN"]
    unknown = int(np.argmax(abs(fold.direction)))
    offsets = 1e-4 * np.arange(-3.0, 4.0)
    values = [value_at(fold, unknown, offset) - fold.value for offset in offsets.tolist()]
    square, slope, rest = np.polyfit(offsets, values, 4)[2:]
    assert square < 0.0
    assert abs(rest - slope**2 / (4.0 * square)) < 1e-9
    assert abs(rest - slope**2 / (4.0 * square)) < 10.0 * fold.error + 1e-12


def test_orbits_on_both_sides_of_a_fold_are_different_motions() -> None:
    branch = folded()
    (fold,) = [found for found in branch.bifurcations if found.kind == "SN"]
    places = [int(np.floor(fold.place)), int(np.ceil(fold.place))]
    orbits = [branch.orbit(place) for place in places]
    assert all(orbit.admissible for orbit in orbits)
    apart = abs(orbits[0].unknowns - orbits[1].unknowns).max()
    assert apart > 1e3 * max(orbit.error for orbit in orbits)


# --- Neimark-Sacker -------------------------------------------------------------------------------


def largest_modulus(orbit: ImpactOrbit) -> float:
    """Of the multipliers by differences of simulations, less one."""
    _, places, _ = releases_of(orbit)
    steps = np.full(len(places), 2e-5)
    matrix = differences(lambda z: returned(orbit, z), places, steps)
    return float(abs(np.linalg.eigvals(matrix)).max() - 1.0)


def test_multipliers_of_simulations_cross_the_unit_circle_at_neimark_sacker() -> None:
    (border,) = [b for b in branch_of("quasi-periodic").bifurcations if b.kind == "NS"]
    off = crossing(lambda d: largest_modulus(near(border, d)), 2e-6)
    assert abs(off) < 1e-9
    assert border.multiplier is not None
    assert abs(border.multiplier) == pytest.approx(1.0, abs=1e-12)
    assert abs(border.multiplier.imag) > 0.01


def test_orbits_are_stable_on_one_side_of_neimark_sacker() -> None:
    branch = branch_of("quasi-periodic")
    (border,) = [b for b in branch.bifurcations if b.kind == "NS"]
    assert (branch.stable == (branch.parameter > border.value)).all()


# --- period doubling ------------------------------------------------------------------------------


def lowest_multiplier(orbit: ImpactOrbit) -> float:
    """By differences of simulations, plus one."""
    _, places, _ = releases_of(orbit)
    matrix = differences(lambda z: returned(orbit, z), places, np.full(len(places), 2e-5))
    return float(np.linalg.eigvals(matrix).real.min() + 1.0)


def doubling() -> Bifurcation:
    (found,) = [b for b in branch_of("doubling").bifurcations if b.kind == "PD"]
    return found


@cache
def doubled() -> ImpactOrbit:
    """What branches off there."""
    (found,) = doubling().switch()
    assert isinstance(found, ImpactOrbit)
    assert found.sticks
    return found


def test_a_multiplier_of_simulations_is_minus_one_where_the_period_doubles() -> None:
    assert abs(crossing(lambda d: lowest_multiplier(near(doubling(), d)), 2e-6)) < 1e-9
    assert (
        lowest_multiplier(near(doubling(), -1e-5)) < 0.0 < lowest_multiplier(near(doubling(), 1e-5))
    )


def test_where_the_period_doubles_there_is_an_orbit_of_twice_the_period() -> None:
    assert doubled().label == "P(inf,2)"
    _, places, _ = releases_of(doubled())
    assert abs(returned(doubled(), places) - places).max() < 1e-10
    # Its two releases are not the same.
    assert abs(np.diff(doubled().states[:, :-2], axis=0)).max() > 1e-5


def test_a_doubled_orbit_that_sticks_is_near_where_its_branch_begins() -> None:
    assert abs(doubled().system.value_of("damping") - doubling().value) < 1e-3
    # where a branch of doubled orbits begins, a multiplier of theirs is one
    assert abs(doubled().multipliers - 1.0).min() < 0.25


def test_all_points_of_a_doubled_branch_that_sticks_have_twice_the_period() -> None:
    _, _, name, bounds = BRANCHES["doubling"]
    branch = continue_orbit(doubled(), name, bounds=bounds, points=20)
    assert branch.label == "P(inf,2)"
    assert len(branch) >= 10
    meetings = [b.value for b in branch.bifurcations if b.kind == "BP"]
    assert any(abs(value - doubling().value) < 1e-9 for value in meetings)
    apart = abs(branch.parameter - doubling().value) > 1e-9
    for x in branch.unknowns[apart]:
        orbit = branch.problem.solution(x, branch.parameter[:1])
        assert isinstance(orbit, ImpactOrbit)
        assert orbit.sticks
        assert branch.problem.shortest(x)[0] is branch.problem
        phases = orbit.phases.reshape(2, -1)
        # the second half is not the first one a period of the table later
        assert abs(phases[1] - phases[0] - 2.0 * np.pi).max() > 1e-7


@pytest.mark.parametrize("name", BRANCHES)
def test_values_of_borders_have_errors_near_rounding(name: str) -> None:
    found = branch_of(name).bifurcations
    assert len(found) >= 1
    assert all(0.0 < b.error < 1e-10 for b in found)


# --- branches as objects --------------------------------------------------------------------------


def test_a_branch_is_drawn() -> None:
    ax = branch_of("P(inf,2)").plot()
    try:
        assert ax.get_xlabel() == r"frequency $\omega$"
        assert len(ax.get_lines()) >= 1
        ax.figure.canvas.draw()
    finally:
        plt.close("all")


def test_a_loaded_branch_has_the_same_bits(tmp_path: Path) -> None:
    branch = branch_of("P(inf,1)")
    path = tmp_path / "branch.h5"
    branch.save(path)
    loaded = Branch.load(path, branch.orbit(3))
    for name in ("parameter", "unknowns", "multipliers", "stable", "admissible", "error"):
        assert getattr(loaded, name).tobytes() == getattr(branch, name).tobytes()
    assert repr(loaded) == repr(branch)
    assert (loaded.label, loaded.endings) == (branch.label, branch.endings)
    assert loaded.orbit(5).states.tobytes() == branch.orbit(5).states.tobytes()
    for a, b in zip(loaded.bifurcations, branch.bifurcations, strict=True):
        assert (a.kind, a.value, a.error, a.touching) == (b.kind, b.value, b.error, b.touching)


@pytest.mark.parametrize("name", ["chain of 1", "single", "chain of 10, dead"])
def test_a_branch_of_several_impacts_reaches_no_rebound(name: str) -> None:
    orbit = orbit_of(name)
    assert len(orbit.impulses) > 1
    branch = continue_orbit(orbit, "restitution", bounds=(0.0, 0.5))
    assert (branch.parameter[0], branch.parameter[-1]) == (0.0, 0.5)
    assert branch.admissible.all()
    assert not branch.bifurcations


def test_points_of_a_branch_are_orbits_to_rounding() -> None:
    branch = branch_of("P(inf,1)")
    assert (branch.residuals < 1e-12).all()
    assert branch.admissible.all()
    for place in (0, len(branch) // 2, -1):
        orbit = branch.orbit(place)
        assert isinstance(orbit, ImpactOrbit)
        assert orbit.sticks
        assert orbit.system.frequency == branch.parameter[place]
        _, places, _ = releases_of(orbit)
        assert abs(returned(orbit, places) - places).max() < 1e-10


# --- criticality ----------------------------------------------------------------------------------


def test_orbits_of_twice_the_period_are_born_as_said() -> None:
    found = doubling().criticality
    assert found is not None
    offset = doubled().system.parameters["damping"] - doubling().value
    assert np.sign(offset) == found.side
    assert (doubled().stable, True) == (found.stable, found.supercritical)
    assert found.error < 1e-6 * found.coefficient
    assert growth_of_born(doubling(), doubled()) == pytest.approx(1.0, abs=0.06)


def test_an_invariant_curve_is_as_large_as_the_coefficient_says() -> None:
    """|z|^2 = -(growth of the multiplier) / Re d, to first order in the growth.

    From simulated motion in contact, a little before each release.
    """
    (border,) = [b for b in branch_of("quasi-periodic").bifurcations if b.kind == "NS"]
    found = border.criticality
    assert found is not None
    assert (found.supercritical, found.stable, found.side) == (True, True, -1)
    assert found.error < 1e-6 * abs(found.coefficient)
    orbit = near(border, -2e-5)
    problem = orbit.problem()
    jacobian, at = problem.returns(orbit.unknowns, np.empty(0))
    solution = problem.at(orbit.unknowns, np.empty(0))
    values, vectors = np.linalg.eig(jacobian(at))
    k = int(np.argmax(abs(values)))
    left, growth = np.linalg.inv(vectors)[k], float(np.log(abs(values[k])))
    expected = -growth / found.coefficient
    releases, places, phase = releases_of(orbit)
    n, units = orbit.system.degrees_of_freedom, np.repeat(problem.sizes, len(places) // 2 + 1)
    basis, others = held_directions(solution, 0), np.append(releases.others, n + releases.others)
    away = (units * (basis @ vectors[:, k].real))[others]
    moved = places + 2.0 * np.sqrt(1.2 * expected) * away
    system, start = orbit.system, releases.phase(moved, phase)
    period, before = TWO_PI / system.frequency, 0.03
    record = system.simulate(
        impacts=200_000, start=system.impact_state(releases.section(moved, start))
    )
    first = (phase - before - start) / system.frequency + period
    x, v = record.sample(np.arange(first, record.time[-1] - period, period))
    # from there on in contact, to the phase of the release of the orbit
    turn = np.array([np.sin(phase - before), np.cos(phase - before), 1.0])
    whole = np.concatenate([x, v, np.tile(turn, (len(x), 1))], axis=1)[-4000:]
    held = whole @ expm(solution.flows[-1] * before / system.frequency).T
    off = (held[:, : 2 * n] - solution.before[0, : 2 * n]) / units
    size = np.mean(abs(off @ basis @ left) ** 2)
    assert size == pytest.approx(expected, rel=0.01)
