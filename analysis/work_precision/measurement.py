"""One measurement: error and run time of a method on a job."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import get_clock_info, perf_counter, process_time
from types import MappingProxyType
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    FoundImpacts,
    GaveUp,
    ImpactMethod,
    OverBudget,
    Simulation,
)
from dynkit.core.validation import Array

NEAR = 0.05
"""Largest distance of a found impact from its exact one, relative to the period."""


@final
@dataclass(frozen=True)
class Comparison:
    """Comparison of one simulation with exact impacts.

    Parameters
    ----------
    impacts : int
        Number of exact impacts and releases.
    missed, invented : int
        Number of exact impacts and releases that were not found, and of found ones that do not
        exist.
    error : float
        Largest error of those that were found; 0 if there are none.
    """

    impacts: int
    missed: int
    invented: int
    error: float

    @property
    def right(self) -> bool:
        """Whether no impact is missed and none invented."""
        return not (self.missed or self.invented)


def compare(found: FoundImpacts, exact: ExactImpacts) -> Comparison:
    """Compare found impacts and releases with exact ones, up to the end of the exact ones.

    Found and exact ones are matched in the order of time, one to one, at distances up to `NEAR` of
    the period: first as many as possible, then as near as possible.
    """
    times, near = found.times, NEAR * exact.period
    ours, theirs = matched(times, exact.times, near)
    errors = exact.errors(times[ours], found.positions[ours], found.velocities[ours], theirs)
    let, go = matched(found.releases, exact.releases, near)
    late = exact.lateness(found.releases[let], go)
    wrong = (times <= exact.until) & ~_within(times, exact.chatters)
    wrong[ours] = False
    early = found.releases <= exact.until
    early[let] = False
    return Comparison(
        len(exact.times) + len(exact.releases),
        len(exact.times) - len(theirs) + len(exact.releases) - len(go),
        int(wrong.sum()) + int(early.sum()),
        max(float(errors.max(initial=0.0)), float(late.max(initial=0.0))),
    )


def matched(found: Array, exact: Array, near: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Match two ascending lists of times; return the places of the pairs in both.

    Parameters
    ----------
    found, exact : (k,), (n,)
    near : float
        Largest distance of a pair.

    Examples
    --------
    >>> matched(np.array([1.0, 1.9, 3.1]), np.array([0.9, 3.0, 4.0]), 0.2)
    (array([0, 2]), array([0, 1]))
    """
    from scipy.optimize import linear_sum_assignment

    apart = abs(found[:, None] - exact)
    # a pair reduces the sum by more than all distances increase it: the number of pairs is largest
    saved = near * (1.0 + min(apart.shape))
    ours, theirs = linear_sum_assignment(np.where(apart <= near, apart - saved, 0.0))
    paired = apart[ours, theirs] <= near
    # pairs in the order of time have the smallest largest distance
    return ours[paired], np.sort(theirs[paired])


def _within(times: Array, intervals: Array) -> NDArray[np.bool_]:
    inside = (intervals[:, :1] <= times) & (times <= intervals[:, 1:])
    return np.asarray(inside.any(axis=0))


_REPEATS, _ENOUGH = 300, 0.2
"""Largest number of repetitions of a run, and seconds after which repetitions end."""

_now = process_time if get_clock_info("process_time").resolution < 1e-6 else perf_counter
"""Clock of processor time, which does not depend on other processes; where its resolution is low,
wall-clock time."""


