"""Figures of branches and curves: what is drawn how."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from dynkit.continuation.bifurcations.kinds import KINDS
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.curves import continue_curve
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.results.drawing import LINES
from dynkit.orbits.periodic_orbit import periodic_orbit
from dynkit.systems import SymbolicMap
from tests.continuation.starts import flat, henon
from tests.pictures import overprinted


class PredatorPrey(SymbolicMap):
    a: float = 3.0
    b: float = 3.5

    def next_state(self, x: Any, y: Any) -> Any:
        return self.a * x * (1 - x) - x * y, self.b * x * y


def axes() -> Any:
    return Figure().add_subplot()


def legend_of(ax: Any) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


@pytest.fixture(scope="module")
def branch() -> Branch:
    return continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-1.1), "p", bounds=(-1.5, 1.5))


def drawn(branch: Branch) -> dict[str, Any]:
    lines = branch.plot(axes()).get_lines()
    return {str(line.get_label()): line for line in lines if line.get_linestyle() != "None"}


def test_kinds_of_orbits_are_told_apart_without_colour(branch: Branch) -> None:
    lines = drawn(branch)
    assert sorted(lines) == ["inadmissible", "stable", "unstable"]
    assert all(np.ptp(to_rgb(line.get_color())) == 0.0 for line in lines.values())
    patterns = [str(line._unscaled_dash_pattern) for line in lines.values()]
    assert len(set(patterns)) == 3
    assert lines["stable"].get_linestyle() == "-"


def test_lines_meet_at_bifurcations(branch: Branch) -> None:
    lines = drawn(branch)
    for b in branch.bifurcations:
        touching = [
            name
            for name, line in lines.items()
            if ((line.get_xdata() == b.value) & (line.get_ydata() == b.unknowns[0])).any()
        ]
        assert len(touching) == 2


def test_no_stretch_is_left_out(branch: Branch) -> None:
    x = np.concatenate([line.get_xdata() for line in drawn(branch).values()])
    assert set(branch.parameter) <= set(x)


def symbols(ax: Any) -> dict[str, Any]:
    """The symbols of bifurcations by their names in the legend."""
    lines = [line for line in ax.get_lines() if line.get_linestyle() == "None"]
    return {line.get_label(): line for line in lines}


def test_bifurcations_have_the_symbols_that_the_legend_names() -> None:
    made = continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-0.2), "p", bounds=(-1.5, 1.5))
    ax = made.plot(axes())
    names = [b.kind if b.admissible else f"({b.kind})" for b in made.bifurcations]
    assert names == ["PD", "SN", "GR", "(SN)", "(PD)"]
    shown = symbols(ax)
    assert set(shown) == set(names)
    for b, name in zip(made.bifurcations, names, strict=True):
        assert shown[name].get_marker() == KINDS[b.kind].marker
        assert b.value in shown[name].get_xdata()
    assert {"stable", *names} <= set(legend_of(ax))


def test_an_inadmissible_bifurcation_is_paler() -> None:
    made = continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-0.2), "p", bounds=(-1.5, 1.5))
    shown = symbols(made.plot(axes()))
    edges = [to_rgb(shown[name].get_markeredgecolor())[0] for name in ("PD", "(PD)")]
    assert edges[0] < edges[1] < 1.0


def test_each_kind_of_bifurcation_has_a_symbol_of_its_own() -> None:
    assert len({row.marker for row in KINDS.values()}) == len(KINDS)


def test_the_label_of_the_orbits_stands_beside_the_curve(branch: Branch) -> None:
    assert [text.get_text() for text in branch.plot(axes()).texts] == [branch.label]


def test_branches_in_one_figure_share_a_legend_and_their_labels_do_not_touch() -> None:
    first = continue_orbit(henon(), "a", bounds=(0.05, 1.1))
    (second, *_) = (b for b in first.bifurcations if b.kind == "PD")
    ax: Any = first.plot(axes())
    for _ in range(3):
        continue_orbit(second.switch()[0], "a", bounds=(0.05, 1.1)).plot(ax)
    names = legend_of(ax)
    assert len(set(names)) == len(names)
    texts = [text.get_text() for text in ax.texts]
    assert texts[0] == "P(1)"
    assert set(texts) == {"P(1)", "P(2)"}
    assert overprinted(ax.get_figure(root=True)) == []


@pytest.mark.parametrize("style", ["journal", "colour"])
def test_styles_are_those_of_matplotlib(branch: Branch, style: str) -> None:
    with plt.style.context(f"dynkit.plotting.{style}"):
        colours = plt.rcParams["axes.prop_cycle"].by_key()["color"]
        lines = drawn(branch)
    order = [lines[name] for name in LINES if name in lines]
    assert [line.get_color() for line in order] == colours[: len(order)]
    greys = [np.dot(to_rgb(colour), (0.3, 0.59, 0.11)) for colour in colours[:3]]
    assert (abs(np.diff(greys)) > 0.1).all()
    assert len({str(line._unscaled_dash_pattern) for line in order}) == 3


def test_axes_are_named(branch: Branch) -> None:
    ax = branch.plot(axes(), y="state[0]")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("p", "state $z_{1}$")


def test_an_observable_that_does_not_exist_is_refused_by_the_name_of_the_argument(
    branch: Branch,
) -> None:
    for unknown in ("energy", ""):
        with pytest.raises(ValueError, match=rf"^y must be one of: state\[0\].*; got '{unknown}'$"):
            branch.plot(axes(), y=unknown)


def test_another_observable_is_drawn() -> None:
    made = continue_orbit(henon(), "a", bounds=(0.05, 1.4))
    ax = made.plot(axes(), y="state[1]")
    assert ax.get_ylabel() == "state $z_{2}$"
    (stable,) = (line for line in ax.get_lines() if line.get_label() == "stable")
    assert set(np.asarray(stable.get_ydata())) & set(made.unknowns[:, 1])


def test_curves_carry_their_kind_and_names() -> None:
    made = continue_orbit(henon(), "a", bounds=(0.05, 1.4))
    curve = continue_curve(made.bifurcations[0], ("a", "b"), bounds=((0.0, 3.0), (-0.5, 0.5)))
    ax = curve.plot(axes())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("a", "b")
    assert [text.get_text() for text in ax.texts] == ["PD"]
    (line,) = ax.get_lines()
    assert (np.column_stack([line.get_xdata(), line.get_ydata()]) == curve.parameters).all()


def dotted(style: Any) -> bool:
    """Whether a line of this style is made of dots: no dash is longer than the line is wide."""
    return style != "-" and bool(max(style[1][::2]) <= 1.0)


def test_only_inadmissible_orbits_are_dotted() -> None:
    styles = LINES | {kind.value: row.line for kind, row in KINDS.items()}
    assert [name for name, style in styles.items() if dotted(style)] == ["inadmissible"]


def test_each_kind_of_bifurcation_has_a_line_of_its_own() -> None:
    assert len({str(row.line) for row in KINDS.values()}) == len(KINDS)


def test_an_observable_that_is_constant_does_not_show_rounding() -> None:
    # of this predator and prey the prey is 1 / b along the branch
    orbit = periodic_orbit(PredatorPrey(), [1.0 / 3.5, 1.0])
    branch = continue_orbit(orbit, "a", bounds=(1.5, 3.5))
    low, high = branch.plot(axes()).get_ylim()
    assert low < 0.96 / 3.5
    assert high > 1.04 / 3.5
