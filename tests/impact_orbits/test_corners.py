"""Borders at which two things happen at once: closed forms, and simulation on both sides."""

from typing import Any

import numpy as np
import pytest

from dynkit import NoConvergence, continue_orbit
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    MatrixOscillator,
    SoftStop,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.orbits.exponentials import run_through
from dynkit.systems.impact.orbits.itineraries import flying
from dynkit.systems.impact.orbits.itineraries.corners import Corner

FIRST = HardStop(0, offset=-0.3, amplitude=0.1, phase=1.0, restitution=0.5, name="a")


def machine(*others: Any) -> ImpactChain:
    return ImpactChain(
        masses=1, damping=0.1, frequency=0.8, harmonic_forces=[1.0], elements=[FIRST, *others]
    )


@pytest.mark.parametrize(
    "other",
    [
        HardStop(0, offset=-0.6, restitution=0.5, name="b"),
        SoftStop(0, offset=-0.6, stiffness=5.0, damping=0.3, name="b"),
    ],
    ids=["hard", "soft"],
)
def test_an_orbit_ends_where_another_stop_reaches_the_place_of_an_impact(other: Any) -> None:
    # the mass turns at its impacts, so that its lowest place is that of one of them
    orbit: Any = machine(other).attractor(transient=100, impacts=20).periodic_orbit()
    assert orbit.label == "P(2,1)"
    lowest = orbit.sample(orbit.time)[0].min()
    branch = continue_orbit(orbit, "b.offset", bounds=(-0.6, -0.3))
    (found,) = (b for b in branch.bifurcations if b.admissible)
    assert found.kind == "GR"
    assert abs(found.value - lowest) <= found.error + orbit.error
    assert found.switch() == []
    assert "at once" in found.touching
    assert (branch.admissible == (branch.parameter < lowest)).all()


def test_an_orbit_ends_where_an_impact_only_just_keeps_friction_slipping() -> None:
    # masses couple the two rows, so that an impact makes the velocity of slip jump
    machine = MatrixOscillator(
        M=[[1.0, 0.4], [0.4, 1.0]],
        C=0.1 * np.eye(2),
        K=[[1.2, -0.3], [-0.3, 1.0]],
        frequency=0.742,
        harmonic_forces=[1.0, 0.482],
        elements=[
            HardStop(0, offset=-0.3, restitution=0.6, name="a"),
            DryFriction(1, force=0.0714, velocity=0.3, name="belt"),
        ],
    )
    orbit: Any = machine.attractor(transient=100, impacts=20).periodic_orbit()
    branch = continue_orbit(orbit, "belt.velocity", bounds=(0.3, 0.45))
    (found,) = branch.bifurcations
    after = found.orbit.sample([found.touching["at once"] + 1e-9])[1][0, 1]
    assert abs(after - found.value) < 1e-7
    assert (branch.admissible == (branch.parameter < found.value)).all()


def test_friction_that_no_stop_presses_is_not_watched_where_nothing_happens() -> None:
    stop = HardStop(0, offset=-1.0, amplitude=0.1, restitution=0.5, name="stop")
    machine = ImpactChain(
        masses=2,
        damping=0.2,
        frequency=1.1,
        elements=[stop, DryFriction(1, coefficient=0.3, normal="stop")],
    )
    orbit: Any = machine.attractor().periodic_orbit()
    assert orbit.label == "P(0,1)"
    assert orbit.admissible
    assert not continue_orbit(orbit, "frequency", bounds=(1.0, 1.2)).bifurcations


def test_a_motion_that_begins_at_rest_and_reaches_no_stop_has_its_orbit() -> None:
    # known at once, so that the motion lasts no time; the response of a chain in closed form
    stop = HardStop(0, offset=-1.0, restitution=0.5)
    machine = ImpactChain(
        masses=2, damping=0.2, frequency=1.1, harmonic_forces=[0.1, 0.0], elements=[stop]
    )
    orbit: Any = machine.attractor().periodic_orbit()
    assert orbit.label == "P(0,1)"
    w, m, c, k = 1.1, machine.mass, machine.damping_matrix, machine.stiffness
    amplitudes = np.linalg.solve(k - w**2 * m + 1j * w * c, np.asarray(machine.harmonic_forces))
    positions = orbit.sample(np.linspace(0.0, orbit.period, 5))[0]
    turns = np.exp(1j * (orbit.phases[0] + np.linspace(0.0, 2.0 * np.pi, 5)))
    convention = [np.outer(turns, a).imag for a in (amplitudes, 1j * amplitudes)]
    assert min(abs(positions - x).max() for x in convention) < 1e-13


