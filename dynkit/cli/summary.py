"""What is printed when a run is done."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynkit.core.validation import Array


def print_summary(shown: Mapping[str, str], file: Path | None) -> None:
    """Print two columns, and the file that was written."""
    lines = {**shown, **({} if file is None else {"written": str(file)})}
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name:<{width}}  {text}")


def sizes(numbers: Array) -> str:
    """Return the smallest and the largest number, or that there are none.

    Examples
    --------
    >>> import numpy as np
    >>> sizes(np.array([0.25, 1.0, np.nan]))
    '0.25 to 1'
    """
    import numpy as np

    there = numbers[~np.isnan(numbers)]
    return f"{there.min():.6g} to {there.max():.6g}" if there.size else "none"
