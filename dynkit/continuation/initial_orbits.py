"""Orbits that the exploration of a network starts from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.orbits.search import OrbitSearch, find_orbits

Search: TypeAlias = Callable[[], OrbitSearch[Any]]

Told: TypeAlias = Callable[[Sequence[OrbitSearch[Any]]], str]
"""What searches looked at, in words."""


@runtime_checkable
class FindsOrbits(Protocol):
    """A system that finds periodic orbits itself.

    ``find_orbits(impacts=n, periods=m)`` returns orbits up to P(n,m), always the same.
    """

    def find_orbits(self, *, impacts: int, periods: int) -> OrbitSearch[Any]:
        """Return orbits up to P(n,m), and what was searched."""
        ...


def offered(systems: Sequence[Map], impacts: int, periods: int) -> list[Search]:
    """Return the searches of systems that find orbits themselves, of orbits up to P(n,m)."""
    return [
        partial(system.find_orbits, impacts=impacts, periods=periods)
        for system in systems
        if isinstance(system, FindsOrbits)
    ]


def searched(systems: Sequence[Map], box: Array, states: int, calls: int) -> list[Search]:
    """Return the searches for orbits of maps, of up to so many states."""
    return [partial(find_orbits, system, states, box, calls=calls) for system in systems]


def told_of_counts(impacts: int, counts: Mapping[str, int]) -> str:
    """Return what searches of systems that find orbits themselves looked at.

    Parameters
    ----------
    impacts : int
        The largest n of P(n,m).
    counts : mapping
        Of the random ``guesses``, the ``starts``, and the ``impacts`` simulated from them.
    """
    told = "P(1,m) from their closed form"
    if counts["guesses"]:
        guessed = "P(2,m)" if impacts == 2 else "P(2,m) and P(3,m)"
        told += f", {guessed} from {counts['guesses']} random guesses"
    if counts["starts"]:
        told += (
            f", P(2,m) and more from near returns among {counts['impacts']} impacts simulated "
            f"from {counts['starts']} starts"
        )
    return told


def told_of_offers(searches: Sequence[OrbitSearch[Any]], periods: int, where: str) -> str:
    """Return what searches for orbits up to P(n,m), at values of a parameter, looked at."""
    total: Counter[str] = Counter()
    for search in searches:
        total.update(search.cost.counts)
    n = searches[0].period
    return f"P(1,1) to P({n},{periods}) {where}: {told_of_counts(n, total)}"


def told_of_searches(searches: Sequence[OrbitSearch[Any]], where: str) -> str:
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
