"""Impact oscillators at the edges of double precision, against exact values.

``python -m tests.benchmarks.extremes``, from the folder of the repository.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from tests.benchmarks.extremes.cases import GROUPS, read_cases
from tests.benchmarks.extremes.measures import Outcome, measure
from tests.benchmarks.extremes.table import head, line, markdown, summary
from tests.benchmarks.programs import output, write_text


class WrongCases(RuntimeError):
    """Cases are off by more than they claim, or end otherwise than they should."""


def extremes(
    out: str | None = None, only: Sequence[str] | None = None, *, log: TextIO
) -> list[Outcome]:
    """Simulate the cases and print, for each, its actual error beside the estimate.

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
    WrongCases
        When a case is off by more than it claims, or ends otherwise than it should.
    """
    file = checked(out, only)
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
        raise WrongCases(f"{len(wrong)} of {len(outcomes)} cases are wrong: {', '.join(wrong)}")
    return outcomes


def checked(out: str | None, only: Sequence[str] | None) -> Path | None:
    """Return the file to write, if any.

    Raises
    ------
    ValueError
        As `extremes`.
    """
    for name in only or ():
        if name not in GROUPS:
            raise ValueError(f"only must hold groups among {', '.join(GROUPS)}; got {name!r}")
    return None if out is None else output(out, (".md",))
