"""Markdown tables, and what is measured for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from time import process_time

from dynkit.core.validation import Array

_REPEATS, _ENOUGH = 200, 0.2
"""Repetitions at most, and seconds after which there are no more."""


def table(title: str, head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table under a title."""
    cells = [[str(cell) for cell in row] for row in rows]
    print(f"\n### {title}\n")
    print("| " + " | ".join(head) + " |")
    print("| " + " | ".join("---" for _ in head) + " |")
    for row in cells:
        print("| " + " | ".join(row) + " |")


def measured(run: Callable[[], Array]) -> tuple[Array, float]:
    """Return the end of a run, and the least seconds of the processor of several repetitions."""
    found, best, spent = run(), math.inf, 0.0  # the first run may include compilation
    for _ in range(_REPEATS):
        began = process_time()
        run()
        seconds = process_time() - began
        best, spent = min(best, seconds), spent + seconds
        if spent > _ENOUGH:
            break
    return found, best
