"""The tutorials run as they stand, and say what they say."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from matplotlib import pyplot as plt
from nbformat import NotebookNode

from tests import notebooks

TUTORIALS = notebooks.notebooks()

Execute: TypeAlias = Callable[[NotebookNode], NotebookNode]


def test_there_are_tutorials_in_order() -> None:
    assert [int(path.name[:2]) for path in TUTORIALS] == list(range(1, len(TUTORIALS) + 1))


@pytest.fixture(scope="module")
def execute() -> Iterator[Execute]:
    with notebooks.executing(first=notebooks.TIMED_ONCE) as found:
        yield found


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_gives_what_it_shows(path: Path, execute: Execute) -> None:
    shown = notebooks.texts(notebooks.read(path))
    given = notebooks.texts(execute(notebooks.read(path)))
    assert len(shown) == len(given)
    for a, b in zip(shown, given, strict=True):
        assert (a.cell, a.words, a.figures) == (b.cell, b.words, b.figures)
        tolerance = 0.25 if a.statistics else 1e-6
        np.testing.assert_allclose(b.numbers, a.numbers, rtol=tolerance, err_msg=a.cell)
        assert len(a.averages) == len(b.averages)
        assert all(map(agree, a.averages, b.averages)), (a.averages, b.averages)


def agree(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether two averages of chaos, with standard errors, may be of the same motion.

    The errors themselves, from a dozen waves and printed to a digit, differ by factors of three.
    """
    (value, error), (other, other_error) = a, b
    near = abs(value - other) <= 5.0 * math.hypot(error, other_error)
    return near and error <= 5.0 * other_error and other_error <= 5.0 * error


def test_averages_agree_within_their_errors_which_are_of_one_size() -> None:
    assert agree((0.355, 0.01), (0.322, 0.012))
    assert not agree((0.355, 0.01), (0.27, 0.012))
    assert not agree((0.355, 0.01), (0.355, 0.06))
    assert not agree((0.355, 0.01), (0.355, 0.0))


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_has_been_executed_whole(path: Path) -> None:
    notebook = notebooks.read(path)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert notebooks.without_noise(notebooks.read(path)) == notebook
    errors = [output for cell in code for output in cell.outputs if output.output_type == "error"]
    assert errors == []


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_begins_with_its_question_and_draws(path: Path) -> None:
    notebook = notebooks.read(path)
    assert notebook.cells[0].source.startswith("# ")
    assert "?**" in notebook.cells[0].source
    assert sum(len(text.figures) for text in notebooks.texts(notebook)) >= 2


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_says_how_hard_and_how_long_it_is(path: Path) -> None:
    head = notebooks.read(path).cells[0].source
    assert re.search(
        r"^\*Difficulty: (easy|medium|hard)\. Time: \d+ minutes\. Needed: ", head, re.M
    )


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_each_exercise_has_a_folded_solution_that_answers(path: Path) -> None:
    cells = notebooks.read(path).cells
    tasks = [i for i, cell in enumerate(cells) if re.search(r"^\*\*\d\.\*\*", cell.source, re.M)]
    assert len(tasks) >= 1
    for i in tasks:
        solution = cells[i + 1]
        assert solution.cell_type == "code"
        assert "hide-cell" in solution.metadata["tags"]
        assert solution.metadata["jupyter"]["source_hidden"]
        assert solution.outputs


def pictures(cell: str) -> str:
    """What the pictures of a cell show."""
    (path,) = (path for path in TUTORIALS if path.name[:2] == cell[:2])
    (text,) = (text for text in notebooks.texts(notebooks.read(path)) if text.cell == cell)
    return "\n".join(text.figures)


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_every_picture_of_a_tutorial_says_what_it_shows(path: Path) -> None:
    for text in notebooks.texts(notebooks.read(path)):
        assert all(text.figures), text.cell


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_headings_of_a_tutorial_are_headings(path: Path) -> None:
    for cell in notebooks.read(path).cells:
        if cell.cell_type == "markdown":
            assert not re.search(r"^#+\s+#", cell.source, flags=re.MULTILINE), cell.id


def test_both_stops_of_the_tutorial_of_structures_are_drawn() -> None:
    assert len(re.findall("one dashed", pictures("06-09"))) == 2
    assert len(re.findall("dashed", pictures("06-01"))) == 1


def test_dotted_lines_are_orbits_that_no_motion_follows() -> None:
    assert "one dotted 'inadmissible'" in pictures("03-01")
    assert "one solid 'stable'" in pictures("03-01")
    assert "one dotted 'inadmissible'" in pictures("03-09")
    dotted = {
        text.cell
        for path in TUTORIALS
        for text in notebooks.texts(notebooks.read(path))
        if "dotted" in "".join(text.figures)
    }
    assert dotted == {"03-01", "03-09", "03-x4"}


def test_the_curve_of_grazing_carries_its_name() -> None:
    assert pictures("03-11").endswith("one dashed 'GR'; texts GR")


def test_the_diagram_of_the_tutorial_has_periods_and_chaos() -> None:
    assert "texts P(#,#) chaotic" in pictures("02-01")


def test_both_borders_of_chatter_are_marked() -> None:
    assert "one dots 'CB'" in pictures("04-07")
    assert "legend CB" in pictures("04-07")


def executed(cell: str) -> dict[str, Any]:
    """Names that one cell of code defines by itself."""
    (path,) = (path for path in TUTORIALS if path.name[:2] == cell[:2])
    (code,) = (each.source for each in notebooks.read(path).cells if each.id == cell)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(code, cell, "exec"), names)
    return names


def test_the_sweep_of_the_ricker_map_goes_through_doublings_to_chaos() -> None:
    """Fixed point up to growth 2, then periods 2, 4, ...: May, Nature 261 (1976) 459."""
    found = executed("07-01")["found"]
    plt.close("all")
    labels = {}
    for growth, points, name in [(1.7, 1, "P(1)"), (2.3, 2, "P(2)"), (2.6, 4, "P(4)")]:
        place = int(abs(found.values - growth).argmin())
        labels[name] = str(found.label(place))
        kept = found.observable(found.observables[0])[place]
        assert len(np.unique(kept.round(6))) == points, growth
    assert labels == {name: name for name in labels}
    assert str(found.label(int(abs(found.values - 2.9).argmin()))) == "chaotic"


def test_the_figure_of_the_ricker_map_shows_periods_and_chaos() -> None:
    assert "texts P(#) chaotic" in pictures("07-01")
