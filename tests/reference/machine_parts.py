"""Elements of a machine, as rows of the state (x, v, stretches, sine, cosine, 1).

Each of them says in which regimes it may be, what it does to the flow there, and what is positive.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from flint import arb, arb_mat

from dynkit.systems import (
    DryFriction,
    Element,
    HardStop,
    ImpactLaw,
    Jenkins,
    PlasticBelow,
    SoftStop,
    ViscoelasticSpheres,
)
from tests.reference.rows import ZERO, Row

OPEN, CLOSED = range(2)
OUT, PRESS, LIFT = range(3)


def sine_cosine(x: float) -> tuple[Any, Any]:
    return arb(x).sin().mid(), arb(x).cos().mid()


class Part(ABC):
    """What an element acts along: its gap, the gap's rate, and what a unit impulse does."""

    def __init__(self, element: Element, inverse: Any, w: Any, width: int, place: int) -> None:
        n = inverse.nrows()
        row = [arb(0)] * n
        given = element.coordinate
        if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], int):
            row[given[0]], row[given[1]] = arb(-1), arb(1)
        elif isinstance(given, tuple):
            row = [arb(x) for x in given]
        else:
            row[given] = arb(1)
        sign = 1 if element.side == "above" else -1
        row = [sign * x for x in row]
        sine, cosine = sine_cosine(element.phase)
        swing = arb(element.amplitude) * cosine, -arb(element.amplitude) * sine
        self.place, self.size = place, n
        self.gap, self.rate = arb_mat(1, width), arb_mat(1, width)
        for i, x in enumerate(row):
            self.gap[0, i] = self.rate[0, n + i] = x
        self.gap[0, width - 3], self.gap[0, width - 2] = -sign * swing[0], -sign * swing[1]
        self.gap[0, width - 1] = -sign * arb(element.offset)
        self.rate[0, width - 3] = sign * w * swing[1]
        self.rate[0, width - 2] = -sign * w * swing[0]
        self.rate[0, width - 1] = -sign * arb(getattr(element, "velocity", 0.0))
        self.gap, self.rate = self.gap.mid(), self.rate.mid()
        self.kick = arb_mat(width, 1)
        pushed = (inverse * arb_mat(n, 1, row)).mid()
        for i in range(n):
            self.kick[n + i, 0] = pushed[i, 0]
        self.one = arb_mat(1, width)
        self.one[0, width - 1] = 1
        self.sign = sign
        self.jumps = False  # whether more than one force may balance the others

    def gap_at(self, z: Any) -> Any:
        return (self.gap * z)[0, 0].mid()

    def rate_at(self, z: Any) -> Any:
        return (self.rate * z)[0, 0].mid()

    def add(self, matrix: Any, force: Any) -> None:
        """Add a force, a row, to the flow; modified in place."""
        for i in range(matrix.nrows()):
            if self.kick[i, 0] != 0:
                for j in range(matrix.ncols()):
                    matrix[i, j] = (matrix[i, j] + self.kick[i, 0] * force[0, j]).mid()

    @abstractmethod
    def first(self, z: Any) -> int:
        """The regime at a start, before anything is decided."""

    @abstractmethod
    def choices(self, z: Any, now: int) -> tuple[int, ...]:
        """Regimes that the state leaves open."""

    @abstractmethod
    def watched(self, now: int, force: Any) -> list[Row]:
        """What is positive in a regime."""

    def push(self, matrix: Any, now: int) -> None:  # noqa: B027
        """Add the force of a regime to the flow."""

    def follow(self, matrix: Any, now: int) -> None:  # noqa: B027
        """Set the rate of the element's own state."""

    def fixes(self, now: int) -> bool:
        """Whether it holds the rate of its gap at zero."""
        return False

    def slips(self, now: int) -> bool:
        return False

    def marks(self, now: int) -> bool:
        """Whether the end of a regime is a section of machines that nothing drives."""
        return self.slips(now)

    def may_stay(self, now: int) -> bool:
        """Whether a regime goes on where what is watched stays zero."""
        return True


