"""Parts of the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

LOOKED_INTO = "Statements of the paper looked into"
"""Title of the section that others refer to."""


@dataclass(frozen=True)
class Finding:
    """One line of the report's summary: what the paper says, and what was found.

    Parameters
    ----------
    what : str
    paper : str
    found : str
    error : str
        Estimate of the error of what was found.
    agrees : bool or None
        Whether both are the same; None where the paper gives nothing that can be compared.
    """

    what: str
    paper: str
    found: str
    error: str
    agrees: bool | None = None


@dataclass(frozen=True)
class Section:
    """One item of the report.

    Parameters
    ----------
    item : str
    title : str
    text : str
        Markdown.
    findings : sequence of Finding
    figures : sequence of str
        Names of the figures' files, without endings.
    seconds : mapping of str to float
        What each part of the work took.
    page : str
        Name of a page beside the report, with the same figure to move through; or empty.
    """

    item: str
    title: str
    text: str
    findings: Sequence[Finding]
    figures: Sequence[str] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    page: str = ""

    @property
    def total(self) -> float:
        """Seconds in all."""
        return sum(self.seconds.values())


LOOK = "Move through this figure in the browser: orbits, their multipliers and motions"
"""Text of the link to the page of a section."""


def sentences(*parts: str) -> str:
    """Return those parts that say something, one after the other.

    Examples
    --------
    >>> sentences("One.", "", "Two.")
    'One. Two.'
    """
    return " ".join(part for part in parts if part)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table.

    Examples
    --------
    >>> print(table(["i", "frequency"], [[1, 0.15]]))
    | i | frequency |
    | --- | --- |
    | 1 | 0.15 |
    """
    lines = [list(head), ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
