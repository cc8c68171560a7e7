"""Base class of branches and of curves of bifurcations."""

from __future__ import annotations

import dataclasses
import os
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.bifurcations.bifurcation import given
from dynkit.continuation.termination import Ending, Reason
from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, largest
from dynkit.core.validation import Array, index_in, of_type
from dynkit.data import store
from dynkit.data.dataset import Variables, described
from dynkit.data.result import Saved, read_result, write_result
from dynkit.orbits.equations import Problem, ProblemSolution

ERROR = (
    "to first order a bound on the distance from the exact curve, "
    "in ranges of parameters and typical sizes of unknowns; "
    "at a given value of the parameter orbits may be farther from the exact one"
)
"""Meaning of `error`."""


class SolutionCurve(Saved):
    """Solutions along a curve, in the order of the curve.

    A subclass must have the fields below, for k points, and implement:

    1. `_free`, the values (k,) of the free parameters, by name;
    2. `error`, (k,), with the meaning of `ERROR`;
    3. `system`, with the free parameters at any of their values.

    A subclass may implement:

    4. `_replaced`, the fields that change when a loaded curve gets its problem back.
    """

    label: str
    unknowns: Array
    admissible: NDArray[np.bool_]
    residuals: Array
    endings: tuple[Ending, Ending]
    cost: Cost
    error: Any
    _problem: Problem | None

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    @abstractmethod
    def _free(self) -> Mapping[str, Array]: ...

    @property
    @abstractmethod
    def system(self) -> Any:
        """The system, at one value of each free parameter.

        Raises
        ------
        ValueError
            When the curve was loaded without an orbit.
        """

    @property
    def problem(self) -> Problem:
        """The equations of the orbits.

        Raises
        ------
        ValueError
            When the curve was loaded without an orbit.
        """
        return given(self._problem, type(self).__name__)

    @property
    def closed(self) -> bool:
        """Whether the curve is closed; the last point then equals the first."""
        return self.endings[0].reason is Reason.CLOSED

    def __len__(self) -> int:
        return len(self.residuals)

    def orbit(self, place: int) -> Any:
        """Return the orbit, or equilibrium, of a point; a negative index counts from the end.

        Raises
        ------
        ValueError
            When there is no such point, or the curve was loaded without an orbit.
        """
        place = index_in("place", place, -len(self), len(self) - 1)
        p = np.array([column[place] for column in self._free.values()])
        return self.problem.solution(self.unknowns[place], p, (float(self.residuals[place]),))

    def _first(self) -> dict[str, float]:
        """Return the free parameters' values at the first point, by name."""
        return {name: float(column[0]) for name, column in self._free.items()}

    def _identity(self) -> dict[str, str]:
        """Return the entries of a store for the system with the parameters of the first point."""
        system = self.system.replace(**self._first())
        return {"system": store.kind_of(system), **store.identity_of(system)}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the curve to a store (HDF5). After a failure the old file remains.

        Raises
        ------
        ValueError
            When the file cannot be written, a field of the system cannot be stored, or the curve
            was loaded without an orbit.
        """
        write_result(path, self, self._identity())

    @classmethod
    def load(cls, path: str | os.PathLike[str], orbit: ProblemSolution | None = None) -> Self:
        """Read a curve from a store, bit for bit as it was written.

        Parameters
        ----------
        path : path
        orbit : PeriodicOrbit or Equilibrium, optional
            Any orbit with the same label of the same system, at any values of the free parameters.
            Methods that return orbits need it.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of such a curve, or the orbit has
            another label or system.
        """
        if orbit is not None:
            of_type("orbit", orbit, ProblemSolution, "a PeriodicOrbit or an Equilibrium")
        found, file, archive = read_result(path, cls)
        return found if orbit is None else found._with_orbits(file, archive, orbit, found._first())

    def _with_orbits(
        self, file: Path, archive: store.Archive, orbit: ProblemSolution, free: Mapping[str, float]
    ) -> Self:
        """Return a curve read from a store with the problem of an orbit.

        `free` are the values of the free parameters with which the store identifies its system.

        Raises
        ------
        ValueError
            When the orbit has another label or system than the store; the message names the
            difference.
        """
        if orbit.label != self.label:
            raise ValueError(f"store {file} was made with orbits {self.label}; got {orbit.label}")
        for name in free:
            if name not in orbit.system.parameters:
                raise ValueError(
                    f"store {file} was made with parameter {name}; got a system without it"
                )
        store.refuse_other_system(file, archive, orbit.system.replace(**free))
        problem, size = orbit.problem(*free), self.unknowns.shape[1]
        if problem.size != size:
            raise ValueError(f"store {file} was made with {size} unknowns; got {problem.size}")
        instance: Any = self  # a subclass is a dataclass
        found: Self = dataclasses.replace(instance, **self._replaced(problem, orbit))
        vars(found)["error"] = self.error
        return found

    def _replaced(self, problem: Problem, orbit: ProblemSolution) -> dict[str, Any]:
        del orbit
        return {"_problem": problem}

    def _checks(self) -> Variables:
        """Return residuals, and the error if it is known or can be computed, as variables."""
        found = {"residual": ("point", self.residuals)}
        if self._problem is not None or "error" in vars(self):
            found["error"] = "point", self.error
        return found

    def _attributes(self, title: str) -> dict[str, str | float]:
        return described(
            title,
            cost=self.cost,
            error=ERROR,
            system=None if self._problem is None else self.system,
            swept=tuple(self._free),
            begins_where=str(self.endings[0]),
            ends_where=str(self.endings[1]),
        )

    def _facts(self) -> Facts:
        return {
            "admissible": self.admissible,
            "begins where": self.endings[0],
            "ends where": self.endings[1],
            "residual": largest(self.residuals),
            "cost": self.cost,
        }
