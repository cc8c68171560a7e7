"""Bifurcation diagrams, chatter ratios, and the figures that they become."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dynkit import sweep
from dynkit.analysis.annotation import LabelInterval, mark_values, spread
from dynkit.analysis.chatter import ChatterRatios
from dynkit.analysis.diagram import BifurcationDiagram
from dynkit.core.validation import Array
from dynkit.plotting.figures import new_figure, print_style, save_figure, size_in_points
from dynkit.systems import ImpactChain


def diagram_of(
    labels: list[str], values: Array | None = None, numbers: Array | None = None
) -> BifurcationDiagram:
    k = len(labels)
    return BifurcationDiagram(
        "frequency",
        np.linspace(0.0, 1.0, k) if values is None else values,
        {"relative_velocity": np.zeros((k, 2)) if numbers is None else numbers},
        labels=labels,
    )


def drawn(diagram: BifurcationDiagram) -> tuple[Figure, Axes]:
    figure, (axes,) = new_figure()
    diagram.plot(axes)
    return figure, axes


# --- intervals ------------------------------------------------------------------------------------


def test_interval_spans_successive_values_of_one_label() -> None:
    diagram = diagram_of(["a", "b", "b", "a"], np.array([0.1, 0.2, 0.4, 0.5]))
    assert diagram.intervals == (
        LabelInterval("a", 0.1, 0.1, 1),
        LabelInterval("b", 0.2, 0.4, 2),
        LabelInterval("a", 0.5, 0.5, 1),
    )


def test_interval_of_a_sweep_downwards_has_its_ends_in_order() -> None:
    (interval,) = diagram_of(["a", "a"], np.array([0.5, 0.4])).intervals
    assert (interval.low, interval.high) == (0.4, 0.5)


@given(st.lists(st.sampled_from("abc"), min_size=1, max_size=40))
def test_intervals_hold_every_value_once(labels: list[str]) -> None:
    intervals = diagram_of(labels).intervals
    assert [name for each in intervals for name in [each.label] * each.count] == labels


def test_no_labels_give_no_intervals() -> None:
    diagram = BifurcationDiagram("frequency", np.array([1.0]), {"u": np.zeros((1, 3))})
    assert diagram.intervals == ()


def test_diagram_of_a_sweep_holds_what_the_sweep_found() -> None:
    found = sweep(
        ImpactChain(frequency=0.87), "frequency", [0.87, 0.88], observables=("energy",),
        progress=False,
    )  # fmt: skip
    diagram = BifurcationDiagram.of(found)
    assert np.array_equal(diagram.observables["energy"], found.observable("energy"))
    assert diagram.intervals == (LabelInterval("P(1,3)", 0.87, 0.88, 2),)


# --- refusals -------------------------------------------------------------------------------------


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match=r"values\[1\] must be a finite number; got nan"):
        diagram_of(["a", "b"], np.array([1.0, np.nan]))


def test_observable_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match=r"observables\['u'\] must have shape \(2, n\)"):
        BifurcationDiagram("frequency", np.array([1.0, 2.0]), {"u": np.zeros((3, 1))})


def test_infinite_observable_is_refused() -> None:
    with pytest.raises(ValueError, match=r"observables\['u'\] must be finite or NaN"):
        BifurcationDiagram("frequency", np.array([1.0]), {"u": np.array([[np.inf]])})


def test_labels_of_another_length_are_refused() -> None:
    with pytest.raises(ValueError, match="labels must be one for each of 2 values; got 1"):
        BifurcationDiagram("frequency", np.arange(2.0), {"u": np.zeros((2, 1))}, labels=["a"])


def test_diagram_without_observables_is_refused() -> None:
    with pytest.raises(ValueError, match="observables must hold at least one; got none"):
        BifurcationDiagram("frequency", np.array([1.0]), {})


def test_unknown_observable_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="observable must be one of: relative_velocity; got 'x'"):
        diagram_of(["a"]).points("x")


def test_arrays_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        diagram_of(["a"]).values[0] = 2.0


# --- drawing --------------------------------------------------------------------------------------


def test_every_number_becomes_a_point() -> None:
    rng = np.random.default_rng(1)
    _, axes = drawn(diagram_of(["a"] * 50, numbers=rng.random((50, 20))))
    assert len(np.asarray(axes.lines[0].get_xdata())) == 1000


def test_dots_at_the_ends_are_inside_of_the_axes() -> None:
    _, axes = drawn(diagram_of(["a"] * 3))
    assert axes.get_xlim() == (-0.25, 1.25)


def test_what_is_not_there_becomes_no_point() -> None:
    numbers = np.array([[1.0, np.nan], [2.0, 3.0]])
    _, axes = drawn(diagram_of(["a", "a"], numbers=numbers))
    assert np.asarray(axes.lines[0].get_ydata()).tolist() == [1.0, 2.0, 3.0]


def test_axes_are_named_in_words_and_symbols() -> None:
    diagram = BifurcationDiagram(
        "frequency",
        np.arange(2.0),
        {"energy": np.ones((2, 1))},
        symbols={"frequency": r"\Omega", "energy": ""},
    )
    _, axes = drawn(diagram)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"frequency $\Omega$", "energy")
    plain = BifurcationDiagram("frequency", np.arange(2.0), {"energy": np.ones((2, 1))})
    _, axes = drawn(plain)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"frequency $\omega$", "energy $E$")


def test_wide_intervals_are_named_and_narrow_ones_not() -> None:
    labels = ["P(1,3)"] * 500 + ["P(9,9)"] + ["P(1,4)"] * 499
    _, axes = drawn(diagram_of(labels))
    assert [text.get_text() for text in axes.texts] == ["P(1,3)", "P(1,4)"]


def test_written_labels_do_not_overlap() -> None:
    labels = [name for i in range(60) for name in [f"P({i},{i})"] * (2 + i % 7)]
    figure, axes = drawn(diagram_of(labels))
    figure.draw_without_rendering()
    boxes = sorted(
        (text.get_window_extent().x0, text.get_window_extent().x1) for text in axes.texts
    )
    assert len(boxes) > 10
    assert all(left[1] <= right[0] for left, right in pairwise(boxes))


def test_labels_stand_near_their_intervals() -> None:
    narrow = [name for i in range(30) for name in [f"P({i},{i})"] * 14]
    _, axes = drawn(diagram_of(narrow + ["P(1,3)"] * 580))
    ends = [np.asarray(line.get_xdata(), float) for line in axes.lines[1:]]
    points = size_in_points(axes)[0] / np.ptp(axes.get_xlim())
    assert len(ends) == len(axes.texts) < 20
    assert max(abs(np.diff(end)[0]) * points for end in ends) <= 8.0 + 1e-9


def test_labels_stay_on_the_figure() -> None:
    labels = [name for i in range(60) for name in [f"P({i},{i})"] * (2 + i % 7)]
    figure, axes = drawn(diagram_of(labels))
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert min(box.x0 for box in boxes) >= 0.0
    assert max(box.y1 for box in boxes) <= figure.bbox.height


@pytest.mark.parametrize("constant", [0.5, 1.0])
def test_one_value_is_drawn_too(constant: float) -> None:
    _, axes = drawn(diagram_of(["a"], np.array([constant])))
    assert [text.get_text() for text in axes.texts] == ["a"]


def test_marks_outside_of_the_axes_are_left_out() -> None:
    _, (axes,) = new_figure()
    axes.set_xlim(0.0, 1.0)
    mark_values(axes, {"inside": 0.5, "outside": 1.5})
    assert [text.get_text() for text in axes.texts] == ["inside"]


@given(
    st.lists(st.floats(-1e3, 1e3), max_size=30).map(sorted), st.floats(0.0, 10.0, exclude_min=True)
)
def test_spread_places_are_a_pitch_apart(wanted: list[float], pitch: float) -> None:
    assert (np.diff(spread(np.array(wanted), pitch)) >= pitch - 1e-9).all()


@given(st.lists(st.integers(-1000, 1000), unique=True, max_size=30).map(sorted))
def test_spread_leaves_alone_what_is_apart(wanted: list[int]) -> None:
    assert spread(np.array(wanted, dtype=float), 0.5) == pytest.approx(wanted)


def test_type_is_legible_at_column_width() -> None:
    with print_style():
        figure, axes = drawn(diagram_of(["a"] * 3))
    axes.legend(["a", "b"])
    figure.draw_without_rendering()
    texts = [*axes.get_xticklabels(), *axes.texts, axes.xaxis.label, axes.yaxis.label]
    assert min(float(text.get_fontsize()) for text in texts) >= 6.0


# --- files ----------------------------------------------------------------------------------------


def test_large_diagram_makes_small_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    figure, _ = drawn(diagram_of(["chaotic"] * 900, numbers=rng.random((900, 100))))
    png, svg = save_figure(figure, tmp_path / "diagram")
    assert max(png.stat().st_size, svg.stat().st_size) < 1_500_000


def test_same_figure_makes_the_same_file(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        save_figure(drawn(diagram_of(["a", "b"]))[0], tmp_path / folder / "diagram")
    for name in ("diagram.png", "diagram.svg"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_stem_with_a_dot_is_kept(tmp_path: Path) -> None:
    png, _ = save_figure(drawn(diagram_of(["a"]))[0], tmp_path / "at-0.87")
    assert png.name == "at-0.87.png"


def test_matplotlib_is_imported_only_to_draw_and_needs_no_display(tmp_path: Path) -> None:
    code = """
