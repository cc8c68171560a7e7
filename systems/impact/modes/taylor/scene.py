"""Data of the structures that Taylor's method follows: equations, forces, and elements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.structure import Excitation, independent

if TYPE_CHECKING:
    from dynkit.systems.structure.equations import Motion
    from dynkit.systems.structure.functions import CoordinateFunction


@final
@dataclass(frozen=True, eq=False)
class Scene:
    """A structure whose energies are not quadratic, its excitation, and its elements.

    Attributes
    ----------
    motion : Motion
    excitation : Excitation
    elements : tuple of Element
    curves : dict
        Functions of the coordinates along which elements act, by the numbers of these.
    normal : dict
        Number of the hard stop whose contact force is the normal force, by number of the friction.
    largest : float
        The larger one of the sizes of positions and velocities of the machine.
    """

    motion: Motion
    excitation: Excitation
    elements: tuple[Element, ...]
    curves: dict[int, CoordinateFunction]
    normal: dict[int, int]
    largest: float

    @property
    def size(self) -> int:
        """The number of coordinates, N."""
        return self.motion.equations.size

    @cached_property
    def sliders(self) -> tuple[int, ...]:
        """Numbers of the elements with sliders."""
        return tuple(k for k, element in enumerate(self.elements) if element.slider)

    @cached_property
    def parted(self) -> tuple[int, ...]:
        """Numbers of elements along functions, without sliders; their gaps are coordinates."""
        return tuple(k for k in self.curves if k not in self.sliders)

    @cached_property
    def rubs(self) -> tuple[int, ...]:
        """Numbers of the elements along rows that have a sticking regime."""
        sticks = [any(regime.sticks for regime in element.regimes) for element in self.elements]
        return tuple(k for k, rubs in enumerate(sticks) if rubs and k not in self.curves)

    @cached_property
    def dragged(self) -> tuple[int, ...]:
        """Numbers of `rubs` whose rows depend linearly on rows of stops and of earlier `rubs`."""
        stops = (k for k, e in enumerate(self.elements) if isinstance(e, HardStop) and not e.curved)
        order = (*stops, *self.rubs)
        kept = [order[i] for i in independent(self.rows[list(order)])]
        return tuple(k for k in self.rubs if k not in kept)

    @cached_property
    def rows(self) -> Array:
        """Rows (elements, N) along which the elements act; zero along functions."""
        rows = [element.row(self.size) for element in self.elements]
        return np.array(rows).reshape(-1, self.size)

    @cached_property
    def signs(self) -> Array:
        """Signs (elements,) of the elements."""
        return np.array([element.sign for element in self.elements])

    def rows_at(self, x: Array) -> Array:
        """The rows (elements, N) at positions (N,)."""
        rows = self.rows
        if self.curves:
            found = {k: function.gradient(x) for k, function in self.curves.items()}
            rows = rows.astype(np.result_type(rows, *found.values()))
            for k, row in found.items():
                rows[k] = row
        return rows

    def inertia(self, x: Array, phase: Any) -> tuple[Array, Array]:
        """Mass matrix (N, N), and rows of elements (elements, N), at positions (N,) and a phase.

        These and the numbers may be complex, for complex-step derivatives.
        """
        return self.motion.mass(x, phase), self.rows_at(x)

    def changed(self, numbers: Array) -> Scene:
        """The scene with imaginary changes of the numbers, of energies, then of functions."""
        count, own, curves = len(self.motion.numbers), self.motion, {}
        motion = type(own)(own.equations, own.numbers + 1j * numbers[:count])
        for k, function in self.curves.items():
            end = count + len(function.numbers)
            moved = function.numbers + 1j * numbers[count:end]
            curves[k], count = type(function)(function.form, moved), end
        return replace(self, motion=motion, curves=curves)

    def bends(self, x: Array, v: Array) -> Array:
        """Accelerations (elements,) along the elements that are due to velocities alone."""
        found = np.zeros(len(self.elements))
        for k, function in self.curves.items():
            found[k] = v @ function.bend(x, v)
        return found

    def forces(self, sine: float, cosine: float) -> Array:
        """Harmonic and constant forces (N,)."""
        own = self.excitation
        found = own.harmonic.real * sine + own.harmonic.imag * cosine + own.constant
        return np.asarray(found[: self.size])

    def gap(self, k: int, x: Array, v: Array, sine: Any, cosine: Any) -> tuple[Any, Any]:
        """Gap of an element and its rate, at positions and velocities (..., N)."""
        place, speed, _ = self.prescribed(k, sine, cosine)
        sign = self.elements[k].sign
        if k in self.curves:
            along = self.curves[k](x), (v * self.curves[k].gradient(x)).sum(axis=-1)
            return sign * (along[0] - place), sign * (along[1] - speed)
        return sign * (x @ self.rows[k] - place), sign * (v @ self.rows[k] - speed)

    def prescribed(self, k: int, sine: Any, cosine: Any) -> tuple[Any, Any, Any]:
        """Position, velocity and acceleration of an element along its row."""
        element, w = self.elements[k], self.excitation.frequency
        still = element.swing(sine, cosine)
        speed = element.swing_rate(w, sine, cosine) + element.drift
        return element.offset + still, speed, -w * w * still
