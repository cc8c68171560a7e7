"""Networks of branches, and how they hang together."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from dynkit.continuation.bifurcations import Bifurcation
from dynkit.continuation.branch import Branch
from dynkit.continuation.membership import Trail
from dynkit.core.cost import Cost
from dynkit.core.validation import Array, finite_scalar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.problem import PeriodicOrbit


class Finish(Enum):
    """Why an exploration ended."""

    COMPLETE = "the search went to its end"
    BUDGET = "the budget was used up"
    INTERRUPTED = "it was interrupted"
    FAILED = "it failed"


@final
class Link(NamedTuple):
    """Which branch a bifurcation leads to: all by their numbers in `Network.branches`."""

    branch: int
    bifurcation: int
    to: int


@final
class Unexplored(NamedTuple):
    """What was left out: a bifurcation of a branch, by number, or orbits to start from.

    The branch is None, and the bifurcation too, where it is an orbit to start from.
    """

    branch: int | None
    bifurcation: int | None
    why: str


@final
@dataclass(frozen=True, eq=False, repr=False)
class Network:
    """Branches that were found by `explore`, and which bifurcations lead from one to another.

    Parameters
    ----------
    branches : tuple of Branch
        In the order in which they were found.
    links : tuple of Link
    unexplored : tuple of Unexplored
    finish : Finish
        Why the exploration ended.
    message : str
        The same in words, with what was left, and what was searched for orbits to start from.
    cost : Cost
    """

    branches: tuple[Branch, ...]
    links: tuple[Link, ...]
    unexplored: tuple[Unexplored, ...]
    finish: Finish
    message: str
    cost: Cost

    @cached_property
    def error(self) -> Array:
        """Largest error of a point of each branch, (b,): see `Branch.error`.

        To first order a bound on how far the branches may be from exact ones, in the range of the
        parameter and typical sizes of the unknowns. What is missing among them, `message` and
        `unexplored` say as far as it is known.
        """
        return np.array([branch.error.max() for branch in self.branches])

    @property
    def bifurcations(self) -> tuple[Bifurcation, ...]:
        """The bifurcations of all branches."""
        return tuple(b for branch in self.branches for b in branch.bifurcations)

    def find(self, label: str) -> tuple[Branch, ...]:
        """Return the branches of one label, such as ``P(1,3)``."""
        return tuple(branch for branch in self.branches if branch.label == label)

    def orbits(self, value: float, label: str | None = None) -> list[PeriodicOrbit]:
        """Return the orbits of the branches at a value of the parameter, solved for there.

        Parameters
        ----------
        value : float
        label : str, optional
            Of branches of this label only, such as ``P(1,3)``.

        Raises
        ------
        ValueError
            When the value is not finite, or branches were loaded without orbits.
        """
        at = finite_scalar("value", value)
        found = []
        for branch, trail in zip(self.branches, self._trails, strict=True):
            if label is not None and branch.label != label:
                continue
            p = np.array([at])
            found += [branch.problem.orbit(x, p, history) for x, history in trail.solutions(at)]
        return found

    @cached_property
    def _trails(self) -> list[Trail]:
        return [Trail(branch) for branch in self.branches]

    def __len__(self) -> int:
        return len(self.branches)

    def __repr__(self) -> str:
        labels = list(dict.fromkeys(branch.label for branch in self.branches))
        shown = ", ".join(labels[:6]) + (", ..." if len(labels) > 6 else "")
        return (
            f"<Network of {len(self.branches)} branches{' of ' if shown else ''}{shown}; "
            f"{len(self.bifurcations)} bifurcations, {len(self.links)} links; {self.message}>"
        )

    def _repr_html_(self) -> str:
        from dynkit.continuation.tables import network_table

        return network_table(self)

    def plot(self, ax: Axes | None = None, y: str | None = None) -> Axes:
        """Draw an observable of all branches against the parameter, and return the axes.

        Stable orbits are solid, unstable ones dashed, inadmissible ones dotted. The bifurcations of
        orbits that are motions of the system are circles, and as many carry their kinds as there is
        room for; those of other orbits are crosses.

        Parameters
        ----------
        ax : Axes, optional
            Where; a new figure otherwise.
        y : str, optional
            Name of an observable; the system's first one otherwise.

        Raises
        ------
        ValueError
            When there are no branches, or they were loaded without orbits.
        """
        from dynkit.continuation.network_drawing import draw_branches

        return draw_branches(self.branches, ax, y)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a store (HDF5); the file is the new one, or after any failure the old one.

        Raises
        ------
        ValueError
            When it cannot be written there.
        """
        from dynkit.continuation.network_archive import save_network

        save_network(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str], orbits: Sequence[PeriodicOrbit] = ()) -> Network:
        """Read it from a store: the same bits.

        Parameters
        ----------
        path : path
        orbits : sequence of PeriodicOrbit, optional
            One of each kind of orbit, at any value of the parameter. Branches of the other kinds
            are read as by `Branch.load` without an orbit.

        Raises
        ------
        ValueError
            When the file is missing, damaged or no store of a network, or the orbits are of another
            system.
        """
        from dynkit.continuation.network_archive import load_network

        return load_network(path, orbits)
