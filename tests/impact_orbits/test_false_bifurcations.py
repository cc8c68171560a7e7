"""What looks like a bifurcation of an orbit that strikes weakly, and is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynkit import Branch, continue_curve, continue_orbit
from dynkit.continuation.bifurcations.tracing import is_of_event
from dynkit.continuation.crossings import Crossing, Located
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactOrbit,
    Jenkins,
    MatrixOscillator,
    SoftStop,
)
from tests.reference.random_machines import random_machine
from tests.validation.curves import _oscillators as oscillators


def test_no_torus_begins_where_an_undamped_structure_only_grazes() -> None:
    """A pair of multipliers gets to those of the structure held at the stop, of modulus one."""
    system = MatrixOscillator(
        M=[[1.5712890625, -0.5712890625], [-0.5712890625, 1.5712890625]], C=np.zeros((2, 2)),
        K=[[3.0, -2.0], [-2.0, 2.0]], frequency=0.850095, restitution=0.362578,
        amplitude=0.983923, offset=0.493281, contact=0, side="below",
        constant_forces=(0.955946, 0.241945),
    )  # fmt: skip
    orbit = system.periodic_orbits()[0]
    branch = continue_orbit(orbit, "offset", bounds=(0.093281, 0.893281), points=40)
    assert [found.kind for found in branch.bifurcations] == ["GR", "PD"]


def weak() -> Branch:
    system = MatrixOscillator(
        M=[[1.0]], C=[[1.6e-5]], K=[[1.0]], frequency=0.0711933, restitution=1.0,
        amplitude=0.122518, offset=0.120211, contact=0, side="below",
    )  # fmt: skip
    (orbit,) = system.periodic_orbits()
    return continue_orbit(orbit, "amplitude", bounds=(0.098, 0.147))


def test_a_gap_that_closes_unseen_before_is_no_grazing() -> None:
    """Between two samples it is closed already; no smallest gap passes zero there."""
    branch = weak()
    assert [found.kind for found in branch.bifurcations] == ["GR", "PD"]
    assert abs(branch.bifurcations[0].value - 0.120211) < 1e-12


def test_rounding_where_a_flight_begins_without_rebound_is_no_dip() -> None:
    system = MatrixOscillator(
        M=np.eye(2), C=np.zeros((2, 2)), K=[[3.0, -2.0], [-2.0, 2.0]], frequency=19.6978,
        restitution=0.0, amplitude=0.0, offset=0.002, contact=0, side="below",
        harmonic_forces=(-0.745759 + 0.900294j, 0.296954 - 0.810871j),
    )  # fmt: skip
    orbit = min(system.periodic_orbits(periods=3), key=lambda orbit: orbit.impulses[0])
    branch = continue_orbit(orbit, "offset", bounds=(0.001, 0.005))
    assert [found.kind for found in branch.bifurcations] == ["GR"]


def test_what_an_orbit_leaves_where_a_flight_begins_is_no_dip() -> None:
    """Along a branch the gap at the impact is a little more than rounding."""
    assert [found.kind for found, *_ in oscillators(695)] == ["NS", "NS", "GR", "CB"]


def test_no_curve_is_begun_from_what_was_not_solved_for() -> None:
    grazing = replace(weak().bifurcations[0], event=1, own=np.array([np.nan]))
    with pytest.raises(ValueError, match=r"^bifurcation must be solved for; got "):
        continue_curve(grazing, ("amplitude", "frequency"), bounds=((0.1, 0.2), (0.05, 0.1)))


@pytest.fixture(scope="module")
def reaching() -> ImpactOrbit:
    """The orbit that only just reaches a soft stop."""
    pad = SoftStop(0, offset=-0.5, stiffness=3.0)
    machine = ImpactChain(
        masses=1, damping=0.05, frequency=0.3, harmonic_forces=[0.2], elements=[pad]
    )
    linear = machine.attractor().periodic_orbit()
    below = continue_orbit(linear, "frequency", bounds=(0.3, 0.9), largest_step=0.2)
    orbit: ImpactOrbit
    (orbit,) = below.bifurcations[0].switch()
    return orbit


def test_no_period_doubles_where_a_soft_stop_is_only_just_reached(reaching: ImpactOrbit) -> None:
    """The equations of both crossings are singular there, for -1 also, which is no multiplier."""
    branch = continue_orbit(reaching, "frequency", bounds=(0.3, 1.5), largest_step=0.2)
    assert [found.kind for found in branch.bifurcations] == ["GR", "SN", "SN", "GR"]


@pytest.mark.parametrize(
    ("first", "largest", "bounds"),
    [
        (0.0011, 0.29, (0.52, 1.53)),
        (0.0365, 0.32, (0.65, 1.55)),
        (0.0042, 0.26, (0.38, 1.33)),
        (0.0065, 0.2, (0.55, 1.42)),
        (0.01, 0.15, (0.3, 1.5)),
        (0.02, 0.25, (0.45, 1.4)),
        (0.05, 0.4, (0.6, 1.6)),
        (0.002, 0.18, (0.7, 1.3)),
    ],
)
def test_each_fold_is_found_once_where_units_change(
    reaching: ImpactOrbit, first: float, largest: float, bounds: tuple[float, float]
) -> None:
    """The velocity at the stop, and so its unit, falls to zero along the branch."""
    branch = continue_orbit(reaching, "frequency", bounds=bounds, step=first, largest_step=largest)
    values = sorted(found.value for found in branch.bifurcations)
    expected = [0.7758126931, 1.1799283792, 1.1813613610, 1.2864923408]
    assert values == pytest.approx(expected, abs=1e-9)
    ways = np.diff(np.column_stack([branch.unknowns, branch.parameter]), axis=0)
    assert ((ways[1:] * ways[:-1]).sum(axis=1) > 0.0).all()


def test_no_fold_where_friction_only_just_sticks() -> None:
    """Two events merge there: the parameter turns along the equations, no multiplier is one."""
    system, start = random_machine(403)
    orbit = system.attractor(start=start, transient=300, impacts=40).periodic_orbit()
    frequency = system.frequency
    branch = continue_orbit(orbit, "frequency", bounds=(0.95 * frequency, 1.02 * frequency))
    values = [found.value for found in branch.bifurcations if found.kind == "GR"]
    folds = [found.value for found in branch.bifurcations if found.kind == "SN"]
    assert len(values) >= 2
    assert all(min(abs(fold - value) for value in values) > 1e-6 for fold in folds)


def test_no_fold_where_events_merge_of_an_orbit_that_is_no_motion() -> None:
    """No GR is named there: the orbit is inadmissible on both sides."""
    stops = [
        SoftStop(1, offset=-0.067, stiffness=5.3, damping=0.36),
        SoftStop(0, side="below", offset=0.151, stiffness=17.7),
    ]
    machine = ImpactChain(
        masses=2, damping=0.2, frequency=0.92, harmonic_forces=[0.92, 0.0], elements=stops
    )
    orbit = machine.attractor(transient=400).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.872, 0.93))
    assert "GR" in {found.kind for found in branch.bifurcations}
    folds = [found for found in branch.bifurcations if found.kind == "SN"]
    assert [abs(fold.orbit.multipliers - 1.0).min() for fold in folds] == []


def test_no_period_doubles_where_events_merge_within_rounding() -> None:
    """Where a GR is known to 1e-7 only, the equations are singular for -1 as well."""
    pad = SoftStop(2, offset=-0.189, stiffness=4.47, damping=0.2)
    machine = ImpactChain(
        masses=3, damping=0.121, frequency=1.3036, harmonic_forces=[0.0, 0.0, 0.609],
        elements=[pad, DryFriction(0, force=0.042)],
    )  # fmt: skip
    orbit = machine.attractor(transient=400, impacts=60).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(1.23, 1.31), points=150)
    values = [found.value for found in branch.bifurcations if found.kind == "GR"]
    assert any(abs(value - 1.2508277562) < 1e-8 for value in values)
    doubled = [found.value for found in branch.bifurcations if found.kind == "PD"]
    assert all(min(abs(double - value) for value in values) > 1e-5 for double in doubled)


def test_no_branch_crosses_where_a_preloaded_stop_is_only_just_left() -> None:
    """The determinant changes its sign where the two events merge, and no multiplier is one."""
    pad = SoftStop(0, offset=-0.6783, side="below", stiffness=6.803, preload=0.2)
    machine = ImpactChain(
        masses=2, damping=0.1617, frequency=0.8392, harmonic_forces=[0.4194, 1.131], elements=[pad]
    )
    orbit = machine.attractor(transient=200, impacts=20).periodic_orbit()
    branch = continue_orbit(
        orbit, "frequency", bounds=(0.7945, 0.847592), step=0.011, largest_step=0.022, points=80
    )
    grazing, fold = branch.bifurcations
    assert (grazing.kind, fold.kind) == ("GR", "SN")
    assert grazing.value == pytest.approx(0.7970104822288, abs=2.0 * grazing.error)
    assert grazing.error < 1e-7
    assert fold.value == pytest.approx(0.797003473318, abs=1e-12)


def test_a_curve_of_period_doublings_ends_where_it_meets_a_grazing() -> None:
    """Where two events merge the equations are singular for -1 also, which is no multiplier."""
    joint = Jenkins(0, stiffness=2.78, force=0.169, name="joint")
    pad = SoftStop(0, offset=-0.089, stiffness=10.2)
    machine = ImpactChain(
        masses=1, damping=0.1, frequency=0.947, harmonic_forces=[0.86], elements=[joint, pad]
    )
    orbit = machine.attractor(transient=400).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.9, 1.05))
    doubling = [found for found in branch.bifurcations if found.kind == "PD"][-1]
    names, bounds = ("frequency", "joint.stiffness"), ((0.7, 1.2), (2.36, 3.0))
    curve = continue_curve(doubling, names, bounds=bounds)
    critical = [abs(curve.orbit(k).multipliers + 1.0).min() for k in range(len(curve))]
    assert max(critical) < 1e-9
    frequency, stiffness = curve.parameters[0]
    assert curve.endings[0].message == (
        f"beyond, there is no such orbit: frequency, joint.stiffness {frequency:.6g}, "
        f"{stiffness:.6g}"
    )
    assert curve.endings[1].message == "the bound was reached: joint.stiffness 3"


def test_a_border_of_endless_chatter_begins_no_curve() -> None:
    stop = HardStop(0, offset=0.18, restitution=0.28, name="stop")
    machine = ImpactChain(
        masses=1, damping=0.1, frequency=1.04, harmonic_forces=[0.83], elements=[stop]
    )
    orbit = machine.attractor(transient=200).periodic_orbit()
    branch = continue_orbit(orbit, "stop.restitution", bounds=(0.2, 0.4))
    (border,) = (found for found in branch.bifurcations if found.kind == "CB")
    bounds = ((0.2, 0.4), (0.1, 0.3))
    with pytest.raises(ValueError, match="an endless chatter ends is not smooth"):
        continue_curve(border, ("stop.restitution", "stop.offset"), bounds=bounds)


def located(kind: str, value: float, event: int = -1, error: float = 1e-13) -> Located:
    crossing, none = Crossing(BifurcationKind(kind), event), np.empty(0)
    p, errors = np.array([value]), np.array([error])
    return Located(crossing, none, none, p, errors, None, none, (), 0.0, 0)


def test_what_is_the_effect_of_a_grazing_is_at_its_value_and_place() -> None:
    grazing = [(7.5, located("GR", 0.5, event=0))]
    assert is_of_event(8.9, located("SN", 0.5), grazing)
    assert is_of_event(7.5, located("NS", 0.5 + 3e-13), grazing)
    assert not is_of_event(9.6, located("SN", 0.5), grazing)
    assert not is_of_event(7.6, located("PD", 0.5 + 1e-12), grazing)
    assert not is_of_event(7.6, located("BP", 0.5), grazing)
    assert not is_of_event(7.6, located("SN", 0.6, error=np.inf), grazing)
    assert not is_of_event(7.6, located("SN", 0.6), [(7.5, located("GR", 0.5, 0, np.inf))])


def test_a_label_has_no_multiplier_where_an_outcome_is_a_choice() -> None:
    system, start = random_machine(417)
    label = system.attractor(start=start, transient=300, impacts=40).label
    assert str(label) == "P(2,1)"
    assert np.isnan(label.multiplier)


def test_orbits_beyond_a_grazing_have_their_least_period() -> None:
    """P(5,2) is born where P(2,1) grazes: on P(5,2) an impact vanishes and another appears."""
    stops = [
        HardStop(0, offset=-0.46097290411016306, restitution=0.41772166487628304, name="a"),
        HardStop(
            0, side="below", offset=0.2933115468204526, restitution=0.5144156138907512, name="b"
        ),
    ]
    machine = ImpactChain(
        masses=1,
        damping=0.17749350197534275,
        frequency=1.0524794130955895,
        harmonic_forces=[0.6520223518116196],
        elements=stops,
    )
    orbit = machine.attractor(transient=300).periodic_orbit()
    assert str(orbit.label) == "P(5,2)"
    branch = continue_orbit(orbit, "a.restitution", bounds=(0.351, 0.5))
    borders = [found for found in branch.bifurcations if found.kind == "GR"]
    assert [found.value for found in borders] == pytest.approx([0.35200065958049] * 2, abs=1e-12)
    beyond = [other for found in borders for other in found.switch()]
    assert sorted(str(other.label) for other in beyond) == ["P(2,1)", "P(3,1)"]
    (alone,) = (other for other in beyond if str(other.label) == "P(2,1)")
    other = continue_orbit(alone, "a.restitution", bounds=(0.34, 0.5))
    grazings = [found.value for found in other.bifurcations if found.kind == "GR"]
    assert grazings == pytest.approx([borders[0].value], abs=1e-11)
