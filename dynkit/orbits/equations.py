"""The contract of equations whose solutions can be continued."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion
from dynkit.core.overriding import Extensible
from dynkit.core.validation import Array, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Result, SavedWithSystem
from dynkit.orbits.spectrum import Spectrum
from dynkit.viewer.series import Series

NOISE = 1e-13
"""Largest error of calls in the scaled equations: Newton's method ends at this level."""

_ROUNDING = 2.0**-52


class Problem(Extensible, ABC):
    """Equations F(x, p) = 0 whose solutions can be continued.

    There are m equations and m unknowns x. The k free parameters are p: one changes along a branch,
    two along a curve. The equations are smooth. Where they are not defined, every method may raise
    `NoMotion`.

    A subclass must implement the abstract methods; `FamilyProblem` implements most of them. Methods
    with a default may be overridden. `PeriodicProblem` adds properties of periodic orbits, and
    `WatchedProblem` adds events. `dynkit.testing.check_problem` tests a subclass against all of
    these contracts.
    """

    stability: Spectrum = Spectrum.EIGENVALUES
    """Kind of the numbers that `spectrum` returns."""

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
        """Values (k,) of the free parameters in the problem's system."""

    @property
    @abstractmethod
    def size(self) -> int:
        """The number m of equations and of unknowns."""

    @abstractmethod
    def scale(self, x: Array) -> Array:
        """Return typical sizes (m,), positive, of the unknowns: the units of arclength."""

    @abstractmethod
    def residual(self, x: Array, p: Array) -> Array:
        """Return F, (m,), each equation in units in which its rounding is about 1e-16."""

    @abstractmethod
    def linearization(self, x: Array, p: Array) -> Any:
        """Return the derivative, (m, m), of F by x."""

    @abstractmethod
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        """Return the derivative, (m, k), of F by the free parameters."""

    @abstractmethod
    def solution(self, x: Array, p: Array, history: Sequence[float] = ()) -> Any:
        """Return the `ProblemSolution` with these unknowns, parameters and history."""

    def observed(self, x: Array, p: Array, name: str) -> Array:
        """Return an observable, (n,), of a solution, equal to `ProblemSolution.observable`.

        A subclass may compute it without the `ProblemSolution`.
        """
        found: Array = self.solution(x, p).observable(name)
        return found

    def rounding(self, x: Array, p: Array) -> Array:
        """Return the rounding error of each equation, (m,); by default 16 roundings of one."""
        return np.full(self.size, 16.0 * _ROUNDING)

    def linearization_error(self, x: Array, p: Array) -> Any:
        """Return the error of the linearization, (m, m), beyond rounding; zero by default."""
        return 0.0

    def corrected(self, y: Array, scale: Array, row: Array, limits: tuple[float, int, int]) -> Any:
        """Return the result of Newton's method for (x, p) along a row; None where it is not known.

        See `dynkit.orbits.newton.Equations.corrected`. By default None.
        """
        return None

    def pencil(self, x: Array, p: Array, value: complex) -> Any:
        """Return D(value), (m, m), which is singular if and only if the value is in the spectrum.

        D(neutral value) is the `linearization`. D is real for a real value, otherwise complex. By
        default it is that of x' = F(x, p): the linearization minus the value.
        """
        matrix = np.asarray(self.linearization(x, p))
        return matrix - value * np.eye(len(matrix)) if value else matrix

    def spectrum(self, x: Array, p: Array) -> Any:
        """Return the numbers that determine stability, complex, the least stable first.

        By default they are the eigenvalues of the first of the `factors`.
        """
        found = np.linalg.eigvals(self._matrix(x, p)).astype(complex)
        return found[np.lexsort((-found.imag, -found.real))]

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        """Return matrices (n, d, d) whose product has this spectrum, and errors of entries (n,).

        The matrices are in the order of time. By default there is one: the linearization.
        Multipliers that are exactly zero may be missing among the eigenvalues. None where the
        matrices are not known.
        """
        matrix = np.asarray(self.linearization(x, p))
        off = 4.0 * _ROUNDING * float(abs(matrix).max(initial=0.0))
        return matrix[None], np.array([off + float(np.max(self.linearization_error(x, p)))])

    def shortest(self, x: Array) -> tuple[Problem, Array]:
        """Return problem and unknowns of the same orbit with its least period, to rounding.

        By default they are this problem and the same unknowns.
        """
        return self, x

    def departing(self, x: Array, way: float) -> tuple[Problem, Array]:
        """Return the problem of the branch that starts at a solution, and the unknowns in it.

        Another problem is needed where the free parameter separates events that coincide in the
        solution. `way` is positive for a branch to larger values of the parameter, otherwise
        negative. By default they are this problem and the same unknowns.
        """
        return self, x

    def repetition(self, x: Array) -> float:
        """Return the distance of a solution from the repetitions of orbits with a shorter period.

        It is the smallest root mean square of the changes over a fraction of the period, in units
        of `scale`: zero for a repeated orbit, infinite where none is possible.
        """
        return np.inf

    def _matrix(self, x: Array, p: Array) -> Array:
        known = self.factors(x, p)
        assert known is not None
        return np.asarray(known[0][0])

    def canonical(self, x: Array) -> Array:
        """Return unknowns, (m,), that are equal for equivalent solutions.

        Where several solutions describe the same orbit, they are the unknowns of one of them.
        """
        return x

    def apart(self, x: Array, other: Array) -> Array:
        """Return the difference of two solutions, (l,), in numbers of order one.

        It is zero for equivalent solutions, and continuous in `x` near such a solution.
        """
        here = self.canonical(other)
        return np.asarray((self.canonical(x) - here) / self.scale(here))

    def oscillation(
        self, x: Array, p: Array, frequency: float, mode: Any
    ) -> tuple[Problem, Array, Array] | None:
        """Return the orbits born at a Hopf bifurcation: their problem, a place and a direction.

        Near the bifurcation the unknowns of the orbits are the place plus multiples of the
        direction. `frequency` is that of the critical pair of eigenvalues, and `mode`, (m,)
        complex, their eigenvector. By default None: not known.
        """
        return None


