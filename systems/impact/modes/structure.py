"""Structures with impacts: mass, damping, stiffness, contacts, held coordinates, excitation."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Regime
from dynkit.systems.impact.modes.bases import Basis, basis_of, row_by_row
from dynkit.systems.structure.double_double import DoubleDouble, add
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import (
    Traction,
    check_semidefinite,
    product_of,
    product_with,
)


@final
class Structure:
    """Data that follow from mass, damping and stiffness; shared by oscillators with equal ones.

    Attributes
    ----------
    mass, damping, stiffness : (N, N)
    size : int
    sliders : int
        Number of sliders, which are the last coordinates. They are massless, but the mass matrix
        has an uncoupled mass of one for each. Impacts do not move them.
    free : Basis
    seen, stuck : dict
        Caches: `seen` has the modes with a share in some rows, filled by `constrained.mode_of`;
        `stuck` has the structures with sticking rows, filled by `sticking.stuck`.
    """

    def __init__(self, given: Derivation, sliders: int = 0, free: Basis | None = None) -> None:
        if free is not None:
            self.free = free
        self.mass = given.mass.dense
        self.damping = given.damping.dense
        self.stiffness = given.stiffness.dense
        if given.traction is not None:
            along, damping, stiffness = given.traction
            self.damping = self.damping + along @ damping.high
            self.stiffness = self.stiffness + along @ stiffness.high
        self.size, self.sliders = len(self.mass), sliders
        # A copy: the cache of structures keeps them for as long as `given` itself exists.
        self._given = replace(given)
        self._stiffened: dict[tuple[tuple[bytes, float, float], ...], Structure] = {}
        self.stuck: dict[bytes, Structure] = {}
        self.seen: dict[Any, Any] = {}
        self.automata: dict[Any, Any] = {}

    @cached_property
    def free(self) -> Basis:
        """The basis of the free motion."""
        return basis_of(self._given)

    @kept
    def beside(self, sliders: int) -> Structure:
        """The same structure with sliders as further coordinates; cached."""
        if not sliders:
            return self
        beside = self.size + sliders
        m, c, k = np.zeros((3, beside, beside))
        for out, part in ((m, self.mass), (c, self.damping), (k, self.stiffness)):
            out[: self.size, : self.size] = part
        np.fill_diagonal(m[self.size :, self.size :], 1.0)
        return Structure(Derivation.from_matrices(m, c, k), sliders)

    @kept
    def without(self, places: NDArray[np.intp]) -> Structure | None:
        """The structure of the other coordinates while these are zero, or None; cached."""
        if len(places) == self.size:
            return None
        left = int((places >= self.size - self.sliders).sum())
        return Structure(self._given.without(places), self.sliders - left)

    def with_basis(self, basis: Basis) -> Structure:
        """The same structure with another basis."""
        other = copy.copy(self)
        vars(other).pop("_kept", None)  # cached contacts depend on the basis
        other.free, other.seen, other.automata = basis, {}, {}
        return other

    def stiffened(self, springs: Sequence[tuple[Array, float, float]]) -> Structure:
        """The same structure with further springs and dashpots along rows (N,); cached."""
        added = [(row, k, c) for row, k, c in springs if k or c]
        if not added:
            return self
        key = tuple((row.tobytes(), k, c) for row, k, c in added)
        if key not in self._stiffened:
            c, k = self._given.damping, self._given.stiffness
            for row, spring, dashpot in added:
                c, k = c.with_spring(row, dashpot), k.with_spring(row, spring)
            check_semidefinite("damping", c.dense)
            check_semidefinite("stiffness", k.dense)
            given = Derivation(self._given.mass, c, k, exact=False)
            self._stiffened[key] = Structure(given, self.sliders)
        return self._stiffened[key]

    @kept
    def dragged(self, along: Array, weights: Array) -> Structure:
        """The same structure with forces ``along @ weights @ (C x' + K x)`` added; cached."""
        traction = Traction.of(along, weights, self._given.damping, self._given.stiffness)
        return Structure(replace(self._given, traction=traction), self.sliders)

    def forces(self, of: Literal["stiffness", "damping"], x: Array) -> DoubleDouble:
        """Product (N, m) of stiffness or damping with columns (N, m), to double-double accuracy."""
        given = self._given
        product: DoubleDouble = getattr(given, of).times(x)
        if given.traction is not None:
            by = product_of(getattr(given.traction, of), x)
            product = add(product, product_with(given.traction.along, by))
        return product

    @kept
    def contact(self, row: Array) -> Contact:
        """The contact along a row (N,) of coordinates; cached."""
        return Contact(self, row)

    @kept
    def holding(self, rows: Array) -> Held:
        """The structure while rows (h, N) of coordinates are held; cached."""
        return Held(self._given, rows, self.sliders)


@final
class Held:
    """A structure with prescribed sums z = J x, J (h, N): h coordinates follow the others.

    The dependent coordinates are x_p = by_sums z + ties x_o.

    Attributes
    ----------
    others, pivots : (m,), (h,)
        Numbers of the independent and of the dependent coordinates.
    by_sums : (h, h)
    ties : (h, m), or None if x_p does not depend on x_o
    weights : (h, N)
        Forces along the rows J as combinations of the forces on the coordinates.
    structure : Structure or None
        Structure of the independent coordinates.
    """

    def __init__(self, given: Derivation, rows: Array, sliders: int) -> None:
        self.pivots = pivots = np.array(pivots_of(rows), dtype=np.intp)
        self.others = np.delete(np.arange(rows.shape[1]), pivots)
        self.by_sums: Array = np.asarray(np.linalg.inv(rows[:, pivots]), dtype=float)
        ties = -self.by_sums @ rows[:, self.others]
        self.ties = ties if ties.any() else None
        self.weights = np.zeros_like(rows)
        self.weights[:, pivots] = self.by_sums.T
        left = given.without(pivots, self.ties) if len(self.others) else None
        sliders -= int((pivots >= rows.shape[1] - sliders).sum())
        self.structure = None if left is None else Structure(left, sliders)

    def leaves(self, row: Array) -> Array:
        """Express a combination (N,) by independent coordinates, (m,); rounding becomes zero."""
        out = row[self.others]
        if self.ties is not None:
            out = out + row[self.pivots] @ self.ties
        return out if abs(out).max(initial=0.0) > ROUNDING * abs(row).max() else np.zeros_like(out)

    def put(self, x: Array, totals: Array) -> None:
        """Set the prescribed sums (..., h) of positions or velocities (..., N), in place."""
        x[..., self.pivots] = row_by_row(totals, self.by_sums)
        if self.ties is not None:
            x[..., self.pivots] += row_by_row(x[..., self.others], self.ties)


ROUNDING = 1e-12
"""Relative size below which a combination of coordinates, rates or forces counts as zero."""


def place_of(row: Array) -> int:
    """Index of the largest number in a row (N,), the last one if there are several."""
    return int(len(row) - 1 - np.argmax(abs(row[::-1])))


def pivots_of(rows: Array) -> list[int]:
    """Pivots (h,) of rows (h, N): index of the largest number after elimination."""
    left, found = rows.copy(), []
    for k, row in enumerate(left):
        found.append(place_of(row))
        left[k + 1 :] -= np.outer(left[k + 1 :, found[k]] / row[found[k]], row)
    return found


_INDEPENDENT = 1e-9
"""Smallest singular value of unit rows above which they count as linearly independent."""


def independent(rows: Array) -> list[int]:
    """Numbers of the first independent rows (k, N); all other rows are combinations of these."""
    lengths, found = np.linalg.norm(rows, axis=-1, keepdims=True), list[int]()
    units = rows / np.maximum(lengths, np.finfo(float).tiny)
    for k in range(len(rows)):
        sizes = np.linalg.svd(units[[*found, k]], compute_uv=False)
        if len(found) < len(sizes) and sizes[-1] > _INDEPENDENT:
            found.append(k)
    return found


@final
class Contact:
    """A row (N,) of a structure's coordinates along which a stop acts.

    Attributes
    ----------
    structure : Structure
    row : (N,)
    place : int
        Number of the coordinate with the largest entry in the row, which sections omit.
    others : (N - 1,)
        Numbers of all others.
    """

    def __init__(self, structure: Structure, row: Array) -> None:
        self.structure, self.row = structure, row
        self.place = place_of(row)
        self.others = np.delete(np.arange(structure.size), self.place)
        self._rest = row[None, self.others] if row[self.others].any() else None

    def put(self, x: Array, total: Any) -> None:
        """Set the row's sums (...) of positions or velocities (..., N) by a change of `place`."""
        if self._rest is not None:
            total = total - row_by_row(x[..., self.others], self._rest)[..., 0]
        x[..., self.place] = total / self.row[self.place]

    @cached_property
    def kick_velocity(self) -> Array:
        """Velocity changes (N,) of an impulse that changes the rate of the row by one."""
        return np.asarray(self.response / (self.row @ self.response))

    @cached_property
    def response(self) -> Array:
        """Velocity changes (N,) of a unit impulse along the row."""
        return np.asarray(np.linalg.solve(self.structure.mass, self.row), dtype=float)

    @cached_property
    def kick(self) -> Array:
        """Change (2, N) of the coordinates by `kick_velocity`, then its low parts: (4, N)."""
        return self.structure.free.kick(self.kick_velocity, self.row)

    @cached_property
    def brief(self) -> Array:
        """Change (2, N) of the coordinates by an `excursion`."""
        return self.structure.free.coordinates(*self.excursion)

    @cached_property
    def excursion(self) -> Array:
        """Changes (2, N) of positions and velocities by brief excursions of the sum J x.

        The changes are to leading order, for a time integral of the excursion of one. In
        coordinates of which J x is one, the positions of the others jump by m^-1 f and their
        velocities by m^-1 (g - c m^-1 f), with f = -C k, g = -K k and k `kick_velocity`; m and c
        are the others' parts of M and C.
        """
        place, (m, c, _) = np.ix_(self.others, self.others), self._matrices
        out = np.zeros((2, len(m)))
        out[0, self.others] = x = self._answer(1)
        out[1, self.others] = self._answer(2) - np.linalg.solve(m[place], c[place] @ x)
        out[:, self.place] = out @ self._back
        return out

    @cached_property
    def coupling(self) -> float:
        """Largest change of a position or velocity by an `excursion`.

        Effects of springs and dashpots may cancel to leading order; therefore the effect of the
        springs alone also counts.
        """
        largest = abs(self.excursion).max()
        if len(self.others):
            largest = max(largest, abs(self._answer(2)).max())
        # without other coordinates coupled to it: the contact coordinate itself
        return float(largest) or 1.0

    @cached_property
    def dragged(self) -> Array:
        """Changes (2, N) of positions and velocities by brief excursions due to impulses along J.

        To leading order, as for an `excursion`, but J x itself may change, too.
        """
        s, k = self.structure, self.kick_velocity
        x = -np.linalg.solve(s.mass, s.damping @ k)
        return np.stack([x, -np.linalg.solve(s.mass, s.stiffness @ k + s.damping @ x)])

    @property
    def _back(self) -> Array:
        """Row (N,) that gives coordinate `place` from the others and, by its own entry, J x."""
        back = -self.row / self.row[self.place]
        back[self.place] = 1.0 / self.row[self.place]
        return np.asarray(back)

    @cached_property
    def _matrices(self) -> list[Array]:
        """Mass, damping and stiffness in coordinates of which J x is one, at its place."""
        s, p, change = self.structure, self.place, self._back
        change[p] -= 1.0
        if not change.any():
            return [s.mass, s.damping, s.stiffness]
        half = [part + np.outer(part[:, p], change) for part in (s.mass, s.damping, s.stiffness)]
        return [part + np.outer(change, part[p]) for part in half]

    def _answer(self, part: int) -> Array:
        """Accelerations (N - 1,) of the others by C k (part 1) or K k (2), k `kick_velocity`."""
        place, kick = np.ix_(self.others, self.others), self.kick_velocity.copy()
        kick[self.place] = 1.0
        forces = self._matrices[part][self.others] @ kick
        forces[self.others >= self.structure.size - self.structure.sliders] = 0.0
        return np.asarray(-np.linalg.solve(self._matrices[0][place], forces))


_structures: WeakKeyDictionary[Any, Structure] = WeakKeyDictionary()


def structure_of(given: LagrangianStructure) -> Structure:
    """The structure of an oscillator, shared by all oscillators with equal matrices."""
    if given._derivation not in _structures:
        derivation = given._derivation
        smooth = derivation.motion is not None  # its modal basis is made only when needed
        _structures[derivation] = Structure(
            derivation, free=None if smooth else basis_of(derivation)
        )
    return _structures[given._derivation]


@final
@dataclass(frozen=True, eq=False)
class Excitation:
    """Harmonic and constant forces on all coordinates (N,); `frequency` is the rate of the phase.

    Attributes
    ----------
    turns : bool
        Whether forces or motions of elements depend on the phase.
    """

    frequency: float
    harmonic: Any
    constant: Array
    turns: bool

    def pulled(self, element: Element, regime: Regime) -> Excitation:
        """The same excitation plus the prescribed forces of an element in a regime."""
        k, c, row = regime.stiffness, regime.damping, element.row(len(self.constant))
        if k == c == regime.push == 0.0 or regime.anchored:
            return self
        push = element.phasor * (k + 1j * self.frequency * c) * row
        own = k * element.offset + c * element.drift + element.sign * regime.push
        constant = self.constant + own * row
        return replace(self, harmonic=self.harmonic + push, constant=constant)
