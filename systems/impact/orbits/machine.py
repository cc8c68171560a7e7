"""Oscillators as matrices, and derivatives of these matrices by any parameter.

A state z has positions, velocities, positions of sliders, sine and cosine of the phase, and 1:
(D,), D = 2N + J + 3. A flight is exp(A t) z and a contact exp(B t) z; gaps and forces are rows. All
matrices and rows are analytic functions of the masses, dashpots, springs, forces and stops. So
derivatives by complex steps are possible: these numbers get a small imaginary part, and the
imaginary part of a result, divided by the step, is the derivative, without cancellation.

References
----------
A. H. Al-Mohy, N. J. Higham, The complex step approximation to the Frechet derivative of a matrix
function, Numerical Algorithms 53 (2010) 133-148.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from dynkit.core.differences import STEP, parameter_difference
from dynkit.core.kept import kept
from dynkit.core.no_motion import NoMotion, Refused
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.elements.friction import FORWARD
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.modes.constrained import pushes

if TYPE_CHECKING:
    from dynkit.systems.impact.elements.element import Element
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

_OF_REGIME, _OF_GUARD, _LEVEL = 4, 6, 4
"""Count of a regime's own numbers, of a guard's numbers, and index of the level among these."""

_LASTING = "gap", "kick", "_pushed", "shift", "put_on", "_response"
"""Methods whose kept results do not depend on the frequency."""

_AGREEMENT = 1e-12
"""Largest relative difference of two difference quotients of a number linear in the parameter."""


def numbers_of(oscillator: DrivenStructure, modes: Sequence[Regimes] = ()) -> Array:
    """All numbers that determine the motion: of the structure, its forces and each element.

    The numbers of flights by Taylor's method in some modes come last.
    """
    o, excitation = oscillator, oscillator._excitation
    forces = [excitation.harmonic.real, excitation.harmonic.imag, excitation.constant]
    forces = [part[: o.degrees_of_freedom] for part in forces]  # none act on sliders
    parts: list[Any] = [o.frequency, *forces, o.mass, o.damping_matrix, o.stiffness]
    parts += [_numbers(element) for element in o._elements]
    parts += [o._automaton.mode(mode.numbers).numbers for mode in modes]
    return np.concatenate([np.ravel(part) for part in parts])


def _beside_frequency(oscillator: DrivenStructure) -> tuple[Any, ...]:
    """Arguments that determine all numbers except the frequency."""
    o = oscillator
    return o._structure, o.harmonic_forces, o.constant_forces, o._elements


def _numbers(element: Element) -> Array:
    """Numbers of an element: its motion, restitution, regimes with their guards, impact law."""
    own = [element.offset, element.amplitude, element.phase, element.drift]
    law = getattr(element, "restitution", 0.0)
    own.append(0.0 if isinstance(law, ImpactLaw) else law)
    for regime in element.regimes:
        own += [regime.push, regime.stiffness, regime.damping, regime.traction]
        for w in regime.guards:
            own += [w.gap, w.rate, w.force, w.stretch, w.level, w.normal]
    return np.array([*own, *_law_numbers(element).values()], dtype=float)


def _law_numbers(element: Element) -> Mapping[str, float]:
    """Numbers of the element's impact law, by name; they are the last ones of the element."""
    law = getattr(element, "restitution", None)
    return law.numbers if isinstance(law, ImpactLaw) else {}


def change_of(numbers: Callable[[float], Array], value: float) -> tuple[Array, bool]:
    """Derivative of numbers by a parameter, and whether they are linear in it.

    Differences of linear numbers are exact for any step. Steps are towards zero, where most
    parameters stay in their range, or else away from zero. Each number has its own unit, to which
    the error of its derivative is relative.
    """
    here = numbers(value)
    step = -0.25 * np.copysign(2.0 ** np.floor(np.log2(abs(value))), value) if value else 0.25
    unit = abs(here)
    for way in (step, -step):
        try:
            near, far = numbers(value + way), numbers(value + 2.0 * way)
        except NoMotion:
            continue
        if not len(here) == len(near) == len(far):
            raise NoSolution("what an element does changes there")
        first, second = (near - here) / way, (far - near) / way
        if (abs(first - second) <= _AGREEMENT * np.maximum(abs(first), unit / abs(way))).all():
            return np.asarray((far - here) / (2.0 * way)), True
        unit = np.where(unit > 0.0, unit, np.maximum(abs(near), abs(far)))
        break
    unit[unit == 0.0] = 1.0
    return unit * derivative(lambda there: numbers(there) / unit, value), False


