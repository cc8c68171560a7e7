"""Networks as archives of a store, made of the archives of their branches."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit import __version__, store
from dynkit.continuation.archive import load_branch, read_archive, save_branch, write_archive
from dynkit.continuation.branch import Branch
from dynkit.continuation.network import Finish, Link, Network, Unexplored
from dynkit.results import Cost

if TYPE_CHECKING:
    from dynkit.orbits import PeriodicOrbit

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
    file = store.place(path)
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
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "branch.h5"
        for i, branch in enumerate(network.branches):
            save_branch(branch, part)
            archive = store.read(part)
            entries |= {f"branch {i}, {name}": text for name, text in archive.entries.items()}
            arrays |= {f"branches/{i}/{name}": array for name, array in archive.arrays.items()}
    write_archive(file, store.Archive(entries, arrays))


def load_network(path: str | os.PathLike[str], orbits: Sequence[PeriodicOrbit]) -> Network:
    """Read a network from a store.

    Raises
    ------
    ValueError
        As `Network.load`.
    """
    _, archive = read_archive(path, _KIND)
    entries = archive.entries
    branches = tuple(_branch(archive, i, orbits) for i in range(int(entries["branches"])))
    unexplored = range(int(entries["unexplored"]))
    return Network(
        branches,
        tuple(Link(*link) for link in json.loads(entries["links"])),
        tuple(Unexplored(*json.loads(entries[f"unexplored {i}"])) for i in unexplored),
        Finish[entries["finish"]],
        entries["message"],
        Cost(float(entries["seconds"]), json.loads(entries["work"])),
    )


def _branch(archive: store.Archive, number: int, orbits: Sequence[PeriodicOrbit]) -> Branch:
    names, places = f"branch {number}, ", f"branches/{number}/"
    part = store.Archive(
        {key[len(names) :]: text for key, text in archive.entries.items() if key.startswith(names)},
        {key[len(places) :]: a for key, a in archive.arrays.items() if key.startswith(places)},
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "branch.h5"
        store.write(file, part)
        for orbit in orbits:
            if orbit.label == part.entries["label"]:
                found = load_branch(file, orbit)
                # the same numbers of impacts may be with other stops
                residual = found.problem.residual(found.unknowns[0], found.parameter[:1])
                if abs(residual).max() < _SOLVED:
                    return found
        return load_branch(file, None)
