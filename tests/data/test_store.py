import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dynkit.data.atomic_files import locked, place
from dynkit.data.store import Archive, read, write

ENTRIES = {"kind": "test", "grüße": "ωγ"}
ARRAYS = {"values": np.array([0.1, np.nan, -0.0]), "group/none yet": np.empty((0, 4))}


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    path = tmp_path / "x.h5"
    write(path, Archive(ENTRIES, ARRAYS))
    return path


def assert_refused_untouched(path: Path, message: str) -> None:
    before = path.read_bytes()
    with pytest.raises(ValueError, match=message):
        read(path)
    assert path.read_bytes() == before


def test_what_was_written_is_read(stored: Path) -> None:
    archive = read(stored)
    assert archive.entries == ENTRIES
    assert archive.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert archive.arrays[name].tobytes() == array.tobytes()
        assert archive.arrays[name].shape == array.shape


def test_other_hdf5_tools_open_a_store(stored: Path) -> None:
    with h5py.File(stored, "r") as file:
        assert file.attrs["kind"] == "test"
        rows: Any = file["group/none yet"]
        assert rows.shape == (0, 4)


def test_writing_leaves_nothing_else_behind(stored: Path) -> None:
    write(stored, Archive({}, {}))
    assert list(stored.parent.iterdir()) == [stored]
    assert not read(stored).entries


def test_a_failed_write_leaves_the_old_store(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    before = stored.read_bytes()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write(stored, Archive({}, {}))
    assert stored.read_bytes() == before
    assert list(stored.parent.iterdir()) == [stored]


@pytest.mark.parametrize("kept", [21, 22, 100, 511, 512, 513, 1000, -4096, -1])
def test_a_truncated_store_is_refused(stored: Path, kept: int) -> None:
    stored.write_bytes(stored.read_bytes()[:kept])
    assert_refused_untouched(stored, r"store must be whole; got .*x\.h5, which is truncated")


@pytest.mark.parametrize("kept", [0, 1, 19])
def test_the_stump_of_a_store_is_refused(stored: Path, kept: int) -> None:
    stored.write_bytes(stored.read_bytes()[:kept])
    assert_refused_untouched(stored, r"store must be a store of dynkit, as .*; got .*x\.h5")


def test_bytes_too_many_are_refused(stored: Path) -> None:
    stored.write_bytes(stored.read_bytes() + b"\0")
    assert_refused_untouched(stored, "store must be whole")


def test_any_byte_that_flips_a_bit_is_refused(stored: Path) -> None:
    whole = stored.read_bytes()
    accepted = []
    for place_, bit in enumerate(np.random.default_rng(0).integers(8, size=len(whole)).tolist()):
        damaged = bytearray(whole)
        damaged[place_] ^= 1 << bit
        stored.write_bytes(damaged)
        try:
            read(stored)
        except ValueError:
            continue
        accepted.append(place_)
    assert accepted == []


def test_another_format_is_refused_by_number(stored: Path) -> None:
    stored.write_bytes(stored.read_bytes().replace(b"format 1\n", b"format 0\n", 1))
    assert_refused_untouched(stored, r"store must have format 1; got format 0 of .*x\.h5")


def test_a_missing_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"can be read; got .*x\.h5 \(No such file"):
        read(tmp_path / "x.h5")


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"store must be in a folder that exists; got .*x\.h5"):
        place("store", tmp_path / "none" / "x.h5")


@pytest.mark.parametrize("name", ["a" * 1000, "a\0b"])
def test_an_impossible_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="store must be a file; got"):
        place("store", tmp_path / name)


def test_a_link_stays_a_link(stored: Path) -> None:
    link = stored.with_name("link.h5")
    link.symlink_to(stored)
    write(place("store", link), Archive({"new": "yes"}, {}))
    assert link.is_symlink()
    assert read(stored).entries == {"new": "yes"}


def test_a_locked_store_is_refused(stored: Path) -> None:
    with (
        locked("store", stored),
        pytest.raises(ValueError, match=r"in use by another writer; got .*x\.h5"),
        locked("store", stored),
    ):
        pass


def test_a_lock_is_given_back(stored: Path) -> None:
    for _ in range(2):
        with locked("store", stored):
            pass
    assert list(stored.parent.iterdir()) == [stored]


def test_a_lock_file_that_nobody_holds_is_taken_over(stored: Path) -> None:
    left_behind = stored.with_name(".x.h5.lock")
    left_behind.touch()
    with locked("store", stored):
        pass
    assert not left_behind.exists()


def test_a_folder_that_cannot_be_written_is_refused(
    stored: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with (
        pytest.raises(ValueError, match=r"can be written; got .*x\.h5 \(Permission"),
        locked("store", stored),
    ):
        pass
