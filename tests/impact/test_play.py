"""One mass with play: symmetric orbits, the symmetry itself, rest on both stops."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, strategies as st
from mpmath import mp, mpf

from dynkit.labels.label import OrbitKind
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.effort import share
from tests.impact.one_mass import DIGITS, Orbit, Real, periodic_orbits

ROUNDING = 2.0**-52

PAIR = {"restitution": 0.5, "amplitude": 0.2, "frequency": 1.0}
LIGHT = {"restitution": 0.7, "amplitude": 0.3, "frequency": 2.1}
SPRING = {
    "spring": 1.0,
    "damping": 0.1,
    "force": 1.0,
    "amplitude": 0.0,
    "frequency": 2.1,
    "restitution": 0.8,
}
BOTH = {**SPRING, "amplitude": 0.2, "frequency": 3.0, "restitution": 0.6}
DASHPOT = {**SPRING, "spring": 0.0}

STABLE: dict[str, tuple[dict[str, Any], int, int]] = {
    "free mass": (PAIR, 1, 0),
    "free mass, light impacts": (LIGHT, 1, 0),
    "spring and force": (SPRING, 1, 0),
    "force and housing": (BOTH, 1, 0),
    "dashpot and force": (DASHPOT, 1, 0),
}
ORBITS: dict[str, tuple[dict[str, Any], int, int]] = {
    **STABLE,
    "free mass, slow": (PAIR, 1, 1),
    "free mass, three periods": (PAIR, 3, 1),
    "free mass, light impacts, slow": (LIGHT, 1, 1),
    "spring and force, slow": (SPRING, 1, 1),
    "dashpot and force, three periods": (DASHPOT, 3, 1),
}


def case_of(name: str) -> tuple[PlayOscillator, Orbit, int]:
    """An oscillator, one of its symmetric orbits, and how many periods that takes."""
    arguments, periods, place = ORBITS[name]
    system = PlayOscillator(**arguments)
    return system, periodic_orbits(system, periods)[place], periods


# --- symmetric orbits of two impacts --------------------------------------------------------------


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("periods", [1, 3, 5])
@pytest.mark.parametrize("arguments", [PAIR, LIGHT], ids=["pair", "light"])
def test_orbits_of_the_free_mass_are_those_of_an_impact_pair(
    arguments: dict[str, Any], periods: int, place: int
) -> None:
    # With velocity V in flight: V = A w cos(p) (1 + r) / (1 - r), V m pi / w = s - 2 A sin(p).
    system = PlayOscillator(**arguments)
    with mp.workdps(DIGITS):
        orbit = periodic_orbits(system, periods)[place]
        a, w, r = mpf(system.amplitude), mpf(system.frequency), mpf(system.restitution)
        ratio = (1 + r) / (1 - r)
        steep = periods * mp.pi * ratio
        turn = mpmath.acos(mpf(system.play) / (a * mpmath.hypot(steep, 2)))
        phase = mpmath.atan2(2, steep) + (-turn if place == 0 else turn)
        assert abs(orbit.phase - phase) < mpf(10) ** -35
        assert abs(orbit.u - a * w * mpmath.cos(phase) * (ratio - 1)) < mpf(10) ** -35


@pytest.mark.parametrize("name", STABLE)
def test_impacts_at_both_stops_count(name: str) -> None:
    system, orbit, periods = case_of(name)
    attractor = system.attractor()
    assert str(attractor.label) == f"P(2,{periods})"
    assert abs(abs(attractor.states[:, 0]) - float(orbit.u)).max() < 1e-13


@pytest.mark.parametrize("name", ORBITS)
def test_multipliers_are_squares_of_those_of_half_the_orbit(name: str) -> None:
    system, orbit, _ = case_of(name)
    state = orbit.state
    found = np.linalg.eigvals(system.jacobian(system(state)) @ system.jacobian(state))
    found = np.array(sorted(found, key=lambda z: (abs(z), z.imag)))
    exact = np.array(sorted(orbit.multipliers**2, key=lambda z: (abs(z), z.imag)))
    # The smaller one is a difference of terms as large as the larger one.
    assert abs(found - exact).max() <= 1e-10 * abs(exact).max()


def test_symmetric_orbits_need_enough_play_and_motion() -> None:
    # A hypot(m pi (1 + r) / (1 - r), 2) >= s.
    limit = 1.0 / math.hypot(3.0 * math.pi, 2.0)
    system = PlayOscillator(**PAIR)
    assert not periodic_orbits(system.replace(amplitude=limit * (1.0 - 1e-12)), 1)
    orbits = periodic_orbits(system.replace(amplitude=limit * (1.0 + 1e-12)), 1)
    assert len(orbits) == 2
    # Where they are born one multiplier is 1, but for the square root of 1e-12.
    assert [orbit.multipliers[1] for orbit in orbits] == pytest.approx([1.0, 1.0], abs=2e-5)


# --- symmetry -------------------------------------------------------------------------------------


TINY = st.floats(-300.0, 0.0).map(lambda power: 10.0**power)


@st.composite
def begins(draw: st.DrawFn) -> tuple[PlayOscillator, ImpactState]:
    share = st.floats(0.0, 1.0)
    system = PlayOscillator(
        play=draw(st.floats(0.1, 3.0)),
        spring=draw(st.sampled_from([0.0, 1.0]) | st.floats(0.0, 4.0) | TINY),
        damping=draw(st.just(0.0) | st.floats(0.0, 4.0) | TINY),
        force=draw(st.sampled_from([0.0, 1.0]) | st.floats(-1.0, 1.0)),
        amplitude=draw(st.sampled_from([0.0, 0.2]) | share),
        frequency=draw(st.floats(0.2, 4.0)),
        restitution=draw(share | st.sampled_from([0.0, 1.0])),
        chatter_tolerance=draw(st.sampled_from([1e-16, 1e-8])),
    )
    phase = draw(st.floats(0.0, 6.28))
    place = system.amplitude * math.sin(phase) + system.play * (draw(share) - 0.5) * 0.999
    return system, system.state([place], [draw(st.floats(-2.0, 2.0))], phase)


def mirrored(system: PlayOscillator, state: ImpactState) -> ImpactState:
    """The state at -x, -x' half a period later: all numbers but the first negative."""
    packed = system.pack_state(state)
    packed[1] = 1.0 - packed[1]  # the other stop, left as fast
    packed[3:] = -packed[3:]
    return system.unpack_state(packed)


