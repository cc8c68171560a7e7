"""Error against run time of dynkit and its peers.

``python -m tests.benchmarks.work_precision``, from the folder of the repository.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from dynkit.analysis import ImpactMethod, WorkPrecision
from dynkit.plotting.figures import PICTURES, write_figure
from tests.benchmarks.peers import all_methods
from tests.benchmarks.programs import output, write_text
from tests.benchmarks.work_precision.jobs import JOBS, standard_jobs
from tests.benchmarks.work_precision.notes import NOTES

ENDINGS = (".csv", ".md", *PICTURES)


def work_precision(
    out: str | None = None,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    *,
    log: TextIO,
) -> WorkPrecision:
    """Measure and print, line by line, what each method makes of each job.

    Parameters
    ----------
    out : str, optional
        File to write as well: the table as .csv or .md, or the figure as .png, .svg or .pdf.
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
    for text in measured.lines():
        print(text, file=log, flush=True)
    print(f"\n{NOTES}", file=log)
    if file is not None:
        _write(file, measured)
        print(f"written: {file}", file=log)
    return measured


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
    if file.suffix in PICTURES:
        write_figure("out", file, measured.figure())
    elif file.suffix == ".csv":
        measured.export(file)
    else:
        text = f"# Error against run time\n\n{measured.table()}\n\n{NOTES}"
        write_text(file, text)
