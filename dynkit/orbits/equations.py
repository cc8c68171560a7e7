"""The contract of equations: what a curve of solutions needs, whatever they stand for."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import Tabled
from dynkit.core.validation import Array
from dynkit.orbits.spectrum import Spectrum

NOISE = 1e-13
"""Errors of calls are no larger than this in the equations: Newton's method ends in them."""

_ROUNDING = 2.0**-52


class Problem(ABC):
    """Equations F(x, p) = 0 whose solutions can be continued.

    There are m equations and m unknowns x; p are the free parameters, k of them, of which one is
    followed along a branch and two along a curve. The equations are smooth. Where they are not
    defined, every method may raise `NoSolution`.

    A subclass must implement what is abstract here; `FamilyProblem` does most of it. What else it
    may offer says so. `PeriodicProblem` adds what periodic orbits have, and `WatchedProblem`
    events; `dynkit.testing.check_problem` runs a subclass through all contracts that it has.
    """

    stability: ClassVar[Spectrum] = Spectrum.EIGENVALUES
    """What `spectrum` returns."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, (k,)."""

    @abstractmethod
    def free(self, *names: str) -> Self:
        """Return the same problem with other parameters free; the rest keep their values."""

    @property
    @abstractmethod
    def values(self) -> Array:
        """Values (k,) of the free parameters in the system that the problem was made of."""

    @property
    @abstractmethod
    def size(self) -> int:
        """The number m of equations and of unknowns."""

    @abstractmethod
    def scale(self, x: Array) -> Array:
        """Typical sizes (m,), positive, of the unknowns: what an arclength is measured in."""

    @abstractmethod
    def residual(self, x: Array, p: Array) -> Array:
        """Return F, (m,), each equation in units in which rounding leaves about 1e-16."""

    @abstractmethod
    def linearization(self, x: Array, p: Array) -> Any:
        """Return the derivative, (m, m), of F by x."""

    @abstractmethod
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        """Return the derivative, (m, k), of F by the free parameters."""

    @abstractmethod
    def solution(self, x: Array, p: Array, history: Sequence[float] = ()) -> Any:
        """Return the `ProblemSolution` that unknowns stand for; `history` as there."""

    def rounding(self, x: Array, p: Array) -> Array:
        """Return how wrong each of F, (m,), may be by rounding; 16 units by default."""
        return np.full(self.size, 16.0 * _ROUNDING)

    def linearization_error(self, x: Array, p: Array) -> Any:
        """Return how wrong the derivative, (m, m), may be beyond rounding; zero by default."""
        return 0.0

    def pencil(self, x: Array, p: Array, value: complex) -> Any:
        """Return D(value), (m, m), which is singular just where the value is in the spectrum.

        At the neutral value of the spectrum it is the `linearization`. Real for a real value, else
        complex. By default it is that of x' = F(x, p): the linearization minus the value.
        """
        matrix = np.asarray(self.linearization(x, p))
        return matrix - value * np.eye(len(matrix)) if value else matrix

    def spectrum(self, x: Array, p: Array) -> Any:
        """Return the numbers that tell stability, complex; by default eigenvalues of `factors`.

        The least stable comes first.
        """
        found = np.linalg.eigvals(self._matrix(x, p)).astype(complex)
        return found[np.lexsort((-found.imag, -found.real))]

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        """Return matrices (n, d, d) whose product, in the order of time, has this spectrum.

        And how wrong the entries of each may be, (n,). By default it is the linearization.
        Multipliers that are zero by their nature need not be among the eigenvalues. None where the
        matrices are not known.
        """
        matrix = np.asarray(self.linearization(x, p))
        off = 4.0 * _ROUNDING * float(abs(matrix).max(initial=0.0))
        return matrix[None], np.array([off + float(np.max(self.linearization_error(x, p)))])

    def _matrix(self, x: Array, p: Array) -> Array:
        known = self.factors(x, p)
        assert known is not None
        return np.asarray(known[0][0])

    def canonical(self, x: Array) -> Array:
        """Return numbers, (l,), of order one, that two solutions share if they stand for the same.

        Where the same orbit has several solutions, they are those of one of them.
        """
        return np.asarray(x / self.scale(x))

    def apart(self, x: Array, other: Array) -> Array:
        """Return how two solutions differ, (l,), in numbers of order one.

        Zeros where they stand for the same. It is continuous in `x` near such a solution.
        """
        return self.canonical(x) - self.canonical(other)

    def oscillation(
        self, x: Array, p: Array, frequency: float, mode: Any
    ) -> tuple[Problem, Array, Array] | None:
        """Return what is born at a Hopf bifurcation: a problem of orbits, its place, a direction.

        The orbits shrink to the place, unknowns of that problem, along the direction. `frequency`
        is that of the critical pair of eigenvalues, and `mode`, (m,) complex, their eigenvector.
        None, unless a subclass knows.
        """
        return None


class ProblemSolution(Tabled, ABC):
    """A solution of the equations of a `Problem`: what is continued.

    A subclass must implement what is abstract here. Instances are immutable.
    """

    @property
    @abstractmethod
    def system(self) -> Any:
        """What the equations are those of, with the parameters of this solution: a `Family`."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Its kind."""

    @property
    @abstractmethod
    def stable(self) -> bool:
        """Whether disturbances decay."""

    @property
    @abstractmethod
    def admissible(self) -> bool:
        """Whether it is a motion of the system."""

    @property
    @abstractmethod
    def history(self) -> tuple[float, ...]:
        """Largest residual before the first and after each step of Newton's method."""

    @property
    @final
    def residual(self) -> float:
        """Largest residual that is left, near rounding."""
        return self.history[-1]

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of its largest error."""

    @property
    @abstractmethod
    def cost(self) -> Cost:
        """What it cost."""

    @abstractmethod
    def problem(self, *names: str) -> Problem:
        """Return the equations that it solves, with the named parameters free."""

    @property
    @abstractmethod
    def unknowns(self) -> Array:
        """The solution, (m,), of the equations of its `problem`."""

    @property
    @abstractmethod
    def observables(self) -> Sequence[str]:
        """Names of what a diagram draws, the first by default."""

    @abstractmethod
    def observable(self, name: str) -> Array:
        """Return one of the observables, (n,)."""


class KeptSolution(ProblemSolution):
    """A solution that is kept as its problem without free parameters, and its unknowns.

    Parameters
    ----------
    problem : Problem
    x : (m,) array
    history : sequence of float
    cost : Cost
    """

    def __init__(self, problem: Any, x: Array, history: Sequence[float], cost: Cost) -> None:
        self._problem = problem
        self._x = np.array(x, dtype=np.float64)
        self._x.setflags(write=False)
        self._history = tuple(history)
        self._cost = cost

    def __reduce__(self) -> tuple[Any, ...]:
        # Made anew: copies of arrays could be written to.
        return type(self), (self._problem, self._x, self._history, self._cost)

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @property
    def cost(self) -> Cost:
        return self._cost

    def problem(self, *names: str) -> Any:
        """Return the equations that it solves, with the named parameters free.

        Raises
        ------
        ValueError
            When the system has no such parameter.
        """
        return self._problem.free(*names)

    @property
    def unknowns(self) -> Array:
        """The solution, (m,), of the equations of its `problem`; read-only."""
        return self._x