@pytest.mark.parametrize("spring", [5e-324, 1e-308, 1e-300])
def test_decay_is_half_the_damping_however_weak_the_spring(spring: float) -> None:
    # Damping over spring overflows.
    system = PlayOscillator(frequency=1.0, spring=spring, damping=1e10)
    assert system.modes.decay.tolist() == [5e9]


@share(0.5)
@given(begins())
def test_the_motion_is_symmetric_to_the_bit(begin: tuple[PlayOscillator, ImpactState]) -> None:
    # From an impact on: which side a state in flight belongs to is not told by its numbers.
    system, state = begin
    first = system.simulate(impacts=1, start=state)
    one = system.simulate(impacts=50, start=first.final)
    other = system.simulate(impacts=50, start=mirrored(system, first.final))
    assert other.ending is one.ending
    assert other.time.tobytes() == one.time.tobytes()
    assert other.sticking.tobytes() == one.sticking.tobytes()
    assert (-other.relative_velocity).tobytes() == one.relative_velocity.tobytes()
    assert np.array_equal(-other.position, one.position)
    assert np.array_equal(-other.velocity, one.velocity)


@pytest.mark.parametrize("name", ORBITS)
def test_the_map_is_symmetric_to_rounding(name: str) -> None:
    system, orbit, _ = case_of(name)
    state = orbit.state * [1.05, 1.0] + [0.0, 0.01]
    turned = state * [-1.0, 1.0] + [0.0, math.pi]
    expected = system(state) * [-1.0, 1.0] + [0.0, math.pi]
    # Only pi is rounded.
    allowed = 8.0 * ROUNDING * (1.0 + abs(system.jacobian(state)).max())
    assert abs(system.difference(system(turned), expected)).max() <= allowed


