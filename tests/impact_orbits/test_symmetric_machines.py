"""Machines whose elements switch at once: derivatives, orbits and branches.

Two equal masses under equal forces move as one, whatever the spring between them: the motion, its
multipliers and its borders are those of one mass. The other multipliers are of disturbances in
which the masses part.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from dynkit import NoConvergence, NoDerivative, continue_orbit
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop


def soft(mass: int) -> SoftStop:
    return SoftStop(mass, offset=-0.1, stiffness=20.0, damping=0.2)


def turning(mass: int) -> DryFriction:
    return DryFriction(mass, force=0.1)


def sticking(mass: int) -> DryFriction:
    return DryFriction(mass, force=0.2, static=0.25)


KINDS: dict[str, tuple[float, list[Callable[[int], Any]]]] = {
    "soft stops": (0.9, [soft]),
    "friction that turns": (0.9, [turning]),
    "friction that sticks": (0.4, [sticking]),
    "soft stops and friction": (0.9, [soft, turning]),
}


def pair(name: str, **parameters: Any) -> MatrixOscillator:
    frequency, kinds = KINDS[name]
    system = MatrixOscillator(
        M=np.eye(2),
        C=0.1 * np.eye(2),
        K=[[2.0, -0.5], [-0.5, 2.0]],
        frequency=frequency,
        harmonic_forces=(0.5, 0.5),
        elements=[kind(mass) for kind in kinds for mass in (0, 1)],
    )
    return system.replace(**parameters)


def single(name: str) -> MatrixOscillator:
    frequency, kinds = KINDS[name]
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.5]],
        frequency=frequency,
        harmonic_forces=(0.5,),
        elements=[kind(0) for kind in kinds],
    )


class Hardening(ImpactChain):
    """Two masses with springs that are not linear, alike."""

    def potential(self, x: Any) -> Any:
        own = sum(0.75 * e**2 + 0.1 * e**4 for e in x)
        return own + 0.25 * (x[1] - x[0]) ** 2

    def dissipation(self, v: Any) -> Any:
        return 0.05 * sum(e**2 for e in v)


def differences(system: Any, state: Array, step: float = 1e-6) -> Array:
    rows = step * np.eye(len(state))
    found = [system.difference(system(state + e), system(state - e)) for e in rows]
    return np.array(found).T / (2.0 * step)


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_through_events_at_once_are_those_of_differences(name: str) -> None:
    system = pair(name)
    state = system.attractor(transient=300, impacts=2).states[-1]
    exact = system.jacobian(state)
    assert abs(exact - differences(system, state)).max() < 1e-7
    found = system._followed(state, 3)[1]
    assert np.array([factor for (factor,), *_ in found]) == pytest.approx(np.array([exact] * 3))


@pytest.mark.parametrize("kind", [turning])
def test_so_are_they_with_springs_that_are_not_linear(kind: Callable[[int], Any]) -> None:
    elements = [kind(0), kind(1)]
    system = Hardening(masses=2, frequency=0.9, harmonic_forces=(0.5, 0.5), elements=elements)
    assert system.engine == "Taylor"
    state = system.attractor(transient=100, impacts=2).states[-1]
    exact = system.jacobian(state)
    assert abs(exact - differences(system, state)).max() < 1e-6
    orbit = system.attractor(transient=100, impacts=20).periodic_orbit()
    assert np.poly(orbit.multipliers) == pytest.approx(np.poly(np.linalg.eigvals(exact)), abs=1e-8)


@pytest.mark.parametrize(("name", "parameter"), [("soft stops", "elements[1].damping")])
def test_derivatives_by_parameters_are_those_of_differences(name: str, parameter: str) -> None:
    system = pair(name)
    state = system.attractor(transient=300, impacts=2).states[-1]
    for each in (parameter, "frequency"):
        value, step = system.parameters[each], 1e-6
        ends = [system.replace(**{each: value + way * step})(state) for way in (1.0, -1.0)]
        found = system.parameter_derivative(state, each)
        assert abs(found - (ends[0] - ends[1]) / (2.0 * step)).max() < 1e-6, each


@pytest.mark.parametrize("name", KINDS)
def test_orbits_hold_those_of_one_mass(name: str) -> None:
    one, two = (
        system.attractor(transient=400, impacts=40).periodic_orbit()
        for system in (single(name), pair(name))
    )
    assert two.admissible
    assert two.error < 1e-11
    assert abs(two.states[0][:1] - one.states[0][:1]).max() < 1e-12
    exact = two.system.jacobian(two.states[0])
    polynomial = np.poly(two.multipliers)
    assert polynomial == pytest.approx(np.poly(np.linalg.eigvals(exact)), abs=1e-9)
    rest = np.polydiv(polynomial, np.poly(one.multipliers))[1]
    assert abs(rest).max() < 1e-9


def test_branches_hold_the_borders_of_one_mass() -> None:
    name = "soft stops"
    one, two = (
        continue_orbit(
            system.attractor(transient=400, impacts=40).periodic_orbit(),
            "frequency",
            bounds=(0.87, 0.92),
        )
        for system in (single(name), pair(name))
    )
    (border,) = one.bifurcations
    found = [own.value for own in two.bifurcations]
    assert found
    assert found == pytest.approx([border.value] * len(found), abs=1e-9)
    beyond = two.parameter > border.value
    assert two.admissible[beyond].all()
    assert not two.admissible[~beyond & (two.parameter < border.value - 1e-6)].any()


@pytest.mark.parametrize("mass", [0, 1])
def test_a_parameter_parts_the_events(mass: int) -> None:
    # Each order of the events is a motion on one side; the border leads to the other one.
    parameter, bounds = f"elements[{mass}].offset", (-0.11, -0.09)
    orbit = pair("soft stops").attractor(transient=400, impacts=40).periodic_orbit()
    branch = continue_orbit(orbit, parameter, bounds=bounds)
    border = branch.bifurcations[0]
    assert abs(border.value + 0.1) <= border.error < 1e-10
    assert "at once" in border.touching
    (other,) = border.switch()
    sides = []
    for part in (branch, continue_orbit(other, parameter, bounds=bounds)):
        near = abs(abs(part.parameter + 0.1) - 0.005) < 0.004
        (side,) = {float(v) for v in np.sign(part.parameter + 0.1)[near & part.admissible]}
        assert (part.admissible[near] == (side * (part.parameter[near] + 0.1) > 0.0)).all()
        sides.append(side)
        there = part.orbit(int(np.flatnonzero(near & part.admissible)[-1]))
        again = there.system.attractor(transient=600, impacts=40).periodic_orbit()
        assert np.poly(there.multipliers) == pytest.approx(np.poly(again.multipliers), abs=1e-9)
    assert sorted(sides) == [-1.0, 1.0]


def hard(mass: int) -> HardStop:
    return HardStop(mass, offset=-0.1, restitution=0.7)


def above(mass: int) -> SoftStop:
    return SoftStop(mass, offset=0.05, stiffness=5.0)


def rubbing(mass: int) -> DryFriction:
    return DryFriction(mass, force=0.03)


BESIDE: dict[str, list[Callable[[int], Any]]] = {
    "hard stops": [hard],
    "hard and soft stops": [hard, above],
    "hard stops and friction": [hard, rubbing],
}


def orbit_of(system: MatrixOscillator) -> Any:
    return system.attractor(transient=400, impacts=40).periodic_orbit()


def both(name: str, **parameters: Any) -> MatrixOscillator:
    elements = [kind(mass) for kind in BESIDE[name] for mass in (0, 1)]
    return pair("soft stops", elements=elements, **parameters)


@pytest.mark.parametrize("name", BESIDE)
def test_orbits_whose_hard_stops_are_hit_at_once_hold_those_of_one_mass(name: str) -> None:
    alone = single("soft stops").replace(elements=[kind(0) for kind in BESIDE[name]])
    one, two = orbit_of(alone), orbit_of(both(name))
    assert two.admissible
    assert two.error < 1e-10
    assert two.impacts == 2 * one.impacts
    phases = np.sort(two.phases % (2.0 * np.pi))
    assert phases == pytest.approx(np.repeat(np.sort(one.phases % (2.0 * np.pi)), 2), abs=1e-12)
    rest = np.polydiv(np.poly(two.multipliers), np.poly(one.multipliers))[1]
    assert abs(rest).max() < 1e-9


def test_disturbances_that_part_the_masses_are_those_of_the_other_mode() -> None:
    # x_0 - x_1 moves by its own mode, and each impact is that of one mass.
    one = orbit_of(single("soft stops").replace(elements=[hard(0)]))
    two = orbit_of(both("hard stops"))
    phases, after = one.phases, one.relative_velocity
    whole, r = np.eye(2), 0.7
    lasts = np.append(np.diff(phases), phases[0] + 2.0 * np.pi - phases[-1]) / 0.9
    for k, phase in enumerate(np.roll(phases, -1)):
        before = -np.roll(after, -1)[k] / r
        pushed = 0.5 * np.sin(phase) + 1.5 * 0.1
        rates = [pushed - 0.1 * v for v in (before, -r * before)]
        struck = np.array([[-r, 0.0], [(rates[1] + r * rates[0]) / before, -r]])
        whole = struck @ expm(lasts[k] * np.array([[0.0, 1.0], [-2.5, -0.1]])) @ whole
    expected = np.polymul(np.poly(one.multipliers), np.poly(whole))
    assert np.poly(two.multipliers) == pytest.approx(expected, abs=1e-9)


def test_orbits_of_uncoupled_masses_have_each_multiplier_twice() -> None:
    system = both("hard stops", K=((1.5, 0.0), (0.0, 1.5)))
    one, two = orbit_of(single("soft stops").replace(elements=[hard(0)])), orbit_of(system)
    assert np.sort(two.multipliers.real) == pytest.approx(
        np.sort(np.repeat(one.multipliers.real, 2)), abs=1e-9
    )


def test_derivatives_through_impacts_at_once_are_those_of_differences() -> None:
    # on the side where the same stop is hit next: on the other one the map is another one
    system = both("hard stops")
    for state in system.attractor(transient=400, impacts=4).states:
        exact, end = system.jacobian(state), system(state)
        for k, unit in enumerate(np.eye(4)):
            for step in (1e-5, -1e-5):
                with suppress(Refused):
                    ends = [system(state + n * step * unit) for n in (1.0, 2.0)]
                    near, far = (system.difference(one, end) for one in ends)
                    if max(abs(near)) < 1e-3:
                        break
            assert abs((2.0 * near - 0.5 * far) / step - exact[:, k]).max() < 1e-7, k


def test_hard_stops_whose_impacts_change_each_other_are_refused_by_name() -> None:
    # a dashpot between the masses: an impact changes the acceleration of the other one
    joined = both("hard stops", C=((0.15, -0.05), (-0.05, 0.15)))
    attractor = joined.attractor(transient=400, impacts=40)
    with pytest.raises(NoConvergence, match="order counts"):
        attractor.periodic_orbit()
    with pytest.raises(NoDerivative, match="order counts"):
        joined.stretching(attractor.final, 40)
    # where they are parted, what each impact shrinks is known: 0.7 squared, and the dashpots
    parted = joined.replace(**{"elements[0].offset": -0.1001})
    found = parted.stretching(parted.attractor(transient=400, impacts=40).final, 40)
    assert found.times is not None
    expected = 40 * 2.0 * np.log(0.7) - 0.3 * found.times.sum()
    assert found.logs.sum() == pytest.approx(expected, rel=1e-9)


def test_friction_that_acts_on_both_masses_is_refused_where_it_turns_at_once() -> None:
    attractor = pair("friction that turns", M=((1.0, 0.2), (0.2, 1.0))).attractor(
        transient=400, impacts=40
    )
    with pytest.raises(NoConvergence, match="order counts"):
        attractor.periodic_orbit()


def test_contacts_at_once_are_those_of_one_mass() -> None:
    tables = [HardStop(mass, offset=-0.1, restitution=0.0) for mass in (0, 1)]
    given: dict[str, Any] = {"frequency": 0.4}
    one = orbit_of(single("soft stops").replace(elements=tables[:1], **given))
    two = orbit_of(pair("soft stops").replace(elements=tables, **given))
    assert two.admissible
    assert two.phases[0] % np.pi == pytest.approx(one.phases[0] % np.pi, abs=1e-8)
    assert abs(two.multipliers).max() == 0.0


@pytest.mark.parametrize(
    ("restitution", "frequency", "force", "damping", "offset", "spring"),
    [
        (0.6070448756787409, 0.38048654558455347, 0.5346467284194154, 0.105212, -0.0214942, 0.0),
        (0.33958346153054364, 0.6587073396441081, 0.3684939968216021, 0.0624087, -0.0969771, 0.2),
        (0.5186417298860712, 0.4569071361112158, 0.2727182593169764, 0.0985287, -0.0931212, 0.0),
        (0.39145662690272054, 0.42486792953253877, 0.632228699846661, 0.145192, -0.0932572, 0.0),
        (0.4010271742908449, 0.5696677031032442, 0.2815245211731731, 0.0959580, -0.0579185, 0.0),
    ],
)
def test_stops_that_chatter_at_once_have_admissible_orbits(
    restitution: float, frequency: float, force: float, damping: float, offset: float, spring: float
) -> None:
    """The order of the slowest bounces is rounding."""
    machine = MatrixOscillator(
        M=np.eye(2),
        C=damping * np.eye(2),
        K=[[1.0 + spring, -spring], [-spring, 1.0 + spring]],
        frequency=frequency,
        harmonic_forces=[force, force],
        constant_forces=[-0.2, -0.2],
        elements=[HardStop(k, offset=offset, restitution=restitution) for k in (0, 1)],
    )
    orbit = machine.attractor(transient=300, impacts=60).periodic_orbit()
    assert orbit.label == "P(inf,1)"
    assert orbit.admissible


def test_a_parameter_parts_impacts_and_the_branch_holds_both_orders() -> None:
    parameter, bounds = "elements[0].offset", (-0.11, -0.09)
    orbit = orbit_of(both("hard stops"))
    branch = continue_orbit(orbit, parameter, bounds=bounds)
    assert branch.admissible.all()
    for border in branch.bifurcations:
        assert abs(border.value + 0.1) <= border.error < 1e-10
        assert "at once" in border.touching
    for number in (0, len(branch.parameter) - 1):
        there = branch.orbit(number)
        again = there.system.attractor(transient=600, impacts=40).periodic_orbit()
        assert np.poly(there.multipliers) == pytest.approx(np.poly(again.multipliers), abs=1e-9)


def test_a_parameter_parts_impacts_and_switches_of_soft_stops() -> None:
    parameter, bounds = "elements[0].offset", (-0.102, -0.098)
    orbit = orbit_of(both("hard and soft stops"))
    branch = continue_orbit(orbit, parameter, bounds=bounds)
    border = branch.bifurcations[0]
    assert abs(border.value + 0.1) <= border.error < 1e-10
    (other,) = border.switch()
    sides = []
    for part in (branch, continue_orbit(other, parameter, bounds=bounds)):
        near = abs(part.parameter + 0.1) > 1e-4
        (side,) = {float(v) for v in np.sign(part.parameter + 0.1)[near & part.admissible]}
        assert (part.admissible[near] == (side * (part.parameter[near] + 0.1) > 0.0)).all()
        sides.append(side)
    assert sorted(sides) == [-1.0, 1.0]


def test_searches_find_orbits_whose_hard_stops_are_hit_at_once() -> None:
    system = both("hard stops")
    found = [orbit for orbit in system.find_orbits(impacts=4, periods=1) if orbit.admissible]
    own = orbit_of(system)
    assert [abs(orbit.phases - own.phases[0]).min() < 1e-9 for orbit in found] == [True]


def test_a_branch_of_a_pair_takes_as_long_steps_as_that_of_one_mass() -> None:
    # no time passes between events at once: what is seen there is rounding, and parts no steps
    stops = [
        kind
        for mass in (0, 1)
        for kind in (
            HardStop(mass, offset=-0.3, restitution=0.6),
            SoftStop(mass, offset=0.3, side="below", stiffness=20.0, damping=0.3),
        )
    ]
    one, two = (
        continue_orbit(orbit_of(system.replace(frequency=0.7)), "frequency", bounds=(0.6, 0.9))
        for system in (
            single("soft stops").replace(elements=stops[:2]),
            pair("soft stops", elements=stops),
        )
    )
    found = [border.value for border in one.bifurcations]
    # beside the borders, a border of each mass divides its own steps
    alone, both = (
        int((abs(np.subtract.outer(branch.parameter, found)).min(axis=1) > 0.01).sum())
        for branch in (one, two)
    )
    assert both <= 1.2 * alone
    again = sorted({round(border.value, 9) for border in two.bifurcations})
    assert again == pytest.approx(sorted(found), abs=1e-9)
