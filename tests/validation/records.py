"""Records and attractors of random oscillators against 50 digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from tests.reference.random_cases import STARTS, Kept, random_case

TURN = 2.0 * math.pi


def states_of_records(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of section coordinates at an impact."""
    for record, i, off in _compared(every):
        yield float(abs(off[1:]).max()), float(record.error[i])


def times_of_records(every: int) -> Iterator[tuple[float, float]]:
    """Error of the time of an impact; its own rounding is told apart."""
    for record, i, off in _compared(every):
        claimed = float(record.error[i]) / record.system.frequency
        yield abs(float(off[0])), claimed + math.ulp(float(record.time[i]))


def states_of_attractors(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of the one state that an attractor keeps."""
    for record, i, off in _compared(every):
        if not len(record.sticking):
            attractor = record.system.attractor(transient=i, impacts=1, start=record.start)
            assert (attractor.states[0] == record.states[i]).all()
            yield float(abs(off[1:]).max()), attractor.error


def missing_impacts(every: int) -> list[int]:
    """Numbers of cases in which an exact impact is not found, and that is not claimed."""
    kept, out = Kept.load(), []
    for row, record in _simulated(kept, every):
        exact = kept.high[kept.begins[row]]
        if (
            _place(record, int(kept.after[row]), int(kept.place[row])) is None
            and record.error.max(initial=0.0) < 1.0
            and not _replaced(record, float(exact))
        ):
            out.append(int(kept.number[row]))
    return out


def _replaced(record: ImpactRecord, time: float) -> bool:
    """Whether a time lies within the rest of a chatter that was replaced by contact."""
    begins = record.sticking[:, 0]
    before = np.searchsorted(record.time, begins)
    last = np.where(before > 0, record.time[before - 1], 0.0)
    return bool(((last < time) & (time < begins)).any())


def _compared(every: int) -> Iterator[tuple[ImpactRecord, int, Array]]:
    """A record, the place of an impact, and the errors of its time and section coordinates."""
    kept = Kept.load()
    for row, record in _simulated(kept, every):
        i = _place(record, int(kept.after[row]), int(kept.place[row]))
        if i is not None:
            high, low = kept.numbers(row)
            off = np.append(record.time[i], record.states[i]) - high - low
            off[-1] -= TURN * np.rint(off[-1] / TURN)
            yield record, i, off


def _simulated(kept: Kept, every: int) -> Iterator[tuple[int, ImpactRecord]]:
    """Rows of every so manieth oscillator, with the record of the case."""
    for row, number in enumerate(kept.number.tolist()):
        if number // STARTS % every == 0:
            yield row, _record(number)


@cache
def _system(number: int) -> MatrixOscillator:
    return random_case(STARTS * number).system()


@cache
def _record(number: int) -> ImpactRecord:
    case = random_case(number)
    system = _system(number // STARTS)
    return system.simulate(impacts=case.impacts, start=case.start(system))


def _place(record: ImpactRecord, after: int, number: int) -> int | None:
    """Place of an impact, by its number since the release before it."""
    releases = record.sticking[:, 1]
    if after > len(releases):
        return None
    first = int(np.searchsorted(record.time, releases[after - 1])) if after else 0
    end = len(record)
    if after < len(releases):
        end = int(np.searchsorted(record.time, releases[after]))
    return first + number if first + number < end else None
