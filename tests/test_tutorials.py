"""The tutorials run as they stand, and say what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests import notebooks

TUTORIALS = notebooks.notebooks()


def test_there_are_tutorials_in_order() -> None:
    assert [int(path.name[:2]) for path in TUTORIALS] == list(range(1, len(TUTORIALS) + 1))


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_gives_what_it_shows(path: Path) -> None:
    shown = notebooks.texts(notebooks.read(path))
    given = notebooks.texts(notebooks.execute(notebooks.read(path)))
    assert len(shown) == len(given)
    for a, b in zip(shown, given, strict=True):
        assert (a.cell, a.words, a.figures) == (b.cell, b.words, b.figures)
        # two runs of a chaotic motion differ by their standard errors
        tolerance = 0.25 if a.statistics else 1e-6
        np.testing.assert_allclose(b.numbers, a.numbers, rtol=tolerance, err_msg=a.cell)


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
    assert sum(text.figures for text in notebooks.texts(notebook)) >= 2
