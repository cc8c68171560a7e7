"""Stroboscopic sections and impact sections."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from dynkit.analysis import ImpactSection, StroboscopicSection
from dynkit.dynamics.attractor import MapAttractor
from dynkit.plotting.figures import new_figure
from dynkit.systems import HardStop, Henon, ImpactChain, SoftStop
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor


def attractor_of(frequency: float = 0.87, transient: int = 700) -> ImpactAttractor:
    return ImpactChain(frequency=frequency).attractor(transient=transient)


def henon() -> MapAttractor:
    return MapAttractor(Henon(), np.zeros(2), transient=100, iterations=50)


# --- stroboscopic sections ------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.0, 2.0, -1.0, 40.0])
def test_phase_at_the_times_is_the_one_asked_for(phase: float) -> None:
    attractor = attractor_of()
    section = StroboscopicSection(attractor, phase=phase)
    angle = 0.87 * section.times + attractor.record.start.phase - phase
    # a few hundred periods, each rounded
    assert abs(np.exp(1j * angle) - 1.0).max() < 1e-12


def test_first_time_is_within_the_first_period() -> None:
    assert 0.0 <= StroboscopicSection(attractor_of(), phase=3.0).times[0] < 2.0 * np.pi / 0.87


def test_states_are_those_of_the_attractor() -> None:
    attractor = attractor_of(0.35)
    section = StroboscopicSection(attractor, periods=7)
    assert np.array_equal(section.states, attractor.time_series(section.times))


def test_kept_impacts_tell_how_many_periods_are_the_default() -> None:
    attractor = attractor_of(0.35)
    times, end = StroboscopicSection(attractor).times, attractor.record.time[-1]
    assert times[-1] <= end < times[-1] + 2.0 * np.pi / 0.35


def test_period_of_the_orbit_is_that_of_its_section() -> None:
    states = StroboscopicSection(attractor_of(transient=3000), periods=9).states
    # P(1,3), which its transient has reached to rounding
    assert states[3:] == pytest.approx(states[:-3], rel=0.0, abs=1e-12)
    assert abs(states[1:] - states[:-1]).max(axis=1).min() > 1e-3


def test_array_holds_the_states() -> None:
    states = np.arange(6.0).reshape(3, 2)
    section = StroboscopicSection(states)
    assert np.array_equal(section.states, states)
    assert section.error == 0.0
    assert states.flags.writeable


def test_error_of_a_section_is_that_of_the_attractor() -> None:
    attractor = attractor_of()
    assert StroboscopicSection(attractor).error == attractor.error
    assert ImpactSection(attractor).error == attractor.error


def test_cost_counts_the_states() -> None:
    assert StroboscopicSection(attractor_of(), periods=5).cost.counts == {"states": 5}


# --- impact sections ------------------------------------------------------------------------------


def test_impact_section_has_the_states_that_were_kept() -> None:
    attractor = attractor_of(0.35)
    section = ImpactSection(attractor)
    assert np.array_equal(section.states, attractor.states)
    assert np.array_equal(section.relative_velocity, attractor.record.relative_velocity)
    assert np.array_equal(section.phase, attractor.record.phase)


def test_last_columns_of_an_array_are_relative_velocity_and_phase() -> None:
    section = ImpactSection([[9.0, 0.1, 2.0], [8.0, 0.2, 3.0]])
    assert section.relative_velocity.tolist() == [0.1, 0.2]
    assert section.phase.tolist() == [2.0, 3.0]


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", [StroboscopicSection, ImpactSection])
@pytest.mark.parametrize("source", [[[1.0]], np.empty((0, 2))])
def test_arrays_without_a_plane_are_refused(section: Any, source: Any) -> None:
    with pytest.raises(ValueError, match=re.escape("source must have shape (1, 2) or more; got")):
        section(source)


def test_map_is_not_driven() -> None:
    with pytest.raises(ValueError, match="source must be driven at one frequency; got"):
        StroboscopicSection(henon())


def test_map_has_no_impacts() -> None:
    with pytest.raises(ValueError, match="source must be a motion with impacts; got"):
        ImpactSection(henon())


def test_motion_without_impacts_is_refused() -> None:
    resting = ImpactChain(frequency=0.87, offset=-10.0).attractor()
    with pytest.raises(ValueError, match="source must hold an impact or more; got 0"):
        ImpactSection(resting)


def test_periods_of_a_motion_without_impacts_must_be_given() -> None:
    resting = ImpactChain(frequency=0.87, offset=-10.0).attractor()
    with pytest.raises(ValueError, match="periods must be given: the kept impacts end before"):
        StroboscopicSection(resting, phase=1.0)


def test_motion_without_impacts_has_a_stroboscopic_section() -> None:
    resting = ImpactChain(frequency=0.87, offset=-10.0).attractor()
    states = StroboscopicSection(resting, periods=400).states
    # rest, once the first mode has decayed: exp(-0.1 * 0.15^2 / 2 * 2900) of its amplitude
    assert abs(states[-1]).max() < 0.05 * abs(states[0]).max()


def test_periods_of_an_array_are_refused() -> None:
    with pytest.raises(ValueError, match="periods must be left out with an array; got 3"):
        StroboscopicSection(np.eye(2), periods=3)


def test_phases_just_below_zero_are_below_two_pi() -> None:
    assert StroboscopicSection(np.eye(2), phase=-1e-17).phase == 0.0
    assert ImpactSection(np.array([[0.1, -1e-17]])).phase.tolist() == [0.0]


@pytest.mark.parametrize("section", [StroboscopicSection, ImpactSection])
def test_unknown_coordinates_are_refused(section: Any) -> None:
    _, (axes,) = new_figure()
    with pytest.raises(ValueError, match=re.escape("coordinates[1] must lie in [-2, 1]; got 2")):
        section(np.eye(2)).plot(axes, coordinates=(0, 2))
    for wrong in (3, np.array(3), (0,), (0, 1, 1), np.arange(3)):
        with pytest.raises(ValueError, match="coordinates must be two numbers of coordinates; got"):
            section(np.eye(2)).plot(axes, coordinates=wrong)


# --- figures --------------------------------------------------------------------------------------


def test_position_and_velocity_of_the_contact_mass_are_drawn() -> None:
    section = StroboscopicSection(attractor_of())
    _, (axes,) = new_figure()
    assert section.plot(axes) is axes
    assert np.array_equal(axes.lines[0].get_xdata(), section.states[:, 9])
    assert np.array_equal(axes.lines[0].get_ydata(), section.states[:, 19])
    names = axes.get_xlabel(), axes.get_ylabel()
    assert names == ("displacement $x_{10}$", "velocity $v_{10}$")


def test_relative_velocity_is_drawn_against_phase() -> None:
    section = ImpactSection(attractor_of(0.35))
    _, (axes,) = new_figure()
    assert section.plot(axes) is axes
    assert np.array_equal(axes.lines[0].get_xdata(), section.phase)
    assert np.array_equal(axes.lines[0].get_ydata(), section.relative_velocity)
    assert axes.get_xlim() == (0.0, 2.0 * np.pi)
    assert axes.get_ylabel() == "relative velocity $u$"


def test_other_coordinates_are_drawn_as_asked() -> None:
    section = ImpactSection(attractor_of(0.35))
    _, (axes,) = new_figure()
    section.plot(axes, coordinates=(0, 3))
    assert np.array_equal(axes.lines[0].get_ydata(), section.states[:, 3])
    assert axes.get_xlabel() == "section coordinate 0"


@pytest.mark.parametrize("section", [StroboscopicSection, ImpactSection])
def test_coordinates_may_be_an_array(section: Any) -> None:
    _, (axes,) = new_figure()
    section(np.array([[0.1, 0.2], [0.3, 0.4]])).plot(axes, coordinates=np.array([1, 0]))
    assert np.asarray(axes.lines[0].get_ydata()).tolist() == [0.1, 0.3]


def test_few_points_are_drawn_larger_than_many() -> None:
    sizes = []
    for frequency in (0.87, 0.35):
        _, (axes,) = new_figure()
        attractor = ImpactChain(frequency=frequency).attractor(impacts=1000)
        ImpactSection(attractor).plot(axes)
        sizes.append(axes.lines[0].get_markersize())
    assert sizes[0] > sizes[1]


def test_array_is_drawn() -> None:
    _, (axes,) = new_figure()
    StroboscopicSection(np.arange(6.0).reshape(2, 3)).plot(axes)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("coordinate 0", "coordinate 1")


def test_velocity_after_impact_is_drawn_against_phase() -> None:
    attractor = ImpactChain(frequency=0.35).attractor()
    section = ImpactSection(attractor)
    _, (axes,) = new_figure()
    section.plot_velocity(axes)
    points = np.asarray(axes.lines[0].get_xydata())
    assert points[:, 0] == pytest.approx(attractor.record.phase)
    # the record knows the velocity of the mass, the section that relative to the table
    assert points[:, 1] == pytest.approx(attractor.record.velocity[:, 9], rel=1e-10)
    assert axes.get_ylabel() == "velocity $v_{10}$ after impact"


@pytest.mark.parametrize(
    "given",
    [
        {"side": "below"},
        {"side": "below", "play": 0.6},
        {"elements": [HardStop(1, side="below", amplitude=0.3, phase=0.4)]},
    ],
)
def test_velocity_after_impact_is_that_of_the_mass_at_any_stop(given: dict[str, Any]) -> None:
    system = ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0.0, 1.5], **given)
    attractor = system.attractor(transient=9, impacts=20)
    _, (axes,) = new_figure()
    ImpactSection(attractor).plot_velocity(axes)
    points = np.asarray(axes.lines[0].get_xydata())
    assert points[:, 1] == pytest.approx(attractor.record.velocity[:, 1], rel=1e-10)


def test_phases_at_several_stops_are_below_a_turn() -> None:
    stops = [HardStop(1, offset=-0.1), HardStop(1, side="below", offset=0.3)]
    system = ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0.0, 1.5], elements=stops)
    attractor = system.attractor(transient=9, impacts=20)
    section = ImpactSection(attractor)
    assert np.unique(attractor.record.element).tolist() == [0, 1]
    assert section.phase == pytest.approx(attractor.record.phase, abs=1e-13)
    with pytest.raises(
        ValueError, match="source must be an attractor to draw velocities, with one"
    ):
        section.plot_velocity()


def test_a_motion_without_a_hard_stop_has_no_section_of_impacts() -> None:
    soft = SoftStop(0, stiffness=9.0)
    system = ImpactChain(masses=1, frequency=0.9, harmonic_forces=[1.0], elements=[soft])
    with pytest.raises(ValueError, match="source must be a motion with impacts; got ImpactChain"):
        ImpactSection(system.attractor(transient=9))


def test_velocity_of_the_table_is_dashed() -> None:
    _, (axes,) = new_figure()
    ImpactSection(ImpactChain(frequency=0.35).attractor()).plot_velocity(axes)
    table = axes.lines[1]
    phase, velocity = np.asarray(table.get_xydata()).T
    assert table.get_linestyle() == "--"
    assert velocity == pytest.approx(0.1 * 0.35 * np.cos(phase), abs=1e-15)


def test_velocity_of_an_array_is_not_drawn() -> None:
    with pytest.raises(ValueError, match="source must be an attractor to draw velocities"):
        ImpactSection([[0.1, 2.0]]).plot_velocity()
