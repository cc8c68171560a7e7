"""Branches as lines: points and bifurcations in the order of the curve."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.core.validation import Array
from dynkit.orbits.kinds import BifurcationKind


@final
class Node(NamedTuple):
    """A point of a branch, or a bifurcation on it."""

    place: float
    bifurcation: Bifurcation | None


def nodes_of(points: int, bifurcations: Iterable[Bifurcation]) -> list[Node]:
    """Return nodes of this number of points, and of bifurcations, in the order of the curve."""
    nodes = [Node(float(i), None) for i in range(points)]
    nodes += [Node(b.place, b) for b in bifurcations]
    return sorted(nodes, key=lambda node: node.place)


def kinds_of(
    nodes: list[Node], stable: NDArray[np.bool_], admissible: NDArray[np.bool_]
) -> list[str]:
    """Return whether orbits after each node but the last are stable, unstable or inadmissible.

    These properties are those of an adjacent point that is not itself a bifurcation.

    Parameters
    ----------
    nodes : list of k Node
    stable, admissible : (n,) arrays of bool
        Properties of the points.
    """
    critical = {place for place, bifurcation in nodes if bifurcation is not None}
    kinds = []
    for place, bifurcation in nodes[:-1]:
        beside = bifurcation is not None or place in critical
        i = min(max(math.floor(place) + beside, 0), len(stable) - 1)
        kinds.append("inadmissible" if not admissible[i] else "stable" if stable[i] else "unstable")
    return kinds


@final
@dataclass(frozen=True, eq=False)
class Line:
    """The drawing of a branch.

    Parameters
    ----------
    names : (str, str)
        Names of the parameter and of the observable.
    nodes : list of k Node
    x : (k,) array
        The parameter at the nodes.
    y : (k, n) array
        The observable at the nodes.
    kinds : list of k - 1 str
        Kind of the orbits after each node but the last, which determines the line style.
    label : str
        Label of the orbits.
    """

    names: tuple[str, str]
    nodes: list[Node]
    x: Array
    y: Array
    kinds: list[str]
    label: str

    def stretches(self) -> Iterator[tuple[str, Array, Array]]:
        """Yield parts with one line style: the kind, the parameter and the observable."""
        place = 0
        for kind, group in groupby(self.kinds):
            stop = place + len(list(group))
            yield kind, self.x[place : stop + 1], self.y[place : stop + 1]
            place = stop

    def marks(self) -> Iterator[tuple[Bifurcation, float, Array]]:
        """Yield bifurcations, with the parameter and the observable (n,) at them.

        A branch point beyond an end of the branch is left out: it belongs to the other branch.
        """
        last = sum(bifurcation is None for _, bifurcation in self.nodes) - 1
        for (place, b), x, y in zip(self.nodes, self.x, self.y, strict=True):
            if b is not None and (b.kind is not BifurcationKind.BP or 0.0 <= place <= last):
                yield b, float(x), y


def curves_of(lines: Iterable[Line]) -> dict[str, tuple[Array, Array]]:
    """Return the curves of each kind of orbits, x and y, as one line with gaps of NaN."""
    parts: dict[str, list[tuple[Array, Array]]] = {}
    gap = np.array([np.nan])
    for line in lines:
        for kind, x, y in line.stretches():
            parts.setdefault(kind, []).extend(
                pair for row in y.T for pair in ((x, row), (gap, gap))
            )
    return {
        kind: (np.concatenate([x for x, _ in found]), np.concatenate([y for _, y in found]))
        for kind, found in parts.items()
    }
