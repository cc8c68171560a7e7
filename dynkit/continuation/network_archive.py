"""Networks as archives of a store, made of the archives of their branches."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from dynkit._version import __version__
from dynkit.continuation.archive import (
    archived_branch,
    read_archive,
    restored_branch,
    with_orbits,
    write_archive,
)
from dynkit.continuation.branch import Branch
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.core.cost import Cost
from dynkit.data import store
from dynkit.orbits.problem import PeriodicOrbit

_KIND = "network of branches"
# A residual that is no larger is that of a solution.
_SOLVED = 1e-8


def save_network(network: Network, path: str | os.PathLike[str]) -> None:
    """Write a network to a store.

    Raises
    ------
    ValueError
        When it cannot be written there, or the system cannot be told from others.
    """
    entries = {
        "kind": _KIND,
        "dynkit": __version__,
        "branches": str(len(network.branches)),
        "links": json.dumps(network.links),
        "finish": network.finish.name,
        "message": network.message,
        "seconds": repr(network.cost.seconds),
        "work": json.dumps(dict(network.cost.counts)),
        "unexplored": str(len(network.unexplored)),
    }
    entries |= {f"unexplored {i}": json.dumps(entry) for i, entry in enumerate(network.unexplored)}
    arrays: dict[str, Any] = {}
    for i, branch in enumerate(network.branches):
        archive = archived_branch(branch)
        entries |= {f"branch {i}, {name}": text for name, text in archive.entries.items()}
        arrays |= {f"branches/{i}/{name}": array for name, array in archive.arrays.items()}
    write_archive(path, store.Archive(entries, arrays))


def load_network(path: str | os.PathLike[str], orbits: Sequence[PeriodicOrbit]) -> Network:
    """Read a network from a store.

    Raises
    ------
    ValueError
        As `Network.load`.
    """
    if isinstance(orbits, PeriodicOrbit) or not isinstance(orbits, Iterable):
        raise ValueError(f"orbits must be a sequence of PeriodicOrbit; got {orbits!r}")
    file, archive = read_archive(path, _KIND)
    entries = archive.entries
    with store.understood(file, _KIND):
        parts = [_part(archive, i) for i in range(int(entries["branches"]))]
        unexplored = range(int(entries["unexplored"]))
        network = Network(
            tuple(restored_branch(file, part) for part in parts),
            tuple(Link(*link) for link in json.loads(entries["links"])),
            tuple(Unexplored(*json.loads(entries[f"unexplored {i}"])) for i in unexplored),
            Finish[entries["finish"]],
            entries["message"],
            Cost(float(entries["seconds"]), dict(json.loads(entries["work"]))),
        )
    pairs = zip(parts, network.branches, strict=True)
    branches = tuple(_with_its_orbits(file, part, branch, orbits) for part, branch in pairs)
    return dataclasses.replace(network, branches=branches)


def _part(archive: store.Archive, number: int) -> store.Archive:
    names, places = f"branch {number}, ", f"branches/{number}/"
    return store.Archive(
        {key[len(names) :]: text for key, text in archive.entries.items() if key.startswith(names)},
        {key[len(places) :]: a for key, a in archive.arrays.items() if key.startswith(places)},
    )


def _with_its_orbits(
    file: Path, part: store.Archive, branch: Branch, orbits: Sequence[PeriodicOrbit]
) -> Branch:
    for orbit in orbits:
        if orbit.label == branch.label:
            found = with_orbits(file, part, branch, orbit)
            # the same numbers of impacts may be with other stops
            residual = found.problem.residual(found.unknowns[0], found.parameter[:1])
            if abs(residual).max() < _SOLVED:
                return found
    return branch
