"""`parameter_map`: the kinds of motion at all pairs of values of two parameters."""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion, Refused, replaced
from dynkit.core.reprs import Facts, line_of, table
from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import (
    Array,
    index_in,
    non_negative_integer,
    one_of,
    read_only,
    within_memory,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.store import Archive
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import MOST_POINTS, Anything, Columns, Findings, Points, Rows, collect
from dynkit.labels.label import (
    COLUMNS,
    KINDS,
    OrbitKind,
    OrbitLabel,
    empty_columns,
    label_in,
    put_label,
)
from dynkit.sweeps.plan import Plan, swept_values
from dynkit.sweeps.swept import Swept
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


NO_MOTION, REFUSED = -1, -2

OTHER_ENDS = {NO_MOTION: "no motion", REFUSED: "refused"}
"""Outcomes of pairs without a motion, by number. A pair is refused if the system refuses it, or the
start at it."""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PlanePlan(Plan):
    """The plan of a map of two parameters, whose pairs of values are points of the engine.

    Parameters
    ----------
    exponents : int
        Number of states for the largest Lyapunov exponent; 0 for no exponents.
    """

    KIND = "map of two parameters"
    exponents: int

    def points(self, *values: Array) -> Points:
        """Return all pairs of values, (k1,) and (k2,); the second value changes fastest."""
        inputs = {f"values of {name}": axis for name, axis in zip(self.names, values, strict=True)}
        return Points(
            len(values[0]) * len(values[1]),
            partial(replace, self),
            partial(self.task, values),
            partial(self.entries, parameters=json.dumps(self.names), exponents=str(self.exponents)),
            {**inputs, "start": self.start},
            self.columns,
        )

    def task(self, values: Sequence[Array], first: int, last: int, found: Findings) -> Array:  # noqa: ARG002
        """Return some pairs of values, (n, 2)."""
        i, j = np.divmod(np.arange(first, last), len(values[1]))
        return np.stack([values[0][i], values[1][j]], axis=1)

    @property
    def columns(self) -> Columns:
        found: Columns = {**COLUMNS, "largest": ("f", (len(self.observables),))}
        return {**found, "exponent": ("f", ())} if self.exponents else found

    @cached_property
    def first(self) -> Map:
        """The system at the first pair, of which those at other pairs may keep parts."""
        return self.system_at(*self.begin)

    def motion_at(self, first: float, second: float) -> Attractor:
        """Simulate at a pair of values.

        Raises
        ------
        Refused
            When the system refuses the pair, or the start at it.
        """
        system = replaced(self.first, **{self.names[0]: first, self.names[1]: second})
        start = self.first.unpack_state(self.start) if len(self.start) else None
        return self.motion(system, start)

    def __call__(self, pairs: Array) -> Rows:
        """Return the rows of pairs of values, (n, 2)."""
        n, began = len(pairs), time.perf_counter()
        labels = empty_columns(n, NO_MOTION)
        largest = np.full((n, len(self.observables)), np.nan)
        exponents = np.full(n if self.exponents else 0, np.nan)
        endings, work = [], Counter[str]()
        for row, (first, second) in enumerate(pairs.tolist()):
            try:
                motion = self.motion_at(first, second)
                label = motion.label
                for column, name in enumerate(self.observables):
                    seen = motion.observable(name)
                    largest[row, column] = seen.max() if len(seen) else np.nan
                if self.exponents:
                    exponents[row] = largest_exponent(motion, self.exponents)
            except NoMotion as end:
                kind = REFUSED if isinstance(end, Refused) else NO_MOTION
                labels["kind"][row] = kind
                endings.append(f"{OTHER_ENDS[kind]}: {end}")
                continue
            put_label(labels, row, label)
            endings.append(str(motion.ending.value))
            work.update(motion.cost.counts)
        arrays: dict[str, Anything] = {**labels, "largest": largest}
        if self.exponents:
            arrays["exponent"] = exponents
        return Rows(arrays, {"ending": endings}, Cost(time.perf_counter() - began, work))


def largest_exponent(attractor: Attractor, count: int) -> float:
    """Return the largest Lyapunov exponent per state, from `count` states after the kept ones.

    During `count` / 4 states before these the disturbance turns into the growing direction. NaN
    where the motion ends.
    """
    states = attractor.states
    if not len(states):
        return float("nan")
    try:
        stretching = attractor.system.stretching(states[-1], count + count // 4)
    except NoMotion:
        return float("nan")
    return float(stretching.logs[count // 4 :, 0].mean())


def axes_of(family: Map, values: object) -> dict[str, Array]:
    """Return the values of two parameters by name, checked without simulating.

    Raises
    ------
    ValueError
        When a value is refused; the message names argument, limit and value.
    """
    if not isinstance(values, Mapping) or len(values) != 2:
        raise ValueError(f"values must hold the values of two parameters by name; got {values!r}")
    first, second = values
    known = ", ".join(family.parameters) or "none"
    for name in (first, second):
        if name not in family.parameters:
            raise ValueError(f"values must be of parameters among {known}; got {name!r}")
    axes = (
        swept_values(f"values[{first!r}]", values[first]),
        swept_values(f"values[{second!r}]", values[second]),
    )
    if len(axes[0]) * len(axes[1]) > MOST_POINTS:
        raise ValueError(
            f"values must not make more than {MOST_POINTS} pairs; got {len(axes[0])} of {first} "
            f"and {len(axes[1])} of {second}"
        )
    origin = float(axes[0][0]), float(axes[1][0])
    for name, axis, other in ((first, axes[0], second), (second, axes[1], first)):
        beside = origin[1] if other == second else origin[0]
        for place, value in enumerate(axis.tolist()):
            try:
                replaced(family, **{name: value, other: beside})
            except Refused as refusal:
                at = _places_of(family, (name, value, place), (other, beside))
                raise ValueError(f"{refusal} in {at}") from refusal
    return {first: axes[0], second: axes[1]}


def _places_of(family: Map, one: tuple[str, float, int], other: tuple[str, float]) -> str:
    """Return the name of the value that the system refuses; of both if it refuses neither alone."""
    name, value, place = one
    own, beside = f"values[{name!r}][{place}]", f"values[{other[0]!r}][0]"
    for changes, at in (({name: value}, own), (dict([other]), beside)):
        try:
            replaced(family, **changes)
        except Refused:
            return at
    return f"{own} with {beside}"


def parameter_map(
    system: Map,
    values: Mapping[str, Array | Sequence[float]],
    *,
    transient: int = 700,
    keep: int = 100,
    observables: Sequence[str] | None = None,
    exponents: int = 0,
    start: object = None,
    executor: Executor | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> ParameterMap:
    """Label the motion at all pairs of values of two parameters, each from the same start.

    Parameters
    ----------
    system : Map
        The swept system; its values of the two parameters have no effect.
    values : mapping of str to array_like
        The values of two of the system's ``parameters``, (k1,) and (k2,), in any order.
    transient : int
        Number of states to skip at each pair.
    keep : int
        Number of states to keep at each pair.
    observables : sequence of str, optional
        Observables whose largest values are kept, among the system's ``observables``; by default
        the first (``relative_velocity`` for impact oscillators).
    exponents : int
        Number of further states for the largest Lyapunov exponent; 0 for no exponents.
    start : state, optional
        Start at all pairs; by default that of the system. A plain map needs one.
    executor : concurrent.futures.Executor, optional
        Executor that simulates chunks: processes, threads, Dask, MPI. The result is the same bits
        with any executor and any number of workers, and without one.
    store : path, optional
        An HDF5 file that keeps finished pairs. As for `dynkit.sweep` the same call resumes it, with
        any executor.
    progress : bool
        Whether to show a bar on standard error.

    Returns
    -------
    ParameterMap
        A pair without a motion, such as a diverging one, is labelled ``no motion``; a pair that the
        system refuses, or at which it refuses the start, ``refused``. `ParameterMap.endings` holds
        the message.

    Raises
    ------
    ValueError
        When an argument is refused, before any simulation or writing. A store is refused if it is
        of another map or another version, damaged, or in use.
    dynkit.WorkerLost
        When a worker died and its executor does not replace it; the store keeps finished pairs.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    >>> from dynkit.systems import Henon
    >>> values = {"a": [0.2, 1.0, 1.2], "b": [0.0, 0.3]}
    >>> found = parameter_map(Henon(), values, start=[0.1, 0.1], progress=False)
    >>> found.names.tolist()
    [['P(1)', 'P(1)'], ['P(2)', 'P(4)'], ['P(2)', 'chaotic']]
    """
    axes = axes_of(checked_map(system, Map), values)
    plan = PlanePlan.of(
        system,
        axes,
        transient=transient,
        keep=keep,
        observables=observables,
        start=start,
        exponents=non_negative_integer("exponents", exponents),
    )
    within_memory("keep", plan.keep, 8.0 * plan.keep)
    points = plan.points(*axes.values())
    rows = collect(points, executor=executor, store=store, progress=progress)
    return ParameterMap._of(plan, tuple(axes.values()), rows)


@final
@dataclass(frozen=True, eq=False, repr=False)
class ParameterMap(Viewed, Swept):
    """The kinds of motion at all pairs of values of two parameters, made by `parameter_map`.

    Arrays are (k1, k2), read-only: row i belongs to value i of the first parameter, column j to
    value j of the second one.

    Parameters
    ----------
    parameters : (str, str)
        Names of the two parameters.
    values : mapping of str to array
        Values of the two parameters by name, (k1,) and (k2,).
    transient, keep : int
        Number of skipped and of kept states at each pair.
    observables : tuple of str
        Names of the observables whose largest values were kept.
    iterates, periods : (k1, k2) array of int
        The n and m of P(n,m); 0 where there is none, as for m of P(n) and n of P(inf,m).
    endings : (k1, k2) array of str
        Why each simulation ended.
    cost : Cost
        Seconds of all workers, and counted work without that of labels.

    Examples
    --------
    >>> from dynkit import parameter_map
    >>> from dynkit.systems import ImpactChain
    >>> found = parameter_map(
    ...     ImpactChain(frequency=0.87),
    ...     {"frequency": [0.87, 0.88], "amplitude": [0.1]},
    ...     progress=False,
    ... )
    >>> found
    <ParameterMap: 2 x 1 values of frequency and amplitude; P(1,3) 2>
    >>> found.iterates[0, 0].item(), found.periods[0, 0].item()
    (1, 3)
    >>> str(found.attractor(0, 0).label)
    'P(1,3)'
    """

    parameters: tuple[str, str]
    values: Mapping[str, Array]
    transient: int
    keep: int
    observables: tuple[str, ...]
    iterates: NDArray[np.int64]
    periods: NDArray[np.int64]
    endings: NDArray[np.str_]
    cost: Cost
    _plan: PlanePlan
    _rows: Rows

    _kind: ClassVar = PlanePlan
    _words: ClassVar = ("map", "points")

    @classmethod
    def _plan_in(cls, archive: Archive) -> tuple[PlanePlan, list[Array]]:
        entries, arrays = archive.entries, archive.arrays
        first, second = json.loads(entries["parameters"])
        values = {name: arrays[f"given/values of {name}"] for name in (first, second)}
        exponents = int(entries["exponents"])
        plan = PlanePlan.stored(entries, values, arrays["given/start"], exponents=exponents)
        return plan, list(values.values())

    @classmethod
    def _of(cls, plan: PlanePlan, values: Sequence[Array], rows: Rows) -> ParameterMap:
        """Return the result from the rows of all pairs."""
        shape, (first, second) = tuple(map(len, values)), plan.names
        endings = np.array(rows.texts["ending"]).reshape(shape)
        for array in (*values, *rows.arrays.values(), endings):
            array.setflags(write=False)
        numbers = rows.arrays["numbers"].reshape(*shape, -1)
        return cls(
            (first, second),
            MappingProxyType(dict(zip(plan.names, values, strict=True))),
            plan.transient,
            plan.keep,
            plan.observables,
            iterates=numbers[..., 0],
            periods=numbers[..., 1],
            endings=endings,
            cost=rows.cost,
            _plan=plan,
            _rows=rows,
        )

    @property
    def _axes(self) -> tuple[Array, ...]:
        return tuple(self.values.values())

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self)._of, (
            self._plan,
            self._axes,
            self._rows,
        )  # a read-only mapping is not pickled

    @property
    def _shape(self) -> tuple[int, ...]:
        return self.iterates.shape

    def where(self, kind: OrbitKind) -> NDArray[np.bool_]:
        """Return whether the motion at each pair is of a kind, (k1, k2)."""
        number = NO_MOTION if kind is OrbitKind.NO_MOTION else KINDS.index(kind)
        return np.asarray(self._rows.arrays["kind"] == number).reshape(self._shape)

    @cached_property
    def names(self) -> NDArray[np.str_]:
        """The labels in words, (k1, k2): P(1,3), chaotic, ``no motion`` or ``refused``.

        Quasi-periodic motions have one name; `label` has their rotation numbers. ``P(1,3)
        unstable`` means that the motion stays on an unstable orbit and is not an attractor; see
        `OrbitLabel.stable`. `endings` says why there is no motion, or what was refused.
        """
        arrays = self._rows.arrays
        texts = [
            OTHER_ENDS.get(kind) or label_in(arrays, place, KINDS[kind]).name
            for place, kind in enumerate(arrays["kind"].tolist())
        ]
        return read_only(np.array(texts).reshape(self._shape))

    def largest(self, name: str | None = None) -> Array:
        """Return the largest kept value of an observable, (k1, k2); NaN where there is none.

        Parameters
        ----------
        name : str, optional
            One of `observables`; by default the first.

        Raises
        ------
        ValueError
            When the observable was not kept.
        """
        asked = self.observables[0] if name is None else name
        one_of("name", asked, self.observables)
        column: Array = self._rows.arrays["largest"][:, self.observables.index(asked)]
        return column.reshape(self._shape)

    @property
    def exponents(self) -> Array:
        """The largest Lyapunov exponents, per state, (k1, k2); NaN where the motion ends.

        Raises
        ------
        ValueError
            When the map was made without exponents.
        """
        if not self._plan.exponents:
            raise ValueError("exponents must be asked for when the map is made; got 0")
        found: Array = self._rows.arrays["exponent"]
        return found.reshape(self._shape)

    @cached_property
    def error(self) -> Array:
        """Uncertainty of the labels, (k1, k2): the `OrbitLabel.error` of each.

        NaN where there is no motion. The error of the states is that of each `attractor`.
        """
        labels = [self._label(place) for place in range(len(self._rows.arrays["kind"]))]
        errors = [np.nan if label is None else label.error for label in labels]
        return read_only(np.array(errors).reshape(self._shape))

    def __repr__(self) -> str:
        names, counts = np.unique(self.names, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        shown = [f"{names[i]} {counts[i]}" for i in order[:6].tolist()]
        shown += [f"{len(order) - 6} more"] if len(order) > 6 else []
        first, second = self.parameters
        return (
            f"<ParameterMap: {self._shape[0]} x {self._shape[1]} values of {first} and {second}; "
            f"{', '.join(shown)}>"
        )

    def _facts(self) -> Facts:
        return {
            "system": line_of(self._plan.system, self._plan.kind, self.parameters),
            **self.values,
            "states at each": f"{self.keep} kept after {self.transient}",
            "observables": self.observables,
            "cost": self.cost,
        }

    def _tables(self) -> list[str]:
        found = Counter(self.names.ravel().tolist()).most_common()
        return [table("Motions", found, ("label", "pairs"))]

    # --- single points ----------------------------------------------------------------------------

    def label(self, i: int, j: int) -> OrbitLabel:
        """Return the label at one pair.

        Raises
        ------
        ValueError
            When there is no such pair, or no motion at it.
        """
        label = self._label(self._place(i, j))
        if label is None:
            why = self.endings[i, j]
            raise ValueError(f"i, j must be a pair with a motion; got ({i}, {j}), {why}")
        if label.periods is None:
            return label

        def harmonics() -> int:
            return self.attractor(i, j).label.harmonics or 0

        def events() -> dict[str, float] | None:
            return self.attractor(i, j).label.counts

        return dataclasses.replace(label, count_harmonics=harmonics, count_events=events)

    def attractor(self, i: int, j: int) -> Attractor:
        """Simulate one pair again and return its attractor, the same bits.

        Raises
        ------
        ValueError
            When there is no such pair, or the map was loaded without its system.
        NoMotion
            When there is no motion at the pair.
        """
        self._place(i, j)
        first, second = self.values.values()
        return self._plan.motion_at(float(first[i]), float(second[j]))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the kinds of motion over the plane of the two parameters, and return the axes.

        The most frequent labels have colours that also differ in grey, and their names are written
        in regions with enough room. Chaos is black; sticking and quasi-periodic motions are
        hatched.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        """
        from dynkit.plotting.regions import draw_regions
        from dynkit.sweeps.planes.drawing import regions_of

        first, second = self._axes
        regions = regions_of(self.names, self.where)
        return draw_regions(ax, (first, second), self.parameters, *regions)

    def _page(self, motions: int) -> Page:
        from dynkit.sweeps.planes.drawing import page_of

        return page_of(self, motions)

    def dataset(self) -> Dataset:
        """Return labels and observables as a dataset over the two parameters."""
        over = self.parameters
        found = {f"largest_{name}": (over, self.largest(name)) for name in self.observables}
        if self._plan.exponents:
            found["exponent"] = (over, self.exponents)
        return Dataset(
            {name: (name, values) for name, values in self.values.items()},
            {
                "label": (over, self.names),
                "iterates": (over, self.iterates),
                "periods": (over, self.periods),
                "ending": (over, self.endings),
                "error": (over, self.error),
                **found,
            },
            described(
                "Kinds of motion over two parameters",
                cost=self.cost,
                error="uncertainty of the label, OrbitLabel.error; its meaning depends on the kind",
                system=self._plan.system,
                swept=over,
                transient=float(self.transient),
                keep=float(self.keep),
            ),
        )

    def _place(self, i: int, j: int) -> int:
        for name, place, count in (("i", i, self._shape[0]), ("j", j, self._shape[1])):
            index_in(name, place, 0, count - 1)
        return i * self._shape[1] + j

    def _label(self, place: int) -> OrbitLabel | None:
        arrays = self._rows.arrays
        kind = int(arrays["kind"][place])
        return None if kind in OTHER_ENDS else label_in(arrays, place, KINDS[kind])
