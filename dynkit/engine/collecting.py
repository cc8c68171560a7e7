"""`collect`: evaluate all points, with or without an executor, and keep results in a store."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Self, final

import numpy as np

from dynkit._version import __version__
from dynkit.core.cost import Cost
from dynkit.core.validation import boolean, positive_integer
from dynkit.data import store as stores
from dynkit.data.atomic_files import reason
from dynkit.engine.executors import finished
from dynkit.engine.points import MOST_POINTS, Findings, Points, Rows, chunks_of

# Largest fraction of the time that writing may take, and least time between writes in seconds.
_SHARE, _LEAST_INTERVAL = 1.0 / 20.0, 1.0


def collect(
    points: Points,
    *,
    executor: Executor | None,
    store: str | os.PathLike[str] | None,
    progress: bool,
) -> Rows:
    """Return the rows of all points: the same bits with any executor, and without one.

    Parameters
    ----------
    points : Points
    executor : Executor or None
    store : path or None
        File that keeps finished chunks; they are read again and not computed again.
    progress : bool
        Whether to show a bar on standard error.

    Raises
    ------
    ValueError
        As `finished`; and for a store of other points, of another version, damaged, or in use.
    WorkerLost
        When the executor has lost a worker.
    OSError
        When the store becomes impossible to write during the run.
    """
    shown = boolean("progress", progress)
    if store is None:
        findings = Findings(len(points))
        _go_on(points, findings, executor, None, shown=shown)
        return findings.rows()
    path = stores.place(store)
    findings = _found(points, path)
    if not findings.done.all():  # a complete store needs neither a lock nor a writable folder
        with stores.locked(path):
            findings = _found(points, path)  # another process may have written since
            with _keeper_of(path, points, findings) as keeper:
                _go_on(points, findings, executor, keeper, shown=shown)
    return findings.rows()


def _go_on(
    points: Points,
    findings: Findings,
    executor: Executor | None,
    keeper: Keeper | None,
    *,
    shown: bool,
) -> None:
    chunks = chunks_of(len(points), chained=points.chained)
    left = [chunk for chunk in chunks if not findings.done[slice(*chunk)].all()]
    tasks = (points.task(*chunk, findings) for chunk in left)  # each is made when it begins
    bar: Any = nullcontext()
    if shown:
        from tqdm import tqdm

        done = int(findings.done.sum())
        bar = tqdm(total=findings.count, initial=done, unit="point", file=sys.stderr)
    with bar:
        for number, rows in finished(points.work, tasks, executor):
            findings.add(slice(*left[number]), rows)
            if keeper is not None:
                keeper.write_when_due()
            if shown:
                written = bar.update(len(rows.texts["ending"]))
                # only when the bar is drawn: a note may cost more than its point
                if rows.note is not None and (written or findings.done.all()):
                    bar.set_postfix_str(rows.note())


def _keeper_of(path: Path, points: Points, findings: Findings) -> Keeper:
    return Keeper(path, lambda: _archived(points, findings), lambda: int(findings.done.sum()))


def save_rows(path: str | os.PathLike[str], points: Points, rows: Rows) -> None:
    """Write the rows of all points to a store; ValueError where it cannot be written."""
    file, findings = stores.place(path), Findings(len(points))
    findings.add(slice(None), rows)
    with stores.locked(file), _keeper_of(file, points, findings):
        pass


def read_rows(path: Path, kind: str) -> tuple[stores.Archive, Findings]:
    """Return the archive of a store, and its findings.

    Raises
    ------
    ValueError
        As `dynkit.data.store.read`, and when the store is of another kind.
    """
    archive = stores.read(path)
    if archive.entries.get("kind") != kind:
        raise ValueError(f"store must hold a {kind}; got {path}")
    with stores.understood(path, kind):
        count = positive_integer("points", int(archive.entries["points"]))
        if count > MOST_POINTS:
            raise ValueError(f"{count} points")
        findings, done = Findings(count), archive.arrays["done"]
        if done.dtype.kind != "i" or done.ndim != 1:
            raise ValueError(f"done is {done.dtype} {done.shape}")
        if len(done) and not (done[0] >= 0 and (np.diff(done) > 0).all()):
            raise ValueError("done must have ascending indices of points")
        arrays, codes = (_group(archive.arrays, name) for name in ("found", "texts"))
        for name, column in [*arrays.items(), *codes.items()]:
            if len(column) != len(done):
                raise ValueError(f"{name} has {len(column)} rows for {len(done)} points")
        known = json.loads(archive.entries["texts"])
        texts = {name: [known[code] for code in column.tolist()] for name, column in codes.items()}
        cost = Cost(float(archive.entries["seconds"]), json.loads(archive.entries["work"]))
        findings.add(done, Rows(arrays, texts, cost))
    return archive, findings


def _group(arrays: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {
        key.removeprefix(f"{name}/"): a for key, a in arrays.items() if key.startswith(f"{name}/")
    }


def _entries(points: Points) -> dict[str, str]:
    return {**points.entries, "points": str(len(points))}


def _archived(points: Points, findings: Findings) -> stores.Archive:
    rows = findings.rows()
    known = sorted({text for texts in rows.texts.values() for text in texts})
    code = {text: number for number, text in enumerate(known)}
    found = {
        "dynkit": __version__,
        "texts": json.dumps(known),
        "seconds": repr(rows.cost.seconds),
        "work": json.dumps(dict(rows.cost.counts)),
    }
    arrays = {f"given/{name}": array for name, array in points.inputs.items()}
    arrays |= {f"found/{name}": array for name, array in rows.arrays.items()}
    for name, texts in rows.texts.items():
        arrays[f"texts/{name}"] = np.array([code[text] for text in texts], dtype=np.int64)
    arrays["done"] = np.flatnonzero(findings.done)
    return stores.Archive({**_entries(points), **found}, arrays)


def _found(points: Points, path: Path) -> Findings:
    if not path.exists():
        return Findings(len(points))
    archive, findings = read_rows(path, points.entries["kind"])
    refuse_other(path, points, archive)
    with stores.understood(path, points.entries["kind"]):
        made = archive.entries["dynkit"]
        refuse_misfits(points, findings)
    if not findings.done.all():
        refuse_other_version(path, made)
    return findings


def refuse_other_version(path: Path, made: str) -> None:
    """Raise ValueError when an unfinished store was made with another version."""
    if made != __version__:
        raise ValueError(
            f"store {path} was made with dynkit {made}, and is not finished; got {__version__}"
        )


def refuse_misfits(points: Points, findings: Findings) -> None:
    """Raise when the findings of a store are impossible for these points.

    Call it inside `dynkit.data.store.understood`.

    Raises
    ------
    LookupError, ValueError
        When a column is missing, or does not fit.
    """
    if findings.count != len(points):
        raise ValueError(f"{findings.count} points instead of {len(points)}")
    if not findings.done.any():
        return
    if points.chained and not findings.done[: int(findings.done.sum())].all():
        raise ValueError("done lacks a point on which later points depend")
    for name, (letter, shape) in points.columns.items():
        found = findings.arrays[name]
        alike = [b in (None, a) for a, b in zip(found.shape[1:], shape, strict=False)]
        if found.dtype.kind != letter or found.ndim != 1 + len(shape) or not all(alike):
            raise ValueError(f"{name} is {found.dtype} {found.shape}")
    _ = findings.texts["ending"]


def refuse_other(path: Path, points: Points, archive: stores.Archive) -> None:
    """Raise when an archive belongs to other points.

    Raises
    ------
    ValueError
        The message names the first difference: entries first, then arrays, then the system.
    """
    made, asked = archive.entries, _entries(points)
    names = [*asked, *(name for name in made if name.startswith("system.") and name not in asked)]
    of_system = [name for name in names if name.startswith("system.")]
    others = [name for name in names if name not in of_system]
    stores.refuse_other_entries(path, archive, asked, others)
    given = _group(archive.arrays, "given")
    for name, array in points.inputs.items():
        _refuse_other_array(path, name, given.get(name), array)
    stores.refuse_other_entries(path, archive, asked, of_system)


def _refuse_other_array(path: Path, name: str, made: Any, asked: Any) -> None:
    if made is None or made.shape != asked.shape:
        shape = None if made is None else made.shape
        raise ValueError(f"store {path} was made with {name} of shape {shape}; got {asked.shape}")
    for place in np.argwhere(made != asked)[:1]:
        where, i = f"{name}{place.tolist()}", tuple(place)
        was, now = made[i].item(), asked[i].item()
        raise ValueError(f"store {path} was made with {where} {was!r}; got {now!r}")


@final
class Keeper:
    """Writes growing content to a store: at the beginning, at intervals, and at the end.

    The intervals keep the cost of writing low. ``archived()`` returns the present content, and
    ``done()`` the number of finished parts. The beginning of the context raises ValueError when the
    store cannot be written.
    """

    def __init__(
        self, path: Path, archived: Callable[[], stores.Archive], done: Callable[[], int]
    ) -> None:
        self._path = path
        self._archived = archived
        self._done = done
        self._written = -1
        self._due = 0.0

    def __enter__(self) -> Self:
        try:
            self.write()
        except OSError as failure:
            raise ValueError(reason(failure)) from failure
        return self

    def __exit__(self, *_: object) -> None:
        self.write()

    def write(self) -> None:
        """Write the content, unless all finished parts are written already."""
        done = self._done()
        if done == self._written:
            return
        began = time.monotonic()
        stores.write(self._path, self._archived())
        ended = time.monotonic()
        self._written = done
        self._due = ended + max(_LEAST_INTERVAL, (ended - began) / _SHARE)

    def write_when_due(self) -> None:
        """Write the content if the last writing is long enough ago."""
        if time.monotonic() >= self._due:
            self.write()
