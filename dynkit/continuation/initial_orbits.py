"""Initial orbits of the exploration of a network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from dynkit.dynamics.map import Map
from dynkit.orbits.equations import ProblemSolution
from dynkit.orbits.search import OrbitSearch, checked_box, find_orbits

Search: TypeAlias = Callable[[], OrbitSearch[Any]]

Describe: TypeAlias = Callable[[Sequence[OrbitSearch[Any]]], str]
"""Function from searches to a description of their extent."""


@runtime_checkable
class FindsOrbits(Protocol):
    """A system with a search for periodic orbits.

    ``find_orbits(impacts=n, periods=m)`` returns orbits up to P(n,m), the same in each call.
    """

    def find_orbits(self, *, impacts: int, periods: int) -> OrbitSearch[Any]:
        """Return orbits up to P(n,m), and the extent of the search."""
        ...


def searches_of(
    system: Map,
    parameter: str,
    bounds: tuple[float, float],
    *,
    values: int,
    largest: tuple[int, int],
    box: Any,
    calls: int,
) -> tuple[list[Search], Describe]:
    """Return searches for orbits at values of a parameter, and a function that describes them.

    Parameters
    ----------
    system : Map
    parameter : str
    bounds : (float, float)
    values : int
        Number of values of the parameter, equally spaced; with a box also both bounds.
    largest : (int, int)
        The largest n and m of P(n,m).
    box : (d, 2) array_like or None
        Box for orbits of a map; None for a system with `find_orbits`.
    calls : int
        Largest number of calls in the search of a box at one value.

    Raises
    ------
    ValueError
        When the system refuses a value, or has no `find_orbits` and no box is given.
    """
    low, high = bounds
    at = [low + (high - low) * (i + 0.5) / values for i in range(values)]
    if box is not None:
        at = [low, *at, high]
    elif not isinstance(system, FindsOrbits):
        raise ValueError("box or seeds must be given for a system without find_orbits; got None")
    systems: list[Any] = [system.replace(**{parameter: value}) for value in at]
    where = f"at {parameter} {at[0]:.6g}"
    if len(at) > 1:
        where = f"at {len(at)} values of {parameter} from {at[0]:.6g} to {at[-1]:.6g}"
    n, m = largest
    if box is not None:
        inside = checked_box(box, system.dimension)
        searches = [partial(find_orbits, each, n, inside, calls=calls) for each in systems]
        return list(searches), partial(_describe_boxes, where=where)
    offers = [partial(each.find_orbits, impacts=n, periods=m) for each in systems]
    return list(offers), partial(_describe_offers, periods=m, where=where)


def seeds_of(seeds: object, parameter: str) -> list[ProblemSolution]:
    """Return the initial orbits of a user as a list.

    Raises
    ------
    ValueError
        When one is neither an orbit nor an equilibrium, or its system lacks the parameter.
    """
    if not isinstance(seeds, Iterable):
        raise ValueError(f"seeds must be periodic orbits or equilibria; got {seeds!r}")
    orbits = list(seeds)
    for i, orbit in enumerate(orbits):
        if not isinstance(orbit, ProblemSolution):
            raise ValueError(f"seeds[{i}] must be a PeriodicOrbit or an Equilibrium; got {orbit!r}")
        if parameter not in orbit.system.parameters:
            raise ValueError(f"seeds[{i}] must have a parameter {parameter!r}; got {orbit!r}")
    return orbits


def describe_counts(impacts: int, counts: Mapping[str, int]) -> str:
    """Return a description of the searches by `find_orbits` of an impact oscillator.

    Parameters
    ----------
    impacts : int
        The largest n of P(n,m).
    counts : mapping
        Numbers of random ``guesses``, where there are closed forms; of ``starts``, and of
        ``impacts`` simulated from them.
    """
    motions = f"{counts['impacts']} impacts simulated from {counts['starts']} starts"
    near = f"near returns among {motions}"
    if "guesses" not in counts:
        return f"from {near}"
    text = "P(1,m) from their closed form"
    if counts["guesses"]:
        guessed = "P(2,m)" if impacts == 2 else "P(2,m) and P(3,m)"
        text += f", {guessed} from {counts['guesses']} random guesses"
    if counts["starts"]:
        text += f", P(2,m) and more from {near}"
    return text


def _describe_offers(searches: Sequence[OrbitSearch[Any]], periods: int, where: str) -> str:
    """Return a description of searches by the system, at values of a parameter."""
    total: Counter[str] = Counter()
    for search in searches:
        total.update(search.cost.counts)
    n = searches[0].period
    return f"P(1,1) to P({n},{periods}) {where}: {describe_counts(n, total)}"


def _describe_boxes(searches: Sequence[OrbitSearch[Any]], where: str) -> str:
    """Return a description of searches of one box, at values of a parameter."""
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
