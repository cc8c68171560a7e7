"""Orbits P(n,m) of a ball on a vibrating table, through grazing, against closed forms."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

from dynkit import Branch, continue_orbit
from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.termination import Reason
from dynkit.core.validation import Array
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems import BouncingBall
from tests.orbits.test_impact_maps import bounce, strengths

GRAZING = 2.504299953651670338229607748670140185784
"""Amplitude where the unstable P(1,1) grazes at restitution 1/2 (mpmath, 40 digits)."""


def unstable(amplitude: float) -> PeriodicOrbit:
    born, _ = strengths(0.5, 1)
    ball = BouncingBall(amplitude=amplitude, frequency=1.0, restitution=0.5)
    return ball.periodic_orbit(phases=[-math.acos(born / amplitude)])


def only(branch: Branch, kind: str) -> Bifurcation:
    (found,) = (b for b in branch.bifurcations if b.kind == kind)
    return found


def exact_grazing(restitution: float, guess: tuple[float, float]) -> float:
    """Strength where P(1,1) with sin(phase) < 0 grazes: gap and rate are zero at one phase."""
    with mpmath.workdps(30):
        r = mpmath.mpf(restitution)
        born, u = mpmath.pi * (1 - r) / (1 + r), 2 * mpmath.pi * r / (1 + r)

        def touches(since: mpmath.mpf, strength: mpmath.mpf) -> list[mpmath.mpf]:
            phase = -mpmath.acos(born / strength)
            swing = mpmath.sin(phase + since) - mpmath.sin(phase)
            gap = (u + born) * since - since**2 / 2 - strength * swing
            return [gap, u + born - since - strength * mpmath.cos(phase + since)]

        return float(mpmath.findroot(touches, guess)[1])


@pytest.mark.parametrize(("start", "bounds"), [(2.2, (2.0, 3.0)), (2.4, (2.3, 2.6))])
@pytest.mark.parametrize("inadmissible", [True, False])
def test_an_unstable_bounce_grazes(
    start: float, bounds: tuple[float, float], inadmissible: bool
) -> None:
    orbit = unstable(start)
    branch = continue_orbit(orbit, "amplitude", bounds=bounds, inadmissible=inadmissible)
    grazing = only(branch, "GR")
    assert abs(grazing.value - GRAZING) <= grazing.error
    assert grazing.error < 1e-11
    assert grazing.admissible
    assert (branch.admissible == (branch.parameter < GRAZING)).all()
    reasons = {ending.reason for ending in branch.endings}
    expected = {Reason.BOUND} if inadmissible else {Reason.BOUND, Reason.INADMISSIBLE}
    assert reasons == expected


def test_a_branch_from_beyond_grazing_comes_back_to_it() -> None:
    branch = continue_orbit(unstable(2.4), "amplitude", bounds=(2.3, 2.8))
    last = branch.orbit(int(np.argmax(branch.parameter)))
    assert not last.admissible
    assert repr(last).startswith("<P(1,1) of BouncingBall(frequency=1, restitution=0.5")
    assert "inadmissible" in repr(last)
    back = continue_orbit(last, "amplitude", bounds=(2.3, 2.8))
    assert abs(only(back, "GR").value - GRAZING) <= only(back, "GR").error
    assert back.admissible.any()


def test_two_bounces_a_period_are_born_where_one_grazes() -> None:
    grazing = only(continue_orbit(unstable(2.4), "amplitude", bounds=(2.3, 2.8)), "GR")
    (orbit,) = grazing.switch()
    assert orbit.label == "P(2,1)"
    branch = continue_orbit(orbit, "amplitude", bounds=(2.3, 2.8))
    other = only(branch, "GR")
    assert abs(other.value - GRAZING) <= other.error
    assert branch.admissible.any()
    assert not branch.admissible.all()
    for place in np.flatnonzero(branch.admissible)[:3]:
        ball = branch.orbit(int(place)).system
        for state, following in zip(*pairs(branch.orbit(int(place)).states), strict=True):
            assert abs(ball.difference(ball(state), following)).max() < 1e-8
    (single,) = other.switch()
    assert single.label == "P(1,1)"


def pairs(states: Array) -> tuple[Array, Array]:
    return states, np.roll(states, -1, axis=0)


@pytest.mark.parametrize("periods", [1, 2, 3])
@pytest.mark.parametrize("sign", [1, -1])
def test_labels_count_the_periods_of_the_table(periods: int, sign: int) -> None:
    born, doubled = strengths(0.5, periods)
    ball, state = bounce(0.5 * (born + doubled), 0.5, periods, sign)
    orbit = ball.periodic_orbit(periods=periods, phases=[state[1]])
    assert orbit.label == f"P(1,{periods})"
    bounds = (0.98 * ball.amplitude, 1.02 * ball.amplitude)
    branch = continue_orbit(orbit, "amplitude", bounds=bounds)
    assert branch.label == orbit.label
    assert pickle.loads(pickle.dumps(orbit)).label == orbit.label


def test_a_stable_bounce_doubles_its_period_to_two_bounces_in_two_periods(tmp_path: Path) -> None:
    _, doubled = strengths(0.5, 1)
    ball, state = bounce(1.4, 0.5, 1, 1)
    orbit = ball.periodic_orbit(phases=[state[1]])
    branch = continue_orbit(orbit, "amplitude", bounds=(0.13, 0.2))
    branch.save(tmp_path / "branch.h5")
    for known in (branch, Branch.load(tmp_path / "branch.h5", orbit)):
        doubling = only(known, "PD")
        assert abs(doubling.value - doubled / 9.0) < 1e-10
        (second,) = doubling.switch()
        assert second.label == "P(2,2)"
        assert second.stable
        assert second.admissible


def test_without_rebound_a_bounce_ends_where_the_table_does_not_throw_the_ball() -> None:
    ball = BouncingBall(amplitude=3.5, frequency=1.0, restitution=0.0)
    orbit = ball.periodic_orbit(phases=[math.acos(math.pi / 3.5)])
    branch = continue_orbit(orbit, "amplitude", bounds=(3.2, 3.6))
    border = only(branch, "CB")
    # cos(phase) = pi / Gamma, and the ball is thrown where sin(phase) > 1 / Gamma
    assert abs(border.value - math.hypot(math.pi, 1.0)) <= border.error
    thrown = branch.parameter > math.hypot(math.pi, 1.0)
    on_it = branch.unknowns[:, 0] % (2.0 * math.pi) < math.pi
    assert (branch.admissible == (thrown & on_it)).all()


@pytest.mark.parametrize("seed", range(20))
def test_bounces_are_admissible_where_simulation_finds_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    restitution, periods = random.uniform(0.2, 0.9), int(random.integers(1, 4))
    born, _ = strengths(restitution, periods)
    ball, state = bounce(
        born + random.uniform(0.1, 8.0), restitution, periods, int(random.choice([-1, 1]))
    )
    orbit = ball.periodic_orbit(periods=periods, phases=[state[1]])
    assert abs(ball.difference(orbit.states[0], state)).max() <= orbit.error + 1e-15 * state.max()
    solution: Any = orbit._solution
    flight = solution.curve(0, 0)
    inside = np.linspace(0.0, flight.lasts, 20001)[1:-1]
    gaps = flight.values(inside, 1)[0]
    dips = np.flatnonzero((gaps[1:-1] < gaps[:-2]) & (gaps[1:-1] < gaps[2:])) + 1
    sampled = gaps[dips].min(initial=math.inf)
    assert flight.smallest[0] == pytest.approx(sampled, abs=1e-5)
    run = ball.simulate(impacts=1, start=ball.impact_state(state))
    assert orbit.admissible == (abs(float(run.time[0]) - flight.lasts) < 1e-6)


@pytest.mark.parametrize("restitution", [0.35, 0.45, 0.55, 0.65])
def test_grazings_at_other_restitutions(restitution: float) -> None:
    born, _ = strengths(restitution, 1)
    ball = BouncingBall(amplitude=1.1 * born, frequency=1.0, restitution=restitution)
    orbit = ball.periodic_orbit(phases=[-math.acos(1.0 / 1.1)])
    branch = continue_orbit(orbit, "amplitude", bounds=(1.05 * born, 6.0))
    grazing = only(branch, "GR")
    since = grazing.touching["time"] + 1e-3
    exact = exact_grazing(restitution, (since, grazing.value + 1e-3))
    assert abs(grazing.value - exact) <= grazing.error < 1e-11
