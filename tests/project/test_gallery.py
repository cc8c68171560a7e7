"""The scripts that draw the pictures of the documentation, which `make docs` executes."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from matplotlib.figure import Figure

from dynkit.plotting.figures import new_figure
from tests.pictures import overprinted

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def scripts() -> Iterator[ModuleType]:
    sys.path.insert(0, str(DOCS / "_extensions"))
    try:
        yield importlib.import_module("scripts")
    finally:
        sys.path.pop(0)


def gallery(scripts: ModuleType) -> list[Path]:
    found: list[Path] = [path for path in scripts.scripts() if path.parent.name == "gallery"]
    return found


def test_the_gallery_has_twenty_pictures_and_shows_every_script(scripts: ModuleType) -> None:
    shown = [name for names in scripts.SECTIONS.values() for name in names]
    assert sorted(shown) == [path.stem for path in gallery(scripts)]
    assert len(shown) >= 20


def test_scripts_of_the_gallery_are_short_and_have_a_title(scripts: ModuleType) -> None:
    for path in gallery(scripts):
        assert len(scripts.lines_of_code(path)) <= scripts.LONGEST, path.name
        title, text = scripts.described(path)
        assert title, path.name
        assert text, path.name


def test_half_of_the_gallery_needs_no_chain(scripts: ModuleType) -> None:
    without = [path for path in gallery(scripts) if "Chain" not in path.read_text(encoding="utf-8")]
    assert 2 * len(without) >= len(gallery(scripts))


def test_pictures_of_other_pages_are_shown_with_their_code(scripts: ModuleType) -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
    for path in scripts.scripts():
        if path not in gallery(scripts):
            assert f"{path.stem}.png)" in pages
            assert f"{path.stem}.py" in pages


def test_a_script_is_drawn_and_one_with_overprinted_texts_is_refused(
    scripts: ModuleType, tmp_path: Path
) -> None:
    script = tmp_path / "one.py"
    lines = "from dynkit.plotting.figures import new_figure\nfigure, (axes,) = new_figure()\n"
    script.write_text(lines)
    scripts.draw(script)
    assert (tmp_path / "one.png").stat().st_size > 0
    script.write_text(lines + 2 * "axes.text(0.5, 0.5, 'word')\n")
    with pytest.raises(ValueError, match="word and word are printed over each other"):
        scripts.draw(script)


def test_overprinted_texts_are_found() -> None:
    figure, (axes,) = new_figure()
    axes.set(xlabel="time", ylabel="x")
    axes.text(0.2, 0.5, "one")
    axes.text(0.8, 0.5, "other")
    assert overprinted(figure) == []
    axes.text(0.21, 0.5, "third")
    assert overprinted(figure) == [("one", "third")]


def test_an_offset_of_an_axis_is_found() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.set_ylabel("x")
    axes.plot([0.0, 1.0], [1e-9, 2e-9])
    assert [name for name, _ in overprinted(figure)] == ["x"]
