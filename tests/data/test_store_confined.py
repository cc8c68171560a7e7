"""Full disks, limits of files' sizes, and folders that must not be written: all that writes."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dynkit import sweep
from dynkit.systems import Logistic
from tests.confined import RATES
from tests.programs import said_by_program

PLAIN = ["sweep.h5", "branch.h5", "curve.h5", "table.csv", "arrays.npz", "arrays.h5"]
COMMAND = ["command.csv", "command.h5"]
FILES = [*PLAIN, "picture.png", "picture.svg", "figure.png", "report.md", *COMMAND]
STORES = {"sweep.h5", "command.h5"}
WORDS = {"disk": "No space left on device", "limit": "File too large"}


@pytest.fixture(scope="module")
def all_confined(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What happened in each confinement, and in which folder."""
    # not pytest's own folder: who is not root may not enter that
    with tempfile.TemporaryDirectory() as parent:
        Path(parent).chmod(0o755)
        folders = {name: tmp_path_factory.mktemp(name) for name in ("disk", "limit")}
        folders["forbidden"] = Path(parent, "folder")
        folders["forbidden"].mkdir()
        told = said_by_program("tests.confined", *map(str, folders.values()))
        yield {name: {**told[name], "folder": folders[name]} for name in folders}
        folders["forbidden"].chmod(0o755)


@pytest.fixture(scope="module")
def disk(all_confined: dict[str, Any]) -> Any:
    """A disk of its own where that is allowed, otherwise the limit too."""
    return all_confined["disk"]


@pytest.fixture(scope="module")
def limit(all_confined: dict[str, Any]) -> Any:
    """A limit of files' sizes, as a quota sets it."""
    return all_confined["limit"]


@pytest.fixture(scope="module")
def forbidden(all_confined: dict[str, Any]) -> Any:
    return all_confined["forbidden"]


@pytest.fixture(params=[*(("disk", name) for name in FILES), *(("limit", name) for name in PLAIN)])
def case(request: pytest.FixtureRequest) -> tuple[Any, str]:
    fixture, name = request.param
    return request.getfixturevalue(fixture), name


def test_where_there_is_no_room_the_old_file_is_left_and_nothing_else(
    case: tuple[Any, str],
) -> None:
    full, name = case
    outcome = full["outcomes"][name]
    assert outcome["left"] == [name]
    if name in STORES:
        assert 0 < outcome["kept"] < len(RATES)
    else:
        assert outcome["kept"] == "the old one"


def test_no_room_is_named_with_the_file(case: tuple[Any, str]) -> None:
    full, name = case
    argument = "store" if name.endswith(".h5") and name != "arrays.h5" else "out"
    argument = "stem" if name == "figure.png" else argument
    said = full["outcomes"][name]["said"]
    assert f"{argument} must be a file that can be written; got SMALL/{name} (" in said
    assert f"({WORDS[full['kind']]})" in said


@pytest.mark.parametrize("name", COMMAND)
def test_no_room_on_the_way_is_a_failure_of_the_command(disk: Any, name: str) -> None:
    said = disk["outcomes"][name]["said"]
    assert said.startswith("SystemExit: 1: dynkit ")
    assert said.count("\n") == 1


@pytest.mark.parametrize("full", ["disk", "limit"])
def test_with_room_again_the_sweep_goes_on_to_the_same_bits(
    request: pytest.FixtureRequest, full: str
) -> None:
    arguments: dict[str, Any] = {"start": [0.3], "transient": 0, "keep": 90, "progress": False}
    store = request.getfixturevalue(full)["folder"] / "free" / "sweep.h5"
    resumed = sweep(Logistic(3.5), "rate", RATES, store=store, **arguments)
    whole = sweep(Logistic(3.5), "rate", RATES, **arguments)
    assert resumed.observable("state[0]").tobytes() == whole.observable("state[0]").tobytes()


@pytest.mark.parametrize("name", [*FILES, "new.csv"])
def test_a_folder_that_must_not_be_written_is_named(forbidden: Any, name: str) -> None:
    said = forbidden["outcomes"][name]["said"]
    assert f"FOLDER/{name}" in said
    assert "(Permission denied)" in said
    assert said.startswith("SystemExit: 2: dynkit " if "command" in name else "ValueError: ")


def test_in_a_folder_that_must_not_be_written_nothing_changes(forbidden: Any) -> None:
    assert forbidden["unchanged"]


def test_a_finished_sweep_needs_no_folder_that_can_be_written(forbidden: Any) -> None:
    assert forbidden["outcomes"]["finished.h5"]["said"] == "done"
