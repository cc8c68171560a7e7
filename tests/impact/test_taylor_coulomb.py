"""Friction at contacts beside springs that are not linear: closed forms, and the exact engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit import continue_orbit
from dynkit.systems import DryFriction, HardStop, ImpactOscillator
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact.disguised import disguised
from tests.impact.test_coulomb import beside_others, block, coupled, dropped, random_machine
from tests.impact.test_rough_stops import bouncing_beside_friction

# --- closed forms --------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Puck(ImpactOscillator):
    """A puck on ice within a ring of radius one: its distance from the ring, and its angle."""

    degrees_of_freedom = 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return (v[0] ** 2 + (1 - x[0]) ** 2 * v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return 0 * x[0]


def puck(coefficient: float, restitution: float) -> Puck:
    ring = HardStop(0, restitution=restitution, name="ring")
    rubs = DryFriction(1, coefficient=coefficient, normal="ring", name="rubber")
    return Puck(frequency=1.0, elements=[ring, rubs])


@pytest.mark.parametrize("restitution", [0.0, 0.4])
def test_a_puck_within_a_rough_ring_moves_along_chords_and_then_along_the_ring(
    restitution: float,
) -> None:
    # Chord n takes 2 u/(u^2 + w^2), u = u_0 r^n, and ends with the impulse (1 + r) u.
    mu, u, w, r = 0.1, 0.8, 1.5, restitution
    system = puck(mu, r)
    start = system.state([0.0, 0.0], [u, w])
    record = system.simulate(impacts=200, start=start)
    time, speeds, times = 0.0, [], []
    for _ in range(len(record)):
        time, w = time + 2.0 * u / (u * u + w * w), w - mu * (1.0 + r) * u
        u *= r
        times.append(time)
        speeds.append(w)
    assert record.time == pytest.approx(times, rel=1e-13)
    assert record.velocity[:, 1] == pytest.approx(speeds, rel=1e-13)
    # Along the ring N = w^2, so w' = -mu w^2.
    for _ in range(80):
        time, w, u = time + 2.0 * u / (u * u + w * w), w - mu * (1.0 + r) * u, r * u
    assert record.sticking[0, 0] == pytest.approx(time, rel=1e-13)
    late = float(record.events.time[-1]) - time
    found = record.final.velocity[1]  # of contact, which begins before the bounces are over
    assert found == pytest.approx(w / (1.0 + mu * w * late), rel=1e-12)
    assert record.ending.name == "SEARCH_LIMIT"  # it never comes to rest


@dataclass(frozen=True, kw_only=True)
class Pressed(ImpactOscillator):
    """A block on a slope, (x, y), whose press gets stronger by x^2 along the slope."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 * x[1]


@pytest.mark.parametrize("static", [0.5, 0.9])
def test_a_block_that_is_pressed_ever_harder_comes_to_rest_as_its_energy_says(
    static: float,
) -> None:
    # N = 1 + x^2: v^2/2 = v_0^2/2 + (g - mu) x - mu x^3/3.
    mu, pull, speed = 0.5, 0.3, 1.2
    table = HardStop(1, restitution=0.3, name="slope")
    sole = DryFriction(0, coefficient=mu, static=static, normal="slope", name="sole")
    system = Pressed(frequency=1.0, constant_forces=[pull, -1.0], elements=[table, sole])
    record = system.simulate(impacts=1, start=system.state([0.0, 0.0], [speed, 0.0]))
    with mp.workdps(30):
        m, g, v = mp.mpf(mu), mp.mpf(pull), mp.mpf(speed)

        def squared(x: Any) -> Any:
            return v**2 + 2 * (g - m) * x - 2 * m * x**3 / 3

        end = mp.findroot(squared, 1.0)

        def inverse(z: Any) -> Any:  # over v, with x = end - z^2; squared = (end - x) (...)
            x = end - z**2
            return 2 / mp.sqrt(2 * m * (x**2 + x * end + end**2) / 3 + 2 * (m - g))

        lasts = mp.quad(inverse, [0, mp.sqrt(end)])
    events = record.events
    assert events.position[-1, 0] == pytest.approx(float(end), rel=1e-13)
    assert events.time[-1] == pytest.approx(float(lasts), rel=1e-12)
    lost = record.system.simulate(impacts=1, start=system.state([0.0, 0.2], [speed, 0.0]))
    balance = lost.energy_balance()
    assert balance.error < 1e-13
    assert balance.dissipated["sole"] > 0.0


