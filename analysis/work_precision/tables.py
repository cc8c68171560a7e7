"""The table of error against run time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from dynkit.analysis.work_precision.measurement import Measurement

_COLUMNS = {
    "job": 3, "method": 6, "tolerance": 9, "error": 9, "seconds": 8, "work": 19, "missed": 6,
    "invented": 8, "remark": 6,
}  # fmt: skip
"""Names of columns, and their least widths."""


def table_lines(
    jobs: Sequence[str], methods: Sequence[str], measured: Iterable[Measurement]
) -> Iterator[str]:
    """Yield the lines of a table in Markdown, each as soon as it is measured."""
    widths = {**_COLUMNS}
    for name, texts in (("job", jobs), ("method", methods)):
        widths[name] = max([widths[name], *map(len, texts)])

    def row(cells: Iterable[str]) -> str:
        return f"| {' | '.join(map(str.ljust, cells, widths.values()))} |"

    yield row(widths)
    yield row("-" * width for width in widths.values())
    for one in measured:
        yield row(cells(one).values())


def cells(one: Measurement) -> dict[str, str]:
    """Return the texts of a measurement in a table, by the names of the columns."""
    ran = one.starts > 0
    work = next((f"{count} {name}" for name, count in one.work.items()), "-")
    texts = (
        one.job,
        one.method,
        f"{one.tolerance:.0e}" if one.tolerance > 0.0 else "-",
        one.known_error,
        "-" if math.isnan(one.seconds) else f"{one.seconds:.1e}",
        work,
        str(one.missed) if ran else "-",
        str(one.invented) if ran else "-",
        one.remark,
    )
    return dict(zip(_COLUMNS, texts, strict=True))