def derivative(function: Callable[[float], Array], value: float) -> Array:
    """Derivative of a function of order one, which varies on the scale of `value` or of one."""
    # the scale of the value first: each evaluation builds an oscillator
    return parameter_difference(function, value, scales=(abs(value), 1.0) if value else (1.0,))


@final
class Numbers(NamedTuple):
    """The parts of the numbers of an oscillator, or of their changes: see `numbers_of`.

    Attributes
    ----------
    frequency : float
    forces : (3, N)
        Real and imaginary parts of the harmonic forces, and constant forces.
    matrices : (3, N, N)
        Mass, damping and stiffness.
    own : list of arrays
        Numbers of each element.
    flights : (j,)
        Numbers of flights by Taylor's method, in some modes.
    clock_alone : bool
        Whether all numbers except the frequency are zero.
    """

    frequency: Any
    forces: Any
    matrices: Any
    own: list[Any]
    flights: Any
    clock_alone: bool

    @classmethod
    def split(cls, oscillator: DrivenStructure, numbers: Any) -> Numbers:
        """Split all numbers, in the order of `numbers_of`."""
        n = oscillator.degrees_of_freedom
        ends = np.cumsum([1, 3 * n, 3 * n * n, *map(_count, oscillator._elements)])
        first, forces, matrices, *own, flights = np.split(numbers, ends)
        alone = not numbers[1:].any()
        return cls(first[0], forces.reshape(3, n), matrices.reshape(3, n, n), own, flights, alone)


def _count(element: Element) -> int:
    regimes = sum(_OF_REGIME + _OF_GUARD * len(regime.guards) for regime in element.regimes)
    return 5 + regimes + len(_law_numbers(element))


@final
class Changes:
    """Derivatives of the numbers by some parameters of an oscillator.

    Parameters
    ----------
    system : callable
        Returns the oscillator at values (l,) of the parameters.
    modes : sequence of Regimes
        Modes whose flights are computed by Taylor's method.
    """

    def __init__(
        self, system: Callable[[Array], DrivenStructure], modes: Sequence[Regimes] = ()
    ) -> None:
        self._system, self._modes = system, modes
        self._known: dict[tuple[int, bytes, Any], tuple[Array, Numbers]] = {}

    def _form(self, p: Array) -> Any:
        """Form of energies that are not quadratic, and of functions along which stops act."""
        if not self._modes:
            return None
        system = self._system(p)
        return system._motion.equations, *(curve.form for curve in system._curves.values())

    def by(self, p: Array, k: int, alone: bool = False) -> tuple[Array, Numbers] | None:
        """By number `k` of the parameters (l,), whole and in parts.

        Kept where it is the same for all its values, and those of the others where it changes
        nothing but itself. None where energies have another form beside
        these values, as where a term vanishes.
        """
        form = self._form(p)
        others = b"" if alone and not self._modes else p[:k].tobytes() + p[k + 1 :].tobytes()
        key = k, others, form
        if key in self._known:
            return self._known[key]
        changed = False

        def numbers(value: float) -> Array:
            nonlocal changed
            moved = p.copy()
            moved[k] = value
            changed = changed or self._form(moved) != form
            return numbers_of(self._system(moved), () if changed else self._modes)

        try:
            whole, linear = change_of(numbers, float(p[k]))
        except NoMotion:
            if changed:
                return None
            raise
        if changed:
            return None
        found = whole, Numbers.split(self._system(p), whole)
        if linear:
            self._known = {key: found, **dict(list(self._known.items())[:7])}
        return found


class Regimes(NamedTuple):
    """A mode: regimes of all elements, elements that hold or stick, and guards that are watched.

    A guard is a pair: an element, and the number of the guard in the element's regime.
    """

    numbers: tuple[int, ...]
    held: tuple[int, ...]
    watched: tuple[tuple[int, int], ...] = ()


