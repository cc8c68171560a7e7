"""The programs among the tutorials use public names, but for those that the API lacks."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "tutorials"
PUBLIC = ("dynkit", "dynkit.analysis", "dynkit.systems")

LACKING = {
    ("dynkit.analysis.annotation", "mark_values"),
    ("dynkit.analysis.dimension.scaling", "find_scaling"),
    ("dynkit.analysis.space_time", "new_surfaces"),
    ("dynkit.continuation.exploring", "at_motions"),
    *(
        ("dynkit.plotting.figures", name)
        for name in ("COLUMN_WIDTH", "DOTS", "ink", "new_figure", "print_style", "save_figure")
    ),
    ("dynkit.data.atomic_files", "whole"),
    ("dynkit.orbits.harmonics", "Harmonics"),
    ("dynkit.labels.label", "OrbitKind"),
    ("dynkit.systems.impact.attractor", "ImpactAttractor"),
    ("dynkit.systems.impact.orbits.orbit", "ImpactOrbit"),
    ("dynkit.systems.impact.record", "ImpactRecord"),
    ("dynkit.systems.impact.state", "ImpactState"),
    ("dynkit.systems.impact.sticking.orbit", "StickingOrbit"),
}
"""What the programs need and no public name gives."""


def imported() -> set[tuple[str, str]]:
    """Modules of dynkit and the names that the programs import from them."""
    return {
        (node.module, alias.name)
        for path in FOLDER.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dynkit")
        for alias in node.names
        if node.module
    }


def test_programs_import_public_names_but_for_those_that_are_lacking() -> None:
    public = {(package, name) for package in PUBLIC for name in import_module(package).__all__}
    assert imported() - public == LACKING


def test_programs_import_dynkit_by_its_names_only() -> None:
    for path in FOLDER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert not any(alias.name.startswith("dynkit") for alias in node.names), path


@pytest.mark.parametrize("package", PUBLIC)
def test_what_is_lacking_is_not_public(package: str) -> None:
    assert not {name for _, name in LACKING} & set(import_module(package).__all__)
