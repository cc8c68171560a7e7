"""`dynkit extremes`: impact oscillators at the edges of double precision, against exact values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from dynkit.cli.extremes.cases import GROUPS, read_cases
from dynkit.cli.output import CommandFailed, writable_file, write_text


def extremes(out: str | None = None, only: Sequence[str] | None = None, *, log: TextIO) -> None:
    """Simulate the cases and print, for each, its true error beside the one that is claimed.

    Parameters
    ----------
    out : str, optional
        Markdown file to write as well.
    only : sequence of str, optional
        Some of the groups, by name; by default all.
    log : TextIO
        Where the table goes.

    Raises
    ------
    ValueError
        When a group is unknown or the file cannot be written.
    CommandFailed
        When a case is off by more than it claims, or ends otherwise than it should.
    """
    for name in only or ():
        if name not in GROUPS:
            raise ValueError(f"only must hold groups among {', '.join(GROUPS)}; got {name!r}")
    file = None if out is None else _markdown(out)

    from dynkit.cli.extremes.measures import measure
    from dynkit.cli.extremes.table import head, line, markdown, summary

    print(head(), file=log)
    outcomes = []
    for case in read_cases():
        if only is None or case.group in only:
            outcomes.append(measure(case))
            print(line(outcomes[-1]), file=log, flush=True)
    print(summary(outcomes), file=log)
    if file is not None:
        write_text(file, markdown(outcomes))
        print(f"written: {file}", file=log)
    wrong = [outcome.case.name for outcome in outcomes if not outcome.right]
    if wrong:
        raise CommandFailed(f"{len(wrong)} of {len(outcomes)} cases are wrong: {', '.join(wrong)}")


def _markdown(out: str) -> Path:
    path = Path(out)
    if path.suffix != ".md":
        raise ValueError(f"out must end in .md; got {out!r}")
    return writable_file("out", path)
