"""Location of bifurcations within a step of a branch."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace

import numpy as np

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.bifurcations.kinds import KINDS, condition_of
from dynkit.continuation.corrector import Failure
from dynkit.continuation.crossings import Crossing, Located
from dynkit.continuation.defining_systems import (
    BifurcationEquations,
    CriticalMultiplier,
    null_vector,
)
from dynkit.continuation.points import Point, beside, interpolated
from dynkit.continuation.test_functions import are_real, crossings, examine, resonances, turns
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import WatchedProblem
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import correct, error_bound

# Largest number of divisions of a step.
_HALVINGS = 45
# Bisection ends when the distance of the two points is below this fraction of the point's error.
_OF_BLUR = 0.25
# Tolerances of `beside` for a solution between two points.
_WITHIN = (1e-6, 1e-9), 2.0
# Tolerances of `beside` that exclude both ends of the step. They apply in the first _DOUBTED
# divisions, because a solution at an end may be the bifurcation of the adjacent step.
_INSIDE, _DOUBTED = ((-1e-6, -1e-9), 2.0), 4
# Least abs(sin theta) of NS: below it the multipliers are nearly real.
_FLAT = 1e-3
# Largest error of a located bifurcation, relative to the range of the parameter.
_UNSURE = 1e-5
# A multiplier is on the unit circle, or an eigenvalue on the imaginary axis, if its distance is
# below this: double multipliers have large rounding errors.
_ON_BORDER = 1e-5
_PAIRS = (BifurcationKind.NS, BifurcationKind.HB)
# Fractions of a step at which it is divided, in the order of trial: near a chatter border an orbit
# may not be defined.
_PARTS = (0.5, 0.25, 0.75, 0.125)
# Largest distance of a multiplier from the critical value, at PD and at a bifurcation that is only
# bisected: near grazing the rounding errors of multipliers are large.
_NEAR = 0.01


def locate(
    problem: Problem, curve: Continuation, before: Point, after: Point, crossing: Crossing
) -> Located | None:
    """Return the bifurcation between two points; None when there is none after all.

    Newton's method is applied to its extended system. As long as it does not converge to a solution
    between the points, the step is divided. If it never converges, the result is the end of the
    last step, which is as short as rounding allows. NS, HB, RS and jumps then have no result.
    """
    began = time.perf_counter()
    steps = 0
    heights = [_height(before, crossing), _height(after, crossing)]
    size = max(height for height in heights if height < np.inf)
    together = after.seen.crossings.count(crossing)
    begin = _way(before, after)
    for halving in range(_HALVINGS):
        if halving % 8 == 0 if halving > 8 else _is_plain(before, after, crossing):
            known = after.seen.branch_point if crossing.kind is BifurcationKind.BP else None
            found = known or solved(problem, before, after, crossing, together)
            if found is not None and (
                halving >= _DOUBTED or known or beside(before, after, found.place, *_INSIDE)
            ):
                seconds = time.perf_counter() - began
                return found._replace(seconds=seconds, steps=steps + len(found.history) - 1)
        if halving % 4 == 0 and halving >= 8 and _is_blurred(curve, before, after):
            break
        middle = _examined_middle(problem, curve, before, after, crossing)
        if middle is None:
            break
        steps += middle.iterations
        if crossing in crossings(before, middle, curve.method.tests):
            after = middle
        elif crossing in crossings(middle, after, curve.method.tests):
            before = middle
        else:
            return None
    least = min(_height(before, crossing), _height(after, crossing))
    # the value of a zero falls with the length of the step, that of a jump does not
    left = _way(before, after) / begin
    if least > max(KINDS[crossing.kind].jump, left) * size:
        return None
    critical = KINDS[crossing.kind].critical.get(problem.stability)
    if crossing.kind in (*_PAIRS, BifurcationKind.RS) or (
        critical is not None and _distance(after, crossing.kind) > _NEAR
    ):
        return None
    errors = abs(after.y - before.y) + _blur(curve, after)
    x, p, none = after.y[:-1], after.y[-1:], np.empty(0)
    if critical is not None and np.any(problem.linearization_error(x, p)):
        errors[:] = np.inf  # errors of differences shift the bifurcation by an unknown distance
    return Located(
        crossing,
        x=x,
        own=none,
        p=p,
        errors=errors,
        multiplier=critical,
        direction=none if critical is None else null_vector(problem, x, p, critical),
        history=(after.residual,),
        seconds=time.perf_counter() - began,
        steps=steps,
        solved=False,
    )


def _way(before: Point, after: Point) -> float:
    """Return the distance of two points, in scaled unknowns."""
    return float(np.linalg.norm((after.y - before.y) / before.scale))


def _height(point: Point, crossing: Crossing) -> float:
    """Return the magnitude of the event's value; zero where the kind is not an event."""
    return abs(point.seen.events[crossing.event].value) if crossing.event >= 0 else 0.0


