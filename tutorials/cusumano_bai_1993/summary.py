"""The first screen of the report: the machine, the diagram, what was found, and what differs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from dynkit.plotting.figures import save_figure
from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.section import Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MACHINE, DIAGRAM = "machine", "figure-4"
"""Pictures of the first screen."""

HEAD = ("in the paper", "what", "paper", "found", "error estimate")
_GROUPS = (
    (False, "Differences"),
    (True, "Agreements"),
    (None, "Statements without a number to compare"),
)


def draw_machine(folder: Path, chain: ImpactChain) -> None:
    """Write the sketch of the machine."""
    save_figure(cast("Figure", chain.plot().figure), folder / MACHINE)


def pictures(sections: Sequence[Section]) -> list[tuple[str, str]]:
    """Return names and titles of the pictures: the machine, and the diagram if it was made."""
    chain = f"The chain of {paper.MASSES} masses above its vibrating table"
    return [(MACHINE, chain)] + [
        (each.item, each.title) for each in sections if each.item == DIAGRAM
    ]


def found(sections: Sequence[Section]) -> str:
    """Return what was found, in three sentences."""
    compared = [each.agrees for section in sections for each in section.findings]
    count, same = len(compared) - compared.count(None), compared.count(True)
    motion = "its motion is periodic, sticks to the table, or is chaotic, by the table's frequency"
    parts = [
        f"The end of a chain of {paper.MASSES} masses hits a vibrating table: {motion}.",
        f"Of {count} results that can be compared with the paper, {same} agree.",
    ]
    parts += [
        f"Of the periodic motions of figure 4, {finding.found} lie on a stable branch that was found."
        for section in sections
        if section.item == "figure-4-branches"
        for finding in section.findings[:1]
    ]
    return " ".join(parts)


def groups(sections: Sequence[Section]) -> list[tuple[str, list[list[str]]]]:
    """Return names and rows of the tables, those that differ first; rows in the report's order."""
    tables = [
        (
            name,
            [
                [section.title.partition(":")[0], each.what, each.paper, each.found, each.error]
                for section in sections
                for each in section.findings
                if each.agrees is agrees
            ],
        )
        for agrees, name in _GROUPS
    ]
    return [(f"{name} ({len(rows)})", rows) for name, rows in tables if rows]
