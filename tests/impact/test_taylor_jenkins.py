"""Sliders beside springs that are not linear: closed forms, sixty digits, and what must hold."""

from __future__ import annotations

from functools import cache
from math import pi
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_poly, ctx

from dynkit.analysis import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactDuffing,
    ImpactPendulum,
    Jenkins,
    MatrixOscillator,
    SoftStop,
    TodaChain,
    iwan,
)
from dynkit.systems.impact.modes.taylor import chart as taylor_chart
from dynkit.systems.impact.simulation.state import within
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.flows.cases import BITS, followed_in_many_digits, taylor
from tests.impact.curved_cases import Bob, floor
from tests.impact.disguised import disguised
from tests.impact.taylor_cases import Bead, DoublePendulumAtAStop

JOINT = Jenkins(0, stiffness=2.0, force=0.2, name="joint")
DUFFING = ImpactDuffing(frequency=0.9, force=0.6, elements=[JOINT])
SYSTEMS: dict[str, Any] = {
    "duffing": DUFFING,
    "duffing at a stop": DUFFING.replace(
        elements=[HardStop(0, offset=-0.3, restitution=0.6), JOINT]
    ),
    "toda, iwan": TodaChain(
        masses=3,
        frequency=0.8,
        harmonic_forces=[0.0, 0.0, 0.9],
        elements=iwan((0, 1), stiffness=1.0, force=0.3, elements=4),
    ),
    "toda, belt": TodaChain(
        masses=2,
        frequency=0.8,
        harmonic_forces=[0.0, 0.9],
        elements=[
            DryFriction(0, force=0.1),
            Jenkins(1, stiffness=1.0, force=0.2, velocity=0.1, amplitude=0.05, side="below"),
        ],
    ),
    "bead": Bead(
        frequency=0.8,
        harmonic_forces=[0.5],
        elements=[HardStop(0, offset=-0.4, restitution=0.5), Jenkins(0, stiffness=1.0, force=0.1)],
    ),
    "bob": Bob(
        frequency=2.0,
        elements=[*floor(amplitude=0.05, offset=0.3), Jenkins(0, stiffness=1.0, force=0.05)],
    ),
    "double pendulum": DoublePendulumAtAStop(
        frequency=0.9,
        harmonic_forces=[0.4, 0.0],
        elements=[
            HardStop(1, offset=-0.2, restitution=0.6),
            Jenkins((0, 1), stiffness=0.5, force=0.1),
        ],
    ),
}


@pytest.mark.usefixtures("optimised")
def test_a_hysteresis_loop_is_masings() -> None:
    # G. Masing, Proc. 2nd Int. Congress for Applied Mechanics, Zurich 1926, 332-335: a branch of
    # the loop is the virgin curve, twice as large. Friction that never slips moves the pendulum.
    joint, swing, w = iwan(0, stiffness=3.0, force=0.8, elements=4, exponent=-0.4), 0.8, 0.6
    drive = DryFriction(0, force=1e6, amplitude=swing)
    moved = ImpactDuffing(frequency=w, elements=[drive, *joint])
    record = moved.simulate(impacts=3, start=moved.state([0.0], [swing * w]))
    springs, forces = np.array([[each.stiffness, each.force] for each in joint]).T
    times = np.linspace(2 * pi / w, 4 * pi / w, 201)
    found = (record.sample(times)[0] - record.sample_sliders(times)) @ springs

    def virgin(x: Array) -> Array:
        out: Array = np.minimum(np.outer(x, springs), forces).sum(axis=1)
        return out

    most, place = virgin(np.array([swing])), swing * np.sin(w * times)
    up, down = -most + 2 * virgin((place + swing) / 2), most - 2 * virgin((swing - place) / 2)
    assert found == pytest.approx(np.where(np.cos(w * times) > 0.0, up, down), abs=1e-12)
    first, last = (np.maximum(swing - n * forces / springs, 0.0) for n in (1, 2))
    lost = list(record.energy_balance().dissipated.values())[2:]
    assert lost == pytest.approx(forces * (11 * first + last), abs=1e-11)


