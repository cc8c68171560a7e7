"""A long compilation says so in one line on a terminal."""

from __future__ import annotations

import gc
import io
from collections.abc import Sequence
from pathlib import Path

import pytest

from dynkit.core.jit import Notice

FOLDER = Path("cache")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, times: Sequence[float]) -> str:
    """What a kernel writes whose inner kernels begin at times; it begins at 0, and ends last."""
    now = iter([0.0, 0.0, *times])
    monkeypatch.setattr("sys.stderr", stream)
    notice = Notice(FOLDER, clock=lambda: next(now))
    notice.begin()
    for _ in times[:-1]:
        notice.begin()
        notice.end()
    notice.end()
    return stream.getvalue()


def test_a_long_compilation_says_where_and_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal(), [0.5, 1.5, 9.0, 18.2])
    assert text == "dynkit compiles kernels, once (5 to 30 s), into cache ... done in 18 s\n"


def test_a_short_compilation_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not shown(monkeypatch, Terminal(), [0.2, 0.4, 0.9])


def test_a_file_gets_no_notice(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not shown(monkeypatch, io.StringIO(), [0.5, 1.5, 9.0, 18.2])


@pytest.mark.parametrize("collects", [True, False])
def test_no_garbage_is_collected_meanwhile(monkeypatch: pytest.MonkeyPatch, collects: bool) -> None:
    monkeypatch.setattr("sys.stderr", io.StringIO())
    notice = Notice(FOLDER)
    try:
        if not collects:
            gc.disable()
        for step in (notice.begin, notice.begin, notice.end):
            step()
            assert not gc.isenabled()
        notice.end()
        assert gc.isenabled() == collects
    finally:
        gc.enable()
