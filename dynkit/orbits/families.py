"""Problems of systems with named parameters, and their solutions."""

from __future__ import annotations

import copy
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion, replaced
from dynkit.core.parameters import Family
from dynkit.core.reprs import Facts, largest, system_repr, written
from dynkit.core.validation import Array, finite_array, of_type, one_of, read_only
from dynkit.data.result import read_result
from dynkit.data.store import Archive, at_parameters
from dynkit.orbits.equations import KeptSolution, Problem
from dynkit.orbits.multiplier_errors import multiplier_errors
from dynkit.orbits.solving import orbit_bound, solve

_NONE = np.empty(0)


class FamilyProblem(Problem):
    """Equations of a system with named parameters, any of which may be free.

    A subclass must implement `size`, `scale`, `residual`, `linearization` and
    `parameter_derivative`; ``self.at(p)`` is the system at parameters p. It may implement:

    1. `label`, the kind of the solutions;
    2. ``observables(x)``, observables of a solution, by name; by default each unknown;

    and the optional methods of `Problem`.

    Parameters
    ----------
    system : Family
    names : sequence of str
        The free parameters.

    Raises
    ------
    ValueError
        When the system has no such parameter.
    """

    def __init__(self, system: Any, names: Sequence[str] = ()) -> None:
        of_type("system", system, Family, "a Family")
        self._system: Any = system
        self._names = tuple(names)
        self._values = np.array([system.value_of(name) for name in names])
        self._at: tuple[bytes, Any] = (self._values.tobytes(), system)

    @property
    def label(self) -> str:
        """Kind of the solutions."""
        return "solution"

    @property
    def system(self) -> Any:
        """The system, whose parameters other than the free ones are fixed."""
        return self._system

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def free(self, *names: str) -> Self:
        return self._of(self._system, names)

    @property
    def values(self) -> Array:
        return self._values

    def at(self, p: Array) -> Any:
        """Return the system with the free parameters set.

        Raises
        ------
        Refused
            When the system refuses them.
        """
        key = np.asarray(p, dtype=np.float64).tobytes()
        if key != self._at[0]:
            values = dict(zip(self._names, np.asarray(p).tolist(), strict=True))
            self._at = (key, replaced(self._system, **values))
        return self._at[1]

    def observables(self, x: Array) -> Mapping[str, Array]:
        """Return the observables of a solution, by name: arrays (n,)."""
        return {f"unknown[{i}]": x[i : i + 1] for i in range(len(x))}

    def made(self, x: Array, history: Sequence[float], cost: Cost) -> FamilySolution:
        """Return the solution with these unknowns; the problem must not have free parameters."""
        return FamilySolution(self, x, history, cost)

    def solution(self, x: Array, p: Array, history: Sequence[float] = ()) -> Any:
        past = history or (float(abs(self.residual(x, p)).max()),)
        cost = Cost(0.0, {"newton steps": len(past) - 1})
        return self._of(self.at(p), ()).made(x, past, cost)

    def _of(self, system: Any, names: Sequence[str]) -> Self:
        changed = copy.copy(self)
        FamilyProblem.__init__(changed, system, names)
        return changed


class FamilySolution(KeptSolution):
    """A solution of a `FamilyProblem`, made by `find_solution` or taken from a branch."""

    _stored: ClassVar[tuple[str, ...]] = ("_x", "_history", "_cost")
    _given: ClassVar[str | None] = "_problem"

    @classmethod
    def load(cls, path: str | os.PathLike[str], problem: Any) -> Self:
        """Read a solution from a store, bit for bit as it was saved.

        Parameters
        ----------
        path : path
        problem : FamilyProblem
            The equations of the solution, at any values of the parameters of their system: the
            solution has those of the store.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of such a solution, or was made with
            another system or other equations.
        """
        of_type("problem", problem, FamilyProblem, "a FamilyProblem")

        def solved(file: Path, archive: Archive) -> FamilyProblem:
            found: FamilyProblem = problem._of(at_parameters(problem.system, file, archive), ())
            return found

        return read_result(path, cls, solved)[0]

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        return f"<{self.label} of {system_repr(self.system, 6)}: {kind}>"

    def _caption(self) -> str:
        return self.label.capitalize()

    def _facts(self) -> Facts:
        more = ", ..." if len(self.eigenvalues) > 6 else ""
        return {
            "system": system_repr(self.system, 6),
            "stable": self.stable,
            "eigenvalues": ", ".join(written(complex(v)) for v in self.eigenvalues[:6]) + more,
            "residual": largest(self.residual),
            "error": self.error,
            "cost": self.cost,
        }

    @property
    def system(self) -> Any:
        return self._problem.system

    @property
    def label(self) -> str:
        return str(self._problem.label)

    @property
    def stable(self) -> bool:
        """Whether all eigenvalues have negative real parts."""
        return bool(np.all(self._problem.stability.stable(self.eigenvalues)))

    @property
    def admissible(self) -> bool:
        return True

    @cached_property
    def eigenvalues(self) -> Any:
        """Eigenvalues, (m,) complex, read-only, the largest real part first.

        They determine stability where F is the rate of the state, x' = F(x, p).
        """
        return read_only(np.asarray(self._problem.spectrum(self._x, _NONE)))

    @cached_property
    def eigenvalues_error(self) -> Array:
        """Estimate of the error of each eigenvalue, (m,), read-only.

        It is four times the largest change in a few trials that disturb the unknowns and the
        entries of the linearization by their errors.
        """
        moved = orbit_bound(self._problem, self._x, _NONE)
        return read_only(multiplier_errors(self._problem, self._x, _NONE, self.eigenvalues, moved))

    @cached_property
    def error(self) -> float:
        """Bound of the largest error of an unknown, to first order.

        It is twice the inverse derivative times the sum of residual and rounding. Infinite where
        the derivative is singular.
        """
        return float(orbit_bound(self._problem, self._x, _NONE).max())

    @property
    def observables(self) -> Sequence[str]:
        return tuple(self._problem.observables(self._x))

    def observable(self, name: str) -> Array:
        """Return one of the observables, (n,).

        Raises
        ------
        ValueError
            When there is no such observable.
        """
        found = self._problem.observables(self._x)
        return np.asarray(found[one_of("name", name, list(found))])