# --- other frames ---------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.0, 2.0])
@pytest.mark.parametrize("name", ["free mass", "free mass, light impacts"])
def test_a_vibrating_housing_is_a_force_in_its_own_frame(name: str, phase: float) -> None:
    arguments, *_ = ORBITS[name]
    shaken = PlayOscillator(**arguments)
    a, w = shaken.amplitude, shaken.frequency
    driven = shaken.replace(amplitude=0.0, force=a * w * w)
    moved = shaken.state([a * math.sin(phase)], [a * w * math.cos(phase) + 0.3], phase)
    one = shaken.simulate(impacts=40, start=moved)
    other = driven.simulate(impacts=40, start=driven.state([0.0], [0.3], phase))
    off = abs(shaken.difference(one.states, other.states)).max(axis=1)
    assert (off <= one.error + other.error).all()


def test_the_default_start_lies_on_the_lower_stop() -> None:
    system = PlayOscillator(**LIGHT)
    start = system.state(phase=1.0)
    assert start.relative_velocity == 0.0
    assert start.position[0] == pytest.approx(0.3 * math.sin(1.0) - 0.5, rel=1e-15, abs=0.0)


# --- a free mass in a housing at rest -------------------------------------------------------------


def test_an_elastic_free_mass_goes_to_and_fro() -> None:
    system = PlayOscillator(play=0.7, amplitude=0.0, frequency=1.0, restitution=1.0)
    record = system.simulate(impacts=1000, start=system.state([0.0], [0.3]))
    speeds = 0.3 * np.where(np.arange(1000) % 2, 1.0, -1.0)
    assert np.array_equal(record.relative_velocity, speeds)
    times = (np.arange(1000) + 0.5) * 0.7 / 0.3
    # one rounding per flight, without bias
    assert record.time == pytest.approx(times, rel=32.0 * ROUNDING, abs=0.0)


@pytest.mark.parametrize("restitution", [0.9, 0.5])
def test_a_free_mass_slows_down_geometrically(restitution: float) -> None:
    system = PlayOscillator(play=0.7, amplitude=0.0, frequency=1.0, restitution=restitution)
    record = system.simulate(impacts=40, start=system.impact_state(np.array([0.3, 0.0])))
    powers = restitution ** np.arange(0.0, 41.0)
    # A rounding or two per impact; those of the times weigh as much as the flights after them.
    assert abs(record.relative_velocity) == pytest.approx(
        0.3 * powers[1:], rel=80.0 * ROUNDING, abs=0.0
    )
    times = np.cumsum(0.7 / (0.3 * powers[:-1]))
    assert record.time == pytest.approx(times, rel=80.0 * ROUNDING, abs=0.0)


def test_a_plastic_free_mass_stays_where_it_hits() -> None:
    system = PlayOscillator(play=0.7, amplitude=0.0, frequency=1.0, restitution=0.0)
    record = system.simulate(impacts=10, start=system.state([0.0], [0.3]))
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert len(record) == 1
    assert math.copysign(1.0, record.relative_velocity[0]) == -1.0


def test_a_mass_that_no_one_moves_hits_nothing() -> None:
    system = PlayOscillator(amplitude=0.2, frequency=1.0)
    record = system.simulate(impacts=10, start=system.state([0.0], [0.0]))
    assert record.ending is Ending.NO_FURTHER_CONTACT


def test_a_stop_that_is_out_of_reach_for_now_costs_little() -> None:
    # Dragged by a dashpot alone the mass need not come back to the stop that it left.
    record = PlayOscillator(**PAIR, damping=0.1).simulate(impacts=300)
    assert record.ending is Ending.COUNT_REACHED
    assert record.cost.counts["cells"] < 100 * 300


# --- rest on both stops ---------------------------------------------------------------------------


@pytest.mark.parametrize("play", [0.1, 1.0, 3.0])
def test_plastic_impacts_hold_the_mass_until_the_housing_turns_back(play: float) -> None:
    # Let go where the housing's acceleration vanishes, at phase 0 and pi; it arrives when
    # A (p - sin p) = s, p < pi, and the housing presses it until pi.
    system = PlayOscillator(play=play, amplitude=1.0, frequency=1.0, restitution=0.0)
    record = system.simulate(impacts=20)
    with mp.workdps(DIGITS):

        def gap(p: Real) -> Real:
            return p - mpmath.sin(p) - mpf(play)

        arrival = float(mpmath.findroot(gap, (mpf("0.1"), mp.pi), solver="anderson"))
    halves = math.pi * np.arange(20)
    assert record.time == pytest.approx(arrival + halves, rel=1e-14, abs=0.0)
    assert record.sticking[:, 1] == pytest.approx(halves[1:], rel=1e-14, abs=0.0)
    assert record.relative_velocity.tolist() == [0.0] * 20
    assert np.signbit(record.relative_velocity).tolist() == [True, False] * 10
    assert str(system.attractor().label) == "P(inf,1)"


