"""Networks of branches, and the bifurcations that connect them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, final

import numpy as np

from dynkit.continuation.bifurcations.bifurcation import Bifurcation, shown
from dynkit.continuation.results.branch import Branch, of_bifurcations
from dynkit.continuation.results.membership import Trail
from dynkit.continuation.results.solution_curve import ERROR
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, span, table
from dynkit.core.validation import Array, finite_scalar, of_type
from dynkit.data.dataset import Dataset, Variables, described
from dynkit.data.result import Saved, read_result, write_result
from dynkit.orbits.equations import ProblemSolution
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

# Largest residual of a solution.
_SOLVED = 1e-8

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Finish(Enum):
    """Why an exploration ended."""

    COMPLETE = "the search went to its end"
    BUDGET = "the budget was used up"
    INTERRUPTED = "it was interrupted"
    FAILED = "it failed"


@final
class Link(NamedTuple):
    """The branch that a bifurcation leads to, by numbers in `Network.branches`."""

    branch: int
    bifurcation: int
    to: int


@final
class Unexplored(NamedTuple):
    """An unexplored bifurcation of a branch, by numbers, or an unexplored initial orbit.

    Branch and bifurcation are None for an initial orbit.
    """

    branch: int | None
    bifurcation: int | None
    why: str


@final
@dataclass(frozen=True, eq=False, repr=False)
class Network(Viewed, Saved):
    """Branches found by `explore`, and the bifurcations that lead from one to another.

    Parameters
    ----------
    branches : tuple of Branch
        The branches in the order in which they were found.
    links : tuple of Link
    unexplored : tuple of Unexplored
    finish : Finish
        Why the exploration ended.
    message : str
        The reason in words, the unexplored parts, and the extent of the search for initial orbits.
    cost : Cost
    """

    _stored: ClassVar = ("branches", "links", "unexplored", "finish", "message", "cost")
    branches: tuple[Branch, ...]
    links: tuple[Link, ...]
    unexplored: tuple[Unexplored, ...]
    finish: Finish
    message: str
    cost: Cost

    @cached_property
    def error(self) -> Array:
        """Largest error of a point of each branch, (b,): see `Branch.error`.

        It bounds, to first order, the distances from the exact branches, in the range of the
        parameter and typical sizes of the unknowns. It does not account for missing branches; see
        `message` and `unexplored`.
        """
        return np.array([branch.error.max() for branch in self.branches])

    @property
    def bifurcations(self) -> tuple[Bifurcation, ...]:
        """The bifurcations of all branches."""
        return tuple(b for branch in self.branches for b in branch.bifurcations)

    def find(self, label: str) -> tuple[Branch, ...]:
        """Return the branches with a label, such as ``P(1,3)``."""
        return tuple(branch for branch in self.branches if branch.label == label)

    def orbits(self, value: float, label: str | None = None) -> list[ProblemSolution]:
        """Return the orbits of the branches at a value of the parameter, by Newton's method.

        Parameters
        ----------
        value : float
        label : str, optional
            Label of the branches to search, such as ``P(1,3)``; by default all.

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
            found += [branch.problem.solution(x, p, history) for x, history in trail.solutions(at)]
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

    def _facts(self) -> Facts:
        return {
            "branches": len(self),
            "bifurcations": len(self.bifurcations),
            "links": len(self.links),
            "unexplored": len(self.unexplored),
            "finish": self.message,
            "cost": self.cost,
        }

    def _tables(self) -> list[str]:
        rows = [
            (number, branch.label, span(branch.parameter), shown(branch.bifurcations))
            for number, branch in enumerate(self.branches)
        ]
        heads = ("branch", "orbits", self._name, "bifurcations")
        return [table("Branches", rows, heads)] if rows else []

    @property
    def _name(self) -> str:
        return self.branches[0].name if self.branches else "parameter"

    def plot(self, ax: Axes | None = None, y: str | None = None) -> Axes:
        """Draw an observable of all branches against the parameter, and return the axes.

        As `Branch.plot`; labels of branches are written where there is room.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure.
        y : str, optional
            Name of an observable; by default the first one of all branches. For orbits and
            equilibria of a flow together it is the ``norm`` of the state, for orbits at the
            crossings of their planes.

        Raises
        ------
        ValueError
            When there are no branches or no such observable, or they were loaded without orbits.
        """
        from dynkit.continuation.results.drawing import draw_branches
        from dynkit.plotting.figures import COLUMN_WIDTH

        if not self.branches:
            raise ValueError("network must have a branch to be drawn; got none")
        lines = [branch._line(self._common if y is None else y) for branch in self.branches]
        return draw_branches(lines, ax, 2.0 * COLUMN_WIDTH, 4.2)

    @property
    def _common(self) -> str | None:
        """Name of the common observable, if it is not the first observable of each branch."""
        rows = [branch.orbit(0).observables for branch in self.branches]
        return "norm" if len({row[0] for row in rows}) > 1 else None

    def _page(self, motions: int) -> Page:
        from dynkit.continuation.results.viewing import page_of

        if not self.branches:
            raise ValueError("network must have a branch to be shown; got none")
        title = f"Network of {len(self)} branches, {len(self.bifurcations)} bifurcations"
        known = all(branch._problem is not None for branch in self.branches)
        return page_of(title, self.branches, self._common if known else None, motions)

    def dataset(self) -> Dataset:
        """Return the points of all branches, in their order, as a dataset.

        Dimensions are ``point``, ``bifurcation`` and ``link``; branches are numbered from zero.
        """
        each = "point"
        found = [(i, b) for i, branch in enumerate(self.branches) for b in branch.bifurcations]
        branches: Variables = {
            attribute: (each, _joined([getattr(branch, key) for branch in self.branches]))
            for attribute, key in {
                "stable": "stable",
                "admissible": "admissible",
                "residual": "residuals",
                "error": "error",
            }.items()
        }
        numbers = [np.full(len(branch), i) for i, branch in enumerate(self.branches)]
        labels = [np.full(len(branch), branch.label) for branch in self.branches]
        links = np.array(self.links, dtype=np.int64).reshape(-1, 3)
        return Dataset(
            {self._name: (each, _joined([branch.parameter for branch in self.branches]))},
            {
                "branch": (each, _joined(numbers)),
                "label": (each, _joined(labels)),
                **branches,
                "bifurcation_branch": ("bifurcation", np.array([i for i, _ in found], dtype=int)),
                **of_bifurcations([b for _, b in found]),
                **{
                    f"link_{key}": ("link", column)
                    for key, column in zip(Link._fields, links.T, strict=True)
                },
            },
            described("Network of branches", cost=self.cost, error=ERROR, message=self.message),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a store (HDF5). After a failure the old file remains.

        Raises
        ------
        ValueError
            When the file cannot be written, a field of the system cannot be stored, or the network
            was loaded without orbits.
        """
        write_result(path, self, self.branches[0]._identity() if self.branches else {})

    @classmethod
    def load(cls, path: str | os.PathLike[str], orbits: Sequence[ProblemSolution] = ()) -> Network:
        """Read a network from a store, bit for bit as it was written.

        Parameters
        ----------
        path : path
        orbits : sequence of ProblemSolution, optional
            One orbit of each label, at any value of the parameter. Branches with other labels are
            read as by `Branch.load` without an orbit.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of a network, or the orbits belong to
            another system.
        """
        if isinstance(orbits, ProblemSolution) or not isinstance(orbits, Iterable):
            raise ValueError(f"orbits must be a sequence of orbits; got {orbits!r}")
        given = list(orbits)
        for k, orbit in enumerate(given):
            of_type(f"orbits[{k}]", orbit, ProblemSolution, "a PeriodicOrbit or an Equilibrium")
        network, file, archive = read_result(path, cls)

        def with_its_orbits(branch: Branch) -> Branch:
            for orbit in given:
                if orbit.label == branch.label:
                    free = network.branches[0]._first()
                    found = branch._with_orbits(file, archive, orbit, free)
                    # orbits with one label may hit different stops
                    residual = found.problem.residual(found.unknowns[0], found.parameter[:1])
                    if abs(residual).max() < _SOLVED:
                        return found
            return branch

        branches = tuple(with_its_orbits(branch) for branch in network.branches)
        return dataclasses.replace(network, branches=branches)


def _joined(arrays: Sequence[Any]) -> Any:
    return np.concatenate(arrays) if arrays else np.empty(0)
