"""Random machines whose springs are not linear against 60 digits: times and states of impacts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from dynkit.systems import HardStop, SoftStop
from tests.reference.nonlinear_machines import Truth, random_nonlinear

MACHINES, IMPACTS = 400, 4

ROUNDING = 2.0**-52


def compared(machine: Any, start: Any, impacts: int = IMPACTS) -> list[tuple[float, float, float]]:
    """Actual errors of times and states of a machine's impacts, and their estimate."""
    record = machine.simulate(impacts=impacts, start=start)
    pairs = zip(Truth(machine).compared(record), record.time.tolist(), strict=False)
    return [(late, off, error + ROUNDING * (1.0 + time)) for (late, off, error), time in pairs]


@cache
def of_machine(number: int) -> list[tuple[float, float, float]]:
    """The same of a random machine."""
    return compared(*random_nonlinear(number))


def states_of_machines(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of positions and velocities after impacts."""
    for number in range(0, MACHINES, every):
        yield from ((off, error) for _, off, error in of_machine(number))


def times_of_machines(every: int) -> Iterator[tuple[float, float]]:
    """Errors of times of these."""
    for number in range(0, MACHINES, every):
        yield from ((late, error) for late, _, error in of_machine(number))


@cache
def lowest(number: int) -> tuple[Any, Any, Any, list[Any], float, float]:
    """A machine, its start, a stop, the other elements, and where its gap is lowest so far.

    The time, and the offset of a stop that just touches then.
    """
    machine, start = random_nonlinear(number)
    stop, *others = machine.elements
    others = [e for e in others if not isinstance(e, HardStop)] or [
        SoftStop(0, offset=-90.0, stiffness=1.0)
    ]
    free = machine.replace(elements=others)
    begin = free.state(start.position, start.velocity, start.phase)
    record = free.simulate(impacts=4, start=begin)
    function = machine._functions[0]

    def place(times: Any) -> Any:
        x, _ = record.sample(times)
        swing = stop.amplitude * np.sin(start.phase + machine.frequency * times - stop.phase)
        return np.array([float(function(each)) for each in x]) - swing

    times = np.linspace(0.02, 0.999 * float(record.time[-1]), 800)
    found = place(times)
    inner = range(1, len(times) - 1)
    i = next(i for i in inner if found[i] <= min(found[:i].min(), found[i + 1]))
    given: Any = {"bounds": times[[i - 1, i + 1]], "method": "bounded", "options": {"xatol": 1e-9}}
    least = minimize_scalar(lambda t: place(np.array([t]))[0], **given)
    return machine, start, stop, others, float(least.x), float(least.fun)


def grazing(number: int, depth: float) -> tuple[bool, float]:
    """Whether a stop so far above the lowest place is hit there; actual error over estimate.

    A depth below zero is the distance by which the stop is missed.
    """
    machine, start, stop, others, time, offset = lowest(number)
    law = stop.restitution if isinstance(stop.restitution, float) else 0.8
    moved = replace(stop, offset=offset + depth, restitution=law or 0.8)
    machine = machine.replace(elements=[moved, *others])
    begin = machine.state(start.position, start.velocity, start.phase)
    first = machine.simulate(impacts=1, start=begin).time
    ratios = [max(late, off) / error for late, off, error in compared(machine, begin, 2)]
    return bool(len(first) and abs(first[0] - time) < 1e-2), max(ratios, default=0.0)
