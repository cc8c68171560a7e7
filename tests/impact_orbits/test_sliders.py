"""Orbits of machines with sliders: loops in many digits, halts amid slip, random machines."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit import NoConvergence, continue_orbit
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    MatrixOscillator,
    SoftStop,
)
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.testing import check_problem
from tests.impact.test_jenkins import MACHINE, random_machine
from tests.impact_orbits.bent_cases import WIDE
from tests.impact_orbits.contracts import check_parameters
from tests.reference.exponential import expm

FORCED: Any = {"masses": 1, "damping": 0.05, "frequency": 0.8, "harmonic_forces": [0.8]}
JOINT = Jenkins(0, stiffness=2.0, force=0.3, name="joint")
ONE = ImpactChain(elements=[JOINT], **FORCED)
SHAKEN: Any = {"masses": 2, "damping": 0.05, "harmonic_forces": [0.4, 0.8]}
BETWEEN = Jenkins((0, 1), stiffness=1.0, force=0.15, name="joint", side="below")
MACHINES = {
    "one": ONE,
    "belt": ONE.replace(elements=[Jenkins(0, stiffness=2.0, force=0.3, velocity=0.3, name="j")]),
    "slips for ever": ONE.replace(elements=[Jenkins(0, stiffness=2.0, force=0.3, velocity=9.0)]),
    "shaken surface": ImpactChain(
        frequency=0.8,
        elements=[Jenkins(0, stiffness=2.0, force=0.3, amplitude=0.05, phase=0.3), BETWEEN],
        **SHAKEN,
    ),
    "stop": ImpactChain(
        frequency=0.8,
        elements=[HardStop(1, offset=-0.6, restitution=0.7, name="table"), BETWEEN],
        **SHAKEN,
    ),
    "sticks": ImpactChain(
        frequency=0.4,
        elements=[HardStop(1, offset=0.2, restitution=0.5, name="table"), BETWEEN],
        **SHAKEN,
    ),
    "all": ImpactChain(
        frequency=0.8,
        elements=[SoftStop(1, offset=-0.6, stiffness=2.0), DryFriction(0, force=0.1), BETWEEN],
        **SHAKEN,
    ),
}


@cache
def orbit_of(machine: Any) -> Any:
    """The orbit of the attractor from the default start."""
    return machine.attractor(transient=900, impacts=60).periodic_orbit()


@pytest.fixture(scope="module")
def orbits() -> dict[str, Any]:
    return {name: orbit_of(machine) for name, machine in MACHINES.items()}


# --- a loop in many digits ------------------------------------------------------------------------


def half_loop(joints: list[Jenkins], guess: list[float]) -> list[float]:
    """Swing, phase of the turn, and times of the yields after it, of a symmetric loop: 40 digits.

    From the turn on all sliders stick, until each has been moved by twice its reach; half a period
    later the mass turns at the opposite place.
    """
    with mp.workdps(40):
        w, push, half = mp.mpf("0.8"), mp.mpf("0.8"), mp.pi / mp.mpf("0.8")
        k, f = ([mp.mpf(repr(getattr(j, n))) for j in joints] for n in ("stiffness", "force"))

        def left(swing: Any, phase: Any, *times: Any) -> list[Any]:
            z = mp.matrix([swing, 0, mp.sin(phase), mp.cos(phase), 1])
            out, stuck, begin = [], [True] * len(joints), mp.mpf(0)
            for i, end in enumerate([*times, half]):
                sticking = [j for j in range(len(joints)) if stuck[j]]
                # force of a stuck slider: F + k (x - swing); of one that slips -F
                spring = 1 + sum((k[j] for j in sticking), mp.mpf(0))
                still = sum((k[j] * swing - f[j] for j in sticking), mp.mpf(0))
                still += sum((f[j] for j in range(len(joints)) if not stuck[j]), mp.mpf(0))
                flow = mp.matrix(5, 5)
                flow[0, 1], flow[2, 3], flow[3, 2] = 1, w, -w
                flow[1, 0], flow[1, 1], flow[1, 2], flow[1, 4] = -spring, -DAMPING, push, still
                z = expm(flow * (end - begin)) * z
                begin = end
                if i < len(joints):
                    out.append(swing - z[0] - 2 * f[i] / k[i])
                    stuck[i] = False
            return [*out, z[0] + swing, z[1]]

        found = mp.findroot(left, guess, tol=1e-60)
        return [float(number) for number in found]


DAMPING = mp.mpf(repr(0.05))


@pytest.mark.parametrize(
    "joints", [[JOINT], [JOINT, Jenkins(0, stiffness=1.0, force=0.35, name="other")]]
)
def test_a_steady_loop_is_that_of_many_digits(joints: list[Jenkins]) -> None:
    orbit = orbit_of(ONE.replace(elements=joints))
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.counts == {f"{joint.name}.sticks": 2 for joint in joints}
    s: Any = orbit._solution
    turns = [not any(e.mode.numbers) for e in s.following]
    (turn,) = (i for i, e in enumerate(s.itinerary) if turns[i] and e.mode.numbers[0] == 1)
    swing, begin = s.before[turn, 0], s.event_phases[turn]
    yields = [
        i for i, e in enumerate(s.itinerary) if e.guard == 1 and not e.mode.numbers[e.element]
    ]
    times = sorted((s.event_phases[yields] - begin) % (2.0 * math.pi) / 0.8)
    exact = half_loop(joints, [swing, begin, *times])
    found = np.array([swing, begin, *times])
    assert abs(found - exact).max() <= 2.0 * orbit.error < 1e-10


# --- multipliers and derivatives ------------------------------------------------------------------


@pytest.mark.parametrize("name", MACHINES)
def test_equations_keep_the_contracts(name: str, orbits: dict[str, Any]) -> None:
    orbit = orbits[name]
    assert orbit.admissible
    own = "frequency", "joint.", "j.", "elements[0]."
    values = orbit.system.parameters.items()
    names = [name for name, p in values if name.startswith(own) and p and np.isfinite(p)]
    check_parameters(orbit, names)


@pytest.mark.parametrize("name", ["one", "belt", "shaken surface", "all"])
def test_multipliers_are_those_of_differences_of_the_simulated_map(
    name: str, orbits: dict[str, Any]
) -> None:
    orbit, machine = orbits[name], MACHINES[name]
    (state,), h = orbit.states, 1e-6
    columns = [
        (machine(state + e) - machine(state - e)) / (2.0 * h) for e in h * np.eye(len(state))
    ]
    found = np.linalg.eigvals(np.array(columns).T)
    assert abs(found.sum() - orbit.multipliers.sum()) < 1e-6
    assert abs((found**2).sum() - (orbit.multipliers**2).sum()) < 1e-6


# --- borders --------------------------------------------------------------------------------------


def test_a_branch_ends_where_the_slider_slips_no_more() -> None:
    # of the stuck slider the response is linear: it slips where its spring may bear no more
    branch = continue_orbit(orbit_of(ONE), "joint.force", bounds=(0.29, 1.0))
    (last,) = branch.bifurcations
    force = 2.0 * 0.8 / abs(1.0 + 2.0 - 0.8**2 + 1j * 0.05 * 0.8)
    assert abs(last.value - force) <= last.error + 1e-12
    assert "grazing-sliding" in last.touching
    assert branch.endings[-1].message.startswith("beyond, there is no such orbit")


def test_of_sliders_along_one_row_any_may_be_seen_to_halt_first() -> None:
    orbit = MACHINE.attractor(transient=2000).periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.admissible


def test_a_slider_begins_to_halt_amid_its_slip() -> None:
    machine = ONE.replace(
        damping=0.0, elements=[Jenkins(0, stiffness=2.0, force=0.3, velocity=0.05, name="joint")]
    )
    branch = continue_orbit(orbit_of(machine), "joint.force", bounds=(0.3, 0.74))
    found = next(b for b in branch.bifurcations if "adding-sliding" in b.touching)
    (there,) = found.switch()
    assert there.counts == {"joint.sticks": 3}
    beyond = continue_orbit(there, "joint.force", bounds=(0.3, 0.74))
    (known,) = (k for k in np.flatnonzero(beyond.admissible)[5:6])
    orbit = beyond.orbit(int(known))
    settled = orbit.system.attractor(transient=900, impacts=1)
    apart = orbit.system.difference(settled.states[-1], orbit.states[0])
    assert abs(apart).max() <= orbit.error + settled.error


# --- random machines ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seed", "hit"), [*((s, False) for s in range(3, 9)), (14, True), (19, True)]
)
def test_orbits_of_random_machines_are_their_long_motions(seed: int, hit: bool) -> None:
    machine, place, velocity = random_machine(seed, hit=hit)
    settled = machine.attractor(transient=1500, impacts=20, start=machine.state(place, velocity))
    orbit = settled.periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.admissible
    assert orbit.counts == settled.label.counts
    for state in settled.states:
        apart = [abs(machine.difference(state, own)).max() for own in orbit.states]
        assert min(apart) <= orbit.error + settled.error


# --- refusals -------------------------------------------------------------------------------------


def test_a_slider_that_never_slips_makes_a_family_of_sticking_orbits() -> None:
    machine = MACHINES["sticks"].replace(**{"joint.force": 9.0})
    with pytest.raises(NoConvergence, match="slider that never slips may be anywhere; got Jenkins"):
        orbit_of(machine)


def test_borders_of_orbits_that_are_no_motions_lead_nowhere() -> None:
    # events in another order: what touches there is at no time
    machine = ONE.replace(
        damping=0.0, elements=[Jenkins(0, stiffness=2.0, force=0.3, velocity=0.05, name="joint")]
    )
    branch = continue_orbit(orbit_of(machine), "frequency", bounds=(0.3, 0.8), points=240)
    assert not branch.admissible.all()
    kinds = [found.kind.value for found in branch.bifurcations]
    assert kinds == ["GR"] * 6
    # where it turns a guard is only grazed: multipliers are those of orbits beside it, none is 1
    turns = np.flatnonzero(np.diff(np.sign(np.diff(branch.parameter)))) + 1
    assert len(turns) == 3
    for turn in turns.tolist():
        assert not branch.admissible[turn]
        beside = np.sort_complex(branch.multipliers[turn - 1 : turn + 2])
        assert abs(np.diff(beside, axis=0)).max() < 1e-3
        assert abs(beside - 1.0).min() > 0.2
    for found in branch.bifurcations:
        assert all(isinstance(orbit, ImpactOrbit) for orbit in found.switch())


# --- sliders that yield at once -------------------------------------------------------------------


def test_two_equal_joints_are_one_of_twice_the_stiffness() -> None:
    halves = [Jenkins(0, stiffness=1.0, force=0.15, name=name) for name in ("joint", "other")]
    two, one = orbit_of(ONE.replace(elements=halves)), orbit_of(ONE)
    assert isinstance(two, ImpactOrbit)
    assert two.admissible
    assert two.counts == {"joint.sticks": 2, "other.sticks": 2}
    times = np.linspace(0.0, one.period, 9)
    apart = [abs(a - b).max() for a, b in zip(two.sample(times), one.sample(times), strict=True)]
    assert max(apart) <= one.error + two.error
    assert abs(np.append(one.multipliers, 0.0) - two.multipliers).max() < 1e-13
    problem = two.problem("frequency")
    check_problem(problem, two.unknowns, problem.values)


def test_joints_of_a_symmetric_machine_yield_at_once() -> None:
    joints = [Jenkins(k, stiffness=2.0, force=0.3, name=f"joint{k}") for k in range(2)]
    pair = MatrixOscillator(
        M=np.eye(2),
        C=0.05 * np.eye(2),
        K=[[1.5, -0.5], [-0.5, 1.5]],
        frequency=0.8,
        harmonic_forces=[0.8, 0.8],
        elements=joints,
    )
    orbit: Any = pair.attractor(transient=900, impacts=60).periodic_orbit()
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.admissible
    # moving together the two stretch no spring between them
    one = orbit_of(ONE)
    (place, _), (wanted, _) = (o.sample(np.linspace(0.0, 7.0, 9)) for o in (orbit, one))
    assert abs(place - wanted).max() <= orbit.error + one.error
    branch = continue_orbit(orbit, "frequency", bounds=(0.79, 0.81))
    assert branch.admissible.all()


# --- sliders that yield at once -------------------------------------------------------------------


def twins(force: float, rows: tuple[int, int]) -> Any:
    """Two equal masses, or one, with two sliders, which are equal where the force is 0.3."""
    n = max(rows) + 1
    return MatrixOscillator(
        M=np.eye(n),
        C=0.1 * np.eye(n),
        K=float(n) * np.eye(n) - (n - 1.0) * np.eye(n)[::-1],
        frequency=0.7,
        harmonic_forces=[0.8] * n,
        elements=[
            Jenkins(rows[0], stiffness=1.0, force=0.3, name="one"),
            Jenkins(rows[1], stiffness=1.0, force=force, name="other"),
        ],
    )


@pytest.mark.parametrize("rows", [(0, 1), (0, 0)])
def test_branches_on_both_sides_of_equal_sliders_are_motions(rows: tuple[int, int]) -> None:
    orbit = orbit_of(twins(0.3, rows))
    branch = continue_orbit(orbit, "other.force", bounds=(0.298, 0.302), **WIDE)
    found = branch.bifurcations[0]
    (other,) = found.switch()
    below = continue_orbit(other, "other.force", bounds=(0.298, 0.302), **WIDE)
    # on the border itself rounding decides
    for part, sign in ((branch, 1.0), (below, -1.0)):
        assert part.bifurcations
        for own in part.bifurcations:
            assert "at once" in own.touching
            assert abs(own.value - 0.3) <= own.error < 1e-10
        apart = abs(part.parameter - 0.3) > 1e-9
        assert (part.admissible == (sign * (part.parameter - 0.3) > 0.0))[apart].all()
        end = part.orbit(int(np.argmax(sign * part.parameter)))
        settled = end.system.attractor(transient=900, impacts=1)
        apart = abs(end.system.difference(end.states[-1], settled.states[-1])).max()
        assert apart <= end.error + settled.error


def test_a_branch_to_smaller_values_begins_in_their_order() -> None:
    branch = continue_orbit(orbit_of(twins(0.3, (0, 1))), "other.force", bounds=(0.28, 0.3))
    assert branch.admissible[branch.parameter < 0.3].all()


def test_sliders_that_no_parameter_parts_stay_one_event() -> None:
    orbit = orbit_of(twins(0.3, (0, 1)))
    branch = continue_orbit(orbit, "frequency", bounds=(0.69, 0.72))
    assert branch.admissible.all()
    assert not branch.bifurcations
    problem: Any = branch._problem
    assert len(problem.itinerary) == 4


@pytest.mark.parametrize(
    ("frequency", "stiffness", "force", "offset", "restitution", "sides"),
    [
        (0.66, 0.43, 0.12, -0.29, 0.48, [True]),
        (0.83, 5.18, 0.24, -0.28, 0.47, [True, False]),
        (0.79, 7.88, 0.2, -0.02, 0.74, [False, True, False]),
    ],
)
def test_a_slider_that_yields_at_the_very_place_of_a_stop_is_a_motion_or_none(
    frequency: float,
    stiffness: float,
    force: float,
    offset: float,
    restitution: float,
    sides: list[bool],
) -> None:
    """An impact leaves it as it yields; at the next one rounding decides whether it does."""
    machine = ImpactChain(
        masses=1,
        damping=0.1,
        frequency=frequency,
        harmonic_forces=[0.5],
        elements=[
            HardStop(0, offset=offset, restitution=restitution),
            Jenkins(0, stiffness=stiffness, force=force),
        ],
    )
    orbit = machine.attractor(transient=300, impacts=40).periodic_orbit()
    assert orbit.admissible
    bounds = 0.9 * frequency, 1.1 * frequency
    branch = continue_orbit(orbit, "frequency", bounds=bounds, points=40)
    changes = np.flatnonzero(np.diff(branch.admissible))
    assert branch.admissible[[0, *(changes + 1)]].tolist() == sides
    places = [found.place for found in branch.bifurcations if found.kind == "GR"]
    assert all(min(abs(change + 0.5 - place) for place in places) < 1.0 for change in changes)


def test_switching_where_an_impact_leaves_a_slider_at_its_limit_leads_to_motions_only() -> None:
    """At both ends a slider yields: before an impact that finds it at its limit, and at a stop."""
    machine = ImpactChain(
        masses=1,
        damping=0.1,
        frequency=0.79,
        harmonic_forces=[0.5],
        elements=[
            HardStop(0, offset=-0.02, restitution=0.74, name="table"),
            Jenkins(0, stiffness=7.88, force=0.2, name="joint"),
        ],
    )
    orbit = machine.attractor(transient=300, impacts=40).periodic_orbit()
    name, bounds = "table.restitution", (0.6, 0.78)
    branch = continue_orbit(orbit, name, bounds=bounds)
    hits, slips, yields = sorted(branch.bifurcations, key=lambda b: (round(b.value, 9), b.event))
    assert abs(hits.value - slips.value) < 1e-9
    for found, what in ((hits, "grazing"), (slips, "grazing-sliding"), (yields, "grazing-sliding")):
        assert what in found.touching
    assert not slips.switch()  # the impact turns it back
    assert len(hits.switch()) == 1
    (there,) = yields.switch()
    beyond = continue_orbit(there, name, bounds=bounds)
    assert beyond.admissible[beyond.parameter > yields.value].all()
    end = beyond.orbit(int(np.argmax(beyond.parameter)))
    assert end.system.parameters[name] == bounds[1]
    settled = end.system.attractor(transient=900, impacts=1)
    apart = [abs(end.system.difference(settled.states[-1], own)).max() for own in end.states]
    assert min(apart) <= end.error + settled.error
