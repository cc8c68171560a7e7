"""The documentation has a page for every public name, and for every tutorial."""

from __future__ import annotations

import ast
import builtins
import importlib
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.public_classes import public_classes

DOCS = Path(__file__).parents[2] / "docs"
MADE = {"../api/command.md", "gallery/index.md"}
"""Pages that exist once the documentation was built."""
PAGES = [DOCS.parent / "README.md", *sorted(DOCS.rglob("*.md"))]


def extension(name: str) -> Any:
    """A module of the documentation's own extensions."""
    sys.path.insert(0, str(DOCS / "_extensions"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


def made_page() -> str:
    """The page of `dynkit.analysis`, as the documentation makes it."""
    text: str = extension("reference").analysis_page()
    return text


def listed(page: str) -> set[str]:
    """Names in the tables of a page of the reference."""
    if page == "analysis.md":
        text = made_page()
    else:
        text = (DOCS / "api" / page).read_text(encoding="utf-8")
    tables = re.findall(r"autosummary::\n(.*?)```", text, flags=re.DOTALL)
    return {
        line.strip(" ~") for table in tables for line in table.split("\n") if line.startswith("   ")
    } - {":toctree: generated", ""}


@pytest.mark.parametrize(
    ("page", "module"),
    [
        ("toolkit.md", "dynkit"),
        ("systems.md", "dynkit.systems"),
        ("analysis.md", "dynkit.analysis"),
        ("figures.md", "dynkit.plotting.figures"),
        ("files.md", "dynkit.data.atomic_files"),
    ],
)
def test_every_public_name_is_in_the_reference(page: str, module: str) -> None:
    names = {name for name in importlib.import_module(module).__all__ if name[0] != "_"}
    own = {name for name in listed(page) if "." not in name}
    assert own == names


@pytest.mark.parametrize("page", ["toolkit.md", "systems.md", "analysis.md"])
def test_names_of_modules_in_the_reference_are_there(page: str) -> None:
    for name in listed(page):
        home, _, attribute = f"dynkit.{name}".rpartition(".")
        if "." in name:
            assert hasattr(importlib.import_module(home), attribute)


INSIDE = {"ImpactMap", "SecondMoments", "SmoothMap"}
"""Bases, and what measures are made of: nothing that a user makes."""


def test_whatever_a_user_gets_is_in_the_reference() -> None:
    known = {
        name.rpartition(".")[2]
        for page in ("toolkit.md", "systems.md", "analysis.md")
        for name in listed(page)
    }
    got = {kind.__name__ for kind in public_classes()}
    assert got - known == INSIDE


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS.parent).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("https://") and target not in MADE:
            place = page.parent / target
            # the build of the documentation draws a picture by the script beside it
            assert place.exists() or place.with_suffix(".py").exists(), target


def undefined(code: str) -> set[str]:
    """Names that code reads and nowhere imports, assigns or takes as an argument."""
    names = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)]
    known = {name.id for name in names if not isinstance(name.ctx, ast.Load)} | set(vars(builtins))
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            known |= {(name.asname or name.name).partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ClassDef | ast.FunctionDef):
            known.add(node.name)
        elif isinstance(node, ast.arg):
            known.add(node.arg)
        elif isinstance(node, ast.ExceptHandler):
            known.add(node.name or "")
    return {name.id for name in names} - known


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")],
    ids=lambda page: page.name,
)
def test_code_needs_nothing_that_its_page_does_not_say(page: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert undefined("\n".join(blocks)) == set()


def test_every_page_is_in_a_table_of_contents() -> None:
    tables = {
        (page.parent / line.strip()).relative_to(DOCS)
        for page in DOCS.rglob("*.md")
        for table in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), flags=re.DOTALL)
        for line in table.split("\n")
        if line.strip() and line[0] != ":"
    }
    pages = {page.relative_to(DOCS).with_suffix("") for page in DOCS.rglob("*.md")}
    assert pages - tables == {Path("index"), Path("paper/paper")}  # the paper is no page


def test_links_from_source_lead_to_the_object_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "reference.html").write_text('<dt id="dynkit.flow.Crossing">', encoding="utf-8")
    page = tmp_path / "source.html"
    for given, wanted in (
        ("dynkit.flow.Crossing", "#dynkit.flow.Crossing"),
        ("dynkit.Crossing", "#dynkit.flow.Crossing"),
        ("dynkit.Crossing.time", ""),
    ):
        page.write_text(f'<a href="reference.html#{given}">', encoding="utf-8")
        assert extension("source_links").mended(page) == f'<a href="reference.html{wanted}">'
