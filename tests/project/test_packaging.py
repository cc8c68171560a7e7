"""The wheel holds the whole package and works away from the repository."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = {
    "dynkit": ROOT / "dynkit",
    "dynkit/systems": ROOT / "systems",
    "dynkit/analysis": ROOT / "analysis",
}


def files_of_the_tree() -> set[str]:
    """Every file of the package, under the path that it has when installed."""
    return {
        f"{target}/{Path(folder, name).relative_to(source).as_posix()}"
        for target, source in SOURCES.items()
        for folder, _, names in os.walk(source, followlinks=False)
        for name in names
        if Path(folder).name != "__pycache__"
    }


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel, built from a copy: setuptools leaves a build folder beside the sources."""
    tree = tmp_path_factory.mktemp("tree")
    for folder in ("dynkit", "systems", "analysis"):
        shutil.copytree(
            ROOT / folder,
            tree / folder,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, tree)
    target = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", target, tree)
    (built,) = target.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which the wheel was installed."""
    target = tmp_path_factory.mktemp("installed")
    pip("install", "--no-deps", "--no-index", "--target", target, wheel)
    return target


def pip(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def run_away_from_home(code: str, installed: Path, folder: Path) -> str:
    """What `code` prints in `folder`, with the wheel and the dependencies but no editable install.

    ``-S`` leaves out the .pth files, by which an editable install would answer for missing files.
    """
    libraries = [sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), *libraries])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_package_of_the_tree_is_listed() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    found = {
        file.removesuffix("/__init__.py").replace("/", ".")
        for file in files_of_the_tree()
        if file.endswith("/__init__.py")
    }
    assert sorted(listed) == sorted(found)


@pytest.mark.parametrize("name", ["systems", "analysis"])
def test_link_is_relative(name: str) -> None:
    assert (ROOT / "dynkit" / name).readlink() == Path("..", name)


def test_wheel_holds_every_file_and_no_other(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert held == files_of_the_tree()


def test_installed_wheel_imports_every_module_from_another_folder(
    installed: Path, tmp_path: Path
) -> None:
    modules = sorted(
        file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        for file in files_of_the_tree()
        if file.endswith(".py")
    )
    code = f"import sys, importlib\nfor m in {modules}: print(importlib.import_module(m).__file__)"
    origins = run_away_from_home(code, installed, tmp_path).split("\n")[:-1]
    assert len(origins) == len(modules)
    assert all(Path(origin).is_relative_to(installed) for origin in origins)


def test_installed_wheel_offers_its_command(installed: Path, tmp_path: Path) -> None:
    printed = run_away_from_home(
        "import sys; from dynkit.cli import main; sys.exit(main(['--help']))", installed, tmp_path
    )
    assert "simulate" in printed
