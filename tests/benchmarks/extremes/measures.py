"""What an extreme case gives: its errors, true and claimed, and its cost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from tests.benchmarks.extremes.cases import Case, ExactImpact

if TYPE_CHECKING:
    from dynkit.systems.impact.records.record import ImpactRecord

_TWO_PI = Decimal("6.28318530717958647692528676655900576839")

LOST = 1.0
"""Where this error is claimed events may be others, and the phase may have turned once more."""


@dataclass(frozen=True)
class Outcome:
    """What was found.

    Parameters
    ----------
    case : Case
    impacts : int
        How many were simulated, those that were skipped among them.
    ending : str
        Name of the ending.
    compared : int
        Impacts compared with exact ones.
    true, claimed : float
        Largest errors of them.
    largest : float
        Largest section coordinate of them, by which errors are judged.
    ratio : float
        Largest ratio of an actual error to its estimate, times among them; not above 1.
    seconds : float
        Of the simulation, without making the system ready.
    wrong : str
        What is wrong, if anything is.
    """

    case: Case
    impacts: int
    ending: str
    compared: int
    true: float
    claimed: float
    largest: float
    ratio: float
    seconds: float
    wrong: str

    @property
    def right(self) -> bool:
        """Whether everything is as it should be."""
        return not self.wrong


def measure(case: Case, *, ready: bool = False) -> Outcome:
    """Simulate a case and compare it with its exact impacts; once more before, if not `ready`."""
    oscillator = case.system()
    start = case.begin(oscillator)
    if not (case.transient or ready):
        oscillator.simulate(impacts=case.impacts, start=start)  # makes the system ready
    attractor = oscillator.attractor(transient=case.transient, impacts=case.impacts, start=start)
    record = attractor.record
    claimed = record.error
    true, asked, ratio, wrong = 0.0, 0.0, 0.0, ""
    for exact in case.values:
        i = _matching(record, exact)
        if i is None and float(claimed.max(initial=0.0)) >= LOST:
            continue
        if i is None:
            wrong = f"impact {exact.number} after {exact.after} releases is missing"
            continue
        error = _distance(case, record.states[i], exact)
        true, asked = max(true, error), max(asked, float(claimed[i]))
        ratio = max(ratio, _ratio(error, float(claimed[i])))
        if claimed[i] < LOST and not case.transient:
            ratio = max(ratio, _lateness(record, i, exact, float(claimed[i])))
    if record.ending.name != case.ending:
        wrong = f"{record.ending.name} instead of {case.ending}"
    elif not np.isfinite(record.states).all():
        wrong = "not finite"
    elif ratio > 1.0:
        wrong = wrong or "an error exceeds what is claimed"
    done = len(record) + attractor.transient
    return Outcome(
        case,
        done,
        record.ending.name,
        len(case.values),
        true,
        asked,
        max((abs(float(x)) for exact in case.values for x in exact.state), default=0.0),
        ratio,
        attractor.cost.seconds,
        wrong,
    )


def _matching(record: ImpactRecord, exact: ExactImpact) -> int | None:
    """Place of an impact, by its number since the release before it."""
    releases = record.sticking[:, 1]
    first = 0
    if exact.after:
        if exact.after > len(releases):
            return None
        first = int(np.searchsorted(record.time, releases[exact.after - 1]))
    place = first + exact.number
    end = len(record)
    if exact.after < len(releases):
        end = int(np.searchsorted(record.time, releases[exact.after]))
    return place if place < end else None


def _distance(case: Case, state: np.ndarray, exact: ExactImpact) -> float:
    """Largest error of a section coordinate; phases differ by half a turn at most."""
    found = state[list(case.coordinates)] if case.coordinates else state
    off = [Decimal(a) - b for a, b in zip(found.tolist(), exact.state, strict=True)]
    off[-1] -= _TWO_PI * (off[-1] / _TWO_PI).to_integral_value()
    return max(abs(float(x)) for x in off)


def _lateness(record: ImpactRecord, i: int, exact: ExactImpact, claimed: float) -> float:
    """Error of the time over the one claimed, both without the rounding of the time itself."""
    time = float(record.time[i])
    late = abs(float(Decimal(time) - exact.time))
    return _ratio(late, claimed / record.system.frequency + math.ulp(time))


def _ratio(true: float, claimed: float) -> float:
    if true == 0.0:
        return 0.0
    return true / claimed if claimed > 0.0 else math.inf
