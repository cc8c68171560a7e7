"""Extreme cases: their exact values, what the core makes of them, and the table."""

from __future__ import annotations

import io
import json
import re
import tracemalloc
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dynkit.systems import ImpactChain
from dynkit.systems.impact.records.record import ImpactRecord
from tests.benchmarks.extremes import WrongCases, extremes
from tests.benchmarks.extremes.__main__ import main
from tests.benchmarks.extremes.cases import GROUPS, Case, read_cases
from tests.benchmarks.extremes.measures import measure
from tests.effort import is_thorough
from tests.reference.extreme_campaign import Extreme, extremes as exact_extremes
from tests.reference.extreme_values import FILE, values_of

CASES = {case.name: case for case in read_cases()}
SMALL = "N = 2, damping 0.1, r = 0.85"


@cache
def references() -> dict[str, Extreme]:
    return {extreme.entry["name"]: extreme for extreme in exact_extremes()}


@cache
def written() -> dict[str, dict[str, object]]:
    return {entry["name"]: entry for entry in json.loads(FILE.read_text())["cases"]}


@cache
def recorded(name: str) -> ImpactRecord:
    """A case simulated. Making chains of a thousand masses ready takes longer than to simulate."""
    case = CASES[name]
    oscillator = case.system()
    return oscillator.simulate(impacts=case.impacts, start=case.begin(oscillator))


# --- the exact values -----------------------------------------------------------------------------


def test_the_file_holds_the_cases_of_the_reference() -> None:
    assert list(written()) == list(references())
    assert list(CASES) == list(written())


def test_every_group_has_cases() -> None:
    assert set(Counter(case.group for case in CASES.values())) == set(GROUPS)


# These take minutes. A plain run computes every fourth of the others anew, a thorough one all.
SLOW = (
    "damping 1e8, r = 0, N = 10",
    "N = 1000, undamped, r = 1",
    "N = 1000, damping 0.1, r = 0.85",
    "P(1,3) for a time of 1e9, frequency 5e-5, N = 3",
    "P(1,50001) for a time of 1e9, frequency 1, N = 1",
)
RECOMPUTED = list(CASES) if is_thorough() else [name for name in CASES if name not in SLOW][::4]


@pytest.mark.parametrize("name", RECOMPUTED)
def test_the_values_of_the_file_are_those_of_the_reference(name: str) -> None:
    assert json.loads(json.dumps(values_of(references()[name]))) == written()[name]


# --- the core -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_no_error_exceeds_the_one_claimed(name: str) -> None:
    recorded(name)  # what it makes ready is shared with the other tests
    outcome = measure(CASES[name], ready=True)
    assert outcome.right, outcome


@pytest.mark.parametrize("name", CASES)
def test_extreme_cases_are_sampled_without_warnings(name: str) -> None:
    record = recorded(name)
    last = float(record.time[-1]) if len(record) else 1.0
    positions, velocities = record.sample(np.linspace(0.0, last, 7))
    assert np.isfinite(positions).all()
    assert np.isfinite(velocities).all()


@pytest.mark.parametrize("name", CASES)
def test_phases_are_kept_within_one_turn(name: str) -> None:
    record = recorded(name)
    assert (record.states[:, -1] >= 0.0).all()
    assert (record.states[:, -1] < 2.0 * np.pi).all()


def peak(transient: int) -> int:
    """Bytes at most while so many impacts are skipped and ten are kept."""
    chain = ImpactChain(masses=1, damping=0.1, restitution=0.5, frequency=2.5)
    chain.simulate(impacts=1)
    tracemalloc.start()
    chain.attractor(transient=transient, impacts=10)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


def test_a_million_impacts_take_the_memory_of_ten() -> None:
    row = 8 * (2 * 1 + 4)  # bytes of one recorded impact; a hundred of them are 1/200 byte for each
    # The interpreter keeps names of attributes that kernels look up, 4096 of them: they are there
    # after some thousand calls.
    chain = ImpactChain(masses=1, damping=0.1, restitution=0.5, frequency=2.5)
    for _ in range(3000):
        chain.simulate(impacts=1)
    # other threads may allocate meanwhile: not in each of three runs
    assert any(peak(1_000_000) <= peak(10) + 100 * row for _ in range(3))


# --- the program ----------------------------------------------------------------------------------


def test_extremes_prints_a_line_for_each_case(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--only", "merging"])
    head, *lines, summary = capsys.readouterr().out.splitlines()
    chosen = [case.name for case in CASES.values() if case.group == "merging"]
    columns = re.split("  +", head)
    assert columns[:6] == ["case", "impacts", "ending", "largest", "actual error", "estimated"]
    assert columns[6:] == ["ratio", "us/impact"]
    assert [line[:54].rstrip() for line in lines] == chosen
    assert summary.startswith(f"{len(chosen)} of {len(chosen)} cases right")


def test_extremes_writes_the_table_as_markdown(tmp_path: Path) -> None:
    file = tmp_path / "extremes.md"
    main(["--only", "merging,time", "--out", str(file)])
    rows = re.findall(r"^\| .* \|$", file.read_text(), flags=re.MULTILINE)
    chosen = [case for case in CASES.values() if case.group in ("merging", "time")]
    assert len(rows) == 2 + len(chosen)


def test_a_case_that_is_wrong_fails_the_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case = CASES[SMALL]
    changed = Case(**{**vars(case), "ending": "CONTACT_FOR_EVER"})
    monkeypatch.setattr("tests.benchmarks.extremes.read_cases", lambda: [changed])
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 1
    message = f"1 of 1 cases are wrong: {SMALL}"
    assert capsys.readouterr().err == f"extremes: failed: {message}\n"
    with pytest.raises(WrongCases, match=re.escape(message)):
        extremes(log=io.StringIO())


def test_an_error_above_the_claimed_one_is_wrong() -> None:
    case = CASES[SMALL]
    (first, *_) = case.values
    moved = first.__class__(first.after, first.number, first.time, (first.state[0] + 1,) * 4)
    outcome = measure(Case(**{**vars(case), "values": (moved,)}))
    assert outcome.wrong == "an error exceeds what is claimed"
    assert outcome.true > 0.5


def test_nothing_is_simulated_before_the_arguments_are_right() -> None:
    log = io.StringIO()
    with pytest.raises(ValueError, match="out must end in"):
        extremes("table.txt", log=log)
    assert not log.getvalue()


# --- what the documentation says ------------------------------------------------------------------


def section() -> str:
    """What the documentation says of extreme cases."""
    text = (Path(__file__).parents[2] / "docs" / "benchmarks.md").read_text()
    return text.split("## Extreme cases\n")[1].split("\n## ")[0]


def test_the_documentation_counts_the_cases() -> None:
    impacts = sum(len(case.values) for case in CASES.values())
    assert f"{len(CASES)} of {len(CASES)} cases right, {impacts} impacts" in section()


def test_the_documentation_names_cases_of_every_group() -> None:
    rows = re.findall(r"^\| (.*?) \|", section(), flags=re.MULTILINE)
    named = [CASES[row] for row in rows if row not in ("case", "---")]
    assert {case.group for case in named} == set(GROUPS)
