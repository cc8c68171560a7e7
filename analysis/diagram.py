"""Bifurcation diagrams: an observable of attractors against a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from dynkit.analysis.annotation import LabelInterval, write_intervals
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, span, table
from dynkit.core.validation import Array, boolean, finite_array, of_type, one_of, unmasked
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.labels.label import OrbitLabel
from dynkit.plotting.figures import print_style
from dynkit.plotting.points import axis_title, dots, draw_diagram
from dynkit.sweeps import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
@dataclass(frozen=True, eq=False, repr=False)
class BifurcationDiagram(Saved):
    r"""Observables of attractors against the swept parameter.

    Parameters
    ----------
    parameter : str
        Name of the parameter.
    values : (k,) array_like
        Values of the parameter, in the order of the sweep.
    observables : mapping of str to (k, n) array_like
        For each observable its numbers at each value; NaN where there are fewer than n.
    labels : sequence of str or OrbitLabel, optional
        One for each value, stored as text (the `name` of an OrbitLabel); or empty.
    symbols : mapping of str to str, optional
        Symbols of the parameter and the observables, written beside their names on the axes, in
        matplotlib's mathematical notation without dollar signs; an empty one writes none. Without
        it frequency, relative velocity and other usual names have the symbols of the paper.

    Raises
    ------
    ValueError
        When a value is not finite, lengths differ, or there is no observable.

    Examples
    --------
    >>> diagram = BifurcationDiagram(
    ...     "frequency",
    ...     [0.8, 0.9, 1.0, 1.1],
    ...     {"relative_velocity": [[0.2, 0.4], [0.3, 0.3], [0.3, 0.3], [0.1, 0.5]]},
    ...     labels=["P(2,1)", "P(1,1)", "P(1,1)", "P(2,1)"],
    ...     symbols={"frequency": r"\omega", "relative_velocity": "u"},
    ... )
    >>> diagram.intervals[1]
    LabelInterval(label='P(1,1)', low=0.9, high=1.0, count=2)
    >>> diagram.plot().get_ylabel()
    'relative velocity $u$'
    """

    _stored: ClassVar = (
        *("parameter", "values", "observables", "labels", "symbols", "cost", "error"),
    )
    parameter: str
    values: Array
    observables: Mapping[str, Array]
    labels: Sequence[str] = ()
    symbols: Mapping[str, str] = field(default_factory=dict)
    _sweep: Sweep | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        values = finite_array("values", self.values, (None,)).copy()
        of_type("observables", self.observables, Mapping, "arrays by name")
        if not self.observables:
            raise ValueError("observables must hold at least one; got none")
        observables = {
            name: _observed(name, numbers, len(values))
            for name, numbers in self.observables.items()
        }
        of_type("parameter", self.parameter, str, "a name")
        sequence = not isinstance(self.labels, str) and isinstance(self.labels, Sequence)
        if not sequence or not all(isinstance(one, str | OrbitLabel) for one in self.labels):
            raise ValueError(f"labels must be a sequence of labels or texts; got {self.labels!r}")
        of_type("symbols", self.symbols, Mapping, "texts by name")
        for name, symbol in self.symbols.items():
            of_type(f"symbols[{name!r}]", symbol, str, "a text")
        if len(self.labels) not in (0, len(values)):
            raise ValueError(
                f"labels must be one for each of {len(values)} values; got {len(self.labels)}"
            )
        for array in (values, *observables.values()):
            array.setflags(write=False)
        names = [getattr(label, "name", label) for label in self.labels]
        object.__setattr__(self, "labels", tuple(map(str, names)))
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "observables", MappingProxyType(observables))
        object.__setattr__(self, "symbols", MappingProxyType(dict(self.symbols)))

    @classmethod
    def of(
        cls, sweep: Sweep, *, labelled: bool = True, symbols: Mapping[str, str] | None = None
    ) -> BifurcationDiagram:
        """Return the diagram of a sweep with all its observables.

        Parameters
        ----------
        sweep : Sweep
        labelled : bool
            Whether to include the labels, which may have to be computed first.
        symbols : mapping of str to str, optional
            As for the class.
        """
        of_type("sweep", sweep, Sweep, "a Sweep")
        with_labels = boolean("labelled", labelled)
        return cls(
            sweep.parameter,
            sweep.values,
            {name: sweep.observable(name) for name in sweep.observables},
            labels=[label.name for label in sweep.labels] if with_labels else (),
            symbols=symbols or {},
            _sweep=sweep,
        )

    def __repr__(self) -> str:
        names, count = ", ".join(self.observables), len(self.values)
        labels = f"; {len(self.intervals)} intervals of labels" if self.intervals else ""
        values = f"{count} values of {self.parameter} {span(self.values)}"
        return f"<BifurcationDiagram of {names}: {values}{labels}>"

    def _facts(self) -> Facts:
        return {
            self.parameter: self.values,
            "observables": tuple(self.observables),
            "cost": self.cost,
        }

    def _tables(self) -> list[str]:
        rows = [(part.label, part.low, part.high, part.count) for part in self.intervals]
        heads = ("label", "from", "to", "values")
        return [table("Intervals of labels", rows, heads)] if rows else []

    @cached_property
    def error(self) -> Array:
        """Estimated error of the states at each value, (k,): `Sweep.error`.

        It is computed by simulation when it is read, and when the diagram is saved. It is zero for
        given numbers. A change of label is located only to within two successive values.
        """
        return np.zeros(len(self.values)) if self._sweep is None else self._sweep.error

    @cached_property
    def cost(self) -> Cost:
        """Cost of the sweep; zero for given numbers."""
        return Cost(0.0) if self._sweep is None else self._sweep.cost

    def dataset(self) -> Dataset:
        """Return the observables as a dataset over the parameter and ``state``."""
        over = self.parameter
        return Dataset(
            {over: (over, self.values)},
            {
                **{name: ((over, f"state of {name}"), x) for name, x in self.observables.items()},
                **({"label": (over, list(self.labels))} if self.labels else {}),
            },
            described("Bifurcation diagram", cost=self.cost, error="see Sweep.error"),
        )

    @cached_property
    def intervals(self) -> tuple[LabelInterval, ...]:
        """Intervals of constant label, in the order of the sweep; none without labels."""
        found = []
        for name, group in groupby(range(len(self.labels)), key=self.labels.__getitem__):
            members = self.values[list(group)]
            found.append(
                LabelInterval(name, float(members.min()), float(members.max()), len(members))
            )
        return tuple(found)

    def points(self, observable: str) -> tuple[Array, Array]:
        """Return the drawn points: parameter and observable, (p,) each, without NaN.

        Raises
        ------
        ValueError
            When there is no such observable.
        """
        return dots(self.values, self._numbers(observable))

    @print_style()
    def plot(
        self, ax: Axes | None = None, *, observable: str | None = None, size: float = 0.7
    ) -> Axes:
        """Draw an observable against the parameter, with the labels above where there is room.

        A bar above the axes changes between light and dark with every change of label. The dots are
        rasterized, so that vector files remain small.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        observable : str, optional
            Name of the observable; by default the first.
        size : float
            Diameter of a dot, in points.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When there is no such observable.
        """
        name = next(iter(self.observables)) if observable is None else observable
        titles = [axis_title(each, self.symbols) for each in (self.parameter, name)]
        axes = draw_diagram(ax, self.values, self._numbers(name), titles, size)
        if self.intervals:
            write_intervals(axes, self.intervals)
        return axes

    def _numbers(self, observable: str) -> Array:
        return self.observables[one_of("observable", observable, self.observables)]


def _observed(name: str, numbers: object, count: int) -> Array:
    unmasked(f"observables[{name!r}]", numbers)
    array = np.array(numbers, dtype=np.float64)
    if array.ndim != 2 or len(array) != count:
        raise ValueError(
            f"observables[{name!r}] must have shape ({count}, n), for any n; got shape "
            f"{array.shape}"
        )
    if np.isinf(array).any():
        raise ValueError(f"observables[{name!r}] must be finite or NaN; got an infinity")
    return array
