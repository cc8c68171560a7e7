"""The result of a sweep."""

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, line_of
from dynkit.core.validation import Array, index_in, one_of, read_only
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.store import Archive, arrays_of
from dynkit.dynamics.attractor import Attractor
from dynkit.engine.points import Rows
from dynkit.labels.label import OrbitLabel
from dynkit.sweeps.plan import KIND, Plan, Values
from dynkit.sweeps.swept import Swept
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
        Why the simulation ended at each value.
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
    _points: Values
    _rows: Rows
    _labels: dict[int, OrbitLabel] = field(default_factory=dict, init=False)

    _kind: ClassVar = KIND
    _words: ClassVar = ("sweep", "values")

    @classmethod
    def _points_in(cls, archive: Archive) -> Values:
        entries = archive.entries
        arrays = arrays_of(archive, {"given/values": ("f", 1), "given/start": ("f", 1)})
        arrays["given/values"].setflags(write=False)
        plan = Plan(
            None,
            entries["system"],
            entries["parameter"],
            arrays["given/values"],
            int(entries["transient"]),
            int(entries["keep"]),
            tuple(json.loads(entries["observables"])),
            arrays["given/start"],
            {"True": True, "False": False}[entries["follow"]],
        )
        return Values(plan)

    @classmethod
    def _of(cls, points: Values, rows: Rows) -> "Sweep":
        """Return the result from the rows of all values."""
        plan = points.plan
        for array in rows.arrays.values():
            array.setflags(write=False)
        return cls(
            plan.parameter,
            plan.values,
            plan.transient,
            plan.keep,
            plan.observables,
            counts=np.asarray(rows.arrays["count"]),
            displaced=np.asarray(rows.arrays["displaced"]),
            endings=tuple(rows.texts["ending"]),
            cost=rows.cost,
            _points=points,
            _rows=rows,
        )

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        first, last = float(self.values[0]), float(self.values[-1])
        return f"<Sweep: {len(self)} values of {self.parameter} from {first:g} to {last:g}>"

    def _facts(self) -> Facts:
        names = [label.name for label in self._labels.values()]  # those that were decided
        counts = [f"{name} {names.count(name)}" for name in dict.fromkeys(names)]
        return {
            "system": line_of(self._points.plan.system, self._points.plan.kind, [self.parameter]),
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
        """
        place = index_in("place", place, 0, len(self) - 1)
        plan, values = self._points.plan, self.values.tolist()
        system, start = plan.system_at(values[place]), plan.first_start()
        if plan.follow and place:
            before = plan.system_at(values[place - 1])
            start = before.unpack_state(self._rows.arrays["final"][place - 1])
        if self.displaced[place]:
            return plan.following(system, start)[0]
        return plan.motion(system, start)

    def label(self, place: int) -> OrbitLabel:
        """Return the label of the attractor at ``values[place]``; it is computed once.

        Raises
        ------
        ValueError
            As `attractor`.
        """
        if place not in self._labels:
            self._labels[place] = self.attractor(place).label
        return self._labels[place]

    def plot(self, ax: "Axes | None" = None) -> "Axes":
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
        from dynkit.sweeps.viewing import page_of

        return page_of(self, motions)

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
                system=self._points.plan.system,
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
        attractor, and only the distribution of many states has a meaning.
        """
        return read_only(np.array([self.attractor(place).error for place in range(len(self))]))