# --- the exact engine ----------------------------------------------------------------------------


def compared(machine: Any, place: Any, velocity: Any, impacts: int) -> None:
    """A machine moves by both engines alike, to within the errors of both."""
    other = disguised(machine)
    assert other.engine == "Taylor"
    one = machine.simulate(impacts=impacts, start=machine.state(place, velocity))
    two = other.simulate(impacts=max(len(one), 1), start=other.state(place, velocity))
    assert len(one) == len(two) >= 1
    assert (
        abs(machine.difference(one.states, two.states)).max(axis=1) <= one.error + two.error
    ).all()
    if one.ending.name == "COUNT_REACHED":
        assert repr(one.events) == repr(two.events)
    times = np.linspace(0.0, 0.99 * float(one.time[-1]), 20)
    for what in (each for each in machine.observables if each.endswith("force")):
        forces = one.observable(what, times), two.observable(what, times)
        assert abs(forces[0] - forces[1]).max() < 1e-9
    balances = one.energy_balance(), two.energy_balance()
    assert balances[1].error < 1e-12
    for source, lost in balances[0].dissipated.items():
        assert balances[1].dissipated[source] == pytest.approx(lost, abs=1e-11)


@pytest.mark.parametrize(
    ("seed", "restitution"), [(2, 0.0), (5, 0.0), (8, 0.0), (3, 0.6), (8, 0.6), (10, 0.6)]
)
def test_random_machines_move_as_by_the_exact_engine(seed: int, restitution: float) -> None:
    compared(*random_machine(seed, restitution), 8)


@pytest.mark.parametrize("seed", [1, 4, 9])
def test_machines_with_other_elements_move_as_by_the_exact_engine(seed: int) -> None:
    compared(*beside_others(seed), 6)


@pytest.mark.parametrize(
    ("coefficient", "velocity", "push", "pull"), [(0.3, 0.0, 1.0, 0.0), (0.8, 0.0, 0.0, 0.5)]
)
def test_the_tail_of_a_chatter_is_right_to_its_error(
    coefficient: float, velocity: float, push: float, pull: float
) -> None:
    exact = dropped(pull, coefficient, 0.6, 1e-16, velocity)
    start = [0.0, 0.3], [push, 0.0]
    fine = exact.simulate(impacts=300, start=exact.state(*start))
    for tolerance in (1e-6, 1e-10):
        machine = disguised(dropped(pull, coefficient, 0.6, tolerance, velocity))
        record = machine.simulate(impacts=300, start=machine.state(*start))
        assert len(record) < len(fine)
        assert 0.0 < record.chatter_error <= tolerance
        apart = abs(record.events.position[-1] - fine.events.position[-1]).max()
        assert apart <= record.chatter_error + 1e-14


@cache
def by_both(seed: int) -> tuple[Any, Any, Any]:
    machine, place, velocity = random_machine(seed, 0.0 if seed > 10 else 0.3)
    record = machine.simulate(impacts=10, start=machine.state(place, velocity))
    return machine, disguised(machine), record.states


@pytest.mark.parametrize("seed", [1, 8, 13, 15])
def test_derivatives_are_those_of_the_exact_engine(seed: int) -> None:
    machine, other, states = by_both(seed)
    free = [state for state in states if not machine.impact_state(state).closed][:4]
    assert len(free) >= 3
    columns = np.arange(machine.dimension) != machine.dimension - 2  # stops rebound one way only
    for state in free:
        one, two = machine.jacobian(state), other.jacobian(state)
        assert abs(one - two)[:, columns].max() < 1e-12 * max(1.0, abs(one).max())


def test_the_derivative_of_the_map_of_a_puck_is_that_of_differences() -> None:
    system = puck(0.1, 0.8)
    states = system.simulate(impacts=4, start=system.state([0.0, 0.0], [0.8, 1.5])).states
    jacobian_is_the_derivative(system, states)


def test_the_map_gives_the_section_of_the_stop_that_was_hit_while_another_holds() -> None:
    machine, place, velocity = random_machine(8, 0.0)
    other = disguised(machine)
    states = other.simulate(impacts=4, start=other.state(place, velocity)).states
    assert abs(other.difference(other(states[0]), states[1])).max() < 1e-12
    assert abs(other.difference(machine(states[0]), states[1])).max() < 1e-12


