"""Chains with stops and friction in many digits: exponentials of (x, v, sine, cosine, one)."""

from collections.abc import Iterable, Sequence
from itertools import combinations
from operator import mul
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx
from mpmath import mp
from mpmath.libmp import from_man_exp, to_fixed

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, Element, HardStop, Jenkins, SoftStop
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.reference.friction import BACKWARD, FORWARD, STICK, Cushion, Gap, Joint, Rub, Table

DIGITS = 40
BITS = 256
"""Binary places of the integers by which states and rows are multiplied: 77 digits."""

GLANCE = 64
"""Steps for which doubles look ahead."""

TINY = 10.0 ** -(DIGITS - 12)
"""Rates, impulses and forces up to this are zero."""

NUDGE = 1e-12
"""Time for which friction slips before one asks whether it stops: its rate may begin as t^2."""

IMPACT, RELEASE, SWITCH, SLIP, HALT, SLIDE = range(6)

ROUNDING = (1 << BITS) // 10**DIGITS
"""What ends a series."""

REST = -1
"""Of friction that takes no force."""

RESTING = 3
"""Of a cushion at whose edge a mass rests."""


class SoftStopReference:
    """The motion of a chain with stops, hard and soft, and friction; the mass matrix is diagonal.

    Hard stops are numbered in their order among the elements, and so is friction. Chatter is not
    completed: its impacts go on. Of each impact ``which`` is the stop, ``coupled`` whether a closed
    stop got an impulse, too, and ``held`` the stops that are closed just after it. ``switches`` are
    changes of friction: the time, its number, and the regime: 0 forward, 1 backward, 2 it sticks.
    Joints, `Jenkins` elements, have these regimes, too: ``slides`` are their changes. A state is
    followed by how far their springs are stretched.
    """

    def __init__(
        self, chain: ImpactOscillator, step: float = 0.02, elements: Sequence[Element] | None = None
    ) -> None:
        self.step, self.size, w = mp.mpf(step), chain.degrees_of_freedom, mp.mpf(chain.frequency)
        n, elements = self.size, chain.elements if elements is None else elements
        self.frequency, self.masses = w, [mp.mpf(m) for m in chain.mass.diagonal().tolist()]
        joints = [e for e in elements if isinstance(e, Jenkins)]
        given = self.masses, w, len(joints)
        self.tables = [Table(e, *given) for e in elements if isinstance(e, HardStop)]
        self.lying = [(fixed(table.gap), fixed(table.rate)) for table in self.tables]
        self.cushions = [Cushion(e, *given) for e in elements if isinstance(e, SoftStop)]
        stops = [e.name for e in elements if isinstance(e, HardStop)]
        self.rubs = [
            Rub(e, *given, stops.index(e.normal) if e.normal else None)
            for e in elements
            if isinstance(e, DryFriction)
        ]
        self.joints = [Joint(e, *given, which) for which, e in enumerate(joints)]
        k, c = (mp.matrix(part.tolist()) for part in (chain.stiffness, chain.damping_matrix))
        self.free = mp.zeros(2 * n + 3 + len(joints))
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
        self.powers: dict[Any, list[list[list[int]]]] = {}
        self.glances: dict[Any, tuple[Array, Array]] = {}
        self.rates: dict[Any, Any] = {}
        self.rows: dict[Any, list[tuple[list[int], int, int, int]]] = {}
        self.regimes: list[int] = []
        self.ways: list[int] = []
        self.sliding = [STICK] * len(joints)
        self.clear()

    def clear(self) -> None:
        """Forget what happened in another motion."""
        self.which: list[int] = []
        self.coupled: list[bool] = []
        self.held: list[tuple[int, ...]] = []
        self.switches: list[tuple[Any, int, int]] = []
        self.slides: list[tuple[Any, int, int]] = []
        self.switches_in_contact = 0
        self.pushes: list[tuple[Any, ...]] = []

    def pushing(self, z: Any, held: tuple[int, ...]) -> tuple[Any, ...]:
        """Forces towards their sides of all tables, cushions and friction, now."""
        _, holding, sticking = self.flow(held)
        by = dict(zip(held, holding, strict=True))
        stuck = dict(zip(self.sticking(held), sticking, strict=True))
        none = 0 * self.free[0, :]
        rows = [by.get(k, none) for k in range(len(self.tables))]
        rests = self.resting(held)
        rows += [
            part.force if regime == 1 else rests.get(k, none)
            for k, (part, regime) in enumerate(zip(self.cushions, self.regimes, strict=True))
        ]
        for k, (rub, way) in enumerate(zip(self.rubs, self.ways, strict=True)):
            rows.append(rub.forces[way] if way in (FORWARD, BACKWARD) else stuck.get(k, none))
        return tuple((row * z)[0] for row in rows)

    def key(self, held: tuple[int, ...]) -> tuple[Any, ...]:
        """What the flow depends on."""
        return tuple(self.regimes), tuple(self.ways), tuple(self.sliding), held

    def flow(self, held: tuple[int, ...]) -> tuple[Any, list[Any], list[Any]]:
        """The generator of the motion, and rows of forces: that hold stops, by which it sticks."""
        key = self.key(held)
        if key not in self.known:
            flow = self.free.copy()
            for cushion, regime in zip(self.cushions, self.regimes, strict=True):
                flow += cushion.kick * cushion.force * int(regime == 1)
            for rub, way in zip(self.rubs, self.ways, strict=True):
                slips = way in (FORWARD, BACKWARD) and rub.stop in (None, *held)
                flow += rub.kick * rub.forces[way] if slips else mp.zeros(flow.rows)
            for joint, way in zip(self.joints, self.sliding, strict=True):
                flow += joint.kick * joint.forces[way]
                if way == STICK:
                    flow[joint.place, :] = joint.rate
            fixed = [*(self.tables[k] for k in held), *self.stuck(held)]
            rates, forces = [part.rate * flow for part in fixed], []
            kicks = [part.kick for part in fixed]
            for rub, way in zip(self.rubs, self.ways, strict=True):
                if rub.stop in held and way in (FORWARD, BACKWARD):
                    sign = -1 if way == FORWARD else 1
                    kicks[held.index(rub.stop)] += sign * rub.coefficient * rub.kick
            if fixed:
                matrix = mp.matrix([[(part.rate * kick)[0] for kick in kicks] for part in fixed])
                if dependent(mp.matrix(inertia(fixed, fixed))):
                    raise RuntimeError(f"rows of what holds or sticks depend: {held}, {self.ways}")
                inverse = (-mp.inverse(matrix)).tolist()
                forces = [combined(numbers, rates) for numbers in inverse]
            for kick, force in zip(kicks, forces, strict=True):
                flow += kick * force
            m, s = len(held), len(self.sticking(held))
            self.known[key] = flow, forces[:m], forces[m : m + s], forces[m + s :]
        found: tuple[Any, list[Any], list[Any]] = self.known[key][:3]
        return found

    def resting(self, held: tuple[int, ...]) -> dict[int, Any]:
        """Rows of the forces of cushions on which a mass rests."""
        self.flow(held)
        key = self.key(held)
        rests = [k for k, regime in enumerate(self.regimes) if regime == RESTING]
        return dict(zip(rests, self.known[key][3], strict=True))

    def most(self, rub: Rub, held: tuple[int, ...]) -> Any:
        """The largest force with which friction sticks, as a row."""
        if rub.stop is None:
            return rub.most
        return rub.static * self.flow(held)[1][held.index(rub.stop)]

    def lean(self, z: Any, held: tuple[int, ...]) -> None:
        """Friction at contacts is off while these are open, and begins with them."""
        for k, rub in enumerate(self.rubs):
            if rub.stop is not None and rub.stop not in held:
                self.ways[k] = REST
            elif rub.stop is not None and self.ways[k] == REST:
                self.ways[k] = self.way(rub, z)

    def moved(self, state: list[int], key: tuple[Any, ...], steps: int) -> list[int]:
        """The state after so many steps in which nothing happens, as integers."""
        if key not in self.powers:
            self.powers[key] = [exponential((self.known[key][0] * self.step).tolist())]
        powers = self.powers[key]
        for k in range(steps.bit_length()):
            if k == len(powers):
                columns = list(zip(*powers[-1], strict=True))
                powers.append(
                    [[sum(map(mul, row, c)) >> BITS for c in columns] for row in powers[-1]]
                )
            if steps >> k & 1:
                state = [sum(map(mul, row, state)) >> BITS for row in powers[k]]
        return state

    def quiet(self, z: Any, held: tuple[int, ...]) -> int:
        """Steps after each of which doubles, with a margin for rounding, see nothing happen."""
        if self.lain(z, held) != sorted(held):
            return 0
        key, state = self.key(held), fixed(z)
        if key not in self.glances:
            self.moved(state, key, 1)
            once = as_floats(self.powers[key][0])
            ahead = [as_floats([row for row, *_ in self.watched(z, held)])]
            most = [abs(ahead[0])]
            for _ in range(GLANCE):
                ahead.append(ahead[-1] @ once)
                most.append(most[-1] @ abs(once))
            self.glances[key] = np.array(ahead[1:]), np.array(most[1:])
        rows, sizes = self.glances[key]
        here = as_floats(state)
        sure = (rows @ here > 1e-12 * (sizes @ abs(here))).all(axis=1)
        return GLANCE if sure.all() else int(sure.argmin())

    def series(self, z: Any, held: tuple[int, ...], step: Any) -> list[list[int]]:
        """Taylor's series of the motion, as integers, as long as it counts within a step."""
        key = self.key(held)
        if key not in self.rates:
            self.rates[key] = list(map(fixed, self.flow(held)[0].tolist()))
        terms, reach = [fixed(z)], fixed([mp.mpf(step)])[0]
        power = 1 << BITS
        while (max(map(abs, terms[-1])) * power) >> BITS > ROUNDING:
            k = len(terms)
            terms.append([(sum(map(mul, row, terms[-1])) >> BITS) // k for row in self.rates[key]])
            power = (power * reach) >> BITS
        return terms

    def watched(self, z: Any, held: tuple[int, ...]) -> list[tuple[list[int], int, int, int]]:
        """What `events` gives, the rows as integers."""
        key = *self.key(held), *self.lain(z, held)
        if key not in self.rows:
            self.rows[key] = [
                (fixed(row), kind, k, to) for row, kind, k, to in self.events(z, held)
            ]
        return self.rows[key]

    def way(self, rub: Rub, z: Any) -> int:
        """The regime of friction by the sign of its rate."""
        rate = (rub.rate * z)[0]
        return STICK if abs(rate) <= TINY else FORWARD if rate > 0 else BACKWARD

    def sticking(self, held: Sequence[int] = ()) -> list[int]:
        """Friction that sticks, but for that which rests, as closed stops hold what it acts on."""
        tables = [self.tables[k] for k in held]
        return [
            k
            for k, rub in enumerate(self.rubs)
            if self.ways[k] == STICK
            and not (held and dependent(mp.matrix(inertia([*tables, rub], [*tables, rub]))))
        ]

    def rest(self, z: Any, held: tuple[int, ...]) -> None:
        """Friction that closed stops keep from slipping does not slip."""
        for k, rub in enumerate(self.rubs):
            fixed = [*(self.tables[j] for j in held), rub]
            rides = bool(held) and dependent(mp.matrix(inertia(fixed, fixed)))
            rates = [rub.rate, rub.rate * self.flow(held)[0]]
            if rides and all(abs((rate * z)[0]) <= TINY for rate in rates):
                self.ways[k] = STICK

    def stuck(self, held: Sequence[int] = ()) -> list[Gap]:
        """The friction that `sticking` numbers, and the cushions on which a mass rests."""
        rests = zip(self.cushions, self.regimes, strict=True)
        resting = [part for part, regime in rests if regime == RESTING]
        return [*(self.rubs[k] for k in self.sticking(held)), *resting]

    def lain(self, z: Any, held: Sequence[int]) -> list[int]:
        """Stops that are closed, or at which friction holds what they stop."""
        if not (self.lying and self.stuck()):
            return sorted(held)
        here = fixed(z)
        sizes = [sum(abs(product(row, here)) for row in rows) for rows in self.lying]
        return sorted({*held, *(k for k, size in enumerate(sizes) if size <= TINY)})

    def settle(self, z: Any) -> None:
        """Regimes of soft stops of which nothing watched is negative."""
        for k, cushion in enumerate(self.cushions):
            watched = cushion.watched
            while left := [to for row, to in watched[self.regimes[k]] if (row * z)[0] < 0]:
                self.regimes[k] = left[0]

    def begin(self, z: Any) -> None:
        """A mass that is at rest at the edge of a preloaded cushion rests there, if it can."""
        for k, part in enumerate(self.cushions):
            still = abs((part.gap * z)[0]) + abs((part.rate * z)[0]) <= NUDGE
            if part.preload > 0 and still:
                self.regimes[k] = RESTING
                z -= part.kick * ((part.rate * z)[0] / (part.rate * part.kick)[0])
                for row, to in part.bounds(self.resting(())[k]):
                    if (row * z)[0] < 0:
                        self.regimes[k] = to

    def staying(self, z: Any, touching: Iterable[int]) -> tuple[int, ...]:
        """Stops that stay closed: forces and accelerations of the gaps are complementary."""
        stops = tuple(sorted(touching))
        if not stops:
            return ()
        tables, ways, sticking = [self.tables[k] for k in stops], self.ways, self.sticking(stops)
        # what rests while they are closed takes no share
        self.ways = [way if k in sticking or way != STICK else REST for k, way in enumerate(ways)]
        free = [(table.rate * self.flow(())[0] * z)[0] for table in tables]
        _, apart = complementary(inertia(tables, tables, self.stuck()), free)
        self.ways = ways
        return tuple(k for k, a in zip(stops, apart, strict=True) if a <= TINY)

    def follow(self, z: Any, held: tuple[int, ...], time: Any) -> None:
        """Regimes of joints, of which what is watched is positive, or becomes so."""
        for k, joint in enumerate(self.joints):
            for _ in range(3):
                flow = self.flow(held)[0]
                slides = self.sliding[k] != STICK
                for row, to in joint.watched[self.sliding[k]]:
                    signs = [(row * part)[0] for part in (z, flow * z, flow * (flow * z))]
                    first = next((sign for sign in signs if abs(sign) > TINY), 0)
                    if first < 0 or (first == 0 and slides):  # friction holds it
                        self.sliding[k] = to
                        self.slides.append((time, k, to))
                        break
                else:
                    break

    def decide(self, z: Any, touching: Iterable[int], halted: int = -1) -> tuple[int, ...]:
        """Decide which friction slips, and which way; return the stops that stay closed.

        What sticks by too much slips: first what has halted, then what exceeds its most by most.
        What would slip against its acceleration sticks.
        """
        for _ in range(30):
            held = self.staying(z, touching)
            self.lean(z, held)
            self.rest(z, held)
            flow, _, forces = self.flow(held)
            sticking = self.sticking(held)
            force = {k: (row * z)[0] for k, row in zip(sticking, forces, strict=True)}
            most = {k: (self.most(self.rubs[k], held) * z)[0] for k in sticking}
            excess = {k: abs(by) - most[k] for k, by in force.items()}
            if torn := [k for k in sticking if excess[k] > TINY]:
                first = halted if halted in torn else max(torn, key=lambda k: excess[k])
                self.ways[first] = BACKWARD if force[first] > 0 else FORWARD
                continue
            for k, rub in enumerate(self.rubs):
                way = 1 if self.ways[k] == FORWARD else -1
                if (
                    self.ways[k] in (FORWARD, BACKWARD)
                    and self.way(rub, z) == STICK
                    and (rub.rate * flow * z)[0] * way < -TINY
                ):
                    self.ways[k] = STICK
                    break
            else:
                return held
        raise RuntimeError(f"friction finds no regimes: {self.ways}")

    def halt(self, z: Any, which: int, touching: list[int]) -> tuple[int, ...]:
        """Stick, or slip on the other way, as it must where what holds moves it."""
        fixed = [*(self.tables[k] for k in touching), *self.stuck(touching), self.rubs[which]]
        moved = dependent(mp.matrix(inertia(fixed, fixed)))
        self.ways[which] = BACKWARD - self.ways[which] if moved else STICK
        return self.decide(z, touching, which)

    def struck(self, z: Any, hit: int, held: tuple[int, ...]) -> tuple[Any, list[int], bool]:
        """The state after an impact, the stops that touch then, and whether others got impulses."""
        table, stops = self.tables[hit], (hit, *held)
        tables, u = [self.tables[k] for k in stops], (table.rate * z)[0]
        r = table.restitution(-u)
        before = [(1 + r) * u] + [mp.mpf(0)] * len(held)
        impulses, after = complementary(inertia(tables, tables), before)
        after[0] -= r * u
        old = z
        for part, impulse in zip(tables, impulses, strict=True):
            z = z + impulse * part.kick
        for rub in self.rubs:
            if rub.stop in stops:  # Coulomb's law for impulses
                w, change = (rub.rate * z)[0], (rub.rate * rub.kick)[0]
                most = rub.coefficient * impulses[stops.index(rub.stop)] * change
                taken = w if abs(w) <= most else mp.sign(w) * most
                z = z - rub.kick * (taken / change)
        for k, rub in enumerate(self.rubs):
            if abs((rub.rate * (z - old))[0]) > TINY and self.ways[k] != REST:
                self.ways[k] = self.way(rub, z)
        for k, cushion in enumerate(self.cushions):
            rate = (cushion.rate * z)[0]
            if self.regimes[k] == RESTING and abs(rate) > TINY:
                self.regimes[k] = int(rate < 0)
        touching = [k for k, rate in zip(stops, after, strict=True) if rate <= TINY]
        return z, touching, any(impulse > TINY for impulse in impulses[1:])

    def events(self, z: Any, held: tuple[int, ...]) -> list[tuple[Any, int, int, int]]:
        """What is positive until something happens: the row, which part, its kind, what follows."""
        _, holding, sticking = self.flow(held)
        found = [(row, RELEASE, k, 0) for k, row in zip(held, holding, strict=True)]
        still = self.lain(z, held)
        for k, table in enumerate(self.tables):
            fixed = [*(self.tables[j] for j in held), *self.stuck(held), table]
            if k not in still or not dependent(mp.matrix(inertia(fixed, fixed))):
                found.append((table.gap, IMPACT, k, 0))
        rests = self.resting(held)
        for k, cushion in enumerate(self.cushions):
            watched = cushion.bounds(rests[k]) if k in rests else cushion.watched[self.regimes[k]]
            found += [(row, SWITCH, k, to) for row, to in watched]
        for k, (joint, way) in enumerate(zip(self.joints, self.sliding, strict=True)):
            found += [(row, SLIDE, k, to) for row, to in joint.watched[way]]
        left = dict(zip(self.sticking(held), sticking, strict=True))
        for k, (rub, way) in enumerate(zip(self.rubs, self.ways, strict=True)):
            if k in left:
                force, most = left[k], self.most(rub, held)
                found += [
                    (most - force, SLIP, k, BACKWARD),
                    (most + force, SLIP, k, FORWARD),
                ]
            elif way in (FORWARD, BACKWARD):
                found.append((rub.rate if way == FORWARD else -rub.rate, HALT, k, STICK))
        return found

    def impacts(
        self, start: Array, count: int, closed: tuple[int, ...] = ()
    ) -> list[tuple[Any, Any]]:
        """Times of so many impacts, and states just after; some stops may be closed at first."""
        return self.motion(start, count, closed, mp.inf)

    def periods(self, start: Array, count: int) -> list[tuple[Any, Any]]:
        """The end of so many periods of what drives a chain without hard stops, and states then."""
        return self.motion(start, count, (), 2 * mp.pi / self.frequency)

    def started(self, start: Array) -> Any:
        """The state at the start of another motion, whose regimes begin."""
        n = 2 * self.size
        z = mp.matrix([*start[:n].tolist(), 0, 1, 1, *start[n:].tolist()])
        self.clear()
        self.sliding = [STICK] * len(self.joints)
        for joint in self.joints:  # a start is rounded: what slides does
            if abs(abs(z[joint.place]) - joint.reach) < 1e-12:
                z[joint.place] = joint.reach * mp.sign(z[joint.place])
        self.regimes, self.ways = [0] * len(self.cushions), [self.way(rub, z) for rub in self.rubs]
        self.settle(z)
        self.begin(z)
        return z

    def motion(
        self, start: Array, count: int, closed: tuple[int, ...], period: Any
    ) -> list[tuple[Any, Any]]:
        """Times of so many impacts, or periods, and states just after them."""
        z, time = self.started(start), mp.mpf(0)
        held, before = self.decide(z, closed), [STICK] * len(self.rubs)
        self.follow(z, held, time)
        found: list[tuple[Any, Any]] = []
        while len(found) < count:
            if any(way not in (STICK, old) for way, old in zip(self.ways, before, strict=True)):
                z, time = after(self.series(z, held, NUDGE), NUDGE), time + NUDGE
            before, due = list(self.ways), (len(found) + 1) * period
            step = min(self.step, due - time)
            whole = step == self.step
            if steps := min(self.quiet(z, held), int(min((due - time) / self.step, GLANCE))):
                there = self.moved(fixed(z), self.key(held), steps)
                z, time = mp.matrix(list(map(number, there))), time + steps * self.step
                continue
            if whole:
                end = self.moved(fixed(z), self.key(held), 1)
                there = mp.matrix(list(map(number, end)))
            else:
                there = after(self.series(z, held, step), step)
                end = fixed(there)
            ahead = [
                event
                for event in self.watched(z, held)
                if product(event[0], end) < (-TINY if event[1] == SLIDE else 0)
            ]
            if not ahead:
                z, time = there, time + step
                if not whole:
                    found.append((due, z.copy()))
                    self.pushes.append(self.pushing(z, held))
                continue
            terms = self.series(z, held, step)
            hits = sorted((root(row, terms, step), *event) for row, *event in ahead)
            if [hit[1] for hit in hits[:2]] == [IMPACT] * 2 and hits[1][0] - hits[0][0] < 1e-20:
                raise RuntimeError(f"two stops are hit at once, at {time + hits[0][0]}")
            wait, kind, which, to = hits[0]
            z, time = after(terms, wait), time + wait
            touching = self.lain(z, held)
            if kind == RELEASE:
                touching.remove(which)
            if kind == SWITCH:
                self.regimes[which] = to
                self.switches_in_contact += bool(held)
            elif kind == SLIP:
                self.ways[which] = to
            elif kind == SLIDE:
                self.sliding[which] = to
                self.slides.append((time, which, to))
            elif kind == IMPACT:
                z, touching, coupled = self.struck(z, which, held)
                self.settle(z)  # forces of dashpots have jumped
            # a dashpot that is touched may tear a mass off a table
            held = self.halt(z, which, touching) if kind == HALT else self.decide(z, touching)
            self.follow(z, held, time)
            changed = zip(before, self.ways, strict=True)
            self.switches += [(time, k, way) for k, (old, way) in enumerate(changed) if way != old]
            if kind == IMPACT:
                found.append((time, z.copy()))
                self.which.append(which)
                self.coupled.append(coupled)
                self.held.append(held)
                self.pushes.append(self.pushing(z, held))
            # past the event by nothing that counts: the next step begins on the other side
            z += mp.mpf(10) ** -(DIGITS - 8) * (self.flow(held)[0] * z)
        return found


def fixed(numbers: Iterable[Any]) -> list[int]:
    """Numbers as integers, in units of 2^-BITS."""
    return [to_fixed(number._mpf_, BITS) for number in numbers]


def as_floats(integers: Any) -> Array:
    """Integers in units of 2^-BITS, as doubles."""
    found: Array = np.array(integers, dtype=object).astype(float) * 2.0**-BITS
    return found


def number(integer: int) -> Any:
    """An integer in units of 2^-BITS, rounded."""
    return mp.make_mpf(from_man_exp(integer, -BITS, mp.prec, "n"))


def product(row: list[int], state: list[int]) -> Any:
    """A row times a state, rounded once: three times as fast as by matrices of mpmath."""
    return mp.make_mpf(from_man_exp(sum(map(mul, row, state)), -2 * BITS, mp.prec, "n"))


def inertia(parts: Sequence[Gap], others: Sequence[Gap], stuck: Sequence[Gap] = ()) -> list[Any]:
    """What unit forces of others change in the accelerations of parts, while some are stuck."""
    found = mp.matrix([[(a.rate * b.kick)[0] for b in others] for a in parts])
    if stuck:
        taken = mp.inverse(mp.matrix(inertia(stuck, stuck))) * mp.matrix(inertia(stuck, others))
        found -= mp.matrix(inertia(parts, stuck)) * taken
    return [[mp.chop(number, TINY) for number in row] for row in found.tolist()]


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


def exponential(rows: list[list[Any]]) -> list[list[int]]:
    """The exponential of a matrix, as integers."""
    unit = 1 << BITS
    with ctx.workprec(2 * BITS):
        found = arb_mat([[arb(each) / unit for each in fixed(row)] for row in rows]).exp() * unit
        return [
            [int(str(each.mid().floor().unique_fmpz())) for each in row] for row in found.tolist()
        ]


def root(row: list[int], terms: list[list[int]], step: Any) -> Any:
    """Where a row of the state, given by its Taylor series, becomes negative within a step."""
    numbers = [sum(map(mul, row, term)) >> BITS for term in reversed(terms)]
    slopes = [k * each for k, each in enumerate(reversed(numbers))][:0:-1]
    low, high = 0, fixed([mp.mpf(step)])[0]
    for _ in range(30):
        middle = (low + high) >> 1
        low, high = (middle, high) if polynomial(numbers, middle) > 0 else (low, middle)
    t = (low + high) >> 1
    for _ in range(6):
        t -= (polynomial(numbers, t) << BITS) // polynomial(slopes, t)
    return number(t)


def polynomial(numbers: Sequence[int], t: int) -> int:
    """A polynomial by Horner's scheme, all as integers; the highest power comes first."""
    found = 0
    for each in numbers:
        found = ((found * t) >> BITS) + each
    return found


def combined(numbers: Sequence[Any], rows: Sequence[Any]) -> Any:
    """A sum of rows, or states, times numbers."""
    return sum((a * row for a, row in zip(numbers, rows, strict=True)), 0 * rows[0])


def after(terms: list[list[int]], time: Any) -> Any:
    """The state after some time, by the series of the motion."""
    t = fixed([mp.mpf(time)])[0]
    return mp.matrix([number(polynomial(numbers[::-1], t)) for numbers in zip(*terms, strict=True)])
