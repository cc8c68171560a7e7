"""Elements of nonlinear machines along rows that depend on one another.

The exact engine, fifty digits from energies, and motions known from symmetry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from dynkit import continue_orbit
from dynkit.systems import (
    DryFriction,
    FPUTChain,
    HardStop,
    ImpactChain,
    Jenkins,
    SoftStop,
)
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact.disguised import DisguisedMatrices
from tests.impact.taylor_cases import Disguised, UnitMasses
from tests.reference.random_machines import random_machine

TABLE = HardStop(-1, amplitude=0.1, restitution=0.6, name="table")

MACHINES: dict[str, dict[str, Any]] = {
    "friction along a stop": {
        "masses": 2,
        "frequency": 0.9,
        "elements": [TABLE, DryFriction(-1, force=0.03, static=0.05)],
    },
    "chatter and rest with friction": {
        "masses": 1,
        "frequency": 0.4,
        "constant_forces": [-0.3],
        "elements": [
            HardStop(0, amplitude=0.3, restitution=0.4),
            DryFriction(0, force=0.1, amplitude=0.3),
        ],
    },
    "a belt along a table that moves": {
        "masses": 1,
        "frequency": 0.5,
        "elements": [
            HardStop(0, amplitude=0.3, restitution=0.4),
            DryFriction(0, force=0.05, velocity=0.1),
        ],
    },
    "three stops, two masses": {
        "masses": 2,
        "frequency": 0.8,
        "harmonic_forces": [0.3, 0.6],
        "elements": [
            HardStop(0, offset=-0.3, restitution=0.5),
            HardStop(1, offset=-0.3, restitution=0.5),
            HardStop((0, 1), offset=-0.35, restitution=0.4),
        ],
    },
    "three frictions, two masses": {
        "masses": 2,
        "frequency": 0.6,
        "harmonic_forces": [0.0, 0.9],
        "elements": [
            DryFriction(0, force=0.14),
            DryFriction(1, force=0.2, velocity=-0.2),
            DryFriction((0, 1), force=0.1, velocity=0.05),
        ],
    },
    "a preload and a joint along a stop": {
        "masses": 1,
        "frequency": 0.9,
        "elements": [
            HardStop(0, amplitude=0.1, restitution=0.6),
            SoftStop(0, offset=0.1, stiffness=10.0, damping=0.2, preload=0.02),
            Jenkins(0, stiffness=2.0, force=0.05),
            DryFriction(0, force=0.01, velocity=0.03),
        ],
    },
}


def agree(exact: Any, other: Any, impacts: int, start: Any = None) -> None:
    """Assert that both engines see the same events, and the same motion within their errors."""
    assert (exact.engine, other.engine) == ("exponential sums", "Taylor")
    begin = None
    if start is not None:
        given = start.position, start.velocity
        begin = other.state(*given, phase=start.phase, sliders=start.sliders)
    one = exact.simulate(impacts=impacts, start=start)
    two = other.simulate(impacts=impacts, start=begin)
    assert one.ending == two.ending
    assert one.events.element.tolist() == two.events.element.tolist()
    assert one.events.kind.tolist() == two.events.kind.tolist()
    within = 8.0 * (one.error + two.error)
    for name in ("position", "velocity", "sliders"):
        apart = abs(getattr(one, name) - getattr(two, name)).max(axis=1, initial=0.0)
        assert (apart <= within).all()
    assert two.energy_balance().error < 1e-12


@pytest.mark.parametrize("name", MACHINES)
def test_linear_machines_move_as_by_the_exact_engine(name: str) -> None:
    agree(ImpactChain(**MACHINES[name]), Disguised(**MACHINES[name]), 6)


@pytest.mark.parametrize("number", [37, 74, 121, 430])
def test_random_machines_move_as_by_the_exact_engine(number: int) -> None:
    exact, start = random_machine(number)
    structure, n = exact._structure, exact.degrees_of_freedom
    names = ("frequency", "harmonic_forces", "constant_forces", "elements", "chatter_tolerance")
    matrices = (structure.mass, structure.damping, structure.stiffness)
    m, c, k = (tuple(map(tuple, part[:n, :n].tolist())) for part in matrices)
    given = {name: getattr(exact, name) for name in names}
    agree(exact, DisguisedMatrices(M=m, C=c, K=k, **given), 5, start)


# --- fifty digits and symmetries ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Cubic(UnitMasses):
    """Unit masses, each on a spring of its own with force x + x^3."""

    def potential(self, x: Any) -> Any:
        return sum(energy(y) for y in x)


def energy(x: Any) -> Any:
    """Potential energy of one spring."""
    return x**2 / 2 + x**4 / 4


def falling(top: Any, force: Any) -> Any:
    """Time of a fall from rest at x = top to 0, with a constant force besides the spring's."""

    def slowness(s: Any) -> Any:  # over s, where x = top - s^2
        x = top - s**2
        return 2 / mp.sqrt((top + x) * (1 + (top**2 + x**2) / 2) + 2 * force)

    return mp.quad(slowness, [0, mp.sqrt(top)])


