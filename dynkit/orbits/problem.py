"""The contract of periodicity: equations of periodic orbits, and the orbits."""

# ruff: noqa: ARG002 (arguments that a default has no use for)

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Self, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.reprs import Facts, largest, system_repr, written
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, read_only
from dynkit.orbits.equations import Problem, ProblemSolution
from dynkit.orbits.multiplier_errors import multiplier_errors
from dynkit.orbits.solving import orbit_bound
from dynkit.orbits.spectrum import Spectrum
from dynkit.viewer.page import Page, page_of_section
from dynkit.viewer.series import Series, series_of_states
from dynkit.viewer.viewing import Viewed


class PeriodicProblem(Problem):
    """A problem whose solutions are the periodic orbits of one kind in a family.

    A subclass must implement, in addition to the equations:

    1. ``linearization(x, p, multiplier)``, the derivative D(mu) for x(T) = mu x(0);
    2. ``multipliers(x, p)``, the Floquet multipliers;
    3. ``orbit(x, p, history)``, the orbit;
    4. ``doubled(x, disturbance)``, the problem of twice the period.

    A subclass may implement:

    5. ``factors(x, p)``, matrices whose product has these multipliers;
    6. ``shortest(x)`` and ``repetition(x)``, when orbits of shorter periods are solutions;
    7. ``returns(x, p)``, when the return map is not that of the orbit's system.
    """

    stability: Spectrum = Spectrum.MULTIPLIERS

    @abstractmethod
    def linearization(self, x: Array, p: Array, multiplier: complex = 1.0) -> Any:
        """Return D(mu), (m, m): the derivative of F by x with x(T) = mu x(0) for x(T) = x(0).

        D(1) is the derivative of F by x. A number mu is a Floquet multiplier of the orbit if and
        only if D(mu) is singular. D is real for a real multiplier, otherwise complex.
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
        """Return matrices (n, d, d) whose product has these multipliers, and their errors (n,).

        The matrices are in the order of time; the errors are those of their entries. Multipliers
        that are exactly zero may be missing among the eigenvalues. By default None: not known.
        """
        return None

    def returns(self, x: Array, p: Array) -> tuple[Callable[[Array], Array], Array]:
        """Return the derivative, (d, d), of the return map as a function of the state, and a state.

        The state, (d,), is one of the orbit. By default the return map is the system's map,
        iterated as many times as the orbit has states. The orbit must be a motion of the system.
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
        """Return the orbit of a solution; `history` as in `PeriodicOrbit`."""

    def solution(self, x: Array, p: Array, history: Sequence[float] = ()) -> PeriodicOrbit:
        return self.orbit(x, p, history)

    @abstractmethod
    def doubled(self, x: Array, disturbance: Array) -> tuple[Self, Array, Array]:
        """Return the problem of twice the period, two periods of this solution, and a direction.

        The direction is the disturbance (m,) in the first period and its opposite in the second.
        For the null vector of D(-1) it is the tangent of the branch that leaves at a period
        doubling.
        """


class PeriodicOrbit(Viewed, ProblemSolution):
    """A periodic orbit, stable or unstable, found by Newton's method.

    A subclass must implement the abstract properties and methods. Instances are immutable.
    """

    def _caption(self) -> str:
        return f"Periodic orbit {self.label}"

    def _facts(self) -> Facts:
        rows = zip(self.multipliers[:6], self.multipliers_resolved, strict=False)
        shown = ", ".join(written(complex(m)) if ok else "not resolved" for m, ok in rows)
        more = ", ..." if len(self.multipliers) > 6 else ""
        return {
            "system": system_repr(self.system, 6),
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
        """The map of the orbit, with the parameters of this orbit."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Label of the orbit, such as ``P(2)`` or ``P(1,3)``."""

    @property
    @abstractmethod
    def states(self) -> Array:
        """The states of the orbit, (n, d), in their order, read-only."""

    @property
    @abstractmethod
    def multipliers(self) -> Any:
        """Floquet multipliers, (d,) complex, the largest modulus first."""

    @cached_property
    def multipliers_error(self) -> Array:
        """Estimate of the error of each multiplier, (d,), read-only.

        It is four times the largest change in a few trials that disturb the unknowns and the
        factors of the product by their errors. It is infinite where it is not known, for example at
        a grazing impact. A multiplier is certainly inside the unit circle, or certainly outside,
        when its modulus differs from one by more than this error.
        """
        problem, x, none = self.problem(), self.unknowns, np.empty(0)
        try:
            moved = orbit_bound(problem, x, none)
        except NoMotion:
            moved = np.full(len(x), np.inf)
        return read_only(multiplier_errors(problem, x, none, self.multipliers, moved))

    @cached_property
    def multipliers_resolved(self) -> Any:
        """Whether each multiplier, (d,) of bool, is larger than its error, or zero without error.

        No digit of a multiplier that is not resolved is known, and not even its sign: its modulus
        is at most the sum of value and error. Where this sum is below one the multiplier is
        certainly inside the unit circle.
        """
        error = self.multipliers_error
        return read_only((error < abs(self.multipliers)) | (error == 0.0))

    @property
    @final
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle, including those not resolved.

        On a level of a first integral, whether none lies outside: linearly stable.
        """
        return bool(np.all(self.problem().stability.stable(self.multipliers)))

    @cached_property
    def isolated(self) -> bool:
        """Whether no multiplier is 1 within its error: no other orbit of this period is near.

        If it is False, the orbit may belong to a continuous family at the same parameters, as for
        an undamped mode in resonance, or be at a bifurcation SN or BP.
        """
        return bool((abs(self.multipliers - 1.0) > self.multipliers_error).all())

    @property
    @abstractmethod
    def admissible(self) -> bool:
        """Whether the orbit is a motion of the system; see `WatchedProblem.admissible`."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of the largest error of a coordinate of the states."""

    @abstractmethod
    def problem(self, *names: str) -> PeriodicProblem:
        """Return the equations of the orbit, with the named parameters free."""

    def _series(self) -> Series:
        return series_of_states(self.system, self.states, periodic=True)

    def _page(self, motions: int) -> Page:
        look = "stable" if self.stable else "unstable"
        look, title = look if self.admissible else "inadmissible", self._caption()
        return page_of_section(title, self, lambda _: self._series(), motions, look)

    @property
    def observables(self) -> Sequence[str]:
        """Names of the system's observables; diagrams draw the first by default."""
        return self.system.observables
