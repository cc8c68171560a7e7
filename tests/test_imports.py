"""Public names: light to import, and all of them there."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ("dynkit", "dynkit.systems", "dynkit.analysis")
HEAVY = ("h5py", "matplotlib", "numba", "numpy", "scipy", "sympy", "tqdm")


def public_names() -> list[tuple[str, str]]:
    return [
        (package, name) for package in PACKAGES for name in importlib.import_module(package).__all__
    ]


def names_for_type_checkers(package: str) -> list[str]:
    """The names that are imported under ``if TYPE_CHECKING``."""
    module = importlib.import_module(package)
    assert module.__file__ is not None
    tree = ast.parse(Path(module.__file__).read_text())
    (block,) = (
        node
        for node in tree.body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    return [
        alias.name
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_import_leaves_heavy_libraries_alone(package: str) -> None:
    code = f"import sys, {package}; print(sorted({set(HEAVY)} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("package", "name"), public_names())
def test_public_name_resolves(package: str, name: str) -> None:
    assert hasattr(importlib.import_module(package), name)


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_see_the_public_names(package: str) -> None:
    public = set(importlib.import_module(package).__all__) - {"__version__"}
    assert sorted(names_for_type_checkers(package)) == sorted(public)


@pytest.mark.parametrize(("package", "name"), public_names())
def test_public_name_is_listed_by_dir(package: str, name: str) -> None:
    assert name in dir(importlib.import_module(package))


@pytest.mark.parametrize("package", PACKAGES)
def test_unknown_name_is_an_attribute_error(package: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'nothing'"):
        importlib.import_module(package).__getattr__("nothing")
