"""Oscillators as matrices, and what their motions make of small changes of any parameter.

States z are positions, velocities, sine and cosine of the phase, and 1: (2N + 3,). In them a flight
is exp(A t), contact exp(B t), gaps and forces are rows, and all of them follow from the masses,
dashpots, springs, forces and stops by formulas that are analytic. So they take numbers with an
imaginary part, and that of a result over that of the numbers is the derivative, without a
difference that could cancel.

References
----------
A. H. Al-Mohy, N. J. Higham, The complex step approximation to the Frechet derivative of a matrix
function, Numerical Algorithms 53 (2010) 133-148.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np
from scipy.linalg import expm

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.impulses.solution import ImpulseSolution
    from dynkit.systems.impact.orbits.passages.passage import Passage
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

STEP = 1e-40
"""Size of imaginary parts: its square vanishes beside one."""

_REST, _STEPS = 1e-17, 16
"""What counts of a series, in steps of norm one; and the most steps."""

_AGREEMENT = 1e-12
_DIFFERENCE = 1e-3


def numbers_of(oscillator: DrivenStructure) -> Array:
    """All numbers that its motion depends on, (3 + stops + 3N + 3N^2,)."""
    o, excitation = oscillator, oscillator._excitation
    places = [stop.offset for stop in o._stops]
    forces = [excitation.harmonic.real, excitation.harmonic.imag, excitation.constant]
    matrices = [o.mass, o.damping_matrix, o.stiffness]
    parts: list[Any] = [o.frequency, o.restitution, o.amplitude, places, *forces, *matrices]
    return np.concatenate([np.ravel(part) for part in parts])


def change_of(numbers: Callable[[float], Array], value: float) -> tuple[Array, bool]:
    """Derivative of numbers by a parameter, and whether they are linear in it.

    Of what is linear differences are exact, whatever the step; steps towards zero stay in the range
    of a parameter that has a bound. Else it is from differences of fourth order.
    """
    step = -0.25 * np.copysign(2.0 ** np.floor(np.log2(abs(value))), value) if value else 0.25
    here, near, far = (numbers(value + k * step) for k in (0.0, 1.0, 2.0))
    first, second = (near - here) / step, (far - near) / step
    size = max(float(abs(first).max()), float(abs(here).max()) / abs(step))
    if float(abs(first - second).max()) <= _AGREEMENT * size:
        return np.asarray((far - here) / (2.0 * step)), True
    return difference(numbers, value, _DIFFERENCE * max(abs(value), 1e-2)), False


def difference(function: Callable[[float], Array], value: float, step: float) -> Array:
    """Derivative from differences of fourth order, from one side at the end of what is allowed."""
    with suppress(NoSolution):
        near, far = (function(value + k * step) - function(value - k * step) for k in (1.0, 2.0))
        return np.asarray((8.0 * near - far) / (12.0 * step))
    weights = (-25.0, 48.0, -36.0, 16.0, -3.0)

    def one_sided(h: float) -> Array:
        terms = [a * function(value + k * h) for k, a in enumerate(weights)]
        return np.asarray(np.sum(terms, axis=0) / (12.0 * h))

    with suppress(NoSolution):
        return one_sided(step)
    return one_sided(-step)


@final
class Changes:
    """Derivatives of the numbers by some parameters of an oscillator.

    Parameters
    ----------
    system : callable
        The oscillator at values (l,) of the parameters.
    """

    def __init__(self, system: Callable[[Array], DrivenStructure]) -> None:
        self._system = system
        self._known: dict[tuple[int, bytes], Array] = {}

    def by(self, p: Array, k: int) -> Array:
        """By number `k` of the parameters (l,), kept where it is the same for all its values."""

        def numbers(value: float) -> Array:
            moved = p.copy()
            moved[k] = value
            return numbers_of(self._system(moved))

        key = k, np.delete(p, k).tobytes()
        if key not in self._known:
            found, linear = change_of(numbers, float(p[k]))
            if not linear:
                return found
            self._known = {key: found, **dict(list(self._known.items())[:7])}
        return self._known[key]


@final
class Machine:
    """An oscillator with imaginary changes of its numbers.

    Parameters
    ----------
    oscillator : DrivenStructure
    change : see `numbers_of`
        Times `STEP` the imaginary part of its numbers.
    """

    def __init__(self, oscillator: DrivenStructure, change: Array) -> None:
        self.size = n = oscillator.degrees_of_freedom
        self.contact, self.others = oscillator._contact.place, oscillator._contact.others
        self.signs = [stop.sign for stop in oscillator._stops]
        numbers = numbers_of(oscillator) + 1j * STEP * change
        self.frequency, self.restitution, self.amplitude = numbers[:3]
        ends = np.cumsum([3, len(self.signs), 3 * n])
        self.places = numbers[ends[0] : ends[1]]
        self.forces = numbers[ends[1] : ends[2]].reshape(3, n).T
        self.mass, self.damping, self.stiffness = numbers[ends[2] :].reshape(3, n, n)

    @cached_property
    def flow(self) -> Any:
        """A, (2N + 3, 2N + 3)."""
        given = np.hstack([-self.stiffness, -self.damping, self.forces])
        return self._rates(np.linalg.solve(self.mass, given))

    @cached_property
    def held(self) -> Any:
        """B, (2N + 3, 2N + 3): the contact coordinate moves with the table."""
        n, c, others = self.size, self.contact, self.others
        follows = np.zeros(2 * n + 3, dtype=complex)
        follows[2 * n] = -self.amplitude * self.frequency**2
        given = np.hstack([-self.stiffness, -self.damping, self.forces])
        given -= np.outer(self.mass[:, c], follows)
        accelerations = np.empty((n, 2 * n + 3), dtype=complex)
        accelerations[c] = follows
        own = self.mass[np.ix_(others, others)]
        accelerations[others] = np.linalg.solve(own, given[others])
        return self._rates(accelerations)

    def _rates(self, accelerations: Any) -> Any:
        n = self.size
        out = np.zeros((2 * n + 3, 2 * n + 3), dtype=complex)
        out[:n, n : 2 * n] = np.eye(n)
        out[n : 2 * n] = accelerations
        out[2 * n, 2 * n + 1], out[2 * n + 1, 2 * n] = self.frequency, -self.frequency
        return out

    @cached_property
    def kick(self) -> Any:
        """(2N + 3,) change by an impulse that changes the contact velocity by one."""
        response = np.linalg.solve(self.mass, np.eye(self.size)[self.contact])
        out = np.zeros(2 * self.size + 3, dtype=complex)
        out[self.size : 2 * self.size] = response / response[self.contact]
        return out

    def gap(self, side: int) -> Any:
        """Row of the gap."""
        row = -self._table(side)
        row[self.contact] = 1.0
        return self.signs[side] * row

    def force(self, side: int) -> Any:
        """Row of the contact force."""
        n, c = self.size, self.contact
        row = self.mass[c] @ self.held[n : 2 * n]
        row -= np.concatenate([-self.stiffness[c], -self.damping[c], self.forces[c]])
        return self.signs[side] * row

    def released(self, places: Array, phase: float, side: int) -> Any:
        """The state on a stop, from the positions and velocities of the other coordinates."""
        z = np.zeros(2 * self.size + 3, dtype=complex)
        z[self._both] = places
        z[-3:] = np.sin(phase), np.cos(phase), 1.0
        z[self.contact] = self._table(side) @ z
        z[self.size + self.contact] = self.amplitude * self.frequency * z[-2]
        return z

    def caught(self, z: Any, side: int) -> Any:
        """The state in which the contact coordinate is on the stop, and moves with it."""
        out, moves = z.copy(), self.amplitude * self.frequency * z[-2]
        out[self.contact] = self._table(side) @ z
        return out - (z[self.size + self.contact] - moves) * self.kick

    def rate(self, z: Any, side: int) -> Any:
        """Rate of the gap."""
        return self.gap(side) @ (self.flow @ z)

    def bounced(self, z: Any, side: int, rate: Any) -> Any:
        """The state just after an impact, by the rate of the gap just before it."""
        return z - (1.0 + self.restitution) * rate * self.signs[side] * self.kick

    def placed(self, z: Any) -> Any:
        """Positions and velocities (2N - 2,) of the other coordinates."""
        return z[self._both]

    @property
    def _both(self) -> Any:
        return np.append(self.others, self.size + self.others)

    def _table(self, side: int) -> Any:
        """Row of the place of a stop."""
        row = np.zeros(2 * self.size + 3, dtype=complex)
        row[-3], row[-1] = self.amplitude, self.places[side]
        return row


def passage_change(passage: Passage, change: Array) -> tuple[Array, float, Array]:
    """Derivatives of places at the end (2N - 2,), contact force at the release, and gaps (n,).

    At given places and phases, by a change of the numbers.
    """
    m, word, phases = Machine(passage.scene.system, change), passage.word, passage.phases
    z = m.released(passage.places, float(phases[0]), word.start)
    force, gaps, norm = m.force(word.start) @ z, [], _norm(m.flow)
    durations = np.diff(phases[:-1]) / m.frequency
    for side, lasts in zip(word.sides, durations, strict=True):
        z = _moved(m.flow, norm, lasts, z)
        gaps.append(m.gap(side) @ z)
        z = m.bounced(z, side, m.rate(z, side))
    side = word.sides[-1]
    # from here on the gap is taken to be zero
    z[m.contact] -= m.signs[side] * gaps[-1]
    row, late, times = m.gap(side), 0.0j, passage.run.time
    flights = np.diff(times, prepend=0.0).tolist()
    # late in a chatter rates are far below the rounding of velocities: what is known is taken
    rates = -passage.run.log.speed / passage.r if flights else passage.run.log.speed
    push, by_rate = (1.0 + m.restitution) * m.signs[side] * m.kick, row @ m.flow
    states = _chatter(passage) + np.outer(rates, push.real)
    for lasts, rate, before in zip(flights, rates.tolist(), states, strict=True):
        z = before + 1j * _moved(m.flow, norm, lasts, z).imag
        later = -1j * (row @ z).imag / rate  # an impact is where the gap is zero
        z += later * (m.flow @ z)
        z[m.contact] -= 1j * m.signs[side] * (row @ z).imag
        z -= complex(rate, (by_rate @ z).imag) * push
        late += later
    lasts = (phases[-1] - phases[-2]) / m.frequency - late - (times[-1] if len(times) else 0.0)
    z = _moved(m.held, _norm(m.held), lasts, m.caught(z, side))
    return m.placed(z).imag / STEP, float(force.imag) / STEP, np.array(gaps).imag / STEP


def _chatter(passage: Passage) -> Array:
    """States (k, 2N + 3) just after the impacts of a chatter."""
    free, states = passage.scene.system._free, passage.run.free_states[1:]
    x, v = free.motion(states)
    _, sine, cosine = free.parts(states)
    return np.concatenate([x, v, np.stack([sine, cosine, np.ones(len(x))], axis=1)], axis=1)


def residual_change(
    oscillator: DrivenStructure, solution: ImpulseSolution, change: Array
) -> tuple[Array, Array]:
    """Derivatives (n,) of the gaps at the impacts of an orbit, and of r/(1 + r) J less their rates.

    At given phases and impulses J, by a change of the numbers.
    """
    m, s = Machine(oscillator, change), solution
    order = np.argsort(s.since[:, 0])
    lasts = s.lasts[order] * s.terms.frequency / m.frequency
    d = 2 * m.size
    first = s.phases[0]
    # what becomes of all states just before the first impact, and of the phase
    moved = np.eye(d + 3, d + 1, dtype=complex)
    moved[d:, d] = np.sin(first), np.cos(first), 1.0
    before = []
    for i, flight in zip(order.tolist(), lasts, strict=True):
        before.append(moved.copy())
        moved[:, d] += s.signs[i] * s.impulses[i] * m.kick
        moved = expm(m.flow * flight) @ moved
    start = np.append(np.linalg.solve(np.eye(d) - moved[:d, :d], moved[:d, d]), 1.0)
    gaps, rates = np.empty((2, len(order)))
    for i, block in zip(order.tolist(), before, strict=True):
        z = block @ start
        gaps[i] = (m.gap(s.sides[i]) @ z).imag / STEP
        left = m.gap(s.sides[i]) @ (m.flow @ z) + s.impulses[i] / (1.0 + m.restitution)
        rates[i] = left.imag / STEP
    return gaps, rates


def _norm(flow: Any) -> float:
    return float(abs(flow).sum(axis=0).max())


def _moved(flow: Any, norm: float, lasts: complex, z: Any) -> Any:
    """exp(A t) z: by its series where that is short, as between the impacts of a chatter."""
    steps = math.ceil(abs(lasts) * norm)
    if steps > _STEPS:
        return expm(flow * lasts) @ z
    for _ in range(steps):
        # A change of A counts in each term as much as z does in the one before.
        term, k, left = z, 1, 1.0
        while left > _REST:
            term = flow @ term * (lasts / (steps * k))
            z = z + term
            left *= abs(lasts) * norm / (steps * k)
            k += 1
    return z
