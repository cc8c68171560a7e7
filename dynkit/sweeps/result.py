"""The result of a sweep."""

import dataclasses
import json
import os
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, line_of
from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import Array, index_in
from dynkit.data import store
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.result import Result
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import read_rows, refuse_misfits, refuse_other, save_rows
from dynkit.engine.points import Rows
from dynkit.labels.label import OrbitLabel
from dynkit.sweeps.plan import KIND, Plan, Values

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result):
    """What a sweep found, made by `dynkit.sweep`.

    It holds the observables that were asked for and one state per value. What more is asked for is
    simulated again from these states, bit for bit the same motion. All arrays are read-only.

    Parameters
    ----------
    parameter : str
        Name of the parameter.
    values : (k,) array
        Values of the parameter.
    transient, keep : int
        States skipped, and states asked for, at each value.
    observables : tuple of str
        Names of what was kept of a state.
    counts : (k,) array of int
        States kept at each value: fewer than `keep` where the motion ended early.
    displaced : (k,) array of bool
        Where a state lay on an unstable orbit and was displaced to leave it; see `sweep`. None is
        in sweeps of independent starts.
    endings : tuple of str
        Why the simulation ended at each value.
    cost : Cost
        Seconds of all workers, and counted work; labels are not in it.

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
    _plan: Plan
    _rows: Rows
    _labels: dict[int, OrbitLabel] = field(default_factory=dict, init=False)

    @classmethod
    def load(cls, path: str | os.PathLike[str], system: Map | None = None) -> "Sweep":
        """Open the store of a finished sweep; nothing is written, and nothing simulated.

        Parameters
        ----------
        path : path
        system : Map, optional
            The system that was swept, at any value of the parameter; needed for `attractor`,
            `label`, `labels` and `error`.

        Raises
        ------
        ValueError
            When the file is missing, damaged or no store of a sweep, when the sweep is not
            finished, or was made with another system.
        """
        file = store.place(path)
        archive, found = read_rows(file, KIND)
        with store.understood(file, KIND):
            entries = archive.entries
            given = {"given/values": ("f", 1), "given/start": ("f", 1)}
            arrays = store.arrays_of(archive, given)
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
            plan.values.setflags(write=False)
            refuse_misfits(Values(plan), found)
        if system is not None:
            if plan.parameter not in checked_map(system, Map).parameters:
                raise ValueError(
                    f"store {file} was made with parameter {plan.parameter}; "
                    "got a system without it"
                )
            plan = dataclasses.replace(plan, system=system, kind=store.kind_of(system))
            refuse_other(file, Values(plan), archive)
        if not found.done.all():
            raise ValueError(
                f"store must hold a finished sweep; got {found.done.sum()} of {found.count} values "
                f"in {file}"
            )
        return sweep_of(plan, found.rows())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a store, as ``store=`` does: `load` reads it, and `sweep` finds it done.

        Raises
        ------
        ValueError
            When it cannot be written there, or the sweep was loaded without its system.
        """
        save_rows(path, Values(self._plan), self._rows)

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        first, last = float(self.values[0]), float(self.values[-1])
        return f"<Sweep: {len(self)} values of {self.parameter} from {first:g} to {last:g}>"

    def _facts(self) -> Facts:
        names = [str(label) for label in self._labels.values()]  # those that were decided
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

        Where a motion ended early, row i is NaN from ``counts[i]`` on, and only there.

        Raises
        ------
        ValueError
            When it was not kept.
        """
        if name not in self.observables:
            raise ValueError(f"name must be one of: {', '.join(self.observables)}; got {name!r}")
        return np.asarray(self._rows.arrays[f"observables/{name}"])

    def attractor(self, place: int) -> Attractor:
        """Return the attractor at ``values[place]``: simulated again, the same bits.

        Raises
        ------
        ValueError
            When there is no such value, or the sweep was loaded without its system.
        """
        place = index_in("place", place, 0, len(self) - 1)
        plan, values = self._plan, self.values.tolist()
        system, start = plan.system_at(values[place]), plan.first_start()
        if plan.follow and place:
            before = plan.system_at(values[place - 1])
            start = before.unpack_state(self._rows.arrays["final"][place - 1])
        if self.displaced[place]:
            return plan.following(system, start)[0]
        return plan.motion(system, start)

    def label(self, place: int) -> OrbitLabel:
        """Return the label at ``values[place]``: `attractor`'s, kept from then on.

        Raises
        ------
        ValueError
            As `attractor`.
        """
        if place not in self._labels:
            self._labels[place] = self.attractor(place).label
        return self._labels[place]

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the first observable at the kept states against the parameter, and nothing more.

        `dynkit.analysis.BifurcationDiagram` draws others, and the labels above.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure of column width.

        Returns
        -------
        Axes
        """
        from dynkit.plotting.points import draw_diagram

        name = self.observables[0]
        titles = [title.replace("_", " ") for title in (self.parameter, name)]
        return draw_diagram(ax, self.values, self.observable(name), titles)

    def dataset(self) -> Dataset:
        """Return the observables as a dataset over the parameter and ``state``, the kept states.

        Labels are in it once all were decided, and the `error`, which simulates, when it was asked
        for before.
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
                error="estimate of the largest error of the kept states, from where a value starts",
                system=self._plan.system,
                swept=(over,),
                transient=float(self.transient),
                keep=float(self.keep),
            ),
        )

    @property
    def labels(self) -> tuple[OrbitLabel, ...]:
        """Labels of all values: milliseconds for each, tens of them where the motion is chaotic."""
        return tuple(self.label(place) for place in range(len(self)))

    @cached_property
    def error(self) -> Array:
        """How wrong the kept states may be at each value, (k,): the error of each `attractor`.

        It counts from the state from which that value starts, which stands for itself: the error
        says how far from the exact motion from there on the states may be, in the attractor's
        sense. A stable motion forgets what went before; in chaos the error is as large as the
        attractor, single states have no meaning, and the distribution of many has.
        """
        errors = np.array([self.attractor(place).error for place in range(len(self))])
        errors.setflags(write=False)
        return errors


def sweep_of(plan: Plan, rows: Rows) -> Sweep:
    """Return what was found at the values of a plan as a sweep."""
    for array in rows.arrays.values():
        array.setflags(write=False)
    return Sweep(
        plan.parameter,
        plan.values,
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