def _blur(curve: Continuation, point: Point) -> Array:
    """Return the errors, (m + 1,), of the unknowns and the parameter at a border.

    They follow from the error bound of the orbit on the border. The error of the parameter is at
    least the change that moves the unknowns along the branch by their error.
    """
    equations, scale = curve.equations, point.scale
    bound = error_bound(equations, equations.jacobian(point.y), point.y, scale, point.tangent)
    errors = np.asarray((bound / scale).max() * scale)
    way = float(np.linalg.norm(point.tangent[:-1]))
    if errors[-1]:
        errors[-1] *= max(1.0, abs(float(point.tangent[-1])) / way) if way else np.inf
    return errors


def _is_plain(before: Point, after: Point, crossing: Crossing) -> bool:
    """Whether Newton's method is tried at once; not for pairs that become real within the step."""
    return crossing.kind not in _PAIRS or before.seen.pairs == after.seen.pairs


def _is_blurred(curve: Continuation, before: Point, after: Point) -> bool:
    """Whether two points are nearer than `_OF_BLUR` times the error of the second."""
    return bool((abs(after.y - before.y) <= _OF_BLUR * _blur(curve, after)).all())


def _examined_middle(
    problem: Problem, curve: Continuation, before: Point, after: Point, crossing: Crossing
) -> Point | None:
    """Return an examined point at the first of `_PARTS` of the step at which an orbit is found.

    Where the crossing is an event, only the value of this event is computed at the point.
    """
    length = _way(before, after)
    for part in _PARTS:
        if crossing.event < 0:
            middle = curve.at(before, part * length)
        else:
            middle = curve.between(before, after, part)
        if not isinstance(middle, Failure):
            with suppress(NoMotion):
                if crossing.event < 0:
                    return replace(middle, seen=examine(problem, middle))
                assert isinstance(problem, WatchedProblem)
                events, own = list(before.seen.events), crossing.event
                events[own] = problem.event(own, middle.y[:-1], middle.y[-1:])
                return replace(middle, seen=replace(before.seen, events=tuple(events)))
    return None


def _on_the_border(problem: Problem, x: Array, p: Array) -> int:
    """Return the number of complex pairs on the border of stability."""
    values = np.asarray(problem.spectrum(x, p))
    near = problem.stability.from_border(values) < _ON_BORDER
    return int(np.count_nonzero(near & (values.imag > 0.0) & ~are_real(values)))


def _is_multiplier(problem: Problem, x: Array, p: Array, number: float) -> bool:
    """Whether a multiplier is within `_NEAR` of a number."""
    return bool((abs(np.asarray(problem.spectrum(x, p)) - number) < _NEAR).any())


