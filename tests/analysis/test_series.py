"""Time series: exact samples, table and impacts beside them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import sympy as sp
from flint import arb, ctx

from dynkit.analysis import PowerSpectrum, TimeSeries
from dynkit.dynamics.attractor import MapAttractor
from dynkit.plotting.figures import new_figure
from dynkit.systems import Element, HardStop, Henon, ImpactChain, Logistic, SoftStop, SymbolicMap
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor


def attractor_of(frequency: float = 0.87, **parameters: Any) -> ImpactAttractor:
    return ImpactChain(frequency=frequency, **parameters).attractor()


def henon() -> MapAttractor:
    return MapAttractor(Henon(), np.zeros(2), transient=100, iterations=50)


def test_values_are_those_of_the_attractor() -> None:
    times = np.array([0.0, 0.3, 7.0])
    attractor = attractor_of()
    series = TimeSeries(attractor, times, coordinate=12)
    assert np.array_equal(series.values, attractor.time_series(times)[:, 12])


def test_contact_coordinate_is_the_default() -> None:
    assert TimeSeries(attractor_of(contact=3, offset=-0.01)).coordinate == 3


def test_default_times_show_twelve_periods() -> None:
    times = TimeSeries(attractor_of()).times
    assert len(times) == 1200
    assert times[100] == pytest.approx(2.0 * np.pi / 0.87, rel=1e-15)


def test_default_times_of_a_map_are_those_of_its_states() -> None:
    series = TimeSeries(henon(), coordinate=0)
    assert np.array_equal(series.values, henon().states[:, 0])


def test_negative_coordinate_counts_from_the_last() -> None:
    assert TimeSeries(attractor_of(), [0.0], coordinate=-1).coordinate == 19


def test_table_is_at_the_contact_mass_at_impacts() -> None:
    attractor = attractor_of(0.35, offset=0.02)
    series = TimeSeries(attractor, attractor.record.time)
    assert series.table == pytest.approx(series.values, rel=0.0, abs=1e-13)


def test_a_stop_that_lags_is_where_the_mass_hits_it() -> None:
    stops = [SoftStop(0, stiffness=1.0), HardStop(1, offset=0.1, amplitude=0.2, phase=0.5)]
    attractor = ImpactChain(masses=2, frequency=0.9, elements=stops).attractor(transient=9)
    series = TimeSeries(attractor, attractor.record.time)
    assert series.table == pytest.approx(series.values, abs=1e-12)


@pytest.mark.parametrize("stop", [SoftStop(1, stiffness=9.0), HardStop((0, 1), offset=-0.1)])
def test_a_machine_without_a_stop_of_one_mass_has_no_table(stop: Element) -> None:
    system = ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0, 1], elements=[stop])
    series = TimeSeries(system.attractor(transient=9))
    assert series.table is None
    assert bool(len(series.impacts)) is isinstance(stop, HardStop)  # periods are no impacts


def test_impacts_are_those_within_the_times() -> None:
    attractor = attractor_of(0.35)
    at = attractor.record.time
    series = TimeSeries(attractor, np.linspace(at[3], at[9], 50))
    assert np.array_equal(series.impacts, at[3:10])


def test_impacts_beyond_the_kept_ones_are_found() -> None:
    attractor = attractor_of(0.35)
    end = float(attractor.record.time[-1])
    further = attractor.system.simulate(impacts=400, start=attractor.record.start).time
    series = TimeSeries(attractor, np.array([0.0, 2.0 * end]))
    assert np.array_equal(series.impacts, further[further <= 2.0 * end])


def test_array_has_no_table_and_no_impacts() -> None:
    series = TimeSeries([1.0, 2.0], [0.0, 1.0])
    assert series.table is None
    assert len(series.impacts) == 0


def test_values_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        TimeSeries([1.0, 2.0], [0.0, 1.0]).values[0] = 3.0


def test_given_arrays_stay_what_they_are() -> None:
    values = np.array([1.0, 2.0])
    TimeSeries(values, [0.0, 1.0])
    assert values.flags.writeable


# --- error and cost -------------------------------------------------------------------------------


def test_error_within_the_kept_impacts_is_that_of_the_attractor() -> None:
    attractor = attractor_of()
    assert TimeSeries(attractor, [0.0, 1.0]).error == attractor.error


def test_error_beyond_the_kept_impacts_grows_in_chaos() -> None:
    attractor = ImpactChain(frequency=0.35).attractor(transient=0, impacts=20)
    end = float(attractor.record.time[-1])
    # its states are lost after some hundred impacts
    assert TimeSeries(attractor, [0.0, 100.0 * end]).error > 1e3 * attractor.error


@pytest.mark.parametrize("latest", [3, 20, 40, 60, 200])
def test_error_of_a_map_covers_states_beyond_the_kept_ones(latest: int) -> None:
    attractor = MapAttractor(Logistic(4.0), np.array([0.3]), transient=10, iterations=5)
    series = TimeSeries(attractor, [0.0, float(latest)])
    # x_n = sin^2(2^n arcsin sqrt(x_0)), in many digits
    with ctx.workdps(100):
        angle = 2**latest * arb(float(attractor.states[0, 0])).sqrt().asin()
        exact = float(angle.sin() ** 2)
    assert abs(float(series.values[-1]) - exact) <= series.error


def test_error_of_an_array_is_zero() -> None:
    assert TimeSeries([1.0], [0.0]).error == 0.0


def test_cost_counts_the_samples() -> None:
    assert TimeSeries(attractor_of(), [0.0, 1.0, 2.0]).cost.counts == {"samples": 3}


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "times", "message"),
    [
        ([1.0, 2.0], None, "times must be given with an array"),
        ([1.0, 2.0], [0.0], "times must have shape (2,); got shape (1,)"),
        ([1.0, 2.0], [0.0, 0.0], "times[1] must exceed times[0]; got 0.0"),
        ([1.0, np.nan], [0.0, 1.0], "source[1] must be a finite number; got nan"),
        ([[1.0]], [0.0], "source must have 1 dimension; got shape (1, 1)"),
    ],
)
def test_bad_arrays_are_refused(source: Any, times: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        TimeSeries(source, times)


@pytest.mark.parametrize("coordinate", [20, -21, 1.0, True, "x"])
def test_unknown_coordinates_are_refused(coordinate: Any) -> None:
    with pytest.raises(ValueError, match=re.escape("coordinate must lie in [-20, 19]; got")):
        TimeSeries(attractor_of(), [0.0], coordinate=coordinate)


def test_coordinate_of_an_array_is_refused() -> None:
    with pytest.raises(ValueError, match="coordinate must be left out with an array; got 0"):
        TimeSeries([1.0], [0.0], coordinate=0)


# --- figure ---------------------------------------------------------------------------------------


def test_motion_table_and_impacts_are_drawn() -> None:
    series = TimeSeries(attractor_of())
    _, (axes,) = new_figure()
    assert series.plot(axes) is axes
    motion, table, impacts = axes.lines
    assert np.array_equal(motion.get_ydata(), series.values)
    assert series.table is not None
    assert np.array_equal(table.get_ydata(), series.table)
    assert np.array_equal(impacts.get_xdata(), series.impacts)


def test_axes_are_named() -> None:
    _, (axes,) = new_figure()
    TimeSeries(attractor_of(), coordinate=14).plot(axes)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time $t$", "velocity $v_{5}$")


def test_table_is_left_out_beside_other_coordinates() -> None:
    _, (axes,) = new_figure()
    TimeSeries(attractor_of(), coordinate=0).plot(axes)
    assert len(axes.lines) == 1


def test_series_of_a_map_is_drawn() -> None:
    _, (axes,) = new_figure()
    TimeSeries(henon()).plot(axes)
    assert axes.get_ylabel() == "coordinate 0"


class Circle(SymbolicMap):
    """A map with a parameter of this name, which is no frequency in its time."""

    frequency: float = 1.7
    angles = ("angle",)

    def next_state(self, angle: sp.Expr) -> tuple[sp.Expr]:
        return (angle + self.frequency - sp.sin(angle) / 2,)


def test_a_parameter_of_a_map_is_no_forcing() -> None:
    attractor = MapAttractor(Circle(), np.array([0.1]), transient=10, iterations=300)
    assert TimeSeries(attractor).times.tolist() == list(range(300))
    assert PowerSpectrum(attractor, 1.0, samples=256).table_frequency is None