Rubs = tuple[tuple[int, int], ...]
"""Friction elements at an impact, each with the sign of its slip; 0 if the impact stops slip."""


@final
class Machine:
    """Matrices of an oscillator; complex if its numbers have imaginary changes, else real.

    Parameters
    ----------
    oscillator : DrivenStructure
    change : array, optional
        Changes of the numbers of `numbers_of`; `STEP` times these are the imaginary parts.
    """

    def __init__(self, oscillator: DrivenStructure, change: Array | None = None) -> None:
        self.size, self.changes = oscillator.degrees_of_freedom, change is not None
        self.elements, self._fixed = oscillator._elements, _beside_frequency(oscillator)
        self.free = Regimes((0,) * len(self.elements), ())
        numbers = numbers_of(oscillator)
        if change is not None:
            numbers = numbers + 1j * STEP * change[: len(numbers)]
        self.frequency, forces, matrices, self._own, *_ = Numbers.split(oscillator, numbers)
        self.mass, self.damping, self.stiffness = matrices
        parts = oscillator._parts
        self.sliders, self.normal, self._led = parts.sliders, parts.normal, parts.led
        beside = np.zeros((self.size, len(self.sliders)))
        rows = [element.row(self.size) for element in self.elements]
        self._along = np.array(rows).reshape(-1, self.size)
        self._given: Any = np.hstack([-self.stiffness, -self.damping, beside, forces.T])
        sizes = [[_OF_REGIME + _OF_GUARD * len(r.guards) for r in e.regimes] for e in self.elements]
        self._begins = [np.cumsum([5, *own]).tolist() for own in sizes]

    def like(self, oscillator: DrivenStructure) -> Machine:
        """The machine of another oscillator; shares matrices if only the frequency differs."""
        same = _beside_frequency(oscillator) == self._fixed
        return self._turned(oscillator.frequency) if same else machine_of(oscillator)

    def changed(self, oscillator: DrivenStructure, change: tuple[Array, Numbers]) -> Machine:
        """The machine of the same oscillator with changes of its numbers: see `Changes.by`."""
        whole, parts = change
        if parts.clock_alone:
            return self._turned(self.frequency + 1j * STEP * parts.frequency)
        return Machine(oscillator, whole)

    def _turned(self, frequency: Any) -> Machine:
        out, known = copy(self), vars(self).get("_kept", {})
        out.frequency, out.changes = frequency, np.iscomplexobj(frequency)
        vars(out)["_kept"] = {
            key: own for key, own in known.items() if key[0] in _LASTING or key[-1] is None
        }
        return out

    def closed(self, element: int) -> Regimes:
        """The mode of contact with one stop, with all other elements in their first regime."""
        numbers = tuple(int(k == element) for k in range(len(self.elements)))
        return Regimes(numbers, (element,))

    def restitution(self, element: int) -> Any:
        """Coefficient of restitution of a hard stop."""
        return self._own[element][4]

    def rebound(self, element: int, piece: int, rate: Any) -> tuple[Any, float]:
        """Restitution, and slope of the rebound velocity, at a rate of the gap before an impact.

        An impact law is evaluated on its piece number `piece`, also beyond the ends of this piece.
        A rate at which the gap opens is replaced by its opposite.
        """
        law: Any = getattr(self.elements[element], "restitution", None)
        if not isinstance(law, ImpactLaw):
            r = self.restitution(element)
            return r, float(r.real)
        if piece > len(law.breaks):
            raise NoSolution("the impact law has fewer pieces there")
        u = np.array([max(abs(rate.real), np.finfo(float).tiny)])
        r, slope = (float(value[0]) for value in law.continued(piece, u))
        if not np.iscomplexobj(rate):
            return r, slope
        change = (slope - r) / float(u[0]) * np.sign(rate.real) * rate.imag
        change += STEP * float(self._law_changed(element, piece, u)[0])
        return r + 1j * change, slope

    def rebounds(self, element: int, rates: Array) -> tuple[Array, Array, Array]:
        """Restitutions, slopes of rebound velocities, and changes of restitutions: (n,) each.

        The rates (n,) of the gap before the impacts are those of gaps that close. The changes are
        due to the changes of the machine's numbers.
        """
        law: Any = getattr(self.elements[element], "restitution", None)
        if not isinstance(law, ImpactLaw):
            r, same = self.restitution(element), np.ones(len(rates))
            return r.real * same, r.real * same, r.imag / STEP * same
        u, (found, slopes, changed) = -rates, np.empty((3, len(rates)))
        pieces = np.array([law.piece(velocity) for velocity in u.tolist()])
        for piece in np.unique(pieces).tolist():
            here = pieces == piece
            found[here], slopes[here] = law.continued(piece, u[here])
            changed[here] = self._law_changed(element, piece, u[here])
        return found, slopes, changed

    def _law_changed(self, element: int, piece: int, velocities: Array) -> Array:
        """Changes (n,) of the restitution at (n,) velocities, due to those of the law's numbers."""
        law: Any = getattr(self.elements[element], "restitution", None)
        names, out = law.numbers, np.zeros(len(velocities))
        for name, own in zip(
            names, self._own[element][-len(names) :] if names else (), strict=True
        ):
            if own.imag:

                def moved(value: float, name: str = name) -> Array:
                    try:
                        there = replace(law, **{name: value})
                    except ValueError as refusal:  # beyond the range of the number
                        raise Refused(str(refusal)) from refusal
                    return np.asarray(there.continued(piece, velocities)[0])

                out += derivative(moved, names[name]) * (own.imag / STEP)
        return out

    @kept
    def gap(self, element: int) -> Any:
        """Row (D,) of the gap."""
        row = -self._place(element)
        row[: self.size] = self._along[element]
        return self.elements[element].sign * row

    @kept
    def rate(self, element: int) -> Any:
        """Row (D,) of the rate of the gap, or of the slip velocity."""
        n, place = self.size, self._place(element)
        row = np.zeros(len(place), dtype=np.result_type(place, self.frequency))
        row[n : 2 * n] = self._along[element]
        row[-3], row[-2] = self.frequency * place[-2], -self.frequency * place[-3]
        row[-1] = -self._own[element][3]
        return self.elements[element].sign * row

    def stretch(self, element: int) -> Any:
        """Row (D,) of the extension of the spring between a coordinate and its slider."""
        row = np.zeros_like(self._given[0])
        row[: self.size] = self._along[element]
        row[self.size + self.sliders[element]] = -1.0
        return self.elements[element].sign * row

    def flow(self, mode: Regimes) -> Any:
        """State matrix A (D, D) of a mode."""
        return self._mode(mode)[0]

    @kept
    def watched(self, mode: Regimes, element: int, guard: int) -> Any:
        """Row (D,) of guard number `guard` in the element's regime."""
        gap, rate, force, stretch, level, normal = self.weights(mode, element, guard)
        row = gap * self.gap(element) + rate * self.rate(element)
        if element in self.sliders:
            row = row + stretch * self.stretch(element)
        if element in mode.held:
            row = row + force * self.force(mode, element)
            if led := self._led(element):  # elements that stick together: the sum of their levels
                at = _OF_REGIME + _OF_GUARD * guard + _LEVEL
                level = sum(abs(share) * self._regime(mode.numbers[k], k)[at] for k, share in led)
            if element in self.normal:
                row = row + normal * self.force(mode, self.normal[element])
        row[-1] += level
        return row

    def weights(self, mode: Regimes, element: int, guard: int) -> Any:
        """The six numbers of guard number `guard` in the element's regime."""
        own = self._regime(mode.numbers[element], element)[_OF_REGIME + _OF_GUARD * guard :]
        return own[:_OF_GUARD]

    def force(self, mode: Regimes, element: int) -> Any:
        """Row (D,) of the constraint force of an element that holds or sticks, in its direction."""
        own = self._mode(mode)[1][mode.held.index(element)]
        return self.elements[element].sign * own

    @kept
    def kick(self, mode: Regimes, element: int, rubs: Rubs = ()) -> Any:
        """Change (D,) of the state by an impulse, with friction, that changes the gap rate by 1."""
        out, over = self._pushed(mode, element)
        for k, way in rubs:
            out = out - way * self.coefficient(k) * self._pushed(mode, k)[0]
        return out / over

    @kept
    def _pushed(self, mode: Regimes, element: int) -> tuple[Any, Any]:
        """Changes of the state, (D,), and of the gap rate by a unit impulse that opens the gap.

        The rates of held elements stay zero.
        """
        n, rows, own = self.size, self._rows(mode.held), self._along[element]
        response = np.linalg.solve(self.mass, np.vstack([own, rows]).T)
        out = response[:, 0]
        if mode.held:
            ties = np.linalg.solve(rows @ response[:, 1:], rows @ out)
            out = out - response[:, 1:] @ ties
        whole = np.zeros_like(self._given[0])
        whole[n : 2 * n] = self.elements[element].sign * out
        return whole, own @ out

    def coefficient(self, element: int) -> Any:
        """Kinetic coefficient of friction of an element at a contact."""
        return -self._regime(FORWARD, element)[3]

    def takes(self, mode: Regimes, element: int) -> Any:
        """Largest change of a slip velocity by an impact, over the change of the gap's rate."""
        own, over = (self._pushed(mode, k)[1] for k in (element, self.normal[element]))
        return self.coefficient(element) * own / over

    @kept
    def stopped(self, mode: Regimes, rubs: Rubs) -> Any:
        """Matrix (D, D) of an impact that makes those slip velocities zero that it stops."""
        out: Any = np.eye(len(self._given[0]))
        for k, way in rubs:
            if not way:
                out = out - np.outer(self.kick(mode, k), self.rate(k))
        return out

    @kept
    def shift(self, element: int) -> Any:
        """Change (D,) of the positions that opens the gap by one."""
        row, out = self._along[element], np.zeros_like(self._given[0].real)
        out[: self.size] = self.elements[element].sign * row / (row @ row)
        return out

    @kept
    def put_on(self, element: int) -> Any:
        """Matrix (D, D) that moves the positions so that the gap becomes zero."""
        return np.eye(len(self._given[0])) - np.outer(self.shift(element), self.gap(element))

    @kept
    def caught(self, mode: Regimes, after: Regimes) -> Any:
        """Matrix (D, D) with which mode `after` begins at an event that ends `mode`.

        If more elements hold or stick in `after`, impulses along all its held elements, with the
        friction that slips then, make their relative velocities zero. Then `slid` places sliders.
        The impulse of an impact is not part of this matrix.
        """
        out: Any = np.eye(len(self._given[0]))
        if set(after.held) - set(mode.held):
            n, rows = self.size, self._rows(after.held)
            rates = np.array([self.elements[k].sign * self.rate(k) for k in after.held])
            response = self._response(after)
            out = out.astype(np.result_type(rates, response))
            out[n : 2 * n] -= response @ np.linalg.solve(rows @ response, rates)
        return self.slid(after) @ out if self.sliders else out

    @kept
    def _response(self, mode: Regimes) -> Any:
        """Changes (N, h) of the velocities by unit impulses along held elements, with friction."""
        return np.linalg.solve(self.mass, self._pushes(mode))

    def slid(self, after: Regimes) -> Any:
        """Matrix (D, D) that puts each slider that slips where its spring balances the friction."""
        out: Any = np.eye(len(self._given[0]))
        for k, place in self.sliders.items():
            push = self._regime(after.numbers[k], k)[0]
            if push:  # the slider slips: the spring force equals the friction
                row = self.stretch(k)
                row[-1] += push / self._regime(0, k)[1]
                out = out.astype(np.result_type(out, row))
                out[self.size + place] += self.elements[k].sign * row
        return out

    def _forced(self, mode: Regimes) -> Any:
        """Rows (N, D) of the forces in a mode, without the constraint forces of held elements."""
        given = self._given
        for k, element in enumerate(self.elements):
            push, stiffness, damping, _ = self._regime(mode.numbers[k], k)[:_OF_REGIME]
            if push or stiffness or damping:
                along = self.stretch(k) if k in self.sliders else self.gap(k)
                force: Any = -stiffness * along - damping * self.rate(k)
                force[-1] += push
                given = given + element.sign * np.outer(self._along[k], force)
        return given

    def dashpots(self, mode: Regimes) -> list[float]:
        """Damping coefficients of all elements in a mode."""
        return [float(self._regime(number, k)[2].real) for k, number in enumerate(mode.numbers)]

    def roughness(self, mode: Regimes) -> Array:
        """Sums (D, D) of the absolute terms from which the state matrix of a mode is computed."""
        n, rows = self.size, self._rows(mode.held)
        inverse, pushes = np.linalg.inv(self.mass), self._pushes(mode)
        terms = abs(inverse) @ abs(self._forced(mode))
        if mode.held:
            lost = abs(np.linalg.inv(rows @ inverse @ pushes)) @ (abs(rows) @ terms)
            terms = terms + abs(inverse) @ abs(pushes) @ lost
        out = abs(self.flow(mode))
        out[n : 2 * n] += terms
        return np.asarray(out)

    @kept
    def _mode(self, mode: Regimes) -> tuple[Any, Any]:
        """State matrix (D, D) of a mode, and rows (h, D) of its constraint forces."""
        n, w, d = self.size, self.frequency, len(self._given[0])
        rows = self._rows(mode.held)
        both = self._driven(mode, w if any(self.dashpots(mode)) else None)
        accelerations, by_force = both[:, :d], both[:, d:]
        forces: Any = np.zeros((0, d))
        if mode.held:
            prescribed = np.array([self._place(k) for k in mode.held]) * (-w * w)
            prescribed[:, -1] = 0.0
            forces = np.linalg.solve(rows @ by_force, prescribed - rows @ accelerations)
            accelerations = accelerations + by_force @ forces
        out = np.zeros((d, d), dtype=np.result_type(accelerations, w))
        out[:n, n : 2 * n] = np.eye(n)
        out[n : 2 * n] = accelerations
        for k, place in self.sliders.items():
            # an anchored slider rests on its surface; any other moves with its coordinate
            out[n + place, n : 2 * n] = self._along[k]
            if self.elements[k].regimes[mode.numbers[k]].anchored:
                out[n + place] -= self.elements[k].sign * self.rate(k)
        out[-3, -2], out[-2, -3] = w, -w
        return out, forces

    @kept
    def _driven(self, mode: Regimes, frequency: Any) -> Any:  # noqa: ARG002
        """Rows (N, D + h) of accelerations without constraint forces, and by unit ones.

        With dashpots of elements they depend on the frequency, at which the stops move; `frequency`
        is only a key of the kept results.
        """
        given = np.hstack([self._forced(mode), self._pushes(mode)])
        return np.linalg.solve(self.mass, given)

    def _regime(self, number: int, element: int) -> Any:
        """Numbers of a regime of an element and of its guards; NoSolution without this regime."""
        found = self._own[element][self._begins[element][number] :]
        if not len(found):  # a soft stop lifts only with a dashpot
            raise NoSolution("what an element does changes there")
        return found

    def _pushes(self, mode: Regimes) -> Any:
        """Generalized forces (N, h) of unit forces along held elements, with their friction."""
        return pushes(self._rows(mode.held), self.slips(mode, self._along))

    def slips(self, mode: Regimes, rows: Array) -> list[tuple[int, Array, Any]]:
        """Friction that slips at contacts, for rows (elements, N): an argument of `pushes`."""
        found = []
        for k, stop in self.normal.items():
            traction = self._regime(mode.numbers[k], k)[3]
            if traction and stop in mode.held:
                sign = self.elements[k].sign * self.elements[stop].sign
                found.append((mode.held.index(stop), rows[k], sign * traction))
        return found

    def _rows(self, held: tuple[int, ...]) -> Array:
        return self._along[list(held)]

    def _place(self, element: int) -> Any:
        """Row (D,) of the position of a stop."""
        offset, amplitude, phase = self._own[element][:3]
        row = np.zeros_like(self._given[0])
        row[-3], row[-2] = amplitude * np.cos(phase), -amplitude * np.sin(phase)
        row[-1] = offset
        return row


@kept
def machine_of(oscillator: DrivenStructure) -> Machine:
    """The machine of an oscillator, which keeps it."""
    return Machine(oscillator)
