"""Branches, and curves of bifurcations, as archives of a store."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit._version import __version__
from dynkit.continuation.bifurcations import Bifurcation, borders_a_motion
from dynkit.continuation.branch import Branch
from dynkit.continuation.curves import BifurcationCurve
from dynkit.continuation.termination import Ending, Reason
from dynkit.core.cost import Cost
from dynkit.data import store
from dynkit.data.atomic_files import reason

if TYPE_CHECKING:
    from dynkit.core.smooth_map import SmoothMap
    from dynkit.orbits.problem import PeriodicOrbit

_BRANCH, _CURVE = "branch of periodic orbits", "curve of bifurcations"
# The arrays, with their kinds of numbers and their numbers of dimensions.
_BRANCH_ARRAYS = {
    "parameter": ("f", 1),
    "unknowns": ("f", 2),
    "multipliers": ("c", 2),
    "admissible": ("b", 1),
    "residuals": ("f", 1),
}
_CURVE_ARRAYS = {
    "parameters": ("f", 2),
    "unknowns": ("f", 2),
    "own": ("f", 2),
    "admissible": ("b", 1),
    "residuals": ("f", 1),
}
_OLDER = ("unknowns", "direction", "tangent", "own")
_OF_BIFURCATION = (*_OLDER, "unknowns_error", "own_error")


def write_archive(path: str | os.PathLike[str], archive: store.Archive) -> None:
    """Write an archive to a store; ValueError where it cannot be written."""
    file = store.place(path)
    with store.locked(file):
        try:
            store.write(file, archive)
        except OSError as failure:
            raise ValueError(reason(failure)) from failure


def read_archive(path: str | os.PathLike[str], kind: str) -> tuple[Path, store.Archive]:
    """The file of a store and its archive; ValueError where it is none of this kind."""
    file = store.place(path)
    archive = store.read(file)
    if archive.entries.get("kind") != kind:
        raise ValueError(f"store must hold a {kind}; got {file}")
    return file, archive


def save_branch(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a branch to a store; ValueError as `Branch.save`."""
    write_archive(path, archived_branch(branch))


def archived_branch(branch: Branch) -> store.Archive:
    """Return a branch as an archive; ValueError where the system cannot be told from others."""
    entries = {
        "kind": _BRANCH,
        "label": branch.label,
        "parameter": branch.name,
        **_identity(branch.system, {branch.name: float(branch.parameter[0])}),
        **_how_made(branch),
        "bifurcations": str(len(branch.bifurcations)),
    }
    arrays: dict[str, Any] = {name: getattr(branch, name) for name in _BRANCH_ARRAYS}
    arrays["error"] = branch.error
    for i, bifurcation in enumerate(branch.bifurcations):
        entries[f"bifurcation {i}"] = json.dumps(_described(bifurcation))
        for name in _OF_BIFURCATION:
            arrays[f"bifurcations/{i}/{name}"] = getattr(bifurcation, name)
    return store.Archive(entries, arrays)


def load_branch(path: str | os.PathLike[str], orbit: PeriodicOrbit | None) -> Branch:
    """Read a branch from a store; ValueError as `Branch.load`."""
    file, archive = read_archive(path, _BRANCH)
    branch = restored_branch(file, archive)
    return branch if orbit is None else with_orbits(file, archive, branch, orbit)


def restored_branch(file: Path, archive: store.Archive) -> Branch:
    """Return the branch of an archive, without orbits; ValueError where something is missing."""
    entries = archive.entries
    numbers: dict[str, Any]
    with store.understood(file, _BRANCH):
        numbers = _rows(archive, {**_BRANCH_ARRAYS, "error": ("f", 1)})
        error = numbers.pop("error")
        name = entries["parameter"]
        count = int(entries["bifurcations"])
        return Branch(
            label=entries["label"],
            name=name,
            **numbers,
            bifurcations=tuple(_restored(archive, i, name) for i in range(count)),
            **_made(archive),
            _problem=None,
            _system=None,
            _error=error,
        )


def with_orbits(file: Path, archive: store.Archive, branch: Branch, orbit: PeriodicOrbit) -> Branch:
    """Return a branch that makes orbits like the one given; ValueError where it is another kind."""
    _refuse_other(file, archive, orbit, {branch.name: branch.parameter[0]})
    problem = orbit.problem(branch.name)
    return dataclasses.replace(
        branch,
        bifurcations=tuple(
            dataclasses.replace(found, _problem=problem) for found in branch.bifurcations
        ),
        _problem=problem,
        _system=orbit.system,
    )


def save_curve(curve: BifurcationCurve, path: str | os.PathLike[str]) -> None:
    """Write a curve to a store; ValueError as `BifurcationCurve.save`."""
    first = dict(zip(curve.names, curve.parameters[0].tolist(), strict=True))
    entries = {
        "kind": _CURVE,
        "label": curve.label,
        "bifurcations": curve.kind,
        "parameters": json.dumps(curve.names),
        **_identity(curve.orbit(0).system, first),
        **_how_made(curve),
    }
    arrays = {name: getattr(curve, name) for name in _CURVE_ARRAYS}
    arrays["error"] = curve.error
    write_archive(path, store.Archive(entries, arrays))