class ProblemSolution(Extensible, Result, ABC):
    """A solution of the equations of a `Problem`, from which a branch can start.

    A subclass must implement the abstract properties and methods. Instances are immutable.
    """

    @property
    @abstractmethod
    def system(self) -> Any:
        """The system, a `Family`, with the parameters of this solution."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Kind of the solution."""

    @property
    def counts(self) -> Mapping[str, float]:
        """Numbers of events in a period, by kind of event; empty by default."""
        return {}

    @property
    @abstractmethod
    def stable(self) -> bool:
        """Whether disturbances decay."""

    @property
    @abstractmethod
    def admissible(self) -> bool:
        """Whether the solution is a motion of the system."""

    @property
    @abstractmethod
    def history(self) -> tuple[float, ...]:
        """Largest residual before the first and after each step of Newton's method."""

    @property
    @final
    def residual(self) -> float:
        """Largest residual after the last step of Newton's method, near rounding."""
        return self.history[-1]

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of the largest error of the solution."""

    @property
    @abstractmethod
    def cost(self) -> Cost:
        """Cost of the solution."""

    @abstractmethod
    def problem(self, *names: str) -> Problem:
        """Return the equations of the solution, with the named parameters free."""

    @property
    @abstractmethod
    def unknowns(self) -> Array:
        """The solution, (m,), of the equations of its `problem`."""

    @property
    @abstractmethod
    def observables(self) -> Sequence[str]:
        """Names of the observables; diagrams draw the first by default."""

    @abstractmethod
    def observable(self, name: str) -> Array:
        """Return one of the observables, (n,)."""

    def _series(self) -> Series | None:
        """Return the time series for pages in the browser; None for a solution at rest."""
        return None

    _each: ClassVar[str] = "state"
    """The dimension of the observables."""

    def _spectrum(self) -> Any:
        """Return the numbers that determine the stability, complex; none where undefined."""
        problem = self.problem()
        try:
            return problem.spectrum(self.unknowns, np.empty(0))
        except NoMotion:
            return np.empty(0, dtype=np.complex128)

    def dataset(self) -> Dataset:
        """Return the observables, the unknowns, and the multipliers or eigenvalues as a dataset.

        As in the dataset of a branch, the variable of eigenvalues is named ``multiplier``, too. It
        is empty where the system has no derivative. Dimensions are ``state`` (``impact`` for a
        machine), ``multiplier`` and ``unknown``.
        """
        return Dataset(
            {},
            {
                **{name: (self._each, self.observable(name)) for name in self.observables},
                "multiplier": ("multiplier", self._spectrum()),
                "unknowns": ("unknown", self.unknowns),
            },
            described(
                f"{self.label[:1].upper()}{self.label[1:]} of a system",
                cost=self.cost,
                error="estimate of the largest error of the solution",
                system=self.system,
                label=self.label,
                solution_error=self.error,
                residual=self.residual,
            ),
        )


class KeptSolution(ProblemSolution, SavedWithSystem):
    """A solution that consists of its problem, without free parameters, and its unknowns.

    Parameters
    ----------
    problem : Problem
    x : (m,) array
    history : sequence of float
    cost : Cost
    """

    _stored: ClassVar[tuple[str, ...]] = ("_problem", "_x", "_history", "_cost")
    _problem: Any
    _x: Array
    _history: tuple[float, ...]
    _cost: Cost

    def __init__(self, problem: Any, x: Array, history: Sequence[float], cost: Cost) -> None:
        self._problem = problem
        self._x = read_only(np.array(x, dtype=np.float64))
        self._history = tuple(history)
        self._cost = cost

    def __reduce__(self) -> tuple[Any, ...]:
        # through __init__, which makes the copied arrays read-only
        return type(self), (self._problem, self._x, self._history, self._cost)

    def _restored(self) -> Self:
        if self._x.shape != (self._problem.size,) or not self._history:
            sizes = f"{self._problem.size} unknowns and a residual"
            raise ValueError(f"{self._x.shape} unknowns, {self._history} residuals, not {sizes}")
        return self

    @property
    def history(self) -> tuple[float, ...]:
        return self._history

    @property
    def cost(self) -> Cost:
        return self._cost

    def problem(self, *names: str) -> Any:
        """Return the equations of the solution, with the named parameters free.

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
