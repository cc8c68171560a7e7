"""Labels of many motions as columns of numbers, which a store keeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dynkit.labels.label import OrbitKind, OrbitLabel

COLUMNS: dict[str, tuple[str, tuple[int | None, ...]]]
COLUMNS = {"kind": ("i", ()), "numbers": ("i", (3,)), "sizes": ("f", (5,))}
"""What `empty_columns` returns: kinds of numbers, and the shape of a row."""

KINDS = tuple(OrbitKind)
"""What the numbers of kinds mean, where there is a motion."""


def empty_columns(count: int, kind: int) -> dict[str, Any]:
    """Return the columns of so many motions, all of one number of kind, for `put_label`."""
    return {
        "kind": np.full(count, kind, dtype=np.int64),
        "numbers": np.zeros((count, 3), dtype=np.int64),  # n, m, simulated
        # tolerance, recurrence, chance, multiplier and its error
        "sizes": np.full((count, 5), np.nan),
    }


def put_label(columns: Mapping[str, Any], place: int, label: OrbitLabel) -> None:
    """Write a label into its place of the columns, in place."""
    columns["kind"][place] = KINDS.index(label.kind)
    columns["numbers"][place] = label.iterates or 0, label.periods or 0, label.simulated
    sizes = label.tolerance, label.recurrence, label.chance
    columns["sizes"][place] = *sizes, label.multiplier, label.multiplier_error


def label_in(columns: Mapping[str, Any], place: int, kind: OrbitKind) -> OrbitLabel:
    """Return the label of a kind that a place of the columns holds, with its stability."""
    n, m, simulated = columns["numbers"][place].tolist()
    tolerance, recurrence, chance, *stability = columns["sizes"][place].tolist()
    multiplier, multiplier_error = stability
    return OrbitLabel(
        kind,
        n or None,
        m or None,
        tolerance,
        recurrence,
        simulated,
        chance=chance,
        multiplier=multiplier,
        multiplier_error=multiplier_error,
    )