import sys
from dynkit.analysis import BifurcationDiagram
diagram = BifurcationDiagram("frequency", [1.0, 2.0], {"u": [[1.0], [2.0]]}, labels=["a", "a"])
assert diagram.intervals and "matplotlib" not in sys.modules
diagram.plot().figure.savefig(sys.argv[1])
"""
    environment = {"PATH": "/usr/bin:/bin", "MPLCONFIGDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "diagram.svg")],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


# --- chatter --------------------------------------------------------------------------------------


def test_ratios_of_a_bouncing_ball_are_the_restitution() -> None:
    chatter = ChatterRatios(0.85 ** np.arange(400.0))
    assert chatter.deviation(0.85, first=1, last=399) < 1e-15


def test_event_is_the_longest_run_that_shortens() -> None:
    chatter = ChatterRatios(np.array([3.0, 2.0, 5.0, 4.0, 3.0, 2.0, 7.0, 6.0]))
    assert (chatter.begin, chatter.flights.tolist()) == (2, [5.0, 4.0, 3.0, 2.0])


def test_one_point_is_drawn_for_each_ratio() -> None:
    axes = ChatterRatios(0.5 ** np.arange(11.0)).plot(new_figure()[1][0])
    assert len(np.asarray(axes.lines[0].get_xdata())) == 10


def test_flights_that_never_shorten_are_refused() -> None:
    with pytest.raises(ValueError, match="flight_times must hold two successive flights"):
        ChatterRatios(np.array([1.0, 2.0]))


def test_negative_flight_is_refused_by_place() -> None:
    with pytest.raises(ValueError, match=r"flight_times\[1\] must not be negative; got -1.0"):
        ChatterRatios(np.array([1.0, -1.0]))


def test_a_flight_of_no_duration_has_a_ratio_with_an_error() -> None:
    chatter = ChatterRatios(np.array([4.0, 2.0, 0.0]))
    assert chatter.ratios.tolist() == [0.5, 0.0]
    assert chatter.error[1] == pytest.approx(0.5 * np.spacing(6.0), rel=1e-12)


def test_a_limit_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="limit must be a finite number; got nan"):
        ChatterRatios(np.array([4.0, 2.0, 1.0])).deviation(np.nan, first=1, last=2)


def test_bounces_beyond_the_event_are_refused() -> None:
    with pytest.raises(ValueError, match="last must not exceed the event's 2 bounces; got 5"):
        ChatterRatios(np.array([3.0, 2.0, 1.0])).deviation(0.5, first=1, last=5)