@final
@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One method at one of its tolerances on one job.

    Parameters
    ----------
    job, method : str
    tolerance : float
        Tolerance of the method, with its own meaning; 0 when it has none, NaN when it did not run.
    error : float
        Largest error of an impact in the norm of `ExactImpacts.errors`, or of a release; NaN when
        an impact is missed or invented, or the method did not finish.
    seconds : float
        Processor time for all starts together, the least of several repetitions; NaN when the
        method did not finish.
    work : mapping of str to int
        Counts of the method's work.
    starts, lost : int
        Number of simulated starts, and of those with a missed or invented impact.
    impacts, missed, invented : int
        Numbers of exact impacts and releases of these starts, of exact ones that were not found,
        and of found ones that do not exist.
    reference : float
        Error of the exact impacts: a smaller `error` is not significant.
    remark : str
        Whether the method gave up, is not installed or lost an impact, or its error is only known
        to be below `reference`.
    """

    job: str
    method: str
    tolerance: float
    error: float = math.nan
    seconds: float = math.nan
    work: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    starts: int = 0
    lost: int = 0
    impacts: int = 0
    missed: int = 0
    invented: int = 0
    reference: float = 0.0
    remark: str = ""

    def __repr__(self) -> str:
        finest = "" if not self.tolerance > 0.0 else f" at {self.tolerance:g}"
        parts = [f"error {self.known_error}"] if self.right else []
        if self.lost:
            parts.append(f"{self.missed} missed, {self.invented} invented of {self.impacts}")
        if not math.isnan(self.seconds):
            parts.append(f"{self.seconds:.2g} s")
        parts += [self.remark] if self.remark else []
        return f"<Measurement of {self.method}{finest} on {self.job}: {', '.join(parts)}>"

    @property
    def right(self) -> bool:
        """Whether the method finished, and no impact is missed and none invented."""
        return not math.isnan(self.error)

    @property
    def known_error(self) -> str:
        """The error as text; below the error of the exact impacts, this upper limit."""
        if math.isnan(self.error):
            return "-"
        within = self.error < self.reference
        return f"{'< ' if within else ''}{max(self.error, self.reference):.1e}"


def measure(
    job: str,
    method: ImpactMethod,
    tolerance: float,
    starts: tuple[ExactImpacts, ...],
    runs: list[Simulation],
) -> Measurement:
    """Measure one method at one tolerance on the starts of a job, by its prepared simulations."""
    found: list[FoundImpacts] = []
    work: dict[str, int] = {}
    remark, left = "", method.budget
    began = _now()
    for run in runs:
        try:
            found.append(run(left))
        except OverBudget as failure:
            remark = f"gave up after {method.budget} {failure.unit}"
            break
        except GaveUp as failure:
            remark = str(failure)
            break
        for name, count in found[-1].work.items():
            work[name] = work.get(name, 0) + count
        left = method.budget - next(iter(work.values()), 0)
    seconds = _now() - began
    if not remark:
        seconds = _shortest(runs, method.budget, seconds)
    compared = [compare(each, exact) for each, exact in zip(found, starts, strict=False)]
    lost = sum(not each.right for each in compared)
    if remark and len(starts) > 1:
        remark = f"{remark}, {len(found)} of {len(starts)} starts done"
    if lost:
        counted = f"{lost} of {len(found)} starts lost" if len(starts) > 1 else "lost"
        remark = f"{counted}; {remark}" if remark else counted
    right = len(found) == len(starts) and not lost
    error = max(each.error for each in compared) if right else math.nan
    reference = max(exact.error for exact in starts)
    if error < reference:
        remark = "not known better"
    return Measurement(
        job=job,
        method=method.name,
        tolerance=tolerance,
        error=error,
        seconds=seconds if len(found) == len(starts) else math.nan,
        work=MappingProxyType(work),
        starts=len(found),
        lost=lost,
        impacts=sum(each.impacts for each in compared),
        missed=sum(each.missed for each in compared),
        invented=sum(each.invented for each in compared),
        reference=reference,
        remark=remark,
    )


def _shortest(runs: list[Simulation], budget: int, first: float) -> float:
    """Return the shortest time of several repetitions; the first run may include compilation."""
    best, spent = first, first
    for _ in range(_REPEATS - 1):
        if spent > _ENOUGH:
            break
        began = _now()
        for run in runs:
            run(budget)
        seconds = _now() - began
        best, spent = min(best, seconds), spent + seconds
    return best


_COLUMNS = {
    "job": 3, "method": 6, "tolerance": 9, "error": 9, "seconds": 8, "work": 19, "missed": 6,
    "invented": 8, "remark": 6,
}  # fmt: skip
"""Names of columns, and their least widths."""


def table_lines(
    jobs: Sequence[str], methods: Sequence[str], measured: Iterable[Measurement]
) -> Iterator[str]:
    """Yield the lines of a table in Markdown, each as soon as it is measured."""
    widths = {**_COLUMNS}
    for name, texts in (("job", jobs), ("method", methods)):
        widths[name] = max([widths[name], *map(len, texts)])

    def row(cells: Iterable[str]) -> str:
        return f"| {' | '.join(map(str.ljust, cells, widths.values()))} |"

    yield row(widths)
    yield row("-" * width for width in widths.values())
    for one in measured:
        yield row(cells(one).values())


def cells(one: Measurement) -> dict[str, str]:
    """Return the texts of a measurement in a table, by the names of the columns."""
    ran = one.starts > 0
    work = next((f"{count} {name}" for name, count in one.work.items()), "-")
    texts = (
        one.job,
        one.method,
        f"{one.tolerance:.0e}" if one.tolerance > 0.0 else "-",
        one.known_error,
        "-" if math.isnan(one.seconds) else f"{one.seconds:.1e}",
        work,
        str(one.missed) if ran else "-",
        str(one.invented) if ran else "-",
        one.remark,
    )
    return dict(zip(_COLUMNS, texts, strict=True))
