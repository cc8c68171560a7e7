"""Machines that progress: their motions repeat but for a shift that nothing sees."""

from typing import Any

import mpmath
import numpy as np
import pytest
import sympy
from numpy.testing import assert_allclose

from dynkit import basins, continue_orbit, explore, sweep
from dynkit.orbits.newton import NoConvergence
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactOscillator,
    Jenkins,
    MatrixOscillator,
    SoftStop,
)
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.testing import check_problem
from tests.impact_orbits.capsule import SoftCapsule, capsule, hardened, integrated

CAPSULES = {
    "P(1,1)": capsule(1.8, 0.6, 0.02, 0.8),
    "P(2,1)": capsule(1.5, 1.5, 0.3, 0.5),
    "P(inf,1)": capsule(0.9, 0.6, 0.02, 0.5),
}


def orbit_of(system: ImpactOscillator) -> ImpactOrbit:
    """The orbit of its attractor."""
    found = system.attractor(transient=60, keep=60).periodic_orbit()
    assert isinstance(found, ImpactOrbit)
    return found


@pytest.fixture(scope="module")
def orbits() -> dict[str, ImpactOrbit]:
    return {label: orbit_of(system) for label, system in CAPSULES.items()}


@pytest.mark.parametrize("label", CAPSULES)
def test_a_capsule_is_labelled_by_its_impacts(label: str, orbits: dict[str, ImpactOrbit]) -> None:
    orbit, found = orbits[label], CAPSULES[label].attractor(transient=300, keep=60).label
    assert str(found) == orbit.label == label
    assert found.multiplier == pytest.approx(abs(orbit.multipliers[0]), abs=1e-11)
    assert orbit.admissible
    assert orbit.stable
    assert orbit.progression[0] == orbit.progression[1] < -0.1


@pytest.mark.parametrize("label", ["P(1,1)", "P(2,1)"])
def test_a_capsule_moves_as_an_integrator_says(label: str, orbits: dict[str, ImpactOrbit]) -> None:
    orbit, system = orbits[label], CAPSULES[label]
    since = 0.3 * orbit.period  # amid a flight
    begin = np.concatenate(orbit.sample([since]), axis=1)[0]
    time = orbit.phases[0] / system.frequency + since
    end, rates = integrated(system, begin, time)
    assert_allclose(end[:2] - begin[:2], orbit.progression, rtol=0.0, atol=2e-13)
    assert_allclose(end[2:], begin[2:], rtol=0.0, atol=2e-13)
    assert_allclose(np.sort(rates), np.sort(orbit.relative_velocity), rtol=0.0, atol=2e-13)
    errors = []
    for h in (1e-3, 1e-4, 1e-5):
        sides = [
            [integrated(system, begin + sign * change, time)[0] for change in h * np.eye(4)]
            for sign in (1.0, -1.0)
        ]
        moved = np.linalg.eigvals((np.array(sides[0]) - sides[1]).T / (2.0 * h))
        moved = moved[np.argsort(-abs(moved))]
        errors.append(abs(moved - np.append(1.0, orbit.multipliers)).max())
    assert errors[1] < 0.02 * errors[0]  # central differences: the square of the step
    assert errors[2] < 1e-8


@pytest.mark.parametrize("label", CAPSULES)
def test_the_progression_is_that_of_simulated_periods(
    label: str, orbits: dict[str, ImpactOrbit]
) -> None:
    orbit = orbits[label]
    system, since = orbit.system, 0.3 * orbit.period
    (place,), (velocity,) = orbit.sample([since])
    start = system.state(place, velocity, orbit.phases[0] + system.frequency * since)
    record = system.simulate(impacts=400, start=start)
    times = orbit.period * np.arange(1.0, 6.0)
    assert record.time[-1] > times[-1]
    x, v = record.sample(times)
    for found in (x, orbit.sample(since + times)[0]):
        assert_allclose(np.diff(found, axis=0), [orbit.progression] * 4, rtol=0.0, atol=1e-11)
        assert_allclose(found[0], place + orbit.progression, rtol=0.0, atol=1e-11)
    assert_allclose(v, [velocity] * 5, rtol=0.0, atol=1e-11)


def test_taylor_s_method_finds_the_same_progression(orbits: dict[str, ImpactOrbit]) -> None:
    linear = orbits["P(1,1)"]
    system = hardened(linear.system, 1e-9)
    assert system.engine == "Taylor"
    orbit = orbit_of(system)
    assert orbit.admissible
    assert_allclose(orbit.progression, linear.progression, rtol=1e-8)
    assert_allclose(orbit.multipliers, linear.multipliers, atol=1e-8)
    problem = orbit.problem("cubic")
    h, (x, p) = 1e-5, (orbit.unknowns, problem.values)
    sides = [problem.residual(x, p + step) for step in (h, -h)]
    expected = (sides[0] - sides[1]) / (2.0 * h)
    assert_allclose(problem.parameter_derivative(x, p)[:, 0], expected, atol=1e-9)