class Table(Part):
    """A hard stop."""

    def __init__(self, element: HardStop, inverse: Any, w: Any, width: int, place: int) -> None:
        super().__init__(element, inverse, w, width, place)
        self.law = element.restitution

    def restitution(self, u: Any) -> Any:
        law: Any = self.law
        if isinstance(law, PlasticBelow):
            return arb(0) if u < arb(law.velocity) else arb(law.rebound)
        if isinstance(law, ViscoelasticSpheres):
            root = u.root(5)
            r = (1 - arb(law.dissipation) * root + arb(law.second) * root**2).mid()
            return r if r > 0 else arb(0)
        return arb(law.expression(u) if isinstance(law, ImpactLaw) else law).mid()

    def first(self, z: Any) -> int:
        return OPEN

    def choices(self, z: Any, now: int) -> tuple[int, ...]:
        if abs(self.gap_at(z)) > ZERO or abs(self.rate_at(z)) > ZERO:
            return (OPEN,)
        return CLOSED, OPEN

    def watched(self, now: int, force: Any) -> list[Row]:
        return [Row(force if now == CLOSED else self.gap)]

    def fixes(self, now: int) -> bool:
        return now == CLOSED


class Cushion(Part):
    """A soft stop."""

    def __init__(self, element: SoftStop, inverse: Any, w: Any, width: int, place: int) -> None:
        super().__init__(element, inverse, w, width, place)
        p, k, c = arb(element.preload), arb(element.stiffness), arb(element.damping)
        self.force = (self.one * p - self.gap * k - self.rate * c).mid()
        self.lifts, self.jumps = c != 0, p != 0

    def first(self, z: Any) -> int:
        return OUT

    def choices(self, z: Any, now: int) -> tuple[int, ...]:
        gap, force = self.gap_at(z), (self.force * z)[0, 0].mid()
        if gap > ZERO:
            return (OUT,)
        pressing = (PRESS, LIFT) if self.lifts else (PRESS,)
        if gap > -ZERO:
            return OUT, *pressing
        if not self.lifts or abs(force) <= ZERO:
            return pressing
        return (PRESS,) if force > 0 else (LIFT,)

    def watched(self, now: int, force: Any) -> list[Row]:
        if now == OUT:
            return [Row(self.gap)]
        inside = Row(-self.gap)
        if now == LIFT:
            return [inside, Row(-self.force)]
        return [inside, Row(self.force)] if self.lifts else [inside]

    def push(self, matrix: Any, now: int) -> None:
        if now == PRESS:
            self.add(matrix, self.force)

    def marks(self, now: int) -> bool:
        return now == OUT


class Rub(Part):
    """Dry friction."""

    STICK: ClassVar = 0
    FORWARD: ClassVar = 1
    BACKWARD: ClassVar = 2
    REST: ClassVar = 3

    def __init__(self, element: DryFriction, inverse: Any, w: Any, width: int, place: int) -> None:
        super().__init__(element, inverse, w, width, place)
        kinetic, along = self.one * arb(element.force), self.rate * arb(element.slope)
        self.most = (self.one * arb(element.most)).mid()
        self.forces = {
            self.FORWARD: (-kinetic - along).mid(),
            self.BACKWARD: (kinetic - along).mid(),
        }
        self.jumps = element.most != element.force
        self.leads = True

    def joins(self, other: Rub) -> bool:
        """Act as one with other friction along the same row over the same surface, if it is."""
        share = self._share(other)
        if share is None:
            return False
        size = abs(share)
        other.most = (other.most + self.most * size).mid()
        ways = (1, 2) if share > 0 else (2, 1)
        for way, own in zip((1, 2), ways, strict=True):
            other.forces[way] = (other.forces[way] + self.forces[own] * share).mid()
        other.jumps = other.jumps or self.jumps
        self.leads = False
        return True

    def _share(self, other: Rub) -> Any:
        """How fast it slips where the other slips by one; None where that is open."""
        mine, others = self.rate.entries(), other.rate.entries()
        k = max(range(len(others)), key=lambda i: abs(float(others[i])))
        share = mine[k] / others[k]
        same = all(abs(a - share * b) < ZERO for a, b in zip(mine, others, strict=True))
        return share.mid() if same and share != 0 else None

    def first(self, z: Any) -> int:
        rate = self.rate_at(z)
        return self.STICK if abs(rate) <= ZERO else self.FORWARD if rate > 0 else self.BACKWARD

    def choices(self, z: Any, now: int) -> tuple[int, ...]:
        if not self.leads:
            return (self.REST,)
        first = self.first(z)
        return (first,) if first else (self.STICK, self.FORWARD, self.BACKWARD, self.REST)

    def watched(self, now: int, force: Any) -> list[Row]:
        if now == self.REST:  # nothing moves it
            return [Row(self.rate), Row(-self.rate)] if self.leads else []
        if now == self.STICK:
            return [Row((self.most - force).mid()), Row((self.most + force).mid())]
        return [Row(self.rate if now == self.FORWARD else -self.rate)]

    def push(self, matrix: Any, now: int) -> None:
        if now in self.forces:
            self.add(matrix, self.forces[now])

    def fixes(self, now: int) -> bool:
        return now == self.STICK

    def slips(self, now: int) -> bool:
        return now in self.forces

    def may_stay(self, now: int) -> bool:
        return now not in self.forces


