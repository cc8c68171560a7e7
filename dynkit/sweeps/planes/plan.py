"""The plan of a map of two parameters, and its values."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.no_motion import NoMotion, Refused, replaced
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import MOST_POINTS, Anything, Columns, Findings, Points, Rows
from dynkit.labels.label import COLUMNS, empty_columns, put_label
from dynkit.sweeps.plan import Plan, swept_values

NO_MOTION, REFUSED = -1, -2

OTHER_ENDS = {NO_MOTION: "no motion", REFUSED: "refused"}
"""Outcomes of pairs without a motion, by number. A pair is refused if the system refuses it, or the
start at it."""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PlanePlan(Plan):
    """The plan of a map of two parameters, whose pairs of values are points of the engine.

    Parameters
    ----------
    exponents : int
        Number of states for the largest Lyapunov exponent; 0 for no exponents.
    """

    KIND = "map of two parameters"
    exponents: int

    def points(self, *values: Array) -> Points:
        """Return all pairs of values, (k1,) and (k2,); the second value changes fastest."""
        inputs = {f"values of {name}": axis for name, axis in zip(self.names, values, strict=True)}
        return Points(
            len(values[0]) * len(values[1]),
            lambda: self,
            partial(self.task, values),
            self.entries(parameters=json.dumps(self.names), exponents=str(self.exponents)),
            {**inputs, "start": self.start},
            self.columns,
        )

    def task(self, values: Sequence[Array], first: int, last: int, found: Findings) -> Array:  # noqa: ARG002
        """Return some pairs of values, (n, 2)."""
        i, j = np.divmod(np.arange(first, last), len(values[1]))
        return np.stack([values[0][i], values[1][j]], axis=1)

    @property
    def columns(self) -> Columns:
        found: Columns = {**COLUMNS, "largest": ("f", (len(self.observables),))}
        return {**found, "exponent": ("f", ())} if self.exponents else found

    def motion_at(self, first: float, second: float) -> Attractor:
        """Simulate at a pair of values.

        Raises
        ------
        Refused
            When the system refuses the pair, or the start at it.
        """
        system = replaced(self.first, **{self.names[0]: first, self.names[1]: second})
        start = self.first.unpack_state(self.start) if len(self.start) else None
        return self.motion(system, start)

    def __call__(self, pairs: Array) -> Rows:
        """Return the rows of pairs of values, (n, 2)."""
        n, began = len(pairs), time.perf_counter()
        labels = empty_columns(n, NO_MOTION)
        largest = np.full((n, len(self.observables)), np.nan)
        exponents = np.full(n if self.exponents else 0, np.nan)
        endings, work = [], Counter[str]()
        for row, (first, second) in enumerate(pairs.tolist()):
            try:
                motion = self.motion_at(first, second)
                label = motion.label
                for column, name in enumerate(self.observables):
                    seen = motion.observable(name)
                    largest[row, column] = seen.max() if len(seen) else np.nan
                if self.exponents:
                    exponents[row] = largest_exponent(motion, self.exponents)
            except NoMotion as end:
                kind = REFUSED if isinstance(end, Refused) else NO_MOTION
                labels["kind"][row] = kind
                endings.append(f"{OTHER_ENDS[kind]}: {end}")
                continue
            put_label(labels, row, label)
            endings.append(str(motion.ending.value))
            work.update(motion.cost.counts)
        arrays: dict[str, Anything] = {**labels, "largest": largest}
        if self.exponents:
            arrays["exponent"] = exponents
        return Rows(arrays, {"ending": endings}, Cost(time.perf_counter() - began, work))


def largest_exponent(attractor: Attractor, count: int) -> float:
    """Return the largest Lyapunov exponent per state, from `count` states after the kept ones.

    During `count` / 4 states before these the disturbance turns into the growing direction. NaN
    where the motion ends.
    """
    states = attractor.states
    if not len(states):
        return float("nan")
    try:
        stretching = attractor.system.stretching(states[-1], count + count // 4)
    except NoMotion:
        return float("nan")
    return float(stretching.logs[count // 4 :, 0].mean())


def axes_of(family: Map, values: object) -> dict[str, Array]:
    """Return the values of two parameters by name, checked without simulating.

    Raises
    ------
    ValueError
        When a value is refused; the message names argument, limit and value.
    """
    if not isinstance(values, Mapping) or len(values) != 2:
        raise ValueError(f"values must hold the values of two parameters by name; got {values!r}")
    first, second = values
    known = ", ".join(family.parameters) or "none"
    for name in (first, second):
        if name not in family.parameters:
            raise ValueError(f"values must be of parameters among {known}; got {name!r}")
    axes = (
        swept_values(f"values[{first!r}]", values[first]),
        swept_values(f"values[{second!r}]", values[second]),
    )
    if len(axes[0]) * len(axes[1]) > MOST_POINTS:
        raise ValueError(
            f"values must not make more than {MOST_POINTS} pairs; got {len(axes[0])} of {first} "
            f"and {len(axes[1])} of {second}"
        )
    origin = float(axes[0][0]), float(axes[1][0])
    for name, axis, other in ((first, axes[0], second), (second, axes[1], first)):
        beside = origin[1] if other == second else origin[0]
        for place, value in enumerate(axis.tolist()):
            try:
                replaced(family, **{name: value, other: beside})
            except Refused as refusal:
                at = _places_of(family, (name, value, place), (other, beside))
                raise ValueError(f"{refusal} in {at}") from refusal
    return {first: axes[0], second: axes[1]}


def _places_of(family: Map, one: tuple[str, float, int], other: tuple[str, float]) -> str:
    """Return the name of the value that the system refuses; of both if it refuses neither alone."""
    name, value, place = one
    own, beside = f"values[{name!r}][{place}]", f"values[{other[0]!r}][0]"
    for changes, at in (({name: value}, own), (dict([other]), beside)):
        try:
            replaced(family, **changes)
        except Refused:
            return at
    return f"{own} with {beside}"