def load_curve(path: str | os.PathLike[str], orbit: PeriodicOrbit | None) -> BifurcationCurve:
    """Read a curve from a store; ValueError as `BifurcationCurve.load`."""
    file, archive = read_archive(path, _CURVE)
    entries = archive.entries
    numbers: dict[str, Any]
    with store.understood(file, _CURVE):
        numbers = _rows(archive, {**_CURVE_ARRAYS, "error": ("f", 1)})
        error = numbers.pop("error")
        one, other = json.loads(entries["parameters"])
        curve = BifurcationCurve(
            kind=entries["bifurcations"],
            label=entries["label"],
            names=(str(one), str(other)),
            **numbers,
            **_made(archive),
            _problem=None,
            _error=error,
        )
        first = dict(zip(curve.names, curve.parameters[0].tolist(), strict=True))
    if orbit is None:
        return curve
    _refuse_other(file, archive, orbit, first)
    return dataclasses.replace(curve, _problem=orbit.problem(*curve.names))


def _how_made(found: Branch | BifurcationCurve) -> dict[str, str]:
    return {
        "dynkit": __version__,
        "endings": json.dumps([[ending.reason.name, ending.message] for ending in found.endings]),
        "seconds": repr(found.cost.seconds),
        "work": json.dumps(dict(found.cost.counts)),
    }


def _made(archive: store.Archive) -> dict[str, Any]:
    entries = archive.entries
    first, last = (Ending(Reason[key], str(text)) for key, text in json.loads(entries["endings"]))
    cost = Cost(float(entries["seconds"]), dict(json.loads(entries["work"])))
    return {"endings": (first, last), "cost": cost}


def _rows(archive: store.Archive, kinds: Mapping[str, tuple[str, int]]) -> dict[str, Any]:
    """The arrays with one row for each point."""
    found: dict[str, Any] = store.arrays_of(archive, kinds)
    lengths = {len(array) for array in found.values()}
    if len(lengths) != 1 or 0 in lengths:
        raise ValueError(f"arrays of {sorted(lengths)} rows")
    return found


def _identity(system: SmoothMap, free: Mapping[str, float]) -> dict[str, str]:
    return store.identity_of(system.replace(**free))


def _refuse_other(
    file: Path, archive: store.Archive, orbit: PeriodicOrbit, free: Mapping[str, Any]
) -> None:
    """Refuse an orbit of another kind or system; the free parameters' values stand for all."""
    entries, size = archive.entries, archive.arrays["unknowns"].shape[1]
    if orbit.label != entries["label"]:
        raise ValueError(f"store {file} was made with orbits {entries['label']}; got {orbit.label}")
    for name in free:
        if name not in orbit.system.parameters:
            raise ValueError(
                f"store {file} was made with parameter {name}; got a system without it"
            )
    asked = _identity(orbit.system, {name: float(value) for name, value in free.items()})
    made = {key: text for key, text in entries.items() if key.startswith("system.")}
    for key in sorted(made.keys() | asked.keys()):
        a, b = made.get(key, "none"), asked.get(key, "none")
        if not store.same(a, b):
            raise ValueError(
                f"store {file} was made with {key.removeprefix('system.')} {a}; got {b}"
            )
    if orbit.problem(*free).size != size:
        raise ValueError(
            f"store {file} was made with {size} unknowns; got {orbit.problem(*free).size}"
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
        "admissible": bifurcation.admissible,
        "arrays": _OF_BIFURCATION,
        "seconds": bifurcation.cost.seconds,
        "work": dict(bifurcation.cost.counts),
    }


def _restored(archive: store.Archive, number: int, parameter: str) -> Bifurcation:
    entry = json.loads(archive.entries[f"bifurcation {number}"])
    kept = entry.get("arrays", _OLDER)
    arrays = {key: archive.arrays[f"bifurcations/{number}/{key}"] for key in kept}
    for key in ("unknowns", "own"):
        arrays.setdefault(f"{key}_error", np.full(len(arrays[key]), np.inf))
    for array in arrays.values():
        array.setflags(write=False)
    multiplier, place = entry["multiplier"], float(entry["place"])
    return Bifurcation(
        kind=str(entry["kind"]),
        parameter=parameter,
        value=float(entry["value"]),
        error=float(entry["error"]),
        multiplier=None if multiplier is None else complex(*multiplier),
        place=place,
        touching=dict(entry["touching"]),
        history=tuple(entry["history"]),
        event=int(entry["event"]),
        # older stores leave it to the points beside it
        admissible=bool(
            entry.get("admissible", borders_a_motion(archive.arrays["admissible"], place))
        ),
        cost=Cost(float(entry["seconds"]), dict(entry["work"])),
        _problem=None,
        **arrays,
    )
