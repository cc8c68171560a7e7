"""The map from impact to impact: its states, its section, and its derivatives."""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import is_
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoCrossing
from dynkit.core.smooth_map import generic_direction
from dynkit.core.stretching import Stretching
from dynkit.core.user_code import code_of, overridden_in
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.systems.impact.elements.laws import law_text
from dynkit.systems.impact.elements.parameters import (
    laws_of,
    numbers_in,
    numbers_of,
    with_law,
    with_numbers,
)
from dynkit.systems.impact.modes.progression import Progression
from dynkit.systems.impact.simulation.driven_structure import OF_TABLE, DrivenStructure
from dynkit.systems.impact.simulation.rebounding import Rebounding
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.starts import entered, start
from dynkit.systems.impact.simulation.state import (
    ImpactState,
    on_section,
    packed,
    section_of,
    sheet_of,
    unpacked,
)
from dynkit.systems.impact.simulation.trajectory import Trajectory
from dynkit.systems.impact.variational.lost_directions import lost_directions
from dynkit.systems.impact.variational.map_derivative import derivatives, tangent
from dynkit.systems.structure.lagrangian import independent

if TYPE_CHECKING:
    from dynkit.dynamics.attractor import Attractor

TWO_PI = 2.0 * math.pi

_FEW, _MOST, _NUMBERS = 32, 512, 1_000_000
"""Number of impacts of a first run, largest number of impacts, and largest number of entries of
their derivatives, that are processed together."""


_ENERGIES = {"degrees_of_freedom", "kinetic", "potential", "dissipation"}
"""Members that `identity` represents by matrices, or by the texts of energies."""

_OF_STRUCTURE = "_derivation", "_curves", "_structure", "_soft", "_sliders"
_OF_ALL = (*_OF_STRUCTURE, "_stops", "_contacts", "_contact")
"""Attributes that oscillators with the same structure share; and with the same table, too."""

_FORCES, _ALONG = ("harmonic_forces", "constant_forces"), ("contact", "side", "play")


def _alike(one: Any, other: Any) -> bool:
    """Whether two values are tuples of equal numbers or of the same objects.

    A class that checks its arguments makes a new tuple each time.
    """
    if type(one) is not tuple or type(other) is not tuple or len(one) != len(other):
        return False
    numbers = {*map(type, one + other)} <= {float, complex}
    return one == other if numbers else all(map(is_, one, other))


@cache
def _arguments_of(kind: Any) -> tuple[str, ...]:
    return tuple(entry.name for entry in dataclasses.fields(kind) if entry.init)


