"""Coulomb friction along functions of the coordinates.

Closed forms, Painleve's rod, and linear machines in other coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from dynkit import CannotFollow, continue_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.systems import DryFriction, HardStop, ImpactChain, ImpactOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact.disguised import DisguisedMatrices
from tests.impact.test_coulomb import beside_others, random_machine
from tests.impact.test_elements_along_functions import Chain, time_between
from tests.impact_orbits.bent_cases import WIDE, orbits_agree, orbits_of

# --- closed forms ---------------------------------------------------------------------------------


class Bowl(ImpactOscillator):
    """A bead of mass one within a round bowl of radius one, under weight one."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return x[1]

    def depth(self, x: Any) -> Any:
        """Return the distance from the bowl."""
        return 1 - sp.sqrt(x[0] ** 2 + x[1] ** 2)

    def angle(self, x: Any) -> Any:
        """Return the angle from the lowest point, which is the length along the bowl."""
        return sp.atan2(x[0], -x[1])


def bowl(coefficient: float, static: float) -> Bowl:
    sole = DryFriction("angle", coefficient=coefficient, static=static, normal="bowl", name="sole")
    return Bowl(frequency=1.0, elements=[HardStop("depth", restitution=0.0, name="bowl"), sole])


def test_a_bead_slides_in_a_rough_bowl_until_it_sticks_as_in_closed_form() -> None:
    # In each swing, counted upwards: (w^2)' = -2 sin - 2 mu (cos + w^2) by the angle.
    system, begin = bowl(0.15, 0.2), 1.2
    record = system.simulate(
        impacts=1, start=system.state([np.sin(begin), -np.cos(begin)], [0.0, 0.0])
    )
    with mp.workdps(40):
        mu, static, turn = mp.mpf(0.15), mp.mpf(0.2), -mp.mpf(begin)
        a, b = (2 - 4 * mu**2) / (1 + 4 * mu**2), -6 * mu / (1 + 4 * mu**2)
        time, halts, turns = mp.mpf(0), [], []
        while abs(mp.tan(turn)) > static:

            def squared(x: Any, turn: Any = turn) -> Any:
                start = a * mp.cos(turn) + b * mp.sin(turn)
                faded = start * mp.exp(-2 * mu * (x - turn))
                return a * mp.cos(x) + b * mp.sin(x) - faded

            fastest = -mp.atan(mu)
            other = mp.findroot(squared, (fastest, -turn), solver="anderson")

            def speed(x: Any, squared: Any = squared) -> Any:
                return mp.sqrt(squared(x))

            time += time_between(speed, turn, fastest) + time_between(speed, other, fastest)
            halts.append(time)
            turns.append(other)
            turn = -other
    events = record.events
    stops = [i for i, place in enumerate(events.velocity) if i and abs(place).max() < 1e-12]
    assert len(halts) == 3
    found = sorted({round(float(t), 9) for t in events.time[stops]})
    assert len(found) == len(halts)
    final = np.arctan2(record.final.position[0], -record.final.position[1])
    assert abs(final) == pytest.approx(float(turns[-1]), abs=1e-13)
    for one in halts:
        assert min(abs(events.time - float(one))) < 1e-12
    force = record.observable("bowl.contact_force", np.array([0.5, events.time[-1]]))
    assert force[1] == pytest.approx(float(mp.cos(turns[-1])), abs=1e-12)


# --- Painleve's rod -------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Rod(ImpactOscillator):
    """A rod of half length one, (x, y, angle), whose lower tip is on rough ground."""

    degrees_of_freedom = 3

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 3) / 2

    def potential(self, x: Any) -> Any:
        return x[1]

    def tip(self, x: Any) -> Any:
        """Return the height of the tip."""
        return x[1] - sp.sin(x[2])

    def foot(self, x: Any) -> Any:
        """Return the place of the tip along the ground."""
        return x[0] - sp.cos(x[2])


def rod(coefficient: float) -> Rod:
    foot = DryFriction("foot", coefficient=coefficient, normal="ground", name="foot")
    ground = HardStop("tip", restitution=0.0, name="ground")
    return Rod(frequency=1.0, elements=[ground, foot])


