"""Sweeps as archives of a store, and the refusal of stores that belong to another sweep."""

import hashlib
import json
import time
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import final

import numpy as np

from dynkit import __version__, store
from dynkit.files import reason
from dynkit.sweeps.following import Findings, Plan
from dynkit.sweeps.sweepable import Sweepable
from dynkit.validation import Array

_KIND = "following sweep"
# Their kinds of numbers, and how many dimensions they have.
_ARRAYS = {
    "values": ("f", 1),
    "start": ("f", 1),
    "final": ("f", 2),
    "count": ("i", 1),
    "ending": ("i", 1),
}
# A write may take this part of the time, and comes at most once in so many seconds.
_SHARE, _LEAST_INTERVAL = 1.0 / 20.0, 1.0
# Longer texts are cut, and told apart by their hash: HDF5 attributes are limited.
_LONGEST = 1000


def identity(system: Sweepable) -> dict[str, str]:
    """Return everything that the system's motion depends on, as plain text by name.

    Raises
    ------
    ValueError
        When something is neither a number, a string, an array, nor a tuple of them.
    """
    return {f"system.{name}": _text(name, value) for name, value in system.identity.items()}


def _text(name: str, value: object) -> str:
    text = _plain(name, value)
    if len(text) <= _LONGEST:
        return text
    return f"{text[:40]}... (sha256 {hashlib.sha256(text.encode()).hexdigest()})"


def _plain(name: str, value: object) -> str:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype} array {value.shape} (sha256 {digest})"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, tuple | list):
        return f"({', '.join(_plain(name, part) for part in value)})"
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool | int | float | complex | str):
        return repr(value)
    raise ValueError(
        f"store must be None for a system whose {name} is no number, string or array; got {value!r}"
    )


def entries_of(plan: Plan) -> dict[str, str]:
    """Return what sets the sweep apart, but for its arrays, as plain text by name."""
    return {
        "kind": _KIND,
        "system": plan.kind,
        "parameter": plan.parameter,
        **identity(plan.system(0)),
        "transient": str(plan.transient),
        "keep": str(plan.keep),
        "observables": json.dumps(plan.observables),
    }


def archived(plan: Plan, entries: Mapping[str, str], findings: Findings) -> store.Archive:
    """Return the finished rows as an archive; `entries` are those of the plan."""
    n = findings.finished
    progress = {
        "dynkit": __version__,
        "endings": json.dumps(findings.endings),
        "displaced": json.dumps(np.flatnonzero(findings.displaced[:n]).tolist()),
        "seconds": repr(findings.seconds),
        "work": json.dumps(findings.work),
    }
    arrays = {
        "values": plan.values,
        "start": plan.start,
        "final": findings.finals[:n],
        "count": findings.counts[:n],
        "ending": findings.ending_codes[:n],
    }
    kept = {f"observables/{name}": rows[:n] for name, rows in findings.observables.items()}
    return store.Archive({**entries, **progress}, {**arrays, **kept})


def read_sweep(path: Path) -> store.Archive:
    """Return the archive of a store that holds a sweep.

    Raises
    ------
    ValueError
        As `store.read`, and when it holds something else, or not all of a sweep.
    """
    archive = store.read(path)
    if archive.entries.get("kind") != _KIND:
        raise ValueError(f"store must hold a {_KIND}; got {path}")
    with store.understood(path, _KIND):
        outline = outline_of(archive)
        observables = {f"observables/{name}": ("f", 2) for name in outline.observables}
        store.arrays_of(archive, {**_ARRAYS, **observables})
        findings = findings_of(outline, archive)
        if not len(outline.values) or findings.finished > len(outline.values):
            raise ValueError(f"{findings.finished} of {len(outline.values)} values")
        for code in findings.ending_codes.tolist() if findings.finished else ():
            _ = findings.endings[code]
        _ = archive.entries["dynkit"]
    return archive


def outline_of(archive: store.Archive) -> Plan:
    """Return the plan that an archive was made with, but for the system."""
    entries = archive.entries
    values = archive.arrays["values"]
    values.setflags(write=False)
    return Plan(
        None,
        entries["system"],
        entries["parameter"],
        values,
        int(entries["transient"]),
        int(entries["keep"]),
        tuple(json.loads(entries["observables"])),
        archive.arrays["start"],
    )


