"""Chains with soft stops in many digits: matrix exponentials of (x, v, sine, cosine, one)."""

from typing import Any

from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import Element, HardStop, ImpactChain, SoftStop

DIGITS = 40


class Gap:
    """What an element acts along: its row, its gap and the rate of it as rows of the state."""

    def __init__(self, element: Element, size: int, frequency: Any) -> None:
        self.sign = 1 if element.side == "above" else -1
        self.row = mp.zeros(size, 1)
        if isinstance(element.coordinate, tuple):
            if len(element.coordinate) == 2 and isinstance(element.coordinate[0], int):
                self.row[element.coordinate[0]], self.row[element.coordinate[1]] = -1, 1
            else:
                for i, part in enumerate(element.coordinate):
                    self.row[i] = mp.mpf(part)
        else:
            self.row[element.coordinate] = 1
        lag, place = mp.mpf(element.phase), mp.mpf(element.offset)
        m, b = element.amplitude * mp.cos(lag), -element.amplitude * mp.sin(lag)
        self.gap, self.rate = mp.zeros(1, 2 * size + 3), mp.zeros(1, 2 * size + 3)
        for i in range(size):
            self.gap[i] = self.rate[size + i] = self.sign * self.row[i]
        for i, number in enumerate((m, b, place)):
            self.gap[2 * size + i] = -self.sign * number
        self.rate[2 * size] = self.sign * frequency * b
        self.rate[2 * size + 1] = -self.sign * frequency * m


class Cushion(Gap):
    """What a soft stop adds: its force as a row of the state, or two."""

    def __init__(self, stop: SoftStop, size: int, frequency: Any) -> None:
        super().__init__(stop, size, frequency)
        # on the structure, along its row
        self.force = -mp.mpf(stop.stiffness) * self.gap - mp.mpf(stop.damping) * self.rate
        self.push = self.sign * self.force
        # of each regime what is positive in it, and what follows
        self.watched = [
            [(self.gap, 1)],
            [(self.force, 2 if stop.damping else 0)],
            [(-self.force, 1), (-self.gap, 0)],
        ]


class SoftStopReference:
    """The motion of a chain with one hard stop, and soft ones; the mass matrix is diagonal."""

    def __init__(self, chain: ImpactChain, step: float = 0.02) -> None:
        self.chain, self.step, n = chain, mp.mpf(step), chain.degrees_of_freedom
        w = mp.mpf(chain.frequency)
        (table,) = (e for e in chain.elements if isinstance(e, HardStop))
        self.cushions = [Cushion(e, n, w) for e in chain.elements if isinstance(e, SoftStop)]
        self.masses = [mp.mpf(m) for m in chain.mass.diagonal().tolist()]
        k, c = (mp.matrix(part.tolist()) for part in (chain.stiffness, chain.damping_matrix))
        self.free = mp.zeros(2 * n + 3)
        for i in range(n):
            self.free[i, n + i] = 1
            for j in range(n):
                self.free[n + i, j] = -k[i, j] / self.masses[i]
                self.free[n + i, n + j] = -c[i, j] / self.masses[i]
        self.free[2 * n, 2 * n + 1], self.free[2 * n + 1, 2 * n] = w, -w
        self.table = Gap(table, n, w)
        # an impulse along the row that changes the rate of the gap by one
        self.kick = mp.zeros(2 * n + 3, 1)
        for i in range(n):
            self.kick[n + i] = self.table.sign * self.table.row[i] / self.masses[i]
        self.kick /= (self.table.rate * self.kick)[0]
        self.known: dict[Any, Any] = {}
        self.switches_in_contact = 0

    def flow(self, pressed: tuple[bool, ...], held: bool) -> tuple[Any, Any, Any]:
        """The generator of the motion, that of one step, and the row of the contact force."""
        if (pressed, held) not in self.known:
            n, flow = self.chain.degrees_of_freedom, self.free.copy()
            for cushion, pushes in zip(self.cushions, pressed, strict=True):
                for i in range(n if pushes else 0):
                    flow[n + i, :] += cushion.row[i] / self.masses[i] * cushion.push
            force = -self.table.rate * flow
            if held:
                flow += self.kick * force
            self.known[pressed, held] = flow, mp.expm(flow * self.step), force
        found: tuple[Any, Any, Any] = self.known[pressed, held]
        return found

    def settled(self, z: Any, regimes: list[int]) -> None:
        """Regimes of which nothing watched is negative; modified in place."""
        for k, cushion in enumerate(self.cushions):
            while left := [to for row, to in cushion.watched[regimes[k]] if (row * z)[0] < 0]:
                regimes[k] = left[0]

    def impacts(self, start: Array, count: int) -> list[tuple[Any, Any]]:
        """Times and states of so many impacts; after one without rebound there may be contact."""
        r = mp.mpf(self.chain.restitution)
        z, time, held = mp.matrix([*start.tolist(), 0, 1, 1]), mp.mpf(0), False
        regimes = [0] * len(self.cushions)
        self.settled(z, regimes)
        found: list[tuple[Any, Any]] = []
        while len(found) < count:
            flow, stepped, force = self.flow(tuple(k == 1 for k in regimes), held)
            there = stepped * z
            watched = [(force if held else self.table.gap, -1, 0)]
            for k, cushion in enumerate(self.cushions):
                watched += [(row, k, to) for row, to in cushion.watched[regimes[k]]]
            hit = [event for event in watched if (event[0] * there)[0] < 0]
            if not hit:
                z, time = there, time + self.step
                continue
            terms = series(flow, z, self.step)
            wait, which, to = min((root(row, terms, self.step), k, to) for row, k, to in hit)
            z, time = sum((term * wait**k for k, term in enumerate(terms)), 0 * z), time + wait
            if which >= 0:
                regimes[which] = to
                self.switches_in_contact += held
                # a dashpot that is touched may tear the mass off the table
                pressed = tuple(k == 1 for k in regimes)
                held = held and bool((self.flow(pressed, False)[2] * z)[0] >= 0)
            elif held:
                held = False
            else:
                z -= (1 + r) * (self.table.rate * z)[0] * self.kick
                found.append((time, z.copy()))
                self.settled(z, regimes)  # forces of dashpots have jumped
                pressed = tuple(k == 1 for k in regimes)
                held = bool(r == 0 and (self.flow(pressed, False)[2] * z)[0] > 0)
            # past the event by nothing that counts: the next step begins on the other side
            flow = self.flow(tuple(k == 1 for k in regimes), held)[0]
            z += mp.mpf(10) ** -(DIGITS - 8) * (flow * z)
        return found


def root(row: Any, terms: Any, step: Any) -> Any:
    """Where a row of the state, given by its Taylor series, changes its sign within a step."""
    polynomial = [(row * term)[0] for term in reversed(terms)]
    low, high, value = mp.mpf(0), step, polynomial[-1]
    for _ in range(12):
        middle = (low + high) / 2
        same = mp.polyval(polynomial, middle) * value > 0
        low, high = (middle, high) if same else (low, middle)
    t = (low + high) / 2
    for _ in range(6):
        value, slope = mp.polyval(polynomial, t, derivative=True)
        t -= value / slope
    return t


def series(flow: Any, z: Any, step: Any) -> list[Any]:
    """Taylor's series of the motion, as long as it counts within a step."""
    terms = [z]
    while mp.norm(terms[-1], mp.inf) * step ** (len(terms) - 1) > mp.mpf(10) ** -DIGITS:
        terms.append(flow * terms[-1] / len(terms))
    return terms