def on_the_ground(angle: float, speed: float, turning: float) -> tuple[list[float], list[float]]:
    s, c = np.sin(angle), np.cos(angle)
    return [c, s, angle], [speed - s * turning, c * turning, turning]


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_a_rod_slides_on_its_tip_as_newton_says(speed: float) -> None:
    # The contact force N and the friction act at the tip: its acceleration upwards is zero.
    mu, system = 0.3, rod(0.3)
    place, velocity = on_the_ground(1.0, speed, 0.2)

    def forces(angle: Any, turning: Any) -> Any:
        s, c = np.sin(angle), np.cos(angle)
        arm = -c - mu * np.sign(speed) * s  # of both forces about the centre, over N
        return (1.0 - s * turning**2) / (1.0 - 3.0 * c * arm), arm

    def rates(_: float, z: Any) -> Any:
        normal, arm = forces(z[2], z[5])
        return [*z[3:], -mu * np.sign(speed) * normal, normal - 1.0, 3.0 * arm * normal]

    given: Any = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}
    times = np.linspace(0.0, 0.6, 4)
    expected = solve_ivp(rates, (0.0, 0.6), [*place, *velocity], t_eval=times, **given).y
    record = system.simulate(impacts=1, start=system.state(place, velocity))
    assert record.events.time[1:].min() > 0.6
    found = np.concatenate(record.sample(times), axis=1).T
    assert abs(found - expected).max() < 1e-12
    normal = [forces(z[2], z[5])[0] for z in expected.T]
    assert record.observable("ground.contact_force", times) == pytest.approx(normal, abs=1e-12)
    rubbed = record.observable("foot.friction_force", times)
    assert rubbed == pytest.approx(-mu * np.sign(speed) * np.array(normal), abs=1e-12)


def test_a_rod_whose_contact_force_has_no_unique_value_ends_by_name() -> None:
    # 1 + 3 cos^2 - 3 mu sin cos < 0
    system = rod(2.0)
    record = system.simulate(impacts=1, start=system.state(*on_the_ground(1.1, -1.0, 0.0)))
    assert record.ending is Ending.PARADOX


def test_an_impact_of_a_rod_on_rough_ground_has_no_unique_outcome() -> None:
    place, velocity = on_the_ground(1.0, 1.5, 0.2)
    system, place[1] = rod(0.3), place[1] + 0.1
    record = system.simulate(impacts=1, start=system.state(place, velocity))
    assert record.ambiguous == 0
    assert np.isinf(record.error).all()


# --- linear machines in other coordinates ---------------------------------------------------------

PUSH, PULL = 0.35, 0.1
"""Harmonic forces on the two masses."""


@dataclass(frozen=True, kw_only=True)
class Pulled(Chain):
    """A bent chain of two masses that forces drive."""

    press: float = 0.1

    def potential(self, x: Any, phase: Any) -> Any:  # type: ignore[override]
        first, last = self.places(x)
        driven = sp.sin(phase) * (sp.Float(PUSH) * first + sp.Float(PULL) * last)
        return super().potential(x) + self.press * last - driven


CASES: dict[str, tuple[tuple[Any, Any], dict[str, float], dict[str, Any]]] = {
    "impacts": (("first", "end"), {"frequency": 0.9, "press": 0.1}, {}),
    "chatter": (("first", "end"), {"frequency": 0.5, "press": 0.3}, {"restitution": 0.3}),
    "belt": (
        ("first", "end"),
        {"frequency": 0.7, "press": 0.11},
        {"restitution": 0.0, "velocity": 0.2, "static": 0.4},
    ),
    "straight stop": (("first", 1), {"frequency": 0.7, "press": 0.11}, {"restitution": 0.3}),
    "straight friction": ((0, "end"), {"frequency": 0.5, "press": 0.3}, {"restitution": 0.3}),
}


@cache
def both(name: str) -> tuple[Any, Any]:
    """The chain, and the bent one; straight where an element acts along a coordinate."""
    places, given, own = CASES[name]
    own = dict(own)
    restitution = own.pop("restitution", 0.6)

    def elements(first: Any, last: Any) -> list[Any]:
        table = HardStop(last, amplitude=0.2, restitution=restitution, name="table")
        sole = DryFriction(first, coefficient=0.3, normal="table", name="sole", **own)
        return [table, sole]

    alike: Any = {"masses": 2, "damping": 0.15, "frequency": given["frequency"]}
    forces: Any = {"harmonic_forces": [PUSH, PULL], "constant_forces": [0.0, -given["press"]]}
    exact = ImpactChain(elements=elements(0, 1), **alike, **forces)
    bends: Any = {"bend": 0.0 if places[0] == 0 else 0.1, "last": 0.0 if places[1] == 1 else 0.12}
    return exact, Pulled(elements=elements(*places), press=given["press"], **alike, **bends)


def starts(name: str) -> tuple[Any, Any]:
    exact, bent = both(name)
    q = np.array([0.3, 0.2])
    x = [float(place) for place in bent.places(q)]
    return exact.state(x, [0.0, 0.0]), bent.state(q, [0.0, 0.0])


@pytest.mark.parametrize("name", CASES)
def test_motions_forces_and_heat_are_those_of_the_chain(name: str) -> None:
    bent = both(name)[1]
    one, two = (
        m.simulate(impacts=16, start=s) for m, s in zip(both(name), starts(name), strict=True)
    )
    bound = one.error[-1] + two.error[-1]
    assert bound < 1e-11
    assert repr(one.events) == repr(two.events)
    assert (len(one.sticking) > 0) is (name != "impacts")
    assert abs(one.position - np.array(bent.places(two.position.T)).T).max() <= bound
    times = np.linspace(0.0, 0.999 * float(one.time[-1]), 50)
    for what in ("table.contact_force", "sole.friction_force", "sole.slip_velocity"):
        seen = [record.observable(what, times) for record in (one, two)]
        assert seen[0] == pytest.approx(seen[1], abs=1e-11)
    heat = two.energy_balance()
    assert heat.error < 1e-12
    assert heat.dissipated == pytest.approx(one.energy_balance().dissipated, abs=1e-12)
    assert heat.dissipated["sole"] > 0.0
    half = bent.simulate(impacts=8, start=starts(name)[1]).final
    assert (bent.simulate(impacts=8, start=half).states == two.states[8:]).all()


