"""Table A1: the natural frequencies."""

from __future__ import annotations

from math import pi, sin

from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop


def closed_form(i: int, masses: int) -> float:
    """Return the i-th natural frequency of a uniform chain with one fixed end, i from 1 on.

    Examples
    --------
    >>> closed_form(1, 1)
    0.9999999999999999
    """
    return 2.0 * sin((2 * i - 1) * pi / (2 * (2 * masses + 1)))


def table_a1(workshop: Workshop) -> Section:
    """Make Table A1."""
    watch = Stopwatch()
    with watch.time("modes"):
        found = workshop.chain(paper.FREQUENCIES[0]).natural_frequencies.tolist()
    rows, agreeing, worst = [], 0, 0.0
    for i, (ours, theirs) in enumerate(zip(found, paper.NATURAL_FREQUENCIES, strict=True), 1):
        error = abs(ours - closed_form(i, paper.MASSES))
        worst = max(worst, error)
        agrees = f"{ours:.3f}" == f"{theirs:.3f}"
        agreeing += agrees
        rows.append(
            [
                i,
                f"{theirs:.3f}",
                f"{ours:.6f}",
                f"{ours - theirs:+.6f}",
                "yes" if agrees else f"no: {ours:.3f}",
                f"{error:.1e}" if error else "none",
            ]
        )
    text = (
        "Natural frequencies $\\omega_i$ of the chain in free flight. The error is the distance "
        "to the closed form $2 \\sin((2i-1)\\pi / (2(2N+1)))$.\n\n"
        + table(
            ["i", "paper", "found", "difference", "same three decimals", "error"],
            rows,
        )
    )
    return Section(
        "table-a1",
        "Table A1: natural frequencies",
        text,
        [
            Finding(
                "natural frequencies",
                f"{len(rows)} values, three decimals",
                f"{agreeing} of {len(rows)} the same when rounded",
                f"{worst:.0e}",
                agreeing == len(rows),
            )
        ],
        seconds=watch.seconds,
    )
