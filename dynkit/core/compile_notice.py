"""One line on a terminal while kernels are compiled for longer than a second.

During compilation no garbage is collected: Numba makes millions of objects, and the collector's
repeated searches take a tenth of the time.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_QUIET = 1.0
"""Seconds of compilation without a notice."""


@dataclass
class Notice:
    """The line of text about compilations.

    Compilations are nested: that of a kernel begins before those of the kernels that it calls.

    Parameters
    ----------
    folder : Path
        Folder of the compiled kernels.
    clock : callable
        Function that returns the time in seconds.
    """

    folder: Path
    clock: Callable[[], float] = time.perf_counter
    _depth: int = 0
    _since: float = 0.0
    _shown: bool = False
    _collects: bool = False

    def begin(self) -> None:
        """Record that a compilation begins."""
        if not self._depth:
            self._since = self.clock()
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1
        long = self.clock() - self._since > _QUIET
        if long and not self._shown and sys.stderr is not None and sys.stderr.isatty():
            self._shown = True
            text = f"dynkit compiles kernels, once (5 to 30 s), into {self.folder} ..."
            sys.stderr.write(text)
            sys.stderr.flush()

    def end(self) -> None:
        """Record that a compilation has ended."""
        self._depth -= 1
        if self._collects and not self._depth:
            gc.enable()
        if self._shown and not self._depth:
            self._shown = False
            sys.stderr.write(f" done in {self.clock() - self._since:.0f} s\n")


def announce(folder: Path) -> None:
    """Show the notice for all compilations of dynkit's kernels in this process."""
    from numba.core import event

    notice = Notice(folder)

    class Compilations(event.Listener):
        def on_start(self, event: Any) -> None:
            if _is_ours(event):
                notice.begin()

        def on_end(self, event: Any) -> None:
            if _is_ours(event):
                notice.end()

    register: Any = event.register
    register("numba:compile", Compilations())


def _is_ours(event: Any) -> bool:
    """Whether the compiled function is a kernel of dynkit, and not one of the user."""
    return str(event.data["dispatcher"].py_func.__module__).startswith("dynkit.")
