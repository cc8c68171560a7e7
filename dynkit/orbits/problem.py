"""The contract of periodicity: equations of periodic orbits, and the orbits."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, ClassVar, Self, final

import numpy as np

from dynkit.core.reprs import Facts, largest, told, written
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem, ProblemSolution
from dynkit.orbits.multiplier_errors import multiplier_errors
from dynkit.orbits.newton import NoSolution, orbit_bound
from dynkit.orbits.spectrum import Spectrum


def fractions(n: int) -> list[int]:
    """Return the proper divisors of n: after so many states an orbit of n may come again."""
    return [k for k in range(1, n // 2 + 1) if n % k == 0]


class PeriodicProblem(Problem):
    """A problem whose solutions are the periodic orbits of one kind in a family.

    A subclass must implement, beside the equations,

    1. ``linearization(x, p, multiplier)``, the derivative where disturbances return multiplied;
    2. ``multipliers(x, p)``, the Floquet multipliers;
    3. ``orbit(x, p, history)``, the orbit;
    4. ``doubled(x, disturbance)``, the problem of twice the period;

    and may offer

    5. ``factors(x, p)``, matrices whose product has these multipliers;
    6. ``shortest(x)`` and ``repetition(x)``, where orbits of a part of the period are solutions;
    7. ``returns(x, p)``, the map of returns, where it is not that of the orbit's system.
    """

    stability: ClassVar[Spectrum] = Spectrum.MULTIPLIERS

    @abstractmethod
    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        """Return D(multiplier), (m, m): the derivative where x(T) = x(0) is x(T) = mu x(0).

        D(1) is the derivative of F by x. A number mu is a Floquet multiplier of the orbit just
        where D(mu) is singular. Real for a real multiplier, else complex.
        """

    @final
    def pencil(self, x: Array, p: Array, value: complex) -> Any:
        return self.linearization(x, p, value)

    @abstractmethod
    def multipliers(self, x: Array, p: Array) -> Any:
        """Return the Floquet multipliers of a solution, complex, the largest modulus first."""

    @final
    def spectrum(self, x: Array, p: Array) -> Any:
        return self.multipliers(x, p)

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        """Return matrices (n, d, d) whose product, in the order of time, has these eigenvalues.

        And how wrong the entries of each may be, (n,). Multipliers that are zero by their nature
        need not be among the eigenvalues. None, unless a subclass knows the matrices.
        """
        return None

    def returns(self, x: Array, p: Array) -> tuple[Callable[[Array], Array], Array]:
        """Return the derivative, (d, d), of the map of returns as a function of the state.

        And the state, (d,), of the orbit. By default it is the system's, as many times as the orbit
        has states. For orbits that are motions of the system.
        """
        orbit = self.orbit(x, p)
        system, count = orbit.system, len(orbit.states)

        def jacobian(state: Array) -> Array:
            out = system.jacobian(state)
            for _ in range(count - 1):
                state = system.image(state)
                out = system.jacobian(state) @ out
            return out

        return jacobian, orbit.states[0]

    @abstractmethod
    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> PeriodicOrbit:
        """Return the orbit that a solution stands for; `history` as in `PeriodicOrbit`."""

    def solution(self, x: Array, p: Array, history: Sequence[float] = ()) -> PeriodicOrbit:
        return self.orbit(x, p, history)

    @abstractmethod
    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        """Return the problem of twice the period, this solution run through twice, and a direction.

        The direction is the disturbance (m,) of the first time, and its opposite the second time:
        with the null vector of D(-1) the tangent of the branch that leaves where the period
        doubles.
        """

    def shortest(self, x: Array) -> tuple[PeriodicProblem, Array]:
        """Return the orbit of a solution as one that is run through once, to rounding.

        This problem and the solution as they are, unless a subclass tells repetitions.
        """
        return self, x

    def repetition(self, x: Array) -> float:
        """Return how far a solution is from an orbit of a part of its period, run through again.

        The root mean square of what changes over that part, in units of `scale`, for the part with
        the least of it. Zero where it is such an orbit, infinite where none is possible.
        """
        return np.inf


def shortest(problem: Problem, x: Array) -> tuple[Problem, Array]:
    """Return any solution as one that is run through once: see `PeriodicProblem.shortest`."""
    return problem.shortest(x) if isinstance(problem, PeriodicProblem) else (problem, x)


def repetition(problem: Problem, x: Array) -> float:
    """Return how far any solution is from one of a part of its period; infinite without period."""
    return problem.repetition(x) if isinstance(problem, PeriodicProblem) else np.inf


class PeriodicOrbit(ProblemSolution):
    """A periodic orbit, stable or not, found by Newton's method.

    A subclass owes what is abstract here. Instances are immutable.
    """

    def _caption(self) -> str:
        return f"Periodic orbit {self.label}"

    def _facts(self) -> Facts:
        rows = zip(self.multipliers[:6], self.multipliers_resolved, strict=False)
        shown = ", ".join(written(complex(m)) if ok else "not resolved" for m, ok in rows)
        more = ", ..." if len(self.multipliers) > 6 else ""
        return {
            "system": told(self.system, 6),
            "stable": self.stable,
            "admissible": self.admissible,
            "multipliers": shown + more,
            "residual": largest(self.residual),
            "error": self.error,
            "cost": self.cost,
        }

    @property
    @abstractmethod
    def system(self) -> SmoothMap:
        """What moves, with the parameters of this orbit."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Its kind, such as ``P(2)`` or ``P(1,3)``."""

    @property
    @abstractmethod
    def states(self) -> Array:
        """Its states, (n, d), one after the other, read-only."""

    @property
    @abstractmethod
    def multipliers(self) -> Any:
        """Floquet multipliers, (d,) complex, the largest modulus first."""

    @cached_property
    def multipliers_error(self) -> Array:
        """Estimate of the error of each multiplier, (d,), read-only.

        Four times the largest change in some probes, which disturb the unknowns by their errors and
        the matrices whose product it is by theirs. Infinite where nothing is known, as where an
        impact only grazes. Whether a multiplier lies inside the unit circle is certain where its
        modulus is farther from one than that.
        """
        problem, x, none = self.problem(), self.unknowns, np.empty(0)
        try:
            moved = orbit_bound(problem, x, none)
        except NoSolution:
            moved = np.full(len(x), np.inf)
        error = multiplier_errors(problem, x, none, self.multipliers, moved)
        error.setflags(write=False)
        return error

    @cached_property
    def multipliers_resolved(self) -> Any:
        """Whether each multiplier, (d,) of bool, is larger than its error, or zero without error.

        Of a multiplier that is not resolved no digit is known, and not its sign: only that its
        modulus is at most the sum of its error and of the value given. Where that is below one the
        multiplier is certainly inside the unit circle.
        """
        error = self.multipliers_error
        resolved = (error < abs(self.multipliers)) | (error == 0.0)
        resolved.setflags(write=False)
        return resolved

    @property
    @final
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle, those not resolved among them."""
        return bool(np.all(abs(self.multipliers) < 1.0))

    @cached_property
    def isolated(self) -> bool:
        """Whether no multiplier is 1 within its error: no other orbit of its period is beside it.

        Otherwise it is one of a family at the same parameters, as where nothing damps a mode in
        resonance, or on the border where orbits meet, SN or BP: it cannot be told which.
        """
        return bool((abs(self.multipliers - 1.0) > self.multipliers_error).all())

    @property
    @abstractmethod
    def admissible(self) -> bool:
        """Whether it is a motion of the system; see `WatchedProblem.admissible`."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of the largest error of a coordinate of its states."""

    @abstractmethod
    def problem(self, *names: str) -> PeriodicProblem:
        """Return the equations that it solves, with the named parameters free."""

    @property
    def observables(self) -> Sequence[str]:
        """Names of what a diagram draws, the first by default: those of the system."""
        return self.system.observables
