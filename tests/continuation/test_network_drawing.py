"""Figures of networks: how orbits are told apart, and names that do not cover one another."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from dynkit import Network, explore
from dynkit.continuation.network import Finish
from dynkit.core.cost import Cost
from dynkit.plotting.names import write_names
from dynkit.systems import ImpactChain
from tests.pictures import style

NONE = Network((), (), (), Finish.COMPLETE, Finish.COMPLETE.value, Cost(0.0))


@pytest.fixture(scope="module")
def network() -> Network:
    chain = ImpactChain(frequency=0.87)
    seeds = chain.periodic_orbits(periods=3)
    found = explore(chain, "frequency", (0.75, 1.05), periods=3, seeds=seeds)
    assert found.finish is Finish.COMPLETE
    return found


@pytest.fixture(scope="module")
def axes(network: Network) -> Axes:
    return network.plot(Figure(figsize=(6.8, 4.4)).subplots())


def names_of(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation)]


def test_orbits_are_told_apart_without_colour(axes: Axes) -> None:
    curves = [line for line in axes.lines if line.get_linestyle() != "None"]
    assert all(np.ptp(to_rgb(line.get_color())) == 0.0 for line in curves)
    assert [line.get_label() for line in curves] == ["stable", "unstable", "inadmissible"]
    assert [style(line) for line in curves] == ["solid", "dashed", "dotted"]


def test_a_curve_ends_at_the_bifurcation_where_its_kind_changes(
    network: Network, axes: Axes
) -> None:
    """The stable P(1,3) is drawn from where it grazes to where it grazes again."""
    (branch,) = network.find("P(1,3)")
    ends = [b.value for b in branch.bifurcations if b.kind == "GR"]
    x = np.asarray(next(line for line in axes.lines if line.get_label() == "stable").get_xdata())
    parts = np.split(x, np.flatnonzero(np.isnan(x)))
    assert (min(ends), max(ends)) in {(np.nanmin(p), np.nanmax(p)) for p in parts if len(p) > 1}


def test_names_stand_inside_and_do_not_cover_one_another(axes: Axes) -> None:
    boxes = [text.get_window_extent() for text in names_of(axes)]
    frame = axes.get_window_extent()
    assert len(boxes) == 3
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert all(frame.x0 <= b.x0 and b.x1 <= frame.x1 for b in boxes)
    assert all(frame.y0 <= b.y0 and b.y1 <= frame.y1 for b in boxes)


def test_names_are_the_labels_of_branches_that_pass_there(network: Network, axes: Axes) -> None:
    assert sorted(text.get_text() for text in names_of(axes)) == ["P(1,3)", "P(2,3)", "P(2,3)"]
    for text in names_of(axes):
        place = axes.transData.transform(text.xy)
        points = [
            axes.transData.transform(np.column_stack([branch.parameter, row]))
            for branch in network.find(text.get_text())
            for row in branch.observable("relative_velocity").T
        ]
        away = np.hypot(*(np.concatenate(points) - place).T).min()
        assert away < 0.05 * axes.get_window_extent().width


def test_names_without_room_are_left_out() -> None:
    axes = Figure(figsize=(2.0, 2.0)).subplots()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    write_names(axes, [(np.array([[0.5 + 1e-3 * i, 0.5]]), "PD") for i in range(40)], 5.0)
    boxes = [text.get_window_extent() for text in names_of(axes)]
    assert 0 < len(boxes) < 40
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


def test_names_outside_of_the_axes_are_not_written() -> None:
    axes = Figure().subplots()
    axes.set_xlim(0.0, 1.0)
    write_names(axes, [(np.array([[2.0, 0.5]]), "PD")], 5.0)
    assert names_of(axes) == []


def test_another_observable_is_drawn_by_name(network: Network) -> None:
    one = replace(network, branches=network.branches[:1])
    axes = one.plot(Figure().subplots(), y="phase")
    assert axes.get_ylabel() == r"phase $\varphi$"


def test_an_empty_network_is_refused() -> None:
    with pytest.raises(ValueError, match="network must have a branch to be drawn; got none"):
        NONE.plot(Figure().subplots())


def test_an_empty_network_has_one_line() -> None:
    assert repr(NONE) == (
        "<Network of 0 branches; 0 bifurcations, 0 links; the search went to its end>"
    )
