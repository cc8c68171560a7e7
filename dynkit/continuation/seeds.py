"""Orbits that the exploration of a network starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, final, runtime_checkable

import numpy as np

from dynkit.continuation.newton import NoConvergence
from dynkit.continuation.problem import NoSolution
from dynkit.maps import Map
from dynkit.no_motion import NoMotion
from dynkit.validation import Array, finite_array

if TYPE_CHECKING:
    from dynkit.orbits import PeriodicOrbit

SEARCHED = 3
"""Orbits of more states than this are not searched for from guesses; they branch off others."""

_GUESSES = 20
_ROUNDING = 1e-14


@runtime_checkable
class OffersOrbits(Protocol):
    """A system that finds periodic orbits itself.

    ``periodic_orbits(impacts=n, periods=m)`` returns orbits P(n,m), always the same.
    """

    def periodic_orbits(self, *, impacts: int, periods: int) -> Sequence[PeriodicOrbit]:
        """Return orbits P(n,m)."""
        ...


def checked_box(box: Any, dimension: int) -> Array:
    """Return least and greatest coordinates, (d, 2).

    Raises
    ------
    ValueError
        When they are not.
    """
    found = finite_array("box", box, (dimension, 2))
    for i in np.flatnonzero(~(found[:, 0] < found[:, 1]))[:1].tolist():
        raise ValueError(f"box[{i}] must be (low, high) with low < high; got {found[i].tolist()}")
    return found


@final
@dataclass(frozen=True, eq=False)
class Offers:
    """P(n,m) that a system offers: all of them for n = 1, the admissible ones of more impacts."""

    system: Map
    impacts: int
    periods: int

    def __call__(self) -> list[PeriodicOrbit]:
        assert isinstance(self.system, OffersOrbits)
        found = self.system.periodic_orbits(impacts=self.impacts, periods=self.periods)
        return [orbit for orbit in found if self.impacts == 1 or orbit.admissible]


def offered(systems: Sequence[Map], impacts: int, periods: int) -> list[Offers]:
    """Return what to ask the systems for: all P(1,m), then P(n,m) of more impacts."""
    return [
        Offers(system, n, m)
        for n in range(1, min(impacts, SEARCHED) + 1)
        for m in range(1, periods + 1)
        for system in systems
    ]


@final
@dataclass(frozen=True, eq=False)
class Search:
    """P(n) of a map that Newton's method finds from guesses in a box, always the same."""

    system: Map
    box: Array
    states: int

    def __call__(self) -> list[PeriodicOrbit]:
        from dynkit.map_orbits import periodic_orbit

        system, box, n = self.system, self.box, self.states
        found: list[PeriodicOrbit] = []
        random = np.random.default_rng(n)
        for guess in random.uniform(box[:, 0], box[:, 1], (_GUESSES, len(box))):
            try:
                orbit = periodic_orbit(system, guess, period=n)
                small = abs(orbit.states) <= _ROUNDING * abs(box).max()
                if small.any():
                    # numbers that have no digits but rounding are zero
                    orbit = periodic_orbit(system, np.where(small, 0.0, orbit.states))
            except (NoMotion, NoConvergence, NoSolution):
                continue
            if orbit.period == n:
                found.append(orbit)
        return found


def searched(systems: Sequence[Map], box: Array, states: int) -> list[Search]:
    """Return the searches for orbits of maps, of up to so many states."""
    counts = range(1, min(states, SEARCHED) + 1)
    return [Search(system, box, n) for n in counts for system in systems]