def solved(
    problem: Problem, before: Point, after: Point, crossing: Crossing, together: int = 1
) -> Located | None:
    """Return the bifurcation that Newton's method finds between two points, if any.

    At NS and HB the number of pairs on the border of stability must be one, or the number
    `together` of the pairs that cross it within the step.
    """
    kind, event, _ = crossing
    guess = interpolated(before, after, _part(before, after, crossing))
    own = np.empty(0)
    if kind in _PAIRS:
        own = _angle(before, after)
        if not len(own):
            return None
    if kind is BifurcationKind.RS:
        own = np.ones(1)
    try:
        widths = before.scale[-1:]
        condition, own = condition_of(kind, event, problem, guess[:-1], own, guess[-1:], widths)
        equations = BifurcationEquations(problem, condition, widths)
        y = np.concatenate([guess[:-1], own, guess[-1:]])
        found = correct(equations, y, equations.scale(y), steps=15)
        place = np.append(found.y[: problem.size], found.y[-1])
        if not found.converged or not beside(before, after, place, *_WITHIN):
            return None
        x, own, p = equations.split(found.y)
        # the error bound uses null vectors and rounding errors at the solution
        condition, _ = condition_of(kind, event, problem, x, own, p, widths)
        equations.condition = condition
        scale, jacobian = equations.scale(found.y), equations.full_jacobian(found.y)
        bound = error_bound(equations, jacobian, found.y, scale, None)
    except (NoMotion, np.linalg.LinAlgError):
        return None
    if kind is BifurcationKind.NS and abs(np.sin(own[0])) < _FLAT:
        return None
    if kind is BifurcationKind.RS and abs(own[0] - 1.0) > _ON_BORDER:
        return None
    if equations.is_unfolded(found.y):
        return None
    # at grazing D(mu) is singular for numbers that are not multipliers
    if kind in _PAIRS and _on_the_border(problem, x, p) not in (1, together):
        return None
    if kind is BifurcationKind.PD and not _is_multiplier(problem, x, p, -1.0):
        return None
    if not bound[-1] < _UNSURE * before.scale[-1]:
        return None
    multiplier, direction = None, np.empty(0)
    if isinstance(condition, CriticalMultiplier):
        multiplier, direction = condition.multiplier(own), condition.direction(x, own, p)
    return Located(crossing, x, own, p, bound, multiplier, direction, found.history, 0.0, 0)


def _part(before: Point, after: Point, crossing: Crossing) -> float:
    """Return an estimate of the position of the bifurcation within the step, from 0 to 1."""
    if crossing.kind is BifurcationKind.SN:
        a, b = float(before.tangent[-1]), float(after.tangent[-1])
    elif crossing.kind is BifurcationKind.RS:
        (there, *_) = resonances(before.seen, after.seen)
        a, b = (turns(point.seen) - there for point in (before, after))
    elif crossing.event >= 0:
        a, b = (point.seen.events[crossing.event].value for point in (before, after))
    else:
        a, b = _distance(before, crossing.kind), -_distance(after, crossing.kind)
    if not np.isfinite(a) or not np.isfinite(b) or a == b:
        return 0.5
    return float(min(max(a / (a - b), 0.05), 0.95))


def _distance(point: Point, kind: BifurcationKind) -> float:
    """Return the distance of the multipliers or eigenvalues from the critical value."""
    spectrum, values = point.seen.kind, point.seen.spectrum
    if kind in _PAIRS:
        there = spectrum.from_border(values[~are_real(values)])
    else:
        there = spectrum.from_number(values, KINDS[kind].critical[spectrum])
    return float(there.min()) if len(there) else np.inf


def _angle(before: Point, after: Point) -> Array:
    """Return angle or frequency, (1,), of the complex pair nearest to the border, if any."""
    spectrum = before.seen.kind
    both = np.append(before.seen.spectrum, after.seen.spectrum)
    upper = both[(both.imag > 0.0) & ~are_real(both)]
    nearest = upper[np.argsort(spectrum.from_border(upper))][:1]
    return np.asarray(np.angle(nearest) if spectrum.periodic else nearest.imag)
