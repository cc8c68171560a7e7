"""Chains with hard and soft stops in many digits: exponentials of (x, v, sine, cosine, one)."""

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import Element, HardStop, ImpactChain, SoftStop

DIGITS = 40
TINY = 10.0 ** -(DIGITS - 12)
"""Rates, impulses and forces up to this are zero."""

IMPACT, RELEASE, SWITCH = range(3)


class Gap:
    """What an element acts along: its row, its gap and the rate of it as rows of the state."""

    def __init__(self, element: Element, size: int, frequency: Any) -> None:
        self.sign = 1 if element.side == "above" else -1
        self.row = mp.zeros(size, 1)
        if isinstance(element.coordinate, tuple):
            if len(element.coordinate) == 2 and isinstance(element.coordinate[0], int):
                before, after = element.coordinate
                self.row[before % size], self.row[after % size] = -1, 1
            else:
                for i, part in enumerate(element.coordinate):
                    self.row[i] = mp.mpf(part)
        else:
            self.row[element.coordinate % size] = 1
        lag, place = mp.mpf(element.phase), mp.mpf(element.offset)
        m, b = element.amplitude * mp.cos(lag), -element.amplitude * mp.sin(lag)
        self.gap, self.rate = mp.zeros(1, 2 * size + 3), mp.zeros(1, 2 * size + 3)
        for i in range(size):
            self.gap[i] = self.rate[size + i] = self.sign * self.row[i]
        for i, number in enumerate((m, b, place)):
            self.gap[2 * size + i] = -self.sign * number
        self.rate[2 * size] = self.sign * frequency * b
        self.rate[2 * size + 1] = -self.sign * frequency * m


