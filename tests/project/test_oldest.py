"""The oldest supported versions are the ones that `make test-oldest` tests."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_constraints_are_the_lowest_versions_that_are_allowed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / "tests" / "oldest.txt").read_text(encoding="utf-8").splitlines()
    constraints = [line for line in lines if not line.startswith("#")]
    assert constraints == [
        each.split(",")[0].replace(">=", "==") for each in project["dependencies"]
    ]


def test_the_oldest_python_is_the_one_that_is_tested() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    required = tomllib.loads(text)["project"]["requires-python"]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    oldest = f"python{required.removeprefix('>=')}"
    # or the one that is there, on a machine that has no other
    assert f"OLDEST_PYTHON ?= $(shell command -v {oldest} || echo $(PYTHON))\n" in makefile
