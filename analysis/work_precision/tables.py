"""The table of error against run time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from dynkit.analysis.work_precision.methods import ImpactMethod

if TYPE_CHECKING:
    from dynkit.analysis.work_precision.measuring import Measurement, WorkPrecision

COLUMNS = ("job", "method", "tolerance", "error", "seconds", "work", "missed", "invented", "remark")


def head(measured: WorkPrecision) -> list[str]:
    """Return the two lines above the table."""
    widths = _widths(list(measured.jobs), measured.methods)
    return [_row(COLUMNS, widths), _row(["-" * width for width in widths], widths)]


def line(measured: WorkPrecision, one: Measurement) -> str:
    """Return the line of one measurement."""
    return _row(_cells(one), _widths(list(measured.jobs), measured.methods))


def _widths(jobs: list[str], methods: tuple[ImpactMethod, ...]) -> tuple[int, ...]:
    longest = max(map(len, ["job", *jobs])), max(len(x) for x in ["method", *_names(methods)])
    return (*longest, 9, 8, 8, 19, 6, 8, 6)


def _names(methods: tuple[ImpactMethod, ...]) -> list[str]:
    return [method.name for method in methods]


def _cells(one: Measurement) -> list[str]:
    ran = one.starts > 0
    work = next(iter(one.work.items()), None)
    return [
        one.job,
        one.method,
        "-" if not one.tolerance > 0.0 else f"{one.tolerance:.0e}",
        _number(one.error),
        _number(one.seconds),
        "-" if work is None else f"{work[1]} {work[0]}",
        str(one.missed) if ran else "-",
        str(one.invented) if ran else "-",
        one.remark,
    ]


def _number(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.1e}"


def _row(cells: object, widths: tuple[int, ...]) -> str:
    assert isinstance(cells, list | tuple)
    padded = [f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)]
    return f"| {' | '.join(padded)} |"
