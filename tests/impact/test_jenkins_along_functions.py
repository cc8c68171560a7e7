"""Sliders along functions of the coordinates: sixty digits, and chains in other coordinates."""

from __future__ import annotations

from functools import cache
from math import pi
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_poly, ctx

from dynkit import continue_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import DryFriction, HardStop, ImpactChain, Jenkins, SoftStop, iwan
from dynkit.systems.impact.simulation.state import within
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.flows.cases import BITS, followed_in_many_digits, taylor
from tests.impact.test_elements_along_functions import GIVEN, TABLE, Chain, Pendulum
from tests.impact_orbits.bent_cases import WIDE, changes, orbits_agree


def beside(first: Any, last: Any) -> dict[str, list[Any]]:
    """Elements on the two masses of a chain."""
    joint: dict[str, Any] = {"stiffness": 2.0, "force": 0.02, "name": "joint"}
    table = HardStop(last, **TABLE)
    return {
        "joint": [table, Jenkins(first, **joint)],
        "iwan": [table, *iwan(first, stiffness=3.0, force=0.05, elements=2, name="iwan")],
        "belt": [
            Jenkins(last, amplitude=0.1, velocity=0.02, side="below", **joint),
            SoftStop(first, offset=0.02, stiffness=20.0),
        ],
        "along the table": [table, Jenkins(last, **joint)],
        "with friction": [table, Jenkins(last, **joint), DryFriction(last, force=0.02)],
    }


@cache
def both(name: str) -> tuple[Any, Any]:
    """The chain, and the bent one."""
    exact = ImpactChain(elements=beside(0, 1)[name], **GIVEN)
    return exact, Chain(elements=beside("first", "end")[name], last=0.12, **GIVEN)


@pytest.mark.parametrize("name", beside(0, 1))
def test_motions_and_heat_are_those_of_the_chain(name: str) -> None:
    exact, bent = both(name)
    q = np.array([0.2, 0.1])
    x = [float(place) for place in bent.places(q)]
    along = x[0] if name in ("joint", "iwan") else x[1]
    places = [along + 0.003] * len(bent._sliders)
    one = exact.simulate(impacts=8, start=exact.state(x, [0.0, 0.0], 0.0, places))
    two = bent.simulate(impacts=8, start=bent.state(q, [0.0, 0.0], 0.0, places))
    bound = one.error[-1] + two.error[-1]
    assert bound < 1e-11
    assert repr(one.events) == repr(two.events)
    assert abs(one.position - np.array(bent.places(two.position.T)).T).max() <= bound
    assert abs(one.sliders - two.sliders).max() <= bound
    times = np.linspace(0.0, min(one.time[-1], two.time[-1]), 50)
    assert abs(one.sample_sliders(times) - two.sample_sliders(times)).max() <= bound
    joint = "iwan1" if name == "iwan" else "joint"
    for what in ("stretch", "spring_force"):
        seen = [record.observable(f"{joint}.{what}", times) for record in (one, two)]
        assert seen[0] == pytest.approx(seen[1], abs=1e-11)
    heat = two.energy_balance()
    assert heat.error < 1e-12
    assert heat.dissipated == pytest.approx(one.energy_balance().dissipated, abs=1e-12)
    half = bent.simulate(impacts=4, start=bent.state(q, [0.0, 0.0], 0.0, places)).final
    assert (bent.simulate(impacts=4, start=half).states == two.states[4:]).all()


@pytest.mark.parametrize("name", beside(0, 1))
def test_the_derivative_of_the_map_is_that_of_differences(name: str) -> None:
    _, system = both(name)
    states = system.simulate(impacts=4).states[3:].copy()
    count, end = len(system._sliders), states.shape[1] - (0 if system._strobed else 2)
    for state in states:  # where no slider is about to yield
        low, high = within(system, system.impact_state(state).position)
        state[end - count : end] = low + 0.37 * (high - low)
    jacobian_is_the_derivative(system, states)


