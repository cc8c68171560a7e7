"""Space-time surfaces."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from dynkit.analysis import SpaceTime
from dynkit.dynamics.attractor import MapAttractor
from dynkit.plotting.figures import new_figure
from dynkit.systems import Henon, ImpactChain


def test_displacements_are_positions_of_the_attractor() -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    times = 0.1 * np.arange(2000, dtype=np.float64)  # as in the paper's figure 17
    surface = SpaceTime(attractor, times)
    assert np.array_equal(surface.displacements, attractor.time_series(times)[:, :10])


def test_array_holds_the_displacements() -> None:
    given = np.arange(6.0).reshape(3, 2)
    surface = SpaceTime(given, [0.0, 1.0, 2.0])
    assert np.array_equal(surface.displacements, given)
    assert surface.error == 0.0
    assert surface.cost.counts == {"samples": 3}


def test_error_is_that_of_the_attractor() -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    assert SpaceTime(attractor, [0.0, 1.0]).error == attractor.error


@pytest.mark.parametrize(
    ("source", "times", "message"),
    [
        (np.eye(2), None, "times must be given with an array"),
        (np.eye(2), [0.0], "times must have shape (2,); got shape (1,)"),
        (np.eye(2), [1.0, 0.0], "times[1] must exceed times[0]; got 0.0"),
        ([1.0], [0.0], "source must have 2 dimensions; got shape (1,)"),
        (MapAttractor(Henon(), np.zeros(2), 9, 9), None, "source must be a motion of masses; got"),
    ],
)
def test_bad_sources_are_refused(source: Any, times: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        SpaceTime(source, times)


def test_flat_axes_are_refused() -> None:
    _, (axes,) = new_figure()
    flat: Any = axes
    with pytest.raises(ValueError, match="ax must be made with projection='3d'; got"):
        SpaceTime(np.eye(2), [0.0, 1.0]).plot(flat)


def test_single_mass_has_no_surface() -> None:
    surface = SpaceTime(ImpactChain(masses=1, frequency=0.4).attractor(), [0.0, 1.0])
    with pytest.raises(ValueError, match=re.escape("must be (2, 2) or more; got shape (2, 1)")):
        surface.plot()


def test_surface_is_drawn_on_given_axes() -> None:
    axes: Any = Figure().add_subplot(projection="3d")
    surface = SpaceTime(ImpactChain(frequency=0.87).attractor())
    assert surface.plot(axes) is axes
    assert len(axes.collections) == 1
    names = axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()
    assert names == ("time $t$", "mass $j$", "displacement $x_j$")


def test_surface_reaches_from_the_first_to_the_last_displacement() -> None:
    axes: Any = Figure().add_subplot(projection="3d")
    surface = SpaceTime(ImpactChain(frequency=0.87).attractor())
    surface.plot(axes)
    low, high = axes.get_zlim()
    assert low <= surface.displacements.min()
    assert high >= surface.displacements.max()


def test_surface_gets_a_figure_of_its_own() -> None:
    from matplotlib import pyplot as plt

    axes = SpaceTime(np.eye(3), [0.0, 1.0, 2.0]).plot()
    assert axes.name == "3d"
    plt.close(axes.figure)


def surface_axes() -> Any:
    return Figure().add_subplot(projection="3d")


def test_surface_looks_the_same_in_axes_of_its_own_and_in_given_ones() -> None:
    from matplotlib import pyplot as plt

    surface = SpaceTime(np.eye(3), [0.0, 1.0, 2.0])
    own, given = surface.plot(), surface.plot(surface_axes())
    for axes in (own, given):
        assert (axes.elev, axes.azim, axes.xaxis.pane.fill) == (32.0, -72.0, False)
    assert (own.get_proj() == given.get_proj()).all()
    plt.close(own.figure)


@pytest.mark.parametrize("count", [2, 501, 2001])
def test_surface_reaches_from_the_first_to_the_last_time(count: int) -> None:
    axes = surface_axes()
    times = 0.1 * np.arange(count, dtype=np.float64)
    SpaceTime(np.zeros((count, 3)), times).plot(axes)
    assert axes.get_xlim() == (0.0, times[-1])
    assert (axes.xy_dataLim.xmin, axes.xy_dataLim.xmax) == (0.0, times[-1])


def test_surface_of_many_samples_has_few_lines() -> None:
    axes = surface_axes()
    SpaceTime(np.zeros((3000, 3)), np.arange(3000.0)).plot(axes)
    (surface,) = axes.collections
    axes.get_figure().draw_without_rendering()
    assert len(surface.get_paths()) <= 2 * 100


def test_masses_are_whole_numbers() -> None:
    axes: Any = Figure().add_subplot(projection="3d")
    times = np.linspace(0.0, 1.0, 20)
    SpaceTime(np.sin(times[:, None] * [1.0, 2.0, 3.0]), times).plot(axes)
    ticks = axes.get_yticks()
    assert (ticks == np.rint(ticks)).all()
