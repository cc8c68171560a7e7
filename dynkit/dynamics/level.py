"""Levels of first integrals on a section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.differences import numerical_derivative, parameter_difference
from dynkit.core.no_motion import Refused, replaced
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Flow

if TYPE_CHECKING:
    from dynkit.dynamics.section import PoincareSection

# Largest number of Newton's steps, and the rounding of an integral relative to its terms.
_STEPS, _ROUNDINGS = 50, 4.0 * 2.0**-52
# A change of an integral along a motion up to this, relative to its terms, is an error of the flow.
_DRIFT = 1e-6


@final
@dataclass(frozen=True, eq=False)
class Level:
    """States of a section at which a first integral of a flow has a given value.

    A state r near the level is moved onto the level along the gradient g of the integral at the
    state: the result is r + c g(r). In the terms of the reference, the multiple c is the unfolding
    parameter, and the value of the integral is the additional equation. On the level c is zero.

    Parameters
    ----------
    flow : Flow
    section : PoincareSection
    name : str
        One of the flow's `integrals`.
    value : float

    References
    ----------
    F. J. Munoz-Almaraz, E. Freire, J. Galan, E. Doedel, A. Vanderbauwhede, Continuation of periodic
    orbits in conservative and Hamiltonian systems, Physica D 181 (2003) 1-38.
    """

    flow: Flow
    section: PoincareSection
    name: str
    value: float

    def gradient(self, reduced: Array) -> Array:
        """Return the derivative, (d - 1,), of the integral by coordinates of the section."""
        full = self.flow.integral_gradient(self.name, self.section.lift(reduced))
        return np.asarray(self.section.lift_derivative(reduced).T @ full)

    def onto(self, reduced: Array) -> tuple[Array, float]:
        """Return the state on the level, (d - 1,), and the multiple c of the gradient.

        Raises
        ------
        Refused
            When there is no state of this level along the gradient.
        """
        way, here, multiple = self.gradient(reduced), reduced, 0.0
        for _ in range(_STEPS):
            full = self.section.lift(here)
            off = self.value - self.flow.integral(self.name, full)
            terms = abs(self.flow.integral_gradient(self.name, full)) @ abs(full)
            if abs(off) <= _ROUNDINGS * float(terms + abs(self.value)):
                return here, multiple
            slope = float(way @ self.gradient(here))
            if slope == 0.0 or not np.isfinite(off / slope):
                break
            multiple += off / slope
            here = reduced + multiple * way
        raise Refused(f"no state with {self.name} {self.value!r} is near {reduced.tolist()}")

    def require_constant(self, arrived: Array) -> None:
        """Raise ValueError if the integral has another value after a motion from the level."""
        value = self.flow.integral(self.name, arrived)
        terms = abs(self.flow.integral_gradient(self.name, arrived)) @ abs(arrived)
        most = max(_DRIFT, self.flow.accuracy**0.5) * float(terms + abs(self.value))
        if abs(value - self.value) > most:
            raise ValueError(
                f"{self.name} must be constant along motions, as one of the integrals; it went "
                f"from {self.value:.6g} to {value:.6g}, at {arrived.tolist()}"
            )

    def derivative(self, reduced: Array) -> Array:
        """Return the derivative, (d - 1, d - 1), of the state on the level by the state."""
        here, multiple = self.onto(reduced)
        bent = np.eye(len(reduced))
        if self._is_off(reduced, here):
            bent += multiple * numerical_derivative(self.gradient, reduced)[0]
        along, rows = self._along(reduced, here)
        return bent - np.outer(along, rows @ bent)

    def by_parameter(self, reduced: Array, parameter: str) -> Array:
        """Return the derivative, (d - 1,), of the state on the level by a parameter.

        The value of the integral is a parameter, too, with the integral's name.
        """
        here, multiple = self.onto(reduced)
        along, rows = self._along(reduced, here)
        if parameter == self.name:
            return along
        moved = np.zeros(len(reduced))
        if self._is_off(reduced, here):
            moved = multiple * parameter_difference(
                lambda value: Level(
                    replaced(self.flow, **{parameter: value}), self.section, self.name, self.value
                ).gradient(reduced),
                self.flow.value_of(parameter),
            )
        full = self.section.lift(here)
        change = self.flow.integral_parameter_derivative(self.name, full, parameter)
        return np.asarray(moved - along * (change + float(rows @ moved)))

    def _is_off(self, reduced: Array, here: Array) -> bool:
        """Whether the state is off the level by more than errors of the flow."""
        return float(abs(here - reduced).max()) > self.flow.accuracy * float(abs(here).max())

    def _along(self, reduced: Array, here: Array) -> tuple[Array, Array]:
        """Return the derivative of the state on the level by the value of the integral.

        Return also the gradient, (d - 1,), of the integral at the state on the level, `here`.
        """
        way, rows = self.gradient(reduced), self.gradient(here)
        return way / float(way @ rows), rows

    def frame(self, here: Array) -> Array:
        """Return orthonormal directions, (d - 1, d - 2), of the section within the level."""
        return np.linalg.qr(self.gradient(here)[:, None], mode="complete")[0][:, 1:]