def test_bounces_that_die_away_without_end_are_no_cycle() -> None:
    machine = ImpactChain(
        masses=3,
        frequency=1.7,
        constant_forces=[-0.1, 0.36, -0.31],
        elements=[HardStop(1, offset=0.18, side="above", restitution=ViscoelasticSpheres(0.13))],
    )
    start = machine.attractor(transient=400, impacts=1).final
    with pytest.raises(NoConvergence):  # which one of two reasons is rounding
        machine.periodic_orbit(start=start)


@pytest.mark.parametrize(("name", "bounds"), [("static", (0.4, 0.5)), ("force", (0.3, 0.4))])
def test_branches_leave_equal_static_and_kinetic_forces(
    name: str, bounds: tuple[float, float]
) -> None:
    # slip then begins with an acceleration that it has not where the two are equal
    friction = DryFriction(0, force=0.4, static=0.4, name="joint")
    machine = ImpactChain(
        masses=1, damping=0.02, frequency=0.4, harmonic_forces=[1.0], elements=[friction]
    )
    orbit: Any = machine.attractor(transient=20, impacts=5).periodic_orbit()
    branch = continue_orbit(orbit, f"joint.{name}", bounds=bounds)
    assert branch.admissible.all()
    there = branch.orbit(len(branch) // 2)
    anew: Any = there.system.attractor(transient=20, impacts=5).periodic_orbit()
    assert abs(there.states - anew.states).max() <= there.error + anew.error


@pytest.mark.parametrize("hard", [True, False], ids=["hard", "soft"])
def test_an_orbit_whose_friction_turns_ends_where_it_reaches_a_stop(hard: bool) -> None:
    # the mass is lowest where its friction turns, there its own velocity is zero
    place: dict[str, Any] = {"coordinate": 0, "name": "end", "offset": -3.0}
    end = HardStop(restitution=0.5, **place) if hard else SoftStop(stiffness=2.0, **place)
    machine = ImpactChain(
        masses=1,
        damping=0.05,
        frequency=0.7,
        harmonic_forces=[1.0],
        elements=[end, DryFriction(0, force=0.1)],
    )
    orbit: Any = machine.attractor().periodic_orbit()
    turns = (orbit._solution.event_phases - orbit.phases[0]) / machine.frequency
    lowest = orbit.sample(turns)[0].min()
    branch = continue_orbit(orbit, "end.offset", bounds=(-3.0, -1.0))
    (found,) = branch.bifurcations
    assert found.kind == "GR"
    assert found.admissible
    assert abs(found.value - lowest) <= found.error + orbit.error
    assert (branch.admissible == (branch.parameter < lowest)).all()


def test_a_branch_in_the_damping_of_a_soft_stop_ends_at_zero_and_does_not_begin_there() -> None:
    machine = ImpactChain(
        masses=1,
        damping=0.05,
        frequency=0.7,
        harmonic_forces=[1.0],
        elements=[SoftStop(0, name="pad", offset=-0.3, stiffness=4.0, damping=0.05)],
    )
    orbit: Any = machine.attractor().periodic_orbit()
    branch = continue_orbit(orbit, "pad.damping", bounds=(0.0, 0.1))
    assert branch.endings[0].reason.name == "NO_SOLUTION"
    assert branch.parameter[0] < 1e-8
    without: Any = machine.replace(**{"pad.damping": 0.0}).attractor().periodic_orbit()
    with pytest.raises(ValueError, match=r"got one at pad.damping 0:"):
        continue_orbit(without, "pad.damping", bounds=(0.0, 0.1))


def test_what_others_watch_at_an_event_needs_no_exponentials(monkeypatch: Any) -> None:
    other = SoftStop(0, offset=-0.6, stiffness=5.0, damping=0.3, name="b")
    orbit: Any = machine(other).attractor(transient=100, impacts=20).periodic_orbit()
    problem = orbit.problem()
    calls: list[Any] = []

    def counted(*given: Any) -> Any:
        calls.append(given)
        return run_through(*given)

    monkeypatch.setattr(flying, "run_through", counted)
    solution = problem._solution(orbit.unknowns, problem.scene(problem.values))
    borders = sorted(problem.borders(solution), key=lambda border: isinstance(border, Corner))
    asked = []
    for border in borders:
        border.value(solution)
        asked.append(len(calls))
    corners = sum(isinstance(border, Corner) for border in borders)
    assert corners > 1
    assert asked[-1] == asked[-1 - corners] > 0
    flights = {
        (flow.tobytes(), start.tobytes(), times.tobytes()) for flow, start, times, _ in calls
    }
    assert len(calls) == len(flights)  # one for all that is watched


def cushioned(damping: float) -> ImpactChain:
    cushion = SoftStop(0, stiffness=20.0, damping=damping, preload=0.1, name="cushion")
    return ImpactChain(
        masses=1, damping=0.1, frequency=0.8, harmonic_forces=[1.0], elements=[cushion]
    )


def test_an_orbit_meets_a_border_where_a_dashpot_takes_all_of_a_preload() -> None:
    # the force at the place of contact is the preload less the damping times the velocity
    orbit = cushioned(0.03).attractor(transient=100).periodic_orbit()
    branch = continue_orbit(orbit, "cushion.damping", bounds=(0.02, 0.4))
    (found,) = (b for b in branch.bifurcations if b.admissible)
    assert found.kind == "GR"
    at = found.touching["grazing"]
    gap, rate = found.orbit.sample(np.array([at]))
    assert abs(gap).max() < 1e-12
    assert abs(float(np.ravel(rate)[0]) * found.value - 0.1) < 1e-9
    assert (branch.admissible == (branch.parameter < found.value)).all()
    beyond = cushioned(0.083).attractor(transient=100).periodic_orbit()
    back = continue_orbit(beyond, "cushion.damping", bounds=(0.02, 0.085))
    (again,) = back.bifurcations
    assert abs(again.value - found.value) <= again.error + found.error


def test_a_branch_is_left_where_a_dashpot_takes_all_of_a_preload() -> None:
    orbit = cushioned(0.03).attractor(transient=100).periodic_orbit()
    (found,) = continue_orbit(orbit, "cushion.damping", bounds=(0.02, 0.08)).bifurcations
    (lifting,) = found.switch()
    branch = continue_orbit(lifting, "cushion.damping", bounds=(0.02, 0.085))
    beyond = branch.parameter > found.value + 1e-6
    assert beyond.sum() > 3
    assert branch.admissible[beyond].all()


STATIC = MatrixOscillator(
    M=[[1.2146]],
    C=[[0.1]],
    K=[[0.47625]],
    frequency=0.61169,
    harmonic_forces=[0.57444],
    constant_forces=[0.31514],
    elements=[
        HardStop(0, offset=0.08929, side="below", restitution=0.96, name="table"),
        DryFriction(0, force=0.09941, static=0.12924, name="rub"),
    ],
)
"""A mass whose slip changes its sign with a force just above the static force."""


def slipping() -> Any:
    """Its branch, along which the force at the change of sign falls to the static force."""
    orbit = STATIC.attractor(transient=400, impacts=40).periodic_orbit()
    return continue_orbit(orbit, "table.restitution", bounds=(0.96, 0.98))


def test_where_static_friction_holds_at_once_the_motion_jumps_to_the_branch_that_sticks() -> None:
    jump = slipping().bifurcations[0]
    assert "crossing-sliding" in jump.touching
    (there,) = jump.switch()
    beyond = continue_orbit(there, "table.restitution", bounds=(0.96, 0.98))
    (begin,) = beyond.bifurcations
    assert "switching-sliding" in begin.touching
    assert (beyond.admissible == (beyond.parameter > begin.value)).all()
    end = beyond.orbit(int(np.argmax(beyond.parameter)))
    settled = end.system.attractor(transient=400, impacts=1)
    apart = [abs(end.system.difference(settled.states[-1], own)).max() for own in end.states]
    assert min(apart) <= end.error + settled.error


def test_a_slip_between_a_change_of_sign_and_a_halt_vanishes_at_a_located_border() -> None:
    last = slipping().bifurcations[-1]
    assert "switching-sliding" in last.touching
    assert last.error < 1e-10
    (there,) = last.switch()
    assert there.counts["rub.sticks"] == 1
    assert len(there.unknowns) == len(last.orbit.unknowns) - 1


def test_a_branch_begins_where_a_soft_stop_is_left_for_a_moment() -> None:
    """Its gap touches zero from within; beyond, it is left and touched again."""
    two = MatrixOscillator(
        M=np.diag([0.8246, 0.6915]),
        C=0.1 * np.eye(2),
        K=[[2.716, -2.003], [-2.003, 4.508]],
        frequency=1.565,
        harmonic_forces=[0.8145 - 0.0378j, -0.9605 + 0.7088j],
        elements=[
            SoftStop((0, 1), offset=-0.0507, stiffness=3.953, name="stop"),
            Jenkins(
                0, amplitude=0.2828, side="below", stiffness=2.935, force=0.2063, velocity=-0.2
            ),
        ],
    )
    orbit: Any = two.attractor(transient=400, impacts=20).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(1.565, 1.58))
    grazing = next(b for b in branch.bifurcations if "grazing" in b.touching)
    (there,) = grazing.switch()
    beyond = continue_orbit(there, "frequency", bounds=(1.565, 1.58))
    assert there.counts["stop.presses"] == 2
    assert beyond.parameter.max() == 1.58
    assert beyond.admissible[beyond.parameter > grazing.value].all()
    end = beyond.orbit(int(np.argmax(beyond.parameter)))
    settled = end.system.attractor(transient=400, impacts=1)
    apart = abs(end.system.difference(settled.states[-1], end.states[0])).max()
    assert apart <= end.error + settled.error
