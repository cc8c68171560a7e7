"""Orbits that the exploration of a network starts from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeAlias, final, runtime_checkable

import numpy as np

from dynkit.continuation.orbit_search import OrbitSearch, find_orbits
from dynkit.maps import Map
from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.orbits import PeriodicOrbit

SEARCHED = 3
"""Orbits of more impacts than this are not asked for; they branch off others."""

Search: TypeAlias = Callable[[], OrbitSearch]


@runtime_checkable
class OffersOrbits(Protocol):
    """A system that finds periodic orbits itself.

    ``periodic_orbits(impacts=n, periods=m)`` returns orbits P(n,m), always the same.
    """

    def periodic_orbits(self, *, impacts: int, periods: int) -> Sequence[PeriodicOrbit]:
        """Return orbits P(n,m)."""
        ...


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


def searched(systems: Sequence[Map], box: Array, states: int, calls: int) -> list[Search]:
    """Return the searches for orbits of maps, of up to so many states."""
    return [partial(find_orbits, system, states, box, calls=calls) for system in systems]


def told_of_searches(searches: Sequence[OrbitSearch], where: str) -> str:
    """Return what searches of one box, at values of a parameter, looked at."""
    period = searches[0].period
    regions = np.array([search.region for search in searches])
    sides = [f"[{a.min():.6g}, {b.max():.6g}]" for a, b in np.moveaxis(regions, 0, -1)]
    asked = "P(1)" if period == 1 else f"P(1) to P({period})"
    resolved = Counter(search.resolved for search in searches)
    parts = [
        f"up to P({n}) at {count} of them" if n else f"not at all at {count} of them"
        for n, count in sorted(resolved.items(), reverse=True)
    ]
    return f"{asked} with states in {' x '.join(sides)} {where}, resolved {', '.join(parts)}"
