"""Histograms: the density of an observable over the states of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.regimes import RegimeChange
from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.plotting.figures import ink, print_style, shown_axes
from dynkit.plotting.points import axis_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
@dataclass(frozen=True, eq=False, repr=False)
class Histogram(Saved):
    """The density of an observable over the states of a motion; made by `RunningHistogram`.

    Parameters
    ----------
    name : str
        Name of the observable.
    edges : (k + 1,) array
        Edges of the bins. A bin contains its lower edge; the last one also its upper edge.
    counts : (k,) array of int
        Number of states in each bin.
    outside : tuple of int
        Number of states below the first and above the last edge.
    error : (k,) array
        One standard error of each density, as an average over an infinite motion: it covers about
        68 %, and is not a bound. It comes from the slow waves in the batches, see
        `dynkit.analysis.averages`, and is at least that of one more state in the bin. Where the
        motion changes its regime it covers the densities before and after.
    change : RegimeChange or None
        The change of regime of the observable or its square.
    cost : Cost

    Examples
    --------
    >>> from dynkit.analysis import RunningHistogram
    >>> from dynkit.systems import Logistic
    >>> running = RunningHistogram("state[0]", low=0.0, high=1.0, bins=4)
    >>> for block in Logistic(rate=4.0).stream(start=[0.3], keep=30_000):
    ...     running.add(block)
    >>> histogram = running.result()
    >>> exact = np.diff(2.0 / np.pi * np.arcsin(np.sqrt(histogram.edges))) * 4.0
    >>> bool((abs(histogram.density - exact) < 3.0 * histogram.error).all())
    True
    """

    _stored: ClassVar = ("name", "edges", "counts", "outside", "error", "change", "cost")
    name: str
    edges: Array
    counts: NDArray[np.int64]
    outside: tuple[int, int]
    error: Array
    change: RegimeChange | None
    cost: Cost

    @property
    def states(self) -> int:
        """Number of all states."""
        return int(self.counts.sum()) + sum(self.outside)

    @property
    def density(self) -> Array:
        """Fraction of all states in each bin, divided by the width of the bin, (k,)."""
        return np.asarray(self.counts / (self.states * np.diff(self.edges)))

    def dataset(self) -> Dataset:
        """Return the density as a dataset over the middles of the bins."""
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        return Dataset(
            {self.name: ("bin", middle)},
            {"density": ("bin", self.density), "error": ("bin", self.error)},
            described(
                f"Histogram of {self.name}",
                cost=self.cost,
                error="one standard error, which covers about 68 %",
                below=float(self.outside[0]),
                above=float(self.outside[1]),
            ),
        )

    def __repr__(self) -> str:
        doubt = "" if self.change is None else f"; {self.change}"
        within = f"{len(self.counts)} bins from {self.edges[0]:g} to {self.edges[-1]:g}"
        return f"<Histogram of {self.name}: {self.states} states in {within}{doubt}>"

    @print_style()
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the density, with a band of one standard error on both sides.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        """
        axes = shown_axes(ax)
        low, high = self.density - self.error, self.density + self.error
        axes.stairs(high, self.edges, baseline=low, fill=True, color=ink(0.7))
        axes.stairs(self.density, self.edges, color=ink(), linewidth=0.6)
        axes.set(xlabel=axis_title(self.name), ylabel="density")
        return axes
