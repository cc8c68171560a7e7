"""Sensitive dependence on initial conditions, from two motions."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from dynkit.analysis.motions import attractor_of, going_on_for
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array, positive, positive_integer, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.dynamics.attractor import Attractor
from dynkit.plotting.figures import ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
class Sensitivity(Saved):
    """The distance of two motions that start close to each other on an attractor.

    All coordinates of the attractor's last state are changed by the same distance, and both states
    are iterated, as Cusumano and Bai did with 1e-8 for about 100 impacts.

    Parameters
    ----------
    attractor : Attractor or ImpactRecord
    distance : float
        Initial difference of every coordinate; positive, and more than the state's rounding.
    iterations : int
        Number of iterates.

    Raises
    ------
    ValueError
        When an argument is refused; when results are read, also when a motion ends.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, section 4.

    Examples
    --------
    >>> from dynkit import MapAttractor
    >>> from dynkit.systems import Logistic
    >>> for rate in (3.2, 4.0):
    ...     attractor = MapAttractor(Logistic(rate), [0.3], transient=200, iterations=1)
    ...     parting = Sensitivity(attractor)
    ...     print(parting.distances[-1] > 1e-3)
    False
    True
    """

    _stored: ClassVar = ("_name", "_iterations", "_run")
    _name: str
    _iterations: int

    def __init__(self, attractor: Attractor, distance: float = 1e-8, iterations: int = 100) -> None:
        source = attractor_of(attractor)
        self._start, self._system = np.asarray(source.states[-1]), source.system
        self._name = type(self._system).__name__
        self._distance = positive("distance", distance)
        if (self._start + self._distance == self._start).all():
            raise ValueError(
                f"distance must exceed the rounding of the state {self._start.tolist()}; "
                f"got {self._distance:g}"
            )
        self._iterations = positive_integer("iterations", iterations)

    @cached_property
    def _run(self) -> tuple[Array, float, Cost]:
        began = time.perf_counter()
        system, start = self._system, self._start
        with going_on_for(self._iterations):
            states = system.iterate(start, self._iterations)
            twin = system.iterate(start + self._distance, self._iterations)
        distances = read_only(np.linalg.norm(system.difference(twin, states), axis=1))
        known = float(system.call_errors(start[None]).max())  # may be absolute for a flow
        error = max(system.accuracy * float(abs(states).max()), known)
        error *= 2.0 * np.sqrt(states.shape[1])  # of both motions, in all coordinates
        cost = Cost(time.perf_counter() - began, {"iterates": 2 * self._iterations})
        return distances, error, cost

    @property
    def distances(self) -> Array:
        """Distances (iterations + 1,) of the two motions, at the start and after each iterate."""
        return self._run[0]

    @property
    def growth(self) -> float:
        """The last distance over the first."""
        return float(self.distances[-1] / self.distances[0])

    @property
    def error(self) -> float:
        """Estimate of the error that an iterate adds to a distance; it grows as the distance does.

        It is that of a call (`Map.accuracy`) in all coordinates of both motions.
        """
        return self._run[1]

    def dataset(self) -> Dataset:
        """Return the distances as a dataset over ``iterate``, numbered from 0."""
        return Dataset(
            {"iterate": ("iterate", np.arange(len(self.distances)))},
            {"distance": ("iterate", self.distances)},
            described(
                f"Distances of two motions of {self._name}",
                cost=self.cost,
                error="estimate of the error that a single iterate adds to a distance",
                iterate_error=self.error,
            ),
        )

    @property
    def cost(self) -> Cost:
        """Seconds, and iterates of both motions."""
        return self._run[2]

    def __repr__(self) -> str:
        name = self._name
        if "_run" not in vars(self):
            return f"<Sensitivity of {name}: {self._iterations} iterations, not computed yet>"
        first, last = self.distances[[0, -1]].tolist()
        return f"<Sensitivity of {name}: {first:.2g} to {last:.2g} in {self._iterations} iterates>"

    @print_style()
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distance against the number of iterates.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        """
        axes = shown_axes(ax)
        axes.plot(self.distances, color=ink())
        axes.set_yscale("log")
        axes.set(xlabel="iterates $n$", ylabel="distance")
        return axes
