"""Orbits that stick to 50 digits and more: from one release to the next in balls.

Impacts before a chatter are those that an orbit of dynkit has; the chatter is followed bounce by
bounce until it is slower than 1e-20 of the fastest impact: what contact leaves out of the rest is
about the cube of that. Derivatives are central differences with a step of 2^-100: no formula of a
derivative is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, final

import numpy as np
from flint import acb_mat, arb, arb_mat, ctx

from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact_orbits.exact_orbits import Ball, ImpactMap, size

BITS = 400
STEP = arb((1, -100))
NEAR = arb((1, -300))
SLOWEST = 1e-20
LONG = 8.0
"""Norms of exponents from which on they are taken by squaring, and kept for the next time."""

GIVEN = (
    "degrees_of_freedom", "contact", "frequency", "amplitude", "restitution", "side", "offset",
    "play", "mass", "damping_matrix", "stiffness", "harmonic_forces", "constant_forces",
)  # fmt: skip


@final
class Rates:
    """What moves states by exp(A t)."""

    def __init__(self, matrix: Ball) -> None:
        self.matrix = matrix
        self._norm = max(sum(abs(float(x)) for x in row) for row in matrix.table())
        self._known: dict[float, Ball] = {}

    def moved(self, z: Ball, time: Ball) -> Ball:
        """exp(A time) z; a float is a time that comes again."""
        norm = self._norm * abs(float(time))
        if norm > LONG:
            if not isinstance(time, float):
                return ((self.matrix * time).exp().mid() * z).mid()
            if time not in self._known:
                self._known[time] = (self.matrix * arb(time)).exp().mid()
            return (self._known[time] * z).mid()
        total, term, least, k = z, z, 1.0, 0
        while least > 2.0 ** -(BITS + 20) or k < norm:
            k += 1
            term = self.matrix * term * (time / arb(k))
            total += term
            least *= norm / k
        return total.mid()


@final
class Contact:
    """What happens on one stop of an `ImpactMap`: states (2N + 1,), phase and one at the end."""

    def __init__(self, impacts: ImpactMap, system: Any, side: int) -> None:
        n, c, others = impacts.size, impacts.contact, impacts.others
        self.frequency, half = impacts.frequency, n - 1
        sign = impacts.signs[side]
        mass, damping, stiffness = (
            arb_mat(m.tolist()) for m in (system.mass, system.damping_matrix, system.stiffness)
        )
        harmonic = np.asarray(system.harmonic_forces or (0j,) * n)
        constant = np.asarray(system.constant_forces or (0.0,) * n)
        # The table by the sine, the cosine and one: its place, velocity and acceleration.
        a, w = impacts.amplitude, impacts.frequency
        zero = arb(0)
        told = [[a, zero, impacts.places[side]], [zero, a * w, zero], [-a * w * w, zero, zero]]

        def load(i: int) -> list[Ball]:
            """Force on coordinate `i`, less what the table takes, by the sine, cosine and one."""
            given = [harmonic[i].real.item(), harmonic[i].imag.item(), constant[i].item()]
            rows = zip(told, (stiffness, damping, mass), strict=True)
            taken = [[m[i, c] * x for x in row] for row, m in rows]
            return [arb(g) - sum(xs, zero) for g, *xs in zip(given, *taken, strict=True)]

        rates = arb_mat(2 * half + 3, 2 * half + 3)
        rates[2 * half, 2 * half + 1], rates[2 * half + 1, 2 * half] = w, -w
        if half:
            inverse = arb_mat([[mass[i, j] for j in others] for i in others]).inv()
            forces = arb_mat(
                [
                    [-stiffness[i, j] for j in others] + [-damping[i, j] for j in others] + load(i)
                    for i in others
                ]
            )
            pushed = inverse * forces
            for i in range(half):
                rates[i, half + i] = 1
                for j in range(2 * half + 3):
                    rates[half + i, j] = pushed[i, j]
        self.rates = Rates(rates.mid())
        row = [stiffness[c, j] for j in others] + [damping[c, j] for j in others]
        row += [-x for x in load(c)]
        force = arb_mat([[sign * x for x in row]])
        for i, k in enumerate(others):
            inertia = arb_mat([[rates[half + i, j] for j in range(2 * half + 3)]])
            force += sign * mass[c, k] * inertia
        # The contact force and its rates.
        self.rows = [force.mid()]
        for _ in range(2):
            self.rows.append((self.rows[-1] * self.rates.matrix).mid())

    def state(self, places: list[Ball], phase: Ball) -> Ball:
        sine, cosine = phase.sin_cos()
        return arb_mat([[x] for x in [*places, sine, cosine, arb(1)]]).mid()

    def force(self, state: Ball, order: int = 0) -> Ball:
        return (self.rows[order] * state)[0, 0].mid()

    def places(self, state: Ball) -> list[Ball]:
        return [x for (x,) in state.table()][:-3]

    def after(self, state: Ball, time: Ball) -> Ball:
        return self.rates.moved(state, time)

    def release(self, state: Ball, lasts: float) -> list[Ball]:
        """Places where the force vanishes about so long after a state."""
        there = self.rates.moved(state, lasts)
        for _ in range(20):
            later = -(self.force(there) / self.force(there, 1)).mid()
            there = self.rates.moved(there, later)
            if abs(later) < NEAR:
                return self.places(there)
        raise ArithmeticError("no release near the time that was given")

    def phase(self, places: list[Ball], guess: Ball) -> Ball:
        """The phase near a guess at which these places are released."""
        for _ in range(60):
            sine, cosine = guess.sin_cos()
            value = self.force(self.state(places, guess))
            row = self.rows[0]
            half = len(places)
            slope = row[0, half] * cosine - row[0, half + 1] * sine
            step = (value / slope).mid()
            if abs(step) < NEAR:
                return guess
            guess = (guess - step).mid()
        raise ArithmeticError("no release near the phase that was given")


@dataclass(frozen=True)
class Passage:
    """What an orbit does from one release to the next, as floats.

    Attributes
    ----------
    start : int
        The stop that releases.
    sides, rates : of the impacts before the chatter, and rates of the gap just before them
    durations : (len(sides),)
        Of the flights that these impacts end.
    phases : (len(sides) + 1,)
        Of the release and of these impacts.
    lasts : float
        Of contact.
    """

    start: int
    sides: list[int]
    rates: list[float]
    durations: Array
    phases: Array
    lasts: float


def parts_of(problem: ItineraryEquations, x: Array) -> list[tuple[Array, Array]]:
    """Places at each release, and phases of it and of the impacts that are named."""
    phases, _, states = problem.layout.split(x)
    system, found = problem.oscillator, []
    ends = [*problem.nodes[1:], len(problem.itinerary)]
    rows = states.reshape(len(problem.nodes), -1)
    for z, begin, end in zip(rows, problem.nodes, ends, strict=True):
        others = np.delete(np.arange(system.degrees_of_freedom), system.contact)
        places = np.append(z[others], z[system.degrees_of_freedom + others])
        found.append((places, phases[begin:end]))
    return found


def passages_of(orbit: ImpactOrbit) -> list[Passage]:
    """Of all releases."""
    problem = orbit.problem()
    s, r = problem.at(orbit.unknowns, np.empty(0)), orbit.system.restitution
    ends, found = [*problem.nodes[1:], s.events], []
    for begin, end in zip(problem.nodes, ends, strict=True):
        hits = range(begin + 1, end)
        impulses = [float(s.impulses[s.impulse_of[i]]) for i in hits]
        chatter = s.chatters.get(end - 1)
        found.append(
            Passage(
                s.itinerary[begin].element,
                [s.itinerary[i].element for i in hits],
                [-impulse / (1.0 + r) for impulse in impulses],
                s.durations[begin : end - 1],
                s.event_phases[begin:end],
                float(s.durations[end - 1]) - (chatter.lasts if chatter else 0.0),
            )
        )
    return found


@dataclass(frozen=True)
class Held:
    """Where contact begins: its stuck state and phase, and the states after the impacts before."""

    contact: Contact
    state: Ball
    phase: Ball
    after: list[list[Ball]]


@final
class StickingMap:
    """From the releases of an orbit to the next ones, also near it, and at other parameters.

    Parameters
    ----------
    orbit : ImpactOrbit
        Whose impacts are made.
    values : float or ball
        Of parameters that are not those of the orbit.
    """

    def __init__(self, orbit: ImpactOrbit, **values: Ball) -> None:
        system = SimpleNamespace(**{name: getattr(orbit.system, name) for name in GIVEN})
        vars(system).update(values)
        self.passages = passages_of(orbit)
        self.impacts = ImpactMap(system)  # type: ignore[arg-type]
        self.rates = Rates(self.impacts.rates)
        self.contacts = [Contact(self.impacts, system, k) for k in range(len(self.impacts.signs))]
        flights = [zip(q.durations.tolist(), q.sides, strict=True) for q in self.passages]
        self._flights: list[list[tuple[float, int]]] = [list(part) for part in flights]

    def held(self, k: int, places: list[Ball], phase: Ball) -> Held:
        """From a release at places and phase to contact, the impacts of passage number `k`."""
        q, impacts = self.passages[k], self.impacts
        y, side, after = [*places, arb(0), phase], q.start, []
        for lasts, to in self._flights[k]:
            y = self._landed(y, side, lasts, to)
            side = to
            after.append(y)
        slowest = SLOWEST * max(abs(rate) for rate in q.rates)
        # As many impacts in whatever is followed from here on.
        while abs(y[-2]) > slowest:
            lasts = self._bouncing(y, side)
            self._flights[k].append((lasts, side))
            y = self._landed(y, side, lasts, side)
            after.append(y)
        half = impacts.size - 1
        lost = impacts.signs[side] * abs(y[-2])
        kick = [impacts.kick[i] for i in impacts.others]
        v = [x - a * lost for x, a in zip(y[half : 2 * half], kick, strict=True)]
        contact = self.contacts[side]
        return Held(contact, contact.state([*y[:half], *v], y[-1]), y[-1], after)

    def _landed(self, y: list[Ball], side: int, lasts: float, to: int) -> list[Ball]:
        """Section coordinates after the impact with stop `to` about so long after another."""
        impacts = self.impacts
        z, time = self.rates.moved(impacts.lift(y, side), lasts), arb(lasts)
        gap, rate = impacts.gaps[to]
        for _ in range(20):
            speed = (rate * z)[0, 0]
            later = -((gap * z)[0, 0] / speed).mid()
            z, time = self.rates.moved(z, later), (time + later).mid()
            if abs(later) < NEAR:
                break
            if not 0 < time < 4 * lasts:
                raise ArithmeticError("no impact near the time that was given")
        else:
            raise ArithmeticError("no impact near the time that was given")
        n, others, speed = impacts.size, impacts.others, (rate * z)[0, 0]
        rebound = -impacts.restitution * speed
        jump = impacts.signs[to] * (rebound - speed)
        v = [z[n + i, 0] + impacts.kick[i] * jump for i in others]
        u = rebound if to == 0 else -rebound
        parts = [*(z[i, 0] for i in others), *v, u, y[-1] + impacts.frequency * time]
        return [x.mid() for x in parts]

    def _bouncing(self, y: list[Ball], side: int) -> float:
        """About how long a short flight lasts: u + a s / 2 + j s^2 / 6 is zero."""
        u, a, j = float(abs(y[-2])), -float(self.bend(y, side)), float(self.bend(y, side, 1))
        down = 0.5 * a + math.sqrt(max(0.25 * a * a - 2.0 / 3.0 * u * j, 0.0))
        if not down > 0.0:
            raise ArithmeticError("the chatter does not complete")
        return 2.0 * u / down

    def bend(self, y: list[Ball], side: int, order: int = 0) -> Ball:
        """Acceleration of the gap at section coordinates, or its rate of change."""
        impacts = self.impacts
        z = impacts.rates * impacts.lift(y, side)
        for _ in range(order):
            z = impacts.rates * z
        return (impacts.gaps[side][1] * z)[0, 0].mid()

    def next(self, k: int, places: list[Ball]) -> list[Ball]:
        """Places at the release after that number `k`."""
        held = self.held(k, places, self.phase(k, places))
        return held.contact.release(held.state, self.passages[k].lasts)

    def phase(self, k: int, places: list[Ball]) -> Ball:
        """Phase at which passage number `k` begins."""
        q = self.passages[k]
        return self.contacts[q.start].phase(places, arb(float(q.phases[0])))

    def around(self, places: list[Ball]) -> list[list[Ball]]:
        """Places at all releases of one period, from the first one to that a period later."""
        out = [places]
        for k in range(len(self.passages)):
            out.append(self.next(k, out[-1]))
        return out


def jacobian(function: Callable[[list[Ball]], list[Ball]], y: list[Ball]) -> Ball:
    """Derivative by central differences."""
    columns = []
    for k in range(len(y)):
        there = [function([*y[:k], y[k] + s * STEP, *y[k + 1 :]]) for s in (1, -1)]
        columns.append([(a - b) / (2 * STEP) for a, b in zip(*there, strict=True)])
    return arb_mat(columns).transpose().mid()


def root(function: Callable[[list[Ball]], list[Ball]], y: list[Ball]) -> tuple[list[Ball], Ball]:
    """A zero near a place, by Newton's method, and the derivative near it."""
    for _ in range(8):
        matrix = jacobian(function, y)
        step = matrix.solve(arb_mat([[x] for x in function(y)])).entries()
        y = [(a - b).mid() for a, b in zip(y, step, strict=True)]
        if size(step) < 1e-30:
            return y, matrix
    raise ArithmeticError("there is no orbit near")


