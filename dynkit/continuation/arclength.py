"""Pseudo-arclength continuation: the points of a curve, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from dynkit.continuation.orbit_equations import CurveEquations
from dynkit.continuation.termination import Bound, Ending, Reason
from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.orbits.newton import (
    Correction,
    Direction,
    NoSolution,
    Outcome,
    bordered_direction,
    correct,
)

# What a step aims at: so many Newton steps, and so many radians between tangents.
_NEWTON_STEPS, _ANGLE, _LARGEST_ANGLE = 3.0, 0.15, 0.5
# How far a point may be from its guess, in steps.
_LARGEST_GAP = 0.3
# And in parts of its orbit's distance from one of a shorter period: half of the way to that orbit,
# from which its two halves are as far apart again.
_PART = 0.25
# A point on a bound is between two points: see `beside`.
_BETWEEN = (1e-9, 0.0), 1.5
# So many times the place of the start within a step is looked for, and so far beyond its ends, in
# steps: a start at an end is on either side of it by rounding.
_RETURNS, _SLACK = 12, 1e-3
# A last Newton step so short, scaled, leaves the tangent as it is; how far a cubic is prolonged, in
# units of the last step.
_SHORT, _FURTHEST = 1e-8, 2.0
# Where a residual stops falling it is rounding, and need not be pushed lower from there on.
_LEAST_LEVEL, _LARGEST_LEVEL = 16.0 * 2.0**-52, 1e-12
# Distance, in scaled unknowns, within which two orbits are one.
SAME = 1e-6
REPEATED = 1e-7
"""Nearer than this to an orbit of a shorter period, in scaled unknowns, an orbit is that one."""


@final
@dataclass(frozen=True)
class Steps:
    """How a curve is followed: step sizes in scaled unknowns, and the number of points."""

    first: float = 0.01
    largest: float = 0.05
    smallest: float = 1e-9
    points: int = 2000


@final
@dataclass(slots=True)
class Point:
    """One corrected point of a curve.

    `tangent` is of unit length in scaled unknowns; `turn` is the sign of the determinant of the
    derivative with the tangent as last row; `seen` is whatever the follower's `watch` leaves there.
    """

    y: Array
    scale: Array
    tangent: Array
    turn: float
    residual: float
    iterations: int
    seen: Any = None

    def along(self, sign: float) -> Point:
        """Return it as the start of a curve, in one of the two directions: 1.0 or -1.0."""
        tangent, turn = sign * self.tangent, sign * self.turn
        return Point(self.y, self.scale, tangent, turn, self.residual, 0)


def cost_of(points: Sequence[Point], seconds: float) -> Cost:
    """Return what the points of a curve cost."""
    steps = sum(point.iterations for point in points)
    return Cost(seconds, {"points": len(points), "newton_steps": steps})


@final
@dataclass
class Follower:
    """Follows a curve R(y) = 0 in one direction; iterating yields its points, the start first.

    Parameters
    ----------
    equations : CurveEquations
        One equation less than unknowns. No step goes to an orbit that repeats one of a shorter
        period, unless the start is one.
    start : Point
        On the curve; its tangent is the direction.
    bounds : tuple of Bound
        What ends the curve; its last point is on the bound.
    steps : Steps
    watch : callable
        (point before, point) -> whether the step was short enough to tell what happened within.
    """

    equations: CurveEquations
    start: Point
    bounds: tuple[Bound, ...]
    steps: Steps
    watch: Callable[[Point, Point], bool]
    ending: Ending | None = None
    _level: float = _LEAST_LEVEL
    _failure: str = field(default="", repr=False)
    _reason: Reason = field(default=Reason.NO_CONVERGENCE, repr=False)
    _repeated: bool = field(default=False, repr=False)

    def __iter__(self) -> Iterator[Point]:
        point = self.start
        home = point.y
        place = self.equations.apart(home, home)
        before = None
        yield point
        if self._starts_outwards(point):
            return
        size = self.equations.repetition(point.y)
        self._repeated = size <= REPEATED
        step = min(self.steps.first, self.steps.largest, np.inf if self._repeated else size)
        for count in range(1, self.steps.points):
            found = self._advance(before, point, step)
            if found is None:
                return
            after, taken = found
            place_before, place = place, self.equations.apart(after.y, home)
            if count > 2 and self._passes(place_before, place):
                closing = self._return_to(home, point, after)
                if closing is not None:
                    self.watch(point, closing)
                    self.ending = Ending(Reason.CLOSED, Reason.CLOSED.value)
                    yield closing
                    return
            yield after
            if self.ending is not None:
                return
            step = self._next_step(point, after, taken)
            before, point = point, after
        limit = f"{Reason.LIMIT.value}: {self.steps.points}, at {self._place(point)}"
        self.ending = Ending(Reason.LIMIT, limit)

    def _place(self, point: Point) -> str:
        return ", ".join(f"{bound.name} {point.y[bound.unknown]:.10g}" for bound in self.bounds)

    def _starts_outwards(self, point: Point) -> bool:
        for bound in self.bounds:
            value, slope = point.y[bound.unknown], point.tangent[bound.unknown]
            if (value <= bound.low and slope < 0.0) or (value >= bound.high and slope > 0.0):
                self._end_at(bound, point)
                return True
        return False

    def _end_at(self, bound: Bound, point: Point) -> None:
        value = point.y[bound.unknown]
        self.ending = Ending(bound.reason, f"{bound.reason.value}: {bound.name} {value:.6g}")

    def _advance(
        self, before: Point | None, point: Point, step: float
    ) -> tuple[Point, float] | None:
        """Return the next point and the step taken."""
        while step > self.steps.smallest:
            after, reached = self.at(point, step, before), None
            if after is None and self._reason is Reason.NO_SOLUTION:
                after, reached = self._land_ahead(point, step)
            if reached is None and after is not None and (bound := self._left(after)) is not None:
                after, reached = self._land(point, after, bound)
            if after is not None:
                if self.watch(point, after):
                    if reached is not None:
                        self._end_at(reached, after)
                    return after, step
                self._failure = "it cannot be told what happens within a step"
                self._reason = Reason.NO_SOLUTION
            step *= 0.5
        reason = self._reason
        self.ending = Ending(reason, f"{reason.value}: at {self._place(point)}, {self._failure}")
        return None

    def at(self, point: Point, step: float, before: Point | None = None) -> Point | None:
        """Return the point a step along the tangent further on; None where there is none.

        The guess is better with the point before.
        """
        guess = point.y + step * point.tangent * point.scale
        if before is not None:
            way = (point.y - before.y) / point.scale
            part = step / max(float(np.sqrt(way @ way)), 1e-300)
            if part <= _FURTHEST:
                guess = interpolated(before, point, 1.0 + part)
        found = self.corrected(guess, point, point.tangent)
        if found is None:
            return None
        # another branch, or too sharp a bend to be sure
        gap = (found.y - guess) / point.scale
        if not _ahead(point, found) or gap @ gap > (_LARGEST_GAP * step) ** 2:
            self._failure, self._reason = "its direction jumps", Reason.NO_CONVERGENCE
            return None
        return found if self._is_same(point, guess, found) else None

    def _is_same(self, before: Point, guess: Array, found: Point) -> bool:
        """Whether a point is so near to its guess that no orbit of a shorter period is between.

        Nor is the same orbit from another of its states on: that is as far as two states are apart.
        """
        if self._repeated:
            return True
        gap = (found.y - guess) / before.scale
        room = _PART * self.equations.repetition(before.y)
        if gap @ gap <= room**2 and self.equations.repetition(found.y) > REPEATED:
            return True
        self._failure, self._reason = "steps lead to other orbits", Reason.NEAR_REPETITION
        return False

    def corrected(self, guess: Array, near: Point, row: Array) -> Point | None:
        """Return the point whose distance from the guess is orthogonal to a row."""
        solution = correct(self.equations, guess, near.scale, row, level=self._level)
        if not solution.converged:
            undefined = solution.outcome is Outcome.UNDEFINED
            self._reason = Reason.NO_SOLUTION if undefined else Reason.NO_CONVERGENCE
            self._failure = solution.message or solution.outcome.value
            return None
        residual = solution.history[-1]
        self._level = min(max(_LEAST_LEVEL, 2.0 * residual), _LARGEST_LEVEL)
        scale = near.scale
        wanted = self.equations.scale(solution.y)
        ratio = wanted / scale
        if ratio.max() > 2.0 or ratio.min() < 0.5:
            scale = wanted
        direction = self._direction(solution, near, row, scale)
        if direction is None:
            return None
        steps = len(solution.history) - 1
        return Point(solution.y, scale, *direction, residual, steps)

    def _corrected_at(self, unknown: int, value: float, guess: Array, near: Point) -> Point | None:
        """Return the point where an unknown has a value, which the guess gets, too."""
        guess[unknown] = value
        row = np.zeros(len(guess))
        row[unknown] = 1.0
        return self.corrected(guess, near, row)

    def _direction(
        self, solution: Correction, near: Point, row: Array, scale: Array
    ) -> Direction | None:
        # after a last step so short the derivative before it serves
        if row is near.tangent and scale is near.scale and solution.moved < _SHORT:
            return solution.direction
        try:
            jacobian = self.equations.jacobian(solution.y)
        except NoSolution as refusal:
            self._failure, self._reason = str(refusal), Reason.NO_SOLUTION
            return None
        direction = bordered_direction(jacobian, scale, _rescaled(near, scale))
        if direction is None:
            self._failure = "the curve has no direction there"
            self._reason = Reason.NO_CONVERGENCE
        return direction

    def _left(self, point: Point) -> Bound | None:
        for bound in self.bounds:
            if not bound.low <= point.y[bound.unknown] <= bound.high:
                return bound
        return None

    def _land(
        self, before: Point, after: Point, bound: Bound
    ) -> tuple[Point, Bound] | tuple[None, None]:
        """Return the point on a bound, between two points, and the bound."""
        for _ in self.bounds:
            index = bound.unknown
            value = bound.low if after.y[index] < bound.low else bound.high
            part = (value - before.y[index]) / (after.y[index] - before.y[index])
            guess = interpolated(before, after, part)
            point = self._corrected_at(index, value, guess, before)
            if point is None or not beside(before, after, point.y, *_BETWEEN):
                break
            if not self._is_same(before, guess, point):
                break
            left = self._left(point)
            if left is None:
                return point, bound
            after, bound = point, left
        return None, None

    def _land_ahead(self, point: Point, step: float) -> tuple[Point, Bound] | tuple[None, None]:
        """Return the point on a bound beyond which the equations may not be defined."""
        way = step * point.tangent * point.scale
        for bound in self.bounds:
            index = bound.unknown
            value = bound.low if way[index] < 0.0 else bound.high
            if way[index] == 0.0 or not 0.0 < (value - point.y[index]) / way[index] <= 1.0:
                continue
            guess = point.y + way * ((value - point.y[index]) / way[index])
            found = self._corrected_at(index, value, guess, point)
            if found is None or self._left(found) is not None or not _ahead(point, found):
                continue
            if self._is_same(point, guess, found):
                return found, bound
        return None, None

    def _next_step(self, before: Point, after: Point, taken: float) -> float:
        cosine = float(after.tangent @ _rescaled(before, after.scale))
        angle = float(np.arccos(min(cosine, 1.0)))
        by_newton = 2.0 ** ((_NEWTON_STEPS - after.iterations) / 2.0)
        by_angle = _ANGLE / max(angle, 1e-3)
        factor = float(min(max(min(by_newton, by_angle), 0.3), 2.0))
        return min(taken * factor, self.steps.largest)

    @staticmethod
    def _passes(before: Array, after: Array) -> bool:
        """Whether the way between two places, as seen from home, leads past home."""
        way = after - before
        length = way @ way
        if not length > 0.0:
            return False
        part = min(max(float(-before @ way / length), 0.0), 1.0)
        gap = before + part * way
        return bool(gap @ gap <= 0.09 * length)

    def _return_to(self, home: Array, point: Point, after: Point) -> Point | None:
        """Return the point between two that is the start again."""
        place, beyond = (self.equations.apart(end.y, home) for end in (point, after))
        for gap, end in ((place, point), (beyond, after)):
            if abs(gap).max() < SAME:
                return end
        row = (after.y - point.y) / point.scale
        row /= np.sqrt(row @ row)
        low, high = 0.0, 1.0
        for _ in range(_RETURNS):
            way = (beyond - place) / (high - low)
            part = low - float(place @ way) / max(float(way @ way), 1e-300)
            trial = None
            if -_SLACK < part < 1.0 + _SLACK:
                trial = self.corrected(interpolated(point, after, part), point, row)
            if trial is None:
                return None
            there = self.equations.apart(trial.y, home)
            if abs(there).max() < SAME:
                return trial
            # the farther end of the two is given up
            if place @ place > beyond @ beyond:
                low, place = part, there
            else:
                high, beyond = part, there
            if low == high:
                return None
        return None


def _rescaled(point: Point, scale: Array) -> Array:
    """Return a point's tangent in other units, of unit length."""
    if scale is point.scale:
        return point.tangent
    tangent = point.tangent * point.scale / scale
    return np.asarray(tangent / np.sqrt(tangent @ tangent))


