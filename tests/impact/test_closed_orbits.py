"""Orbits of one mass whose impacts are all alike, in closed form: one stop, or two in turn."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.impact import test_play as play, test_single as single
from tests.impact.one_mass import DIGITS, Orbit

ROUNDING = 2.0**-52


class Case(NamedTuple):
    """An orbit, and the periods of the force that it takes; half of them lie between two stops."""

    system: ImpactOscillator
    orbit: Orbit
    periods: int

    @property
    def turn(self) -> int:
        """The factor of u from one impact to the next."""
        return -1 if self.system.play < math.inf else 1

    @property
    def half_turns(self) -> int:
        """Of the phase, from one impact to the next."""
        return self.periods if self.turn < 0 else 2 * self.periods

    def after(self, impacts: Any) -> Array:
        """The section states after some more impacts."""
        phase = self.orbit.state[1] + math.pi * ((impacts * self.half_turns) % 2)
        return np.stack([self.orbit.state[0] * self.turn**impacts + 0.0 * phase, phase], axis=-1)

    def derivative(self, side: int = 1) -> Array:
        """Of absolute values of u, from an impact at either stop."""
        u, phase = self.orbit.state
        place = np.array([u, phase] if side > 0 else [-u, phase + math.pi])
        found = self.system.jacobian(place)
        return np.asarray(np.diag([self.turn * side, 1.0]) @ found @ np.diag([side, 1.0]))

    @property
    def lost(self) -> float:
        """What dashpot and impact leave of an area."""
        time = self.half_turns * math.pi / self.system.frequency
        damping = float(self.system.damping_matrix[0, 0])
        return self.system.restitution**2 * math.exp(-damping * time)


CASES: dict[str, Case] = {
    **{str(case): Case(case.system, case.orbit, case.periods) for case in single.CASES},
    **{name: Case(*play.case_of(name)) for name in play.ORBITS},
}
STABLE = [*map(str, single.STABLE), *play.STABLE]
EACH = pytest.mark.parametrize("name", CASES)


@EACH
def test_the_closed_form_solves_the_equations_of_motion(name: str) -> None:
    # By a matrix exponential of position, velocity, sine and cosine: nothing else is shared.
    system, orbit, _ = case = CASES[name]
    with mp.workdps(DIGITS):
        k, c = mpf(float(system.stiffness[0, 0])), mpf(float(system.damping_matrix[0, 0]))
        w, swing, force = mpf(system.frequency), mpf(system.amplitude), system.harmonic_forces[0]
        rates = mpmath.matrix([[0, 1, 0, 0], [-k, -c, 0, 0], [0, 0, 0, w], [0, 0, -w, 0]])
        rates[1, 2], rates[1, 3] = mpf(force.real), mpf(force.imag)
        sign = 1 if system.side == "above" else -1
        sine, cosine = mpmath.sin(orbit.phase), mpmath.cos(orbit.phase)
        x, v = swing * sine + mpf(system.offset), swing * w * cosine + sign * orbit.u
        flight = rates * (case.half_turns * mp.pi / w)
        end = mpmath.expm(flight) * mpmath.matrix([x, v, sine, cosine])
        # Where two stops are half a play from the middle, the next one is the image of this one
        assert abs(end[0] - case.turn * x) < mpf(10) ** -35
        approach = -sign * case.turn * (end[1] - swing * w * end[3])
        assert abs(mpf(system.restitution) * approach - orbit.u) < mpf(10) ** -35


@EACH
def test_the_map_leads_from_impact_to_impact(name: str) -> None:
    system, orbit, _ = case = CASES[name]
    steepest = abs(system.jacobian(orbit.state)).max()
    # The state is rounded, and so are position and velocity where the flight ends.
    allowed = 4.0 * ROUNDING * (1.0 + steepest) * (1.0 + abs(orbit.state).max())
    assert abs(system.difference(system(orbit.state), case.after(1))).max() <= allowed


@pytest.mark.parametrize("name", STABLE)
def test_stable_orbits_are_kept(name: str) -> None:
    system, orbit, _ = case = CASES[name]
    record = system.simulate(impacts=1000, start=system.impact_state(orbit.state))
    impacts = np.arange(1, 1001)
    assert orbit.stable
    assert abs(system.difference(record.states, case.after(impacts))).max() < 1e-13
    times = case.half_turns * math.pi / system.frequency * impacts
    assert record.time == pytest.approx(times, rel=1e-14, abs=0.0)


@pytest.mark.parametrize(
    ("name", "side"), [(name, side) for name, case in CASES.items() for side in {1, case.turn}]
)
def test_the_jacobian_at_either_stop_is_the_closed_form(name: str, side: int) -> None:
    case = CASES[name]
    exact = np.array(case.orbit.derivative.tolist(), dtype=float)
    found = case.derivative(side)
    # Its elements change by about their squares when the impact, of velocity u, is shifted.
    allowed = 8.0 * ROUNDING * (1.0 + abs(exact).max() ** 2 / abs(case.orbit.state[0]))
    assert abs(found - exact).max() <= allowed


@EACH
def test_the_multipliers_product_is_what_dashpot_and_impact_take(name: str) -> None:
    case = CASES[name]
    assert np.prod(case.orbit.multipliers) == pytest.approx(case.lost, rel=1e-14, abs=0.0)
    found = case.derivative()
    # The terms of the determinant are as large as the square of the elements.
    allowed = 8.0 * ROUNDING * (abs(found).max() ** 2 / abs(case.orbit.state[0]) + 1.0)
    assert np.linalg.det(found) == pytest.approx(case.lost, abs=allowed)