class Table(Gap):
    """What a hard stop adds: its restitution, and what a unit impulse does to the state."""

    def __init__(self, stop: HardStop, masses: list[Any], frequency: Any) -> None:
        size = len(masses)
        super().__init__(stop, size, frequency)
        self.restitution = mp.mpf(stop.restitution)
        self.kick = mp.zeros(2 * size + 3, 1)
        for i, mass in enumerate(masses):
            self.kick[size + i] = self.sign * self.row[i] / mass


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
    """The motion of a chain with hard stops, and soft ones; the mass matrix is diagonal.

    Hard stops are numbered in their order among the elements. Chatter is not completed: its
    impacts go on. Of each impact ``which`` is the stop, ``coupled`` whether a closed stop got an
    impulse, too, and ``held`` the stops that are closed just after it.
    """

    def __init__(
        self, chain: ImpactChain, step: float = 0.02, elements: Sequence[Element] | None = None
    ) -> None:
        self.step, self.size, w = mp.mpf(step), chain.degrees_of_freedom, mp.mpf(chain.frequency)
        n, elements = self.size, chain.elements if elements is None else elements
        self.masses = [mp.mpf(m) for m in chain.mass.diagonal().tolist()]
        self.tables = [Table(e, self.masses, w) for e in elements if isinstance(e, HardStop)]
        self.cushions = [Cushion(e, n, w) for e in elements if isinstance(e, SoftStop)]
        k, c = (mp.matrix(part.tolist()) for part in (chain.stiffness, chain.damping_matrix))
        self.free = mp.zeros(2 * n + 3)
        for i, mass in enumerate(self.masses):
            self.free[i, n + i] = 1
            for j in range(n):
                self.free[n + i, j] = -k[i, j] / mass
                self.free[n + i, n + j] = -c[i, j] / mass
            if chain.harmonic_forces:
                self.free[n + i, 2 * n] = chain.harmonic_forces[i].real / mass
                self.free[n + i, 2 * n + 1] = chain.harmonic_forces[i].imag / mass
            if chain.constant_forces:
                self.free[n + i, 2 * n + 2] = chain.constant_forces[i] / mass
        self.free[2 * n, 2 * n + 1], self.free[2 * n + 1, 2 * n] = w, -w
        self.known: dict[Any, Any] = {}
        self.which: list[int] = []
        self.coupled: list[bool] = []
        self.held: list[tuple[int, ...]] = []
        self.switches_in_contact = 0

    def inertia(self, stops: Sequence[int]) -> list[list[Any]]:
        """What unit impulses of these stops change in the rates of their gaps."""
        tables = [self.tables[k] for k in stops]
        return [[(a.rate * b.kick)[0] for b in tables] for a in tables]

    def flow(self, regimes: list[int], held: tuple[int, ...]) -> tuple[Any, Any, dict[int, Any]]:
        """The generator of the motion, that of one step, and rows of the forces that hold stops."""
        pressed = tuple(regime == 1 for regime in regimes)
        if (pressed, held) not in self.known:
            n, flow = self.size, self.free.copy()
            for cushion, pushes in zip(self.cushions, pressed, strict=True):
                for i in range(n if pushes else 0):
                    flow[n + i, :] += cushion.row[i] / self.masses[i] * cushion.push
            forces = {}
            if held:
                inertia = mp.matrix(self.inertia(held))
                if dependent(inertia):
                    raise RuntimeError(f"rows of stops that are held depend: {held}")
                inverse = mp.inverse(inertia)
                free = [self.tables[k].rate * flow for k in held]
                for i, k in enumerate(held):
                    forces[k] = -sum((inverse[i, j] * a for j, a in enumerate(free)), 0 * free[0])
            for k, force in forces.items():
                flow += self.tables[k].kick * force
            self.known[pressed, held] = flow, mp.expm(flow * self.step), forces
        found: tuple[Any, Any, dict[int, Any]] = self.known[pressed, held]
        return found

    def settled(self, z: Any, regimes: list[int]) -> None:
        """Regimes of which nothing watched is negative; modified in place."""
        for k, cushion in enumerate(self.cushions):
            while left := [to for row, to in cushion.watched[regimes[k]] if (row * z)[0] < 0]:
                regimes[k] = left[0]

    def staying(self, z: Any, regimes: list[int], touching: Iterable[int]) -> tuple[int, ...]:
        """Stops that stay closed: forces and accelerations of the gaps are complementary."""
        stops = tuple(sorted(touching))
        flow = self.flow(regimes, ())[0]
        free = [(self.tables[k].rate * flow * z)[0] for k in stops]
        _, apart = complementary(self.inertia(stops), free)
        return tuple(k for k, a in zip(stops, apart, strict=True) if a <= TINY)

    def struck(self, z: Any, hit: int, held: tuple[int, ...]) -> tuple[Any, list[int], bool]:
        """The state after an impact, the stops that touch then, and whether others got impulses."""
        table, stops = self.tables[hit], (hit, *held)
        u = (table.rate * z)[0]
        before = [(1 + table.restitution) * u] + [mp.mpf(0)] * len(held)
        impulses, after = complementary(self.inertia(stops), before)
        after[0] -= table.restitution * u
        for k, impulse in zip(stops, impulses, strict=True):
            z = z + impulse * self.tables[k].kick
        touching = [k for k, rate in zip(stops, after, strict=True) if rate <= TINY]
        return z, touching, any(impulse > TINY for impulse in impulses[1:])

    def events(self, regimes: list[int], held: tuple[int, ...]) -> list[tuple[Any, int, int, int]]:
        """What is positive until something happens: the row, which part, its kind, what follows."""
        forces = self.flow(regimes, held)[2]
        found = [(forces[k], RELEASE, k, 0) for k in held]
        found += [(t.gap, IMPACT, k, 0) for k, t in enumerate(self.tables) if k not in held]
        for k, cushion in enumerate(self.cushions):
            found += [(row, SWITCH, k, to) for row, to in cushion.watched[regimes[k]]]
        return found

    def impacts(
        self, start: Array, count: int, closed: tuple[int, ...] = ()
    ) -> list[tuple[Any, Any]]:
        """Times of so many impacts, and states just after; some stops may be closed at first."""
        z, time = mp.matrix([*start.tolist(), 0, 1, 1]), mp.mpf(0)
        regimes = [0] * len(self.cushions)
        self.settled(z, regimes)
        held = self.staying(z, regimes, closed)
        self.which, self.coupled, self.held, self.switches_in_contact = [], [], [], 0
        found: list[tuple[Any, Any]] = []
        while len(found) < count:
            flow, stepped, _ = self.flow(regimes, held)
            there = stepped * z
            ahead = [event for event in self.events(regimes, held) if (event[0] * there)[0] < 0]
            if not ahead:
                z, time = there, time + self.step
                continue
            terms = series(flow, z, self.step)
            hits = sorted((root(row, terms, self.step), *event) for row, *event in ahead)
            if [hit[1] for hit in hits[:2]] == [IMPACT] * 2 and hits[1][0] - hits[0][0] < 1e-20:
                raise RuntimeError(f"two stops are hit at once, at {time + hits[0][0]}")
            wait, kind, which, to = hits[0]
            z, time = sum((term * wait**k for k, term in enumerate(terms)), 0 * z), time + wait
            touching = [k for k in held if kind != RELEASE or k != which]
            if kind == SWITCH:
                regimes[which] = to
                self.switches_in_contact += bool(held)
            elif kind == IMPACT:
                z, touching, coupled = self.struck(z, which, held)
                self.settled(z, regimes)  # forces of dashpots have jumped
            # a dashpot that is touched may tear a mass off a table
            held = self.staying(z, regimes, touching)
            if kind == IMPACT:
                found.append((time, z.copy()))
                self.which.append(which)
                self.coupled.append(coupled)
                self.held.append(held)
            # past the event by nothing that counts: the next step begins on the other side
            z += mp.mpf(10) ** -(DIGITS - 8) * (self.flow(regimes, held)[0] * z)
        return found


def complementary(matrix: list[list[Any]], offset: list[Any]) -> tuple[list[Any], list[Any]]:
    """The p >= 0 with w = offset + matrix p >= 0, and this w: in each row one of them is zero."""
    everything = range(len(offset))
    for size in range(len(offset) + 1):
        for active in combinations(everything, size):
            p = mp.zeros(len(offset), 1)
            if active:
                block = mp.matrix([[matrix[i][j] for j in active] for i in active])
                if dependent(block):
                    continue  # fewer of these do the same
                solved = mp.lu_solve(block, mp.matrix([-offset[k] for k in active]))
                for k, number in zip(active, solved, strict=True):
                    p[k] = number
            w = [offset[i] + sum(matrix[i][j] * p[j] for j in active) for i in everything]
            w = [mp.mpf(0) if i in active else w[i] for i in everything]
            if all(number >= -TINY for number in (*p, *w)):
                return list(p), w
    raise RuntimeError("the stops leave no way out")


def dependent(inertia: Any) -> bool:
    """Whether rows depend on each other."""
    size = mp.fprod(inertia[i, i] for i in range(inertia.rows))
    return bool(abs(mp.det(inertia)) <= TINY * size)


def root(row: Any, terms: Any, step: Any) -> Any:
    """Where a row of the state, given by its Taylor series, becomes negative within a step."""
    polynomial = [(row * term)[0] for term in reversed(terms)]
    low, high = mp.mpf(0), step
    for _ in range(12):
        middle = (low + high) / 2
        positive = mp.polyval(polynomial, middle) > 0
        low, high = (middle, high) if positive else (low, middle)
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