def _ahead(before: Point, after: Point) -> bool:
    return bool(after.tangent @ _rescaled(before, after.scale) >= np.cos(_LARGEST_ANGLE))


def beside(before: Point, after: Point, y: Array, slack: tuple[float, float], most: float) -> bool:
    """Whether unknowns are between two points, and near the line between them.

    Parameters
    ----------
    before, after : Point
    y : array
    slack : (float, float)
        How far beyond the points they may be: parts of the distance and of its square root, squared
        scaled unknowns all.
    most : float
        How far from the first point they may be: squares, in squares of the distance.
    """
    way, gap = ((end - before.y) / before.scale for end in (after.y, y))
    length, along = float(way @ way), float(gap @ way)
    more = slack[0] * length + slack[1] * length**0.5
    return -more <= along <= length + more and float(gap @ gap) <= most * length


def interpolated(before: Point, after: Point, part: float) -> Array:
    """Return unknowns between two points, by the cubic through both with their tangents."""
    way = after.y - before.y
    length = float(np.sqrt(np.sum((way / before.scale) ** 2)))
    first, last = before.tangent * before.scale * length, after.tangent * after.scale * length
    s, r = part, 1.0 - part
    return np.asarray(before.y + way * s * s * (3.0 - 2.0 * s) + s * r * (r * first - s * last))
