"""Orbits of machines with elements in many digits, by shooting with the modes that they pass.

Of the orbit at hand only the order of its events and a guess are taken. Exponentials of matrices in
mpmath and Newton's method with differences: no modes, no divided differences, no derivatives.
"""

from typing import Any

import numpy as np
from mpmath import mp

from dynkit.systems import DryFriction, SoftStop
from tests.reference.exponential import expm
from tests.reference.friction import Cushion, Gap, Rub, Table
from tests.reference.soft_stops import SoftStopReference

DIGITS = 45
NEAR = 1e-6
"""Phases that are nearer are those of one event."""


class ExactMachine:
    """The modes of masses with elements, hard stops first, by the regimes of all of these."""

    def __init__(self, chain: Any) -> None:
        own = SoftStopReference(chain, elements=chain._elements)
        self.size, self.free, self.masses = own.size, own.free, own.masses
        self.parts: list[Any] = [*own.tables]
        for element in chain._elements[len(own.tables) :]:
            given = self.masses, own.frequency
            stops = [stop.name for stop in chain._elements[: len(own.tables)]]
            if isinstance(element, SoftStop):
                self.parts.append(Cushion(element, *given))
            else:
                assert isinstance(element, DryFriction)
                stop = stops.index(element.normal) if element.normal else None
                self.parts.append(Rub(element, *given, stop=stop))

    def mode(self, regimes: tuple[int, ...]) -> tuple[Any, dict[int, Any]]:
        """The generator, and rows of the forces by which elements hold or stick."""
        flow, held = self.free.copy(), []
        for k, (part, regime) in enumerate(zip(self.parts, regimes, strict=True)):
            if isinstance(part, Cushion) and regime == 1:
                flow += part.kick * part.force
            elif isinstance(part, Rub) and regime in (1, 2):
                flow += part.kick * part.forces[regime - 1]
            elif (type(part), regime) in ((Table, 1), (Rub, 3)):
                held.append(k)
        forces = {}
        if held:
            fixed = [self.parts[k] for k in held]
            kicks = [part.kick for part in fixed]
            for part, regime in zip(self.parts, regimes, strict=True):
                if isinstance(part, Rub) and part.stop in held and regime in (1, 2):
                    own = (-1 if regime == 1 else 1) * part.coefficient * part.kick
                    kicks[held.index(part.stop)] = kicks[held.index(part.stop)] + own
            inertia = mp.matrix([[(a.rate * kick)[0] for kick in kicks] for a in fixed])
            rates = mp.matrix([(part.rate * flow).tolist()[0] for part in fixed])
            rows = -mp.inverse(inertia) * rates
            forces = {k: rows[i, :] for i, k in enumerate(held)}
            for k, kick in zip(held, kicks, strict=True):
                flow += kick * forces[k]
        return flow, forces

    def guard(self, regimes: tuple[int, ...], element: int, number: int) -> Any:
        """The row that is zero where a mode ends."""
        part, regime = self.parts[element], regimes[element]
        if isinstance(part, Cushion):
            return part.watched[regime][number][0]
        force = self.mode(regimes)[1].get(element)
        if isinstance(part, Rub) and regime == 3:
            most = part.most
            if part.stop is not None:
                most = part.static * self.mode(regimes)[1][part.stop]
            return most - force if number == 0 else most + force
        if isinstance(part, Rub):
            return part.rate
        return part.gap if force is None else force

    def kick(self, regimes: tuple[int, ...], stop: Gap) -> Any:
        """What an impulse does that changes the rate of a gap by one, other stops closed."""
        pairs = zip(self.parts, regimes, strict=True)
        held = [part for part, regime in pairs if isinstance(part, Table) and regime == 1]
        out = stop.kick.copy()
        if held:
            inertia = mp.matrix([[(a.rate * b.kick)[0] for b in held] for a in held])
            answer = mp.inverse(inertia) * mp.matrix([(a.rate * out)[0] for a in held])
            for share, part in zip(answer, held, strict=True):
                out -= part.kick * share
        return out / (stop.rate * out)[0]


