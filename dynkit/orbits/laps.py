"""Periodic points of one-dimensional maps, from the laps of their iterates.

A lap is an interval on which an iterate is monotone. A lap of f^(k+1) is the part of a lap of f
whose images lie in one lap of f^k, so each of its ends is the solution of one monotone equation. A
lap on which f^n decreases has at most one point with f^n(x) = x, and the signs of f^n(x) - x at
both ends decide whether it exists. Where f^n increases, an interval [a, b] has no such point if
f^n(a) > b or f^n(b) < a, and at most one if the slope of f^n is above one throughout, or below one;
all other intervals are halved. That slope is bounded by those of f on the images of the interval,
whose ends are the images of a and b.

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
"""Cells of the grid for turning points: two turning points in one cell may be missed."""

# Solutions of one equation that are closer than this, relative to the interval, are not separated:
# between them the residual is below rounding.
_APART = 2.0**-26
# Least width of a cell relative to the interval: narrower cells contain a jump or a corner.
_NARROW = 2.0**-46
# A cell is halved if the change of f over it deviates from the trapezoidal rule for the slope by
# more than this, relative to the largest change that the slopes at its ends allow. The deviation is
# zero for a parabola, and of order one at a jump or a corner for any width of the cell.
_BENT = 0.1


class Lap(NamedTuple):
    """An interval [a, b] on which an iterate is monotone, and the images of its ends.

    `word` lists the laps of f, by number, that contain the successive iterates.
    """

    word: tuple[int, ...]
    a: float
    b: float
    image_a: float
    image_b: float


class _Node(NamedTuple):
    """A point x, its image under f^n, and the slope of f^n at x.

    `way` lists the iterates x, f(x), ..., n of them, each with the slope of f.
    """

    x: float
    f: float
    slope: float
    way: tuple[tuple[float, float], ...] = ()


@final
class Laps:
    """Laps of the iterates of a map on an interval.

    Parameters
    ----------
    calls : MapCalls
        Calls of a map of one dimension.
    low, high : float
        Limits of all states of the orbits.

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
            least, most = self._slopes(lap.word, a, b)
            if least >= 1.0 or most <= 1.0:
                at_a, at_b = a.f - a.x, b.f - b.x
                if at_a * at_b <= 0.0 or self._solved(a) or self._solved(b):
                    found.append(self._root(n, (a.x, at_a), (b.x, at_b)))
                continue
            middle = self._sloped(0.5 * (a.x + b.x), n)
            if b.x - a.x > slack:
                waiting += [(a, middle), (middle, b)]
            elif self._solved(middle):
                found.append(middle.x)
        return found

    def _slopes(self, word: tuple[int, ...], a: _Node, b: _Node) -> tuple[float, float]:
        """Return the least and the greatest slope, in magnitude, of f^n between two points.

        Both points are in one lap. The extremes of f's slope are those at the points and at the
        nodes of the grid between them.
        """
        least = most = 1.0
        turned = False
        for number, ends in zip(word, zip(a.way, b.way, strict=True), strict=True):
            (low, one), (high, other) = reversed(ends) if turned else ends
            lap, slack = self.first[number], self._slack
            if lap.a - slack <= low <= high + slack <= lap.b + 2.0 * slack:
                places, slopes = [low, high], [abs(one), abs(other)]
            else:  # a point is an end of the lap, and its computed image is beyond a jump
                places, slopes = [lap.a - slack, lap.b + slack], []
            slopes += self._steepness[slice(*np.searchsorted(self._places, places))].tolist()
            least, most = least * min(slopes), most * max(slopes)
            turned ^= lap.image_a > lap.image_b
        return least, most

    def _solved(self, node: _Node) -> bool:
        """Whether f^n(x) - x may be zero within the least width of a cell from the node."""
        return abs(node.f - node.x) <= self._narrow * (1.0 + abs(node.slope))

    def image(self, x: float, n: int) -> float:
        """Return f^n(x)."""
        state = np.array([x])
        for _ in range(n):
            state = self._calls.next(state)
        return float(state[0])

    def _sloped(self, x: float, n: int, image: float | None = None) -> _Node:
        state, slope, way = np.array([x]), 1.0, list[tuple[float, float]]()
        for _ in range(n):
            way.append((float(state[0]), float(self._calls.derivative(state)[0, 0])))
            slope *= way[-1][1]
            state = self._calls.next(state)
        # at the end of a lap the image is the one-sided limit
        return _Node(x, float(state[0]) if image is None else image, slope, tuple(way))

    def _root(self, n: int, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Return the zero of f^n(x) - x between a and b, or the end where it is nearly zero."""

        def excess(x: float) -> float:
            return a[1] if x == a[0] else b[1] if x == b[0] else self.image(x, n) - x

        if a[1] * b[1] > 0.0:
            return a[0] if abs(a[1]) < abs(b[1]) else b[0]
        return float(brentq(excess, a[0], b[0], xtol=self._rounding, rtol=2.0**-50))

    def _inverse(self, number: int, y: float) -> float:
        """Return the point x in a lap of f with f(x) = y."""
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
        """Return the intervals (a, b) on which f is monotone, with its values at both ends."""
        found: list[tuple[float, float, float, float]] = []
        pieces = list(self._pieces())
        nodes = [node for piece in pieces for node in piece]
        self._places = np.array([node.x for node in nodes])
        self._steepness = abs(np.array([node.slope for node in nodes]))
        for piece in pieces:
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
        """Yield nodes of each interval on which f is defined and smooth."""
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
        """Whether the change of f between two nodes differs from the integral of its slopes.

        It is also True if f is defined at one of the nodes only.
        """
        width = right.x - left.x
        if np.isnan(left.f) or np.isnan(right.f):
            return not (np.isnan(left.f) and np.isnan(right.f))
        change = 0.5 * width * (left.slope + right.slope)
        largest = width * max(abs(left.slope), abs(right.slope))
        size = max(abs(left.f), abs(right.f), abs(left.x), abs(right.x))
        # bound of the errors of both values
        noise = 4.0 * max(self._calls.system.accuracy, 2.0**-52) * size
        return not abs(right.f - left.f - change) <= _BENT * largest + noise

    def _turn(self, left: _Node, right: _Node) -> _Node:
        """Return the point between two nodes where the slope changes its sign."""
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
    """Return the laps of a map on the interval `box`, (2,), extended by its images.

    The interval is extended by the images of so many iterates, within the limit, (2,).
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
    """Yield n = 1, 2, ..., a point of each orbit of f^n, and the number of laps of f^n.

    The iteration ends when the calls are used up. Only one of all cyclic permutations of a word is
    searched, because the others contain other points of the same orbits.
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
