"""`measure`: measures of a stream in one pass, with a store that is read and continued."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

from dynkit.analysis.running import (
    Running,
    RunningExponents,
    RunningHistogram,
    RunningPOD,
    RunningSample,
    RunningSpectrum,
)
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array, boolean, of_type
from dynkit.data import atomic_files as files, store as stores
from dynkit.data.result import archive_of, read_result
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Stream
from dynkit.engine.collecting import kept_in, refuse_other_version


class _Slot(NamedTuple):
    """One measure of a store; all other fields are None. The fields are the kinds of a store."""

    RunningExponents: RunningExponents | None = None
    RunningHistogram: RunningHistogram | None = None
    RunningPOD: RunningPOD | None = None
    RunningSample: RunningSample | None = None
    RunningSpectrum: RunningSpectrum | None = None


@final
class Measures(Mapping[str, Any]):
    """The results of `measure`, by name; each is computed from the accumulated sums when read.

    Attributes
    ----------
    states, keep : int
        Number of states that have been measured, and of all states of the stream.
    cost : Cost
        Seconds of the motion and of the measures, and work of the motion.
    repeats : int or None
        Number of states after which a state has recurred, bit for bit. A periodic motion recurs. So
        does a chaotic motion of few coordinates, because of rounding: later states then add no
        information, and the errors of the measures are too small.
    """

    _stored: ClassVar = (
        *("states", "keep", "cost", "repeats", "_last", "_anchor", "_anchored", "_slots"),
    )
    states: int
    keep: int
    cost: Cost
    repeats: int | None
    _last: Array | None
    _anchor: Array
    _anchored: int

    def __init__(self, running: Mapping[str, Running], keep: int) -> None:
        vars(self)["running"] = dict(running)
        self.states, self.keep, self.cost, self._last = 0, keep, Cost(0.0), None
        self.repeats, self._anchor, self._anchored = None, np.empty(0), 0

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Measures:
        """Read the measures of a store, also while another process continues it.

        Raises
        ------
        ValueError
            When the file is missing, damaged, or not a store of measures.
        """
        return _read(path)[0]

    @cached_property
    def running(self) -> Mapping[str, Running]:
        """The measures that accumulate."""
        slots = self._slots.items()
        return {name: each for name, slot in slots for each in slot if each is not None}

    def __getitem__(self, name: str) -> Any:
        return self.running[name].result()

    def __iter__(self) -> Iterator[str]:
        return iter(self.running)

    def __len__(self) -> int:
        return len(self.running)

    def __repr__(self) -> str:
        again = f"; repeats itself after {self.repeats}" if self.repeats else ""
        return f"<Measures {', '.join(self)}: {self.states} of {self.keep} states{again}>"

    @cached_property
    def _slots(self) -> Mapping[str, _Slot]:
        for name, running in self.running.items():
            kind = type(running)  # a class of the user may have the same name
            if kind.__module__ != Running.__module__ or kind.__name__ not in _Slot._fields:
                raise ValueError(f"store must be None for {name}, which is {running!r}")
        return {
            name: _Slot(**{type(running).__name__: running})  # type: ignore[arg-type]
            for name, running in self.running.items()
        }

    def _after(self, block: Attractor) -> Measures:
        """Return the measures with one more block; the old ones remain."""
        began = time.perf_counter()
        running = {name: deepcopy(each) for name, each in self.running.items()}
        for each in running.values():
            each.add(block)
        found, system = Measures(running, self.keep), block.system
        found.states = self.states + len(block.states)
        found._last = system.pack_state(block.final)  # type: ignore[attr-defined]
        seconds = block.cost.seconds + time.perf_counter() - began
        found.cost = self.cost + Cost(seconds, block.cost.counts)
        found._look_for_repetition(self, block.states)
        return found

    def _look_for_repetition(self, before: Measures, states: Array) -> None:
        """Compare the states of a block with an earlier state, the anchor, which is renewed.

        R. P. Brent, BIT 20 (1980) 176-184.
        """
        self.repeats, self._anchor = before.repeats, before._anchor
        self._anchored = before._anchored
        if self.repeats is None and self._anchored:
            same = np.flatnonzero((states == self._anchor).all(axis=1))
            if len(same):
                self.repeats = before.states + int(same[0]) + 1 - self._anchored
        if self.states >= 2 * self._anchored:
            self._anchor, self._anchored = states[-1].copy(), self.states


def _read(path: str | os.PathLike[str]) -> tuple[Measures, stores.Archive]:
    found, file, archive = read_result(path, Measures)
    if len(found.running) < len(found._slots):
        raise ValueError(f"store must hold all of a Measures; got {file} (a measure is missing)")
    return found, archive


def measure(
    stream: Stream,
    measures: Mapping[str, Running],
    *,
    store: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Measures:
    """Measure the blocks of a stream in one pass, in the memory of one block.

    A store keeps the accumulated sums, and the state from which the motion continues. It is
    written at intervals, and at the end also after an error; other processes can read it at any
    time. If the run is interrupted, the same call continues it, with the same bits as without the
    interruption. A stream with a larger `keep` continues a finished one.

    Parameters
    ----------
    stream : Stream
    measures : mapping of str to Running
        New measures, by name; they are copied.
    store : path, optional
        HDF5 file for the measures of `dynkit.analysis`.
    progress : bool
        Whether to show a bar on standard error.

    Returns
    -------
    Measures

    Raises
    ------
    ValueError
        When an argument is refused; for a store of another stream or of other measures, of another
        version, damaged, or in use.
    NoMotion
        When the motion ends; the store keeps the states before.
    OSError
        When the store becomes impossible to write during the run.

    Examples
    --------
    >>> from dynkit.analysis import RunningExponents, RunningHistogram
    >>> from dynkit.systems import Logistic
    >>> stream = Logistic(rate=4.0).stream(start=[0.3], keep=30_000)
    >>> wanted = {"exponent": RunningExponents(), "x": RunningHistogram("state[0]", low=0, high=1)}
    >>> found = measure(stream, wanted, progress=False)
    >>> found
    <Measures exponent, x: 30000 of 30000 states>
    >>> bool(abs(found["exponent"].exponents[0] - np.log(2.0)) < 3.0 * found["exponent"].error[0])
    True
    """
    of_type("stream", stream, Stream, "a Stream, as system.stream() returns")
    shown, new = boolean("progress", progress), Measures(_checked(measures), stream.keep)
    if store is None:
        box = [new]
        _follow(stream, box, None, shown=shown)
        return box[0]
    path, entries = files.place("store", store), _entries(stream, new)
    box = [_found(path, entries, new)]
    if box[0].states < stream.keep:
        with files.locked("store", path):
            # another process may have written the store since
            existed, box[0] = path.exists(), _found(path, entries, new)
            kept = kept_in(path, lambda: archive_of(box[0], entries), lambda: box[0].states)
            try:
                with kept as write:
                    _follow(stream, box, write, shown=shown)
            except ValueError:  # a wrong argument, such as the name of an observable
                if not (existed or box[0].states):
                    path.unlink(missing_ok=True)
                raise
    return box[0]


def _checked(measures: object) -> Mapping[str, Running]:
    if not isinstance(measures, Mapping) or not measures:
        raise ValueError(f"measures must be a mapping of names to measures; got {measures!r}")
    for name, running in measures.items():
        if not isinstance(running, Running) or not isinstance(name, str):
            raise ValueError(f"measures[{name!r}] must be a Running measure; got {running!r}")
        if running.states:
            raise ValueError(
                f"measures[{name!r}] must be new; got {running!r} of {running.states} states"
            )
    return measures


def _follow(
    stream: Stream, box: list[Measures], write: Callable[[], None] | None, *, shown: bool
) -> None:
    """Measure the remaining blocks; the only entry of `box` is replaced after each block."""
    from tqdm import tqdm

    done, last = box[0].states, box[0]._last
    final_state = None if last is None else stream.system.unpack_state(last)
    with tqdm(
        total=stream.keep, initial=done, unit="state", file=sys.stderr, disable=not shown
    ) as bar:
        for block in stream.blocks_after(done, final_state):
            box[0] = box[0]._after(block)
            if write is not None:
                write()
            bar.update(len(block.states))


def _entries(stream: Stream, new: Measures) -> dict[str, str]:
    """Return the entries that a store of this stream and these measures must have."""
    own = {f"measure {name}": repr(running) for name, running in new.running.items()}
    of = {"system": stores.kind_of(stream.system)}
    return {**of, **stores.identity_of(stream), **own, "measures": ", ".join(sorted(new._slots))}


def _found(path: Path, entries: Mapping[str, str], new: Measures) -> Measures:
    """Return the measures of a store, or the new ones where there is none."""
    if not path.exists():
        return new
    found, archive = _read(path)
    stores.refuse_other_entries(path, archive, entries, sorted(entries))
    if found.states > new.keep:
        raise ValueError(f"keep must be {found.states} or more, as {path} has; got {new.keep}")
    if found.states < new.keep:
        refuse_other_version(path, archive.entries["dynkit"])
    found.keep = new.keep
    return found
