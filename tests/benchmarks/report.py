"""Lines of the table of benchmarks: each job beside a peer or a limit of the same run."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import process_time
from typing import final

from dynkit.analysis.work_precision import measurement
from dynkit.analysis.work_precision.measurement import Measurement
from dynkit.core.validation import Array

_REPEATS = 200
"""Repetitions at most; there are no more after as many seconds as in `measurement`."""

HEAD = ("job", "dynkit", "beside", "its time", "ratio", "at most")


@final
@dataclass(frozen=True)
class Line:
    """A job's seconds of the processor, and those of a peer, or a limit.

    Parameters
    ----------
    job : str
    seconds : float
    beside : str
        What the job stands beside.
    its : float
        The seconds of that.
    most : float, optional
        The ratio that is aimed at.
    """

    job: str
    seconds: float
    beside: str
    its: float
    most: float | None = None

    def cells(self) -> tuple[str, ...]:
        """The texts of the row."""
        ratio = self.seconds / self.its
        most = "" if self.most is None else f"{self.most:.3g}"
        return (
            *(self.job, duration(self.seconds), self.beside, duration(self.its)),
            *(f"{ratio:.2f}" if ratio < 10.0 else f"{ratio:.0f}", most),
        )


def duration(seconds: float) -> str:
    """Return seconds with the unit that suits them, and two or three digits."""
    units = (1.0, "s"), (1e-3, "ms"), (1e-6, "µs")
    size, unit = next((one for one in units if seconds >= 0.9995 * one[0]), units[-1])
    number = seconds / size
    return f"{number:.0f} {unit}" if number >= 100.0 else f"{number:.2g} {unit}"


def markdown(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table."""
    cells = [list(head), *([str(cell) for cell in row] for row in rows)]
    cells.insert(1, ["---"] * len(cells[0]))
    return "\n".join(f"| {' | '.join(row)} |" for row in cells)


def by_job(found: Iterable[Measurement], *, finest: bool = False) -> str:
    """Return a table of errors and times: a row for each method and tolerance, a column for a job.

    Parameters
    ----------
    found : iterable of Measurement
    finest : bool
        Whether only the finest tolerance of each method has a row.
    """
    everything = list(found)
    jobs = list(dict.fromkeys(one.job for one in everything))
    last = {one.method: one.tolerance for one in everything if not math.isnan(one.tolerance)}
    rows: dict[str, dict[str, str]] = {}
    for one in everything:
        if math.isnan(one.tolerance) or (finest and one.tolerance != last[one.method]):
            continue
        name = f"{one.method}, {one.tolerance:.0e}" if one.tolerance > 0.0 else one.method
        rows.setdefault(name, {})[one.job] = _cell(one)
    for one in everything:  # methods that a job does not suit, or that are not installed
        if math.isnan(one.tolerance):
            own = [name for name in rows if name.split(",")[0] == one.method]
            for name in own or [one.method]:
                rows.setdefault(name, {})[one.job] = one.remark
    head = "method, tolerance or step", *jobs
    return markdown(
        head, [(name, *(row.get(job, "") for job in jobs)) for name, row in rows.items()]
    )


def _cell(one: Measurement) -> str:
    if one.starts > 1:
        text = f"{one.missed} missed, {one.invented} invented"
        return f"{text} ({one.remark})" if "gave up" in one.remark else text
    if one.right:
        return f"{one.error:.0e}, {duration(one.seconds)}"
    return one.remark.partition(" after")[0]


def time_once() -> None:
    """Time every run once from now on: repetitions make times steady, which no test asserts."""
    measurement._ENOUGH = 0.0


def clock() -> float:
    """Seconds of the processor, those of processes that have ended included."""
    return process_time() + sum(os.times()[2:4])


def in_turns(*calls: Callable[[], object], runs: int = 5) -> list[float]:
    """Return the least seconds of the processor of each call, of runs in turns."""
    best = [math.inf] * len(calls)
    for _ in range(runs):
        for i, call in enumerate(calls):
            began = clock()
            call()
            best[i] = min(best[i], clock() - began)
    return best


def measured(run: Callable[[], Array]) -> tuple[Array, float]:
    """Return the end of a run, and the least seconds of the processor of several repetitions."""
    found, best, spent = run(), math.inf, 0.0  # the first run may include compilation
    for _ in range(_REPEATS):
        began = process_time()
        run()
        seconds = process_time() - began
        best, spent = min(best, seconds), spent + seconds
        if spent > measurement._ENOUGH:
            break
    return found, best
