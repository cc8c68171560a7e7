"""Figures follow matplotlib's own settings, and are the paper's where there are none."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from dynkit import MapAttractor, Sweep, periodic_orbit, sweep
from dynkit.analysis import POD, BifurcationDiagram, ImpactSection, SpaceTime, TimeSeries
from dynkit.continuation.continuing import continue_orbit
from dynkit.plotting import figures
from dynkit.systems import ImpactChain, Logistic


def chain() -> ImpactChain:
    return ImpactChain(masses=2, frequency=0.9)


def logistic_sweep() -> Sweep:
    return sweep(Logistic(rate=3.1), "rate", [3.1, 3.2], start=[0.3], progress=False)


def diagram() -> Axes:
    return BifurcationDiagram.of(logistic_sweep()).plot()


def branch() -> Axes:
    orbit = periodic_orbit(Logistic(rate=2.9), [[0.6]])
    return continue_orbit(orbit, "rate", bounds=(2.8, 3.2)).plot()


PLOTS: dict[str, Callable[[], Axes]] = {
    "diagram": diagram,
    "branch": branch,
    "record": lambda: chain().simulate(impacts=5).plot(),
    "impact attractor": lambda: chain().attractor(impacts=5).plot(),
    "impact orbit": lambda: chain().periodic_orbit().plot(),
    "map attractor": lambda: MapAttractor(Logistic(rate=3.5), np.array([0.3]), 100, 20).plot(),
    "sweep": lambda: logistic_sweep().plot(),
    "series": lambda: TimeSeries(chain().attractor(impacts=5)).plot(),
    "section": lambda: ImpactSection(chain().attractor(impacts=5)).plot(),
    "modes": lambda: POD(chain().attractor(impacts=5)).plot(),
    "space and time": lambda: SpaceTime(chain().attractor(impacts=5)).plot(),
}


@pytest.fixture(autouse=True)
def _no_figures_stay() -> object:
    yield
    plt.close("all")


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_pyplot_shows_what_has_no_axes_given(plot: Callable[[], Axes]) -> None:
    figure = plot().get_figure()
    assert any(plt.figure(number) is figure for number in plt.get_fignums())


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_what_pyplot_sets_as_a_figure_is_made_lasts(
    plot: Callable[[], Axes], monkeypatch: pytest.MonkeyPatch
) -> None:
    # as backends of notebooks do, that would otherwise show the first figure only
    make = plt.figure

    def figure(*args: object, **settings: object) -> object:
        mpl.rcParams["keymap.help"] = ["f9"]
        return make(*args, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(plt, "figure", figure)
    with mpl.rc_context():
        plot()
        assert mpl.rcParams["keymap.help"] == ["f9"]


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_a_dark_style_is_followed(plot: Callable[[], Axes]) -> None:
    with plt.style.context("dark_background"):
        axes = plot()
    assert to_rgb(axes.get_facecolor()) == (0.0, 0.0, 0.0)
    colours = {to_rgb(line.get_color()) for line in axes.lines}
    assert (0.0, 0.0, 0.0) not in colours


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_type_is_that_of_print_unless_the_user_has_chosen(plot: Callable[[], Axes]) -> None:
    assert plot().xaxis.label.get_fontsize() == 8.0
    with mpl.rc_context({"axes.labelsize": 15.0}):
        assert plot().xaxis.label.get_fontsize() == 15.0


def test_ink_is_between_text_and_paper() -> None:
    with mpl.rc_context({"text.color": "red", "axes.facecolor": "blue"}):
        np.testing.assert_allclose(figures.ink(0.25), (0.75, 0.0, 0.25))


def called_at_import(code: str) -> set[str]:
    """Names of the functions that a module calls while it is imported."""
    tree = ast.parse(code)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            node.body = []
    return {
        call.func.id
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
    }


def test_no_colour_is_chosen_before_a_figure_is_drawn() -> None:
    assert called_at_import("REGION = [ink(0.5)]") == {"ink"}
    assert called_at_import("def draw():\n    return ink(0.5)") == set()
    root = Path(__file__).parents[2]
    for folder in ("dynkit", "systems", "analysis", "tutorials"):
        for path in (root / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if "ink" in text or "circles" in text:
                assert not called_at_import(text) & {"ink", "circles"}, path
