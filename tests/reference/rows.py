"""Rows of a state, and first roots of polynomials: in doubles where these decide, else exact."""

from __future__ import annotations

from math import comb
from typing import Any, Final

import numpy as np
from flint import arb, arb_poly

ZERO: Final = arb(10) ** -36
"""Of 60 digits: what is smaller is zero."""

DEGREE: Final = 36
_CUT: Final = 0.4871
"""Where an interval is halved: a root is not likely to be there."""

_DEEP: Final = 34


class Row:
    """A row of the state, exact and in doubles."""

    def __init__(self, row: Any) -> None:
        self.row = row
        self.numbers = [float(x) for x in row.entries()]


def _bernstein() -> Any:
    n = DEGREE
    return np.array([[comb(j, i) / comb(n, i) for i in range(n + 1)] for j in range(n + 1)])


def _parts() -> tuple[Any, Any]:
    """Bernstein coefficients on both parts of a cut interval, by those on the whole."""
    n, t = DEGREE, _CUT
    left, right = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    for j in range(n + 1):
        for i in range(j + 1):
            left[j, i] = comb(j, i) * t**i * (1 - t) ** (j - i)
            right[n - j, n - i] = comb(j, i) * (1 - t) ** i * t ** (j - i)
    return left, right


BERNSTEIN: Final = _bernstein()
_LEFT, _RIGHT = _parts()


def row_reaches(rows: Any, matrix: Any) -> tuple[Any, Any]:
    """Bernstein coefficients (m, DEGREE + 1, n) of rows (m, n) exp(matrix t), t up to 1; sizes."""
    terms, sizes = [rows], [abs(rows)]
    for k in range(1, DEGREE + 1):
        terms.append(terms[-1] @ matrix / k)
        sizes.append(sizes[-1] @ abs(matrix) / k)
    numbers = np.einsum("jk,kmn->mjn", BERNSTEIN, np.array(terms))
    # sizes of what is summed: all positive
    return numbers, np.einsum("jk,kmn->mjn", BERNSTEIN, abs(np.array(terms))) + 1e-300


def first_root(numbers: list[Any], end: Any) -> Any:
    """The first root in (0, end] of a polynomial that is positive just after 0; or None.

    Roots at 0 are divided out: so many leading coefficients are zero.
    """
    size = max(abs(float(c)) for c in numbers)
    lead = 0
    while lead < len(numbers) and abs(numbers[lead]) <= ZERO * max(size, 1.0):
        lead += 1
    rest = numbers[lead:]
    if not rest:
        return None
    if rest[0] < 0:
        raise ArithmeticError(f"negative at once: {float(rest[0])} of order {lead}")
    short = _short(rest)
    if short is not None and short < end:
        found = _within(rest, arb(0), short)
        if found is not None:
            return found
        return _within(rest, short, end)
    return _within(rest, arb(0), end)


def _short(rest: list[Any]) -> Any:
    """A time within which the first three terms have a root, much before the end; or None."""
    a, b, c = (float(x) for x in (*rest[:3], *[arb(0)] * 3)[:3])
    roots = [z.real for z in np.roots([c, b, a]) if abs(z.imag) < 1e-12 and z.real > 0.0]
    if roots and min(roots) < 1e-3:
        return arb(1.7 * min(roots))
    return None


def _within(rest: list[Any], low: Any, high: Any) -> Any:
    """The first root in an interval, at whose begin the polynomial is positive."""
    width = (high - low).mid()
    given = arb_poly(rest)
    scaled = given if low == 0 else given(arb_poly([low, arb(1)]))
    powers = np.zeros(DEGREE + 1)
    factor = arb(1)
    for k in range(min(len(rest), DEGREE + 1)):
        powers[k] = float(scaled[k] * factor)
        factor = (factor * width).mid()
    numbers = BERNSTEIN @ powers
    margin = 1e-12 * float(BERNSTEIN[-1] @ abs(powers))
    stack = [(numbers, 0.0, 1.0, 0)]
    slope = given.derivative()
    while stack:
        b, left, right, depth = stack.pop()
        if b.min() > margin:
            continue
        if b[0] > margin and b[-1] < -margin and _one_change(b, margin):
            t = left + (right - left) * _float_root(b)
            return _polished(given, slope, (low + width * arb(t)).mid())
        if depth == _DEEP or right - left < 1e-9:
            found = _nearly_double(given, slope, low + width * arb(left), low + width * arb(right))
            if found is not None:
                return found
            continue
        middle = left + _CUT * (right - left)
        stack.append((_RIGHT @ b, middle, right, depth + 1))
        stack.append((_LEFT @ b, left, middle, depth + 1))
    return None


def _one_change(b: Any, margin: float) -> bool:
    signs = np.sign(np.where(abs(b) <= margin, 0.0, b))
    first = int(np.argmax(signs < 0.0))
    return bool((signs[:first] >= 0.0).all() and (signs[first:] <= 0.0).all())


def _float_root(b: Any) -> float:
    low, high = 0.0, 1.0
    for _ in range(40):
        if b[0] <= 0.0 or b[-1] >= 0.0:
            break
        middle = low + _CUT * (high - low)
        left = _LEFT @ b
        if left[-1] < 0.0:
            b, high = left, middle
        else:
            b, low = _RIGHT @ b, middle
    return 0.5 * (low + high)


def _polished(given: Any, slope: Any, x: Any) -> Any:
    for _ in range(40):
        step = (given(x) / slope(x)).mid()
        x = (x - step).mid()
        if abs(step) <= abs(x) * arb(2) ** -170:
            return x
    raise ArithmeticError("Newton's method for a root does not end")


def _nearly_double(given: Any, slope: Any, left: Any, right: Any) -> Any:
    """The root in a short interval where doubles see none, or two, that are near each other."""
    low, high = given(left).mid(), given(right).mid()
    width = right - left
    if low > 0 > high:
        for _ in range(60):
            middle = ((left + right) / 2).mid()
            left, right = (middle, right) if given(middle).mid() > 0 else (left, middle)
        return _polished(given, slope, left)
    bend, t = slope.derivative(), ((left + right) / 2).mid()
    for _ in range(60):
        step = (slope(t) / bend(t)).mid()
        t = (t - step).mid()
        if abs(step) <= abs(t) * arb(2) ** -150:
            break
    if not left - width < t < right + width or bend(t) < 0:
        return None
    least = given(t).mid()
    if least > -ZERO:  # it may touch
        return None
    gap = ((-2 * least / bend(t)).mid()).sqrt().mid()
    return _polished(given, slope, (t - gap).mid())
