"""What is watched along branches: impulses, smallest gaps, loss of contact after impacts."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from dynkit import continue_orbit
from dynkit.core.validation import Array
from dynkit.orbits.events import Condition
from dynkit.orbits.solving import solve
from dynkit.systems.impact.orbits.flights import smallest_minimum
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from tests.impact_orbits.gaps import dip, gap, lowest, stops
from tests.impact_orbits.structures import SYSTEMS
from tests.impact_orbits.test_many_impacts import FREQUENCIES, SEARCHED, searched, settled
from tests.reference.random_cases import STARTS, random_case

NONE = np.empty(0)


@cache
def orbits_of(name: str) -> list[ImpactOrbit]:
    found = [o for m in (1, 2, 3, 5) for o in SYSTEMS[name].periodic_orbits(periods=m)]
    return found + (searched(name) if name in SEARCHED else [])


# --- gaps -----------------------------------------------------------------------------------------


def check_gaps(orbit: ImpactOrbit) -> None:
    n, sides = orbit.impacts, stops(orbit)
    events = orbit.problem().events(orbit.unknowns, NONE)
    for i in range(n):
        for side in range(sides):
            found, wanted = events[n + i * sides + side].value, dip(orbit, i, side).value
            # Without rebound a flight may begin into the stop: this is watched by itself.
            pressed = events[-n + i].kind == "CB" and events[-n + i].value < 0.0
            assert math.isnan(found) == pressed
            assert pressed or found == wanted or abs(found - wanted) <= 1e-9


@pytest.mark.parametrize("name", SYSTEMS)
def test_smallest_gaps_are_those_of_dense_samples(name: str) -> None:
    for orbit in orbits_of(name):
        check_gaps(orbit)


@pytest.mark.parametrize("height", [1e-2, 1e-5, 1e-7, -1e-7, -1e-5])
@pytest.mark.parametrize("place", [0.1, 0.4, 0.7, 0.95, 1.3])
@pytest.mark.parametrize("before", [False, True], ids=["after an impact", "before one"])
@pytest.mark.plain
def test_a_dip_beside_a_weak_impact_is_seen(height: float, place: float, before: bool) -> None:
    times = np.linspace(0.0, 1.0, 25)
    h = times[1]
    t = Polynomial([0.0, 1.0])
    gap = t * ((t - place * h) ** 2 + height * h * h) * (2.0 - 0.3 * t)
    gap = gap(1.0 - t) if before else gap

    def curve(at: Array, orders: int) -> Array:
        return np.array([gap.deriv(k)(at) for k in range(orders)])

    flat = [x.real for x in gap.deriv().roots() if abs(x.imag) < 1e-12 and 0.0 < x.real < 1.0]
    minima = [float(gap(x)) for x in flat if gap.deriv(2)(x) > 0.0]
    lowest, at = smallest_minimum(curve, times, curve(times, 3))
    if not minima:
        assert (lowest, math.isnan(at)) == (math.inf, True)
        return
    # Newton's method ends where the next step would be the square of 1e-7
    assert lowest == pytest.approx(min(minima), rel=1e-9, abs=1e-14)
    assert abs(float(gap.deriv()(at))) < 1e-6 * h**2


def test_a_grazing_beside_a_weak_impact_is_found() -> None:
    """Its dip is no smallest value between two others: the gap is zero at the impact."""
    system = random_case(STARTS * 51_663).system().replace(offset=-0.352)
    orbit = min(system.periodic_orbits(periods=2), key=lambda orbit: orbit.impulses[0])
    branch = continue_orbit(orbit, "offset", bounds=(-0.356, -0.35))
    (grazing,) = branch.bifurcations
    assert grazing.kind == "GR"
    assert (branch.admissible == (branch.parameter < grazing.value)).all()


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_smallest_gaps_of_motions_are_those_of_dense_samples(frequency: float) -> None:
    check_gaps(settled(frequency))


@pytest.mark.parametrize("name", SYSTEMS)
def test_orbits_are_admissible_just_where_dense_samples_say_so(name: str) -> None:
    for orbit in orbits_of(name):
        low = lowest(orbit)
        # None of these grazes.
        assert low == 0.0 or low < -1e-6
        assert orbit.admissible == (low == 0.0)


def test_the_samples_see_orbits_of_both_kinds() -> None:
    found = [orbit.admissible for name in SYSTEMS for orbit in orbits_of(name)]
    assert 20 < sum(found) < len(found) - 20


@pytest.mark.parametrize(("periods", "admissible"), [(1, True), (2, False), (3, True)])
@pytest.mark.plain
def test_the_paper_chain_at_0_87_skips_no_impact(periods: int, admissible: bool) -> None:
    orbit = ImpactChain(frequency=0.87).periodic_orbit(periods=periods)
    assert orbit.admissible == admissible
    record = orbit.system.simulate(impacts=1, start=orbit.system.impact_state(orbit.states[0]))
    assert (abs(record.time[0] - orbit.period) < 1e-9 * orbit.period) == admissible


def test_an_impulse_that_pulls_is_not_admissible() -> None:
    orbit = SYSTEMS["single, stop"].periodic_orbit(periods=1)
    pulling = orbit.unknowns * [1.0, -1.0]
    assert not orbit.problem().admissible(pulling, NONE)


# --- what is watched ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_events_are_impulses_gaps_and_the_acceleration_without_rebound(name: str) -> None:
    for orbit in orbits_of(name):
        n, sides = orbit.impacts, stops(orbit)
        events = orbit.problem().events(orbit.unknowns, NONE)
        kinds = ["GR"] * (n + n * sides) + ["CB"] * n
        parts = [*range(n), *(i for i in range(n) for _ in range(sides)), *range(n)]
        assert [e.kind for e in events] == kinds
        assert [e.part for e in events] == parts
        assert [e.value for e in events[:n]] == orbit.impulses.tolist()
        dead = orbit.system.restitution == 0.0
        assert [math.isinf(e.value) for e in events[-n:]] == [not dead] * n


def test_without_rebound_the_gap_begins_with_the_acceleration() -> None:
    for orbit in orbits_of("chain, dead"):
        if orbit.impacts == 1:
            (event,) = [e for e in orbit.problem().events(orbit.unknowns, NONE) if e.kind == "CB"]
            # gap = a t^2 / 2 + b t^3 / 6 + O(t^4)
            t = 1e-2
            at = gap(orbit, 0, np.array([t, 0.5 * t])) / np.array([t, 0.5 * t]) ** 2
            assert 2.0 * (2.0 * at[1] - at[0]) == pytest.approx(event.value, abs=1e-4)


# --- borders --------------------------------------------------------------------------------------


def on_border(
    problem: ItineraryEquations, condition: Condition, x: Array, own: Array
) -> tuple[Array, Array, Array]:
    """Unknowns, own ones and parameter where the condition holds: Newton, by differences."""
    m, e = problem.size, condition.unknowns
    scale = np.concatenate([problem.scale(x), np.ones(e), problem.values])

    def equations(y: Array) -> Array:
        parts = y[:m], y[m : m + e], y[m + e :]
        return np.concatenate([problem.residual(parts[0], parts[2]), condition.residual(*parts)])

    y = np.concatenate([x, own, problem.values])
    for _ in range(30):
        h = 1e-6 * scale
        columns = [(equations(y + d) - equations(y - d)) / 2.0 for d in np.diag(h)]
        step = np.linalg.solve(np.transpose(columns) / h, equations(y))
        y = y - step
        if (abs(step) <= 1e-13 * scale).all():
            break
    assert abs(equations(y)).max() < 1e-13
    return y[:m], y[m : m + e], y[m + e :]


def steady_frequencies(oscillator: SingleImpactOscillator) -> list[float]:
    """Where force / |1 - w^2 + 2 i zeta w| is the distance of the stop: quadratic in w^2."""
    half = 1.0 - 2.0 * oscillator.damping_ratio**2
    root = math.sqrt(half * half - 1.0 + (oscillator.force / oscillator.stop) ** 2)
    return [math.sqrt(x) for x in (half - root, half + root) if x > 0.0]


@pytest.mark.parametrize("restitution", [0.0, 0.2, 0.8, 1.0])
@pytest.mark.parametrize("stop", [0.3, 1.5, 3.0])
def test_an_impulse_vanishes_where_the_steady_response_reaches_the_stop(
    stop: float, restitution: float
) -> None:
    oscillator = SingleImpactOscillator(
        frequency=1.0, stop=stop, restitution=restitution, damping_ratio=0.1
    )
    for wanted in steady_frequencies(oscillator):
        # The orbits of small impulses are on one side, which depends on restitution and stop.
        near = [oscillator.replace(frequency=wanted * (1.0 + d)) for d in (-1e-4, 1e-4)]
        orbits = [orbit for system in near for orbit in system.periodic_orbits(periods=1)]
        orbit = min(orbits, key=lambda o: float(o.impulses[0]))
        problem = orbit.problem("frequency")
        condition, own = problem.condition(0, orbit.unknowns, problem.values)
        x, _, p = on_border(problem, condition, orbit.unknowns, own)
        assert p[0] == pytest.approx(wanted, rel=1e-12)
        assert abs(x[1]) < 1e-13


def touched(system: ImpactOscillator, periods: int, low: float, high: float) -> tuple[Any, ...]:
    """Problem, unknowns, own ones, parameter and event where P(1,m) grazes between frequencies."""
    for _ in range(12):
        middle = 0.5 * (low + high)
        inside = system.replace(frequency=middle).periodic_orbit(periods=periods).admissible
        low, high = (middle, high) if inside else (low, middle)
    orbit = system.replace(frequency=low).periodic_orbit(periods=periods)
    problem = orbit.problem("frequency")
    events = problem.events(orbit.unknowns, problem.values)
    which = 1 + int(np.argmin([e.value for e in events[1:]]))
    condition, own = problem.condition(which, orbit.unknowns, problem.values)
    return problem, *on_border(problem, condition, orbit.unknowns, own), which


def side_of(event: int, orbit: ImpactOrbit) -> int:
    """Of which stop an event of an orbit of one impact watches the gap."""
    return (event - 1) % stops(orbit)


GRAZING = {
    "P(1,3), up": (ImpactChain(frequency=0.87), 3, 0.87, 1.1),
    "P(1,3), down": (ImpactChain(frequency=0.87), 3, 0.87, 0.7),
    "P(1,4), up": (ImpactChain(frequency=1.2), 4, 1.2, 1.35),
    "below": (SYSTEMS["chain, below"], 1, 1.3, 0.5),
    "contact inside": (SYSTEMS["chain, contact inside"], 2, 2.2, 2.5),
    "play": (SYSTEMS["chain, play"], 1, 0.8, 1.1),
    "single": (SYSTEMS["single"], 2, 4.0, 2.5),
}
"""System, periods, an admissible frequency and one that is not."""


@pytest.mark.parametrize("name", GRAZING)
def test_where_an_orbit_grazes_gap_and_rate_are_zero_at_the_own_phase(name: str) -> None:
    problem, x, own, p, which = touched(*GRAZING[name])
    orbit = problem.orbit(x, p, (0.0,))
    time = float(own[0] - x[0]) / p[0]
    assert 0.0 < time < orbit.period
    h = 1e-4
    before, at, after = gap(orbit, side_of(which, orbit), time + np.array([-h, 0.0, h]))
    assert abs(at) < 1e-13
    assert (after - before) / (2.0 * h) == pytest.approx(0.0, abs=1e-7)
    assert before > 0.0
    assert after > 0.0


@pytest.mark.parametrize("name", GRAZING)
def test_the_place_of_a_touch_is_told(name: str) -> None:
    problem, x, own, p, which = touched(*GRAZING[name])
    place = problem.touching(which, x, own, p)
    orbit = problem.orbit(x, p, (0.0,))
    side = side_of(which, orbit)
    assert abs(gap(orbit, side, np.array([place["time"]]))[0]) < 1e-13
    assert place["phase"] == pytest.approx((x[0] + p[0] * place["time"]) % (2.0 * math.pi))
    assert place["side"] == side


@pytest.mark.parametrize("name", GRAZING)
def test_orbits_are_admissible_on_one_side_of_a_touch(name: str) -> None:
    system, periods, low, high = GRAZING[name]
    *_, p, _ = touched(system, periods, low, high)
    step = math.copysign(1e-6, high - low)
    there = [
        system.replace(frequency=float(p[0] + k * step)).periodic_orbit(periods=periods).admissible
        for k in (-1, 1)
    ]
    assert there == [True, False]


@pytest.mark.parametrize("name", GRAZING)
def test_a_touch_is_an_impulse_of_zero_of_one_impact_more(name: str) -> None:
    problem, x, _, p, which = touched(*GRAZING[name])
    ((other, more, values),) = problem.neighbours(which, x, p)
    assert np.array_equal(values, p)
    assert (np.diff(more[:2]) > 0.0).all()
    assert sorted(more[2:]) == [0.0, pytest.approx(x[1])]
    assert abs(other.residual(more, p)).max() < 1e-13


@pytest.mark.parametrize("name", GRAZING)
def test_an_impact_without_impulse_can_be_left_out(name: str) -> None:
    problem, x, _, p, which = touched(*GRAZING[name])
    ((other, more, _),) = problem.neighbours(which, x, p)
    vanished = int(np.flatnonzero(more[2:] == 0.0)[0])
    assert other.events(more, p)[vanished].value == 0.0
    ((back, less, _),) = other.neighbours(vanished, more, p)
    turns = (less[0] - x[0]) / (2.0 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-15)
    assert less[1] == x[1]
    assert abs(back.residual(less, p)).max() < 1e-13
    assert back.neighbours(0, less, p) == []


def test_an_orbit_is_followed_through_a_touch() -> None:
    problem, x, _, p, _ = touched(*GRAZING["P(1,3), up"])
    for k in range(-3, 4):
        found, history = solve(problem, x, p + 1e-4 * k)
        assert history[-1] < 1e-14
        assert problem.admissible(found, p + 1e-4 * k) == (k < 0) or k == 0


def test_no_touch_is_seen_where_flights_without_rebound_begin_into_the_stop() -> None:
    chain = ImpactChain(masses=3, frequency=1.7, restitution=0.0)
    for frequency in np.linspace(1.7, 1.78, 9).tolist():
        orbit = chain.replace(frequency=frequency).periodic_orbit(periods=2)
        impulse, smallest, acceleration = (
            e.value for e in orbit.problem().events(orbit.unknowns, NONE)
        )
        assert impulse > 0.0 > acceleration
        assert math.isnan(smallest)
        assert dip(orbit, 0, 0).value < 0.0
        assert not orbit.admissible


@pytest.mark.parametrize("masses", [1, 2])
def test_a_branch_begins_and_ends_without_rebound(masses: int) -> None:
    system = ImpactChain(masses=masses, frequency=2.2, restitution=0.0, damping=0.1)
    (orbit,) = system.periodic_orbits()
    up = continue_orbit(orbit, "restitution", bounds=(0.0, 0.5))
    assert (up.parameter[0], up.parameter[-1]) == (0.0, 0.5)
    down = continue_orbit(up.orbit(len(up.parameter) - 1), "restitution", bounds=(0.0, 0.5))
    assert down.parameter[0] == 0.0
    assert down.orbit(0).unknowns == pytest.approx(orbit.unknowns, rel=1e-12)
    assert not up.bifurcations + down.bifurcations
