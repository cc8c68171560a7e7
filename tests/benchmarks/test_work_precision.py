"""Error against run time: the standard jobs, their exact values, and the program."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit.analysis import ExactImpacts
from dynkit.analysis.work_precision.measurement import compare
from dynkit.analysis.work_precision.standard_methods import ExactMaps
from tests.benchmarks.peers import NAMES, all_methods
from tests.benchmarks.work_precision import work_precision
from tests.benchmarks.work_precision.__main__ import main
from tests.benchmarks.work_precision.jobs import JOBS, read_starts, standard_jobs
from tests.effort import is_thorough
from tests.reference.work_precision_jobs import Start, starts, values_of


@cache
def jobs() -> dict[str, list[ExactImpacts]]:
    return standard_jobs()


# --- the exact values -----------------------------------------------------------------------------

# Chatter takes a minute. A plain run computes one long motion and some near-grazing starts anew.
RECOMPUTED = range(206) if is_thorough() else (1, 6, 7, 204, 205)


def test_the_file_holds_the_starts_of_the_reference() -> None:
    written = [(entry["job"], entry["position"], entry["phase"]) for entry in read_starts()]
    assert written == [
        (start.job, list(start.case.position), start.case.phase) for start in starts()
    ]
    assert list(dict.fromkeys(job for job, _, _ in written)) == list(JOBS)


@pytest.mark.parametrize("place", RECOMPUTED)
def test_the_values_of_the_file_are_those_of_the_reference(place: int) -> None:
    start: Start = starts()[place]
    written: dict[str, Any] = read_starts()[place]
    # A dip's time and depth are sums of doubles, whose last digits differ from one processor to
    # another: the exact values are those of the numbers in the file.
    offset = written["system"]["offset"]
    assert offset == pytest.approx(start.case.offset, rel=0.0, abs=1e-14)
    if start.job == "grazing":
        assert written["until"] == pytest.approx(start.until, rel=0.0, abs=1e-4)
        start = replace(start, until=written["until"])
    found = json.loads(
        json.dumps(values_of(replace(start, case=replace(start.case, offset=offset))))
    )
    assert found == {name: written[name] for name in found}


# --- dynkit on the standard jobs ------------------------------------------------------------------


@pytest.mark.parametrize("title", JOBS.values())
def test_dynkit_is_right_on_every_job(title: str) -> None:
    for exact in jobs()[title]:
        outcome = compare(ExactMaps().prepare(exact, 0.0)(0), exact)
        assert outcome.right
        if title != JOBS["grazing"]:
            # not only the start, all numbers of the motion are rounded
            assert outcome.error < 64.0 * 2.0**-53 * max(exact.conditioning, 1.0)


@pytest.mark.parametrize("title", JOBS.values())
def test_no_error_on_a_job_exceeds_the_one_claimed(title: str) -> None:
    for exact in jobs()[title]:
        check_claims(exact)


def check_claims(exact: ExactImpacts) -> None:
    start = exact.system.state(exact.position, exact.velocity, exact.phase)
    count = len(exact.times) + 1
    if len(exact.chatters):
        count = 600  # with the bounces that are not compared
    record = exact.system.simulate(impacts=count, start=start)
    places = [int(np.argmin(abs(record.time - time))) for time in exact.times]
    for which, place in enumerate(places):
        claimed = float(record.error[place])
        off = exact.errors(
            record.time[[place]], record.position[[place]], record.velocity[[place]], [which]
        )
        # errors are claimed in absolute terms, of phases rather than times
        smallest = min(*exact.size, exact.system.frequency * exact.period)
        assert off[0] <= (claimed + np.spacing(record.time[place])) / smallest


def test_near_grazing_starts_come_in_pairs_of_dips_and_misses() -> None:
    hits = [len(exact.times) for exact in jobs()[JOBS["grazing"]]]
    assert hits == [1, 0] * 100


# --- the program ----------------------------------------------------------------------------------


def test_it_prints_a_line_for_each_measurement(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--only", "damping", "--methods", "dynkit,Moreau"])
    head, _, *lines = capsys.readouterr().out.split("\n\n")[0].splitlines()
    assert head.startswith("| job         | method | tolerance | error")
    found = [[cell.strip() for cell in line.split("|")[1:4]] for line in lines]
    assert found == [
        [JOBS["damping"], "dynkit", "-"],
        *([JOBS["damping"], "Moreau", step] for step in ("1e-02", "1e-03", "1e-04", "1e-05")),
    ]


def test_a_library_that_is_not_there_is_skipped_with_a_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in ("heyoka", "siconos", "siconos.kernel"):
        monkeypatch.setitem(__import__("sys").modules, module, None)
    main(["--only", "chaos", "--methods", "heyoka,Siconos"])
    printed = capsys.readouterr().out
    assert "heyoka is not installed: it comes with the extra dev" in printed
    assert "Siconos is not installed" in printed


@pytest.mark.parametrize("ending", ["csv", "md", "png", "svg"])
def test_it_writes_tables_and_figures(ending: str, tmp_path: Path) -> None:
    file = tmp_path / f"found.{ending}"
    work_precision(str(file), ["damping"], ["dynkit", "paper"], log=io.StringIO())
    content = file.read_bytes()
    if ending == "csv":
        rows = list(csv.DictReader(io.StringIO(content.decode())))
        assert [row["method"] for row in rows] == ["dynkit"] + ["paper"] * 5
        assert all(float(row["error"]) < 1e-4 and int(row["work"]) > 0 for row in rows)
    elif ending == "md":
        assert content.decode().count("\n| damping 1e4 | ") == 6
    else:
        assert content.startswith(b"\x89PNG" if ending == "png" else b"<?xml")


def test_the_help_names_jobs_and_methods(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    named = f"jobs: {', '.join(JOBS)}\nmethods: {', '.join(NAMES)}\n"
    assert named in capsys.readouterr().out


def test_the_names_are_those_of_the_methods() -> None:
    assert NAMES == (
        "dynkit", "paper", "RK45", "DOP853", "Radau", "LSODA", "Moreau", "heyoka", "Siconos",
    )  # fmt: skip
    assert [method.name for method in all_methods(["paper", "Moreau"])] == ["paper", "Moreau"]
    with pytest.raises(ValueError, match=r"methods must hold names among dynkit, .*; got 'RK54'"):
        all_methods(["RK54"])