@pytest.mark.usefixtures("optimised")
def test_a_slider_under_a_cubic_spring_is_that_of_sixty_digits() -> None:
    record = DUFFING.simulate(impacts=3, start=DUFFING.state([0.1], [0.3], 0.0, [0.05]))
    k, f, c, w, drive = (arb(value) for value in (2.0, 0.2, 0.1, 0.9, 0.6))

    def velocity(regime: int) -> Any:
        """Of place, velocity, slider and phase: it sticks, or slides forward or backward."""

        def of(z: Any) -> Any:
            x, v, s, phase = z
            pull = (-k * (x - s), -f, f)[regime]
            moved = 0 * v if regime == 0 else v
            return [v, -c * v - x - x**3 + pull + drive * phase.sin(), moved, 0 * phase + w]

        return of

    def watched(regime: int, z: Any) -> Any:
        return z[1] if regime else (k * (z[0] - z[2])) ** 2 - f**2

    with ctx.workprec(BITS):
        z, now, regime = [arb(0.1), arb(0.3), arb(0.05), arb(0)], arb(0), 0
        modes = DUFFING._automaton.regimes
        assert len(record.events.time) > 8
        pairs = zip(record.events.time.tolist(), record.events.mode.tolist(), strict=True)
        for time, mode in pairs:
            begin = arb(time) - arb(2.0**-20)
            z = followed_in_many_digits(velocity(regime), z, begin - now)
            paths = [arb_poly(path.coeffs()) for path in taylor(velocity(regime), z)]
            late = arb(2.0**-20)
            for _ in range(5):  # the secant through two near times
                ends = [
                    watched(regime, [path(late + arb(h)) for path in paths])
                    for h in (0.0, 2.0**-90)
                ]
                late = (late - ends[0] * arb(2.0**-90) / (ends[1] - ends[0])).mid()
            z, now, regime = [path(late).mid() for path in paths], begin + late, modes[mode][0]
            assert abs(float(now) - time) < 1e-13
        z = followed_in_many_digits(velocity(regime), z, 6 * arb.pi() / w - now)
    found = [float(value) for value in z[:3]]
    assert abs(record.states[-1] - found).max() <= record.error[-1] < 1e-12


@cache
def recorded(name: str) -> Any:
    return SYSTEMS[name].simulate(impacts=12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_energies_balance_and_runs_go_on_bit_for_bit(name: str) -> None:
    whole = recorded(name)
    balance, rest = whole.energy_balance(), SYSTEMS[name].simulate(impacts=6, start=None)
    assert balance.error < 1e-12
    assert all(heat >= -balance.error for heat in balance.dissipated.values())
    on = SYSTEMS[name].simulate(impacts=6, start=rest.final)
    assert (on.states == whole.states[6:]).all()


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_derivative_of_the_map_is_that_of_differences(name: str) -> None:
    system, states = SYSTEMS[name], recorded(name).states[3:5].copy()
    count = len(system._sliders)
    end = states.shape[1] - (0 if system._strobed else 2)
    for state in states:  # where no slider is about to yield
        low, high = within(system, system.impact_state(state).position)
        state[end - count : end] = low + 0.37 * (high - low)
    jacobian_is_the_derivative(system, states)


@pytest.mark.parametrize("name", ["duffing at a stop", "bead", "double pendulum", "toda, belt"])
def test_orbits_have_the_multipliers_of_their_attractors(name: str) -> None:
    attractor = SYSTEMS[name].attractor(transient=100, keep=50)
    orbit = attractor.periodic_orbit()
    assert str(orbit.label) == str(attractor.label)
    assert orbit.admissible
    assert orbit.error < 1e-10
    if name == "bead":
        spectrum = LyapunovSpectrum(attractor, iterations=128)
        assert abs(spectrum.exponents[0] - np.log(abs(orbit.multipliers).max())) < 0.01


def test_regimes_of_sliders_need_no_code_of_their_own() -> None:
    chain = SYSTEMS["toda, iwan"].replace(masses=2, harmonic_forces=[0.0, 0.9])
    before = taylor_chart._integrator.cache_info().misses
    record = chain.simulate(impacts=4)
    assert len(chain._automaton.modes) > 4
    assert taylor_chart._integrator.cache_info().misses == before + 1
    assert record.sliders.shape == (4, 4)


def test_wrong_sliders_are_named() -> None:
    with pytest.raises(ValueError, match=r"sliders\[0\] must lie in \[-0.1, 0.1\]; got 0.3"):
        DUFFING.state([0.0], [0.0], 0.0, [0.3])
    pendulum = ImpactPendulum(frequency=0.8)
    with pytest.raises(ValueError, match="sliders must"):
        pendulum.state([0.0], [0.0], 0.0, [0.0])


@pytest.mark.parametrize(
    "other",
    [
        SoftStop(0, offset=0.9, stiffness=3.0, damping=0.2, side="below"),
        DryFriction(0, force=0.3, static=0.4, velocity=-0.2),
    ],
    ids=["soft stop", "friction"],
)
def test_derivatives_from_a_start_at_the_limit_are_those_of_the_exact_engine(other: Any) -> None:
    joint = Jenkins(0, stiffness=2.0, force=0.5)
    exact = MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.0]],
        frequency=1.0,
        harmonic_forces=[0.5],
        elements=[joint, other],
    )
    state = np.array([1.2, 0.4, 0.95])
    found, expected = (system.jacobian(state) for system in (disguised(exact), exact))
    assert found == pytest.approx(expected, abs=1e-9)