class Joint(Part):
    """A spring and a slider in series; the stretch of the spring is a state."""

    STICK: ClassVar = 0
    FORWARD: ClassVar = 1
    BACKWARD: ClassVar = 2

    def __init__(self, element: Jenkins, inverse: Any, w: Any, width: int, place: int) -> None:
        super().__init__(element, inverse, w, width, place)
        pull = arb_mat(1, width)
        pull[0, place] = 1
        self.reach = (arb(element.force) / arb(element.stiffness)).mid()
        most = self.one * self.reach
        self.margins = [Row((most - pull).mid()), Row((most + pull).mid())]
        force = self.one * arb(element.force)
        self.forces = [(pull * -arb(element.stiffness)).mid(), -force, force]

    def stretched(self, z: Any, place: Any) -> Any:
        """The stretch where the slider is at a place; one as far off as it may be is exactly so."""
        along = sum((self.gap[0, i] * z[i, 0] for i in range(self.size)), arb(0))
        stretch = (along - self.sign * place).mid()
        if abs(abs(stretch) - self.reach) < arb(10) ** -12:
            return self.reach if stretch > 0 else -self.reach
        return stretch

    def slider(self, z: Any) -> Any:
        """Where the slider is."""
        along = sum((self.gap[0, i] * z[i, 0] for i in range(self.size)), arb(0))
        return (self.sign * (along - z[self.place, 0])).mid()

    def first(self, z: Any) -> int:
        return self.STICK

    def choices(self, z: Any, now: int) -> tuple[int, ...]:
        stretch = z[self.place, 0]
        if abs(stretch) < self.reach - ZERO:
            return (self.STICK,)
        slides = self.FORWARD if stretch > 0 else self.BACKWARD
        rate = self.rate_at(z)
        if abs(rate) > ZERO:
            return (slides,) if (rate > 0) == (stretch > 0) else (self.STICK,)
        return self.STICK, slides

    def watched(self, now: int, force: Any) -> list[Row]:
        if now == self.STICK:
            return self.margins
        return [Row(self.rate if now == self.FORWARD else -self.rate)]

    def push(self, matrix: Any, now: int) -> None:
        self.add(matrix, self.forces[now])

    def follow(self, matrix: Any, now: int) -> None:
        for j in range(matrix.ncols()):
            matrix[self.place, j] = self.rate[0, j] if now == self.STICK else 0

    def may_stay(self, now: int) -> bool:
        return now == self.STICK


def part_of(element: Element, inverse: Any, w: Any, width: int, place: int) -> Part:
    """The part of a machine that an element is."""
    kinds: dict[type, type[Part]] = {
        HardStop: Table,
        SoftStop: Cushion,
        DryFriction: Rub,
        Jenkins: Joint,
    }
    return kinds[type(element)](element, inverse, w, width, place)
