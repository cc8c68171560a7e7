"""One mass on a spring against a stop: periodic orbits, multipliers, grazing."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.one_mass import DIGITS, Orbit, Real, flight_matrix, periodic_orbits

ROUNDING = 2.0**-52


def make(**arguments: Any) -> SingleImpactOscillator:
    return SingleImpactOscillator(**{"restitution": 0.8, **arguments})


# --- one impact in m periods of the force ---------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """An orbit of one impact in some periods, by its place among those of that kind."""

    frequency: float
    stop: float
    periods: int
    place: int

    @property
    def system(self) -> SingleImpactOscillator:
        return make(frequency=self.frequency, stop=self.stop)

    @property
    def orbit(self) -> Orbit:
        return periodic_orbits(self.system, self.periods)[self.place]


STABLE = [
    Case(1.5, -0.2, 1, 0),
    Case(2.0, 0.0, 1, 0),
    Case(2.3, 0.1, 1, 0),
    Case(4.0, 0.0, 2, 0),
    Case(5.5, 0.0, 3, 0),
    Case(5.5, 0.1, 3, 0),
    Case(8.2, 0.0, 4, 0),
]
UNSTABLE = [
    Case(2.8, 0.1, 1, 0),
    Case(2.8, 0.1, 2, 0),
    Case(5.5, 0.1, 3, 1),
    Case(5.5, 0.1, 4, 1),
    Case(8.2, -0.2, 3, 1),
]


CASES = STABLE + UNSTABLE
"""Of which there is more in `test_closed_orbits`."""


@pytest.mark.parametrize("case", STABLE, ids=repr)
def test_stable_orbits_attract_what_is_near(case: Case) -> None:
    system, orbit = case.system, case.orbit
    start = system.impact_state(orbit.state * [1.01, 1.0])
    attractor = system.attractor(transient=400, impacts=100, start=start)
    # 0.72^400 is 1e-57: nothing of the start is left.
    assert abs(system.difference(attractor.states, orbit.state)).max() < 1e-13
    assert str(attractor.label) == f"P(1,{case.periods})"


@pytest.mark.parametrize("case", CASES, ids=repr)
def test_multipliers_are_the_closed_form(case: Case) -> None:
    orbit = case.orbit
    found = np.linalg.eigvals(case.system.jacobian(orbit.state))
    found = np.array(sorted(found, key=lambda z: (abs(z), z.imag)))
    assert found == pytest.approx(orbit.multipliers, rel=1e-12, abs=0.0)


def test_a_saddle_repels_what_is_near() -> None:
    case = Case(5.5, 0.1, 3, 1)
    system, state = case.system, case.orbit.state
    distance = np.array([1e-9, 0.0])
    off = system.iterate(state + distance, 15) - state
    growth = np.linalg.norm(off[-1]) / np.linalg.norm(off[-2])
    assert growth == pytest.approx(abs(case.orbit.multipliers[1]), rel=1e-4, abs=0.0)


# --- grazing --------------------------------------------------------------------------------------


def steady(system: SingleImpactOscillator, phase: float = 1.0) -> ImpactState:
    """A state of the response of the oscillator without stop."""
    w = system.frequency
    response = system.force / ((1.0 - w) * (1.0 + w) + 2j * system.damping_ratio * w)
    z = response * cmath.exp(1j * phase)
    return system.state([z.real], [-w * z.imag], phase)


GRAZING = [
    (frequency, ratio, stop)
    for frequency in (0.3, 0.9, 1.0, 1.7, 2.8, 6.0)
    for ratio in (0.01, 0.05, 0.7)
    for stop in (0.5, 20.0)
]


def grazing(frequency: float, ratio: float, stop: float, factor: float) -> SingleImpactOscillator:
    system = make(frequency=frequency, damping_ratio=ratio, stop=stop)
    return system.replace(force=factor * system.grazing_force)


@pytest.mark.parametrize("apart", [1e-1, 1e-5, 1e-9, 1e-14])
@pytest.mark.parametrize("ratio", [0.0, 1e-9, 1e-3, 0.7])
def test_the_grazing_force_is_right_near_resonance(ratio: float, apart: float) -> None:
    frequency = 1.0 + apart
    system = make(frequency=frequency, damping_ratio=ratio, stop=0.3)
    with mp.workdps(DIGITS):
        w, zeta = mpf(frequency), mpf(ratio)
        exact = mpf(0.3) * abs(1 - w * w + mpmath.mpc(0, 2) * zeta * w)
        assert abs(system.grazing_force / exact - 1) < 4.0 * ROUNDING


def test_without_damping_no_force_is_small_enough_at_resonance() -> None:
    assert make(frequency=1.0, damping_ratio=0.0, stop=0.3).grazing_force == 0.0


@pytest.mark.parametrize("stop", [0.0, -0.3])
def test_a_stop_that_holds_the_mass_is_reached_by_any_force(stop: float) -> None:
    assert make(frequency=2.0, stop=stop).grazing_force == 0.0


@pytest.mark.parametrize(("frequency", "ratio", "stop"), GRAZING)
def test_below_the_grazing_force_there_is_no_impact(
    frequency: float, ratio: float, stop: float
) -> None:
    system = grazing(frequency, ratio, stop, 1.0 - 1e-9)
    attractor = system.attractor(start=steady(system))
    assert attractor.ending is Ending.NO_FURTHER_CONTACT
    assert len(attractor.states) == 0


@pytest.mark.parametrize(("frequency", "ratio", "stop"), GRAZING)
def test_above_the_grazing_force_impacts_go_on(frequency: float, ratio: float, stop: float) -> None:
    system = grazing(frequency, ratio, stop, 1.0 + 1e-9)
    attractor = system.attractor(start=steady(system))
    assert attractor.ending is Ending.COUNT_REACHED


@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("frequency", "ratio", "stop"), GRAZING)
def test_the_first_impact_beyond_grazing_has_the_speed_of_the_linear_response(
    frequency: float, ratio: float, stop: float, excess: float
) -> None:
    system = grazing(frequency, ratio, stop, 1.0 + excess)
    u = system.simulate(impacts=1, start=steady(system)).relative_velocity[0]
    # X^2 w^2 = x'^2 + w^2 stop^2 on the response of amplitude X
    exact = 0.8 * frequency * stop * math.sqrt(2.0 * excess + excess**2)
    # The depth below the stop, excess * stop, has the rounding of the terms of the motion.
    assert u == pytest.approx(exact, rel=16.0 * ROUNDING / excess, abs=0.0)


def before_grazing() -> tuple[SingleImpactOscillator, Real, Real, Real]:
    """An oscillator, (u, phase) after an impact from which it comes back to touch the stop only.

    Also the depth of the touch by u: the motion is followed back from a touch to when it left the
    stop.
    """
    system = make(frequency=2.8, stop=0.1)
    with mp.workdps(DIGITS):
        c, w, force = 2 * mpf(system.damping_ratio), mpf(system.frequency), mpf(system.force)
        stop, touch = mpf(system.stop), mpf(3)
        response = force / (1 - w * w + mpmath.mpc(0, 1) * c * w)

        def before(time: Real) -> Real:
            turn = response * mpmath.expj(touch)
            own = mpmath.matrix([stop - mpmath.re(turn), w * mpmath.im(turn)])
            turn *= mpmath.expj(-w * time)
            return flight_matrix(c, 1, -time) * own + mpmath.matrix(
                [mpmath.re(turn), -w * mpmath.im(turn)]
            )

        time = mpmath.findroot(lambda t: before(t)[0] - stop, mpf("1.76"))
        u, depth = -before(time)[1], flight_matrix(c, 1, time)[0, 1]
        pull = force * mpmath.cos(touch) - stop
        return system, (u, touch - w * time), depth, pull


def test_the_impact_map_has_a_square_root_at_grazing() -> None:
    # Slower by e, the mass gets deeper by depth e, and hits with sqrt(2 |acceleration| depth e).
    system, (u, phase), depth, pull = before_grazing()
    assert u > 0 > pull
    assert depth > 0
    slower = np.array([float(u) - e for e in 10.0 ** np.arange(-10.0, -6.0, 0.5)])
    e = np.array([float(u - mpf(s)) for s in slower])
    found = np.array([system(np.array([s, float(phase)]))[0] for s in slower])
    leading = system.restitution * np.sqrt(2.0 * float(-pull * depth) * e)
    # The next term is smaller by sqrt(e) = 1e-3.
    assert found == pytest.approx(leading, rel=1e-2, abs=0.0)
    exponent = np.polyfit(np.log(e), np.log(found), 1)[0]
    assert exponent == pytest.approx(0.5, abs=1e-2 / math.log(e.max() / e.min()))


def test_the_derivative_is_singular_at_grazing() -> None:
    system, (u, phase), *_ = before_grazing()
    e = 10.0 ** np.arange(-10.0, -6.0, 0.5)
    sizes = [abs(system.jacobian(np.array([float(u) - d, float(phase)]))).max() for d in e]
    exponent = np.polyfit(np.log(e), np.log(sizes), 1)[0]
    assert exponent == pytest.approx(-0.5, abs=1e-2 / math.log(e.max() / e.min()))


def test_on_the_other_side_of_grazing_the_impact_is_missed() -> None:
    system, (u, phase), *_ = before_grazing()

    def wait(speed: float) -> float:
        start = system.impact_state(np.array([speed, float(phase)]))
        return float(system.simulate(impacts=1, start=start).time[0])

    assert wait(float(u) + 1e-9) > wait(float(u) - 1e-9) + 0.1


# --- other words for the same -------------------------------------------------------------------


def test_the_default_start_is_at_rest_at_a_distance_of_one() -> None:
    start = make(frequency=2.0, stop=-3.5).state()
    assert start.position.tolist() == [-4.5]
    assert start.velocity.tolist() == [0.0]


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_force_and_stop_scale_the_motion(factor: float) -> None:
    system = make(frequency=2.0, stop=0.1)
    scaled = system.replace(force=factor, stop=factor * 0.1)
    one = system.simulate(impacts=50, start=system.state([-1.0]))
    other = scaled.simulate(impacts=50, start=scaled.state([-factor]))
    allowed = factor * one.error + other.error
    assert (abs(other.relative_velocity - factor * one.relative_velocity) <= allowed).all()
    assert (abs(other.time - one.time) <= (one.error + other.error) * 4.0).all()


@pytest.mark.parametrize("force", [1e-30, 1e-50, 1e-150])
def test_a_stop_that_need_not_hold_does_not(force: float) -> None:
    # The impact leaves the roundings of -1 in the position, much more than the distances that the
    # force works on. The mass is pulled off by stop - force cos(phase), zero at phase 0 alone.
    system = make(frequency=1.0, damping_ratio=0.0, restitution=0.0, force=force, stop=force)
    record = system.simulate(impacts=3, start=system.state([-1.0]))
    alike = make(frequency=1.0, damping_ratio=0.0, restitution=0.0, stop=1.0)
    start = alike.state([1.0], [0.0], 0.5 * math.pi)
    expected = alike.simulate(impacts=2, start=start)
    assert len(record.sticking) == 0
    assert record.time[1:] - record.time[0] == pytest.approx(expected.time, rel=1e-14, abs=0.0)


def test_strong_subharmonic_driving_is_chaotic() -> None:
    # Shaw & Holmes 1983 find chaos at restitution 0.8 and 2.8 times the natural frequency.
    assert str(make(frequency=2.8).attractor().label) == "chaotic"
