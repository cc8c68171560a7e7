"""Error against run time: jobs times methods times their tolerances."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import get_clock_info, perf_counter, process_time
from types import MappingProxyType
from typing import TYPE_CHECKING, final

from dynkit.analysis.work_precision.comparing import compare
from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    FoundImpacts,
    GaveUp,
    ImpactMethod,
    OverBudget,
    Simulation,
    Unsuited,
)
from dynkit.analysis.work_precision.standard_methods import impact_methods
from dynkit.core.cost import Cost

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_REPEATS, _ENOUGH = 300, 0.2
"""A run is repeated so often at most, and no more once so many seconds have passed."""

_now = process_time if get_clock_info("process_time").resolution < 1e-6 else perf_counter
"""Time of the processor, which other work on the machine does not change; where it is coarse, the
time that passes."""


@final
@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One method at one of its tolerances on one job.

    Parameters
    ----------
    job, method : str
    tolerance : float
        Of the method, in its own meaning; 0 when it has none, NaN when it did not run.
    error : float
        Largest error of an impact as `ExactImpacts.errors` has it, or of a release; NaN when an
        impact is missed or invented, or the method did not come to its end.
    seconds : float
        Of the processor, for all starts together, the least of some repetitions; NaN when it did
        not come to its end.
    work : mapping of str to int
        What the method counts.
    starts, lost : int
        Starts that were simulated, and those of them in which an impact is missed or invented.
    impacts, missed, invented : int
        Exact impacts and releases of these starts; how many of them were not found; how many were
        found that are none.
    remark : str
        What is to be said of it: that it gave up, is not installed, or lost an impact.
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
    remark: str = ""

    def __repr__(self) -> str:
        finest = "" if not self.tolerance > 0.0 else f" at {self.tolerance:g}"
        parts = [f"error {self.error:.1e}"] if self.right else []
        if self.lost:
            parts.append(f"{self.missed} missed, {self.invented} invented of {self.impacts}")
        if not math.isnan(self.seconds):
            parts.append(f"{self.seconds:.2g} s")
        parts += [self.remark] if self.remark else []
        return f"<Measurement of {self.method}{finest} on {self.job}: {', '.join(parts)}>"

    @property
    def right(self) -> bool:
        """Whether it came to its end, and no impact is missed and none invented."""
        return not math.isnan(self.error)


@final
class WorkPrecision:
    """Error against run time of methods that simulate impacts, each over its own tolerance.

    All is measured when it is first asked for, and once. Before the time is taken each method may
    prepare itself: compile, find modes. The time is that of the processor, the least of up to 300
    repetitions, fewer where they take long.

    Parameters
    ----------
    jobs : mapping of str to ExactImpacts, or to a sequence of them
        By name: a start with its exact impacts, or several starts that are one job together.
    methods : sequence of ImpactMethod, optional
        By default those of `impact_methods`.

    Raises
    ------
    ValueError
        When there is no job, or a job without starts, or no method.

    Examples
    --------
    A ball thrown up above a floor at rest, of which the first two impacts are known:

    >>> from dynkit.systems import MatrixOscillator
    >>> ball = MatrixOscillator(
    ...     M=[[1]], C=[[0]], K=[[0]], constant_forces=[-1.0], amplitude=0, frequency=1,
    ...     restitution=0.5,
    ... )
    >>> exact = ExactImpacts(
    ...     system=ball, position=[0.0], velocity=[1.0], until=3.2,
    ...     times=[2.0, 3.0], positions=[[0.0], [0.0]], velocities=[[0.5], [0.25]],
    ... )
    >>> measured = WorkPrecision({"ball": exact}, impact_methods(["dynkit", "DOP853"]))
    >>> first = measured.measurements[0]
    >>> first.method, first.error < 1e-15, first.missed, first.invented
    ('dynkit', True, 0, 0)
    """

    def __init__(
        self,
        jobs: Mapping[str, ExactImpacts | Sequence[ExactImpacts]],
        methods: Sequence[ImpactMethod] | None = None,
    ) -> None:
        if not jobs:
            raise ValueError("jobs must hold at least one; got none")
        self.jobs: Mapping[str, tuple[ExactImpacts, ...]] = MappingProxyType(
            {name: _starts(name, given) for name, given in jobs.items()}
        )
        self.methods = tuple(impact_methods() if methods is None else methods)
        if not self.methods:
            raise ValueError("methods must hold at least one; got none")
        for method in self.methods:
            if not isinstance(method, ImpactMethod):
                raise ValueError(f"methods must be ImpactMethods; got {method!r}")
        self._measured: list[Measurement] = []
        self._seconds = 0.0
        self._going = self._run()

    def __iter__(self) -> Iterator[Measurement]:
        """Give the measurements one by one, as soon as they are made."""
        i = 0
        while True:
            if i == len(self._measured):
                following = next(self._going, None)
                if following is None:
                    return
                self._measured.append(following)
            yield self._measured[i]
            i += 1

    def __repr__(self) -> str:
        methods = ", ".join(method.name for method in self.methods)
        return f"<WorkPrecision: {', '.join(self.jobs)}; {methods}>"

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """All measurements, job by job, method by method, from coarse to fine."""
        return tuple(self)

    @property
    def floors(self) -> Mapping[str, float]:
        """What rounding the start costs, job by job: conditioning times 2^-53; NaN if unknown."""
        return {
            name: 2.0**-53 * max(exact.conditioning for exact in starts)
            for name, starts in self.jobs.items()
        }

    @property
    def error(self) -> float:
        """Rounding of the exact impacts: no measured error is more certain than this."""
        return max(exact.rounding for starts in self.jobs.values() for exact in starts)

    @property
    def cost(self) -> Cost:
        """Seconds of all runs, preparations and repetitions among them; the measurements."""
        return Cost(self._seconds, {"measurements": len(self.measurements)})

    def table(self) -> str:
        """Return the measurements as a table in Markdown, one line each."""
        from dynkit.analysis.work_precision.tables import head, line

        return "\n".join([*head(self), *(line(self, each) for each in self)])

    def plot(self, ax: Axes | None = None, *, job: str | None = None) -> Axes:
        """Draw error against seconds for one job, both logarithmic; each method has its line.

        Of a job of several starts the number of starts is drawn in which an impact is missed or
        invented, against seconds.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure.
        job : str, optional
            Which one; by default the first.

        Raises
        ------
        ValueError
            When there is no such job.
        """
        from dynkit.analysis.work_precision.drawing import draw_job

        name = next(iter(self.jobs)) if job is None else job
        if name not in self.jobs:
            raise ValueError(f"job must be one of: {', '.join(self.jobs)}; got {name!r}")
        return draw_job(self, name, ax)

    def figure(self) -> Figure:
        """Return a new figure with a panel for each job, as `plot` draws them."""
        from dynkit.analysis.work_precision.drawing import draw_all

        return draw_all(self)

    def _run(self) -> Iterator[Measurement]:
        for job, starts in self.jobs.items():
            for method in self.methods:
                for tolerance in method.tolerances:
                    began = perf_counter()
                    try:
                        runs = [method.prepare(exact, tolerance) for exact in starts]
                    except Unsuited as refusal:
                        yield Measurement(
                            job=job, method=method.name, tolerance=math.nan, remark=str(refusal)
                        )
                        break
                    measured = _measure(job, method, tolerance, starts, runs)
                    self._seconds += perf_counter() - began
                    yield measured


def _starts(name: str, given: ExactImpacts | Sequence[ExactImpacts]) -> tuple[ExactImpacts, ...]:
    starts = (given,) if isinstance(given, ExactImpacts) else tuple(given)
    if not starts or not all(isinstance(exact, ExactImpacts) for exact in starts):
        raise ValueError(f"jobs[{name!r}] must be one or more ExactImpacts; got {given!r}")
    return starts


def _measure(
    job: str,
    method: ImpactMethod,
    tolerance: float,
    starts: tuple[ExactImpacts, ...],
    runs: list[Simulation],
) -> Measurement:
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
        told = f"{lost} of {len(found)} starts lost" if len(starts) > 1 else "lost"
        remark = f"{told}; {remark}" if remark else told
    right = len(found) == len(starts) and not lost
    return Measurement(
        job=job,
        method=method.name,
        tolerance=tolerance,
        error=max(each.error for each in compared) if right else math.nan,
        seconds=seconds if len(found) == len(starts) else math.nan,
        work=MappingProxyType(work),
        starts=len(found),
        lost=lost,
        impacts=sum(each.impacts for each in compared),
        missed=sum(each.missed for each in compared),
        invented=sum(each.invented for each in compared),
        remark=remark,
    )


def _shortest(runs: list[Simulation], budget: int, first: float) -> float:
    """The shortest time of some repetitions; the first may have compiled something."""
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