@final
class ExactSticking:
    """What Newton's method on the map between releases makes of an orbit.

    Parameters as for `StickingMap`.

    Raises
    ------
    ArithmeticError
        When it has no such orbit nearby.
    """

    def __init__(self, orbit: ImpactOrbit, **values: Ball) -> None:
        with ctx.workprec(BITS):
            self._map = StickingMap(orbit, **values)
            first = [arb(x) for x in orbit.states[0, :-2].tolist()]
            self._places, self._left = first, arb_mat(0, 0)
            if first:
                self._places, self._left = root(self._returned, first)

    def _returned(self, places: list[Ball]) -> list[Ball]:
        later = self._map.around(places)[-1]
        return [b - a for a, b in zip(places, later, strict=True)]

    @cached_property
    def releases(self) -> list[list[Ball]]:
        """Places (2N - 2,) and phase, not wrapped, of each."""
        with ctx.workprec(BITS):
            begun = self._map.around(self._places)[:-1]
            return [[*places, self._map.phase(k, places)] for k, places in enumerate(begun)]

    @cached_property
    def multipliers(self) -> list[Ball]:
        """Of the map from the first release to that a period later, (2N - 2,), in any order."""
        with ctx.workprec(BITS):
            d = len(self._places)
            matrix = self._left + arb_mat(np.eye(d).tolist())
            return list(acb_mat(matrix.mid()).eig(algorithm="approx")) if d else []


def slope(orbit: ImpactOrbit, name: str) -> Array:
    """Derivative (releases, 2N - 1) of places and phases at the releases by a parameter."""
    with ctx.workprec(BITS):
        h = arb("1e-12")
        value = arb(float(getattr(orbit.system, name)))
        ends = [ExactSticking(orbit, **{name: value + s * h}).releases for s in (1, -1)]
        return np.array(
            [
                [float(((a - b) / (2 * h)).mid()) for a, b in zip(*rows, strict=True)]
                for rows in zip(*ends, strict=True)
            ]
        )
