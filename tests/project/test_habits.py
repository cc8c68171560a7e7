"""The files by which the project is cited, checked before a commit, and built elsewhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import dynkit

ROOT = Path(__file__).parents[2]
FILES = [
    ROOT / "CITATION.cff",
    ROOT / ".pre-commit-config.yaml",
    *sorted((ROOT / ".github").rglob("*.yml")),
]


def read(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_file_is_yaml(path: Path) -> None:
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)


def test_the_citation_is_of_this_version() -> None:
    citation = read("CITATION.cff")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["version"] == dynkit.__version__
    assert citation["license"] == project["license"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)


def test_the_checks_run_on_three_systems_with_every_supported_python() -> None:
    jobs = read(".github/workflows/ci.yml")["jobs"]
    matrix = jobs["checks"]["strategy"]["matrix"]
    systems = {"ubuntu-latest", "macos-latest", "windows-latest"}
    assert set(matrix["os"]) == set(jobs["install"]["strategy"]["matrix"]["os"]) == systems
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f">={matrix['python'][0]}" == project["requires-python"]
    steps = [step.get("run", "") for step in jobs["checks"]["steps"]]
    # links are made before the files are
    assert steps[0] == "git config --global core.symlinks true"
    assert steps[-1] == ".ci/run"


def test_commands_of_the_workflow_and_of_the_hooks_exist() -> None:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    text += (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert set(re.findall(r"(?:run|entry): make ([a-z-]+)", text)) <= set(targets)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tools = [re.split(r"[<>=\[;]", each)[0] for each in project["optional-dependencies"]["dev"]]
    assert set(re.findall(r"\.venv/bin/(\S+)", text)) <= set(tools)


def test_every_citation_of_the_paper_has_its_reference() -> None:
    paper = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8")
    references = (ROOT / "docs" / "paper" / "paper.bib").read_text(encoding="utf-8")
    assert set(re.findall(r"@(\w+\d{4})", paper)) == set(
        re.findall(r"^@\w+\{(\w+),", references, re.M)
    )
