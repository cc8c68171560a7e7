"""Error against run time of dynkit and its peers.

``python -m tests.benchmarks.work_precision``, from the folder of the repository.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TextIO

from dynkit.analysis import ImpactMethod, WorkPrecision
from dynkit.analysis.work_precision.measuring import Measurement
from dynkit.analysis.work_precision.tables import head, line
from dynkit.cli.output import write_picture, write_table
from tests.benchmarks.peers import all_methods
from tests.benchmarks.programs import output, write_text
from tests.benchmarks.work_precision.jobs import JOBS, standard_jobs
from tests.benchmarks.work_precision.notes import NOTES

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
    file, chosen = checked(out, only, methods)
    measured = WorkPrecision(standard_jobs(only), chosen)
    for text in head(measured):
        print(text, file=log)
    for one in measured:
        print(line(measured, one), file=log, flush=True)
    print(f"\n{NOTES}", file=log)
    if file is not None:
        _write(file, measured)
        print(f"written: {file}", file=log)


def checked(
    out: str | None, only: Sequence[str] | None, methods: Sequence[str] | None
) -> tuple[Path | None, list[ImpactMethod]]:
    """Return the file to write, if any, and the methods.

    Raises
    ------
    ValueError
        As `work_precision`.
    """
    for name in only or ():
        if name not in JOBS:
            raise ValueError(f"only must hold jobs among {', '.join(JOBS)}; got {name!r}")
    chosen = all_methods(methods)
    return None if out is None else output(out, ENDINGS), chosen


def _write(file: Path, measured: WorkPrecision) -> None:
    if file.suffix in (".png", ".svg"):
        write_picture(file, measured.figure)
    elif file.suffix == ".csv":
        write_table(file, _columns(measured))
    else:
        text = f"# Error against run time\n\n{measured.table()}\n\n{NOTES}"
        write_text(file, text)


def _columns(measured: WorkPrecision) -> dict[str, list[object]]:
    """What every measurement holds, column by column."""
    rows = measured.measurements
    names = [field.name for field in fields(Measurement) if field.name != "work"]
    columns: dict[str, list[object]] = {name: [getattr(x, name) for x in rows] for name in names}
    counted = [next(iter(one.work.items()), ("", 0)) for one in rows]
    return {**columns, "work": [count for _, count in counted], "unit": [x for x, _ in counted]}
