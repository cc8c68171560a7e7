"""`dynkit work-precision`: error against run time, beside other methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from dynkit.cli.output import writable_file, write_picture, write_table, write_text
from dynkit.cli.work_precision.jobs import JOBS, standard_jobs

if TYPE_CHECKING:
    from dynkit.analysis.work_precision.measuring import WorkPrecision

ENDINGS = (".csv", ".md", ".png", ".svg")


def work_precision(
    out: str | None = None,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    *,
    log: TextIO,
) -> None:
    """Measure and print, line by line, what each method makes of each job.

    Parameters
    ----------
    out : str, optional
        File to write as well: the table as .csv or .md, or the figure as .png or .svg.
    only : sequence of str, optional
        Some of the jobs, by name; by default all.
    methods : sequence of str, optional
        Some of the methods, by name; by default all.
    log : TextIO
        Where the table goes.

    Raises
    ------
    ValueError
        When a job or a method is unknown, or the file cannot be written.
    """
    for name in only or ():
        if name not in JOBS:
            raise ValueError(f"only must hold jobs among {', '.join(JOBS)}; got {name!r}")
    from dynkit.analysis.work_precision.measuring import WorkPrecision
    from dynkit.analysis.work_precision.peers import impact_methods
    from dynkit.analysis.work_precision.tables import NOTES, head, line

    chosen = impact_methods(methods)
    file = None if out is None else _output(out)
    measured = WorkPrecision(standard_jobs(only), chosen)
    for text in head(measured):
        print(text, file=log)
    for one in measured:
        print(line(measured, one), file=log, flush=True)
    print(f"\n{NOTES}", file=log)
    if file is not None:
        _write(file, measured)
        print(f"written: {file}", file=log)


def _output(out: str) -> Path:
    path = Path(out)
    if path.suffix not in ENDINGS:
        raise ValueError(f"out must end in {', '.join(ENDINGS)}; got {out!r}")
    return writable_file("out", path)


def _write(file: Path, measured: WorkPrecision) -> None:
    from dynkit.analysis.work_precision.tables import NOTES

    if file.suffix in (".png", ".svg"):
        write_picture(file, measured.figure)
    elif file.suffix == ".csv":
        write_table(file, _columns(measured))
    else:
        text = f"# Error against run time\n\n{measured.table()}\n\n{NOTES}"
        write_text(file, text)


def _columns(measured: WorkPrecision) -> dict[str, list[object]]:
    """What every measurement holds, column by column."""
    from dynkit.analysis.work_precision.measuring import Measurement

    rows = measured.measurements
    names = [field.name for field in fields(Measurement) if field.name != "work"]
    columns: dict[str, list[object]] = {name: [getattr(x, name) for x in rows] for name in names}
    counted = [next(iter(one.work.items()), ("", 0)) for one in rows]
    return {**columns, "work": [count for _, count in counted], "unit": [x for x, _ in counted]}
