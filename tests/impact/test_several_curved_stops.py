"""Stops along functions of the coordinates beside others and friction: closed forms, chains."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

from dynkit.systems import DryFriction, HardStop, ImpactChain, ImpactOscillator, SoftStop
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact_orbits.bent_cases import Leaning


class Ring(ImpactOscillator):
    """A free particle between two circular walls."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return sp.Integer(0)

    def square(self, x: Any) -> Any:
        """Return the square of the distance from the centre."""
        return x[0] ** 2 + x[1] ** 2


def ring(restitution: float) -> Ring:
    outer = HardStop("square", offset=1.0, side="below", restitution=restitution)
    inner = HardStop("square", offset=0.16, restitution=restitution)
    return Ring(frequency=1.0, elements=[outer, inner])


@pytest.mark.parametrize("r", [1.0, 0.8])
def test_a_particle_between_two_circles_moves_along_chords(r: float) -> None:
    system = ring(r)
    x, v, time = np.array([0.7, 0.0]), np.array([-0.3, 0.05]), 0.0
    record = system.simulate(impacts=15, start=system.state(x, v))
    for found, place in zip(record.time, record.position, strict=True):
        b, a = x @ v, v @ v
        times = []
        for radius, sign in ((1.0, 1.0), (0.4, -1.0)):
            root = b * b - a * (x @ x - radius**2)
            times += [(-b + sign * root**0.5) / a] if root > 0.0 else []
        length = min(t for t in times if t > 1e-9)
        x, time = x + v * length, time + length
        v = v - (1.0 + r) * (v @ x) / (x @ x) * x
        assert abs(found - time) < 1e-11
        assert abs(place - x).max() < 1e-11
    balance = record.energy_balance()
    assert balance.error < 1e-14
    assert -balance.change == pytest.approx(0.04625 - 0.5 * v @ v, abs=1e-12)
    assert set(record.events.element.tolist()) == {0, 1}
    jacobian_is_the_derivative(system, record.states[4:6])


class Machine(Leaning):
    """A chain of three masses; the displacement of the first one is a function of coordinates."""

    def first(self, x: Any) -> Any:
        """Return that displacement."""
        return self.places(x)[0]


def beside(first: Any) -> dict[str, list[Any]]:
    """Elements of a chain, whose first coordinate may have a name."""
    table = HardStop(2, amplitude=0.1, restitution=0.3)
    wall = HardStop(first, amplitude=0.1, restitution=0.6)
    return {
        "another stop": [table, HardStop(first, offset=-0.01, restitution=0.4)],
        "facing": [wall, HardStop(first, offset=0.22, side="below", restitution=0.5)],
        "friction": [wall, DryFriction(1, force=0.02, static=0.03, velocity=0.1)],
        "preload": [
            wall,
            SoftStop(1, offset=0.05, stiffness=20.0, damping=0.3, preload=0.05),
        ],
    }


@pytest.mark.parametrize("name", beside(0))
def test_motions_are_those_of_the_chain(name: str) -> None:
    given: dict[str, Any] = {"frequency": 0.9, "damping": 0.15}
    exact = ImpactChain(masses=3, elements=beside(0)[name], **given)
    bent = Machine(elements=beside("first")[name], **given)
    q = np.array([0.2, 0.1, 0.2])
    x = [float(place) for place in bent.places(q)]
    one = exact.simulate(impacts=10, start=exact.state(x, [0.0] * 3))
    two = bent.simulate(impacts=10, start=bent.state(q, [0.0] * 3))
    bound = one.error[-1] + two.error[-1]
    assert bound < 1e-9
    assert repr(one.events) == repr(two.events)
    assert abs(one.position - np.array(bent.places(two.position.T)).T).max() <= bound
    heat = two.energy_balance().dissipated
    assert heat == pytest.approx(one.energy_balance().dissipated, abs=1e-10)
    count = 2 if name in ("another stop", "facing") else 1
    jacobian_is_the_derivative(bent, two.states[3 : 3 + count])
    half = bent.simulate(impacts=5, start=bent.state(q, [0.0] * 3)).final
    assert (bent.simulate(impacts=5, start=half).states == two.states[5:]).all()


def test_a_start_beyond_one_of_two_walls_is_named() -> None:
    for place, word in ((1.2, "above"), (0.1, "below")):
        with pytest.raises(ValueError, match=f"square of the position must not be {word}"):
            ring(1.0).state([place, 0.0], [0.0, 0.0])
