"""Several multipliers or eigenvalues that pass the border of stability within one step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit import Branch, continue_orbit, equilibrium, periodic_orbit
from dynkit.systems import ImpactChain, SymbolicFlow, SymbolicMap


class DoublingRing(SymbolicMap):
    """Three logistic maps in a ring: multipliers 2 - p, and 1 - 3c times that, twice."""

    p: float = 2.5
    c: float = 0.1

    def next_state(self, x: Any, y: Any, z: Any) -> Any:
        a, b, c = (self.p * each * (1 - each) for each in (x, y, z))
        mean = self.c * (a + b + c)
        return tuple((1 - 3 * self.c) * each + mean for each in (a, b, c))


class PitchforkRing(SymbolicMap):
    p: float = 0.5
    c: float = 0.1

    def next_state(self, x: Any, y: Any, z: Any) -> Any:
        a, b, c = (self.p * each - each**3 for each in (x, y, z))
        mean = self.c * (a + b + c)
        return tuple((1 - 3 * self.c) * each + mean for each in (a, b, c))


class TurningRing(SymbolicMap):
    """Two equal maps of a plane: the multipliers p exp(+-i), twice."""

    p: float = 0.5

    def next_state(self, x: Any, y: Any, u: Any, v: Any) -> Any:
        def turned(a: Any, b: Any) -> Any:
            size = self.p - a**2 - b**2
            return size * (0.6 * a - 0.8 * b), size * (0.8 * a + 0.6 * b)

        return (*turned(x, y), *turned(u, v))


class OscillatingRing(SymbolicFlow):
    """Three oscillators in a ring: growths p, and p - 3c twice."""

    p: float = -0.5
    c: float = 0.1

    def velocity(self, x: Any, y: Any, z: Any, u: Any, v: Any, w: Any) -> Any:
        mean = self.c * (x + y + z)
        ahead = ((self.p - 3 * self.c) * a + mean - b - a**3 for a, b in ((x, u), (y, v), (z, w)))
        return (*ahead, x, y, z)


def found_on(branch: Branch, kind: str, exact: list[float]) -> None:
    assert [str(found.kind) for found in branch.bifurcations] == [kind] * len(exact)
    for found, value in zip(branch.bifurcations, sorted(exact), strict=True):
        assert found.error < 1e-12
        assert found.value == pytest.approx(value, abs=found.error + 1e-15)


@pytest.mark.parametrize("c", [0.1, -0.1])
@pytest.mark.parametrize("step", [0.002, 0.01, 0.05])
def test_double_multipliers_of_a_ring_are_found(c: float, step: float) -> None:
    most = 5.0 * step
    doubling = periodic_orbit(DoublingRing(c=c), [0.6] * 3)
    branch = continue_orbit(doubling, "p", bounds=(1.5, 6.0), step=step, largest_step=most)
    found_on(branch, "PD", [3.0, 2.0 + 1.0 / (1.0 - 3.0 * c)])
    at = {found.value: found for found in branch.bifurcations}
    (double,) = (at[value] for value in at if abs(value - 3.0) > 0.1)
    assert double.criticality is None  # its normal form has two coordinates
    assert str(double.switch()[0].label) == "P(2)"
    crossing = periodic_orbit(PitchforkRing(c=c), [0.0] * 3)
    branch = continue_orbit(crossing, "p", bounds=(0.3, 2.0), step=step, largest_step=most)
    found_on(branch, "BP", [1.0, 1.0 / (1.0 - 3.0 * c)])


def test_double_pairs_are_found() -> None:
    branch = continue_orbit(periodic_orbit(TurningRing(), [0.0] * 4), "p", bounds=(0.3, 2.0))
    found_on(branch, "NS", [1.0])
    angle = np.arctan2(0.8, 0.6) / (2.0 * np.pi)
    assert branch.bifurcations[0].rotation_number == pytest.approx(angle, abs=1e-14)
    for c in (0.1, -0.1):
        start = equilibrium(OscillatingRing(c=c), [0.0] * 6)
        found_on(continue_orbit(start, "p", bounds=(-0.7, 1.0)), "HB", [0.0, 3.0 * c])


class Beside(SymbolicMap):
    """Multipliers -p and -(1 + rate (p - 1 - apart)) at zero."""

    p: float = 0.5
    apart: float = 0.02
    rate: float = 1.0

    def next_state(self, x: Any, y: Any) -> Any:
        return -self.p * x + x**3, -(1 + self.rate * (self.p - 1 - self.apart)) * y + y**3


class TurningBeside(SymbolicMap):
    """The same of two pairs, at angles 0.93 and 1.97."""

    p: float = 0.5
    apart: float = 0.02
    rate: float = 1.0

    def next_state(self, x: Any, y: Any, u: Any, v: Any) -> Any:
        here = self.p - x**2 - y**2
        there = 1 + self.rate * (self.p - 1 - self.apart) - u**2 - v**2
        return (
            here * (0.6 * x - 0.8 * y),
            here * (0.8 * x + 0.6 * y),
            there * (-5 * u - 12 * v) / 13,
            there * (12 * u - 5 * v) / 13,
        )


@pytest.mark.parametrize("apart", [0.02, 0.005, 0.001])
@pytest.mark.parametrize("rate", [1.0, 0.5, -1.0, -0.5])
@pytest.mark.parametrize("step", [0.003, 0.01, 0.04])
@pytest.mark.parametrize(("system", "kind"), [(Beside(), "PD"), (TurningBeside(), "NS")])
def test_two_that_pass_within_a_step_are_found_in_either_direction(
    system: SymbolicMap, kind: str, step: float, rate: float, apart: float
) -> None:
    start = periodic_orbit(system.replace(apart=apart, rate=rate), [0.0] * system.dimension)
    branch = continue_orbit(start, "p", bounds=(0.4, 1.7), step=step, largest_step=4.0 * step)
    found_on(branch, kind, [1.0, 1.0 + apart])


def test_several_pairs_within_a_step_are_found() -> None:
    chain = ImpactChain(masses=100, frequency=0.87)
    start, bounds = chain.periodic_orbit(periods=3), (0.82, 0.95)
    fine = continue_orbit(start, "frequency", bounds=bounds, step=0.001, largest_step=0.002)
    branch = continue_orbit(start, "frequency", bounds=bounds)
    assert len(fine) > 10 * len(branch)
    assert [found.kind for found in branch.bifurcations] == [it.kind for it in fine.bifurcations]
    assert len(branch.bifurcations) == 14
    for found, other in zip(branch.bifurcations, fine.bifurcations, strict=True):
        assert abs(found.value - other.value) <= found.error + other.error
