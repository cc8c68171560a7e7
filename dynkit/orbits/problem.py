"""Periodic orbits, and the equations that a family of them solves."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, Tabled, largest, told, written
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.multiplier_errors import multiplier_errors
from dynkit.orbits.newton import NoSolution, orbit_bound

NOISE = 1e-13
"""Errors of calls are no larger than this in the equations: Newton's method ends in them."""


def fractions(n: int) -> list[int]:
    """Return the proper divisors of n: after so many states an orbit of n may come again."""
    return [k for k in range(1, n // 2 + 1) if n % k == 0]


@final
@dataclass(frozen=True)
class Event:
    """A number that changes its sign where a branch meets a border of its own kind.

    Parameters
    ----------
    kind : BifurcationKind
        GR or CB.
    part : int
        Which part of the orbit it belongs to.
    value : float
        Positive on the admissible side, zero on the border; infinite where there is nothing to
        watch, NaN where its sign would tell nothing.
    ends : bool
        Whether there are no such orbits beyond, admissible or not.
    """

    kind: BifurcationKind
    part: int
    value: float
    ends: bool = False


class Condition(ABC):
    """One equation more, g(x, e, p) = 0, that holds at a border, with e unknowns of its own.

    `size` = e + 1 equations in all.
    """

    unknowns: int
    """The number e of unknowns of its own."""
    unit: float = 1.0
    """What g is measured in."""
    noise: float = 0.0
    """What errors of calls leave in g."""
    unfolding: Any = None
    """What times the first of the own unknowns is added to the orbit's equations, (m,), or None."""
    rounding: float = 0.0
    """What rounding leaves in g / `unit`, where that is more than in the orbit's equations."""

    @abstractmethod
    def residual(self, x: Array, own: Array, p: Array) -> Array:
        """Return the equations, (e + 1,), at unknowns (m,), own ones (e,) and parameters (k,)."""


class Problem(ABC):
    """Equations F(x, p) = 0 whose solutions are the periodic orbits of one kind in a family.

    There are m equations and m unknowns x; p are the free parameters, k of them, of which one is
    followed along a branch and two along a curve. The equations are smooth. Where they are not
    defined, every method may raise `NoSolution`.

    A subclass owes what is abstract here.
    """

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

    def rounding(self, x: Array, p: Array) -> Array:
        """Return how wrong each of F, (m,), may be by rounding; 16 units by default."""
        return np.full(self.size, 16.0 * 2.0**-52)

    @abstractmethod
    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        """Return D(multiplier), (m, m): how disturbances that return multiplied change F.

        D(1) is the derivative of F by x. A number mu is a Floquet multiplier of the orbit just
        where D(mu) is singular. Real for a real multiplier, else complex.
        """

    def linearization_error(self, x: Array, p: Array) -> Any:
        """Return how wrong D, (m, m), may be beyond rounding; zero, unless a subclass knows."""
        return 0.0

    @abstractmethod
    def parameter_derivative(self, x: Array, p: Array) -> Array:
        """Return the derivative, (m, k), of F by the free parameters."""

    @abstractmethod
    def multipliers(self, x: Array, p: Array) -> Any:
        """Return the Floquet multipliers of a solution, complex, the largest modulus first."""

    def factors(self, x: Array, p: Array) -> tuple[Array, Array] | None:
        """Return matrices (n, d, d) whose product, in the order of time, has these eigenvalues.

        And how wrong the entries of each may be, (n,). Multipliers that are zero by their nature
        need not be among the eigenvalues. None, unless a subclass knows the matrices.
        """
        return None

    @abstractmethod
    def orbit(self, x: Array, p: Array, history: Sequence[float] = ()) -> PeriodicOrbit:
        """Return the orbit that a solution stands for; `history` as in `PeriodicOrbit`."""

    @abstractmethod
    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        """Return the problem of twice the period, this solution run through twice, and a direction.

        The direction is the disturbance (m,) of the first time, and its opposite the second time:
        with the null vector of D(-1) the tangent of the branch that leaves where the period
        doubles.
        """

    def events(self, x: Array, p: Array) -> list[Event]:
        """Return what is to be watched along a branch, always as many and in the same order.

        Nothing, unless a subclass tells; it then owes `condition`, too.
        """
        return []

    def condition(self, event: int, x: Array, p: Array) -> tuple[Condition, Array]:
        """Return what holds where event number `event` is zero, and a guess of its own unknowns.

        The guess is made from a solution nearby.
        """
        raise ValueError(f"event must be one of the events: there are none; got {event}")

    def admissible(self, x: Array, p: Array) -> bool:
        """Whether a solution is a motion of the system, and no impact was left out or pulls.

        All are, unless a subclass tells.
        """
        return True

    def touching(
        self,
        event: int,
        x: Array,
        own: Array,
        p: Array,
    ) -> Mapping[str, float]:
        """Return where and when it touches, by name, at a zero of event number `event`.

        `own` are the unknowns (e,) of the event's condition. Nothing, unless a subclass tells.
        """
        return {}

    def neighbours(
        self,
        event: int,
        x: Array,
        p: Array,
    ) -> list[tuple[Problem, Array, Array]]:
        """Return guesses of orbits of other kinds that meet this one at a zero of an event.

        Each is a problem with the same free parameters, unknowns and parameters. None, unless a
        subclass knows some.
        """
        return []

    def shortest(self, x: Array) -> tuple[Problem, Array]:
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

    def canonical(self, x: Array) -> Array:
        """Return numbers, (l,), of order one, that two solutions share if they are one orbit.

        Where the same orbit has several solutions, they are those of one of them.
        """
        return np.asarray(x / self.scale(x))

    def apart(self, x: Array, other: Array) -> Array:
        """Return how two solutions differ as orbits, (l,), in numbers of order one.

        Zeros where they are one orbit, whichever of its states comes first. It is continuous in `x`
        near such a solution.
        """
        return self.canonical(x) - self.canonical(other)


class PeriodicOrbit(Tabled, ABC):
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

    @property
    @abstractmethod
    def admissible(self) -> bool:
        """Whether it is a motion of the system; see `Problem.admissible`."""

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
        """Estimate of the largest error of a coordinate of its states."""

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

    @abstractmethod
    def observable(self, name: str) -> Array:
        """Return one of the system's observables, (n,): what a diagram draws."""
