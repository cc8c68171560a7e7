"""Error against run time, for all jobs, methods and tolerances."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import fields, replace
from itertools import tee
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from dynkit.analysis.work_precision.drawing import Job, Lines, draw_all, draw_job
from dynkit.analysis.work_precision.event_driven import weakest_bounce
from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.measurement import Measurement, measure, table_lines
from dynkit.analysis.work_precision.methods import ImpactMethod, Unsuited
from dynkit.analysis.work_precision.standard_methods import impact_methods
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import line_of
from dynkit.core.validation import Array, boolean, one_of, positive_integer
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def reference_impacts(system: Any, start: Any, impacts: int, coarsest: float) -> ExactImpacts:
    """Return the first impacts that dynkit finds, with their error.

    Bounces before sticking that are weaker than those a method at the coarsest tolerance simulates
    are left out, as chatters.

    Raises
    ------
    ValueError
        When the system is not an impact oscillator, there are no impacts, or their error is as
        large as the motion.
    """
    count = positive_integer("impacts", impacts)
    for name in ("state", "simulate"):
        if not hasattr(system, name):
            raise ValueError(f"system must be an ImpactOscillator; got {system!r}")
    state = system.simulate(impacts=1, start=start).start
    # the state in doubles, as the methods get it, without further digits of the start
    anew = system.state(state.position, state.velocity, state.phase)
    record = system.simulate(impacts=count + 1, start=anew)
    times = record.time
    if not len(times):
        raise ValueError(f"start must lead to an impact; got {start!r}")
    # half-way to the next impact, or half a period later where there is none
    later = times[count] if len(times) > count else times[-1] + math.pi / system.frequency
    until = float(0.5 * (times[:count][-1] + later))
    cut = 0.0  # without restitution there are no bounces
    if system.restitution != 0.0:
        cut = weakest_bounce(system.amplitude * system.frequency, state.velocity, coarsest)
    chatters = _chatters(times, abs(record.relative_velocity) < cut, record.sticking, until)
    inside = np.zeros(len(times), dtype=bool)
    for begin, end in chatters:
        inside |= (begin <= times) & (times <= end)
    kept = (times <= until) & ~inside
    if not kept.any():
        raise ValueError(f"impacts must not all be weak bounces; got {impacts} of them")
    releases = record.sticking[:, 1]
    exact = ExactImpacts(
        system=system,
        position=state.position,
        velocity=state.velocity,
        phase=state.phase,
        until=until,
        times=times[kept],
        positions=record.position[kept],
        velocities=record.velocity[kept],
        releases=releases[releases <= until],
        chatters=chatters,
    )
    error = _error(system, float(record.error[times <= until][-1]), exact)
    if not error < 1.0:
        raise ValueError(
            f"impacts must be so few that dynkit's own error stays below the size of the motion; "
            f"got {impacts}, error {error:.1e}"
        )
    return replace(exact, error=error)


def _chatters(times: Array, weak: Any, sticking: Array, until: float) -> list[tuple[float, float]]:
    """Return intervals from before the first weak bounce of each contact to its release."""
    found = []
    for contact, release in [*sticking.tolist(), (until, until)]:
        last = int(np.searchsorted(times, contact, side="right"))
        first = last
        while first and weak[first - 1]:
            first -= 1
        if first < last:
            # a motion that begins in a chatter has no earlier bounce
            begin = float(0.5 * (times[first - 1] + times[first])) if first else 0.0
            found.append((min(begin, until), min(release, until)))
    return found


def _error(system: Any, error: float, exact: ExactImpacts) -> float:
    """Return an error of section coordinates in the norm of `ExactImpacts.errors`.

    An error of the phase is also one of the position and the velocity of the table, and so of the
    contact mass.
    """
    position, velocity = exact.size
    reach = max(1.0, system.amplitude)
    speed = 1.0 + system.amplitude * system.frequency
    parts = (1.0 / (2.0 * math.pi), reach / position, speed / velocity)
    return float(max(error * max(parts), exact.rounding))


@final
class WorkPrecision(Saved):
    """Error against run time of methods that simulate impacts, each over its tolerances.

    Measurements are made once, when they are first read. Preparations of a method, such as
    compilation and modes, are not timed. The time is processor time, the least of up to 300
    repetitions, fewer where they take long.

    Parameters
    ----------
    jobs : mapping of str to ExactImpacts, or to a sequence of them
        By name: a start with its exact impacts, or several starts that form one job.
    methods : sequence of ImpactMethod, optional
        By default those of `impact_methods`.
    progress : bool
        Whether to show a bar on standard error during measurements.

    Raises
    ------
    ValueError
        When there is no job, or a job without starts, or no method.

    Examples
    --------
    A ball thrown up from a floor at rest, with its first two impacts:

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

    _stored: ClassVar = ("measurements", "cost", "_jobs", "_names")
    _jobs: tuple[Job, ...]
    _names: tuple[str, ...]

    def __init__(
        self,
        jobs: Mapping[str, ExactImpacts | Sequence[ExactImpacts]],
        methods: Sequence[ImpactMethod] | None = None,
        *,
        progress: bool = False,
    ) -> None:
        if not jobs:
            raise ValueError("jobs must hold at least one; got none")
        self.jobs: Mapping[str, tuple[ExactImpacts, ...]] = MappingProxyType(
            {name: _starts(name, given) for name, given in jobs.items()}
        )
        self.methods = _checked(methods)
        self._jobs = tuple(
            Job(
                name,
                len(starts),
                2.0**-53 * max(exact.conditioning for exact in starts),
                max(exact.error for exact in starts),
            )
            for name, starts in self.jobs.items()
        )
        self._names = tuple(method.name for method in self.methods)
        self._progress = boolean("progress", progress)
        self._seconds = 0.0
        (self._going,) = tee(self._run(), 1)  # copies share the measurements

    @classmethod
    def of(
        cls,
        system: Any,
        *,
        start: Any = None,
        impacts: int = 20,
        methods: Sequence[ImpactMethod] | None = None,
        progress: bool = True,
    ) -> WorkPrecision:
        """Measure methods on a user's impact oscillator, with the impacts of dynkit as reference.

        Errors are differences from dynkit's impacts. `ImpactRecord.error` estimates the error of
        these: `plot` draws it as a band, in which points are not significant, and `table` gives it
        as an upper limit of smaller errors. Bounces before sticking that are too weak for the
        coarsest method are not compared.

        Parameters
        ----------
        system : ImpactOscillator
        start : ImpactState, optional
            State made by ``system.state``, or the end of a motion; by default ``state()``.
        impacts : int
            Number of impacts to compare.
        methods : sequence of ImpactMethod, optional
            By default those of `impact_methods`.
        progress : bool
            Whether to show a bar on standard error during measurements.

        Raises
        ------
        ValueError
            When an argument is refused; when there is no impact, or dynkit's error has grown to the
            size of the motion.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> measured = WorkPrecision.of(
        ...     ImpactChain(masses=2, frequency=0.87), impacts=5,
        ...     methods=impact_methods(["dynkit", "DOP853"]), progress=False,
        ... )
        >>> finest = measured.measurements[-1]
        >>> finest.method, finest.missed, finest.error < 1e-8, measured.error < 1e-12
        ('DOP853', 0, True, True)
        """
        chosen = _checked(methods)
        coarsest = max((t for each in chosen for t in each.tolerances), default=0.0)
        exact = reference_impacts(system, start, impacts, coarsest)
        return cls({line_of(system, "", ()): exact}, chosen, progress=progress)

    def __iter__(self) -> Iterator[Measurement]:
        """Yield the measurements one by one, as soon as they are made."""
        return iter(self.measurements) if "measurements" in vars(self) else copy(self._going)

    def __repr__(self) -> str:
        jobs = ", ".join(job.name for job in self._jobs)
        return f"<WorkPrecision: {jobs}; {', '.join(self._names)}>"

    @cached_property
    def measurements(self) -> tuple[Measurement, ...]:
        """All measurements, job by job, method by method, from coarse to fine."""
        return tuple(self)

    @property
    def floors(self) -> Mapping[str, float]:
        """Error from rounding of the start, by job: conditioning times 2^-53; NaN if unknown."""
        return {job.name: job.floor for job in self._jobs}

    @property
    def error(self) -> float:
        """Error of the exact impacts: a lower limit for significant errors."""
        return max(job.error for job in self._jobs)

    @cached_property
    def cost(self) -> Cost:
        """Seconds of all runs, with preparations and repetitions; number of measurements."""
        count = len(self.measurements)  # reading them starts the measurements
        return Cost(self._seconds, {"measurements": count})

    def table(self) -> str:
        """Return the measurements as a table in Markdown, one line each."""
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """Yield the lines of `table` one by one, as soon as they are measured."""
        return table_lines([job.name for job in self._jobs], self._names, self)

    def plot(self, ax: Axes | None = None, *, job: str | None = None) -> Axes:
        """Draw error against seconds for one job, both logarithmic, with a line for each method.

        For a job of several starts, the number of starts with a missed or invented impact is drawn
        against seconds.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure.
        job : str, optional
            Name of the job; by default the first.

        Raises
        ------
        ValueError
            When there is no such job.
        """
        jobs = {each.name: each for each in self._jobs}
        name = next(iter(jobs)) if job is None else job
        return draw_job(jobs[one_of("job", name, jobs)], self._lines(name), ax)

    def dataset(self) -> Dataset:
        """Return the measurements as a dataset over ``measurement``."""
        found, each = self.measurements, "measurement"
        names = [entry.name for entry in fields(Measurement) if entry.name != "work"]
        counted = [next(iter(one.work.items()), ("", 0)) for one in found]
        return Dataset(
            {},
            {
                **{name: (each, np.array([getattr(x, name) for x in found])) for name in names},
                "work": (each, np.array([count for _, count in counted])),
                "unit": (each, np.array([unit for unit, _ in counted], dtype=str)),
            },
            described(
                "Error against run time",
                cost=self.cost,
                error="largest error of an impact, or of a release, against the exact ones",
            ),
        )

    def figure(self) -> Figure:
        """Return a new figure with a panel for each job; see `plot`."""
        return draw_all([(job, self._lines(job.name)) for job in self._jobs])

    def _lines(self, job: str) -> Lines:
        return [
            [each for each in self if (each.job, each.method) == (job, name)]
            for name in self._names
        ]

    def _run(self) -> Iterator[Measurement]:
        from tqdm import tqdm

        total = len(self.jobs) * sum(len(method.tolerances) for method in self.methods)
        shown = {"unit": "run", "file": sys.stderr, "disable": not self._progress}
        with tqdm(total=total, desc="error against run time", **shown) as bar:
            for job, starts in self.jobs.items():
                for method in self.methods:
                    for measured in self._measure(job, starts, method):
                        bar.update()
                        yield measured

    def _measure(
        self, job: str, starts: tuple[ExactImpacts, ...], method: ImpactMethod
    ) -> Iterator[Measurement]:
        for tolerance in method.tolerances:
            began = perf_counter()
            try:
                runs = [method.prepare(exact, tolerance) for exact in starts]
            except Unsuited as refusal:
                yield Measurement(
                    job=job, method=method.name, tolerance=math.nan, remark=str(refusal)
                )
                break
            measured = measure(job, method, tolerance, starts, runs)
            self._seconds += perf_counter() - began
            yield measured


def _starts(name: str, given: ExactImpacts | Sequence[ExactImpacts]) -> tuple[ExactImpacts, ...]:
    starts = (given,) if isinstance(given, ExactImpacts) else tuple(given)
    if not starts or not all(isinstance(exact, ExactImpacts) for exact in starts):
        raise ValueError(f"jobs[{name!r}] must be one or more ExactImpacts; got {given!r}")
    return starts


def _checked(methods: Sequence[ImpactMethod] | None) -> tuple[ImpactMethod, ...]:
    """Return the methods, by default all; ValueError when one of them is none."""
    chosen = tuple(impact_methods() if methods is None else methods)
    if not chosen:
        raise ValueError("methods must hold at least one; got none")
    for method in chosen:
        if not isinstance(method, ImpactMethod):
            raise ValueError(
                "methods must be ImpactMethods, as impact_methods(['dynkit', 'RK45']) returns; "
                f"got {method!r}"
            )
    return chosen