def test_a_rail_that_is_not_even_sees_the_place() -> None:
    class Rail(SoftCapsule):
        def potential(self, x: Any) -> Any:
            return super().potential(x) + sympy.sin(x[1]) / 100

    given: Any = {"cubic": 0.5, "frequency": 1.0, "elements": [DryFriction(1, force=0.3)]}
    assert SoftCapsule(**given)._progression.shift.shape == (4, 1)
    assert Rail(**given)._progression.shift.shape == (4, 0)


def block(bias: float) -> MatrixOscillator:
    """A block on the ground, with a harmonic force and a constant one."""
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        harmonic_forces=[1.0],
        constant_forces=[bias],
        elements=[DryFriction(0, force=0.6, name="ground")],
    )


def test_a_block_that_slips_once_in_a_period_progresses_as_in_closed_form() -> None:
    # x'' = sin(t) + bias - force from sin(begin) = force - bias until x' = 0 again
    with mpmath.workdps(30):
        rest = mpmath.mpf(0.6) - mpmath.mpf(0.45)
        begin = mpmath.asin(rest)

        def speed(t: mpmath.mpf) -> mpmath.mpf:
            return mpmath.cos(begin) - mpmath.cos(t) - rest * (t - begin)

        end = mpmath.findroot(speed, 4.5)
        lasts = end - begin
        slip = mpmath.cos(begin) * lasts - mpmath.sin(end) + rest - rest * lasts**2 / 2
    orbit = orbit_of(block(0.45))
    assert orbit.label == "P(1,1)"
    assert abs(orbit.progression[0] - float(slip)) <= orbit.error < 1e-12
    assert orbit.counts == {"ground.sticks": 1}
    assert orbit.multipliers == [0.0]


def test_a_block_without_bias_stays_where_it_is() -> None:
    orbit = orbit_of(block(0.0))
    assert orbit.label == "P(1,1)"
    assert abs(orbit.progression[0]) <= orbit.error


@pytest.mark.parametrize(
    "elements",
    [
        [
            SoftStop((0, 1), stiffness=20.0, damping=0.6, name="head"),
            DryFriction(1, force=0.6, name="rock"),
        ],
        [
            SoftStop((0, 1), stiffness=20.0, damping=0.6, name="head"),
            Jenkins(1, stiffness=50.0, force=0.6, name="rock"),
        ],
    ],
    ids=["friction", "slider"],
)
def test_a_drill_advances(elements: list[SoftStop | DryFriction | Jenkins]) -> None:
    # A mass that is pushed and shaken strikes a bit, which the rock lets go beyond a force: Phys.
    # Rev. E 64 (2001) 056224.
    drill = MatrixOscillator(
        M=np.diag([1.0, 0.1]),
        C=np.diag([0.0, 0.05]),
        K=np.zeros((2, 2)),
        frequency=1.0,
        harmonic_forces=[0.8, 0.0],
        constant_forces=[0.15, 0.0],
        elements=elements,
    )
    orbit = orbit_of(drill)
    assert orbit.label == "P(1,1)"
    assert orbit.admissible
    assert orbit.progression[0] == pytest.approx(orbit.progression[1], abs=1e-14)
    assert len(orbit.multipliers) == drill.dimension - 1
    motion = drill.attractor(transient=300, keep=20)
    assert_allclose(np.diff(motion.record.position[:, 0]), orbit.progression[0], atol=1e-10)
    check_problem(orbit.problem("frequency"), orbit.unknowns, np.array([1.0]))


def test_a_block_that_is_pulled_moves_as_one_on_a_belt() -> None:
    friction: Any = {"force": 0.5, "static": 0.8}
    pulled = MatrixOscillator(
        M=np.eye(2),
        C=np.zeros((2, 2)),
        K=[[1.0, -1.0], [-1.0, 1.0]],
        frequency=1.0,
        elements=[
            DryFriction(0, **friction, name="ground"),
            DryFriction(1, force=50.0, velocity=0.2, name="hand"),
        ],
    )
    held = ImpactChain(
        masses=1, damping=0.0, frequency=1.0, elements=[DryFriction(0, velocity=0.2, **friction)]
    )
    motion = pulled.attractor(transient=30, keep=30)
    cycle, other = motion.periodic_orbit(), held.attractor(transient=30, keep=30).periodic_orbit()
    assert isinstance(cycle, ImpactOrbit)
    assert isinstance(other, ImpactOrbit)
    assert str(motion.label) == cycle.label == "P(1)"
    assert cycle.period == pytest.approx(other.period, rel=1e-13)
    assert_allclose(cycle.progression, 0.2 * cycle.period, rtol=0.0, atol=cycle.error)


