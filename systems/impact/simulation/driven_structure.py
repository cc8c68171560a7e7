"""A structure with its excitation and its elements: parameters, checked and composed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, ClassVar, cast, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    check_fields,
    finite_array,
    finite_scalar,
    index_in,
    non_negative,
    one_of,
    positive,
    positive_integer,
    regular_array,
    unmasked,
)
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.elements.laws import ImpactLaw, checked_restitution
from dynkit.systems.impact.elements.parameters import check_curved, checked_elements, names_of
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.curves import Along, CurvedContact
from dynkit.systems.impact.modes.progression import Progression, directions
from dynkit.systems.impact.modes.structure import (
    Contact,
    Excitation,
    Structure,
    place_of,
    structure_of,
)
from dynkit.systems.impact.simulation.automaton import Automaton
from dynkit.systems.impact.simulation.crossed import Crossed
from dynkit.systems.impact.simulation.joined_modes import cycled_by, halts
from dynkit.systems.impact.simulation.rebounding import Rebounding
from dynkit.systems.impact.simulation.regimes import Parts
from dynkit.systems.structure.energies import NotQuadraticError
from dynkit.systems.structure.equations import (
    derivation_of,
    has_arguments_of_its_own,
    small_oscillations,
)
from dynkit.systems.structure.functions import CoordinateFunction, function_of
from dynkit.systems.structure.lagrangian import (
    LagrangianStructure,
    shared_derivation,
    watched,
)
from dynkit.systems.structure.modes import Derivation

_OF_STOP = "restitution", "amplitude", "offset", "side"
OF_TABLE = (*_OF_STOP, "contact", "play")
"""Parameters of the table; if there are elements, they are those of the first `HardStop`."""


@dataclass(frozen=True, kw_only=True)
class DrivenStructure(LagrangianStructure):
    """A structure with its forces and elements; see `ImpactOscillator` for the parameters.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.
    """

    frequency: float
    restitution: float | Any = 0.85  # or an ImpactLaw
    amplitude: float = 0.1
    offset: float = 0.0
    contact: int = -1
    side: str = "above"
    play: float = math.inf
    harmonic_forces: Any = ()  # kept as tuples
    constant_forces: Any = ()
    chatter_tolerance: float = 1e-16
    elements: Any = ()  # kept as a tuple

    structure_independent: ClassVar[frozenset[str]] = frozenset(
        (
            *OF_TABLE,
            *("frequency", "harmonic_forces", "constant_forces", "chatter_tolerance", "elements"),
        )
    )

    def __post_init__(self) -> None:
        if not isinstance(self.elements, tuple) or self.elements:
            self._compose()
        check_fields(self, frequency=positive, restitution=checked_restitution)
        check_fields(self, amplitude=non_negative, offset=finite_scalar)
        play: Any = self.play
        if not (isinstance(play, Real) and play == math.inf):
            check_fields(self, play=positive)
        one_of("side", self.side, ("above", "below"))
        check_fields(self, chatter_tolerance=non_negative)
        n = positive_integer("degrees_of_freedom", self.degrees_of_freedom)
        self._set("contact", index_in("contact", self.contact, -n, n - 1))
        for name, kind in (("harmonic_forces", complex), ("constant_forces", float)):
            self._set(name, _forces(name, getattr(self, name), n, kind))

    def _compose(self) -> None:
        """Set the parameters of the table from the first hard stop of the elements."""
        elements = checked_elements(self.elements, self.degrees_of_freedom)
        stop = next((element for element in elements if isinstance(element, HardStop)), None)
        own = {entry.name: entry.default for entry in fields(self) if entry.name in OF_TABLE}
        if stop is not None:
            own |= {name: getattr(stop, name) for name in _OF_STOP}
            own["contact"] = place_of(stop.row(self.degrees_of_freedom))
        check_curved(self, elements)
        for entry in (entry for entry in fields(self) if entry.name in own):
            given, taken = getattr(self, entry.name), own[entry.name]
            if given not in (entry.default, taken):
                raise ValueError(f"{entry.name} must not be given beside elements; got {given!r}")
            self._set(entry.name, taken)
        self._set("elements", elements)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    @property
    @final
    def dimension(self) -> int:
        """Number of section coordinates: 2N, and one for each slider of a `Jenkins` element.

        It is one less for an undriven machine whose section is an event of an element along a row.
        It is two more if a hard stop acts along a function of the coordinates: then all positions
        and velocities are kept.
        """
        fixed = self._cycled and not self._framed
        more = 2 * self._bent + len(self._sliders) - fixed
        return 2 * self.degrees_of_freedom + more

    @property
    @final
    def natural_frequencies(self) -> Array:
        """Natural frequencies of the structure in free flight, undamped, ascending, (N,).

        If the energies are not quadratic, they are those of small oscillations about zero.
        """
        return self.modes.frequencies

    @property
    @final
    def modal_matrix(self) -> Array:
        """Mass-normalised modal matrix, (N, N), one mode per column, its last row not negative.

        If the energies are not quadratic, it is that of small oscillations about zero.
        """
        if self._motion is not None:
            return small_oscillations(self.mass, self.stiffness)
        return self.modes.matrix

    @property
    @final
    def engine(self) -> str:
        """Engine that computes the motions: ``"exponential sums"``, or ``"Taylor"``.

        Exponential sums are for quadratic energies; they are exact to rounding and miss no impact.
        Taylor's method is for energies of any other smooth form, and for elements along functions
        of the coordinates.

        Raises
        ------
        ValueError, TypeError
            When an energy is neither quadratic nor smooth.
        """
        return "exponential sums" if self._motion is None else "Taylor"

    def _examine(self) -> None:
        _ = self._derivation

    @property
    def _motion(self) -> Any:
        """The equations of motion for Taylor's method; None for exponential sums."""
        return self._derivation.motion

    def _derive(self) -> Derivation:
        if not has_arguments_of_its_own(self):
            try:
                return super()._derive()
            except NotQuadraticError:
                pass
        return derivation_of(self, self.degrees_of_freedom)

    @cached_property
    def _derivation(self) -> Derivation:
        # Equal structures share a derivation, but not one that depends on functions of elements.
        if self._curves:
            return derivation_of(watched(self), self.degrees_of_freedom)
        return shared_derivation(self)

    @cached_property
    def _curves(self) -> dict[int, CoordinateFunction]:
        """Functions of the coordinates along which elements act, by the number of the element."""
        n = self.degrees_of_freedom
        named = ((k, e.coordinate) for k, e in enumerate(self._elements) if e.curved)
        return {k: function_of(watched(self), name, n) for k, name in named}

    @cached_property
    def _functions(self) -> tuple[CoordinateFunction | Along, ...]:
        """For each element the function along which it acts; a row is a linear function."""
        n, own = self.degrees_of_freedom, self._curves
        return tuple(own.get(k) or Along(e.row(n)) for k, e in enumerate(self._elements))

    @cached_property
    def _bent(self) -> bool:
        """Whether a hard stop acts along a function; then sections keep all coordinates."""
        return any(stop.curved for stop in self._stops)

    @property
    def _framed(self) -> bool:
        """Whether some section coordinates are determined by the others."""
        return self._bent or (self._cycled and self._crossed.element.curved)

    @cached_property
    def _structure(self) -> Structure:
        return structure_of(self).beside(len(self._sliders))

    @cached_property
    def _sliders(self) -> tuple[Element, ...]:
        """The elements with sliders; the positions of sliders are the last coordinates."""
        return tuple(element for element in self._soft if element.slider)

    @property
    def _size(self) -> int:
        """Number of coordinates, sliders included."""
        return self.degrees_of_freedom + len(self._sliders)

    @cached_property
    def _progression(self) -> Progression:
        """Directions of whole states, (2N + J,), along which the machine may progress."""
        n = self.degrees_of_freedom
        if self._motion is not None:
            rigid, drag = self._motion.shifts(self.frequency)
        else:
            modes, drag = self.modes, self.damping_matrix
            rigid = modes.matrix[:, modes.frequencies == 0.0]
        if not rigid.size or self._curves:
            return Progression.along(np.zeros((n + self._size, 0)))
        found = directions(rigid, drag, self._elements)
        return Progression.along(np.insert(found, [n] * n, 0.0, axis=0))

    @cached_property
    def _progressions(self) -> list[Progression]:
        """Directions of progression of the section coordinates, one for each hard stop."""
        n, own = self.degrees_of_freedom, self._progression.shift
        kept = [self._crossed.kept] if self._strobed else [(o, o) for o in self._others]
        places = [np.r_[x, n + v, 2 * n : len(own)] for x, v in kept]
        more = 0 if self._strobed else 2
        return [Progression.along(np.pad(own[k], ((0, more), (0, 0)))) for k in places]

    @cached_property
    def _contact(self) -> Contact:
        """The contact of the first stop."""
        first: Contact = self._contacts[0]
        return first

    @cached_property
    def _contacts(self) -> tuple[Any, ...]:
        """The contacts of all hard stops."""
        n, structure = self._size, self._structure
        if self._bent:
            own = self._functions[: len(self._stops)]
            return tuple(CurvedContact(function, self.degrees_of_freedom) for function in own)
        return tuple(structure.contact(stop.row(n)) for stop in self._stops)

    @property
    def _others(self) -> list[Any]:
        """For each stop, the indices (N - 1,) of the coordinates that are section coordinates.

        All N if a stop acts along a function of the coordinates.
        """
        kept = self.degrees_of_freedom - (not self._bent)
        return [contact.others[:kept] for contact in self._contacts]

    @cached_property
    def _excitation(self) -> Excitation:
        n, sliders = self.degrees_of_freedom, len(self._sliders)
        harmonic = np.array((self.harmonic_forces or (0j,) * n) + (0j,) * sliders)
        constant = np.array((self.constant_forces or (0.0,) * n) + (0.0,) * sliders)
        moved = any(element.phasor for element in self._elements)
        moved = moved or (self._motion is not None and self._motion.equations.turns)
        return Excitation(self.frequency, harmonic, constant, moved or bool(harmonic.any()))

    @cached_property
    def _length(self) -> float:
        """A characteristic length of the machine, in its unit of length; one if there is none.

        It is the largest of these lengths. For each element along a row: offset, amplitude, travel
        of its belt in one radian of the phase and stretch of its sliding spring, in sum, divided by
        the largest entry of the row. For each coordinate: the displacement at which its spring and
        its inertia at the frequency balance the sum of all forces.
        """
        w, given, n = self.frequency, self._excitation, self.degrees_of_freedom
        forces, found = (abs(given.harmonic) + abs(given.constant))[:n], [0.0]
        for element in self._elements:
            if element.curved:  # its function need not be a length
                continue
            row = abs(element.row(n))
            stretch = max(abs(regime.stretch) for regime in element.regimes)
            own = abs(element.offset) + element.amplitude + abs(element.drift) / w + stretch
            found.append(own / float(row.max()))
            forces = forces + max(abs(regime.push) for regime in element.regimes) * row
        stiff = abs(self.stiffness.diagonal()) + w * w * self.mass.diagonal()
        return max(*found, float((forces / stiff).max())) or 1.0

    @cached_property
    def _stops(self) -> tuple[HardStop, ...]:
        if self.elements:
            return tuple(stop for stop in self.elements if isinstance(stop, HardStop))
        sign, c = 1 if self.side == "above" else -1, self.contact % self.degrees_of_freedom
        own = {name: getattr(self, name) for name in _OF_STOP}
        near = HardStop(c, **own)
        if self.play == math.inf:
            return (near,)
        facing = "below" if sign > 0 else "above"
        return near, replace(near, offset=self.offset + sign * self.play, side=facing)

    @cached_property
    def _soft(self) -> tuple[Element, ...]:
        """The elements that are not hard stops."""
        return tuple(e for e in self.elements if not isinstance(e, HardStop))

    @property
    def _own(self) -> tuple[Element, ...]:
        """The elements besides a simple table and its far stop; all if the table is not simple.

        A table is simple if its play's far stop is the only other hard stop, and if it acts on one
        coordinate, without phase lag, with a number as restitution.
        """
        plain = all(
            isinstance(stop.coordinate, int)
            and not stop.phase
            and not isinstance(stop.restitution, ImpactLaw)
            for stop in self._stops
        )
        return self._soft if plain and not self._several else self._elements

    @property
    def _table(self) -> HardStop | None:
        """The first hard stop, if it acts on one coordinate; else None."""
        first = self._stops[:1]
        return first[0] if first and isinstance(first[0].coordinate, int) else None

    @property
    def _table_alone(self) -> bool:
        """Whether energies are quadratic and a simple table acts alone, or with play (see `_own`).

        Then the equations of periodic orbits have closed forms in the phases of the impacts.
        """
        return self._motion is None and not self._own

    @property
    def _strobed(self) -> bool:
        """Whether there is no hard stop, so that section coordinates are positions and velocities.

        The section is where a period of the forcing begins, or a cycle of an undriven machine.
        """
        return not self._stops

    @property
    def _cycled(self) -> bool:
        """Whether there is no hard stop and no forcing, and an element's event is the section."""
        idle = self._strobed and not self._excitation.turns
        return idle and cycled_by(self._elements) is not None

    @cached_property
    def _crossed(self) -> Crossed:
        """The section of a machine without hard stops."""
        n, k = self.degrees_of_freedom, cycled_by(self._elements) or 0
        contact: Any = CurvedContact(self._functions[k], n)
        if not self._elements[k].curved:
            contact = self._structure.contact(self._elements[k].row(self._size))
        return Crossed(self._elements[k], contact, halts(self._elements[k]), self._cycled, n)

    @property
    def _several(self) -> bool:
        """Whether there are several hard stops among `elements`, and not a table with play."""
        return bool(self.elements) and len(self._stops) > 1

    @property
    def _holding(self) -> int:
        """Number of elements whose contact or sticking a state stores.

        It is 0 if at most one element at a time, a hard stop, may hold.
        """
        sticky = any(r.sticks or r.holds for element in self._soft for r in element.regimes)
        return len(self._elements) if self._several or sticky else 0

    @property
    def _mapped(self) -> bool:
        """Whether tangent vectors are multiplied by derivatives of the map, not by faster steps."""
        return bool(self._soft) or self._several or self._motion is not None

    @property
    def _faces(self) -> bool:
        """Whether there is a play, with a far stop that faces the table."""
        return not self.elements and len(self._stops) > 1

    @property
    def _elements(self) -> tuple[Element, ...]:
        """All elements, the hard stops first."""
        return *self._stops, *self._soft

    @cached_property
    def _automaton(self) -> Any:
        if self._motion is not None:
            return self._taylor_automaton()
        if not self.elements and not isinstance(self.restitution, ImpactLaw):
            return Rebounding(self._alike, self.restitution)
        given = self._structure, self._excitation, self._elements, self.chatter_tolerance
        return Automaton(*given, self._parts)

    @cached_property
    def _parts(self) -> Parts:
        """The elements, and the rules for their regimes."""
        numbers = sorted(
            range(len(self.elements)), key=lambda k: not isinstance(self.elements[k], HardStop)
        )
        return Parts(self._elements, self._structure, self._normal, numbers)

    @property
    def _normal(self) -> dict[int, int]:
        """Number of the hard stop that is the normal of friction, by the friction's number."""
        named, given = (
            dict(zip(names_of(self.elements), self.elements, strict=True)),
            self._elements,
        )
        return {
            k: next(j for j, stop in enumerate(given) if stop is named[e.leans_on])
            for k, e in enumerate(given)
            if e.leans_on
        }

    @property
    def _alike(self) -> Automaton:
        """The automaton shared by oscillators that differ only in the restitution of the table.

        The structure stores that of the last forces and table, at the last frequency.
        """
        forces = self.harmonic_forces, self.constant_forces, self.chatter_tolerance
        key = (*forces, self.amplitude, self.offset, self.contact, self.side, self.play)
        known = self._structure.automata
        found = known.get(key)
        if found is None:
            stops = tuple(replace(stop, restitution=1.0) for stop in self._stops)
            given = self._structure, self._excitation, stops, self.chatter_tolerance
            known.clear()
            found = Automaton(*given, Parts(stops, self._structure, {}))
        found = known[key] = found.turned(self._excitation)
        return cast("Automaton", found)

    def _taylor_automaton(self) -> Any:
        from dynkit.systems.impact.modes.taylor.scene import Scene
        from dynkit.systems.impact.simulation.taylor.automaton import TaylorAutomaton

        given = self._motion, self._excitation, self._elements
        largest = self._length * max(1.0, self.frequency)
        scene = Scene(*given, self._curves, self._normal, largest)
        return TaylorAutomaton(self._structure, scene, self._parts)

    @cached_property
    def _free(self) -> Any:
        return self._automaton.modes[0]

    @cached_property
    def _gaps(self) -> tuple[Any, ...]:
        return tuple(guard.sum for guard in self._automaton.guards[: len(self._stops)])


def _forces(name: str, given: Any, size: int, kind: type[Any]) -> tuple[Any, ...]:
    """Forces on all coordinates as a tuple, which is empty if there are no forces."""
    if isinstance(given, tuple) and not given:
        return given
    unmasked(name, given)
    array = regular_array(name, given, kind.__name__ if kind is complex else "real")
    if kind is complex and array.dtype.kind not in "iufc" and array.size:
        raise ValueError(f"{name} must be an array of complex numbers; got {given!r}")
    parts = [array.real, array.imag] if kind is complex and np.iscomplexobj(array) else [array]
    for part in parts:
        finite_array(name, part, (size,))
    return tuple(array.astype(kind).tolist())
