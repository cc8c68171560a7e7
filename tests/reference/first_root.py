"""Certified first root of a sum of damped oscillators, by bisection and interval arithmetic.

Cells are taken from left to right and bisected until each is one of: no root (f keeps its sign),
one crossing (f monotone or concave), or one minimum (f convex) whose height is enclosed. Nothing
is decided by sampling. Where 256 bits cannot tell a minimum from zero the answer is ``touch``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal, NamedTuple

from flint import arb, ctx

from tests.reference.oscillators import PRECISION, Cell, Number, OscillatorSum

SPLIT: Final = 0.4871
"""Where cells are split: off the middle, so that constructed cases stay off the edges."""

RELATIVE_WIDTH: Final = 2.0**-120
"""Half width of an enclosed root or minimum, relative to its place."""

NARROWEST: Final = 2.0**-48
"""Cells are not split below this width relative to their right end."""


class FirstRoot(NamedTuple):
    """What is proved about the first root with s > 0.

    kind
        ``root``: f > 0 on (0, root) and f changes sign there. ``none``: f > 0 on (0, horizon].
        ``touch``: f > 0 before, and a minimum or crossing that this precision cannot tell from a
        double root stands at ``root``.
    root, rate
        Enclosure of the root, narrower than 1e-30, and of f' there; None for ``none``.
    minimum, minimum_at
        The lowest local minimum in the open interval before the root; for ``none`` also f(horizon)
        counts. None where f has no such minimum.
    depth, depth_at
        f at its first stationary point after the root, or at the horizon where that comes first:
        a small negative depth is a grazing impact. None for ``none`` and ``touch``.
    """

    kind: Literal["root", "none", "touch"]
    root: arb | None
    rate: arb | None
    minimum: arb | None
    minimum_at: arb | None
    depth: arb | None
    depth_at: arb | None


class Crossing(NamedTuple):
    """A root, and whether f is proved to change sign there."""

    at: arb
    crosses: bool


def evaluate(
    s: Number,
    offset: Number,
    value: Sequence[Number],
    rate: Sequence[Number],
    w: Sequence[Number],
    sigma: Sequence[Number],
    *,
    leading: Sequence[Number] = (),
    precision: int = PRECISION,
) -> arb:
    """f(s) as a ball, at ``precision`` bits. Parameters as in `first_root`."""
    with ctx.workprec(precision):
        return OscillatorSum(offset, value, rate, w, sigma, leading).evaluate(arb(s))


def first_root(
    offset: Number,
    value: Sequence[Number],
    rate: Sequence[Number],
    w: Sequence[Number],
    sigma: Sequence[Number],
    *,
    horizon: float,
    leading: Sequence[Number] = (),
    precision: int = PRECISION,
) -> FirstRoot:
    """First root in (0, horizon] of f(s) = offset + sum of damped oscillators.

    Parameters
    ----------
    offset
        Constant term.
    value, rate, w, sigma : (n,)
        Value and rate at s = 0, natural frequency w >= 0 and decay sigma >= 0 of each term of
        y'' + 2 sigma y' + w^2 y = 0; sigma = 0, sigma = w and sigma > w are allowed.
    leading
        Exact f(0), f'(0), ... where they are known better than the sum gives them: ``(0.0, u)``
        after an impact, ``(0.0, 0.0, 0.0)`` after a release. The correction is a polynomial of
        that degree, so it grows like 1e-17 s. The root at 0 is divided out.

    Raises
    ------
    ValueError
        If f is not proved positive just after s = 0.
    """
    with ctx.workprec(precision):
        total = OscillatorSum(offset, value, rate, w, sigma, leading)
        found = find_root(total, horizon)
        if found is None:
            height, place = total.evaluate(arb(horizon)), arb(horizon)
            lowest = lowest_minimum(total, horizon)
            if lowest is not None and not height < lowest[0]:
                height, place = lowest
            return FirstRoot("none", None, None, height, place, None, None)
        minimum, minimum_at = lowest_minimum(total, _below(found.at)) or (None, None)
        slope = total.derivatives(found.at, 2)[1]
        if not found.crosses:
            return FirstRoot("touch", found.at, slope, minimum, minimum_at, None, None)
        depth, depth_at = _depth(total, found.at, horizon)
        return FirstRoot("root", found.at, slope, minimum, minimum_at, depth, depth_at)


def find_root(
    total: OscillatorSum, horizon: float, unproved: Sequence[tuple[float, float]] | None = None
) -> Crossing | None:
    """First zero of the sum in (0, horizon], or None where there is proved to be none.

    Where cells are given as ``unproved``, in order, f is known to be positive between them.
    """
    _require_positive_start(total)
    stack = cells(total, 0.0, horizon) if unproved is None else list(unproved)
    stack.reverse()
    while stack:
        left, right = stack.pop()
        cell = total.cell(left, right)
        if cell.sign() > 0:
            continue
        if right - left < NARROWEST * right:
            return Crossing(arb(left).union(arb(right)), crosses=False)
        if left > 0.0 or total.zero_order == 0:
            settled, crossing = _settle(total, cell)
            if settled and crossing is not None:
                return crossing
            if settled:
                continue
        middle = _split(cell)
        stack += [(middle, right), (left, middle)]
    return None


def lowest_minimum(total: OscillatorSum, horizon: float) -> tuple[arb, arb] | None:
    """Lowest local minimum (height, place) in the open interval (0, horizon), if there is one."""
    best: tuple[arb, arb] | None = None
    stack = cells(total, 0.0, horizon)[::-1]
    while stack:
        left, right = stack.pop()
        cell = total.cell(left, right)
        if cell.sign(1) or cell.sign(2) < 0 or (best and cell.lower_bound() > best[0]):
            continue
        at = None
        if right - left < NARROWEST * max(right, NARROWEST * horizon):
            if left == 0.0:
                continue
            at = arb(left).union(arb(right))
        elif cell.sign(2) > 0:
            start, end = cell.jet[1], total.derivatives(arb(right), 2)[1]
            if start >= 0 or end <= 0:
                continue
            if start < 0 and end > 0:
                at = _stationary(total, left, right)
        if at is not None:
            height = total.evaluate(at)
            if best is None or height.mid() < best[0].mid():
                best = height, at
            continue
        middle = _split(cell)
        stack += [(middle, right), (left, middle)]
    return best


def _require_positive_start(total: OscillatorSum) -> None:
    order = total.zero_order
    if not total.derivatives(arb(0), order + 1)[order] > 0:
        raise ValueError(f"f must be positive just after s = 0; derivative {order} there is not")


def cells(total: OscillatorSum, begin: float, end: float) -> list[tuple[float, float]]:
    """First cells, each about one radian of the fastest oscillator."""
    if not end > begin:
        raise ValueError(f"horizon must be positive; got {end}")
    count = int(min(1 + (end - begin) * total.fastest() / 2.5, 1000))
    inner = (begin + (end - begin) * (i + 0.0871) / count for i in range(1, count))
    return list(pairwise([begin, *inner, end]))


def _split(cell: Cell) -> float:
    """Where to split; beside a root at 0 near the scale on which f turns back."""
    middle = cell.left + SPLIT * (cell.right - cell.left)
    if cell.zero_order:
        first, second = cell.jet[cell.zero_order], cell.jet[cell.zero_order + 1]
        if second < 0:
            turn = float((-first / second).mid()) * (cell.zero_order + 1)
            middle = min(middle, SPLIT * turn)
    return middle


def _settle(total: OscillatorSum, cell: Cell) -> tuple[bool, Crossing | None]:
    """Decide a cell that starts with f > 0: (decided, first zero in it)."""
    slope, curvature = cell.sign(1), cell.sign(2)
    if slope > 0:
        return True, None
    if slope < 0 or curvature < 0:
        end = total.evaluate(arb(cell.right))
        if end > 0:
            return True, None
        if end < 0:
            return True, _refine(total, cell.left, arb(cell.right))
        if slope < 0:
            rate = total.derivatives(arb(cell.right), 2)[1]
            if rate < 0:
                return True, Crossing(cell.right - end / rate, crosses=True)
            return False, None
    if curvature > 0:
        if not (cell.jet[1] < 0 and total.derivatives(arb(cell.right), 2)[1] > 0):
            return False, None
        lowest = _stationary(total, cell.left, cell.right)
        height = total.evaluate(lowest)
        if height > 0:
            return True, None
        if height < 0:
            return True, _refine(total, cell.left, lowest.mid())
        return True, Crossing(lowest, crosses=False)
    return False, None


def _below(at: arb) -> float:
    """A double just below the root, so that f is positive up to it."""
    return float(at.lower()) * (1 - 2.0**-50)


def _radius(at: arb) -> arb:
    return abs(at) * RELATIVE_WIDTH


def _bisection_newton(function: OscillatorSum, order: int, low: arb, high: arb) -> arb:
    """Zero of derivative ``order`` in (low, high), where it changes sign: safeguarded Newton."""
    rising = function.derivatives(high, order + 1)[order] > 0
    # A root beside the one at 0 is about four times as far as where its cell begins: see `_split`.
    x = 4 * low if high > 16 * low > 0 else (low + high) / 2
    for _ in range(400):
        x = x.mid()
        here, slope = function.derivatives(x, order + 2)[order : order + 2]
        if (here > 0) == rising:
            high = x
        else:
            low = x
        step = (here / slope).mid() if slope != 0 else arb(0)
        following = (x - step).mid()
        if slope != 0 and abs(step) < _radius(x) / 4:
            return following
        x = following if slope != 0 and low < following < high else ((low + high) / 2).mid()
    raise ArithmeticError("Newton's iteration did not settle")


def _refine(total: OscillatorSum, left: float, right: arb) -> Crossing:
    """Enclose the one crossing between f(left) > 0 and f(right) < 0."""
    at = _bisection_newton(total, 0, arb(left), right)
    radius = _radius(at)
    for _ in range(5):
        if total.evaluate(at - radius) > 0 and total.evaluate(at + radius) < 0:
            return Crossing(arb(at, radius), crosses=True)
        # A tiny root beside the one at 0 is known to fewer digits of its own.
        radius *= 2**12
    return Crossing(arb(at, radius), crosses=False)


def _stationary(total: OscillatorSum, left: float, right: float) -> arb:
    """Enclose the one zero of f' between f'(left) < 0 and f'(right) > 0."""
    at = _bisection_newton(total, 1, arb(left), arb(right))
    radius = _radius(at)
    below = total.derivatives(at - radius, 2)[1]
    above = total.derivatives(at + radius, 2)[1]
    if not (below < 0 and above > 0):
        raise ArithmeticError("the minimum could not be enclosed")
    return arb(at, radius)


def _depth(total: OscillatorSum, root: arb, horizon: float) -> tuple[arb, arb]:
    """f at the first stationary point after the root, or at the horizon."""
    remaining = float((arb(horizon) - root).mid())
    if remaining > 0:
        found = find_root(total.derivative_from(root.mid(), factor=-1), remaining)
        if found is not None:
            at = root.mid() + found.at
            return total.evaluate(at), at
    return total.evaluate(arb(horizon)), arb(horizon)
