"""Linear machines in other coordinates: their mass matrices vary, and so do the rows of stops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import sympy as sp

from dynkit.systems import HardStop, ImpactChain, ImpactOscillator

WIDE: dict[str, Any] = {"step": 0.1, "largest_step": 0.25}
"""Steps along branches of which only the bifurcations, or the ends, are compared."""


@dataclass(frozen=True, kw_only=True)
class Bent(ImpactOscillator):
    """The chain of one or two masses, whose displacements are bent functions of the coordinates.

    The last one is q + last q^3, the first one of two also holds the square of the second.
    """

    masses: int = 2
    damping: float = 0.1
    bend: float = 0.1
    last: float = 0.12

    @property
    def degrees_of_freedom(self) -> int:
        return self.masses

    def places(self, q: Any) -> list[Any]:
        """Return the displacements of the chain."""
        end = q[-1] + self.last * q[-1] ** 3
        return [*(y + self.bend * y**3 + self.bend * q[-1] ** 2 for y in q[:-1]), end]

    def _speeds(self, q: Any, v: Any) -> list[Any]:
        return [sum(p.diff(y) * u for y, u in zip(q, v, strict=True)) for p in self.places(q)]

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return sum(u**2 for u in self._speeds(x, v)) / 2

    def potential(self, x: Any) -> Any:
        return _springs(self.places(x)) / 2

    def dissipation(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return self.damping * _springs(self._speeds(x, v)) / 2

    def end(self, x: Any) -> Any:
        """Return the displacement of the last mass."""
        return self.places(x)[-1]

    def beside(self, exact: Any) -> tuple[Any, Any]:
        """States of the chain and of this, on an orbit of the chain, farthest off the table."""
        times = np.linspace(0.0, exact.period, 65)
        phases = exact.phases[0] + exact.system.frequency * times
        x, v = exact.sample(times)
        k = int(np.argmax(x[:, -1] - 0.15 * np.sin(phases)))
        end = _inverse(self.last, x[k, -1])
        q = [*(_inverse(self.bend, y - self.bend * end**2) for y in x[k, :-1]), end]
        slopes = np.diag(
            1.0 + 3.0 * np.array([self.bend, self.last])[-self.masses :] * np.square(q)
        )
        slopes[:-1, -1] = 2.0 * self.bend * end
        own = self.state(q, np.linalg.solve(slopes, v[k]), phases[k])
        return exact.system.state(x[k], v[k], phases[k]), own


@dataclass(frozen=True, kw_only=True)
class Leaning(Bent):
    """The chain of three masses, of which only the first displacement is no coordinate."""

    masses: int = 3

    def places(self, q: Any) -> list[Any]:
        first = q[0] + self.bend * q[0] ** 3 + self.bend * (q[1] + q[2]) ** 2
        return [first, *q[1:]]


def _inverse(cubic: float, y: float) -> float:
    """Where q + cubic q^3 is y."""
    roots = np.roots([cubic, 0.0, 1.0, -y])
    return float(roots[np.argmin(abs(roots.imag))].real)


def _springs(x: list[Any]) -> Any:
    return sum((b - a) ** 2 for a, b in zip([sp.Integer(0), *x], x, strict=False))


def both(
    masses: int, *, straight: bool = False, restitution: float = 0.85, **given: Any
) -> tuple[Any, Any]:
    """The chain, and the bent one; straight where the stop acts along a coordinate."""
    given = {"damping": 0.15, **given}  # numbers that are equal would be one
    exact = ImpactChain(masses=masses, restitution=restitution, **given)
    at: Any = masses - 1 if straight else "end"
    table = HardStop(at, amplitude=0.1, restitution=restitution, name="table")
    last = 0.0 if straight else 0.12
    return exact, Bent(masses=masses, last=last, elements=[table], **given)


def orbits_of(chain: Any, bent: Any, start: Any = None) -> tuple[Any, Any]:
    """The orbit of the chain's attractor, and that of the bent chain, sought from one place."""
    found = chain.attractor(transient=60, keep=60, start=start).periodic_orbit()
    pairs = zip((chain, bent), bent.beside(found), strict=True)
    exact, own = (m.periodic_orbit(periods=found.periods, start=state) for m, state in pairs)
    return exact, own


def orbits_agree(exact: Any, bent: Any, parameters: Sequence[str]) -> None:
    """Assert that both are one orbit, with the same derivatives by some parameters."""
    assert bent.error < 1e-11
    assert (exact.label, dict(exact.counts)) == (bent.label, dict(bent.counts))
    assert (exact.admissible, bent.admissible) == (True, True)
    assert abs(exact.phases - bent.phases).max() <= exact.error + bent.error
    assert np.poly(bent.multipliers) == pytest.approx(np.poly(exact.multipliers), abs=1e-11)
    for parameter in parameters:
        one, two = (changes(orbit, parameter) for orbit in (exact, bent))
        assert one == pytest.approx(two, rel=1e-10, abs=1e-10)


def changes(orbit: Any, parameter: str) -> Any:
    """Of phases and impulses, which come first, whatever the other unknowns are."""
    problem = orbit._problem.free(parameter)
    x, p = orbit._x, problem.values
    by = problem.parameter_derivative(x, p)[:, 0]
    found = np.linalg.solve(problem.linearization(x, p), -by)
    return found[: problem.layout.events + problem.layout.impacts]