def test_a_branch_doubles_its_period_where_simulation_does() -> None:
    system = capsule(3.85, 1.5, 0.3, 0.8)
    branch = continue_orbit(orbit_of(system), "frequency", bounds=(3.84, 3.9))
    (doubling,) = branch.bifurcations
    assert str(doubling.kind) == "PD"
    assert doubling.value == pytest.approx(3.8772373156, abs=1e-9)
    assert str(doubling.criticality) == "supercritical, stable, at larger values"
    (twice,) = doubling.switch()
    assert twice.label == "P(2,2)"
    assert twice.progression == pytest.approx(2.0 * doubling.orbit.progression, rel=1e-2)
    for change, label in ((-1e-3, "P(1,1)"), (1e-3, "P(2,2)")):
        beside = system.replace(frequency=doubling.value + change)
        found = beside.attractor(transient=3000, keep=60)
        assert str(found.label) == label


def test_a_branch_that_sticks_is_continued() -> None:
    orbit = orbit_of(CAPSULES["P(inf,1)"])
    branch = continue_orbit(orbit, "ground.force", bounds=(0.297, 0.303))
    last = branch.orbit(-1)
    found = orbit_of(last.system)
    assert last.progression == pytest.approx(found.progression, abs=1e-11)
    assert branch.stable.all()


def test_motions_elsewhere_are_one() -> None:
    system = CAPSULES["P(1,1)"]
    starts = np.array([[x, x, v, 0.1, 0.3] for x in (0.0, 500.0) for v in (0.0, 0.2)])
    found = basins(system, starts, transient=200, progress=False)
    assert [str(basin.label) for basin in found.basins] == ["P(1,1)"]
    assert found.numbers.tolist() == [0] * 4
    labels = sweep(system, "frequency", [1.75, 1.85], transient=200, keep=60, progress=False).labels
    assert list(map(str, labels)) == ["P(1,1)"] * 2
    network = explore(system, "frequency", (1.79, 1.81), iterates=1, periods=1, values=1)
    assert [branch.label for branch in network.branches] == ["P(1,1)"]


EYE, APART, FRICTION = np.eye(2), np.array([[1.0, -1.0], [-1.0, 1.0]]), DryFriction(1, force=0.3)


@pytest.mark.parametrize(
    ("damping", "stiffness", "elements", "expected"),
    [
        (0.0 * EYE, APART, [FRICTION], [[1.0, 1.0]]),
        (EYE, APART, [HardStop((0, 1), offset=-1.0)], [[1.0, 1.0]]),
        (0.0 * EYE, 0.0 * EYE, [DryFriction(0, force=1.0), FRICTION], np.eye(2)),
        (0.0 * EYE, 0.0 * EYE, [FRICTION, HardStop((0.5, -1.0))], [[1.0, 0.5]]),
        (0.0 * EYE, APART, [FRICTION, HardStop(1)], []),  # it sees the place
        (0.0 * EYE, APART, [FRICTION, SoftStop(0, stiffness=1e-20)], []),
        (0.0 * EYE, APART, [DryFriction((0, 1), force=0.3)], []),  # nothing resists
        (APART, APART, [HardStop((0, 1), offset=-1.0)], []),
    ],
)
def test_directions_are_those_that_nothing_sees_and_something_resists(
    damping: np.ndarray, stiffness: np.ndarray, elements: list[HardStop], expected: np.ndarray
) -> None:
    given: Any = {"M": np.diag([1.0, 0.3]), "C": damping, "K": stiffness, "frequency": 1.0}
    found = MatrixOscillator(**given, elements=elements)._progression.shift[:2].T
    assert_allclose(found[np.argsort(found[:, 1])], np.reshape(expected, (-1, 2)), atol=1e-15)


def test_a_wall_spring_that_rounding_would_lose_restores() -> None:
    free, held = (
        ImpactChain(
            masses=2,
            springs=(wall, 1.0),
            damping=0.0,
            frequency=1.0,
            elements=[DryFriction(1, force=0.3)],
        )
        for wall in (0.0, 1e-17)
    )
    assert free._progression.shift.shape == (4, 1)
    assert held._progression.shift.shape == (4, 0)


def test_a_machine_that_nothing_slows_down_is_one_of_a_family() -> None:
    free = MatrixOscillator(
        M=np.eye(2),
        C=0.1 * APART,
        K=APART,
        frequency=1.3,
        harmonic_forces=[1.0, -1.0],
        elements=[HardStop((0, 1), offset=-0.1, restitution=0.5)],
    )
    with pytest.raises(NoConvergence, match="one of a family"):
        free.attractor(transient=300, keep=60).periodic_orbit()
