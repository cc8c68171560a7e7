"""Progress of long computations, on a terminal."""

from __future__ import annotations

import sys
from typing import Any

# Seconds after which a bar appears, and between two looks of it.
_QUIET, _OFTEN = 2.0, 0.1


def late_bar(what: str, unit: str, total: int | None = None, of: Any = None) -> Any:
    """Return a bar of tqdm on standard error, where this is a terminal; it may count an iterable.

    It appears after two seconds, and is removed at the end.
    """
    from tqdm import tqdm

    how: dict[str, Any] = {"delay": _QUIET, "mininterval": _OFTEN, "leave": False, "disable": None}
    return tqdm(of, desc=what, unit=f" {unit}", total=total, file=sys.stderr, **how)
