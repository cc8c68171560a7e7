"""Periodic points of one-dimensional maps, from the laps of their iterates.

A lap is an interval on which an iterate is monotone. A lap of f^(k+1) is the part of a lap of f
whose images lie in one lap of f^k: so each end of it is the solution of one monotone equation. On a
lap where f^n falls there is at most one point with f^n(x) = x, which the signs of f^n(x) - x at
both ends decide. On a lap where it rises, an interval [a, b] has none if f^n(a) > b or f^n(b) < a,
and at most one if the slope of f^n is above one throughout, or below one; all others are halved.

J. Milnor, W. Thurston, On iterated maps of the interval, Lecture Notes in Mathematics 1342 (1988)
465-563 (laps).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple, final

import numpy as np
from scipy.optimize import brentq

from dynkit.core.validation import Array
from dynkit.orbits.map_calls import MapCalls, Spent

CELLS = 1024
"""Cells of the grid on which laps are looked for: two turning points in one cell may be missed."""

# Two solutions of one equation that are nearer than the root of a rounding have residuals that
# rounding does not tell from zero in between.
_APART = 2.0**-26
# Cells of this part of the interval are halved no further: the map jumps or has a corner there.
_NARROW = 2.0**-46
# The change of f over a cell may differ from the trapezoidal rule for its slope by this part of the
# largest change that the slopes allow; cells with more are halved. Of a parabola nothing is left
# out, of a jump or a corner a part of order one however narrow the cell.
_BENT = 0.1


class Lap(NamedTuple):
    """An interval [a, b], and the images of its ends under the iterate that is monotone on it.

    `word` are the numbers of the laps of f in which the first iterates lie.
    """

    word: tuple[int, ...]
    a: float
    b: float
    image_a: float
    image_b: float


class _Node(NamedTuple):
    x: float
    f: float
    slope: float


@final
class Laps:
    """Laps of the iterates of a map on an interval.

    Parameters
    ----------
    calls : MapCalls
        Of a map of one dimension.
    low, high : float
        All states of the orbits lie between them.

    Raises
    ------
    Spent
        From here and all methods: when there are no calls left.
    """

    def __init__(self, calls: MapCalls, low: float, high: float) -> None:
        self._calls = calls
        self.low, self.high = low, high
        self._slack = _APART * (high - low)
        self._narrow = _NARROW * (high - low)
        self._inverses: dict[tuple[int, float], float] = {}
        self.first = [Lap((i,), *ends) for i, ends in enumerate(self._monotone())]

    def longer(self, laps: list[Lap]) -> list[Lap]:
        """Return the laps of f^(k+1), from those of f^k."""
        found = []
        for (number,), a, b, image_a, image_b in self.first:
            bottom, top = min(image_a, image_b), max(image_a, image_b)
            ends = {image_a: a, image_b: b}
            for lap in laps:
                low, high = max(lap.a, bottom), min(lap.b, top)
                if not low < high:
                    continue
                places = []
                for y in (low, high):
                    known = {lap.a: lap.image_a, lap.b: lap.image_b}
                    image = known[y] if y in known else self.image(y, len(lap.word))
                    x = ends[y] if y in ends else self._inverse(number, y)
                    places.append((x, image))
                (x, image_x), (z, image_z) = sorted(places)
                found.append(Lap((number, *lap.word), x, z, image_x, image_z))
        return found

    def periodic_points(self, lap: Lap) -> list[float]:
        """Return the points of a lap of f^n with f^n(x) = x, to rounding."""
        n, slack = len(lap.word), self._slack
        at_a, at_b = lap.image_a - lap.a, lap.image_b - lap.b
        if lap.image_a >= lap.image_b:
            bracketed = at_a >= -slack and at_b <= slack
            return [self._root(n, (lap.a, at_a), (lap.b, at_b))] if bracketed else []
        found: list[float] = []
        waiting = [(self._sloped(lap.a, n, lap.image_a), self._sloped(lap.b, n, lap.image_b))]
        while waiting:
            a, b = waiting.pop()
            if a.f > b.x + slack or b.f < a.x - slack:
                continue
            middle = self._sloped(0.5 * (a.x + b.x), n)
            steep = [node.slope > 1.0 for node in (a, middle, b)]
            if all(steep) or not any(steep):
                at_a, at_b = a.f - a.x, b.f - b.x
                if at_a * at_b <= 0.0 or self._solved(a) or self._solved(b):
                    found.append(self._root(n, (a.x, at_a), (b.x, at_b)))
            elif b.x - a.x > slack:
                waiting += [(a, middle), (middle, b)]
            elif self._solved(middle):
                found.append(middle.x)
        return found

    def _solved(self, node: _Node) -> bool:
        """Whether f^n(x) - x may be zero in the cell, halved no further, that a lap ends with."""
        return abs(node.f - node.x) <= self._narrow * (1.0 + abs(node.slope))

    def image(self, x: float, n: int) -> float:
        """Return f^n(x)."""
        state = np.array([x])
        for _ in range(n):
            state = self._calls.next(state)
        return float(state[0])

    def _sloped(self, x: float, n: int, image: float | None = None) -> _Node:
        state, slope = np.array([x]), 1.0
        for _ in range(n):
            slope *= float(self._calls.derivative(state)[0, 0])
            state = self._calls.next(state)
        # at the end of a lap the image is that of its own side
        return _Node(x, float(state[0]) if image is None else image, slope)

    def _root(self, n: int, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Where f^n(x) - x, given at both ends, is zero, or the end where it nearly is."""

        def excess(x: float) -> float:
            return a[1] if x == a[0] else b[1] if x == b[0] else self.image(x, n) - x

        if a[1] * b[1] > 0.0:
            return a[0] if abs(a[1]) < abs(b[1]) else b[0]
        return float(brentq(excess, a[0], b[0], xtol=self._rounding, rtol=2.0**-50))

    def _inverse(self, number: int, y: float) -> float:
        """Return the place in a lap of f that f takes to y."""
        key = number, y
        if key not in self._inverses:
            _, a, b, image_a, image_b = self.first[number]

            def excess(x: float) -> float:
                return (image_a if x == a else image_b if x == b else self.image(x, 1)) - y

            x = brentq(excess, a, b, xtol=self._rounding, rtol=2.0**-50)
            self._inverses[key] = float(x)
        return self._inverses[key]

    @property
    def _rounding(self) -> float:
        return 2.0**-52 * max(abs(self.low), abs(self.high), self.high - self.low)

    # --- laps of the map itself -------------------------------------------------------------------

    def _monotone(self) -> list[tuple[float, float, float, float]]:
        """Intervals (a, b) on which f is monotone, with its values at both ends."""
        found: list[tuple[float, float, float, float]] = []
        for piece in self._pieces():
            start = sloping = piece[0]
            for node in piece[1:]:
                if sloping.slope * node.slope < 0.0:
                    turn = self._turn(sloping, node)
                    found.append((start.x, turn.x, start.f, turn.f))
                    start = turn
                if node.slope != 0.0:
                    sloping = node
            found.append((start.x, piece[-1].x, start.f, piece[-1].f))
        return [ends for ends in found if ends[0] < ends[1]]

    def _pieces(self) -> Iterator[list[_Node]]:
        """Nodes of intervals on which f is smooth, as far as it is defined."""
        nodes = [self._sloped(float(x), 1) for x in np.linspace(self.low, self.high, CELLS + 1)]
        piece = [nodes[0]]
        for node in nodes[1:]:
            waiting = [node]
            while waiting:
                left, right = piece[-1], waiting[-1]
                width = right.x - left.x
                if not self._bends(left, right):
                    piece.append(waiting.pop())
                elif width > self._narrow:
                    waiting.append(self._sloped(left.x + 0.5 * width, 1))
                else:
                    if not np.isnan(left.f):
                        yield piece
                    piece = [waiting.pop()]
        if not np.isnan(piece[-1].f):
            yield piece

    def _bends(self, left: _Node, right: _Node) -> bool:
        """Whether f between two nodes is not as its slopes there say."""
        width = right.x - left.x
        if np.isnan(left.f) or np.isnan(right.f):
            return not (np.isnan(left.f) and np.isnan(right.f))
        change = 0.5 * width * (left.slope + right.slope)
        largest = width * max(abs(left.slope), abs(right.slope))
        size = max(abs(left.f), abs(right.f), abs(left.x), abs(right.x))
        # both values are wrong by the accuracy, and by roundings
        noise = 4.0 * max(self._calls.system.accuracy, 2.0**-52) * size
        return not abs(right.f - left.f - change) <= _BENT * largest + noise

    def _turn(self, left: _Node, right: _Node) -> _Node:
        """The place between two nodes where the slope changes its sign."""
        while True:
            middle = 0.5 * (left.x + right.x)
            if not left.x < middle < right.x:
                return left if abs(left.slope) <= abs(right.slope) else right
            node = self._sloped(middle, 1)
            if node.slope == 0.0:
                return node
            if node.slope * left.slope > 0.0:
                left = node
            else:
                right = node