PARAMETERS = {
    "joint": ["joint.force", "joint.stiffness", "damping", "table.restitution"],
    "iwan": ["iwan1.force"],
    "belt": ["joint.velocity", "joint.amplitude", "frequency"],
    "along the table": ["joint.stiffness"],
    "with friction": ["joint.force"],
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_orbits_and_their_derivatives_are_those_of_the_chain(name: str) -> None:
    exact, bent = (s.attractor(transient=30, keep=20).periodic_orbit() for s in both(name))
    orbits_agree(exact, bent, PARAMETERS[name])
    assert abs(changes(bent, "bend")).max() < 1e-10  # other coordinates of the same motion


def test_a_branch_meets_the_bifurcation_of_the_chain() -> None:
    found = []
    for machine in both("joint"):
        near = machine.replace(**{"joint.force": 0.0515})
        orbit = near.attractor(transient=60, keep=30).periodic_orbit()
        found.append(
            continue_orbit(orbit, "joint.force", bounds=(0.0515, 0.0523), **WIDE).bifurcations
        )
    (known,), (other,) = found
    assert known.kind is other.kind is BifurcationKind.GR
    assert known.admissible
    assert other.admissible
    assert abs(known.value - other.value) <= known.error + other.error


SWINGING = Pendulum(
    frequency=1.3,
    drag=0.1,
    harmonic_forces=[0.5],
    elements=[Jenkins("across", stiffness=2.0, force=0.2, name="joint")],
)


def test_a_slider_along_the_way_of_a_bob_is_that_of_sixty_digits() -> None:
    record = SWINGING.simulate(impacts=3, start=SWINGING.state([0.1], [0.3], 0.0, [0.05]))
    k, f, c, w, drive = (arb(value) for value in (2.0, 0.2, 0.1, 1.3, 0.5))

    def velocity(regime: int) -> Any:
        """Of angle, rate, slider and phase: it sticks, or slides forward or backward."""

        def of(z: Any) -> Any:
            x, v, s, phase = z
            pull = (-k * (x.sin() - s), -f, f)[regime]
            moved = 0 * v if regime == 0 else x.cos() * v
            push = drive * phase.sin() + x.cos() * pull
            return [v, push - c * v - x.sin(), moved, 0 * phase + w]

        return of

    def watched(regime: int, z: Any) -> Any:
        return z[1] * z[0].cos() if regime else (k * (z[0].sin() - z[2])) ** 2 - f**2

    with ctx.workprec(BITS):
        z, now, regime, late = [arb(0.1), arb(0.3), arb(0.05), arb(0)], arb(0), 0, arb(2.0**-20)
        modes = SWINGING._automaton.regimes
        assert len(record.events.time) > 8
        pairs = zip(record.events.time.tolist(), record.events.mode.tolist(), strict=True)
        for time, mode in pairs:
            begin = arb(time) - late
            z = followed_in_many_digits(velocity(regime), z, begin - now)
            paths = [arb_poly(path.coeffs()) for path in taylor(velocity(regime), z)]
            zero = late
            for _ in range(5):  # the secant through two near times
                ends = [
                    watched(regime, [path(zero + arb(h)) for path in paths])
                    for h in (0.0, 2.0**-90)
                ]
                zero = (zero - ends[0] * arb(2.0**-90) / (ends[1] - ends[0])).mid()
            z, now, regime = [path(zero).mid() for path in paths], begin + zero, modes[mode][0]
            assert abs(float(now) - time) < 1e-13
        z = followed_in_many_digits(velocity(regime), z, 6 * arb.pi() / w - now)
    found = [float(value) for value in z[:3]]
    assert abs(record.states[-1] - found).max() <= record.error[-1] < 1e-12
    assert record.time[-1] == pytest.approx(6 * pi / 1.3)
    assert record.energy_balance().error < 1e-13


def test_exponents_of_a_bob_on_a_joint_are_those_of_its_orbit() -> None:
    attractor = SWINGING.attractor(transient=150, impacts=20)
    orbit = attractor.periodic_orbit()
    assert orbit.admissible
    largest = LyapunovSpectrum(attractor, iterations=128).exponents[0]
    assert largest == pytest.approx(np.log(abs(orbit.multipliers).max()), abs=0.01)


def test_a_slider_is_named_that_is_too_far_behind_along_a_function() -> None:
    with pytest.raises(ValueError, match=r"sliders\[0\] must lie in \[-0.1, 0.1\]; got 0.3"):
        SWINGING.state([0.0], [0.0], 0.0, [0.3])