@dataclass(frozen=True, kw_only=True)
class ImpactMap(DrivenStructure, Map):
    """Base of `ImpactOscillator`: the part that records, attractors and orbits use."""

    _closed: ClassVar[frozenset[str]] = frozenset(
        ("accuracy", "conservative", "coordinates", "iterate_into", "jacobian_factors", "seen_of")
    )

    # subclasses implement these methods, as the classes of the results import this module
    @abstractmethod
    def simulate(self, *, impacts: int, start: ImpactState | None = None) -> Any:
        """Return the record of a number of impacts: see `ImpactOscillator`."""

    @abstractmethod
    def attractor(self, *args: Any, **kwargs: Any) -> Any:
        """Return the motion after a transient: see `ImpactOscillator`."""

    @abstractmethod
    def _attractor_of(self, record: Any) -> Any: ...

    @abstractmethod
    def periodic_orbit(self, *args: Any, **kwargs: Any) -> Any:
        """Return a periodic orbit: see `ImpactOscillator`."""

    def _run(self, start: ImpactState, count: int, *, store: bool, **limits: int) -> Trajectory:
        return trajectory_of(self, start, count, store=store, **limits)

    # --- the family -------------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of this oscillator, by name."""
        left_out = {"chatter_tolerance", "contact", "masses", *(OF_TABLE if self.elements else ())}
        found = {k: value for k, value in super().parameters.items() if k not in left_out}
        return found | self._numbers

    def replace(self, **parameters: Any) -> Self:
        """Return the same oscillator with some of its arguments changed.

        Raises
        ------
        ValueError
            When a name is not an argument of this class, a value is refused, or the class computes
            it from other arguments.
        """
        asked = dict(parameters)
        known, of_elements = self._arguments, [*self._numbers, *laws_of(self.elements)]
        for name in parameters:
            if name not in known and name not in of_elements:
                names = ", ".join([*known, *of_elements])
                raise ValueError(f"parameter must be one of: {names}; got {name!r}")
        numbers = {name: parameters.pop(name) for name in of_elements if name in parameters}
        if numbers and not self.elements:
            parameters = with_law("restitution", self.restitution, parameters | numbers)
        elif numbers:
            parameters["elements"] = with_numbers(
                parameters.get("elements", self.elements), numbers
            )
        if self.elements:
            defaults = {e.name: e.default for e in dataclasses.fields(self) if e.name in OF_TABLE}
            parameters = defaults | parameters
        made = type(self)(**{name: getattr(self, name) for name in known} | parameters)
        made._take(self)
        for name, value in asked.items():
            own, found = (vars(o) if name in known else o._numbers for o in (self, made))
            before, after, ignored = own.get(name, ()), found.get(name, ()), False
            if isinstance(before, float):
                ignored = after == before != value
            elif name in _FORCES:
                ignored = np.array_equal(after, before) and not np.array_equal(value, before)
            if ignored:
                kind = type(self).__name__
                shown = f"{before:.16g}" if isinstance(before, float) else before
                raise ValueError(f"{name} must be {shown}, which {kind} computes; got {value!r}")
        return made

    def _take(self, other: ImpactMap) -> None:
        """Share computed attributes with another oscillator, as far as their arguments agree."""
        own, known = vars(self), vars(other)
        unlike = ((k, a, known.get(k)) for k, a in own.items() if a is not known.get(k))
        changed = {k for k, a, b in unlike if not _alike(a, b)}
        if "elements" not in changed and changed <= independent(type(self)):
            names = _OF_STRUCTURE if changed.intersection(OF_TABLE) else _OF_ALL
            own.update({name: known[name] for name in names if name in known})
            # where stops are at rest does not matter, but along what they act
            if "_progression" in known and changed.isdisjoint(_ALONG) and self._motion is None:
                own["_progression"] = known["_progression"]

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that determines the motion: arguments, and matrices of the energies.

        For a class that overrides more than the energies, such as the start, `code` is a digest of
        its code.
        """
        names = [*self._arguments, "mass", "damping_matrix", "stiffness"]
        if self.elements:  # the elements already have the table's numbers
            names = [name for name in names if name not in OF_TABLE]
        found: dict[str, object] = dict(self._numbers) if self.elements else {}
        found |= {name: getattr(self, name) for name in names}
        laws = tuple(stop.restitution for stop in self._stops)
        of_law = {"law": tuple(map(law_text, laws))} if any(map(law_text, laws)) else {}
        if of_law and not self.elements:
            found["restitution"] = repr(self.restitution)
        smooth = {} if self._motion is None else {"energies": self._motion.text}
        smooth |= {self._elements[k].coordinate: f.text for k, f in self._curves.items()}
        elements = {"elements": tuple(map(repr, self.elements))}
        own = [e for e in self.elements if "__final__" not in vars(type(e))]
        forces = tuple(repr((e.regimes, e.sign, e.phasor, e.drift, e.leans_on)) for e in own)
        more = overridden_in(type(self)) - _ENERGIES - set(self._arguments)
        code = {"code": code_of(type(self))} if more else {}
        return found | of_law | smooth | elements | ({"regimes": forces} if forces else {}) | code

    @cached_property
    def _numbers(self) -> dict[str, float]:
        """The parameters of elements, or of the law of the table."""
        if self.elements:
            return numbers_of(self.elements)
        own = numbers_in("restitution", self.restitution)
        return {name: number for name, number in own.items() if "." in name}

    @property
    def _unshown(self) -> tuple[str, ...]:
        """Arguments that the first element determines."""
        return OF_TABLE if self.elements else ()

    @property
    def _arguments(self) -> tuple[str, ...]:
        return _arguments_of(type(self))

    # --- states -----------------------------------------------------------------------------------

    def state(
        self,
        position: object = None,
        velocity: object = None,
        phase: float = 0.0,
        sliders: object = None,
    ) -> ImpactState:
        """Return a state to start from, in flight or on the table.

        Parameters
        ----------
        position : (N,) array_like
            Positions; by default the shape of the first mode with modal amplitude one, with the
            contact coordinate on its side of zero (the start of Cusumano & Bai). That position may
            be beyond a stop, or on a stop that moves towards it. Then the contact coordinate starts
            at a distance of one from the stop, or half-way between two stops. If the first mode has
            a node at the contact coordinate, only that coordinate is displaced. With several stops
            the default is the nearest position at which all gaps are one or, with less room, a
            half, a quarter and so on. With a stop along a function of the coordinates it is the
            shape above, or else plus or minus a half of it, twice it, a quarter, an eighth and so
            on. These lengths have no unit: with another unit of length the default start is a
            different one, and may lead to another attractor.
        velocity : (N,) array_like
            Velocities; by default 0.
        phase : float
            Phase of the table, taken modulo 2 pi.
        sliders : (J,) array_like
            Positions of the sliders of `Jenkins` elements, in their order; by default in the middle
            of their surfaces, or as near to the middle as their springs allow.

        Raises
        ------
        ValueError
            When a number is not finite, or the spring of a slider is stretched by more than the
            stretch at which the slider slides.
        Refused
            When the contact mass is beyond the table by more than rounding, or on the table and
            moving into it.
        """
        return start(self, position, velocity, phase, sliders)

    @property
    def default_start(self) -> ImpactState:
        return self._default_start

    @cached_property
    def _default_start(self) -> ImpactState:
        own = self._automaton
        if not isinstance(own, Rebounding) or type(self).state is not ImpactMap.state:
            return self.state()
        if own.shared.start is None:  # the start does not depend on the restitution
            own.shared.start = self.state()._numbers
        speed, element, motion, closed, q, turn = own.shared.start
        return ImpactState(speed, element, motion, closed, self, q, turn)

    @property
    def start_size(self) -> int:
        """Number of arguments of `state_from`: 2N + 1."""
        return 2 * self.degrees_of_freedom + 1

    @property
    def start_names(self) -> tuple[str, ...]:
        """Names of the arguments of `state_from`."""
        each = range(self.degrees_of_freedom)
        return (*(f"{name}[{i}]" for name in ("position", "velocity") for i in each), "phase")

    def state_from(self, numbers: Array) -> ImpactState:
        """Return the `state` with these N positions, N velocities and phase, (2N + 1,).

        Raises
        ------
        ValueError
            As in `state`.
        """
        n = self.degrees_of_freedom
        given = finite_array("numbers", numbers, (self.start_size,))
        return self.state(given[:n], given[n:-1], float(given[-1]))

    def _entered(self, given: ImpactState | None) -> ImpactState:
        if given is None:
            given = self.default_start
        if not isinstance(given, ImpactState):
            raise ValueError(
                f"start must be an ImpactState; got {given!r}: state(position, velocity) makes one"
            )
        return entered(self, given)

    @final
    def pack_state(self, state: ImpactState) -> Array:
        """Return the state as one array, from which `unpack_state` restores it bit for bit.

        A state of an oscillator with other parameters is first converted, as in `simulate`.

        Raises
        ------
        ValueError
            When the state belongs to another structure, or is beyond the table.
        """
        return packed(self._entered(state))

    @final
    def unpack_state(self, packed: Array) -> ImpactState:
        """Return the state that `pack_state` turned into an array.

        Raises
        ------
        ValueError
            When a number is not finite, or the array has not the size of a state.
        """
        return unpacked(self, packed)

    def displaced(self, motion: Attractor, size: float) -> ImpactState:
        """Return the final state of a motion, just after an impact, displaced in all coordinates.

        Displacements of positions and velocities are relative to their largest values in the kept
        states, that of the relative velocity is relative to its final value, and that of the phase
        is relative to one radian. Each coordinate has a different factor, so that the direction has
        no symmetry.

        Parameters
        ----------
        motion : ImpactAttractor
            With at least one impact.
        size : float
            Relative size of the displacement.
        """
        states, scale = abs(motion.states), np.ones(self.dimension)
        for kind in self._measured:
            scale[kind] = states[:, kind].max(initial=0.0)
        if not self._strobed:
            scale[-2] = motion.states[-1, -2]
        change = size * scale * generic_direction(self.dimension)
        return self.impact_state(motion.states[-1] + change)

    @property
    def _measured(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Numbers of the section coordinates that are lengths, and of those that are velocities."""
        kept = self._crossed.kept if self._strobed else (self._others[0],) * 2
        count = [len(part) for part in (*kept, self._sliders)]
        positions, velocities, sliders, *others = np.split(
            np.arange(self.dimension), np.cumsum(count)
        )
        return np.append(positions, sliders), np.append(velocities, np.concatenate(others)[:-1])

    # --- the map ----------------------------------------------------------------------------------

    @final
    def section_state(self, state: ImpactState) -> Array:
        """Section coordinates of a state on the table: (2N,), and one more for each slider."""
        return section_of(self, state)

    @final
    def impact_state(self, state: Array) -> ImpactState:
        """The state just after an impact that has the given section coordinates, (2N,).

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or the relative velocity is negative
            without play.
        """
        return on_section(self, state)

    @final
    def __call__(self, state: Array) -> Array:
        return self.section_state(self._once(state).final)

    @final
    def return_time(self, state: Array) -> float:
        """Return the time from a state just after an impact, (d,), to the next."""
        return self._once(state).duration

    @property
    def _margin(self) -> float:
        """Error estimate of a run, divided by its largest distance from three disturbed runs.

        If one direction stretches most, the error and the distances are Gaussian numbers along it.
        If their root mean squares have the ratio r, the error exceeds f times the largest distance
        with a probability of (2/pi)^(3/2) E|g|^3 (r/f)^3 = 0.81 (r/f)^3. For random machines r is
        0.2.
        """
        several = self._several or bool(self._soft)
        return 8.0 if several and self._motion is None else 4.0

    def _once(self, state: Array) -> Trajectory:
        done = self._run(self.impact_state(state), 1, store=False)
        if done.impacts < 1:
            raise NoCrossing(f"there is no next impact: {done.ending.value}")
        return done

    @property
    def _families(self) -> str:
        return "as where friction or a slider never slips" if self._soft else ""

    @final
    def call_errors(self, states: Array) -> Array:
        """Return errors (n,) of the map at states (n, d), by the disturbances of a record's error.

        They include the effect of rounding the state.
        """
        least = super().call_errors(states)
        found = [self.simulate(impacts=1, start=self.impact_state(state)).error for state in states]
        ends = [float(error[0]) if len(error) else np.inf for error in found]
        return np.maximum(least, np.array(ends) / self._margin)

    @final
    def jacobian(self, state: Array) -> Array:
        (found,) = derivatives(self, self._run(self.impact_state(state), 1, store=True))
        return np.asarray(found)

    def _frame(self, state: Array) -> Array:
        return tangent(self, self.impact_state(state)) if self._framed else super()._frame(state)

    @final
    def orbit_factors(self, state: Array, following: Array) -> tuple[Array, Array]:
        """Return the `jacobian_factors`, (1, d, d), and the error of their entries, (1,).

        If the section lies along a function of the coordinates, they are those of disturbances that
        stay on the section: (1, d - 2, d - 2) on a stop, (1, d - 1, d - 1) without hard stops.
        """
        factors, errors = self.jacobian_factors(state)
        if not self._framed:
            return factors, errors
        return self._frame(following).T @ factors @ self._frame(state), errors

    def _followed(
        self, state: Array, most: int
    ) -> tuple[Array, list[tuple[Any, ...]], Sequence[float]]:
        start = self.impact_state(state)
        alone = self._motion is not None or start.closed
        limit = 1 if alone else max(1, min(most, _MOST, _NUMBERS // self.dimension**2))
        for wanted in (_FEW, limit) if limit > _FEW else (limit,):
            run = self._run(start, wanted, store=True)
            if run.impacts < wanted:
                raise NoCrossing(f"there is no next impact: {run.ending.value}")
            modes = run.guards[run.log.guard[:-1], 0].tolist()
            holding = {k for k in set(modes) if any(self._automaton.parts.grips(run.regimes[k]))}
            cut = next((n for n, k in enumerate(modes, 1) if k in holding), wanted)
            if cut < wanted:  # the next run begins held, as its neighbours do
                run = self._run(start, cut, store=True)
                break
        factors = derivatives(self, run)
        off = self.accuracy * np.linalg.norm(factors, axis=(1, 2))
        lost = lost_directions(self, run).tolist()
        found: list[tuple[Any, ...]] = list(zip(factors[:, None], off[:, None], lost, strict=True))
        return self.section_state(run.final), found, np.diff(run.time, prepend=0.0).tolist()

    @final
    def stretching(
        self, state: Array | ImpactState, n: int, frame: Array | None = None
    ) -> Stretching:
        if self._mapped:
            here = self.section_state(state) if isinstance(state, ImpactState) else state
            found = super().stretching(here, n, frame)
            return dataclasses.replace(found, final=self.impact_state(found.state))
        from dynkit.systems.impact.variational.tangents import stretching

        start = state if isinstance(state, ImpactState) else self.impact_state(state)
        return stretching(self, start, n, frame, self.accuracy)

    @final
    def without_shift(self, states: Array) -> Array:
        if not self._progression.shift.size:
            return states
        if not self._several:
            return self._progressions[0].removed(states)
        out, sheets = states.copy(), sheet_of(states[..., -1])
        for k, own in enumerate(self._progressions):
            out[sheets == k] = own.removed(states[sheets == k])
        return out

    def _progression_at(self, state: Array) -> Progression:
        """Progression of the section coordinates at a state, (d,)."""
        return self._progressions[int(sheet_of(state[-1])) if self._several else 0]

    @final
    def difference(self, a: Array, b: Array) -> Array:
        out = np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)
        if self._strobed:
            return out
        # Symmetric in both directions, unlike the remainder operator.
        turns = np.rint(out[..., -1] / TWO_PI)
        if self._several:
            turns *= sheet_of(np.asarray(a)[..., -1]) == sheet_of(np.asarray(b)[..., -1])
        out[..., -1] -= TWO_PI * turns
        return out
