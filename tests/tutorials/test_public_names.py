"""The programs among the tutorials use public names only."""

import ast
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "tutorials"
PUBLIC = (
    "dynkit",
    "dynkit.analysis",
    "dynkit.plotting.figures",
    "dynkit.data.atomic_files",
    "dynkit.systems",
)


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


def test_programs_import_public_names_only() -> None:
    public = {(package, name) for package in PUBLIC for name in import_module(package).__all__}
    assert imported()
    assert imported() <= public


def test_programs_import_dynkit_by_its_names_only() -> None:
    for path in FOLDER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert not any(alias.name.startswith("dynkit") for alias in node.names), path
