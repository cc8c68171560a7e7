"""Compilation of the numerical kernels, with a cache folder for each state of their sources.

Numba's own file cache notices an edit to the file of a compiled function, but not an edit to a
function of another file that it calls. The cache folder is therefore named after a hash of every
kernel source of the package.

That cache is Numba's own: machine code, and an index of it that Python's pickle reads, which runs
whatever code its file asks for. So the folder must belong to the user, and nobody else may write
to it; where that is not so, another one serves. Nothing else that dynkit reads is code.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

_Function = TypeVar("_Function", bound=Callable[..., Any])

FUSED = {"contract"}
"""Fast-math flags of products that are added without being rounded."""

REORDERED = {"reassoc", "contract", "nsz"}
"""Fast-math flags of sums whose error bound holds for any order of the terms."""


def _user_cache() -> Path:
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(configured)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _private(folder: Path) -> bool:
    """Whether it can be written to, by this user only; made when it is missing."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        if sys.platform == "win32":  # a user's own folders are closed to others there
            return True
        found = folder.stat()
    except OSError:
        return False
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _kernel_sources() -> list[Path]:
    package = Path(__file__).resolve().parents[1]
    return sorted(
        {
            source.resolve()
            for folder in (package, package / "systems", package / "analysis")
            for source in folder.rglob("*kernels.py")
        }
        | {Path(__file__).resolve()}
    )


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels, named after a hash of their sources and Numba's version.

    The base is ``NUMBA_CACHE_DIR`` where it is set, otherwise the user's cache folder. Where others
    may write to that folder, or the user may not, it is a temporary folder of this process.
    """
    import numba

    # versions of Numba would overwrite each other's index
    digest = hashlib.sha256(numba.__version__.encode())
    for source in _kernel_sources():
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    folder = _user_cache() / "dynkit" / f"kernels-{digest.hexdigest()[:16]}"
    return folder if _private(folder) else Path(tempfile.mkdtemp(prefix="dynkit-kernels-"))


@cache
def _inner() -> Any:
    """The class of kernels that only kernels call.

    Numba compiles a function once more for every integer constant that it is called with; these are
    compiled once for all integers, unless `constants` says otherwise.
    """
    from numba.core import types
    from numba.core.registry import CPUDispatcher

    class Inner(CPUDispatcher):
        constants = False

        def __call__(self, *_: object) -> object:
            name = self.py_func.__name__
            raise TypeError(f"{name} is called by kernels only; got a call from Python")

        def get_call_template(self, args: Any, kws: Any) -> Any:
            if not self.constants:
                args = tuple(map(types.unliteral, args))
            return super().get_call_template(args, kws)

    return Inner


def kernel(
    *,
    entry: bool = False,
    reorder: bool = False,
    fuse: bool = False,
    inline: bool = False,
    constants: bool = False,
    nogil: bool = False,
) -> Callable[[_Function], _Function]:
    """Compile a kernel on its first call and keep the machine code in `cache_folder`.

    With ``NUMBA_DISABLE_JIT=1`` in the environment it stays what it is, some hundred times slower.

    Parameters
    ----------
    entry
        Python calls it, too. What turns Python's arguments into those of machine code is a fifth of
        the time that compilation takes.
    reorder
        The sums of this function may be taken in any order and contracted to fused operations.
        Never for double-double arithmetic.
    fuse
        Products may be added without being rounded, in the order given.
    inline
        Compiled into its callers.
    constants
        Compiled for each set of integer constants that it is called with: for inner loops, which
        are a fifth faster where they are known to begin at zero.
    nogil
        Other threads run during a call from Python: only where no two calls share a buffer that
        they modify.
    """
    import numba
    import numpy as np

    # The runtime's reference counting takes longer than the loops over a few slots; without it
    # kernels cannot allocate, so they work in the buffers that they are given.
    options: dict[str, Any] = {
        "cache": entry,
        "no_cpython_wrapper": not entry,
        "no_cfunc_wrapper": True,
        "error_model": "numpy",
        "fastmath": REORDERED if reorder else FUSED if fuse else False,
        "forceinline": inline,
        "nogil": nogil,
        "_nrt": False,
    }
    settings: Any = numba.config

    def decorate(function: _Function) -> _Function:
        if settings.DISABLE_JIT:  # the same arithmetic: what is divided by zero is infinite
            plain: _Function = np.errstate(all="ignore")(function)
            return plain
        previous = settings.CACHE_DIR
        settings.CACHE_DIR = str(cache_folder())
        try:
            compiled: Any = numba.njit(**options)(function)
        finally:
            settings.CACHE_DIR = previous
        if not entry:
            compiled.__class__ = _inner()
            compiled.constants = constants
        found: _Function = compiled
        return found

    return decorate
