"""Orbits by itinerary: closed forms, forty digits, the map's own orbits, other equations."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import dynkit
from dynkit import NoConvergence, continue_orbit
from dynkit.core.differences import numerical_derivative
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop
from dynkit.systems.impact.orbits.itineraries.finding import orbit_near
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.simulation.state import TWO_PI
from dynkit.testing import check_problem
from tests.impact_orbits.contracts import check_parameters
from tests.reference.itineraries import actual_error

NONE = np.empty(0)

BILINEAR = ImpactChain(
    masses=1,
    frequency=0.8,
    damping=0.05,
    harmonic_forces=[1.0],
    elements=[SoftStop(0, stiffness=3.0, name="soft")],
)
CUSHION = BILINEAR.replace(**{"soft.offset": -0.3, "soft.stiffness": 2.0}).replace(
    elements=[SoftStop(0, offset=-0.3, stiffness=2.0, damping=0.6, name="soft")]
)
RATTLE = ImpactChain(
    masses=3,
    frequency=0.9,
    harmonic_forces=[0.1, 0.0, 0.0],
    elements=[
        HardStop(2, amplitude=0.1, restitution=0.85, name="table"),
        HardStop((0, 1), offset=-0.02, restitution=0.5, name="gear"),
    ],
)
BRAKE = ImpactChain(
    masses=2,
    damping=0.02,
    frequency=1.0,
    harmonic_forces=[0.0, 0.3],
    elements=[
        DryFriction(0, force=0.5, static=0.8, velocity=0.2, slope=0.01, name="belt"),
        DryFriction((0, 1), force=0.05, name="joint"),
    ],
)
MIXED = ImpactChain(
    masses=3,
    frequency=0.9,
    elements=[
        HardStop(2, amplitude=0.1, restitution=0.85, phase=0.2, name="table"),
        HardStop((0, 1), offset=-0.1, restitution=0.5, name="gear"),
        SoftStop(1, offset=0.1, stiffness=5.0, damping=0.2, name="cushion"),
        DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt"),
    ],
)
BELT = ImpactChain(
    masses=1,
    damping=0.0,
    frequency=1.0,
    elements=[DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt")],
)
MACHINES = {
    "bilinear": BILINEAR,
    "cushion": CUSHION,
    "rattle": RATTLE,
    "brake": BRAKE,
    "mixed": MIXED,
    "belt": BELT,
}


def orbit_of(machine: ImpactChain) -> Any:
    """The orbit of the attractor from the default start."""
    return machine.attractor(transient=600, impacts=60).periodic_orbit()


@pytest.fixture(scope="module")
def orbits() -> dict[str, Any]:
    return {name: orbit_of(machine) for name, machine in MACHINES.items()}


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_period_of_stick_slip_on_a_belt_is_that_of_the_closed_form(seed: int) -> None:
    # Unit mass and spring: it slips for 2 (pi - atan(a/v)), and sticks for 2 a/v.
    random = np.random.default_rng(seed)
    force, more, velocity = random.uniform([0.1, 0.1, 0.05], [1.0, 0.8, 0.6])
    belt = DryFriction(0, force=force, static=force + more, velocity=velocity)
    machine = BELT.replace(elements=[belt])
    orbit = machine.periodic_orbit(start=machine.state([0.0], [velocity]))
    slip, stick = 2.0 * (math.pi - math.atan(more / velocity)), 2.0 * more / velocity
    assert orbit.period == pytest.approx(slip + stick, rel=1e-12)
    assert orbit.label == "P(1)"
    assert orbit.counts == {"elements[0].sticks": 1}
    assert orbit.admissible
    assert abs(orbit.multipliers).max() < 1e-12  # what sticks forgets where it was


@pytest.mark.parametrize("ratio", [0.6, 0.8, 1.4, 1.9])
def test_den_hartogs_oscillator_without_stops_has_the_amplitude_of_the_closed_form(
    ratio: float,
) -> None:
    # J. P. Den Hartog, Trans. ASME APM-53-9 (1931) 107-115; k = m = F = 1.
    friction = 0.1
    machine = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=ratio,
        harmonic_forces=[1.0],
        elements=[DryFriction(0, force=friction, name="friction")],
    )
    orbit = orbit_of(machine)
    v, g = 1.0 / (1.0 - ratio**2), math.tan(math.pi / (2.0 * ratio)) / ratio
    turning = abs(orbit._solution.before[:, 0]).max()
    assert turning == pytest.approx(math.sqrt(v * v - (g * friction) ** 2), rel=1e-12)
    assert orbit.counts == {"friction.sticks": 0}


def impact_pair(restitution: float, frequency: float) -> Any:
    """A ball between the walls of a shaken box."""
    walls: Any = {"amplitude": 0.1, "restitution": restitution}
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=frequency,
        elements=[
            HardStop(0, offset=-0.5, name="left", **walls),
            HardStop(0, offset=0.5, side="below", name="right", **walls),
        ],
    )


@pytest.mark.parametrize(("restitution", "frequency"), [(0.6, 2.0), (0.7, 1.0), (0.55, 3.0)])
def test_impact_pair_has_the_symmetric_orbit_of_the_closed_form(
    restitution: float, frequency: float
) -> None:
    # It crosses the box at a speed V in half a period, from each wall at the same phase of it.
    r, w, a, half = restitution, frequency, 0.1, 0.5
    pair = impact_pair(r, w)

    def left(phase: float) -> float:
        speed = 2.0 * w / math.pi * (half - a * math.sin(phase))
        return a * w * math.cos(phase) * (1.0 + r) / (1.0 - r) - speed

    ends = np.linspace(-math.pi / 2, math.pi / 2, 9)
    cells = [(a, b) for a, b in pairwise(ends) if left(a) * left(b) < 0.0]
    roots = [brentq(left, *cell, xtol=1e-15) for cell in cells]
    assert roots
    for phase in roots:
        speed = 2.0 * w / math.pi * (half - a * math.sin(phase))
        start = pair.state([-half + a * math.sin(phase)], [speed], phase)
        orbit = pair.periodic_orbit(start=start)
        assert orbit.label == "P(2,1)"
        assert orbit.counts["left.impacts"] == orbit.counts["right.impacts"] == 1
        off = (orbit.phases - phase) % math.pi
        assert np.minimum(off, math.pi - off).max() < 1e-12
        # of half a period, with its sign changed: W is the wall's velocity
        lasts, wall, change = math.pi / w, a * w * math.cos(phase), a * w * w * math.sin(phase)
        by_phase = (wall - speed) / (-wall - speed)
        by_speed = w * lasts / (-wall - speed)
        matrix = np.array(
            [
                [by_phase, by_speed],
                [-(1.0 + r) * change / w * by_phase, -(1.0 + r) * change / w * by_speed + r],
            ]
        )
        expected = np.linalg.eigvals(matrix) ** 2
        expected = expected[np.argsort(-abs(expected))]
        np.testing.assert_allclose(
            np.sort(abs(orbit.multipliers)), np.sort(abs(expected)), rtol=1e-11
        )


def test_soft_stop_is_reached_where_the_linear_response_reaches_it() -> None:
    orbit = orbit_of(BILINEAR)
    branch = continue_orbit(orbit, "soft.offset", bounds=(-4.0, 0.0))
    w, c = BILINEAR.frequency, 0.05
    amplitude = 1.0 / math.hypot(1.0 - w * w, c * w)
    grazing = branch.bifurcations[0]
    assert grazing.kind == "GR"
    assert "grazing" in grazing.touching
    assert grazing.value == pytest.approx(-amplitude, rel=1e-12)
    assert abs(grazing.value + amplitude) <= grazing.error
    assert "no such orbit" in str(branch.endings[0]) + str(branch.endings[1])
    (beyond,) = grazing.switch()
    assert beyond.counts == {"soft.presses": 0}
    other = continue_orbit(beyond, "soft.offset", bounds=(-4.0, 0.0))
    assert [b.value for b in other.bifurcations] == [pytest.approx(-amplitude, rel=1e-12)]


def test_friction_begins_to_stick_where_it_could_hold_at_a_turning_point() -> None:
    # There the force that holds, sin(phase) - x, is the friction.
    machine = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=0.8,
        harmonic_forces=[1.0],
        elements=[DryFriction(0, force=0.1, name="friction")],
    )
    branch = continue_orbit(orbit_of(machine), "friction.force", bounds=(0.01, 0.9))
    found = [b for b in branch.bifurcations if "crossing-sliding" in b.touching]
    assert len(found) == 2  # one at each end of the swing
    b, w = 1.0 / 0.8, 0.8

    def held(friction: float) -> float:
        # the phase of the turning point has the cosine g friction / v
        v, g = 1.0 / (1.0 - w * w), math.tan(math.pi * b / 2.0) * b
        swing = math.sqrt(v * v - (g * friction) ** 2)
        return abs(math.sqrt(1.0 - (g * friction / v) ** 2) - swing) - friction

    expected = brentq(held, 0.5, 0.9, xtol=1e-14)
    for bifurcation in found:
        assert bifurcation.value == pytest.approx(expected, rel=1e-11)
        (beyond,) = bifurcation.switch()
        assert beyond.counts == {"friction.sticks": 2}  # it is symmetric as well
        stuck = continue_orbit(beyond, "friction.force", bounds=(0.01, 0.9))
        place = int(np.argmin(abs(stuck.parameter - 0.85)))
        assert stuck.admissible[place]
        found_there = stuck.orbit(place)
        label = found_there.system.attractor(transient=300, impacts=30).label
        assert label.counts == found_there.counts


def between_cushions(frequency: float) -> MatrixOscillator:
    cushions = [
        SoftStop(0, offset=side * 3.0, side=name, stiffness=5.0)
        for side, name in ((-1.0, "above"), (1.0, "below"))
    ]
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.0]],
        frequency=frequency,
        harmonic_forces=[1.0],
        elements=cushions,
    )


@pytest.mark.parametrize(("frequency", "presses"), [(0.7, 1), (1.2, 0)])
def test_both_halves_of_a_symmetric_orbit_change_at_a_grazing(
    frequency: float, presses: int
) -> None:
    # the free amplitude is that of the cushions, 3
    reaches = brentq(lambda w: math.hypot(1.0 - w * w, 0.1 * w) - 1.0 / 3.0, 0.5, 0.95, xtol=1e-15)
    orbit = between_cushions(frequency).attractor().periodic_orbit()
    assert set(orbit.counts.values()) == {1 - presses}
    branch = continue_orbit(orbit, "frequency", bounds=(0.6, 1.3))
    grazing = min(branch.bifurcations, key=lambda b: abs(b.value - reaches))
    assert grazing.value == pytest.approx(reaches, rel=1e-12)
    (beyond,) = grazing.switch()
    assert set(beyond.counts.values()) == {presses}
    other = continue_orbit(beyond, "frequency", bounds=(0.6, 1.3))
    inside = other.parameter > reaches + 1e-6 if presses else other.parameter < reaches - 1e-6
    inside &= other.parameter < 1.0
    assert inside.sum() > 4
    assert other.admissible[inside].all()


def test_both_halves_of_a_symmetric_orbit_yield_more_often() -> None:
    machine = MatrixOscillator(
        M=[[1.3]],
        C=[[0.2]],
        K=[[1.28]],
        frequency=0.266,
        harmonic_forces=[1.3],
        elements=[DryFriction(0, force=0.42, name="friction")],
    )
    orbit = machine.attractor(transient=200, impacts=40).periodic_orbit()
    branch = continue_orbit(orbit, "friction.force", bounds=(0.25, 0.45))
    borders = [b for b in branch.bifurcations if "adding-sliding" in b.touching]
    assert len(borders) == 2  # one in each half
    for border in borders:
        (beyond,) = border.switch()
        assert beyond.admissible
        label = beyond.system.attractor(transient=200, impacts=30).label
        assert beyond.counts == label.counts == {"friction.sticks": 4}


# --- errors, multipliers, derivatives -------------------------------------------------------------


@pytest.mark.parametrize("name", MACHINES)
def test_error_is_an_estimate_of_the_actual_error(name: str, orbits: dict[str, Any]) -> None:
    orbit = orbits[name]
    assert actual_error(orbit) <= orbit.error < 1e-10


@pytest.mark.parametrize("name", [name for name in MACHINES if name != "belt"])
def test_orbits_are_those_of_the_map(name: str, orbits: dict[str, Any]) -> None:
    orbit, machine = orbits[name], MACHINES[name]
    given = dynkit.periodic_orbit(machine, orbit.states)
    apart = abs(machine.difference(given.states, orbit.states)).max()
    assert apart <= orbit.error + given.error
    assert orbit.admissible
    assert orbit.label == str(machine.attractor(transient=600, impacts=60).label)
    within = np.maximum(orbit.multipliers_error, given.multipliers_error) + 1e-10
    for own in orbit.multipliers:
        assert (abs(given.multipliers - own) <= within.max()).any()


@pytest.mark.parametrize("name", MACHINES)
def test_counts_are_those_of_the_attractor(name: str, orbits: dict[str, Any]) -> None:
    attractor = MACHINES[name].attractor(transient=600, impacts=60)
    counts = attractor.label.counts
    assert counts is None or dict(orbits[name].counts) == dict(counts)


@pytest.mark.parametrize("name", MACHINES)
def test_equations_keep_the_contracts(name: str, orbits: dict[str, Any]) -> None:
    orbit = orbits[name]
    values = orbit.system.parameters.items()
    # differences at zero have no step
    names = [name for name, p in values if p and np.isfinite(p) and name != "chatter_tolerance"]
    check_parameters(orbit, names)


@pytest.mark.parametrize("name", ["rattle", "mixed"])
@pytest.mark.parametrize("side", [-1.0, 0.0, 1.0])
def test_equations_are_smooth_through_grazing(
    name: str, side: float, orbits: dict[str, Any]
) -> None:
    problem = orbits[name].problem()
    n, k, _ = problem.layout
    x = orbits[name].unknowns.copy()
    x[n : n + k] = side * 1e-3 * x[n : n + k]
    found, error = numerical_derivative(lambda y: problem.residual(y, NONE), x)
    off = abs(problem.linearization(x, NONE) - found)
    assert (off <= 20.0 * error + 1e-12 * abs(found).max()).all()


# --- the other equations --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_equations_of_a_table_alone_give_the_same_orbits(seed: int) -> None:
    random = np.random.default_rng(seed)
    while True:
        masses, frequency = int(random.integers(1, 5)), float(random.uniform(0.6, 3.0))
        r = float(random.uniform(0.3, 0.9))
        chain = ImpactChain(masses=masses, frequency=frequency, restitution=r)
        attractor = chain.attractor(transient=1500)
        if attractor.label.periods is not None and (attractor.label.iterates or 99) < 5:
            break
    known = attractor.periodic_orbit()
    assert isinstance(known, ImpactOrbit)
    own = orbit_near(chain, attractor.final, attractor.label.periods)
    first = np.argmin(abs(chain.difference(own.states, known.states[0])).max(axis=1))
    states = np.roll(own.states, -first, axis=0)
    assert abs(chain.difference(states, known.states)).max() <= own.error + known.error
    within = own.multipliers_error.max() + known.multipliers_error.max()
    for multiplier in known.multipliers:
        assert abs(own.multipliers - multiplier).min() <= within
    for name in ("frequency", "amplitude", "damping", "restitution"):
        slopes = []
        for orbit in (known, own):
            problem = orbit.problem(name)
            p, x = problem.values, orbit.unknowns
            by = np.linalg.solve(problem.linearization(x, p), -problem.parameter_derivative(x, p))
            n = len(orbit.phases)
            slopes.append(by[:n, 0])
        np.testing.assert_allclose(np.roll(slopes[1], -first), slopes[0], rtol=1e-7, atol=1e-9)


# --- branches -------------------------------------------------------------------------------------


def test_branches_follow_parameters_of_elements(orbits: dict[str, Any]) -> None:
    branch = continue_orbit(orbits["belt"], "belt.velocity", bounds=(0.15, 0.5))
    velocity = branch.parameter
    period = 2.0 * (math.pi - np.arctan(0.3 / velocity)) + 0.6 / velocity
    found = [branch.orbit(k).period for k in range(len(branch))]
    np.testing.assert_allclose(found, period, rtol=1e-11)
    assert branch.admissible.all()


def test_a_family_of_orbits_is_refused_by_name() -> None:
    machine = ImpactChain(
        masses=1, damping=0.0, frequency=1.0, elements=[SoftStop(0, stiffness=3.0)]
    )
    with pytest.raises(NoConvergence, match="family"):
        machine.periodic_orbit(start=machine.state([1.0], [0.0]))


def test_a_slider_that_never_slips_is_refused_by_name() -> None:
    machine = ImpactChain(
        masses=1, frequency=1.0, harmonic_forces=[0.1], elements=[DryFriction(0, force=1.0)]
    )
    with pytest.raises(NoConvergence, match="family"):
        machine.periodic_orbit(start=machine.state([0.0], [0.0]))


@pytest.mark.parametrize("transient", [1, 400])  # the velocities that are left are rounding
def test_a_mass_that_comes_to_rest_between_others_is_refused_by_name(transient: int) -> None:
    machine = ImpactChain(
        masses=2,
        damping=0.05,
        frequency=0.8,
        harmonic_forces=[0.5, 0.0],
        elements=[DryFriction(0, force=0.6)],
    )
    with pytest.raises(NoConvergence, match="family"):
        machine.attractor(transient=transient).periodic_orbit()


def test_wrong_arguments_are_refused_by_name() -> None:
    with pytest.raises(NotImplementedError, match="a table of one coordinate, alone; got SoftStop"):
        BILINEAR.periodic_orbit(phases=[0.1])
    with pytest.raises(ValueError, match="start must be given with elements, and periods alone"):
        BILINEAR.periodic_orbit(phases=[0.1], start=BILINEAR.state())
    with pytest.raises(ValueError, match="periods must be a positive integer; got 0"):
        BILINEAR.periodic_orbit(periods=0)
    with pytest.raises(ValueError, match="start must be an ImpactState; got 3"):
        BILINEAR.periodic_orbit(start=3)  # type: ignore[arg-type]
    chain = ImpactChain(masses=1, frequency=2.8)
    with pytest.raises(ValueError, match="start must be given with elements, and periods alone"):
        chain.periodic_orbit(start=chain.state())


def test_phases_of_states_are_those_of_periods() -> None:
    orbit = orbit_of(BILINEAR)
    assert (orbit.phases % TWO_PI == 0.0).all()
    np.testing.assert_allclose(BILINEAR(orbit.states[0]), orbit.states[0], atol=1e-13)


def test_friction_that_sticks_together_is_one_friction_of_the_sum() -> None:
    given: Any = {"masses": 1, "damping": 0.05, "frequency": 0.5, "harmonic_forces": [1.0]}
    parts = [DryFriction(0, force=0.2, static=0.3), DryFriction((-0.5,), force=0.3, static=0.5)]
    two, one = (
        ImpactChain(elements=elements, **given).attractor(transient=200, impacts=9).periodic_orbit()
        for elements in (parts, [DryFriction(0, force=0.35, static=0.55)])
    )
    assert isinstance(two, ImpactOrbit)
    assert two.admissible
    assert abs(two.states - one.states).max() <= one.error + two.error
    problem = two.problem("elements[1].static")
    check_problem(problem, two.unknowns, problem.values)


def test_what_sticks_at_a_state_of_an_orbit_does_not_slip_by_rounding() -> None:
    # with a static force above the kinetic one it would slip on
    machine = ImpactChain(
        masses=(1.0, 1.2, 0.9),
        damping=0.06,
        frequency=0.52,
        harmonic_forces=[0.3, -0.4, 0.5],
        elements=[
            DryFriction(1, force=0.2, static=0.3),
            HardStop(2, offset=-0.3, restitution=0.5),
        ],
    )
    orbit: Any = machine.attractor(transient=400, impacts=40).periodic_orbit()
    solution: Any = orbit._solution
    stuck = [1 in solution.following[i].mode.held for i in solution.hits]
    assert any(stuck)
    near = orbit.unknowns * (
        1.0 + 1e-15 * np.random.default_rng(0).normal(size=len(orbit.unknowns))
    )
    states = orbit.problem().at(near, np.empty(0)).section_states
    assert not states[stuck, 3].any()  # velocity of the second mass
    for here, there in zip(states, np.roll(states, -1, axis=0), strict=True):
        assert abs(machine.difference(machine(here), there)).max() < 1e-11
