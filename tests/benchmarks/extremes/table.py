"""The table of extreme cases, as printed and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from tests.benchmarks.extremes.measures import Outcome
from tests.benchmarks.report import markdown as benchmark_table

_HEAD = ("case", "impacts", "ending", "largest", "actual error", "estimated", "ratio", "us/impact")
_WIDTHS = (54, 8, 18, 8, 12, 9, 7, 9)

_ABOUT = """\
# Extreme cases

"Largest" is the largest section coordinate of the impacts that are compared. Actual errors are
differences of their section coordinates and times from 30 digits, computed with 50 digits.
Estimated errors are those of `record.error`. Both are absolute. The largest ratio of the two, over
all impacts, must not exceed 1. Times per impact are without compilation. In a run of few impacts,
most of the time is the start of the run.
"""


def head() -> str:
    """Return the head of the printed table."""
    return _row(_HEAD)


def line(outcome: Outcome) -> str:
    """Return one line of the printed table."""
    text = _row(_cells(outcome))
    return text if outcome.right else f"{text}  WRONG: {outcome.wrong}"


def summary(outcomes: Sequence[Outcome]) -> str:
    """Return a line about all outcomes."""
    right = sum(outcome.right for outcome in outcomes)
    worst = max((outcome.ratio for outcome in outcomes), default=0.0)
    impacts = sum(outcome.compared for outcome in outcomes)
    return (
        f"{right} of {len(outcomes)} cases right, {impacts} impacts compared; "
        f"largest ratio of an actual error to its estimate: {worst:.2g}"
    )


def markdown(outcomes: Sequence[Outcome]) -> str:
    """Return the table as Markdown."""
    table = benchmark_table(_HEAD, [_cells(outcome) for outcome in outcomes])
    return f"{_ABOUT}\n{table}\n\n{summary(outcomes)}\n"


def selection(outcomes: Sequence[Outcome], each: int = 2) -> str:
    """Return, as Markdown, the cases of each group with the largest ratios of errors."""
    groups: dict[str, list[Outcome]] = {}
    for outcome in sorted(outcomes, key=lambda one: -one.ratio):
        if outcome.compared:
            groups.setdefault(outcome.case.group, []).append(outcome)
    rows = [_cells(one) for group in sorted(groups) for one in groups[group][:each]]
    return benchmark_table(_HEAD, rows)


def _cells(outcome: Outcome) -> list[str]:
    compared = outcome.compared > 0
    each = 1e6 * outcome.seconds / max(outcome.impacts, 1)
    return [
        outcome.case.name,
        f"{outcome.impacts}",
        outcome.ending,
        f"{outcome.largest:.1e}" if compared else "-",
        f"{outcome.true:.1e}" if compared else "-",
        f"{outcome.claimed:.1e}" if compared else "-",
        f"{outcome.ratio:.2g}" if compared else "-",
        f"{each:.3g}",
    ]


def _row(cells: Sequence[str]) -> str:
    first, *others = zip(cells, _WIDTHS, strict=True)
    return "  ".join([f"{first[0]:<{first[1]}}", *(f"{cell:>{width}}" for cell, width in others)])
