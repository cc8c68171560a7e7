"""`dynkit continue`: what it prints and writes."""

import csv
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dynkit import Branch, continue_orbit
from dynkit.cli import main
from dynkit.systems import ImpactChain

CONTINUE = ["continue", "--frequency", "0.87", "--from", "0.7", "--to", "1.1"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def table_of(text: str) -> list[list[str]]:
    """The rows under the heading of the table of bifurcations."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("kind  "))
    return [line.split() for line in lines[start + 1 :] if re.match(r"[A-Z]{2} ", line)]


@cache
def expected() -> Branch:
    chain = ImpactChain(frequency=0.87)
    return continue_orbit(chain.periodic_orbit(periods=3), "frequency", bounds=(0.7, 1.1))


def test_continue_prints_the_bifurcations(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*CONTINUE, "--periods", "3"]) == 0
    rows = table_of(capsys.readouterr().out)
    found = expected().bifurcations
    assert [row[0] for row in rows] == [b.kind for b in found]
    # twelve digits are printed
    assert np.allclose([float(row[1]) for row in rows], [b.value for b in found], rtol=1e-11)
    assert {row[2] for row in rows if row[0] == "PD"} == {"-1"}
    assert {row[2] for row in rows if row[0] == "GR"} == {"-"}


def test_continue_starts_from_the_attractor_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(CONTINUE) == 0
    assert "started from  P(1,3), stable\n" in capsys.readouterr().out


def test_continue_keeps_the_branch(folder: Path) -> None:
    assert main([*CONTINUE, "--periods", "3", "--store", "branch.h5"]) == 0
    orbit = ImpactChain(frequency=0.87).periodic_orbit(periods=3)
    kept = Branch.load(folder / "branch.h5", orbit)
    assert np.array_equal(kept.unknowns, expected().unknowns)


def test_a_table_has_points_and_bifurcations_in_the_order_of_the_curve(folder: Path) -> None:
    assert main([*CONTINUE, "--periods", "3", "--out", "branch.csv"]) == 0
    with (folder / "branch.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    branch = expected()
    points = [row for row in rows if not row["kind"]]
    assert [float(row["frequency"]) for row in points] == branch.parameter.tolist()
    velocity = branch.observable("relative_velocity")
    assert [float(row["relative_velocity[0]"]) for row in points] == velocity[:, 0].tolist()
    found = [row for row in rows if row["kind"]]
    assert [row["kind"] for row in found] == [b.kind for b in branch.bifurcations]
    assert [float(row["frequency"]) for row in found] == [b.value for b in branch.bifurcations]
    for row, bifurcation in zip(found, branch.bifurcations, strict=True):
        before = [each for each in rows[: rows.index(row)] if not each["kind"]]
        assert len(before) == np.floor(bifurcation.place) + 1
        assert float(row["error_of_frequency"]) == bifurcation.error
        assert row["distance_from_curve"] == "nan"


def test_an_array_file_has_the_dataset_of_the_branch_and_a_store_is_read_again(
    folder: Path,
) -> None:
    assert main([*CONTINUE, "--periods", "3", "--out", "branch.npz"]) == 0
    branch = expected()
    with np.load(folder / "branch.npz") as file:
        assert file["frequency"].tolist() == branch.parameter.tolist()
        assert file["bifurcation_value"].tolist() == [b.value for b in branch.bifurcations]
    assert main([*CONTINUE, "--periods", "3", "--out", "branch.h5"]) == 0
    assert np.array_equal(Branch.load(folder / "branch.h5").parameter, branch.parameter)


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_continue_draws_the_branch(ending: str, folder: Path) -> None:
    assert main([*CONTINUE, "--out", f"branch.{ending}"]) == 0
    assert [path.name for path in folder.iterdir()] == [f"branch.{ending}"]
    begin = (folder / f"branch.{ending}").read_bytes()[:5]
    assert begin in (b"\x89PNG\r", b"<?xml")


def test_failure_leaves_nothing_half_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", fail)
    assert main([*CONTINUE, "--out", "branch.png"]) == 1
    assert list(folder.iterdir()) == []
