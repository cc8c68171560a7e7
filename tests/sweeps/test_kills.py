"""Sweeps that are killed at any moment, and writers that start at once: nothing is lost."""

from pathlib import Path
from typing import Any

import pytest

from dynkit import Sweep, sweep
from tests.programs import said_by_program
from tests.sweeps.cases import CHAIN, FREQUENCIES, SHORT, assert_same_bits
from tests.sweeps.killing import KILLS, MOMENTS, RATES, ROUNDS, WRITERS

LOCK, NEW, STORE = ".x.h5.lock", ".x.h5.new", "x.h5"


def campaign(name: str, folder: Path) -> Any:
    """What happened in processes that descend from one with a single thread, which may fork."""
    return said_by_program("tests.sweeps.killing", name, str(folder), "20261122")


@pytest.fixture(scope="module")
def moments(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int], Sweep]:
    """Where the stores are, how many values of each survived, and what nobody killed."""
    folder = tmp_path_factory.mktemp("moments")
    whole = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    return folder, campaign("moments", folder), whole


@pytest.mark.parametrize("place", range(len(MOMENTS)), ids=str)
def test_a_killed_sweep_goes_on_where_it_was(
    moments: tuple[Path, list[int], Sweep], place: int
) -> None:
    folder, survived, whole = moments
    exact = [0, 7, 7]
    assert place >= len(exact) or survived[place] == exact[place]
    store = folder / f"{place}.h5"
    assert_same_bits(sweep(CHAIN, "frequency", FREQUENCIES, store=store, **SHORT), whole)
    assert [file.name for file in folder.iterdir() if store.name in file.name] == [store.name]


@pytest.fixture(scope="module")
def kills(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    found: dict[str, Any] = campaign("kill", tmp_path_factory.mktemp("kills"))
    return found


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
