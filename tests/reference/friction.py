"""What stops and friction do to a chain, in many digits, as rows of (x, v, sine, cosine, one).

And of how far the springs of joints are stretched, one number each.
"""

from collections.abc import Callable
from typing import Any

import sympy
from mpmath import mp

from dynkit.systems import DryFriction, Element, HardStop, ImpactLaw, Jenkins, SoftStop


def in_many_digits(law: Any) -> Callable[[Any], Any]:
    """Restitution as a function of the approach velocity; its numbers are those of the doubles."""
    if not isinstance(law, ImpactLaw):
        return lambda _: mp.mpf(law)
    velocity = sympy.Symbol("u", positive=True)
    found: Callable[[Any], Any] = sympy.lambdify(velocity, law.expression(velocity), "mpmath")
    return found


FORWARD, BACKWARD, STICK = range(3)


class Gap:
    """What an element acts along, and what a unit impulse or force along it does to the state.

    Its gap and the rate of it are rows of the state, which ends with so many stretched springs.
    """

    def __init__(
        self, element: Element, masses: list[Any], frequency: Any, springs: int = 0
    ) -> None:
        size, sign = len(masses), 1 if element.side == "above" else -1
        row = mp.zeros(size, 1)
        if isinstance(element.coordinate, tuple):
            if len(element.coordinate) == 2 and isinstance(element.coordinate[0], int):
                before, after = element.coordinate
                row[before % size], row[after % size] = -1, 1
            else:
                for i, part in enumerate(element.coordinate):
                    row[i] = mp.mpf(part)
        else:
            row[element.coordinate % size] = 1
        lag, place = mp.mpf(element.phase), mp.mpf(element.offset)
        m, b = element.amplitude * mp.cos(lag), -element.amplitude * mp.sin(lag)
        numbers = 2 * size + 3 + springs
        self.gap, self.rate = mp.zeros(1, numbers), mp.zeros(1, numbers)
        self.kick, self.one = mp.zeros(numbers, 1), mp.zeros(1, numbers)
        self.one[2 * size + 2] = 1
        for i, mass in enumerate(masses):
            self.gap[i] = self.rate[size + i] = sign * row[i]
            self.kick[size + i] = sign * row[i] / mass
        for i, number in enumerate((m, b, place)):
            self.gap[2 * size + i] = -sign * number
        self.rate[2 * size] = sign * frequency * b
        self.rate[2 * size + 1] = -sign * frequency * m


class Table(Gap):
    """What a hard stop adds: its restitution at an approach velocity."""

    def __init__(self, stop: HardStop, masses: list[Any], frequency: Any, springs: int = 0) -> None:
        super().__init__(stop, masses, frequency, springs)
        self.restitution = in_many_digits(stop.restitution)


class Cushion(Gap):
    """What a soft stop adds: its force as a row of the state."""

    def __init__(self, stop: SoftStop, masses: list[Any], frequency: Any, springs: int = 0) -> None:
        super().__init__(stop, masses, frequency, springs)
        self.force = -mp.mpf(stop.stiffness) * self.gap - mp.mpf(stop.damping) * self.rate
        self.preload = mp.mpf(stop.preload)
        self.force += self.preload * self.one
        # of each regime what is positive in it, and what follows
        lifts, left = [(self.force, 2)] * bool(stop.damping), [(-self.gap, 0)]
        self.watched = [
            [(self.gap, 1)],
            lifts if stop.damping and not stop.preload else [*lifts, *left],
            [(-self.force, 1), *left],
            [],
        ]

    def bounds(self, force: Any) -> list[tuple[Any, int]]:
        """Of a mass that rests by this force, a row, what is positive, and what follows."""
        return [(force, 0), (self.preload * self.one - force, 1)]


class Rub(Gap):
    """What friction adds: forces as rows of the state, of which its rate is that of slip.

    With a coefficient it leans on the hard stop of this number; the forces are without traction.
    """

    def __init__(
        self,
        friction: DryFriction,
        masses: list[Any],
        frequency: Any,
        springs: int = 0,
        stop: int | None = None,
    ) -> None:
        super().__init__(friction, masses, frequency, springs)
        self.stop, self.coefficient = stop, mp.mpf(friction.coefficient or 0.0)
        one = self.one
        self.rate -= (1 if friction.side == "above" else -1) * mp.mpf(friction.velocity) * one
        self.static = mp.mpf(friction.most)
        self.most = self.static * one
        way, along = mp.mpf(friction.force or 0.0) * one, mp.mpf(friction.slope) * self.rate
        self.forces = [-way - along, way - along]


class Joint(Gap):
    """A spring and a slider in series: forces, of its regimes what is positive, and what follows.

    The stretch of its spring is number `which` of the springs; while it sticks its rate is that of
    the gap, over the surface.
    """

    def __init__(
        self, joint: Jenkins, masses: list[Any], frequency: Any, springs: int, which: int
    ) -> None:
        super().__init__(joint, masses, frequency, springs)
        sign = 1 if joint.side == "above" else -1
        self.rate -= sign * mp.mpf(joint.velocity) * self.one
        self.place = 2 * len(masses) + 3 + which
        pull = mp.zeros(1, self.rate.cols)
        pull[self.place] = mp.mpf(joint.stiffness)
        self.reach = mp.mpf(joint.force) / mp.mpf(joint.stiffness)
        most = mp.mpf(joint.force) * self.one
        self.forces = [-most, most, -pull]
        self.watched = [
            [(self.rate, STICK)],
            [(-self.rate, STICK)],
            [(most - pull, FORWARD), (most + pull, BACKWARD)],
        ]
