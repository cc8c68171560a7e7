"""How much of the package a sweep of a small map runs."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

import dynkit
from dynkit import Map, sweep
from dynkit.core.validation import Array

_PACKAGE = Path(dynkit.__file__).resolve().parents[1]
_FOLDERS = tuple(str(_PACKAGE / name) for name in ("dynkit", "systems", "analysis"))


class Quadratic(Map):
    """A map of three lines."""

    rate: float = 3.2
    dimension = 1

    def __call__(self, state: Array) -> Array:
        return self.rate * state * (1.0 - state)


def entered(run: Callable[[], object]) -> set[tuple[str, str]]:
    """Return the files and names of the package's functions that a second run enters."""
    run()  # imports, and what is found once for a class
    found = set()

    def look(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        file = str(Path(code.co_filename).resolve())
        # a comprehension is a function in older versions of Python only
        if event == "call" and file.startswith(_FOLDERS) and "comp>" not in code.co_name:
            found.add((file, code.co_qualname))

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(before)
    return {pair for pair in found if not pair[1].endswith("<genexpr>")}


@pytest.mark.parametrize(("follow", "files", "functions"), [(False, 12, 70), (True, 18, 132)])
def test_a_stored_sweep_of_a_small_map_enters_few_functions(
    follow: bool, files: int, functions: int, tmp_path: Path
) -> None:
    store, rates = tmp_path / "x.h5", np.linspace(2.9, 3.9, 21)
    options: dict[str, Any] = {"start": [0.3], "transient": 100, "keep": 50, "progress": False}

    def run() -> None:
        store.unlink(missing_ok=True)
        sweep(Quadratic(), "rate", rates, follow=follow, store=store, **options)

    found = entered(run)
    assert len({file for file, _ in found}) <= files
    assert len(found) <= functions
