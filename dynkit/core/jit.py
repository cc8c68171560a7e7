"""Compilation of the numerical kernels, with a cache folder for each state of their sources.

Numba's own file cache notices an edit to the file of a compiled function, but not an edit to a
function of another file that it calls. The cache folder is therefore named after a hash of every
kernel source of the package.

The cache holds machine code and an index that Python's pickle reads, and a pickle can run any code.
So the folder must belong to the user and nobody else may write to it; otherwise a temporary folder
replaces it. Nothing else that dynkit reads is code.
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
from types import SimpleNamespace
from typing import Any, TypeVar

from dynkit.core.compile_notice import announce

_Function = TypeVar("_Function", bound=Callable[..., Any])

FUSED = {"contract"}
"""Fast-math flags that allow fused multiply-add operations."""

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
    """Return whether this user, and nobody else, can write to the folder; create it if missing."""
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
def _announced() -> None:
    """Announce long compilations of this process."""
    announce(cache_folder())


@cache
def _inner() -> tuple[Any, Any]:
    """Return dispatcher and compiler classes of kernels that only other kernels call.

    Numba would compile a function again for every integer constant that is passed to it. These
    kernels are compiled once for all integers, unless `constants` is true.

    Numba would also optimise each of them, with all that it calls, and make machine code of it.
    Their code is linked into that of the kernels that Python calls, which is optimised as a whole:
    without a pass of their own a first simulation compiles in four fifths of the time.
    """
    from numba.core import codegen, compiler, types
    from numba.core.registry import CPUDispatcher

    library: Any = codegen.JITCodeLibrary
    pipeline: Any = compiler.Compiler

    class Linked(library):  # type: ignore[misc]
        codegen = SimpleNamespace(set_env=lambda *_: None)

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, _: str) -> int:
            self._ensure_finalized()
            return 0

    class Linking(pipeline):  # type: ignore[misc]
        def __init__(self, typing: Any, target: Any, _: Any, *rest: Any) -> None:
            super().__init__(typing, target, Linked(target.codegen(), "inner"), *rest)

    class Inner(CPUDispatcher):
        constants = False

        def __call__(self, *_: object) -> object:
            name = self.py_func.__name__
            raise TypeError(f"{name} is called by kernels only; got a call from Python")

        def get_call_template(self, args: Any, kws: Any) -> Any:
            if not self.constants:
                args = tuple(map(types.unliteral, args))
            return super().get_call_template(args, kws)

    return Inner, Linking


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

    With ``NUMBA_DISABLE_JIT=1`` in the environment the function remains plain Python, which is
    about a hundred times slower.

    Parameters
    ----------
    entry
        Python may call the kernel. The wrapper that converts Python's arguments takes a fifth of
        the compilation time.
    reorder
        The compiler may reorder the sums of this function and use fused multiply-add operations.
        Never for double-double arithmetic.
    fuse
        The compiler may use fused multiply-add operations, in the order given.
    inline
        The kernel is inlined into its callers.
    constants
        The kernel is compiled for each set of integer constants that is passed to it: inner loops
        that start at a known zero are a fifth faster.
    nogil
        A call from Python releases the interpreter lock: only where no two calls share a buffer
        that they modify.
    """
    import numba
    import numpy as np

    # Numba's reference counting takes longer than the loops over a few terms. Without it kernels
    # cannot allocate arrays: they work in the buffers that are passed to them.
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
        if settings.DISABLE_JIT:  # the same arithmetic: a division by zero gives infinity
            plain: _Function = np.errstate(all="ignore")(function)
            return plain
        _announced()
        inner, linking = _inner()
        if not entry:
            options["pipeline_class"] = linking
        previous = settings.CACHE_DIR
        settings.CACHE_DIR = str(cache_folder())
        try:
            compiled: Any = numba.njit(**options)(function)
        finally:
            settings.CACHE_DIR = previous
        if not entry:
            compiled.__class__ = inner
            compiled.constants = constants
        found: _Function = compiled
        return found

    return decorate
