"""Public names: light to import, and all of them there."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import dynkit

PACKAGES = ("dynkit", "dynkit.systems", "dynkit.analysis")
HEAVY = ("h5py", "matplotlib", "numba", "numpy", "scipy", "sympy", "tqdm")


def public_names() -> list[tuple[str, str]]:
    return [
        (package, name) for package in PACKAGES for name in importlib.import_module(package).__all__
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_import_leaves_heavy_libraries_alone(package: str) -> None:
    code = f"import sys, {package}; print(sorted({set(HEAVY)} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("package", "name"), public_names())
def test_public_name_resolves(package: str, name: str) -> None:
    assert hasattr(importlib.import_module(package), name)


def test_namespace_of_the_toolkit_knows_no_particular_system() -> None:
    stub = Path(dynkit.__file__).with_suffix(".pyi").read_text()
    assert not {"systems", "analysis", "cli"} & set(re.findall(r"[a-z]+", stub))


@pytest.mark.parametrize(("package", "name"), public_names())
def test_public_name_is_listed_by_dir(package: str, name: str) -> None:
    assert name in dir(importlib.import_module(package))


@pytest.mark.parametrize("package", PACKAGES)
def test_unknown_name_is_an_attribute_error(package: str) -> None:
    with pytest.raises(AttributeError, match=f"No {package} attribute nothing"):
        importlib.import_module(package).__getattr__("nothing")
