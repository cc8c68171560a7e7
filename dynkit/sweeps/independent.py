"""Sweeps of independent starts: each value starts by itself, wherever it is simulated."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from dynkit import store
from dynkit.maps import Map
from dynkit.no_motion import located
from dynkit.results import Cost
from dynkit.sweeps.archive import identity, outline_of
from dynkit.sweeps.following import Findings, Plan, kind_of
from dynkit.sweeps.sweepable import Sweepable, sweepable
from dynkit.validation import Array
from dynkit.workers.collecting import collect, read_rows, refuse_other
from dynkit.workers.points import Anything, Points, Rows

KIND = "sweep of independent starts"


def simulate_independently(
    plan: Plan, executor: Executor | None, path: Path | None, *, progress: bool
) -> Findings:
    """Return what is found at all values, each by itself.

    Raises
    ------
    ValueError
        As `dynkit.workers.collecting.collect`.
    NoMotion
        When there is no motion at a value, or the system refuses the start there; a note of the
        exception says where, as of every exception.
    """
    points = _Values(plan)
    return _findings(plan, collect(points, executor=executor, store=path, progress=progress))


def load_independent(file: Path, system: Sweepable | Map | None) -> tuple[Plan, Findings]:
    """Return what the store of such a sweep holds, as `Sweep.load` does.

    Raises
    ------
    ValueError
        As `Sweep.load`.
    """
    archive, found = read_rows(file, KIND)
    with store.understood(file, KIND):
        given = {name: archive.arrays[f"given/{name}"] for name in ("values", "start")}
        plan = replace(outline_of(store.Archive(archive.entries, given)), follow=False)
    if system is not None:
        plan = replace(plan, family=sweepable(system), kind=kind_of(system))
        points = _Values(plan)
        refuse_other(file, points, points.entries, archive)
    if not found.done.all():
        raise ValueError(
            f"store must hold a finished sweep; got {found.done.sum()} of {found.count} values "
            f"in {file}"
        )
    with store.understood(file, KIND):
        return plan, _findings(plan, found.rows())


def _findings(plan: Plan, rows: Rows) -> Findings:
    names = plan.observables
    endings = list(dict.fromkeys(rows.texts["ending"]))
    return Findings(
        {name: rows.arrays[f"observables/{name}"] for name in names},
        rows.arrays["final"],
        rows.arrays["count"],
        np.array([endings.index(text) for text in rows.texts["ending"]], dtype=np.int64),
        np.zeros(len(plan.values), dtype=np.bool_),
        endings,
        len(plan.values),
        rows.cost.seconds,
        dict(rows.cost.counts),
    )


@final
class _Values(Points):
    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def __len__(self) -> int:
        return len(self._plan.values)

    @property
    def work(self) -> Callable[[Array], Rows]:
        return _Simulated(replace(self._plan, values=self._plan.values[:1]))

    def task(self, first: int, last: int) -> Array:
        return self._plan.values[first:last]

    @property
    def entries(self) -> Mapping[str, str]:
        plan = self._plan
        return {
            "kind": KIND,
            "system": plan.kind,
            "parameter": plan.parameter,
            **identity(plan.system(0)),
            "transient": str(plan.transient),
            "keep": str(plan.keep),
            "observables": json.dumps(plan.observables),
        }

    @property
    def inputs(self) -> Mapping[str, Anything]:
        return {"values": self._plan.values, "start": self._plan.start}


@final
@dataclass(frozen=True, eq=False)
class _Simulated:
    """The rows of some values; of the plan's values only the first, at which its start is told."""

    plan: Plan

    def __call__(self, values: Array) -> Rows:
        plan, n = self.plan, len(values)
        began = time.perf_counter()
        start = plan.start_at(0, np.empty((0, 0)))
        kept = {name: np.full((n, plan.keep), np.nan) for name in plan.observables}
        counts = np.zeros(n, dtype=np.int64)
        finals, endings, cost = [], [], Cost(0.0)
        for place, value in enumerate(values.tolist()):
            with located(f"at {plan.parameter} {value}"):
                system = plan.system_at(value)
                motion = plan.motion(system, start)
            for name, rows in kept.items():
                found = motion.observable(name)
                rows[place, : len(found)] = found
                counts[place] = len(found)
            finals.append(system.pack_state(motion.final))
            endings.append(str(motion.ending.value))
            cost = cost + Cost(0.0, motion.cost.counts)
        arrays: dict[str, Anything] = {f"observables/{name}": rows for name, rows in kept.items()}
        arrays |= {"final": np.array(finals), "count": counts}
        return Rows(arrays, {"ending": endings}, cost + Cost(time.perf_counter() - began))
