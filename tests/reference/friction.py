"""What stops and friction do to a chain, in many digits, as rows of (x, v, sine, cosine, one)."""

from collections.abc import Callable
from typing import Any

import sympy
from mpmath import mp

from dynkit.systems import DryFriction, Element, HardStop, ImpactLaw, SoftStop


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

    Its gap and the rate of it are rows of the state.
    """

    def __init__(self, element: Element, masses: list[Any], frequency: Any) -> None:
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
        self.gap, self.rate = mp.zeros(1, 2 * size + 3), mp.zeros(1, 2 * size + 3)
        self.kick = mp.zeros(2 * size + 3, 1)
        for i, mass in enumerate(masses):
            self.gap[i] = self.rate[size + i] = sign * row[i]
            self.kick[size + i] = sign * row[i] / mass
        for i, number in enumerate((m, b, place)):
            self.gap[2 * size + i] = -sign * number
        self.rate[2 * size] = sign * frequency * b
        self.rate[2 * size + 1] = -sign * frequency * m


class Table(Gap):
    """What a hard stop adds: its restitution at an approach velocity."""

    def __init__(self, stop: HardStop, masses: list[Any], frequency: Any) -> None:
        super().__init__(stop, masses, frequency)
        self.restitution = in_many_digits(stop.restitution)


class Cushion(Gap):
    """What a soft stop adds: its force as a row of the state."""

    def __init__(self, stop: SoftStop, masses: list[Any], frequency: Any) -> None:
        super().__init__(stop, masses, frequency)
        self.force = -mp.mpf(stop.stiffness) * self.gap - mp.mpf(stop.damping) * self.rate
        self.force[self.force.cols - 1] += mp.mpf(stop.preload)
        # of each regime what is positive in it, and what follows
        lifts, left = [(self.force, 2)] * bool(stop.damping), [(-self.gap, 0)]
        self.watched = [
            [(self.gap, 1)],
            lifts if stop.damping and not stop.preload else [*lifts, *left],
            [(-self.force, 1), *left],
        ]


class Rub(Gap):
    """What friction adds: forces as rows of the state, of which its rate is that of slip."""

    def __init__(self, friction: DryFriction, masses: list[Any], frequency: Any) -> None:
        super().__init__(friction, masses, frequency)
        one = mp.zeros(1, self.rate.cols)
        one[one.cols - 1] = 1
        self.rate -= (1 if friction.side == "above" else -1) * mp.mpf(friction.velocity) * one
        self.static = mp.mpf(friction.most)
        self.most = self.static * one
        way, along = mp.mpf(friction.force) * one, mp.mpf(friction.slope) * self.rate
        self.forces = [-way - along, way - along]
