"""The kernel cache holds code: only the user may write to its folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import pytest

from dynkit.core import jit
from dynkit.core.jit import cache_folder, kernel

SETTINGS: Any = numba.config


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cache_folder.cache_clear()
    yield tmp_path
    cache_folder.cache_clear()


def again() -> Path:
    cache_folder.cache_clear()
    return cache_folder()


def test_the_folder_is_the_users_alone(base: Path) -> None:
    folder = again()
    assert folder.is_relative_to(base)
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o702, 0o720])
def test_a_folder_that_others_may_write_to_is_not_used(base: Path, mode: int) -> None:
    folder = again()
    folder.chmod(mode)
    other = again()
    assert not other.is_relative_to(base)
    assert other.stat().st_mode & 0o077 == 0
    other.rmdir()


def test_a_folder_of_somebody_else_is_not_used(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = again()
    monkeypatch.setattr("os.geteuid", lambda: folder.stat().st_uid + 1)
    other = again()
    assert other != folder
    other.rmdir()


def test_a_file_in_its_place_is_not_used(base: Path) -> None:
    (base / "dynkit").write_text("mine")
    other = again()
    assert not other.is_relative_to(base)
    other.rmdir()


def test_another_version_of_numba_has_another_folder(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = again()
    monkeypatch.setattr(numba, "__version__", "0.1")
    assert again() != folder


@kernel()
def doubled(count: int, by: float) -> float:
    return count * by


def sum_of_doubled(count: int) -> float:
    return doubled(2, 1.0) + doubled(3, 2.0) + doubled(count, 3.0)


@pytest.mark.skipif(SETTINGS.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_is_compiled_once_for_all_integers_and_for_kernels_only() -> None:
    caller: Any = numba.njit(sum_of_doubled)  # not from a cache: what it calls is compiled here
    assert caller(4) == 2.0 + 6.0 + 12.0
    compiled: Any = doubled
    assert len(compiled.overloads) == 1
    with pytest.raises(TypeError, match="doubled is called by kernels only"):
        doubled(2, 1.0)


def test_an_edit_of_any_kernel_makes_another_folder(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = Path(jit.__file__).resolve().parents[1]
    files = {
        file for part in ("", "systems", "analysis") for file in (package / part).rglob("*.py")
    }
    with_kernels = [file.resolve() for file in files if "@kernel(" in file.read_text()]
    assert len(with_kernels) > 15
    read = Path.read_bytes
    before = again()
    for edited in with_kernels:
        with monkeypatch.context() as patch:
            patch.setattr(
                Path, "read_bytes", lambda path, e=edited: read(path) + b"#" * (path == e)
            )
            assert again() != before