def test_bounces_against_friction_along_the_stop_have_their_times_to_rounding() -> None:
    # weight 1, friction 1/8: on the way up the force is 9/8, on the way down 7/8
    machine = Cubic(
        frequency=1.0,
        constant_forces=[-1.0],
        elements=[HardStop(0, restitution=0.75), DryFriction(0, force=0.125)],
    )
    record = machine.simulate(impacts=9, start=machine.state([0.0], [1.0]))
    with mp.workdps(50):
        speed, time, up, down = mp.mpf(1), mp.mpf(0), mp.mpf(9) / 8, mp.mpf(7) / 8
        for impact in range(9):
            left = speed**2 / 2
            top = mp.findroot(lambda x, left=left: energy(x) + up * x - left, left / up)
            time += falling(top, up) + falling(top, down)
            speed = mp.sqrt(2 * (energy(top) + down * top)) * mp.mpf(3) / 4
            assert abs(mp.mpf(float(record.time[impact])) - time) <= record.error[impact]
            assert abs(mp.mpf(float(record.velocity[impact, 0])) - speed) <= record.error[impact]
    assert record.error[-1] < 1e-12


def test_elastic_masses_between_stops_move_as_if_they_passed_each_other() -> None:
    # equal masses exchange their velocities: each velocity flies from stop to stop
    machine = Cubic(
        masses=2,
        frequency=1.0,
        elements=[
            HardStop(0, offset=-0.5, restitution=1.0),
            HardStop(1, offset=0.5, restitution=1.0, side="below"),
            HardStop((0, 1), restitution=1.0),
        ],
    )
    record = machine.simulate(impacts=40, start=machine.state([-0.25, 0.25], [1.5, 0.75]))
    walls, expected = record.time[record.element != 2], list[float]()
    with mp.workdps(50):
        for x, v in ((-0.25, 1.5), (0.25, 0.75)):
            total = mp.mpf(v) ** 2 / 2 + energy(mp.mpf(x))
            first, across = (
                mp.quad(lambda y, e=total: 1 / mp.sqrt(2 * (e - energy(y))), [begin, 0.5])
                for begin in (x, -0.5)
            )
            expected += [float(first + k * across) for k in range(40)]
    assert 20 < len(walls) < 40
    assert np.sort(expected)[: len(walls)] == pytest.approx(walls, rel=1e-13)


# --- orbits, branches and exponents ---------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in MACHINES if not name.startswith("three fric")])
def test_derivatives_beside_cubic_springs_are_those_of_differences(name: str) -> None:
    chain = FPUTChain(cubic=0.4, **MACHINES[name])
    states = chain.attractor(transient=10, impacts=2).states
    jacobian_is_the_derivative(chain, states[-1:])


def test_a_cubic_chain_between_dependent_stops_has_orbits_and_branches() -> None:
    chain = FPUTChain(cubic=0.4, **MACHINES["three stops, two masses"])
    attractor = chain.attractor(transient=60, impacts=20)
    assert str(attractor.label) == "P(2,1)"
    orbit = attractor.periodic_orbit()
    assert orbit.residual < 1e-12
    branch = continue_orbit(orbit, "frequency", bounds=(0.8, 0.805))
    there = chain.replace(frequency=float(branch.parameter[-1]))
    settled = there.attractor(transient=60, impacts=4, start=attractor.final).states
    away = abs(chain.difference(branch.orbit(-1).states[:1], settled)).max(axis=1)
    assert away.min() < 1e-9


def test_a_cubic_chain_with_friction_along_its_stop_has_its_orbit() -> None:
    attractor = FPUTChain(cubic=0.4, **MACHINES["friction along a stop"]).attractor(
        transient=100, impacts=20
    )
    orbit = attractor.periodic_orbit()
    assert orbit.residual < 1e-12
    assert abs(orbit.states[0] - attractor.states[-1]).max() < 1e-9
    assert orbit.multipliers[-1] == 0.0  # it sticks once in each period
