"""The page of benchmarks: it is what ``make bench`` writes from its template."""

from __future__ import annotations

import math
import re

import pytest

from dynkit.analysis.work_precision.measurement import Measurement
from tests.benchmarks.report import HEAD, Line, by_job, duration
from tests.benchmarks.run import PAGE, TEMPLATE, machine, unbroken


def test_the_page_is_the_template_with_tables_in_it() -> None:
    prose = re.split(r"\$\w+", unbroken(TEMPLATE.read_text(encoding="utf-8")))
    page = PAGE.read_text(encoding="utf-8")
    pattern = "(.+?)".join(map(re.escape, prose))
    written = re.fullmatch(pattern, page, flags=re.DOTALL)
    assert written is not None
    _, lines, *_ = written.groups()
    assert lines.splitlines()[0] == f"| {' | '.join(HEAD)} |"
    assert all(line.count("|") == len(HEAD) + 1 for line in lines.splitlines())


def test_a_line_stands_beside_another() -> None:
    line = Line("impact", 1.2e-6, "a peer", 6e-6, 0.5)
    assert line.cells() == ("impact", "1.2 µs", "a peer", "6 µs", "0.20", "0.5")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 µs"), (2e-8, "0.02 µs"), (9.996e-4, "1 ms"), (0.1234, "123 ms"), (75.0, "75 s")],
)
def test_durations_have_the_unit_that_suits_them(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_methods_are_rows_and_jobs_columns() -> None:
    found = [
        Measurement(job="a", method="fine", tolerance=1e-3, error=2e-3, seconds=0.5, starts=1),
        Measurement(job="a", method="fine", tolerance=1e-6, error=2e-6, seconds=1.5, starts=1),
        Measurement(job="a", method="lost", tolerance=1e-3, remark="gave up after 3 steps"),
        Measurement(job="b", method="fine", tolerance=math.nan, remark="not made for it"),
        Measurement(job="b", method="lost", tolerance=1e-3, starts=200, missed=3, invented=1),
    ]
    assert by_job(found, finest=True).splitlines()[2:] == [
        "| fine, 1e-06 | 2e-06, 1.5 s | not made for it |",
        "| lost, 1e-03 | gave up | 3 missed, 1 invented |",
    ]


def test_the_machine_is_named() -> None:
    assert re.fullmatch(
        r"Measured \d\d \w+ 20\d\d on one of \d+ processors \(.+\), .+\.", machine()
    )
