"""Sweeps that are killed at any moment, and writers that start at once: nothing is lost."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.sweeps.killing import KILLS, RATES, ROUNDS, WRITERS

ROOT = Path(__file__).resolve().parents[2]
LOCK, NEW, STORE = ".x.h5.lock", ".x.h5.new", "x.h5"


def campaign(name: str, folder: Path) -> dict[str, Any]:
    """What happened in processes that descend from one with a single thread, which may fork."""
    found = subprocess.run(
        [sys.executable, "-m", "tests.sweeps.killing", name, str(folder), "20261122"],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    outcome: dict[str, Any] = json.loads(found.stdout)
    return outcome


@pytest.fixture(scope="module")
def kills(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return campaign("kill", tmp_path_factory.mktemp("kills"))


def test_two_hundred_were_killed_before_and_while_they_wrote(kills: dict[str, Any]) -> None:
    killed = kills["killed"]
    assert len(killed) == KILLS
    assert any(NEW in each["left"] for each in killed)
    assert any(STORE in each["left"] for each in killed)
    assert any(STORE not in each["left"] for each in killed)
    assert len({each["survived"] for each in killed}) > len(RATES) // 2


def test_what_was_reported_stored_is_there(kills: dict[str, Any]) -> None:
    lost = [each for each in kills["killed"] if each["survived"] < each["reported"]]
    assert lost == []


def test_what_is_there_is_right(kills: dict[str, Any]) -> None:
    assert [each for each in kills["killed"] if not each["right"]] == []


def test_what_goes_on_ends_with_the_bits_of_a_sweep_that_nobody_killed(
    kills: dict[str, Any],
) -> None:
    finished = kills["finished"]
    assert finished
    for each in finished:
        assert each["right"]
        assert each["survived"] == len(RATES)
        # empty; it is left when the process dies between the last write and its end
        assert set(each["left"]) <= {STORE, LOCK}


def test_of_writers_at_once_one_writes_and_the_others_are_refused(tmp_path: Path) -> None:
    found = campaign("race", tmp_path)
    assert len(found["outcomes"]) == ROUNDS
    for number, outcome in enumerate(found["outcomes"]):
        refusal = f"store must not be in use by another writer; got /{number}.h5"
        assert len(outcome) == WRITERS
        assert "right" in outcome  # a later one may find the sweep finished
        assert set(outcome) <= {"right", refusal}
    assert found["left"] == sorted([f"{number}.h5" for number in range(ROUNDS)] + ["warm.h5"])
    assert all(found["same"])
