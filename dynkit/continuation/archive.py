"""Branches as archives of a store."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit import __version__, store
from dynkit.continuation.bifurcations import Bifurcation
from dynkit.continuation.branch import Branch
from dynkit.continuation.endings import Ending, Reason
from dynkit.results import Cost
from dynkit.sweeps.archive import identity
from dynkit.sweeps.sweepable import sweepable

if TYPE_CHECKING:
    from dynkit.continuation.problem import Problem
    from dynkit.maps import Map
    from dynkit.orbits import PeriodicOrbit

_KIND = "branch of periodic orbits"
_ARRAYS = ("parameter", "unknowns", "multipliers", "admissible", "residuals")


def save_branch(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a branch to a store.

    Raises
    ------
    ValueError
        When it cannot be written there, or the system cannot be told from others.
    """
    file = store.place(path)
    entries = {
        "kind": _KIND,
        "label": branch.label,
        "parameter": branch.name,
        **_identity(branch.system, branch.name, float(branch.parameter[0])),
        "dynkit": __version__,
        "endings": json.dumps([[ending.reason.name, ending.message] for ending in branch.endings]),
        "seconds": repr(branch.cost.seconds),
        "work": json.dumps(dict(branch.cost.counts)),
        "bifurcations": str(len(branch.bifurcations)),
    }
    arrays: dict[str, Any] = {name: getattr(branch, name) for name in _ARRAYS}
    arrays["error"] = branch.error
    for i, bifurcation in enumerate(branch.bifurcations):
        entries[f"bifurcation {i}"] = json.dumps(_described(bifurcation))
        arrays |= {
            f"bifurcations/{i}/unknowns": bifurcation.unknowns,
            f"bifurcations/{i}/direction": bifurcation.direction,
            f"bifurcations/{i}/tangent": bifurcation.tangent,
            f"bifurcations/{i}/own": bifurcation.own,
        }
    write_archive(file, store.Archive(entries, arrays))


def write_archive(file: Path, archive: store.Archive) -> None:
    """Write an archive to a store; ValueError where it cannot be written."""
    with store.locked(file):
        try:
            store.write(file, archive)
        except OSError as failure:
            raise ValueError(
                f"store must be a file that can be written; got {file} ({failure.strerror})"
            ) from failure


def read_archive(path: str | os.PathLike[str], kind: str) -> tuple[Path, store.Archive]:
    """The file of a store and its archive; ValueError where it is none of this kind."""
    file = store.place(path)
    archive = store.read(file)
    if archive.entries.get("kind") != kind:
        raise ValueError(f"store must hold a {kind}; got {file}")
    return file, archive


def load_branch(path: str | os.PathLike[str], orbit: PeriodicOrbit | None) -> Branch:
    """Read a branch from a store.

    Raises
    ------
    ValueError
        As `Branch.load`.
    """
    file, archive = read_archive(path, _KIND)
    entries, arrays = archive.entries, archive.arrays
    name = entries["parameter"]
    problem = None
    if orbit is not None:
        _refuse_other(file, archive, orbit)
        problem = orbit.problem(name)
    endings = [Ending(Reason[key], text) for key, text in json.loads(entries["endings"])]
    count = int(entries["bifurcations"])
    return Branch(
        label=entries["label"],
        name=name,
        **{key: arrays[key] for key in _ARRAYS},
        bifurcations=tuple(_restored(archive, i, name, problem) for i in range(count)),
        endings=(endings[0], endings[1]),
        cost=Cost(float(entries["seconds"]), json.loads(entries["work"])),
        _problem=problem,
        _system=orbit.system if orbit is not None else None,
        _error=arrays["error"],
    )


def _identity(system: Map, name: str, value: float) -> dict[str, str]:
    return identity(sweepable(system.replace(**{name: value})))


def _refuse_other(file: Path, archive: store.Archive, orbit: PeriodicOrbit) -> None:
    entries, arrays = archive.entries, archive.arrays
    name = entries["parameter"]
    if orbit.label != entries["label"]:
        raise ValueError(f"store {file} was made with orbits {entries['label']}; got {orbit.label}")
    if name not in orbit.system.parameters:
        raise ValueError(f"store {file} was made with parameter {name}; got a system without it")
    asked = _identity(orbit.system, name, float(arrays["parameter"][0]))
    made = {key: text for key, text in entries.items() if key.startswith("system.")}
    for key in sorted(made.keys() | asked.keys()):
        a, b = made.get(key, "none"), asked.get(key, "none")
        if a != b:
            raise ValueError(
                f"store {file} was made with {key.removeprefix('system.')} {a}; got {b}"
            )
    size = orbit.problem(name).size
    if size != arrays["unknowns"].shape[1]:
        raise ValueError(
            f"store {file} was made with {arrays['unknowns'].shape[1]} unknowns; got {size}"
        )


def _described(bifurcation: Bifurcation) -> dict[str, Any]:
    multiplier = bifurcation.multiplier
    return {
        "kind": bifurcation.kind,
        "value": bifurcation.value,
        "error": bifurcation.error,
        "multiplier": None if multiplier is None else [multiplier.real, multiplier.imag],
        "place": bifurcation.place,
        "touching": dict(bifurcation.touching),
        "history": bifurcation.history,
        "event": bifurcation.event,
        "seconds": bifurcation.cost.seconds,
        "work": dict(bifurcation.cost.counts),
    }


def _restored(
    archive: store.Archive, place: int, parameter: str, problem: Problem | None
) -> Bifurcation:
    entry = json.loads(archive.entries[f"bifurcation {place}"])
    arrays = {
        key: archive.arrays[f"bifurcations/{place}/{key}"]
        for key in ("unknowns", "direction", "tangent", "own")
    }
    for array in arrays.values():
        array.setflags(write=False)
    multiplier = entry["multiplier"]
    return Bifurcation(
        kind=entry["kind"],
        parameter=parameter,
        value=entry["value"],
        error=entry["error"],
        multiplier=None if multiplier is None else complex(*multiplier),
        place=entry["place"],
        touching=entry["touching"],
        history=tuple(entry["history"]),
        event=entry["event"],
        cost=Cost(entry["seconds"], entry["work"]),
        _problem=problem,
        **arrays,
    )
