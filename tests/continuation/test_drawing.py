"""Figures of branches and curves: what is drawn how."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from dynkit.continuation.branch import Branch
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.curves import continue_curve
from dynkit.continuation.drawing import LINES
from dynkit.continuation.kinds import KINDS
from tests.continuation.starts import flat, henon


def axes() -> Any:
    return Figure().add_subplot()


@pytest.fixture(scope="module")
def branch() -> Branch:
    return continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-1.1), "p", bounds=(-1.5, 1.5))


def drawn(branch: Branch) -> dict[str, Any]:
    lines = branch.plot(axes()).get_lines()
    return {str(line.get_label()): line for line in lines if line.get_linestyle() != "None"}


def test_kinds_of_orbits_are_told_apart_without_colour(branch: Branch) -> None:
    lines = drawn(branch)
    assert sorted(lines) == ["inadmissible", "stable", "unstable"]
    assert {line.get_color() for line in lines.values()} == {(0.0, 0.0, 0.0)}
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


def test_bifurcations_carry_their_kinds(branch: Branch) -> None:
    ax = branch.plot(axes())
    kinds = [b.kind if b.admissible else f"({b.kind})" for b in branch.bifurcations]
    assert [text.get_text() for text in ax.texts] == kinds


def test_labels_that_would_lie_on_one_another_are_one() -> None:
    made = continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-1.005), "p", bounds=(-1.5, 1.5))
    texts = [text.get_text() for text in made.plot(axes()).texts]
    assert sorted(texts) == ["PD", "PD, GR", "SN", "SN"]


def test_what_happens_to_no_motion_is_in_brackets_beside_a_cross() -> None:
    made = continue_orbit(flat("cusp", 0.0, 0.0, 1.0, border=-0.2), "p", bounds=(-1.5, 1.5))
    assert [b.kind for b in made.bifurcations] == ["PD", "SN", "GR", "SN", "PD"]
    ax = made.plot(axes())
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["PD", "SN", "GR", "(SN)", "(PD)"]
    marks = [line.get_marker() for line in ax.get_lines() if line.get_linestyle() == "None"]
    assert marks == ["o", "o", "o", "x", "x"]


def test_axes_are_named(branch: Branch) -> None:
    ax = branch.plot(axes(), y="state[0]")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("p", "state[0]")


def test_another_observable_is_drawn() -> None:
    made = continue_orbit(henon(), "a", bounds=(0.05, 1.4))
    ax = made.plot(axes(), y="state[1]")
    assert ax.get_ylabel() == "state[1]"
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