class ExactOrbit:
    """The orbit of a machine near one that was found: phases and states of its events.

    Attributes
    ----------
    phases, states
        Just before the events; of what nothing drives the first phase is the period.
    """

    def __init__(self, orbit: Any) -> None:
        with mp.workdps(DIGITS):
            problem = orbit._problem
            self.itinerary, self.driven, chain = problem.itinerary, problem.driven, orbit.system
            self.machine = ExactMachine(chain)
            self.frequency, self.turn = mp.mpf(chain.frequency), 2 * mp.pi * problem.periods
            self.count, self.dimension = len(self.itinerary), 2 * self.machine.size
            x = [mp.mpf(number) for number in orbit.unknowns.tolist()]
            before = problem.at(orbit.unknowns, np.empty(0)).before
            state = [mp.mpf(number) for number in before[0, : self.dimension].tolist()]
            modes = {event.mode.numbers for event in self.itinerary}
            self.flows = {numbers: self.machine.mode(numbers)[0] for numbers in modes}
            y = mp.matrix([*x[: self.count], *state])
            for _ in range(8):
                left = self.left(y)
                if mp.norm(left, mp.inf) < mp.mpf(10) ** (8 - DIGITS):
                    break
                y = y - mp.lu_solve(self.derivative(y, left), left)
            else:
                raise RuntimeError(f"Newton's method in many digits must converge; left {left}")
            self.phases = [y[i] for i in range(self.count)]
            before, _, self.after = self.passed(y)
            self.states = [z[: self.dimension] for z in before]

    def passed(self, y: Any) -> tuple[list[Any], list[Any], list[Any]]:
        """States just before the events and a period later, the guards, and states just after."""
        phases = [y[i] for i in range(self.count)]
        clock = self.frequency
        if not self.driven:
            clock, phases[0] = 2 * mp.pi / phases[0], mp.mpf(0)
        phases.append(phases[0] + self.turn)
        z = mp.matrix([*[y[self.count + i] for i in range(self.dimension)]])
        z = mp.matrix([*z, mp.sin(phases[0]), mp.cos(phases[0]), 1])
        states, guards, started = [list(z)], [], []
        for i, event in enumerate(self.itinerary):
            regimes = event.mode.numbers
            if event.element < 0:
                guards.append(mp.sin(phases[i]))
            else:
                guards.append((self.machine.guard(regimes, event.element, event.guard) * z)[0])
            if event.kicked:
                stop = self.machine.parts[event.element]
                rate = (stop.rate * z)[0]
                change = (1 + stop.restitution(-rate)) * rate
                z = z - change * self.machine.kick(event.kicked.numbers, stop)
                for k, way in event.rubs:
                    rub = self.machine.parts[k]
                    over = (rub.rate * rub.kick)[0]
                    most = -rub.coefficient * change * over / (stop.rate * stop.kick)[0]
                    z = z - (way * most if way else (rub.rate * z)[0]) / over * rub.kick
            after = self.itinerary[(i + 1) % self.count].mode.numbers
            started.append(z)
            z = expm(self.flows[after] * ((phases[i + 1] - phases[i]) / clock)) * z
            states.append(list(z))
        return states, guards, started

    def left(self, y: Any) -> Any:
        """Guards at the events, and what the state misses a period later."""
        states, guards, _ = self.passed(y)
        missing = [states[-1][i] - states[0][i] for i in range(self.dimension)]
        return mp.matrix([*guards, *missing])

    def derivative(self, y: Any, left: Any) -> Any:
        """By differences, right to half of the digits."""
        out, step = mp.zeros(len(y)), mp.mpf(10) ** (-DIGITS // 2)
        for k in range(len(y)):
            there = y.copy()
            there[k] += step
            change = (self.left(there) - left) / step
            for i in range(len(y)):
                out[i, k] = change[i]
        return out

    def at(self, phase: float) -> Any:
        """The state (D,) at a phase between events, or just after the event that is near it."""
        which = [k for k in range(self.count) if float(self.phases[k]) <= phase + NEAR]
        turns, k = (0, which[-1]) if which else (1, self.count - 1)
        since = phase + turns * self.turn - self.phases[k]
        flow = self.flows[self.itinerary[(k + 1) % self.count].mode.numbers]
        later = mp.mpf(0) if abs(since) < NEAR else since / self.frequency
        return expm(flow * later) * self.after[k]


def section_error(orbit: Any) -> float:
    """Largest error of a section coordinate of an orbit of a driven machine.

    Positions, velocities, relative velocities and phases just after impacts, or at releases; where
    nothing impacts positions and velocities at the beginnings of periods.
    """
    with mp.workdps(DIGITS):
        exact, system, errors = ExactOrbit(orbit), orbit.system, []
        n, found = exact.machine.size, orbit.states.tolist()
        for row, phase in zip(found, orbit.phases.tolist(), strict=True):
            near = [k for k in range(exact.count) if abs(float(exact.phases[k]) - phase) < NEAR]
            z = exact.at(phase)
            true = list(z[: 2 * n])
            if not system._strobed:
                event = exact.itinerary[near[-1]]
                stop = exact.machine.parts[event.element]
                kept = system._others[event.element].tolist()
                u = (stop.rate * z)[0] * (-1 if event.element == 1 and system._faces else 1)
                true = [z[k] for k in kept] + [z[n + k] for k in kept] + [u]
                errors.append(abs(mp.mpf(phase) - exact.phases[near[-1]]))
            errors += [abs(mp.mpf(a) - b) for a, b in zip(row, true, strict=False)]
        return float(max(errors))


def actual_error(orbit: Any) -> float:
    """How far phases and states of the events are from the exact ones."""
    with mp.workdps(DIGITS):
        exact, n = ExactOrbit(orbit), len(orbit._problem.itinerary)
        x = [mp.mpf(number) for number in orbit.unknowns.tolist()]
        states = [number for state in exact.states[:-1] for number in state]
        before = orbit._problem.at(orbit.unknowns, np.empty(0)).before[:, : exact.dimension]
        own = [mp.mpf(number) for number in before.ravel().tolist()]
        pairs = [*zip(x[:n], exact.phases, strict=True), *zip(own, states, strict=True)]
        return float(max(abs(a - b) for a, b in pairs))
