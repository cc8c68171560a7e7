"""Soft stops and dry friction along functions of the coordinates.

Closed forms, Taylor series in sixty digits, and linear machines in other coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from flint import arb, arb_poly, ctx
from scipy.integrate import solve_ivp

from dynkit import CannotFollow, OrbitKind, continue_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import DryFriction, HardStop, ImpactChain, ImpactOscillator, SoftStop
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.flows.cases import BITS, Many, followed_in_many_digits, taylor
from tests.impact.test_taylor_rows import MACHINES, agree
from tests.impact_orbits.bent_cases import WIDE, Bent, orbits_agree, orbits_of

# --- closed forms ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Pendulum(ImpactOscillator):
    """A pendulum of length one beside a rubber wall."""

    drag: float = 0.0

    degrees_of_freedom = 1

    def dissipation(self, v: Any) -> Any:
        return self.drag * v[0] ** 2 / 2

    def kinetic(self, v: Any) -> Any:
        return v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return 1 - sp.cos(x[0])

    def across(self, x: Any) -> Any:
        """Return the distance of the bob from below the pivot."""
        return sp.sin(x[0])


@dataclass(frozen=True, kw_only=True)
class Plane(ImpactOscillator):
    """A particle in a plane, drawn to the centre by springs."""

    drag: float = 0.0
    stiff: float = 1.0

    degrees_of_freedom = 2

    def dissipation(self, v: Any) -> Any:
        return self.drag * (v[0] ** 2 + v[1] ** 2) / 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + self.stiff * x[1] ** 2) / 2

    def radius(self, x: Any) -> Any:
        """Return the distance from the centre."""
        return sp.sqrt(x[0] ** 2 + x[1] ** 2)

    def angle(self, x: Any) -> Any:
        """Return the polar angle."""
        return sp.atan2(x[1], x[0])


@dataclass(frozen=True, kw_only=True)
class BeadOnAParabola(ImpactOscillator):
    """A bead of mass one on y = x^2 / 2 under weight one."""

    drag: float = 0.0

    degrees_of_freedom = 1

    def dissipation(self, v: Any) -> Any:
        return self.drag * v[0] ** 2 / 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return (1 + x[0] ** 2) * v[0] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 / 2

    def arc(self, x: Any) -> Any:
        """Return the length along the parabola from its lowest point."""
        return (x[0] * sp.sqrt(1 + x[0] ** 2) + sp.asinh(x[0])) / 2


def time_between(speed: Any, turn: Any, end: Any, rate: Any = lambda _: 1) -> Any:
    """Time between a turning point and another point of a coordinate whose speed is given.

    Or what has a rate that depends on the coordinate.
    """
    way = end - turn

    def slowness(s: Any) -> Any:
        x = turn + s**2 * way
        return 2 * s * abs(way) * rate(x) / speed(x)

    return mp.quad(slowness, [0, 1], method="gauss-legendre")


def test_a_pendulum_swings_against_a_rubber_wall_in_the_time_of_its_energy() -> None:
    wall = SoftStop("across", offset=0.5, side="below", stiffness=40.0, name="wall")
    pendulum = Pendulum(frequency=1.0, elements=[wall])
    record = pendulum.simulate(impacts=6, start=pendulum.state([-1.0], [0.0]))
    with mp.workdps(40):
        energy, touch = 1 - mp.cos(1), mp.asin(mp.mpf(1) / 2)

        def potential(x: Any) -> Any:
            return 1 - mp.cos(x) + 20 * max(mp.mpf(0), mp.sin(x) - mp.mpf(1) / 2) ** 2

        def speed(x: Any) -> Any:
            return mp.sqrt(2 * (energy - potential(x)))

        deepest = mp.findroot(lambda x: energy - potential(x), mp.mpf("0.6"))
        free, pressed = time_between(speed, -mp.mpf(1), touch), time_between(speed, deepest, touch)
        lasts = [free] + [2 * pressed, 2 * free] * 5
        expected = np.cumsum(lasts)
    found = record.events.time[: len(lasts)]
    assert record.error[-1] < 1e-11
    for one, two in zip(found, expected, strict=True):
        assert abs(mp.mpf(float(one)) - two) <= record.error[-1]
    assert record.energy_balance().error < 1e-13


def test_a_particle_in_a_soft_circular_wall_keeps_energy_and_angular_momentum() -> None:
    wall = SoftStop("radius", offset=1.0, side="below", stiffness=30.0, preload=0.25)
    plane = Plane(frequency=1.0, elements=[wall])
    record = plane.simulate(impacts=3, start=plane.state([0.5, 0.0], [0.0, 1.5]))
    with mp.workdps(40):
        half, momentum = mp.mpf(1) / 2, mp.mpf(3) / 4

        def energy(r: Any) -> Any:
            pressed = max(mp.mpf(0), r - 1)
            return momentum**2 / (2 * r**2) + half * r**2 + 15 * pressed**2 + pressed / 4

        total = energy(half)
        far = mp.findroot(lambda r: total - energy(r), mp.mpf("1.1"))

        def speed(r: Any) -> Any:
            return mp.sqrt(2 * (total - energy(r)))

        ends = [(a, mp.mpf(1)) for a in (half, far)]
        lasts = [time_between(speed, *pair) for pair in ends]
        turned = [time_between(speed, *pair, lambda r: momentum / r**2) for pair in ends]
        for i in range(5):  # where it meets the wall, and how it moves there
            time = lasts[0] * (2 * i + 1) + 2 * i * lasts[1]
            angle = turned[0] * (2 * i + 1) + 2 * i * turned[1]
            met = record.events.time[2 * i]
            assert abs(mp.mpf(float(met)) - time) <= record.error[-1]
            for place, of in zip(record.sample([met])[0][0], (mp.cos, mp.sin), strict=True):
                assert abs(mp.mpf(float(place)) - of(angle)) <= record.error[-1]
    assert record.error[-1] < 1e-11


def test_friction_on_a_bead_takes_the_energy_of_its_way_along_the_curve() -> None:
    rail = DryFriction("arc", force=0.1, static=0.15, name="rail")
    bead = BeadOnAParabola(frequency=1.0, elements=[rail])
    record = bead.simulate(impacts=20, start=bead.state([1.0], [0.0]))
    with mp.workdps(40):
        force, static = mp.mpf(0.1), mp.mpf(0.15)

        def arc(x: Any) -> Any:
            return (x * mp.sqrt(1 + x**2) + mp.asinh(x)) / 2

        turn, time, halts = mp.mpf(1), mp.mpf(0), []
        while abs(turn) / mp.sqrt(1 + turn**2) > static:

            def left(x: Any, turn: Any = turn) -> Any:
                return (turn**2 - x**2) / 2 - force * abs(arc(turn) - arc(x))

            other = mp.findroot(left, -turn * mp.mpf("0.8"))

            def speed(x: Any, left: Any = left) -> Any:
                return mp.sqrt(2 * left(x) / (1 + x**2))

            time += time_between(speed, turn, mp.mpf(0)) + time_between(speed, other, mp.mpf(0))
            halts.append(time)
            turn = other
    assert record.final.position[0] == pytest.approx(float(turn), abs=1e-13)
    assert record.final.velocity[0] == pytest.approx(0.0, abs=1e-30)
    assert len(halts) == 4
    for one, two, error in zip(record.time, halts, record.error, strict=True):
        assert abs(mp.mpf(float(one)) - two) <= error < 1e-12


def test_a_link_on_a_turntable_breaks_away_where_its_torque_exceeds_the_static_one() -> None:
    # On the table r'' = (0.25 - 1) r, and the torque is d/dt (r^2 / 2).
    table = DryFriction("angle", force=0.1, static=0.2, velocity=0.5)
    link = Plane(frequency=1.0, elements=[table])
    record = link.simulate(impacts=1, start=link.state([1.0, 0.0], [0.0, 0.5]))
    rate = np.sqrt(0.75)
    first = record.events.time[0]
    assert first == pytest.approx(np.arcsin(0.2 / (0.5 * rate)) / (2.0 * rate), abs=1e-14)
    # then the torque is constant: angular momentum r^2 / 2 on the table, and 0.1 t besides
    later = np.linspace(first, first + 0.4, 5)
    x, v = record.sample(later)
    momentum = x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]
    begun = 0.5 * np.cos(rate * first) ** 2
    assert momentum == pytest.approx(begun - 0.1 * (later - first), abs=1e-13)


# --- linear machines in other coordinates ---------------------------------------------------------


class Chain(Bent):
    """A bent chain of two masses; displacements are functions of its coordinates."""

    def first(self, x: Any) -> Any:
        """Return the displacement of the first mass."""
        return self.places(x)[0]


TABLE: dict[str, Any] = {"amplitude": 0.1, "restitution": 0.6, "name": "table"}
GIVEN: dict[str, Any] = {"masses": 2, "frequency": 0.9, "damping": 0.15}


def beside(first: Any, last: Any) -> dict[str, list[Any]]:
    """Elements on the two masses of a chain."""
    table = HardStop(last, **TABLE)
    return {
        "pad": [table, SoftStop(first, offset=0.02, stiffness=50.0, damping=0.2, name="pad")],
        "moving pad": [
            SoftStop(last, amplitude=0.1, stiffness=50.0, damping=0.2, preload=0.01, name="pad")
        ],
        "belt": [
            table,
            DryFriction(first, force=0.02, static=0.03, velocity=0.1, name="belt"),
        ],
        "rail along the table": [table, DryFriction(last, force=0.03, static=0.05, name="rail")],
        "shared rail": [
            DryFriction(last, force=0.03, static=0.05, name="rail"),
            DryFriction(last, force=0.01),
            SoftStop(last, amplitude=0.1, stiffness=30.0, name="pad"),
        ],
        "rail": [HardStop(1, **TABLE), DryFriction(first, force=0.02, name="rail")],
    }


@cache
def both(name: str) -> tuple[Any, Any]:
    """The chain, and the bent one: straight where the table acts along a coordinate."""
    straight = name == "rail"
    exact = ImpactChain(elements=beside(0, 1)[name], **GIVEN)
    named = beside("first", "end")[name]
    return exact, Chain(elements=named, last=0.0 if straight else 0.12, **GIVEN)


@pytest.mark.parametrize("name", beside(0, 1))
def test_motions_and_heat_are_those_of_the_chain(name: str) -> None:
    exact, bent = both(name)
    q = np.array([0.2, 0.1])
    x = [float(place) for place in bent.places(q)]
    one = exact.simulate(impacts=8, start=exact.state(x, [0.0, 0.0]))
    two = bent.simulate(impacts=8, start=bent.state(q, [0.0, 0.0]))
    bound = one.error[-1] + two.error[-1]
    assert bound < 1e-11
    assert repr(one.events) == repr(two.events)
    assert abs(one.position - np.array(bent.places(two.position.T)).T).max() <= bound
    heat = two.energy_balance()
    assert heat.error < 1e-12
    assert heat.dissipated == pytest.approx(one.energy_balance().dissipated, abs=1e-12)
    half = bent.simulate(impacts=4, start=bent.state(q, [0.0, 0.0])).final
    assert (bent.simulate(impacts=4, start=half).states == two.states[4:]).all()


class Named(ImpactChain):
    """A chain whose last displacement has a name."""

    def last(self, x: Any) -> Any:
        """Return the last displacement."""
        return x[-1]


ONE_MASS: dict[str, dict[str, Any]] = {
    "a fixed table": {
        "masses": 1,
        "frequency": 0.4,
        "constant_forces": [-0.3],
        "harmonic_forces": [0.5],
        "elements": [HardStop(0, restitution=0.4), DryFriction(0, force=0.1)],
    },
    **{name: MACHINES[name] for name in ("chatter and rest with friction",)},
    **{name: MACHINES[name] for name in MACHINES if name.startswith("a ")},
}


@pytest.mark.parametrize("named", ["stops", "others", "all"])
@pytest.mark.parametrize("name", ONE_MASS)
def test_on_one_coordinate_functions_and_rows_are_held_together(name: str, named: str) -> None:
    given = ONE_MASS[name]
    elements = [
        e if isinstance(e, HardStop) is (named == "others") and named != "all"
        else replace(e, coordinate="last")
        for e in given["elements"]
    ]  # fmt: skip
    agree(ImpactChain(**given), Named(**(given | {"elements": elements})), 6)


def test_a_mass_rests_on_a_preloaded_pad_as_that_of_the_chain() -> None:
    given = GIVEN | {"harmonic_forces": [0.1, 0.0], "constant_forces": [0.0, -0.01]}
    found = []
    for kind, row in ((ImpactChain, 1), (Named, "last")):
        pad = SoftStop(row, stiffness=20.0, damping=0.3, preload=0.05)
        machine = kind(elements=[pad], **given)
        start = machine.state([0.1, 0.0], [0.0, 0.0])
        assert start.closed == (0,)
        found.append(machine.simulate(impacts=12, start=start))
    one, two = found
    assert repr(one.events) == repr(two.events)
    assert abs(one.events.time - two.events.time).max() < 1e-12
    assert abs(one.states - two.states).max() <= one.error[-1] + two.error[-1] < 1e-13


def test_friction_along_a_row_that_a_gradient_meets_is_refused_by_name() -> None:
    slips = [DryFriction(0, force=0.1), DryFriction("last", force=0.1)]
    with pytest.raises(CannotFollow, match="along what other friction, or a stop, holds"):
        Named(masses=1, frequency=1.0, elements=slips).simulate(impacts=1)
    rubs = [HardStop("radius", offset=0.5, restitution=0.0), DryFriction(0, force=0.1)]
    plane = Plane(frequency=1.0, elements=rubs)
    with pytest.raises(CannotFollow, match="along what other friction, or a stop, holds"):
        plane.simulate(impacts=2, start=plane.state([1.0, 0.0], [0.0, 0.0]))


# --- orbits, branches, exponents and labels -------------------------------------------------------


@cache
def orbits(name: str) -> tuple[Any, Any]:
    """The orbits of the chain and of the bent one."""
    return orbits_of(*both(name))


PARAMETERS = {
    "pad": ["frequency", "pad.stiffness", "pad.offset"],
    "moving pad": ["pad.amplitude", "pad.preload", "pad.damping"],
    "belt": ["belt.force", "belt.velocity", "belt.static"],
    "rail along the table": ["rail.static", "table.restitution"],
    "rail": ["rail.force", "damping"],
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_orbits_and_their_derivatives_are_those_of_the_chain(name: str) -> None:
    orbits_agree(*orbits(name), PARAMETERS[name])


DRIVEN: dict[str, Any] = {
    "a pendulum and a rubber wall": Pendulum(
        frequency=1.1,
        drag=0.1,
        harmonic_forces=[0.6],
        elements=[
            SoftStop("across", offset=0.5, side="below", stiffness=40.0, damping=0.3, name="wall")
        ],
    ),
    "a particle and a soft circular wall": Plane(
        frequency=0.8,
        drag=0.3,
        stiff=1.3,
        harmonic_forces=[0.5, 0.1j],
        elements=[
            SoftStop("radius", offset=0.5, side="below", stiffness=30.0, damping=0.2, name="wall")
        ],
    ),
    "friction along the radius of a link": Plane(
        frequency=0.6,
        drag=0.1,
        stiff=1.3,
        harmonic_forces=[0.5, 0.4j],
        elements=[DryFriction("radius", force=0.35, static=0.42, name="rod")],
    ),
    "a bead with friction along its curve": BeadOnAParabola(
        frequency=0.8,
        drag=0.05,
        harmonic_forces=[0.6],
        elements=[DryFriction("arc", force=0.45, static=0.5, name="rail")],
    ),
}


class Wall:
    """The pendulum and its wall in sixty digits: outside, pressing, lifted."""

    def __init__(self) -> None:
        self.regime = 0

    def gap(self, z: list[Many]) -> Many:
        return arb(0.5) - z[0].sin()

    def force(self, z: list[Many]) -> Many:
        return arb(0.3) * z[0].cos() * z[1] - 40 * self.gap(z)

    def rates(self, z: list[Many]) -> list[Many]:
        push = z[0].cos() * self.force(z) if self.regime == 1 else 0
        return [
            z[1],
            arb(0.6) * z[2].sin() - z[0].sin() - arb(0.1) * z[1] - push,
            0 * z[2] + arb(1.1),
        ]

    def zero(self, z: list[Many]) -> Many:
        return self.force(z) if self.regime == 1 else self.gap(z)

    def switched(self, z: list[Many]) -> list[Many]:
        self.regime = (self.regime + 1) % 3
        return z


class Rod:
    """The link and its friction in sixty digits: slips in either way, or sticks."""

    def __init__(self) -> None:
        self.way = 1

    def row(self, z: list[Many]) -> tuple[Many, Many, Many]:
        r = (z[0] * z[0] + z[1] * z[1]).sqrt()
        return r, z[0] / r, z[1] / r

    def free(self, z: list[Many]) -> list[Many]:
        x, y, u, v, phase = z
        return [
            arb(0.5) * phase.sin() - x - arb(0.1) * u,
            arb(0.4) * phase.cos() - arb(1.3) * y - arb(0.1) * v,
        ]

    def held(self, z: list[Many]) -> Many:
        """Return the friction force that keeps the radius."""
        (r, *row), a, (u, v) = self.row(z), self.free(z), z[2:4]
        slip = row[0] * u + row[1] * v
        return (slip * slip - u * u - v * v) / r - row[0] * a[0] - row[1] * a[1]

    def rates(self, z: list[Many]) -> list[Many]:
        (_, *row), a = self.row(z), self.free(z)
        force = -arb(0.35) * self.way if self.way else self.held(z)
        return [*z[2:4], a[0] + force * row[0], a[1] + force * row[1], 0 * z[4] + arb(0.6)]

    def zero(self, z: list[Many]) -> Many:
        if self.way:
            _, *row = self.row(z)
            return row[0] * z[2] + row[1] * z[3]
        return abs(self.held(z)) - arb(0.42)

    def switched(self, z: list[Many]) -> list[Many]:
        held = self.held(z)
        sticks = self.way and abs(held) < arb(0.42)
        self.way = 0 if sticks else -1 if held > 0 else 1
        return z


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize(
    ("name", "exact", "start"),
    [
        ("a pendulum and a rubber wall", Wall(), ([0.0], [0.9])),
        ("friction along the radius of a link", Rod(), ([0.9, 0.1], [0.0, 0.4])),
    ],
)
def test_driven_motions_differ_from_sixty_digits_by_no_more_than_their_error(
    name: str, exact: Any, start: Any
) -> None:
    system = DRIVEN[name].replace()
    begin = system.state(*start)
    record = system.simulate(impacts=2, start=begin)
    times = np.unique(record.events.time)  # it halts and slips on at once
    assert len(times) > 4
    z, clock, back = [arb(x) for part in start for x in part] + [arb(0)], arb(0), arb(2.0**-20)
    with ctx.workprec(BITS):
        for time in times.tolist():
            near = followed_in_many_digits(exact.rates, z, arb(time) - clock - back)
            paths = taylor(exact.rates, near)

            def at(t: Any, paths: list[Many] = paths) -> list[Many]:
                return [arb_poly(path.coeffs())(t).mid() for path in paths]

            steps = [back, back + arb(2.0**-30)]
            for _ in range(4):
                one, two = (exact.zero(at(t)).mid() for t in steps[-2:])
                steps.append((steps[-1] - two * (steps[-1] - steps[-2]) / (two - one)).mid())
            z, clock = exact.switched(at(steps[-1])), arb(time) - back + steps[-1]
            assert abs(float(arb(time) - clock)) <= record.error[-1] < 1e-11
        z = followed_in_many_digits(exact.rates, z, arb(float(record.time[-1])) - clock)
    n = len(z) // 2
    found = np.concatenate([record.position[-1], record.velocity[-1]])
    assert abs(found - [float(x) for x in z[: 2 * n]]).max() <= record.error[-1]


@pytest.mark.parametrize("name", DRIVEN)
def test_nonlinear_machines_have_orbits_by_itinerary(name: str) -> None:
    system = DRIVEN[name]
    attractor = system.attractor(transient=150, impacts=20)
    assert str(attractor.label) == "P(1,1)"
    orbit = attractor.periodic_orbit()
    assert sum(orbit.counts.values()) > 0
    assert orbit.admissible
    away = abs(system.difference(orbit.states[0], attractor.states[-1])).max()
    assert away <= orbit.error + 1e-11
    jacobian = system.jacobian(orbit.states[0])
    assert np.poly(jacobian) == pytest.approx(np.poly(orbit.multipliers), abs=1e-11)
    jacobian_is_the_derivative(system, orbit.states[:1])


def test_a_branch_meets_the_bifurcation_of_one_mass() -> None:
    found = []
    for kind, row in ((ImpactChain, 0), (Bent, "end")):
        pad = SoftStop(row, amplitude=0.1, stiffness=30.0, damping=0.2, name="pad")
        rail = DryFriction(row, force=0.0177, name="rail")
        machine = kind(elements=[pad, rail], **(GIVEN | {"masses": 1}))
        orbit = machine.attractor(transient=100).periodic_orbit()
        found.append(
            continue_orbit(orbit, "rail.force", bounds=(0.0177, 0.01775), **WIDE).bifurcations
        )
    (known,), (other,) = found
    assert known.kind is other.kind is BifurcationKind.GR
    assert known.admissible == other.admissible
    assert abs(known.value - other.value) <= known.error + other.error


def test_a_cycle_on_a_belt_is_that_of_one_mass() -> None:
    found: list[Any] = []
    for kind, row in ((ImpactChain, 0), (Bent, "end")):
        belt = DryFriction(row, force=0.5, static=0.8, velocity=0.2)
        machine = kind(masses=1, damping=0.01, frequency=1.0, elements=[belt])
        attractor = machine.attractor(transient=10, impacts=20)
        found.append(attractor.periodic_orbit())
        assert str(attractor.label) == "P(1)"
    exact, bent = found
    assert abs(exact.period - bent.period) <= exact.error + bent.error < 1e-11
    assert bent.system.dimension == 2  # positions are kept that are bent
    jacobian_is_the_derivative(bent.system, bent.states[:1])
    assert abs(bent.multipliers).max() < 1e-12
    derivative = bent.system.jacobian(bent.states[0])
    assert derivative.shape == (2, 2)


def test_sections_along_functions_have_exact_derivatives() -> None:
    wall = SoftStop("across", offset=0.5, side="below", stiffness=40.0)
    table = DryFriction("angle", force=0.1, static=0.2, velocity=0.5)
    cases: list[tuple[Any, Any]] = [
        (Pendulum(frequency=1.0, drag=0.05, elements=[wall]), ([-1.0], [0.0])),
        (Plane(frequency=1.0, drag=0.02, stiff=1.4, elements=[table]), ([1.0, 0.1], [0.0, 0.8])),
    ]
    for system, start in cases:
        record = system.simulate(impacts=2, start=system.state(*start))
        assert system.dimension == 2 * system.degrees_of_freedom
        jacobian_is_the_derivative(system, record.states[1:])


def test_exponents_beside_a_rubber_wall_are_those_of_the_orbit() -> None:
    attractor = DRIVEN["a pendulum and a rubber wall"].attractor(transient=150, impacts=20)
    spectrum = LyapunovSpectrum(attractor, iterations=128)
    expected = np.log(abs(attractor.periodic_orbit().multipliers))
    assert (abs(spectrum.exponents - expected) <= 3.0 * spectrum.error + 1e-9).all()


def test_an_orbit_on_two_stops_along_functions_is_that_of_the_chain() -> None:
    found: list[Any] = []
    for maker, rows in ((ImpactChain, (0, 1)), (Chain, ("first", "end"))):
        table = HardStop(rows[1], **TABLE)
        other = HardStop(rows[0], offset=-0.01, restitution=0.4)
        machine = maker(elements=[table, other], **GIVEN)
        found.append(machine.attractor(transient=60, keep=30).periodic_orbit())
    exact, bent = found
    assert {event.element for event in exact.problem().itinerary} == {0, 1}
    allowed = exact.error + bent.error
    assert abs(exact.phases - bent.phases).max() <= allowed < 1e-10
    assert abs(exact.impulses - bent.impulses).max() <= allowed
    assert np.poly(bent.multipliers) == pytest.approx(np.poly(exact.multipliers), abs=1e-11)


class Rotor(ImpactOscillator):
    """A rotor that its unbalance turns, in a ring of radius one."""

    degrees_of_freedom = 2
    loss: float = 0.5
    flattening: float = 0.0
    weight: float = 0.0

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + x[1] ** 2) / 2 + self.weight * x[1]

    def dissipation(self, v: Any) -> Any:
        return self.loss * (v[0] ** 2 + v[1] ** 2) / 2

    def clearance(self, x: Any) -> Any:
        return (1 - x[0] ** 2 - (1 + self.flattening) * x[1] ** 2) / 2


UNBALANCE, RING = 0.8, HardStop("clearance", restitution=0.7)


def rubbing(frequency: float, **parameters: Any) -> Any:
    """The orbit of a rotor that rubs all around its ring."""
    forces = [UNBALANCE, -1j * UNBALANCE]
    rotor = Rotor(frequency=frequency, harmonic_forces=forces, elements=[RING], **parameters)
    attractor = rotor.attractor()
    assert attractor.label.kind is OrbitKind.NO_IMPACTS
    assert attractor.label.error == np.inf  # no proof excludes further impacts
    return attractor.periodic_orbit()


def test_a_rotor_that_rubs_all_around_its_ring_turns_as_in_closed_form() -> None:
    w, c = 1.3, 0.5
    orbit = rubbing(w, loss=c)
    # it lags by an angle with c w = F sin(angle); changes of it are those of a pendulum
    sine = c * w / UNBALANCE
    cosine = np.sqrt(1 - sine**2)
    x, v = orbit.sample(np.linspace(0.0, orbit.period, 9))
    assert orbit.admissible
    assert orbit.error < 1e-11
    assert abs(np.hypot(*x.T) - 1).max() <= orbit.error
    assert abs(x[0] @ v[0]) <= orbit.error
    assert abs(x[0, 0] * v[0, 1] - x[0, 1] * v[0, 0] - w) <= orbit.error
    assert abs(-UNBALANCE * x[0, 0] - c * w) <= orbit.error
    of_angle = np.exp(np.roots([1, c, UNBALANCE * cosine]) * orbit.period)
    assert abs(np.poly(orbit.multipliers) - np.poly([*of_angle, 0, 0])).max() < 1e-11


def test_a_branch_of_full_rub_folds_and_loses_contact_as_in_closed_form() -> None:
    orbit, found = rubbing(1.3), []
    for bounds, kind in (((1.2, 1.7), BifurcationKind.SN), ((0.4, 1.31), BifurcationKind.CB)):
        given: Any = {"step": 0.05, "largest_step": 0.2, "points": 24}
        branch = continue_orbit(orbit, "frequency", bounds=bounds, **given)
        found.append(next(b for b in branch.bifurcations if b.kind is kind))
    fold, lost = found
    assert abs(fold.value - UNBALANCE / 0.5) <= fold.error < 1e-10
    # the ring pushes by F cos(angle) + w^2 - 1
    w2 = np.roots([1, -2 + 0.25, 1 - UNBALANCE**2])
    assert abs(lost.value - np.sqrt(w2.min())) <= lost.error < 1e-10


def test_full_rub_in_a_ring_that_is_not_round_is_a_motion_along_it() -> None:
    w, c, b, weight = 1.4, 0.3, 0.1, 0.1
    orbit = rubbing(w, loss=c, flattening=b, weight=weight)
    q = 1 / np.sqrt(1 + b)

    def along(t: float, y: Any) -> Any:
        """Rates of the angle and of its rate: x = (cos, q sin)."""
        angle, rate = y
        tangent = np.array([-np.sin(angle), q * np.cos(angle)])
        x = np.array([np.cos(angle), q * np.sin(angle)])
        force = UNBALANCE * np.array([np.sin(w * t), -np.cos(w * t)]) - x - [0, weight]
        m, bend = tangent @ tangent, -x @ tangent
        return rate, (force @ tangent - bend * rate**2) / m - c * rate

    x, v = (part[0] for part in orbit.sample(np.zeros(1)))
    angle = np.arctan2(x[1] / q, x[0])
    tangent = np.array([-np.sin(angle), q * np.cos(angle)])
    begin = np.array([angle, (v @ tangent) / (tangent @ tangent)])
    given: Any = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    end = solve_ivp(along, (0, orbit.period), begin, **given).y[:, -1]
    assert end - begin == pytest.approx([2 * np.pi, 0], abs=1e-11)
    assert orbit.admissible
