"""Figures of networks: how orbits are told apart, and names that do not cover one another."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from dynkit import Network, explore
from dynkit.continuation.network import Finish
from dynkit.core.cost import Cost
from dynkit.plotting.names import write_names
from dynkit.systems import ImpactChain

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
    assert {line.get_color() for line in curves} == {(0.0, 0.0, 0.0)}
    handles, labels = axes.get_legend_handles_labels()
    assert labels == ["stable", "unstable", "inadmissible"]
    assert len({str(handle.get_linestyle()) for handle in handles}) > 1  # type: ignore[attr-defined]
    assert len({line.get_linewidth() for line in curves}) == 3


def test_a_curve_ends_at_the_bifurcation_where_its_kind_changes(
    network: Network, axes: Axes
) -> None:
    """The stable P(1,3) is drawn from where it grazes to where it grazes again."""
    (branch,) = network.find("P(1,3)")
    ends = [b.value for b in branch.bifurcations if b.kind == "GR"]
    spans = {(np.min(x), np.max(x)) for x in (np.asarray(line.get_xdata()) for line in axes.lines)
             if x.size}  # fmt: skip
    assert (min(ends), max(ends)) in spans


def test_names_stand_inside_and_do_not_cover_one_another(axes: Axes) -> None:
    boxes = [text.get_window_extent() for text in names_of(axes)]
    frame = axes.get_window_extent()
    assert len(boxes) > 5
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert all(frame.x0 <= b.x0 and b.x1 <= frame.x1 for b in boxes)
    assert all(frame.y0 <= b.y0 and b.y1 <= frame.y1 for b in boxes)


def test_names_are_those_of_the_bifurcations(network: Network, axes: Axes) -> None:
    known = {(b.value, b.kind) for b in network.bifurcations}
    assert {(text.xy[0], text.get_text()) for text in names_of(axes)} <= known


def test_names_without_room_are_left_out() -> None:
    axes = Figure(figsize=(2.0, 2.0)).subplots()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    write_names(axes, [(0.5 + 1e-3 * i, 0.5, "PD") for i in range(40)], 5.0)
    boxes = [text.get_window_extent() for text in names_of(axes)]
    assert 0 < len(boxes) < 40
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


def test_names_outside_of_the_axes_are_not_written() -> None:
    axes = Figure().subplots()
    axes.set_xlim(0.0, 1.0)
    write_names(axes, [(2.0, 0.5, "PD")], 5.0)
    assert names_of(axes) == []


def test_another_observable_is_drawn_by_name(network: Network) -> None:
    one = replace(network, branches=network.branches[:1])
    axes = one.plot(Figure().subplots(), y="phase")
    assert axes.get_ylabel() == "phase"


def test_an_empty_network_is_refused() -> None:
    with pytest.raises(ValueError, match="network must have a branch to be drawn; got none"):
        NONE.plot(Figure().subplots())


def test_an_empty_network_has_one_line() -> None:
    assert repr(NONE) == (
        "<Network of 0 branches; 0 bifurcations, 0 links; the search went to its end>"
    )