def findings_of(plan: Plan, archive: store.Archive) -> Findings:
    """Return what the archive of this plan's sweep has found."""
    findings = Findings.none_yet(plan)
    n = findings.finished = len(archive.arrays["count"])
    for name, rows in findings.observables.items():
        rows[:n] = archive.arrays[f"observables/{name}"]
    finals = archive.arrays["final"]
    findings.finals = np.empty((len(plan.values), finals.shape[1]))
    findings.finals[:n] = finals
    findings.counts[:n] = archive.arrays["count"]
    findings.ending_codes[:n] = archive.arrays["ending"]
    # sweeps of older versions did not leave unstable orbits
    findings.displaced[json.loads(archive.entries.get("displaced", "[]"))] = True
    findings.endings = list(json.loads(archive.entries["endings"]))
    findings.seconds = float(archive.entries["seconds"])
    findings.work = dict(json.loads(archive.entries["work"]))
    return findings


def refuse_other(
    path: Path, plan: Plan, entries: Mapping[str, str], archive: store.Archive
) -> None:
    """Refuse the archive of another sweep than this plan's.

    Raises
    ------
    ValueError
        Naming the first thing that differs.
    """
    made, asked = archive.entries, {**archive.entries, **entries}
    first = ("system", "parameter")
    for name in first:
        _refuse_if_other(path, name, made[name], asked[name])
    _refuse_other_values(path, archive.arrays["values"], plan.values)
    for name in made.keys() - entries.keys():
        if name.startswith("system."):
            raise ValueError(f"store {path} was made with {_short(name)} {made[name]}; got none")
    for name, text in entries.items():
        shown = json.loads(text) if name == "observables" else text
        found = json.loads(made[name]) if name == "observables" else made.get(name, "none")
        _refuse_if_other(path, _short(name), found, shown)
    if not _same(archive.arrays["start"], plan.start):
        raise ValueError(f"store {path} was made with another start")


def _short(name: str) -> str:
    return name.removeprefix("system.")


def _refuse_if_other(path: Path, name: str, made: object, asked: object) -> None:
    alike = store.same(str(made), str(asked)) if isinstance(made, str) else made == asked
    if not alike:
        raise ValueError(f"store {path} was made with {name} {made}; got {asked}")


def _refuse_other_values(path: Path, made: Array, asked: Array) -> None:
    if len(made) != len(asked):
        raise ValueError(f"store {path} was made with {len(made)} values; got {len(asked)}")
    for place in np.flatnonzero(made != asked)[:1].tolist():
        a, b = float(made[place]), float(asked[place])
        raise ValueError(f"store {path} was made with values[{place}] {a!r}; got {b!r}")


def _same(a: Array, b: Array) -> bool:
    return a.shape == b.shape and a.tobytes() == b.tobytes()


@final
class Keeper:
    """Writes what a sweep has found to its store, as often as is cheap, and at the end."""

    def __init__(self, path: Path, plan: Plan, entries: Mapping[str, str]) -> None:
        self._path = path
        self._plan = plan
        self._entries = entries
        self._written = -1
        self._due = 0.0

    def prepare(self, findings: Findings) -> None:
        """Make sure that the store can be written, before anything is simulated.

        Raises
        ------
        ValueError
            When it cannot.
        """
        try:
            self.write(findings)
        except OSError as failure:
            raise ValueError(reason(failure)) from failure

    def write(self, findings: Findings) -> None:
        """Write whatever is not yet written.

        Raises
        ------
        OSError
            When it cannot be written; the store is then as it was.
        """
        if findings.finished == self._written:
            return
        finished = findings.finished
        began = time.monotonic()
        store.write(self._path, archived(self._plan, self._entries, findings))
        ended = time.monotonic()
        self._written = finished
        self._due = ended + max(_LEAST_INTERVAL, (ended - began) / _SHARE)

    def write_when_due(self, findings: Findings) -> None:
        """Write when the last time is long enough ago."""
        if time.monotonic() >= self._due:
            self.write(findings)
