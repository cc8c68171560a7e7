"""Pseudo-arclength continuation of a curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from scipy.optimize import brentq

from dynkit.continuation.closure import passes, return_to
from dynkit.continuation.corrector import Failure
from dynkit.continuation.method import ContinuationMethod
from dynkit.continuation.orbit_equations import CurveEquations
from dynkit.continuation.points import Point, beside, interpolated, rescaled, slope
from dynkit.continuation.termination import Bound, Ending, Reason
from dynkit.core.kept import cached_property
from dynkit.core.progress import late_bar
from dynkit.core.validation import Array
from dynkit.orbits.newton import Direction, correct

# Largest angle between the tangents of successive points, in radians.
_LARGEST_ANGLE = 0.5
# Largest distance of a corrected point from its guess, as a fraction of the step.
_LARGEST_GAP = 0.3
# Largest distance of a corrected point from its guess, as a fraction of the `repetition`: a quarter
# of the repetition is half of the distance to the orbit of a shorter period.
_PART = 0.25
# Tolerances of `beside`, slack and most, for a point on a bound.
_BETWEEN = (1e-9, 0.0), 1.5
REPEATED = 1e-7
"""An orbit with a `repetition` below this, in scaled unknowns, is an orbit of a shorter period."""

# Inward component of the tangent of a point on a bound: up to this it may be rounding.
_LEVEL = 1e-6

_JUMPS = Failure(Reason.NO_CONVERGENCE, "its direction jumps")
_NEAR_REPETITION = Failure(Reason.NEAR_REPETITION, "steps lead to other orbits")
_NOT_ON_BOUND = Failure(Reason.NO_CONVERGENCE, "no point on the bound is found")
_CANNOT_TELL = Failure(Reason.NO_SOLUTION, "bifurcations within a step cannot be separated")


@final
@dataclass(frozen=True)
class Continuation:
    """A curve R(y) = 0 in one direction: iteration yields its points, the start first.

    The last item is the `Ending`. Iteration does not change the instance.

    Parameters
    ----------
    equations : CurveEquations
        There is one equation less than unknowns. No step leads to a repeated orbit of a shorter
        period, unless the start is one.
    start : Point
        A point of the curve; its tangent is the direction.
    bounds : tuple of Bound
        Bounds at which the curve ends; its last point is on the bound.
    method : ContinuationMethod
    accept : callable
        (point before, point) -> the examined point, and whether the step is short enough to
        separate the bifurcations within it.
    """

    equations: CurveEquations
    start: Point
    bounds: tuple[Bound, ...]
    method: ContinuationMethod
    accept: Callable[[Point, Point], tuple[Point, bool]]

    def __iter__(self) -> Iterator[Point | Ending]:
        point, before = self.start, None
        home = point.y
        place = self.equations.apart(home, home)
        yield point
        if (bound := self._outwards(point)) is not None:
            yield self._on(bound, point)
            return
        step, here = self._first_step(), self
        for count in range(1, self.method.points):
            advanced = here._advance(before, point, step)
            if isinstance(advanced, Ending):
                yield advanced
                return
            after, taken, reached = advanced
            here = here._at(after)
            place_before, place = place, here.equations.apart(after.y, home)
            if count > 2 and passes(place_before, place):
                closing = return_to(here.equations, here.corrected, home, point, after)
                if closing is not None:
                    yield self.accept(point, closing)[0]
                    yield Ending(Reason.CLOSED, Reason.CLOSED.value)
                    return
            yield after
            if reached is not None:
                yield self._on(reached, after)
                return
            step = self.method.steps.next(point, after, taken)
            before, point = point, after
        limit = f"{Reason.LIMIT.value}: {self.method.points}, at {self._place(point)}"
        yield Ending(Reason.LIMIT, limit)

    def shown(self) -> Iterator[Point | Ending]:
        """Yield the same items; a terminal shows the number of points and the last parameters."""
        with late_bar("branch", "point") as bar:
            for item in self:
                yield item
                if isinstance(item, Point):
                    bar.set_postfix_str(self._place(item), refresh=False)
                    bar.update()

    def _at(self, point: Point) -> Continuation:
        """Return the continuation with the equations near a point."""
        equations = self.equations.near(point.y)
        return self if equations is self.equations else replace(self, equations=equations)

    @cached_property
    def _repeated(self) -> bool:
        """Whether the start is a repeated orbit of a shorter period."""
        return self.equations.repetition(self.start.y) <= REPEATED

    def _first_step(self) -> float:
        size = np.inf if self._repeated else self.equations.repetition(self.start.y)
        return float(min(self.method.steps.first, size))

    def _place(self, point: Point) -> str:
        return ", ".join(f"{bound.name} {point.y[bound.unknown]:.10g}" for bound in self.bounds)

    def _outwards(self, point: Point) -> Bound | None:
        """Return the bound that the curve leaves at its start, if any."""
        for bound in self.bounds:
            value, slope = point.y[bound.unknown], point.tangent[bound.unknown]
            if (value <= bound.low and slope < 0.0) or (value >= bound.high and slope > 0.0):
                return bound
        return None

    @staticmethod
    def _on(bound: Bound, point: Point) -> Ending:
        value = point.y[bound.unknown]
        return Ending(bound.reason, f"{bound.reason.value}: {bound.name} {value:.6g}")

    def _advance(
        self, before: Point | None, point: Point, step: float
    ) -> tuple[Point, float, Bound | None] | Ending:
        """Return the next point, the step taken, and the bound that the point is on."""
        failure, steps = Failure(Reason.NO_CONVERGENCE, ""), self.method.steps
        while step > steps.smallest:
            after, reached = self._reached(before, point, step)
            if isinstance(after, Point):
                accepted, clear = self.accept(point, after)
                if clear:
                    return accepted, step, reached
                after = _CANNOT_TELL
            failure = after
            step = steps.shorter(step)
        reason, message = failure
        return Ending(reason, f"{reason.value}: at {self._place(point)}, {message}")

    def _reached(
        self, before: Point | None, point: Point, step: float
    ) -> tuple[Point | Failure, Bound | None]:
        """Return the point at a step, or the point on a bound that is reached before."""
        after = self.at(point, step, before)
        if isinstance(after, Failure):
            ahead = self._land_ahead(point, step) if after.reason is Reason.NO_SOLUTION else None
            return ahead or (after, None)
        bound = self._left(after)
        if bound is not None:
            return self._land(point, after, bound)
        return (_NOT_ON_BOUND if self._left_between(point, after) else after), None

    def at(self, point: Point, step: float, before: Point | None = None) -> Point | Failure:
        """Return the point at a step along the tangent, or why there is none.

        With the point before, the predictor is more accurate.
        """
        guess = self.method.predictor(point, before, step)
        found = self.corrected(guess, point, point.tangent)
        if isinstance(found, Failure):
            return found
        # the point is on another branch, or the curve bends too sharply within the step
        gap = (found.y - guess) / point.scale
        if not _ahead(point, found) or gap @ gap > (_LARGEST_GAP * step) ** 2:
            return _JUMPS
        return found if self._is_same(point, guess, found) else _NEAR_REPETITION

    def between(self, before: Point, after: Point, part: float) -> Point | Failure:
        """Return the point at a part, from 0 to 1, of the way between two, or why there is none.

        Its tangent is that of a Newton iterate near it. The guess is on the parabola through both
        points with the tangent of the first. The tangent of the second is not used: it may differ
        abruptly beyond a border.
        """
        way = (after.y - before.y) / before.scale
        step = part * float(np.sqrt(way @ way))
        straight = step * before.tangent
        guess = before.y + before.scale * (straight + part * (part * way - straight))
        near, scale = before.tangent, before.scale
        found = correct(self.equations, guess, scale, near, level=before.level)
        gap = (found.y - guess) / scale
        if found.converged and gap @ gap <= (_LARGEST_GAP * step) ** 2:
            direction = found.direction or Direction(near, before.turn)
            residual, steps = found.history[-1], len(found.history) - 1
            point = Point(found.y, scale, *direction, residual, steps, before.level)
            if self._is_same(before, guess, point):
                return point
        return self.at(before, step)

    def _is_same(self, before: Point, guess: Array, found: Point) -> bool:
        """Whether a point is so near its guess that no orbit of a shorter period lies between them.

        Cyclic shifts of the same orbit are at least as far from the guess, and are excluded, too.
        """
        if self._repeated:
            return True
        gap = (found.y - guess) / before.scale
        room = _PART * self.equations.repetition(before.y)
        return bool(gap @ gap <= room**2) and self.equations.repetition(found.y) > REPEATED

    def corrected(self, guess: Array, near: Point, row: Array) -> Point | Failure:
        """Return the point on the plane through the guess that is orthogonal to a row."""
        return self.method.corrector(self.equations, guess, near, row)

    def _corrected_at(
        self, unknown: int, value: float, guess: Array, near: Point
    ) -> Point | Failure:
        """Return the point where an unknown has a value; the guess is set to it in place."""
        guess[unknown] = value
        row = np.zeros(len(guess))
        row[unknown] = 1.0
        return self.corrected(guess, near, row)

    def _left(self, point: Point) -> Bound | None:
        for bound in self.bounds:
            if not bound.low <= point.y[bound.unknown] <= bound.high:
                return bound
        return None

    def _left_between(self, before: Point, after: Point) -> bool:
        """Whether the curve turns back beyond a bound between two points."""
        way = after.y - before.y
        length = float(np.linalg.norm(way / before.scale))
        for bound in self.bounds:
            i = bound.unknown
            a, b = (float(slope(end, way)[i]) for end in (before, after))
            if a * b < 0.0:
                turn = brentq(partial(_slope, a, b, way[i]), 0.0, 1.0)
                if not bound.low <= interpolated(before, after, turn)[i] <= bound.high:
                    there = self.at(before, turn * length)
                    return isinstance(there, Point) and self._left(there) is not None
        return False

    def _land(
        self, before: Point, after: Point, bound: Bound
    ) -> tuple[Point, Bound] | tuple[Failure, None]:
        """Return the point on a bound between two points, and the bound."""
        for _ in self.bounds:
            index = bound.unknown
            value = bound.low if after.y[index] < bound.low else bound.high
            part = (value - before.y[index]) / (after.y[index] - before.y[index])
            guess = interpolated(before, after, part)
            point = self._corrected_at(index, value, guess, before)
            if isinstance(point, Failure):
                return point, None
            if not beside(before, after, point.y, *_BETWEEN):
                break
            if not self._is_same(before, guess, point):
                return _NEAR_REPETITION, None
            inwards = point.tangent[index] * (1.0 if value == bound.low else -1.0)
            if inwards > _LEVEL:  # the curve has crossed the bound, and returned over a fold
                break
            left = self._left(point)
            if left is None:
                return point, bound
            after, bound = point, left
        return _NOT_ON_BOUND, None

    def _land_ahead(self, point: Point, step: float) -> tuple[Point, Bound] | None:
        """Return the next point on a bound, where the equations may not be defined beyond it."""
        way = step * point.tangent * point.scale
        for bound in self.bounds:
            index = bound.unknown
            value = bound.low if way[index] < 0.0 else bound.high
            if way[index] == 0.0 or not 0.0 < (value - point.y[index]) / way[index] <= 1.0:
                continue
            guess = point.y + way * ((value - point.y[index]) / way[index])
            found = self._corrected_at(index, value, guess, point)
            if isinstance(found, Failure) or self._left(found) is not None:
                continue
            if _ahead(point, found) and self._is_same(point, guess, found):
                return found, bound
        return None


def _slope(a: float, b: float, way: float, part: float) -> float:
    """Return the slope, at a fraction of the step, of the cubic with slopes a and b at its ends.

    `way` is the change of the cubic over the step.
    """
    return a + part * (2.0 * (3.0 * way - 2.0 * a - b) + 3.0 * part * (a + b - 2.0 * way))


def _ahead(before: Point, after: Point) -> bool:
    return bool(after.tangent @ rescaled(before, after.scale) >= np.cos(_LARGEST_ANGLE))
