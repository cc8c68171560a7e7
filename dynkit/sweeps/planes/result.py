"""The result of a map of two parameters."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, line_of, table
from dynkit.core.validation import Array, index_in, one_of, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.store import Archive
from dynkit.dynamics.attractor import Attractor
from dynkit.engine.collecting import Rows
from dynkit.labels.label import KINDS, OrbitKind, OrbitLabel, label_in
from dynkit.sweeps.planes.plan import KIND, OTHER_ENDS, Plan
from dynkit.sweeps.swept import Swept
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    _points: Plan
    _rows: Rows

    _kind: ClassVar = KIND
    _words: ClassVar = ("map", "points")

    @classmethod
    def _points_in(cls, archive: Archive) -> Plan:
        entries, arrays = archive.entries, archive.arrays
        first, second = json.loads(entries["parameters"])
        values = arrays[f"given/values of {first}"], arrays[f"given/values of {second}"]
        return Plan(
            None,
            entries["system"],
            (first, second),
            int(entries["transient"]),
            int(entries["keep"]),
            tuple(json.loads(entries["observables"])),
            int(entries["exponents"]),
            arrays["given/start"],
            values,
        )

    @classmethod
    def _of(cls, points: Plan, rows: Rows) -> ParameterMap:
        """Return the result from the rows of all pairs."""
        shape = tuple(map(len, points.values))
        endings = np.array(rows.texts["ending"]).reshape(shape)
        for array in (*points.values, *rows.arrays.values(), endings):
            array.setflags(write=False)
        numbers = rows.arrays["numbers"].reshape(*shape, -1)
        return cls(
            points.names,
            MappingProxyType(dict(zip(points.names, points.values, strict=True))),
            points.transient,
            points.keep,
            points.observables,
            iterates=numbers[..., 0],
            periods=numbers[..., 1],
            endings=endings,
            cost=rows.cost,
            _points=points,
            _rows=rows,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self)._of, (self._points, self._rows)  # a read-only mapping is not pickled

    @property
    def _shape(self) -> tuple[int, ...]:
        return self.iterates.shape

    def where(self, kind: OrbitKind) -> NDArray[np.bool_]:
        """Return whether the motion at each pair is of a kind, (k1, k2)."""
        return np.asarray(self._rows.arrays["kind"] == KINDS.index(kind)).reshape(self._shape)

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
        if not self._points.exponents:
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
            "system": line_of(self._points.system, self._points.kind, self.parameters),
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
        return self._points.motion(float(first[i]), float(second[j]))

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
        from dynkit.sweeps.planes.drawing import draw_map

        return draw_map(self.values, self.names, self.where, ax)

    def _page(self, motions: int) -> Page:
        from dynkit.sweeps.planes.viewing import page_of

        return page_of(self, motions)

    def dataset(self) -> Dataset:
        """Return labels and observables as a dataset over the two parameters."""
        over = self.parameters
        found = {f"largest_{name}": (over, self.largest(name)) for name in self.observables}
        if self._points.exponents:
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
                system=self._points.system,
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
