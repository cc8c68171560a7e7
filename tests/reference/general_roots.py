"""Proved first root among rows of a linear motion: the farthest step that cannot pass one.

From f > 0 no root can lie before the root of f + f' e - D e^2 / 2, where D bounds |f''|. The steps
converge quadratically on a simple root from below, and f + f' e + D e^2 / 2 < 0 proves that it is
there. Nothing is sampled. A double root that the precision cannot decide raises.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from flint import arb, arb_mat, ctx

from tests.reference.linear_motion import LinearMotion, Row
from tests.reference.mode_bounds import INFINITE

MOST_STEPS: Final = 3_000_000
LONGEST: Final = arb((1, 100))
"""A step is no longer than this over the largest rate."""


class Root(NamedTuple):
    """First root after ``elapsed``, of row number ``which``; the state there."""

    elapsed: arb
    which: int
    state: arb_mat
    steps: int


def first_root(
    motion: LinearMotion, rows: Sequence[Row], z: arb_mat, orders: Sequence[int]
) -> Root | None:
    """First root after 0 of any of the rows; None where there is proved to be none.

    Parameters
    ----------
    motion, z
        The motion and its state at 0.
    rows
        Quantities that are positive just after 0.
    orders
        Of each the order of its first derivative at 0 that is not zero; those before are taken to
        vanish exactly.

    Raises
    ------
    ArithmeticError
        Where this precision, or this many steps, cannot decide.
    """
    elapsed = arb(0)
    negligible = arb((1, -ctx.prec // 2))
    for count in range(MOST_STEPS):
        if count >= 8 and count & (count - 1) == 0 and _never(motion, rows, z):
            return None
        low, high, index = INFINITE, INFINITE, -1
        for i, row in enumerate(rows):
            leading = orders[i] if count == 0 else 0
            if leading:
                step, top = _leave(motion, row, z, leading), INFINITE
            else:
                step, top = _step(motion, row, z)
            if not step > 0:
                raise ArithmeticError(f"the bounds leave no step; got {step}")
            if step < low:
                low, high, index = step, top, i
        if not low < INFINITE:
            return None
        if high - low < negligible * (elapsed + low):
            last = ((low + high) / 2).mid()
            return Root((elapsed + last).mid(), index, motion.move(z, last), count)
        if count and low < arb((1, -ctx.prec // 3)) * elapsed:
            raise ArithmeticError("grazing cannot be decided at this precision")
        low = motion.short(low.min(LONGEST / motion.fastest))
        z = motion.move(z, low)
        elapsed = (elapsed + low).mid()
    raise ArithmeticError("no root found, and none excluded")


def _never(motion: LinearMotion, rows: Sequence[Row], z: arb_mat) -> bool:
    return all(motion.lowest_ever(row, z) > 0 for row in rows)


def _leave(motion: LinearMotion, row: Row, z: arb_mat, order: int) -> arb:
    """Half of the time within which f, whose first derivatives vanish, must stay positive."""
    first = row.derivatives(z)[order]
    if not first > 0:
        raise ArithmeticError(f"derivative {order} must be positive at the start; got {first}")
    best = arb(0)
    harmonic = row.harmonic * motion.frequency ** (order + 1)
    for bound in motion.bounds(row, z, order + 1):
        total = bound.value + harmonic
        safe = (order + 1) * first / (2 * total) if total > 0 else INFINITE
        best = best.max(safe.lower().min(bound.window))
    return best.lower()


def _step(motion: LinearMotion, row: Row, z: arb_mat) -> tuple[arb, arb]:
    """A time before which f cannot vanish, and one before which it must, or infinity."""
    jets = row.value_and_rate(z)
    if not jets[0] > 0:
        raise ArithmeticError(f"f must be positive; got {jets[0]}")
    harmonic = row.harmonic * motion.frequency**2
    structural = row.structural(motion, z, jets)
    turning = jets[0] - structural[0], jets[1] - structural[1]
    low, high = arb(0), INFINITE
    for floor in motion.floors(row, z, *structural):
        # With the table, or whatever turns with it, as it is now, or at its worst all the time.
        moving = floor.value + turning[0], floor.rate + turning[1], floor.curvature + harmonic
        worst = floor.value - row.harmonic, floor.rate, floor.curvature
        for value, rate, curvature in (moving, worst):
            if value.lower() > 0:
                far = _earliest(value.lower(), rate.lower(), curvature.upper())
                low = low.max(far.min(floor.window)).lower()
        if floor.whole:
            latest = _latest(jets[0], jets[1], moving[2])
            if latest < floor.window:
                high = high.min(latest).upper()
    return low, high


def _earliest(f: arb, rate: arb, bound: arb) -> arb:
    """Root of f + f' e - D e^2 / 2, for f > 0."""
    root = (rate * rate + 2 * bound * f).sqrt()
    if rate < 0:
        return (2 * f / (root - rate)).lower()
    return ((root + rate) / bound).lower() if bound > 0 else INFINITE


def _latest(f: arb, rate: arb, bound: arb) -> arb:
    """Root of f + f' e + D e^2 / 2, for f > 0, or infinity."""
    square = rate * rate - 2 * bound * f
    if not (rate < 0 and square > 0):
        return INFINITE
    return (2 * f / (square.sqrt() - rate)).upper()
