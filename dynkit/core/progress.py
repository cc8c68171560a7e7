"""Progress of long computations, on a terminal."""

from __future__ import annotations

import sys
from typing import Any

# Seconds after which a bar appears, and seconds between two updates.
_QUIET, _OFTEN = 2.0, 0.1


def late_bar(what: str, unit: str, total: int | None = None, of: Any = None) -> Any:
    """Return a progress bar of tqdm on standard error, which shows only on a terminal.

    It appears after two seconds, and is removed at the end. It counts the items of `of`, if given.
    """
    from tqdm import tqdm

    how: dict[str, Any] = {"delay": _QUIET, "mininterval": _OFTEN, "leave": False, "disable": None}
    return tqdm(of, desc=what, unit=f" {unit}", total=total, file=sys.stderr, **how)
