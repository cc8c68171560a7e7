"""Periodic orbits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.maps import Map
from dynkit.results import Cost
from dynkit.showing import Facts, costing, table, told, written
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.continuation.problem import Problem


class PeriodicOrbit(ABC):
    """A periodic orbit, stable or not, found by Newton's method.

    A subclass owes what is abstract here. Instances are immutable.
    """

    def _repr_html_(self) -> str:
        rows = zip(self.multipliers[:6], self.multipliers_resolved, strict=False)
        shown = ", ".join(written(complex(m)) if ok else "not resolved" for m, ok in rows)
        more = ", ..." if len(self.multipliers) > 6 else ""
        facts: Facts = [
            ("system", told(self.system, 6)),
            ("stable", "yes" if self.stable else "no"),
            ("admissible", "yes" if self.admissible else "no"),
            ("multipliers", shown + more),
            *self._facts(),
            ("residual", f"{self.residual:.1e}"),
            ("error", f"{self.error:.1e}"),
            ("cost", costing(self.cost)),
        ]
        return table(f"Periodic orbit {self.label}", facts)

    def _facts(self) -> Facts:
        """Rows of its table that a subclass adds."""
        return []

    @property
    @abstractmethod
    def system(self) -> Map:
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
        from dynkit.continuation.multiplier_errors import multiplier_errors_of

        error = multiplier_errors_of(self)
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