def reached(calls: MapCalls, box: Array, iterates: int, limit: Array) -> Laps:
    """Return the laps of a map on an interval, (2,), with all that so many iterates reach from it.

    As far as that lies within the limit, (2,).
    """
    low, high = box.tolist()
    for _ in range(iterates + 1):
        laps = Laps(calls, low, high)
        images = [image for lap in laps.first for image in lap[-2:]]
        before = low, high
        low = max(min([low, *images]), float(limit[0]))
        high = min(max([high, *images]), float(limit[1]))
        if max(before[0] - low, high - before[1]) <= 4.0 * laps._rounding:
            return laps
    return laps


def periodic_points(laps: Laps, period: int) -> Iterator[tuple[int, list[float], int]]:
    """Yield n = 1, 2, ..., a point of each orbit of f^n, and its laps, as far as calls reach.

    Of words that are turned into one another, one: each has another point of the same orbits.
    """
    found = laps.first
    for n in range(1, period + 1):
        try:
            if n > 1:
                found = laps.longer(found)
            turned = partial(_least_turn, n)
            points = [x for lap in found if turned(lap.word) for x in laps.periodic_points(lap)]
        except Spent:
            return
        yield n, points, len(found)


def _least_turn(n: int, word: tuple[int, ...]) -> bool:
    return all(word <= word[i:] + word[:i] for i in range(1, n))