@pytest.mark.parametrize("name", ["impacts", "straight stop"])
def test_the_derivative_of_the_map_is_that_of_differences(name: str) -> None:
    system = both(name)[1]
    states = system.simulate(impacts=8, start=starts(name)[1]).states
    free = [state for state in states if not system.impact_state(state).closed]
    jacobian_is_the_derivative(system, np.array(free[:3]))


PARAMETERS = {
    "impacts": ["sole.coefficient", "table.restitution", "sole.velocity", "frequency"],
    "chatter": ["sole.coefficient", "table.amplitude", "damping"],
    "belt": ["sole.static", "sole.coefficient", "sole.velocity"],
    "straight stop": ["sole.coefficient", "table.restitution"],
    "straight friction": ["sole.coefficient", "table.restitution"],
}


@cache
def orbits(name: str) -> tuple[Any, Any]:
    return orbits_of(*both(name), starts(name)[0])


@pytest.mark.parametrize("name", PARAMETERS)
def test_orbits_and_their_derivatives_are_those_of_the_chain(name: str) -> None:
    orbits_agree(*orbits(name), PARAMETERS[name])


def test_a_branch_meets_the_bifurcations_of_the_chain() -> None:
    found = [
        continue_orbit(orbit, "sole.coefficient", bounds=(0.26, 0.38), **WIDE).bifurcations
        for orbit in orbits("impacts")
    ]
    assert len(found[0]) == len(found[1]) > 0
    for known, other in zip(*found, strict=True):
        assert known.kind is other.kind
        assert known.admissible == other.admissible
        assert abs(known.value - other.value) <= known.error + other.error


def test_exponents_are_those_of_the_orbit() -> None:
    attractor = both("impacts")[1].attractor(transient=60, keep=60, start=starts("impacts")[1])
    spectrum = LyapunovSpectrum(attractor, iterations=129)
    orbit = orbits("impacts")[1]
    expected = np.log(abs(orbit.multipliers[:3])) / len(orbit.impulses)
    assert (abs(spectrum.exponents[:3] - expected) <= 3.0 * spectrum.error[:3] + 1e-9).all()


def named(machine: Any) -> Any:
    """The same machine, whose stops and friction act along functions."""
    elements, functions = [], {}
    for k, element in enumerate(machine.elements):
        if isinstance(element, HardStop | DryFriction):
            index = element.coordinate
            functions[f"y{k}"] = lambda self, x, index=index: x[index]
            element = replace(element, coordinate=f"y{k}")
        elements.append(element)
    kind: Any = type("Named", (DisguisedMatrices,), functions)
    same = "M", "C", "K", "frequency", "harmonic_forces", "constant_forces"
    return kind(elements=elements, **{name: getattr(machine, name) for name in same})


@pytest.mark.parametrize(
    ("make", "given"),
    [(random_machine, (2, 0.0)), (random_machine, (5, 0.6)), (beside_others, (2,))],
)
def test_random_machines_move_as_by_the_exact_engine(make: Any, given: Any) -> None:
    machine, place, velocity = make(*given)
    other = named(machine)
    one = machine.simulate(impacts=8, start=machine.state(place, velocity))
    two = other.simulate(impacts=8, start=other.state(place, velocity))
    assert repr(one.events) == repr(two.events)
    within = (one.error + two.error)[:, None]
    assert within.max() < 1e-9
    assert (abs(one.position - two.position) <= within).all()
    assert (abs(one.velocity - two.velocity) <= within).all()


# --- what is refused ------------------------------------------------------------------------------


def test_friction_along_the_function_of_a_stop_is_refused_by_name() -> None:
    rub = DryFriction("depth", coefficient=0.1, normal="bowl")
    with pytest.raises(NotImplementedError, match=r"elements\[1\].*must not act along a hard stop"):
        Bowl(frequency=1.0, elements=[HardStop("depth", name="bowl"), rub])


def test_friction_whose_gradient_meets_that_of_its_stop_is_refused_where_it_happens() -> None:
    class Twice(Bowl):
        def height(self, x: Any) -> Any:
            """Return the square of the distance from the centre."""
            return x[0] ** 2 + x[1] ** 2

    rub = DryFriction("height", coefficient=0.1, normal="bowl")
    bead = Twice(frequency=1.0, elements=[HardStop("depth", restitution=0.0, name="bowl"), rub])
    with pytest.raises(CannotFollow, match="must not act along what stops hold"):
        bead.simulate(impacts=2, start=bead.state([0.5, 0.0], [0.1, 0.0]))
