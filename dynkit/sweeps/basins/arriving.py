"""Starts as points of the engine; a motion ends early at an orbit found from a sample of them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.data.store import identity_of, kind_of
from dynkit.dynamics.attractor import Attractor
from dynkit.engine.collecting import Findings, Points, Rows, chunks_of
from dynkit.engine.executors import finished
from dynkit.labels.label import COLUMNS, OrbitKind
from dynkit.sweeps.basins.classification import Look, orbit_size
from dynkit.sweeps.basins.matching import NEAR, label_at, nearest, orbits_in, size_of

# From _MANY starts on a sample is simulated first: for fewer the kernel for arrivals, which takes
# seconds to compile, does not pay. A motion has arrived when its distance from an orbit is below
# _ARRIVED, a tenth of the distance within which motions have the same attractor.
_MANY, _ARRIVED = 1000, 0.1 * NEAR


@final
@dataclass(frozen=True, eq=False)
class Arriving:
    """Function from starts (n, s) to their rows; motions that arrive at known orbits end early.

    Parameters
    ----------
    look : Look
    known : Rows
        Rows of motions on the known orbits.
    """

    look: Look
    known: Rows

    @cached_property
    def _orbits(self) -> list[Attractor]:
        """The motion on each known orbit, with all states of the orbit."""
        system, finals = self.look.system, self.known.arrays["final"]
        sizes = [orbit_size(label_at(self.known, k)) for k in range(len(finals))]
        return [
            system.attractor(start=system.unpack_state(final), transient=0, keep=size)
            for final, size in zip(finals, sizes, strict=True)
        ]

    def __call__(self, starts: Array) -> Rows:
        """Return the rows of some starts; motions at a known orbit have no final state."""
        began, look = time.perf_counter(), self.look
        arrivals = look.system.arrivals(starts, self._orbits, look.transient, _ARRIVED)
        assert arrivals is not None
        orbits, states, cost = arrivals
        rest, known = np.full(len(starts), np.inf), self.known.arrays
        for number, orbit in enumerate(self._orbits):
            here = np.flatnonzero(orbits == number)
            found = nearest(look, orbit.states, states[here])
            rest[here] = np.where(found <= NEAR * size_of(look, orbit.states), found, np.inf)
        (others,) = np.nonzero(np.isinf(rest))
        later, (there,) = look(starts[others]), np.nonzero(np.isfinite(rest))
        which = orbits[there]
        arrays = {name: np.empty((len(starts), *a.shape[1:]), a.dtype) for name, a in known.items()}
        for name, array in arrays.items():
            array[others], array[there] = later.arrays[name], known[name][which]
        arrays["final"][there] = np.nan
        arrays["state"][there], arrays["rest"][there] = states[there], rest[there]
        endings = np.empty(len(starts), dtype=object)
        endings[others] = later.texts["ending"]
        endings[there] = np.array(self.known.texts["ending"], dtype=object)[which]
        seconds = time.perf_counter() - began - later.cost.seconds
        return Rows(arrays, {"ending": endings.tolist()}, later.cost + cost + Cost(seconds))


@final
@dataclass(eq=False)
class Starts:
    """All starts, (n, s), as `points` of the engine.

    A sample of the starts, as many as the square root of their number, is simulated first. All
    others are compared with its stable periodic orbits.

    Attributes
    ----------
    sampling : Cost
        Cost of the sample.
    """

    look: Look
    starts: Array
    executor: Executor | None
    sampling: Cost = field(init=False, default_factory=lambda: Cost(0.0))

    @property
    def points(self) -> Points:
        """The points of the engine."""
        state, packed = self.look.sizes
        return Points(
            len(self.starts),
            self._work,
            lambda first, last, _: self.starts[first:last],
            self._entries,
            {"starts": self.starts},
            {**COLUMNS, "rest": ("f", ()), "state": ("f", (state,)), "final": ("f", (packed,))},
        )

    def _entries(self) -> dict[str, str]:
        system = {"system": kind_of(self.look.system), **identity_of(self.look.system)}
        return {"kind": "basins of attraction", **system, **self.look.entries}

    def _work(self) -> Callable[[Array], Rows]:
        look, count = self.look, len(self.starts)
        able = look.system.arrivals(self.starts[:0], (), 0, _ARRIVED) is not None
        if count < _MANY or not able:
            return look
        places = np.random.default_rng(count).choice(count, math.isqrt(count), replace=False)
        sample = self.starts[np.sort(places)]
        rows = self._sampled(sample)
        self.sampling = rows.cost
        firsts = [found.place for found, _ in orbits_in(look, rows, sample)]
        labels = [label_at(rows, place) for place in firsts]
        lasting = OrbitKind.PERIODIC, OrbitKind.STICKING
        stable = [label.kind in lasting and bool(label.stable) for label in labels]
        known = np.array(firsts, dtype=np.intp)[stable]
        if not len(known):
            return look
        arrays = {name: array[known] for name, array in rows.arrays.items()}
        endings = [rows.texts["ending"][k] for k in known.tolist()]
        return Arriving(look, Rows(arrays, {"ending": endings}, Cost(0.0)))

    def _sampled(self, sample: Array) -> Rows:
        chunks, findings = chunks_of(len(sample)), Findings(len(sample))
        tasks = [sample[slice(*chunk)] for chunk in chunks]
        for number, rows in finished(self.look, tasks, self.executor):
            findings.add(slice(*chunks[number]), rows)
        return findings.rows()