# --- chaos between contacts -----------------------------------------------------------------------

RATTLE = PlayOscillator(frequency=1.5, play=2.0)
"""Let go by a stop its motion is always the same, and chaotic until, by chance, it sticks again."""


def free_flight(a: Real, w: Real, s: Real, begin: tuple[Real, Real, Real]) -> tuple[Real, int]:
    """Phase and side of the next impact of a free mass, from phase, position and velocity.

    Between the phases at which the housing is as fast as the mass both gaps are monotonic.
    """
    phase, x, v = begin
    whole = 2 * mp.pi * mpmath.floor(phase / (2 * mp.pi))
    angle, place, slope = float(phase - whole), float(x), float(v / w)

    def gap(side: int, at: float) -> float:
        rest = place + slope * (at - angle) - float(a) * math.sin(at)
        return side * rest + 0.5 * float(s)

    alike = [angle + 2.0 * float(s + 2 * a) / abs(slope)]
    if abs(slope) < a:
        turn, turns = math.acos(slope / float(a)), range(3 + int(alike[0] / math.tau))
        alike = [math.tau * k + p for k in turns for p in (turn, math.tau - turn)]
    low = angle
    for high in (p for p in alike if p > angle + 1e-6):
        assert min(abs(gap(1, high)), abs(gap(-1, high))) > 1e-6  # nothing that only grazes
        for side in (1, -1):
            if gap(side, high) < 0.0:
                for _ in range(50):
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if gap(side, middle) > 0.0 else (low, middle)
                end = whole + mpf(high)
                for _ in range(mp.prec.bit_length()):
                    value = side * (x + v * (end - phase) / w - a * mpmath.sin(end)) + s / 2
                    end -= value / (side * (v / w - a * mpmath.cos(end)))
                return end, side
        low = high
    raise AssertionError("a free mass comes to a stop")


def rattles_that_repeat_in_doubles() -> Iterator[ImpactRecord]:
    """Motions of rattles whose play differs in the last digits, three contacts of each.

    Doubles stick again after some hundred impacts, always the same number; how many, and whether at
    the same stop, as they do here, the last digits decide.
    """
    for k in range(400):
        rattle = RATTLE.replace(play=2.0 + 2.0**-50 * k, restitution=0.7)
        record = rattle.simulate(impacts=750)
        releases = record.sticking[:3, 1]
        if len(releases) == 3 and np.diff(releases) == pytest.approx(releases[0], rel=1e-12):
            yield record


def nearly_sticks(rattle: ImpactMap, time: float) -> bool:
    """Whether an impact of the first so long is slower than 1e-2, to 300 digits."""
    assert isinstance(rattle, PlayOscillator)
    with mp.workprec(1000):
        a, w, s = mpf(rattle.amplitude), mpf(rattle.frequency), mpf(rattle.play)
        phase, x, v, u = mpf(0), -s / 2, a * w, mpf(1)
        while u > 1e-2 and phase < w * time:
            end, side = free_flight(a, w, s, (phase, x, v))
            x, phase = x + v * (end - phase) / w, end
            housing = a * w * mpmath.cos(end)
            u = mpf(rattle.restitution) * side * (housing - v)
            v = housing + side * u
    return bool(u <= 1e-2)


def test_chaos_that_contact_interrupts_is_not_called_periodic() -> None:
    records = rattles_that_repeat_in_doubles()
    record = next(each for each in records if not nearly_sticks(each.system, each.sticking[0, 1]))
    assert record.error[np.searchsorted(record.time, record.sticking[0, 0])] > 1.0
    assert record.system.attractor().label.kind is OrbitKind.UNSETTLED


@pytest.mark.parametrize("seed", range(12))
def test_motions_of_the_rattle_are_periodic_only_where_they_do_not_stick(seed: int) -> None:
    random = np.random.default_rng(seed)
    start = RATTLE.state(random.uniform(-0.9, 0.9, 1), random.uniform(-1.0, 1.0, 1))
    label = RATTLE.attractor(start=start).label
    assert str(label) in ("P(2,1)", "chaotic", "unsettled")
