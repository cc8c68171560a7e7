"""What `plot` draws of records, attractors, orbits and sweeps."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.lines import Line2D

from dynkit import MapAttractor, basins, sweep
from dynkit.analysis import BifurcationDiagram, ImpactSection, TimeSeries
from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.plotting.figures import new_figure
from dynkit.plotting.points import PHASE, draw_motion, draw_points
from dynkit.systems import (
    BouncingBall,
    Henon,
    ImpactChain,
    ImpactOrbit,
    ImpactOscillator,
    Logistic,
    PlayOscillator,
    SingleImpactOscillator,
)

CHAIN = ImpactChain(masses=2, frequency=0.9)


def data(line: Line2D) -> Array:
    """What a line shows, (2, p)."""
    return np.asarray(line.get_xydata(), dtype=float).T


def single() -> ImpactOrbit:
    return CHAIN.periodic_orbit()


def sticking() -> ImpactOrbit:
    ball = BouncingBall(amplitude=0.16, frequency=3.0, restitution=0.5)
    return ball.periodic_orbit(sticking=True)


def test_a_record_is_drawn_from_its_start_to_its_last_impact() -> None:
    record = CHAIN.simulate(impacts=7)
    motion, table, impacts = record.plot(new_figure()[1][0]).lines
    times, place = data(motion)
    assert (times[0], times[-1]) == (0.0, record.time[-1])
    np.testing.assert_array_equal(place, record.sample(times)[0][:, 1])
    np.testing.assert_allclose(data(impacts), [record.time, record.position[:, 1]], rtol=1e-14)
    np.testing.assert_allclose(data(table)[1], 0.1 * np.sin(0.9 * times), atol=1e-15)
    assert (place >= data(table)[1] - 1e-12).all()


def test_both_stops_of_a_play_are_drawn() -> None:
    pair = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5)
    motion, near, far, _ = pair.simulate(impacts=5).plot(new_figure()[1][0]).lines
    low, place, high = (data(line)[1] for line in (near, motion, far))
    np.testing.assert_allclose(high - low, 1.0)
    assert ((place >= low - 1e-12) & (place <= high + 1e-12)).all()


def test_a_motion_that_ended_by_itself_is_drawn_beyond_its_last_impact() -> None:
    rest = SingleImpactOscillator(frequency=4.0, restitution=0.8, stop=2.0)
    record = rest.simulate(impacts=1000)
    period = 2.0 * np.pi / 4.0
    times = data(record.plot(new_figure()[1][0]).lines[0])[0]
    last = record.time[-1] if len(record) else 0.0
    assert times[-1] == pytest.approx(max(last + 2.0 * period, 12.0 * period))


def test_a_long_record_is_drawn_for_a_thousand_periods() -> None:
    record = SingleImpactOscillator(frequency=4.0, restitution=0.8).simulate(impacts=600)
    motion, _, impacts = record.plot(new_figure()[1][0]).lines
    assert data(motion)[0, -1] == 1000 * 2.0 * np.pi / 4.0 < record.time[-1]
    assert 0 < len(data(impacts)[0]) < 600


@pytest.mark.parametrize("orbit", [single, sticking])
def test_an_orbit_is_drawn_for_one_period(orbit: object) -> None:
    found: ImpactOrbit = orbit()  # type: ignore[operator]
    motion, _, impacts = found.plot(new_figure()[1][0]).lines
    times, place = data(motion)
    assert (times[0], times[-1]) == (0.0, found.period)
    assert place[0] == pytest.approx(place[-1], abs=1e-12)
    at, there = data(impacts)
    assert len(at) > 1
    table = found.system.amplitude * np.sin(found.phases[0] + found.system.frequency * at)
    np.testing.assert_allclose(there, table, atol=1e-12)


@pytest.mark.parametrize("system", [CHAIN, PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0)])
def test_records_and_time_series_are_drawn_alike(system: ImpactOscillator) -> None:
    attractor = system.attractor(impacts=5)
    ours = attractor.record.plot(new_figure()[1][0])
    theirs = TimeSeries(attractor).plot(new_figure()[1][0])
    assert [ours.get_xlabel(), ours.get_ylabel()] == [theirs.get_xlabel(), theirs.get_ylabel()]
    shown = [(line.get_linestyle(), line.get_label()) for line in ours.lines]
    assert shown == [(line.get_linestyle(), line.get_label()) for line in theirs.lines]


def test_an_impact_attractor_is_drawn_as_its_section() -> None:
    attractor = CHAIN.attractor(impacts=20)
    ours = attractor.plot(new_figure()[1][0])
    theirs = ImpactSection(attractor).plot(new_figure()[1][0])
    np.testing.assert_array_equal(data(ours.lines[0]), data(theirs.lines[0]))
    assert ours.get_xlim() == theirs.get_xlim() == (0.0, 2.0 * np.pi)


def test_a_motion_without_impacts_has_an_empty_section() -> None:
    far = SingleImpactOscillator(frequency=4.0, stop=2.0).attractor()
    axes = far.plot(new_figure()[1][0])
    assert data(axes.lines[0]).shape == (2, 0)
    assert [text.get_text() for text in axes.texts] == ["no states"]


def test_axes_do_not_show_rounding() -> None:
    axes = new_figure()[1][0]
    draw_points(axes, np.array([[1.0, 0.227], [1.0, 0.227 + 1e-13]]), ("x", "y"))
    assert axes.get_ylim() == pytest.approx((0.227 * 0.945, 0.227 * 1.055))
    draw_points(axes, np.array([[3.0, 7.0]]), ("x", "y"))  # what was drawn before is still shown
    assert axes.get_ylim()[0] < 0.227
    assert axes.get_ylim()[1] > 7.0


def test_a_short_time_long_after_the_start_fills_its_axis() -> None:
    axes = draw_motion(new_figure()[1][0], 1e10 + np.arange(5.0), np.zeros(5), "x")
    assert np.diff(axes.get_xlim()) < 5.0


@pytest.mark.parametrize("system", [Logistic(rate=3.5), Henon()])
def test_a_map_attractor_shows_two_coordinates_or_the_next_state(system: Map) -> None:
    attractor = MapAttractor(system, np.full(system.dimension, 0.1), 50, 9)
    first, second = data(attractor.plot(new_figure()[1][0]).lines[0])
    np.testing.assert_array_equal(first, attractor.states[:, 0])
    following = [system(state)[0] for state in attractor.states]
    expected = following if system.dimension == 1 else attractor.states[:, 1]
    np.testing.assert_array_equal(second, expected)


def test_a_sweep_is_drawn_as_its_diagram_without_labels() -> None:
    found = sweep(Logistic(rate=3.1), "rate", [3.1, 3.2], start=[0.3], progress=False)
    ours = found.plot(new_figure()[1][0])
    theirs = BifurcationDiagram.of(found).plot(new_figure()[1][0])
    np.testing.assert_array_equal(data(ours.lines[0]), data(theirs.lines[0]))
    assert (ours.get_xlabel(), ours.get_ylabel()) == ("rate", "state $z_{1}$")
    assert (ours.get_xlim(), len(ours.texts)) == (theirs.get_xlim(), 0)


def test_a_sweep_of_motions_without_impacts_says_so() -> None:
    high = ImpactChain(masses=1, offset=-9.0, frequency=0.9)
    found = sweep(high, "frequency", [0.8, 0.9], progress=False)
    (text,) = found.plot(new_figure()[1][0]).texts
    assert text.get_text() == "no states"


def test_basins_are_drawn_over_the_coordinate_that_ascends() -> None:
    phases = np.linspace(0.0, 2.0, 5)  # both sin(3 phase) and the phase change along the first axis
    pair = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5)
    starts = [[[0.1 * np.sin(3.0 * p), v, p] for v in (0.1, 0.2, 0.3)] for p in phases]
    axes = basins(pair, starts, transient=20, keep=10, progress=False).plot(new_figure()[1][0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == (PHASE, "velocity $v_{1}$")
    assert axes.get_xlim() == (-0.25, 2.25)
