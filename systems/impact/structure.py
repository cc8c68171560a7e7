"""Structures under impacts: mass, damping, stiffness and contact, and what drives them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final
from weakref import WeakKeyDictionary

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.bases import Basis, basis_of
from dynkit.systems.impact.elements import Element, Regime
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.systems.structure.modes import Derivation


@final
class Structure:
    """What follows from mass, damping, stiffness and contact: shared by all other parameters.

    Attributes
    ----------
    seen : dict
        Modes that take part in the motion of some coordinates, filled by `free_mode`.
    """

    def __init__(self, given: Derivation, contact: int) -> None:
        self.mass = given.mass.dense
        self.damping = given.damping.dense
        self.stiffness = given.stiffness.dense
        self.contact = contact
        self.free = basis_of(given)
        self.size = len(self.mass)
        # A copy, as structures are kept for as long as `given` lives.
        self._given = replace(given)
        self.others = np.delete(np.arange(self.size), contact)
        self._stiffened: dict[tuple[bytes, float, float], Structure] = {}
        self.seen: dict[frozenset[bytes], Any] = {}

    def stiffened(self, row: Array, stiffness: float, damping: float) -> Structure:
        """The same with a spring and a dashpot more along a row (N,) of coordinates; kept."""
        if stiffness == damping == 0.0:
            return self
        key = row.tobytes(), stiffness, damping
        if key not in self._stiffened:
            along = np.outer(row, row)
            c, k = self.damping + damping * along, self.stiffness + stiffness * along
            self._stiffened[key] = Structure(
                Derivation.from_matrices(self.mass, c, k), self.contact
            )
        return self._stiffened[key]

    @cached_property
    def kick_velocity(self) -> Array:
        """Velocity changes (N,) of an impulse that changes the contact velocity by one."""
        response = np.linalg.solve(self.mass, np.eye(self.size)[self.contact])
        return np.asarray(response / response[self.contact])

    @cached_property
    def kick(self) -> Array:
        """(4, N) change of the coordinates by `kick_velocity`, then its low parts."""
        return self.free.kick(self.kick_velocity, self.contact)

    @cached_property
    def brief(self) -> Array:
        """(2, N) change of the coordinates by an `excursion`."""
        return self.free.coordinates(*self.excursion)

    @cached_property
    def stuck(self) -> Basis | None:
        """Basis of the structure whose contact coordinate is held; None when nothing is left."""
        if self.size == 1:
            return None
        return basis_of(self._given.without(self.contact))

    @cached_property
    def caught(self) -> Array:
        """(2 N - 2, 2 N) stuck coordinates of free ones, whose contact velocity is lost."""
        if self.stuck is None:
            return np.zeros((0, 2))
        x, v = self.free.units()
        v = v - np.outer(v[:, self.contact], self.kick_velocity)
        return flat(self.stuck.coordinates(x[:, self.others], v[:, self.others]))

    @cached_property
    def released(self) -> Array:
        """(2 N, 2 N - 2) free coordinates of stuck ones, the contact coordinate at zero."""
        if self.stuck is None:
            return np.zeros((2, 0))
        x, v = np.zeros((2, 2 * len(self.others), self.size))
        x[:, self.others], v[:, self.others] = self.stuck.units()
        return flat(self.free.coordinates(x, v))

    @cached_property
    def excursion(self) -> Array:
        """Changes (2, N) of positions and velocities by brief excursions of the contact coordinate.

        To leading order, where its time integral is one: the positions of the others jump by m^-1 f
        and their velocities by m^-1 (g - c m^-1 f), with f = -C k, g = -K k and k `kick_velocity`;
        m and c are the others' parts of M and C.
        """
        place = np.ix_(self.others, self.others)
        out = np.zeros((2, self.size))
        out[0, self.others] = x = self._answer(self.damping)
        out[1, self.others] = self._answer(self.stiffness) - np.linalg.solve(
            self.mass[place], self.damping[place] @ x
        )
        return out

    @cached_property
    def coupling(self) -> float:
        """Largest change by an `excursion`.

        Springs and dashpots may cancel, which leaves terms that are smaller by a power of the
        duration; what the springs do counts by itself, too.
        """
        largest = abs(self.excursion).max()
        if self.size > 1:
            largest = max(largest, abs(self._answer(self.stiffness)).max())
        # no other, or none that is tied to it: then the contact coordinate itself
        return float(largest) or 1.0

    def _answer(self, part: Array) -> Array:
        """Accelerations (N - 1,) of the others by their part of K k or C k, k `kick_velocity`."""
        place = np.ix_(self.others, self.others)
        forces = part[self.others] @ self.kick_velocity
        return np.asarray(-np.linalg.solve(self.mass[place], forces))


def flat(units: Array) -> Array:
    """Matrix (2 n, k) of the coordinates (k, 2, n) of k units."""
    return np.ascontiguousarray(units.reshape(len(units), -1).T)


_structures: WeakKeyDictionary[Any, dict[int, Structure]] = WeakKeyDictionary()


def structure_of(given: LagrangianStructure, contact: int) -> Structure:
    """The shared part, computed once for all oscillators of equal structure and contact."""
    known = _structures.setdefault(given._derivation, {})
    place = contact % given.degrees_of_freedom
    if place not in known:
        known[place] = Structure(given._derivation, place)
    return known[place]


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """What acts from outside at one frequency, phase' = frequency: forces on all coordinates (N,).

    Attributes
    ----------
    turns : bool
        Whether anything depends on the phase, these forces or motions of elements.
    """

    frequency: float
    harmonic: Any
    constant: Array
    turns: bool

    def pulled(self, element: Element, regime: Regime) -> Drive:
        """The same with what an element, which moves, adds to the forces."""
        k, c, row = regime.stiffness, regime.damping, element.row(len(self.constant))
        if k == c == 0.0:
            return self
        push = element.phasor * (k + 1j * self.frequency * c) * row
        constant = self.constant + k * element.offset * row
        return replace(self, harmonic=self.harmonic + push, constant=constant)
