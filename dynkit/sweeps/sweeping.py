"""`sweep`: the motion at values of a parameter, and its result."""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion, Refused
from dynkit.core.reprs import Facts, line_of
from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import Array, boolean, index_in, one_of, read_only, within_memory
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.store import Archive, arrays_of
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import MOST_POINTS, Anything, Columns, Findings, Points, Rows, collect
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.sweeps.plan import Plan, swept_values
from dynkit.sweeps.swept import NO_SYSTEM, Swept
from dynkit.viewer.page import Page, page_of_motions
from dynkit.viewer.series import Series
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_RUNS = 16
"""Largest number of runs in which a displaced motion may leave an orbit. With the default 800
states a run they suffice where the largest multiplier exceeds 1.0014 per state."""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SweepPlan(Plan):
    """The plan of a sweep."""

    KIND = "sweep"

    def points(self, values: Array) -> Points:
        """Return values of the parameter, (k,), as points of the engine."""
        return Points(
            len(values),
            partial(replace, self),
            partial(self.task, values),
            partial(self.entries, parameter=self.names[0], follow=str(self.follow)),
            {"values": values, "start": self.start},
            self.columns,
            self.follow,
        )

    def task(
        self, values: Array, first: int, last: int, found: Findings | Rows
    ) -> tuple[Array, tuple[float, Array] | None]:
        """Return some values, and the value before them with its last state, if they follow it."""
        if not self.follow or not first:
            return values[first:last], None
        return values[first:last], (float(values[first - 1]), found.arrays["final"][first - 1])

    @property
    def columns(self) -> Columns:
        observables = dict.fromkeys(self.observables, ("f", (self.keep,)))
        return {
            "count": ("i", ()),
            "displaced": ("b", ()),
            "final": ("f", (None,)),
            **{f"observables/{name}": column for name, column in observables.items()},
        }

    def __call__(self, task: tuple[Array, tuple[float, Array] | None]) -> Rows:
        """Simulate some values, where each may follow the value before it."""
        (values, before), began = task, time.perf_counter()
        shape, work = (len(values), self.keep), Counter[str]()
        kept = {name: np.full(shape, np.nan) for name in self.observables}
        counts, displaced, finals, endings = [], [], [], []
        start, note = self.start_after(before), None
        for place, value in enumerate(values.tolist()):
            try:
                system = self._known["system"] = self.system_at(value)
                if self.follow:
                    motion, moved = self.following(system, start)
                else:
                    motion, moved = self.motion(system, start), False
                found = {name: motion.observable(name) for name in kept}
            except Exception as error:
                if not isinstance(error, NoMotion) or isinstance(error, Refused):
                    error.add_note(f"at {self.names[0]} {value}")
                    raise
                self._known.pop("last", None)
                counts.append(0)
                displaced.append(False)
                own = system.pack_state(system.default_start if start is None else start)
                finals.append(np.full(len(own), np.nan))
                endings.append(f"{OrbitKind.NO_MOTION.value}: {error}")
                continue
            for name, rows in kept.items():
                rows[place, : len(found[name])] = found[name]
            counts.append(len(found[self.observables[0]]))
            displaced.append(moved)
            finals.append(system.pack_state(motion.final))
            endings.append(str(motion.ending.value))
            for name, count in motion.cost.counts.items():
                work[name] += count
            if self.follow:  # the next task need not unpack this state from the rows of the engine
                self._known["last"] = value, motion.final
                note = partial(self._note, value, motion)
        arrays: dict[str, Anything] = {f"observables/{name}": rows for name, rows in kept.items()}
        arrays |= {
            "final": np.array(finals),
            "count": np.array(counts, dtype=np.int64),
            "displaced": np.array(displaced, dtype=np.bool_),
        }
        return Rows(arrays, {"ending": endings}, Cost(time.perf_counter() - began, work), note)

    def _note(self, value: float, motion: Attractor) -> str:
        """Return a value and its label from the kept states: a full label would cost too much."""
        label = motion.label_within(self.keep)
        name = "..." if label.kind is OrbitKind.UNSETTLED else str(label)
        return f"{self.names[0]} {value:.6g}: {name}"

    def start_after(self, before: tuple[float, Array] | None) -> Any:
        """Return the start after a value and its packed last state.

        After None, and after a value without a motion, it is that of the first value.
        """
        if before is None or np.isnan(before[1]).all():
            if not len(self.start):  # the default start of the system
                return None
            before = self.begin[0], self.start
        value, packed = before
        known, state = self._known.get("last", (None, None))
        return state if known == value else self.system_at(value).unpack_state(packed)

    def following(self, system: Map, start: Any) -> tuple[Attractor, bool]:
        """Simulate and leave unstable orbits; return the motion, and whether it was displaced.

        Only the kept states are examined. Where they recur, and neither norms nor multipliers prove
        that the orbit is stable, the last state is displaced and the motion simulated from there,
        until disturbances of this size have had time to grow to the size of the motion. Where the
        multipliers prove neither stability nor instability, and the displaced motion remains near
        the orbit, the orbit is not unstable: the motion before the displacement is returned. So it
        is where the displaced motion runs away.
        """
        motion = self.motion(system, start)
        if motion._stays:
            return motion, False
        label = motion.label_within(self.keep)
        if label.kind not in (OrbitKind.PERIODIC, OrbitKind.STICKING) or label.stable:
            return motion, False
        # geometric mean of the error of an iterate, relative to the motion's size, and of that size
        size = math.sqrt(system.accuracy)
        try:
            away = system.displaced(motion, size)
            for _ in range(self._runs_to_leave(label, size)):
                away = self.motion(system, away).final
            left = self.motion(system, away)
        except NoMotion:
            return motion, False
        if label.stable is None and _near(motion, left, size):
            return motion, False
        return left, True

    def _runs_to_leave(self, label: OrbitLabel, size: float) -> int:
        """Return the number of runs, of transient + keep states each, for growth to size one."""
        if label.stable is None:
            return 0
        states = (label.iterates or 1) * -math.log(size) / math.log(label.multiplier)
        return min(math.ceil(states / (self.transient + self.keep)), _MOST_RUNS)


