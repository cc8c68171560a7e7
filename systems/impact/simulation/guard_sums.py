"""Exponential sums of guards at the start of a motion: their values, and disturbed offsets."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.validation import Array


def value_and_rate(gap: Any, state: Array) -> tuple[float, float, float]:
    """Value of an exponential sum at a state (2, slots), its rate, and the sum of its |terms|."""
    terms = gap.rows[:4] * np.vstack([state, state])[:, : gap.rows.shape[1]]
    size = float(abs(terms[:2]).sum() + abs(gap.offset))
    return float(terms[:2].sum() + gap.offset), float(terms[2:4].sum()), size


def displaced(tables: Any, terms: Array, parts: Array) -> Any:
    """The same tables with disturbed offsets of guards, relative to the terms of their sums.

    If the structure at rest almost exactly touches the table, these offsets are rounding errors.
    """
    from dynkit.exponential.stack_kernels import OFFSET

    if not terms.any():
        return tables
    numbers = tables.ladders.numbers.copy()
    numbers[:, OFFSET] += parts[tables.element, np.minimum(tables.event, 1)] * terms
    return tables._replace(ladders=tables.ladders._replace(numbers=numbers))