def find_solution(problem: FamilyProblem, guess: Any) -> FamilySolution:
    """Return the solution of a problem that Newton's method finds from a guess.

    Parameters
    ----------
    problem : FamilyProblem
        It is solved at the parameters of its system.
    guess : (m,) array_like

    Returns
    -------
    FamilySolution
        `continue_orbit` follows it.

    Raises
    ------
    ValueError
        When the guess is not finite or of another shape.
    NoConvergence
        When Newton's method does not converge to a solution.

    Examples
    --------
    >>> from dynkit.core.parameters import Family
    >>> class Circle(Family):
    ...     radius: float = 1.0
    ...     x: float = 0.5
    >>> class OnCircle(FamilyProblem):
    ...     size = 1
    ...
    ...     def scale(self, y):
    ...         return np.ones(1)
    ...
    ...     def residual(self, y, p):
    ...         circle = self.at(p)
    ...         return y**2 + circle.x**2 - circle.radius**2
    ...
    ...     def linearization(self, y, p):
    ...         return np.array([2.0 * y])
    ...
    ...     def parameter_derivative(self, y, p):
    ...         circle = self.at(p)
    ...         known = {"x": 2.0 * circle.x, "radius": -2.0 * circle.radius}
    ...         return np.array([[known[name] for name in self.names]])
    >>> from dynkit import continue_orbit
    >>> point = find_solution(OnCircle(Circle()), [-1.0])
    >>> branch = continue_orbit(point, "x", bounds=(-2.0, 2.0))
    >>> branch.bifurcations
    (<SN at x 1>, <SN at x -1>)
    >>> branch.closed
    True
    """
    of_type("problem", problem, FamilyProblem, "a FamilyProblem")
    start = finite_array("guess", guess, (problem.size,))
    _require_equations(problem.free(), start)
    return solution_near(problem, start)


def solution_near(problem: FamilyProblem, start: Array) -> FamilySolution:
    """Return the solution near a start (m,), as `find_solution`, of equations known to be right."""
    began, fixed = time.perf_counter(), problem.free()
    x, history = solve(fixed, start, _NONE, what=f"no {fixed.label}")
    # set unknowns below their error to zero: otherwise rounding errors would become scales
    cleared = np.where(abs(x) <= orbit_bound(fixed, x, _NONE), 0.0, x)
    if abs(fixed.residual(cleared, _NONE)).max() <= history[-1]:
        x = cleared
    cost = Cost(time.perf_counter() - began, {"newton steps": len(history) - 1})
    return fixed.made(x, history, cost)


def _require_equations(problem: FamilyProblem, x: Array) -> None:
    """Raise ValueError where a method of a problem does not return an array of its shape."""
    m = problem.size
    try:
        for name, shape in (("scale", (m,)), ("residual", (m,)), ("linearization", (m, m))):
            found = getattr(problem, name)(x, *([] if name == "scale" else [_NONE]))
            real = isinstance(found, np.ndarray) and found.dtype.kind in "iuf"
            if not real or found.shape != shape:
                got = f"{found.dtype} {found.shape}" if hasattr(found, "dtype") else repr(found)
                raise ValueError(f"{name} must return an array {shape} of floats; got {got}")
    except NoMotion:  # the solution says why
        pass
