"""`dynkit reproduce`: the table and the figures of Cusumano & Bai (1993), and a report on them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from dynkit.cli.output import output_folder
from dynkit.cli.reproduce.paper import ITEMS


def reproduce(out: str, only: Sequence[str] | None = None, *, log: TextIO) -> Path:
    """Make the items, their figures as PNG and SVG, and ``report.md``.

    Parameters
    ----------
    out : str
        Folder to write to, made when it is missing.
    only : sequence of str, optional
        Some of the items, by name; by default all.
    log : TextIO
        Where a line goes for each item that is done.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    ValueError
        When an item is unknown or the folder cannot be written to.
    """
    for name in only or ():
        if name not in ITEMS:
            raise ValueError(f"only must hold items among {', '.join(ITEMS)}; got {name!r}")
    folder = output_folder("out", out)

    import time

    from dynkit.cli.reproduce.items import MAKERS
    from dynkit.cli.reproduce.report import write_report
    from dynkit.cli.reproduce.workshop import Workshop

    began = time.perf_counter()
    workshop = Workshop(folder)
    print("compiling or loading the kernels: ", end="", file=log, flush=True)
    print(f"{workshop.warm_up():.1f} s", file=log, flush=True)
    sections = []
    for name in ITEMS:
        if only is None or name in only:
            print(f"{name}: ", end="", file=log, flush=True)
            section = MAKERS[name](workshop)
            print(f"{section.total:.1f} s", file=log, flush=True)
            sections.append(section)
    seconds = time.perf_counter() - began
    report = write_report(folder / "report.md", sections, workshop.warm_up(), seconds)
    print(f"written: {report} ({seconds:.1f} s in all)", file=log)
    return report
