"""Figures of maps and basins."""

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

from dynkit import basins, parameter_map
from dynkit.plotting.figures import new_figure
from dynkit.plotting.regions import Region, draw_regions, shades
from dynkit.systems import Henon
from tests.scaling.cases import SHORT, attracted, mapped


def legend(axes: Axes) -> list[str]:
    drawn = axes.get_legend()
    assert drawn is not None
    return [text.get_text() for text in drawn.get_texts()]


@pytest.mark.parametrize("count", range(1, 13))
def test_neighbouring_colours_differ_in_grey(count: int) -> None:
    grey = np.array(shades(count)) @ [0.3, 0.59, 0.11]
    assert len(np.unique(grey)) == count
    assert count < 4 or abs(np.diff(grey)).min() > 0.1


def drawn(cells: Any, **more: Any) -> Axes:
    _, (axes,) = new_figure()
    array = np.array(cells)
    x, y = (np.arange(n, dtype=np.float64) for n in array.shape)
    regions = [Region("one", shades(1)[0]), Region("two", None, "////"), Region("none")]
    return draw_regions(axes, (x, y), ("frequency", "relative_velocity"), array, regions)


def test_each_cell_has_the_colour_of_its_region() -> None:
    axes = drawn([[0, 1, 1], [0, 0, 1]])
    (mesh,) = (c for c in axes.collections if c.get_array() is not None)
    assert np.asarray(mesh.get_array()).tolist() == [[0, 0], [1, 0], [1, 1]]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        r"frequency $\omega$",
        "relative velocity $u$",
    )


def test_only_what_is_there_stands_in_the_legend() -> None:
    assert legend(drawn([[0, 1], [0, 0]])) == ["one", "two"]


def test_a_name_stands_inside_of_its_region() -> None:
    cells = np.ones((20, 20), dtype=np.int64)
    cells[:8] = 0
    axes = drawn(cells)
    places = {text.get_text(): text.get_position() for text in axes.texts}
    assert cells[round(places["one"][0]), round(places["one"][1])] == 0
    assert cells[round(places["two"][0]), round(places["two"][1])] == 1


def test_a_name_without_room_is_left_to_the_legend() -> None:
    cells = np.ones((60, 60), dtype=np.int64)
    cells[30, 30] = 0
    axes = drawn(cells)
    assert [text.get_text() for text in axes.texts] == ["two"]
    assert legend(axes) == ["one", "two"]


def test_values_in_any_order_are_drawn_in_ascending_order() -> None:
    values = {"a": [0.2, 1.4, 1.0], "b": [0.3, 0.1]}
    found = parameter_map(Henon(), values, start=[0.1, 0.1], **SHORT)
    turned = {"a": [1.4, 0.2, 1.0], "b": [0.1, 0.3]}
    other = parameter_map(Henon(), turned, start=[0.1, 0.1], **SHORT)
    pictures = []
    for each in (found, other):
        _, (axes,) = new_figure()
        each.plot(axes)
        (mesh,) = (c for c in axes.collections if c.get_array() is not None)
        pictures.append(np.asarray(mesh.get_array()).tolist())
    assert pictures[0] == pictures[1]


def test_a_map_names_its_labels() -> None:
    _, (axes,) = new_figure()
    names = legend(mapped().plot(axes))
    assert {"P(1)", "P(2)"} <= set(names)


def test_basins_are_drawn_over_the_coordinates_that_change() -> None:
    _, (axes,) = new_figure()
    found = attracted()
    found.plot(axes)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("state $z_{1}$", "state $z_{2}$")
    assert legend(axes) == ["0: P(4)", "runs away"]
    (line,) = axes.lines
    assert np.array_equal(np.asarray(line.get_xydata()), found.basins[0].states)


def test_fractions_of_starts_in_a_row_are_bars() -> None:
    starts = np.random.default_rng(0).uniform(-2.0, 2.0, (40, 2))
    found = basins(Henon(a=1.0), starts, **SHORT)
    _, (axes,) = new_figure()
    found.plot(axes)
    heights = [patch.get_height() for patch in axes.patches]  # type: ignore[attr-defined]
    assert heights == [found.basins[0].fraction, float((found.numbers == -2).mean())]