def _near(orbit: Attractor, other: Attractor, size: float) -> bool:
    """Whether the last state of another motion is near an orbit, relative to the orbit's size."""
    states, there = (orbit.system.without_shift(o.states) for o in (orbit, other))
    nearest = float(np.linalg.norm(orbit.system.difference(states, there[-1]), axis=1).min())
    return nearest <= size * (float(np.linalg.norm(states, axis=1).max()) or 1.0)


def sweep(
    system: Map,
    parameter: str,
    values: Array | Sequence[float],
    *,
    transient: int = 700,
    keep: int = 100,
    observables: Sequence[str] | None = None,
    start: object = None,
    follow: bool = True,
    executor: Executor | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Sweep:
    """Simulate the motion at each value of a parameter, from the last state at the value before.

    In a simulation, a state on an unstable orbit may stay there, and a symmetric motion stays
    symmetric. Therefore a following sweep checks the multipliers wherever the kept states recur for
    at least three periods. (For one hard stop it first checks norms of derivatives.) If these do
    not prove that the orbit is stable, the last state is displaced. The displacement, relative to
    the motion, is the square root of the system's `accuracy` (1.5e-8 for rounding): far above
    rounding, and far below the motion. The motion is then simulated again, for as many runs (at
    most 16) as a disturbance of that size needs to grow to the size of the motion. Where
    instability is not proved and the displaced motion remains near the orbit, the motion before the
    displacement is kept. `Sweep.displaced` marks displaced motions. Stable motions, however narrow
    their basins, are never displaced.

    Parameters
    ----------
    system : Map
        The swept system; its value of the parameter has no effect.
    parameter : str
        One of the system's ``parameters``.
    values : (k,) array_like
        Values of the parameter in the order of the sweep, ascending or not.
    transient : int
        Number of states to skip at each value.
    keep : int
        Number of states to keep at each value.
    observables : sequence of str, optional
        Observables to keep, among the system's ``observables``; by default the first
        (``relative_velocity`` for impact oscillators). Those of a plain map are the coordinates of
        its states, ``state[0]`` and so on. Nothing else is stored.
    start : state, optional
        Start of the first value; by default that of the system. A plain map needs one.
    follow : bool
        Whether each value starts from the last state of the value before it, or, where that has no
        motion, as the first value; otherwise all values have the same start.
    executor : concurrent.futures.Executor, optional
        Executor that simulates chunks of values, with ``follow=False`` only: processes, threads,
        Dask, MPI. The result is the same bits with any executor and any number of workers, and
        without one.
    store : path, optional
        An HDF5 file that keeps finished values. It is rewritten every second, less often when
        writing takes long, and when the sweep ends or is interrupted. The same call resumes it,
        with any executor, and gives (on the same machine) the same bits as without interruption.
    progress : bool
        Whether to show a bar on standard error, with the current value, and its label where the
        kept states determine it.

    Returns
    -------
    Sweep

    Raises
    ------
    ValueError
        When an argument is refused, before any simulation or writing. A store is refused if it is
        of another sweep or another version, damaged, or in use. When a system refuses a state or a
        value during the run; the store keeps finished values.
    dynkit.WorkerLost
        When a worker died and its executor does not replace it; the store keeps finished values.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> chain = ImpactChain(masses=10, frequency=0.87)
    >>> found = sweep(chain, "frequency", [0.86, 0.87, 0.88], progress=False)
    >>> found.observable("relative_velocity").shape
    (3, 100)
    >>> print(*found.labels)
    P(1,3) P(1,3) P(1,3)
    """
    checked_map(system, Map)
    system.value_of(parameter)
    array = swept_values("values", values)
    if len(array) > MOST_POINTS:
        raise ValueError(f"values must not be more than {MOST_POINTS}; got {len(array)}")
    for place, value in enumerate(array.tolist()):
        try:
            system.replace(**{parameter: value})
        except ValueError as refusal:
            raise ValueError(f"{refusal} in values[{place}]") from refusal
    following = boolean("follow", follow)
    if following and executor is not None:
        raise ValueError(
            "executor must be None when each value starts from the last state of the one before "
            f"it (follow=False makes them independent); got {executor!r}"
        )
    plan = SweepPlan.of(
        system,
        {parameter: array},
        transient=transient,
        keep=keep,
        observables=observables,
        start=start,
        follow=following,
    )
    within_memory("keep", plan.keep, 8.0 * plan.keep * len(array) * len(plan.observables))
    rows = collect(plan.points(array), executor=executor, store=store, progress=progress)
    return Sweep._of(plan, (array,), rows)


@final
@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Viewed, Swept):
    """The motions at values of a parameter; made by `dynkit.sweep`.

    It holds the observables that were asked for and one state per value. `attractor`, `label` and
    `error` simulate again from these states, bit for bit the same motion. Arrays are read-only.

    Parameters
    ----------
    parameter : str
        Name of the parameter.
    values : (k,) array
        Values of the parameter.
    transient, keep : int
        Number of skipped states, and of states to keep, at each value.
    observables : tuple of str
        Names of the kept observables.
    counts : (k,) array of int
        Number of kept states at each value: fewer than `keep` where the motion ended early.
    displaced : (k,) array of bool
        Whether the motion lay on an unstable orbit and was displaced to leave it; see `sweep`.
        False throughout for independent starts.
    endings : tuple of str
        Why the simulation ended at each value. Where the motion runs away, or has no next state
        for another reason, it is "no motion: " with the message of the exception.
    cost : Cost
        Seconds of all workers, and counted work without that of labels.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from dynkit import Sweep, sweep
    >>> from dynkit.systems import ImpactChain
    >>> chain = ImpactChain(masses=10, frequency=0.87)
    >>> with TemporaryDirectory() as folder:
    ...     store = Path(folder, "x.h5")
    ...     found = sweep(chain, "frequency", [0.86, 0.87], store=store, progress=False)
    ...     loaded = Sweep.load(store, chain)
    >>> loaded
    <Sweep: 2 values of frequency from 0.86 to 0.87>
    >>> loaded.endings[0]
    'the number of impacts was reached'
    >>> print(loaded.label(1), loaded.error[1] < 1e-10)
    P(1,3) True
    """

    parameter: str
    values: Array
    transient: int
    keep: int
    observables: tuple[str, ...]
    counts: NDArray[np.int64]
    displaced: NDArray[np.bool_]
    endings: tuple[str, ...]
    cost: Cost
    _plan: SweepPlan
    _rows: Rows
    _labels: dict[int, OrbitLabel] = field(default_factory=dict, init=False)

    _kind: ClassVar = SweepPlan
    _words: ClassVar = ("sweep", "values")

    @classmethod
    def _plan_in(cls, archive: Archive) -> tuple[SweepPlan, tuple[Array]]:
        entries = archive.entries
        arrays = arrays_of(archive, {"given/values": ("f", 1), "given/start": ("f", 1)})
        follow = {"True": True, "False": False}[entries["follow"]]
        values, start = arrays["given/values"], arrays["given/start"]
        plan = SweepPlan.stored(entries, {entries["parameter"]: values}, start, follow=follow)
        return plan, (values,)

    @classmethod
    def _of(cls, plan: SweepPlan, values: Sequence[Array], rows: Rows) -> Sweep:
        """Return the result from the rows of all values."""
        for array in (*values, *rows.arrays.values()):
            array.setflags(write=False)
        return cls(
            plan.names[0],
            values[0],
            plan.transient,
            plan.keep,
            plan.observables,
            counts=np.asarray(rows.arrays["count"]),
            displaced=np.asarray(rows.arrays["displaced"]),
            endings=tuple(rows.texts["ending"]),
            cost=rows.cost,
            _plan=plan,
            _rows=rows,
        )

    @property
    def _axes(self) -> tuple[Array]:
        return (self.values,)

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        first, last = float(self.values[0]), float(self.values[-1])
        return f"<Sweep: {len(self)} values of {self.parameter} from {first:g} to {last:g}>"

    def _facts(self) -> Facts:
        names = [label.name for label in self._labels.values()]  # those that were decided
        counts = [f"{name} {names.count(name)}" for name in dict.fromkeys(names)]
        return {
            "system": line_of(self._plan.system, self._plan.kind, [self.parameter]),
            self.parameter: self.values,
            "states at each": f"{self.keep} kept after {self.transient}",
            "observables": self.observables,
            "motions that ended early": int((self.counts < self.keep).sum()),
            "displaced from unstable orbits": int(self.displaced.sum()),
            f"labels, {len(names)} decided": ", ".join(counts) or None,
            "cost": self.cost,
        }

    def observable(self, name: str) -> Array:
        """Return an observable at the kept states, (k, keep), read-only.

        Row i is NaN from column ``counts[i]`` on, where the motion ended early, and only there.

        Raises
        ------
        ValueError
            When the observable was not kept.
        """
        known = one_of("name", name, self.observables)
        return np.asarray(self._rows.arrays[f"observables/{known}"])

    def attractor(self, place: int) -> Attractor:
        """Simulate ``values[place]`` again and return its attractor, the same bits.

        Raises
        ------
        ValueError
            When there is no such value, or the sweep was loaded without its system.
        NoMotion
            When there is no motion at the value: its ending begins with "no motion".
        """
        place = index_in("place", place, 0, len(self) - 1)
        plan = self._plan
        (value,), before = plan.task(self.values, place, place + 1, self._rows)
        system, start = plan.system_at(float(value)), plan.start_after(before)
        if self.displaced[place]:
            return plan.following(system, start)[0]
        return plan.motion(system, start)

    def label(self, place: int) -> OrbitLabel:
        """Return the label of the attractor at ``values[place]``; it is computed once.

        It is "no motion" where the motion ends before all states are kept, or runs away among the
        later states that a label examines. In the second case all states are kept.

        Raises
        ------
        ValueError
            As `attractor`.
        """
        if place not in self._labels:
            try:
                self._labels[place] = self.attractor(place).label
            except Refused:
                raise
            except NoMotion:  # of the kept states, or later of those that the label examines
                none = OrbitLabel(OrbitKind.NO_MOTION, None, None, np.nan, np.nan, 0)
                self._labels[place] = none
        return self._labels[place]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the first observable at the kept states against the parameter.

        `dynkit.analysis.BifurcationDiagram` draws other observables, and labels above them.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.

        Returns
        -------
        Axes
        """
        from dynkit.plotting.points import axis_title, draw_diagram

        name = self.observables[0]
        titles = [axis_title(title) for title in (self.parameter, name)]
        return draw_diagram(ax, self.values, self.observable(name), titles)

    def _page(self, motions: int) -> Page:
        name = self.observables[0]
        numbers = self.observable(name)
        place, column = np.nonzero(~np.isnan(numbers))
        title, names = f"Sweep of {self.parameter}", (self.parameter, name)
        dots = place, self.values[place], numbers[place, column]
        page = page_of_motions(title, names, len(self), *dots)

        def series(at: int) -> Series:
            attractor = self.attractor(at)
            self._labels[at] = attractor.label
            return attractor._series()

        loaded = self._plan.system is None
        page = page.noting(NO_SYSTEM) if loaded else page.with_series(motions, series)
        labels = [self._labels[at].name if at in self._labels else "" for at in range(len(self))]
        facts = {
            self.parameter: self.values,
            "label": labels,
            "kept states": self.counts.astype(float),
            "ending": list(self.endings),
            "displaced": ["from an unstable orbit" if moved else "" for moved in self.displaced],
        }
        return replace(page, facts=facts)

    def dataset(self) -> Dataset:
        """Return the observables as a dataset over the parameter and ``state``, the kept states.

        It contains the labels once all of them have been computed, and the `error` if it has been
        read before, because both simulate.
        """
        over, names = self.parameter, []
        if len(self._labels) == len(self):
            names = [str(label) for label in self.labels]
        return Dataset(
            {over: (over, self.values)},
            {
                **{name: ((over, "state"), self.observable(name)) for name in self.observables},
                "count": (over, self.counts),
                "ending": (over, list(self.endings)),
                "displaced": (over, self.displaced),
                **({"label": (over, names)} if names else {}),
                **known_error(self, over),
            },
            described(
                "Sweep of a parameter",
                cost=self.cost,
                error="estimate of the largest error of the kept states for the start of a value",
                system=self._plan.system,
                swept=(over,),
                transient=float(self.transient),
                keep=float(self.keep),
            ),
        )

    @property
    def labels(self) -> tuple[OrbitLabel, ...]:
        """Labels of all values; each takes milliseconds, and about ten times more for chaos."""
        return tuple(self.label(place) for place in range(len(self)))

    @cached_property
    def error(self) -> Array:
        """Estimated error of the kept states at each value, (k,): the error of each `attractor`.

        It is the distance to the exact motion from the start of that value, which is taken as
        exact: a stable motion loses all memory of its start. In chaos the error is as large as the
        attractor, and only the distribution of many states has a meaning. It is NaN where there is
        no motion.
        """
        errors = np.full(len(self), np.nan)
        for place in range(len(self)):
            with suppress(NoMotion):
                errors[place] = self.attractor(place).error
        return read_only(errors)
