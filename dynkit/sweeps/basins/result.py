"""The result of `basins`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, costing, line_of, table
from dynkit.core.validation import Array, index_in
from dynkit.dynamics.attractor import Attractor
from dynkit.engine.points import Rows
from dynkit.sweeps.basins.basin import Basin
from dynkit.sweeps.basins.classification import OTHER_ENDS, Look
from dynkit.sweeps.basins.matching import Found

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@final
class Basins:
    """Which start leads to which attractor, made by `dynkit.basins`.

    Examples
    --------
    >>> from dynkit import basins
    >>> from dynkit.systems import Logistic
    >>> found = basins(Logistic(rate=3.2), [[-0.1], [0.3], [0.5], [0.7]], progress=False)
    >>> found
    <Basins: 4 starts; P(2) 3, runs away 1>
    >>> found.numbers.tolist(), found.basins[0].fraction
    ([-2, 0, 0, 0], 0.75)
    >>> found.outcome(0)
    'runs away'
    """

    def __init__(
        self,
        look: Look,
        starts: Array,
        numbers: NDArray[np.int64],
        attractors: Sequence[Found],
        rows: Rows,
    ) -> None:
        self._look = look
        self._attractors = tuple(attractors)
        self._cost = rows.cost
        self._starts = starts
        self._numbers = numbers.reshape(starts.shape[:-1])
        self._numbers.setflags(write=False)

    @property
    def starts(self) -> Array:
        """The starts, (k1, k2, s) or (k, s), read-only."""
        return self._starts

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The number of each start's attractor, (k1, k2) or (k,), read-only.

        Attractors are numbered in the order of the first starts that lead to them. Numbers below
        zero stand for no attractor: -1 unsettled, -2 runs away, -3 comes to no next crossing, -4 no
        state of the system (such as one beyond the table), -5 cannot be followed.
        """
        return self._numbers

    @cached_property
    def basins(self) -> tuple[Basin, ...]:
        """The attractors that were found, by their numbers."""
        count = self._numbers.size
        out = []
        for number, found in enumerate(self._attractors):
            members = int((self._numbers == number).sum())
            part = members / count
            found.states.setflags(write=False)
            place = np.unravel_index(found.place, self._numbers.shape)
            out.append(
                Basin(
                    number,
                    found.label,
                    found.ending,
                    found.states,
                    tuple(int(i) for i in place),
                    members,
                    part,
                    float(np.sqrt(part * (1.0 - part) / count)),
                )
            )
        return tuple(out)

    @property
    def error(self) -> Array:
        """Standard errors of the basins' fractions, (number of basins,), of starts at random."""
        return np.array([basin.error for basin in self.basins])

    @property
    def cost(self) -> Cost:
        """Seconds of all workers, and counted work; what labels count is not in it."""
        return self._cost

    def __len__(self) -> int:
        return len(self._attractors)

    def __repr__(self) -> str:
        shown = [f"{basin.label} {basin.count}" for basin in self.basins]
        for number, text in OTHER_ENDS.items():
            count = int((self._numbers == number).sum())
            shown += [f"{text} {count}"] if count else []
        sizes = " x ".join(map(str, self._numbers.shape))
        return f"<Basins: {sizes} starts; {', '.join(shown)}>"

    def _repr_html_(self) -> str:
        facts: Facts = [
            ("system", line_of(self._look.system, "")),
            ("starts", " x ".join(map(str, self._numbers.shape))),
        ]
        facts += [
            (text, int((self._numbers == number).sum()))
            for number, text in OTHER_ENDS.items()
            if (self._numbers == number).any()
        ]
        rows = [(b.number, b.label, b.count, b.fraction, f"{b.error:.1e}") for b in self.basins]
        shown = table("Basins", [*facts, ("cost", costing(self.cost))])
        heads = ("attractor", "label", "starts", "fraction", "error")
        return shown + (table("Attractors", rows, heads) if rows else "")

    def outcome(self, *place: int) -> str:
        """Return what became of one start, in words.

        Raises
        ------
        ValueError
            When there is no such start.
        """
        number = int(self._numbers[self._place(place)])
        return OTHER_ENDS[number] if number < 0 else str(self._attractors[number].label)

    def attractor(self, *place: int) -> Attractor:
        """Return the attractor of one start: simulated again, the same bits.

        Raises
        ------
        ValueError
            When there is no such start, or it has no motion.
        """
        return self._look.motion(self._starts[self._place(place)])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the basins over the starts, and return the axes.

        Of starts in two directions, (k1, k2, s), the basins as regions, and the attractors of
        two-dimensional maps; of starts in a row, (k, s), the fractions with their standard errors.

        Parameters
        ----------
        ax : Axes, optional
            Where; a new figure of column width otherwise.
        """
        from dynkit.sweeps.basins.drawing import draw_basins

        return draw_basins(self.basins, self.starts, self.numbers, ax)

    def to_xarray(self) -> xarray.Dataset:
        """Return the number of each start's attractor, and what the attractors are, as a dataset.

        Dimensions are ``start``, or ``row`` and ``column`` of starts in two directions,
        ``coordinate`` of the starts, and ``attractor``.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        ImportError
            When xarray is not installed.
        """
        from dynkit.data.xarrays import dataset

        over = ("row", "column") if self._numbers.ndim == 2 else ("start",)
        return dataset(
            "Basins of attraction",
            {"attractor": ("attractor", np.arange(len(self)))},
            {
                "number": (over, self.numbers),
                "position": ((*over, "coordinate"), self.starts),
                "label": ("attractor", [str(basin.label) for basin in self.basins]),
                "count": ("attractor", [basin.count for basin in self.basins]),
                "fraction": ("attractor", [basin.fraction for basin in self.basins]),
                "error": ("attractor", self.error),
            },
            cost=self.cost,
            error="standard error of the fraction of starts that were drawn at random",
            system=self._look.system,
            facts={f"number_{number}": text for number, text in OTHER_ENDS.items()},
        )

    def _place(self, place: tuple[int, ...]) -> tuple[int, ...]:
        shape: tuple[int, ...] = self._numbers.shape
        inside = len(place) == len(shape)
        if not inside or any(not 0 <= i < k for i, k in zip(place, shape, strict=True)):
            raise ValueError(f"place must lie within {shape}; got {place}")
        for i, k in zip(place, shape, strict=True):
            index_in("place", i, 0, k - 1)
        return place