def test_orbits_and_branches_are_those_of_the_exact_engine() -> None:
    machine = sliding(1.2, 0.6)
    found = []
    for system in (machine, disguised(machine)):
        orbit = system.attractor(transient=60, impacts=30).periodic_orbit()
        branch = continue_orbit(orbit, "sole.coefficient", bounds=(0.27, 0.3))
        found.append((orbit, branch))
    (one, first), (two, second) = found
    assert one.states == pytest.approx(two.states, abs=1e-11)
    assert abs(one.multipliers) == pytest.approx(abs(two.multipliers), abs=1e-9)
    kinds = [
        [(b.kind, round(float(b.value), 9)) for b in each.bifurcations] for each in (first, second)
    ]
    assert kinds[0] == kinds[1] != []


def sliding(amplitude: float, restitution: float) -> Any:
    machine = block(coefficient=0.3)
    return machine.replace(
        M=np.eye(2),
        C=0.1 * np.eye(2),
        K=[[1.0, -0.2], [-0.2, 0.5]],
        frequency=1.1,
        constant_forces=[0.0, -0.4],
        elements=[
            HardStop(1, amplitude=amplitude, restitution=restitution, name="table"),
            DryFriction(0, coefficient=0.3, normal="table", velocity=0.2, name="sole"),
        ],
    )


def test_a_contact_force_without_a_unique_value_ends_the_motion_by_name() -> None:
    rod = disguised(coupled(2.5, 5.0))
    record = rod.simulate(impacts=3, start=rod.state([0.0, 0.0], [0.0, 0.0]))
    assert record.ending.name == "PARADOX"
    assert len(record) == 0
    falls = disguised(coupled(0.3, 5.0))
    record = falls.simulate(impacts=1, start=falls.state([0.0, 0.5], [0.0, 0.0]))
    assert record.ambiguous == 0
    assert record.error[0] == np.inf


def test_runs_go_on_bit_for_bit() -> None:
    ring = puck(0.1, 0.8)
    begin = ring.state([0.0, 0.0], [0.8, 1.5])
    others = (disguised(sliding(1.2, 0.6)), disguised(sliding(2.5, 0.0)))
    for system, start in ((ring, begin), *((other, None) for other in others)):
        whole, half = (system.simulate(impacts=k, start=start) for k in (12, 6))
        rest = system.simulate(impacts=6, start=half.final)
        assert rest.states.tobytes() == whole.states[6:].tobytes()


@pytest.mark.parametrize("tolerance", [1e-10, 1e-16])
@pytest.mark.parametrize("seed", [17, 46])
def test_a_chatter_is_not_cut_where_its_bounces_make_friction_elsewhere_slip(
    seed: int, tolerance: float
) -> None:
    # Nor does a mass pass its stop where friction switches in the middle of the lowest bounces.
    pair, start = bouncing_beside_friction(seed), ([0.0, 0.3], [0.0, 0.0])
    exact = pair.simulate(impacts=200, start=pair.state(*start))
    other = disguised(pair.replace(chatter_tolerance=tolerance))
    found = other.simulate(impacts=70, start=other.state(*start))
    assert found.sticking[0, 0] == pytest.approx(exact.sticking[0, 0], abs=1e-8)
    one, two = (record.events for record in (exact, found))
    x, y = (events.position[events.kind == 1][0] for events in (one, two))
    v, w = (events.velocity[events.kind == 1][0] for events in (one, two))
    assert x == pytest.approx(y, abs=2e-10)
    assert v == pytest.approx(w, abs=2e-10)


def test_derivatives_of_the_lowest_bounces_are_those_of_the_exact_engine() -> None:
    machine = dropped(0.0, 0.3, 0.6, 1e-50)
    other = disguised(machine)
    record = machine.simulate(impacts=60, start=machine.state([0.0, 0.3], [1.0, 0.0]))
    assert record.relative_velocity[56] < 1e-12
    for state in record.states[[0, 20, 36, 56]]:
        one, two = machine.jacobian(state), other.jacobian(state)
        assert abs(one - two).max() < 1e-13 * max(1.0, abs(one).max())
