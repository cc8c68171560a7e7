"""Labels of many motions as columns of numbers, which a store keeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dynkit.labels.label import OrbitKind, OrbitLabel

COLUMNS: dict[str, tuple[str, tuple[int | None, ...]]]
COLUMNS = {"kind": ("i", ()), "numbers": ("i", (4,)), "sizes": ("f", (7,))}
"""Columns that `empty_columns` returns: kind of the numbers, and shape of a row."""

KINDS = tuple(OrbitKind)
"""The kind of orbit for each number in the column of kinds, where there is a motion."""


def empty_columns(count: int, kind: int) -> dict[str, Any]:
    """Return the columns of `count` motions, all with the same number of kind, for `put_label`."""
    return {
        "kind": np.full(count, kind, dtype=np.int64),
        "numbers": np.zeros((count, 4), dtype=np.int64),  # n and m of P(n,m), simulated, curves
        # tolerance, recurrence, chance; multiplier and rotation number, each with its error
        "sizes": np.full((count, 7), np.nan),
    }


def put_label(columns: Mapping[str, Any], place: int, label: OrbitLabel) -> None:
    """Write a label into row `place` of the columns, in place."""
    columns["kind"][place] = KINDS.index(label.kind)
    counts = label.iterates or 0, label.periods or 0, label.simulated, label.curves
    columns["numbers"][place] = counts
    sizes = label.tolerance, label.recurrence, label.chance, label.multiplier
    rotation = label.rotation_number, label.rotation_error
    columns["sizes"][place] = *sizes, label.multiplier_error, *rotation


def label_in(columns: Mapping[str, Any], place: int, kind: OrbitKind) -> OrbitLabel:
    """Return the label of this kind in row `place` of the columns, with its stability."""
    n, m, simulated, curves = columns["numbers"][place].tolist()
    tolerance, recurrence, chance, *others = columns["sizes"][place].tolist()
    multiplier, multiplier_error, rotation_number, rotation_error = others
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
        rotation_number=rotation_number,
        rotation_error=rotation_error,
        curves=curves,
    )
