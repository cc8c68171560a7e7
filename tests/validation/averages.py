"""Powers of the proper orthogonal decomposition of short motions against 100 digits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, ctx

from dynkit.analysis import POD
from dynkit.core.validation import Array
from dynkit.systems.impact.records.record import ImpactRecord
from tests.impact_orbits.exact_orbits import BITS, ImpactMap
from tests.reference.random_cases import STARTS, random_case

CASES, FEW = 1800, 5
NONE = arb((1, -200))
"""Sums of rates below are zero."""


def powers(every: int) -> Iterator[tuple[float, float]]:
    """Largest error of a power of a motion of one to three flights, from just after an impact."""
    for number in range(0, CASES, every):
        yield from powers_of(number)


def powers_of(number: int) -> Iterator[tuple[float, float]]:
    """The same of one case, if it has such a motion."""
    case = random_case(STARTS * (40_000 + number))
    system = case.system()
    if system.degrees_of_freedom > FEW:
        return
    before = system.simulate(impacts=1 + number % 7, start=case.start(system))
    if not len(before):
        return
    start, count = before.states[-1], 1 + number % 3
    record = system.simulate(impacts=count, start=system.impact_state(start))
    if len(record) < count or len(record.sticking):
        return
    try:
        pod = POD(record)
        exact = _exact(start, record)
    except (ArithmeticError, ValueError):  # it rests, or modes merge
        return
    yield float(abs(pod.power - exact).max()), pod.error


def _exact(start: Array, record: ImpactRecord) -> Array:
    """Mean squares of the proper orthogonal modes, descending."""
    with ctx.workprec(BITS):
        impacts = ImpactMap(record.system)
        n = impacts.size
        rates, right = acb_mat(impacts.rates).eig(right=True, algorithm="approx")
        left = right.inv().mid()
        diagonal = acb_mat(len(rates), len(rates))
        for i, rate in enumerate(rates):
            diagonal[i, i] = rate
        off = right * diagonal * left - acb_mat(impacts.rates)
        apart = max(float(abs(z).mid()) for z in off.entries())
        if not apart < 1e-80:
            raise ArithmeticError("modes merge")
        y, side = [arb(x) for x in start.tolist()], int(np.signbit(start[-2]))
        products, total = acb_mat(n, n), arb(0)
        durations = np.diff(record.time, prepend=0.0).tolist()
        for lasts, u in zip(durations, record.relative_velocity.tolist(), strict=True):
            to, guess = int(np.signbit(u)), arb(lasts)
            after = impacts.next(y, side, (impacts.rates * guess).exp().mid(), guess, to)
            time = ((after[-1] - y[-1]) / impacts.frequency).mid()
            products += _integral(rates, right, left * acb_mat(impacts.lift(y, side)), time, n)
            total += time
            y, side = after, to
        mean = (products / acb(total)).mid()
        values = acb_mat(mean).eig(algorithm="approx")
        return np.sort([float(z.real.mid()) for z in values])[::-1]


def _integral(rates: Any, right: Any, parts: Any, time: Any, n: int) -> Any:
    """Of the products (n, n) of positions over a flight."""
    whole = len(rates)
    grown = acb_mat(whole, whole)
    for i in range(whole):
        for j in range(whole):
            both = rates[i] + rates[j]
            span = acb(time) if abs(both) < NONE else ((both * time).exp() - 1) / both
            grown[i, j] = parts[i, 0] * parts[j, 0] * span
    rows = acb_mat([[right[i, j] for j in range(whole)] for i in range(n)])
    return (rows * grown * rows.transpose()).mid()
