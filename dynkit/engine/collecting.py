"""Points to evaluate in chunks, with or without an executor; their findings, kept in a store."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from dynkit._version import __version__
from dynkit.core.cost import Cost
from dynkit.core.validation import boolean, positive_integer
from dynkit.data import atomic_files as files, store as stores
from dynkit.engine.executors import finished

Anything: TypeAlias = NDArray[Any]
Columns: TypeAlias = Mapping[str, tuple[str, tuple[int | None, ...]]]
"""For each array, by name: NumPy's kind letter, and the shape of a row; None for any length."""

# There are at least _FEW chunks, of up to _SIZE points each, if there are enough points. For very
# many points there are at most about _MANY larger chunks, because each takes an executor some time.
_FEW, _SIZE, _MANY = 256, 32, 2048

MOST_POINTS = 10_000_000
"""The findings at this many points take a gigabyte; at a millisecond each they take three hours."""


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Findings at n points.

    Parameters
    ----------
    arrays : mapping of str to (n, ...) array
    texts : mapping of str to list of n str
    cost : Cost
        Cost of all n points.
    note : callable, optional
        Returns a text beside the count of the progress bar; for chains only.
    """

    arrays: Mapping[str, Anything]
    texts: Mapping[str, list[str]]
    cost: Cost
    note: Callable[[], str] | None = None


def chunks_of(count: int, *, chained: bool = False) -> list[tuple[int, int]]:
    """Return the range (first, last + 1) of each chunk; it depends on the count only.

    The chunks of a chain are single points.

    Examples
    --------
    >>> chunks_of(3), len(chunks_of(40_000)), chunks_of(40_000)[-1]
    ([(0, 1), (1, 2), (2, 3)], 1250, (39968, 40000))
    """
    size = 1 if chained else max(1, min(count // _FEW, _SIZE), count // _MANY)
    return [(first, min(first + size, count)) for first in range(0, count, size)]


@final
class Findings:
    """The findings so far, filled in place: the rows, among `count`, of finished chunks."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.done = np.zeros(count, dtype=np.bool_)
        self.arrays: dict[str, Anything] = {}
        self.texts: dict[str, Anything] = {}
        self._seconds, self._work = 0.0, Counter[str]()

    def add(self, places: slice | NDArray[np.intp], rows: Rows) -> None:
        """Add the rows of these points; an interruption leaves all other rows unchanged."""
        for name, array in rows.arrays.items():
            if name not in self.arrays:
                self.arrays[name] = np.zeros((self.count, *array.shape[1:]), array.dtype)
            self.arrays[name][places] = array
        for name, texts in rows.texts.items():
            if name not in self.texts:
                self.texts[name] = np.full(self.count, "", dtype=object)
            self.texts[name][places] = texts
        self._seconds += rows.cost.seconds
        for name, count in rows.cost.counts.items():
            self._work[name] += count
        self.done[places] = True

    def rows(self) -> Rows:
        """Return the finished rows, in the order of the points."""
        arrays = {name: array[self.done] for name, array in self.arrays.items()}
        texts = {name: every[self.done].tolist() for name, every in self.texts.items()}
        return Rows(arrays, texts, Cost(self._seconds, self._work))


