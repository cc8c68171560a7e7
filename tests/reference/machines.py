"""Machines with elements of any kind in 60 digits: the motion from event to event.

A set of regimes is one flow z' = A z of (x, v, stretches of sliders' springs, sine, cosine, 1). No
modes: states move by Taylor series and exponentials of A. The next event is the first root of a row
of z. Bernstein coefficients in doubles, with a margin for their rounding, exclude roots or isolate
one; what they leave open is decided in 60 digits.

After an event, regimes are those of which all that is watched is positive: its first derivative
that is not zero counts. Nothing of dynkit is used but the numbers of its machines.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, Final, NamedTuple

from flint import arb, arb_mat, ctx

from tests.reference.machine_flows import Flow, at, most, step_of
from tests.reference.machine_parts import CLOSED, Joint, Part, Rub, Table, part_of
from tests.reference.rows import ZERO, first_root

BITS: Final = 200
ZERO_RATE: Final = arb(10) ** -36
AT_ONCE: Final = arb(2) ** -10 + 1

SLOW: Final = arb(10) ** -12
"""A rebound below this is the end of a chatter: what follows it changes by about its square."""

MOST_EVENTS: Final = 700
"""Events after which a motion is given up: a chatter of a law that hardly ends."""


class NotDecided(Exception):
    """The motion cannot be followed any more, for a reason that is said."""


class Event(NamedTuple):
    """A time, its state just after, the regimes from then on, and the stops that were hit.

    It is marked where it is one of those that are counted in place of impacts.
    """

    time: Any
    state: Any
    regimes: tuple[int, ...]
    hit: tuple[int, ...]
    marked: bool
    ambiguous: bool


class Machine:
    """The motion of a system of dynkit, in many digits.

    Parameters
    ----------
    system : its matrices, forces and elements are read
    """

    def __init__(self, system: Any) -> None:
        with ctx.workprec(BITS):
            elements = system._elements
            self.size = n = system.degrees_of_freedom
            self.frequency = arb(float(system.frequency))
            joints = [k for k, e in enumerate(elements) if e.slider]
            self.width = 2 * n + len(joints) + 3
            inverse = arb_mat(system.mass.tolist()).inv().mid()
            self.free = arb_mat(self.width, self.width)
            w = self.width
            forces = [system.harmonic_forces, system.constant_forces]
            harmonic, constant = ([0.0] * n if not len(f) else list(f) for f in forces)
            parts = [
                (inverse * arb_mat(part.tolist())).mid()
                for part in (system.stiffness, system.damping_matrix)
            ]
            pushes = (
                inverse
                * arb_mat(
                    [
                        [f.real, f.imag, g]
                        for f, g in zip(map(complex, harmonic), constant, strict=True)
                    ]
                )
            ).mid()
            for i in range(n):
                self.free[i, n + i] = 1
                for j in range(n):
                    self.free[n + i, j] = -parts[0][i, j]
                    self.free[n + i, n + j] = -parts[1][i, j]
                for j in range(3):
                    self.free[n + i, w - 3 + j] = pushes[i, j]
            self.free[w - 3, w - 2], self.free[w - 2, w - 3] = self.frequency, -self.frequency
            places = iter(range(2 * n, w - 3))
            self.parts: list[Part] = [
                part_of(e, inverse, self.frequency, w, next(places) if e.slider else -1)
                for e in elements
            ]
            rubs = [p for p in self.parts if isinstance(p, Rub)]
            for i, rub in enumerate(rubs):
                any(rub.joins(other) for other in rubs[:i] if other.leads)
            self.flows: dict[tuple[int, ...], Flow | None] = {}

    # --- regimes ----------------------------------------------------------------------------------

    def flow(self, regimes: tuple[int, ...]) -> Flow | None:
        """The motion in these regimes; None where what holds and sticks depends on each other."""
        if regimes not in self.flows:
            self.flows[regimes] = self._built(regimes)
        return self.flows[regimes]

    def fixed(self, regimes: Sequence[int]) -> list[Part]:
        """What holds or sticks."""
        return [p for p, now in zip(self.parts, regimes, strict=True) if p.fixes(now)]

    def _built(self, regimes: tuple[int, ...]) -> Flow | None:
        matrix = arb_mat(self.free)
        for part, now in zip(self.parts, regimes, strict=True):
            part.push(matrix, now)
        fixed = self.fixed(regimes)
        forces: dict[Part, Any] = {}
        if fixed:
            rates = stacked([p.rate for p in fixed])
            kicks = stacked([p.kick.transpose() for p in fixed]).transpose()
            inertia = (rates * kicks).mid()
            if dependent(inertia):
                return None
            by = -(inertia.solve(rates * matrix)).mid()
            matrix = (matrix + kicks * by).mid()
            for i, p in enumerate(fixed):
                forces[p] = arb_mat(1, self.width, [by[i, j] for j in range(self.width)])
        for part, now in zip(self.parts, regimes, strict=True):
            part.follow(matrix, now)
        for part, now in zip(self.parts, regimes, strict=True):
            rests = isinstance(part, Rub) and part.leads and now == part.REST
            if rests and not dependent_on(part, fixed):
                return None
        rows = [
            (k, row)
            for k, (part, now) in enumerate(zip(self.parts, regimes, strict=True))
            for row in part.watched(now, forces.get(part))
        ]
        return Flow(matrix, rows, step_of(matrix))

    def decide(self, z: Any, before: tuple[int, ...]) -> tuple[int, ...]:
        """The regimes that follow: what may stick sticks, and what need not change stays."""
        choices = [p.choices(z, now) for p, now in zip(self.parts, before, strict=True)]

        def changes(regimes: tuple[int, ...]) -> tuple[int, int]:
            slips = sum(
                p.slips(now)
                for p, now, own in zip(self.parts, regimes, choices, strict=True)
                if len(own) > 1
            )
            return slips, sum(a != b for a, b in zip(before, regimes, strict=True))

        for regimes in sorted(product(*choices), key=changes):
            if self.follows(z, regimes, choices):
                return regimes
        raise NotDecided("no regimes follow")

    def follows(self, z: Any, regimes: tuple[int, ...], choices: list[tuple[int, ...]]) -> bool:
        """Whether regimes go on, and no friction slips in them that could stick instead."""
        if not self.stays(z, regimes):
            return False
        for k, (part, own) in enumerate(zip(self.parts, choices, strict=True)):
            if len(own) > 1 and part.jumps and part.slips(regimes[k]):
                stuck = (*regimes[:k], Rub.STICK, *regimes[k + 1 :])
                if self.stays(z, stuck, k):
                    return False
        return True

    def stays(self, z: Any, regimes: tuple[int, ...], only: int | None = None) -> bool:
        """Whether all that is watched, or that of one element, is positive for a while."""
        flow = self.flow(regimes)
        if flow is None:
            return False
        states = [z]
        for k, row in flow.rows:
            if only not in (None, k):
                continue
            for order in range(3 * self.size + 8):
                if order == len(states):
                    states.append((flow.matrix * states[-1]).mid())
                value = (row.row * states[order])[0, 0].mid()
                if abs(value) > ZERO * (1.0 + most(states[order])):
                    if value < 0:
                        return False
                    break
            else:
                if not self.parts[k].may_stay(regimes[k]):
                    return False
        return True

    def unique(self, z: Any, regimes: tuple[int, ...], before: tuple[int, ...]) -> bool:
        """Whether no other regimes follow: none do without preloads and larger static forces.

        Where others switch at once with friction that could slip as well, their order counts.
        """
        choices = [p.choices(z, now) for p, now in zip(self.parts, before, strict=True)]
        pairs = enumerate(zip(self.parts, choices, strict=True))
        several = {k for k, (part, own) in pairs if part.jumps and len(own) > 1}
        if not several:
            return True
        places = range(len(regimes))
        at_once = sum(before[k] != regimes[k] for k in places if len(choices[k]) > 1) > 1

        def follows(other: tuple[int, ...]) -> bool:
            alike = all(k in several for k in places if other[k] != regimes[k])
            by_order = at_once and alike
            return self.stays(z, other) if by_order else self.follows(z, other, choices)

        return not any(follows(other) for other in product(*choices) if other != regimes)

    # --- motion -----------------------------------------------------------------------------------

    def start(self, x: Any, v: Any, sliders: Any, sine: float, cosine: float) -> Any:
        """A state from doubles; a slider that is as far off as it may be is exactly there."""
        with ctx.workprec(BITS):
            joints = [p for p in self.parts if isinstance(p, Joint)]
            numbers = [*map(arb, x.tolist()), *map(arb, v.tolist()), *[arb(0)] * len(joints)]
            z = arb_mat(self.width, 1, [*numbers, arb(sine), arb(cosine), arb(1)])
            for joint, place in zip(joints, sliders.tolist(), strict=True):
                z[joint.place, 0] = joint.stretched(z, arb(place))
            return z

    def motion(
        self, z: Any, until: float, *, periods: bool = False, marks: int = -1
    ) -> tuple[list[Event], str]:
        """Events until a time, and why they end before, if they do.

        Ends of periods, at phase 0, are marked events, too, where these are asked for. Or those are
        marked at which element number `marks` comes to a halt, or is reached.
        """
        with ctx.workprec(BITS):
            period = (2 * arb.pi() / self.frequency).mid() if periods else None
            events: list[Event] = []
            try:
                self._motion(events, z, arb(until), period, marks)
            except NotDecided as reason:
                return events, str(reason)
            return events, ""

    def _motion(self, events: list[Event], z: Any, until: Any, period: Any, marks: int) -> None:
        time, turns = arb(0), 1
        regimes = self.decide(z, tuple(p.first(z) for p in self.parts))
        angle = arb.atan2(z[self.width - 3, 0], z[self.width - 2, 0])
        begin = (angle / self.frequency).mid()  # the phase is 0 at the end of a period
        if period is not None and begin < 0:
            begin = (begin + period).mid()
        events.append(Event(time, z, regimes, (), False, False))
        while time < until:
            if len(events) > MOST_EVENTS:
                raise NotDecided(f"more than {MOST_EVENTS} events")
            flow = self.flow(regimes)
            assert flow is not None
            due = until if period is None else (turns * period - begin).mid()
            z, wait, roots = self._next(flow, z, (due - time).mid())
            if not roots:
                time, turns = due, turns + 1
                if period is not None:
                    events.append(Event(time, z, regimes, (), True, False))
                continue
            time = (time + wait).mid()
            z, hit, ambiguous = self._struck(z, regimes)
            after = self.decide(z, regimes)
            ambiguous = ambiguous or not self.unique(z, after, regimes)
            marked = marks in roots and self.parts[marks].marks(regimes[marks])
            events.append(Event(time, z, after, hit, marked, ambiguous))
            regimes = after

    def _next(self, flow: Flow, z: Any, due: Any) -> tuple[Any, Any, tuple[int, ...]]:
        """The state at the next event, the time until then, and the elements of its rows."""
        passed, steps = arb(0), 0
        while True:
            steps += 1
            if steps > 4000:
                raise NotDecided("nothing happens")
            step = flow.step
            last = due is not None and due - passed < step
            if last:
                step = float((due - passed).upper())
            clear = flow.clear(z)
            if all(clear) and not last:
                z, passed = (flow.exponential * z).mid(), (passed + arb(step)).mid()
                continue
            terms = flow.series(z, step)
            end = ((due - passed) / arb(step)).mid() if last else arb(1)
            found: list[tuple[Any, int]] = []
            for (k, row), is_clear in zip(flow.rows, clear, strict=True):
                if is_clear:
                    continue
                numbers = [(row.row * term)[0, 0].mid() for term in terms]
                # a little beyond the first one so far: others may be zero there, too
                until = min([end, *((r * AT_ONCE).mid() for r, _ in found)], key=float)
                root = first_root(numbers, until)
                if root is not None:
                    found.append((root, k))
            if found:
                first = min((r for r, _ in found), key=float)
                z = at(terms, first)
                same = tuple(sorted({k for r, k in found if abs(r - first) < ZERO}))
                return z, (passed + first * arb(step)).mid(), same
            z, passed = at(terms, end), (passed + end * arb(step)).mid()
            if last:
                return z, due, ()

    def _struck(self, z: Any, regimes: tuple[int, ...]) -> tuple[Any, tuple[int, ...], bool]:
        """The state after impacts, the stops that were hit, and if their law is one of several."""
        tables = [(k, p) for k, p in enumerate(self.parts) if isinstance(p, Table)]
        hits = [
            k
            for k, p in tables
            if regimes[k] != CLOSED and abs(p.gap_at(z)) < ZERO and p.rate_at(z) < -ZERO_RATE
        ]
        held = [p for k, p in tables if regimes[k] == CLOSED]
        ambiguous, done = False, list(hits)
        for i, k in enumerate(hits):
            table = self.parts[k]
            assert isinstance(table, Table)
            for other in hits[:i]:
                if abs((self.parts[other].rate * table.kick)[0, 0]) > ZERO:
                    raise NotDecided("two stops are hit at once")
            z, pushed, slow = self._impact(z, table, held)
            ambiguous = ambiguous or pushed
            if slow:
                done.remove(k)
        return z, tuple(done), ambiguous

    def _impact(self, z: Any, table: Table, held: Sequence[Part]) -> tuple[Any, bool, bool]:
        """Newton's law with complementarity over the closed stops.

        The state, whether a closed stop takes an impulse, and whether a chatter is over.
        """
        u = table.rate_at(z)
        r = table.restitution(-u)
        slow = 0 < -r * u < SLOW and r < 1
        if slow:
            r = arb(0)
        active: list[Part] = [table]
        # by pivoting: a closed stop takes an impulse where it would close further
        for choice in sorted(product((False, True), repeat=len(held)), key=sum):
            active = [table, *(p for p, takes in zip(held, choice, strict=True) if takes)]
            rates = stacked([p.rate for p in active])
            kicks = stacked([p.kick.transpose() for p in active]).transpose()
            inertia = (rates * kicks).mid()
            if dependent(inertia):
                continue
            wanted = arb_mat(len(active), 1, [-(1 + r) * u] + [arb(0)] * (len(active) - 1))
            impulses = inertia.solve(wanted).mid()
            after = (z + kicks * impulses).mid()
            if all(x >= 0 for x in impulses.entries()) and all(
                p.rate_at(after) > -ZERO for p in held
            ):
                return after, len(active) > 1, slow
        raise NotDecided("the stops leave no way out")


def stacked(rows: list[Any]) -> Any:
    return arb_mat([row.entries() for row in rows])


def dependent(inertia: Any) -> bool:
    """Whether rows depend on each other."""
    size = arb(1)
    for i in range(inertia.nrows()):
        size *= inertia[i, i]
    return bool(abs(inertia.det().mid()) <= ZERO * abs(size))


def dependent_on(part: Part, fixed: list[Part]) -> bool:
    """Whether others hold what a part acts along."""
    both = [*(p for p in fixed if isinstance(p, Table)), part]
    rates = stacked([p.rate for p in both])
    kicks = stacked([p.kick.transpose() for p in both]).transpose()
    return len(both) > 1 and dependent((rates * kicks).mid())