@final
@dataclass(frozen=True, eq=False)
class Points:
    """Points that can be evaluated in any order, by any process.

    Parameters
    ----------
    count : int
    work : callable
        Returns, when the first chunk begins, a function from the task of a chunk to its `Rows`.
        That function is picklable, small, and depends on nothing else: it returns the same bits in
        every process.
    task : callable
        ``task(first, last, found)`` returns the task of a chunk: the points first, ..., last - 1.
        For a chain, `found` holds the rows of all earlier points.
    entries : callable
        Returns, for a store only, texts by name that identify the points: a store with others is
        refused. ``entries()["kind"]`` is the kind of the store.
    inputs : mapping of str to array
        Arrays that identify the points.
    columns : Columns
        Kinds and shapes of the arrays of their rows; those of a store must agree.
    chained : bool
        Whether a point needs the rows of the one before it: such points are evaluated one by one,
        in their order, without an executor.
    """

    count: int
    work: Callable[[], Callable[[Any], Rows]]
    task: Callable[[int, int, Findings], Any]
    entries: Callable[[], Mapping[str, str]]
    inputs: Mapping[str, Anything]
    columns: Columns
    chained: bool = False


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
    path = None if store is None else files.place("store", store)
    findings = _found(points, path)
    if findings.done.all():  # a complete store needs neither a lock nor a writable folder
        return findings.rows()
    with ExitStack() as opened:
        write = None
        if path is not None:
            opened.enter_context(files.locked("store", path))
            findings = _found(points, path)  # another process may have written since
            archived = partial(_archived, points, findings)
            write = opened.enter_context(kept_in(path, archived, findings.done.sum))
        chunks = chunks_of(points.count, chained=points.chained)
        left = [chunk for chunk in chunks if not findings.done[slice(*chunk)].all()]
        tasks = (points.task(*chunk, findings) for chunk in left)  # each is made when it begins
        bar: Any = None
        if shown:
            from tqdm import tqdm

            done = int(findings.done.sum())
            bar = tqdm(total=findings.count, initial=done, unit="point", file=sys.stderr)
            opened.enter_context(bar)
        work = points.work()
        found = enumerate(map(work, tasks)) if executor is None else finished(work, tasks, executor)
        for number, rows in found:
            findings.add(slice(*left[number]), rows)
            if write is not None:
                write()
            if bar is not None:
                written = bar.update(len(rows.texts["ending"]))
                # only when the bar is drawn: a note may cost more than its point
                if rows.note is not None and (written or findings.done.all()):
                    bar.set_postfix_str(rows.note())
    return findings.rows()


def save_rows(path: str | os.PathLike[str], points: Points, rows: Rows) -> None:
    """Write the rows of all points to a store; ValueError where it cannot be written."""
    findings = Findings(points.count)
    findings.add(slice(None), rows)
    stores.save(path, _archived(points, findings))


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
    return stores.Archive({**points.entries(), "points": str(points.count), **found}, arrays)


def _found(points: Points, path: Path | None) -> Findings:
    if path is None or not path.exists():
        return Findings(points.count)
    kind = points.entries()["kind"]
    archive, findings = read_rows(path, kind)
    refuse_other(path, points, archive)
    with stores.understood(path, kind):
        made = archive.entries["dynkit"]
        refuse_misfits(findings, points.count, points.columns, chained=points.chained)
    if not findings.done.all():
        refuse_other_version(path, made)
    return findings


def refuse_other_version(path: Path, made: str) -> None:
    """Raise ValueError when an unfinished store was made with another version."""
    if made != __version__:
        raise ValueError(
            f"store {path} was made with dynkit {made}, and is not finished; got {__version__}"
        )


def refuse_misfits(findings: Findings, count: int, columns: Columns, *, chained: bool) -> None:
    """Raise when the findings of a store are impossible for this number of points.

    Call it inside `dynkit.data.store.understood`.

    Raises
    ------
    LookupError, ValueError
        When a column is missing, or does not fit.
    """
    if findings.count != count:
        raise ValueError(f"{findings.count} points instead of {count}")
    if not findings.done.any():
        return
    if chained and not findings.done[: int(findings.done.sum())].all():
        raise ValueError("done lacks a point on which later points depend")
    for name, (letter, shape) in columns.items():
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
    made, asked = archive.entries, {**points.entries(), "points": str(points.count)}
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


@contextmanager
def kept_in(
    path: Path, archived: Callable[[], stores.Archive], done: Callable[[], int]
) -> Generator[Callable[[], None]]:
    """Write growing content to a store: at the beginning, at intervals, and at the end.

    The context yields a function, to be called when content was added: it writes if the last
    writing is long enough ago. The intervals keep the cost of writing low. ``archived()`` returns
    the present content, and ``done()`` the number of finished parts. The beginning of the context
    raises ValueError when the store cannot be written.
    """
    written, due = -1, 0.0

    def write(*, at_once: bool = False) -> None:
        nonlocal written, due
        began = time.monotonic()
        if (began < due and not at_once) or (count := int(done())) == written:
            return
        stores.write(path, archived())
        ended = time.monotonic()
        written, due = count, ended + max(_LEAST_INTERVAL, (ended - began) / _SHARE)

    try:
        write()
    except OSError as failure:
        raise ValueError(files.reason(failure)) from failure
    try:
        yield write
    finally:
        write(at_once=True)
