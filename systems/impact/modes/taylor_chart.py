"""Coordinates in which Taylor's method follows a structure, and its compiled integrators.

The seam between the event loop and a mode that is not linear is `Chart`: it puts positions and
velocities into coordinates, among them the gaps of stops and the slip velocities of friction, so
that nothing cancels near contact; it advances to the earliest guard; and it gives the Taylor
coefficients of a state and the derivative of the flow. Numbers are runtime parameters: another
value compiles nothing.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.no_motion import CannotFollow, Diverged
from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.structure.equations import Equations

_MOST_KEPT = 64
"""Compiled integrators that are kept."""

_LARGE = 60
"""From so many equations on heyoka's code is made compact, which compiles much faster."""

_CHUNK, _MOST = 1_000, 200_000
"""Steps of one call, and of one flight, of Taylor's method."""


@final
@dataclass(frozen=True)
class Plan:
    """What is compiled: everything but numbers.

    Attributes
    ----------
    equations : Equations
    kinds : tuple of int
        For each number whether it is 0, 1 or -1, which are compiled, or another one (2).
    stops, rubs : tuples of (int, int)
        Elements whose gaps, and whose slip velocities alone, are coordinates; and their places.
    held, sticking : tuples of int
        Elements that hold, and that stick.
    guards : tuple of int
        Element of each guard.
    elements : int
        Number of elements.
    """

    equations: Equations
    kinds: tuple[int, ...]
    stops: tuple[tuple[int, int], ...]
    rubs: tuple[tuple[int, int], ...]
    held: tuple[int, ...]
    sticking: tuple[int, ...]
    guards: tuple[int, ...]
    elements: int


def numbers_of(groups: Sequence[Array]) -> tuple[Array, tuple[int, ...]]:
    """All numbers as one array, and the kind of each."""
    flat = np.concatenate([np.asarray(group, dtype=float).ravel() for group in groups])
    kinds = np.full(len(flat), 2)
    for value in (0, 1, -1):
        kinds[flat == value] = value
    return flat, tuple(kinds.tolist())


@final
class _Leaves:
    """The numbers of a plan as heyoka's expressions, in the order of `numbers_of`."""

    def __init__(self, hy: Any, kinds: tuple[int, ...], first: int) -> None:
        self._hy, self._kinds, self._first, self._next = hy, kinds, first, 0

    def __call__(self, *shape: int) -> Any:
        """The next numbers, as an array of expressions of this shape."""
        count = math.prod(shape)
        places = range(self._next, self._next + count)
        self._next += count
        out = np.empty(count, dtype=object)
        for i, k in enumerate(places):
            kind = self._kinds[k]
            out[i] = float(kind) if kind != 2 else self._hy.par[self._first + k]
        return out.reshape(shape)


def _total(terms: Sequence[Any]) -> Any:
    """The sum of products, without those that are zero."""
    kept = [a * b for a, b in terms if not (_zero(a) or _zero(b))]
    out = kept[0] if kept else 0.0
    for term in kept[1:]:
        out = out + term
    return out


def _zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0


def _system(hy: Any, plan: Plan) -> tuple[list[Any], list[Any], list[Any]]:
    """The variables (2 N), their rates, and the guards, as heyoka's expressions."""
    from dynkit.systems.symbolic.taylor import series

    equations, n, e = plan.equations, plan.equations.size, plan.elements
    zx = [hy.expression(f"x{i}") for i in range(n)]
    zv = [hy.expression(f"v{i}") for i in range(n)]
    phase = hy.par[0] + hy.par[1] * hy.time
    rate = hy.par[1]
    sine, cosine = hy.sin(phase), hy.cos(phase)
    first = 2 + len(equations.numbers)
    leaves = _Leaves(hy, plan.kinds, first)
    forces = leaves(3, n)
    rows, own = leaves(e, n), leaves(e, 8)  # sign, phasor (2), offset, drift, push, k, c
    back_x, back_v = leaves(n, n), leaves(n, n)
    watches = leaves(len(plan.guards), 4)

    def swing(k: int, order: int) -> Any:
        """Displacement of an element, or its rate, or acceleration."""
        real, imaginary = own[k, 1], own[k, 2]
        if order == 1:
            return rate * _total([(real, cosine), (-1.0 * imaginary, sine)])
        still = _total([(real, sine), (imaginary, cosine)])
        return still if order == 0 else -1.0 * (rate * rate * still)

    shift_x, shift_v = list(zx), list(zv)
    for k, p in plan.stops:
        shift_x[p] = zx[p] + own[k, 0] * (own[k, 3] + swing(k, 0))
    for k, p in (*plan.stops, *plan.rubs):
        shift_v[p] = zv[p] + own[k, 0] * (own[k, 4] + swing(k, 1))
    x = [_total(list(zip(row, shift_x, strict=True))) for row in back_x]
    v = [_total(list(zip(row, shift_v, strict=True))) for row in back_v]
    places, speeds = dict(plan.stops), dict((*plan.stops, *plan.rubs))

    def gap(k: int) -> Any:
        if k in places:
            return zx[places[k]]
        along = _total(list(zip(rows[k], x, strict=True)))
        return own[k, 0] * (along - own[k, 3] - swing(k, 0))

    def slip(k: int) -> Any:
        if k in speeds:
            return zv[speeds[k]]
        along = _total(list(zip(rows[k], v, strict=True)))
        return own[k, 0] * (along - own[k, 4] - swing(k, 1))

    known = zip((*equations.x, *equations.v), (*x, *v), strict=True)
    symbols = dict(known) | {equations.phase: phase, equations.rate: rate}
    pars = (hy.par[2 + i] for i in range(len(equations.numbers)))
    symbols |= dict(zip(equations.numbers, pars, strict=True))
    f = series("the energies", equations.force, symbols)
    for i in range(n):
        f[i] = f[i] + _total([(forces[0, i], sine), (forces[1, i], cosine), (forces[2, i], 1.0)])
    for k in range(e):
        parts = [(1.0, own[k, 5])]
        parts += [(-1.0 * own[k, 6], gap(k))] if not _zero(own[k, 6]) else []
        parts += [(-1.0 * own[k, 7], slip(k))] if not _zero(own[k, 7]) else []
        push = _total(parts)
        if not _zero(push):
            f = [f[i] + _total([(own[k, 0] * rows[k, i], push)]) for i in range(n)]
    both = (*plan.held, *plan.sticking)
    moved = [swing(k, 2) for k in both]
    if equations.constant_mass:
        through, given = leaves(n, n), leaves(n, len(both))
        pull, stiff = leaves(len(both), n), leaves(len(both), len(both))
        a = [_total([*zip(through[i], f, strict=True), *zip(given[i], moved)]) for i in range(n)]
        press = [
            _total([*zip(pull[j], f, strict=True), *zip(stiff[j], moved)])
            for j in range(len(both))
        ]
    else:
        mass = series("the energies", [m for row in equations.mass for m in row], symbols)
        a, press = _constrained(np.array(mass, dtype=object).reshape(n, n), f, rows, both, moved)
    dx, dv = [], []
    at_x = {p: k for k, p in plan.stops}
    at_v = at_x | {p: k for k, p in plan.rubs}
    for i in range(n):
        if i in at_x:
            dx.append(hy.expression(0.0) if at_x[i] in plan.held else zv[i])
        else:
            dx.append(v[i])
        if i not in at_v:
            dv.append(a[i])
        elif at_v[i] in both:
            dv.append(hy.expression(0.0))
        else:
            k = at_v[i]
            along = _total(list(zip(rows[k], a, strict=True)))
            dv.append(own[k, 0] * (along - swing(k, 2)))
    guards = []
    for watch, k in zip(watches, plan.guards, strict=True):
        terms = [(1.0, watch[3])]
        terms += [(watch[0], gap(k))] if not _zero(watch[0]) else []
        terms += [(watch[1], slip(k))] if not _zero(watch[1]) else []
        if not _zero(watch[2]):
            terms.append((watch[2] * own[k, 0], press[both.index(k)]))
        guards.append(_total(terms))
    rates = [hy.expression(d) if isinstance(d, float) else d for d in (*dx, *dv)]
    return [*zx, *zv], rates, guards


def _constrained(
    mass: Any, f: list[Any], rows: Any, both: tuple[int, ...], moved: list[Any]
) -> tuple[list[Any], list[Any]]:
    """Accelerations, and forces along the rows of elements that hold: by elimination."""
    n, h = len(f), len(both)
    right = np.empty((n, 1 + h), dtype=object)
    right[:, 0] = f
    right[:, 1:] = rows[list(both)].T if h else np.empty((n, 0), dtype=object)
    solved = _solved(mass, right)
    a, press = list(solved[:, 0]), list[Any]()
    if h:
        inner, outer = np.empty((h, h), dtype=object), np.empty((h, 1), dtype=object)
        for j, k in enumerate(both):
            for i in range(h):
                inner[j, i] = _total(list(zip(rows[k], solved[:, 1 + i], strict=True)))
            outer[j, 0] = moved[j] - _total(list(zip(rows[k], a, strict=True)))
        press = list(_solved(inner, outer)[:, 0])
        for i in range(n):
            a[i] = a[i] + _total(list(zip(solved[i, 1:], press, strict=True)))
    return a, press


def _solved(matrix: Any, right: Any) -> Any:
    """Solution of a symmetric positive definite system of expressions, without pivoting."""
    a, b, n = matrix.copy(), right.copy(), len(matrix)
    for k in range(n):
        for i in range(k + 1, n):
            if _nil(a[i, k]):
                continue
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, n):
                a[i, j] = a[i, j] if _nil(a[k, j]) else a[i, j] - factor * a[k, j]
            for j in range(b.shape[1]):
                b[i, j] = b[i, j] if _nil(b[k, j]) else b[i, j] - factor * b[k, j]
    for k in reversed(range(n)):
        for j in range(b.shape[1]):
            left = b[k, j]
            for i in range(k + 1, n):
                if not (_nil(a[k, i]) or _nil(b[i, j])):
                    left = left - a[k, i] * b[i, j]
            b[k, j] = left if _nil(left) else left / a[k, k]
    return b


def _nil(value: Any) -> bool:
    return _zero(value) or str(value) in ("0", "0.0", "0.0000000000000000")


@lru_cache(_MOST_KEPT)
def _integrator(plan: Plan) -> Any:
    """heyoka's integrator of a plan, whose events are the guards."""
    from dynkit.systems.symbolic.taylor import heyoka

    hy = heyoka("a structure whose energies are not quadratic")
    variables, rates, guards = _system(hy, plan)
    down = hy.event_direction.negative
    return hy.taylor_adaptive(
        list(zip(variables, rates, strict=True)),
        [0.0] * len(variables),
        compact_mode=len(variables) > _LARGE,
        t_events=[hy.t_event(guard, direction=down, cooldown=0.0) for guard in guards],
    )


@lru_cache(_MOST_KEPT)
def _variations(plan: Plan) -> Any:
    """The same without events, with derivatives by the state and by the phase."""
    from dynkit.systems.symbolic.taylor import heyoka

    hy = heyoka("a structure whose energies are not quadratic")
    variables, rates, _ = _system(hy, plan)
    system = hy.var_ode_sys(
        list(zip(variables, rates, strict=True)), [*variables, hy.par[0]]
    )
    return hy.taylor_adaptive(
        system,
        [0.0] * len(variables),
        compact_mode=len(system.sys) > _LARGE,
    )


@final
class Chart:
    """One set of coordinates of a mode: positions and velocities, of which some are gaps or slips.

    Attributes
    ----------
    plan : Plan
    own : (stops and rubs, 8) numbers of the elements, see `TaylorMode.own`
    to_x, to_v, back_x, back_v : (N, N)
        From positions to coordinates and back, and for velocities.
    """

    def __init__(
        self, plan: Plan, pars: Array, own: Array, to: tuple[Array, Array], back: tuple[Array, Array]
    ) -> None:
        self.plan, self._pars, self._own = plan, pars, own
        self.to_x, self.to_v = to
        self.back_x, self.back_v = back
        self.places, self.speeds = dict(plan.stops), dict((*plan.stops, *plan.rubs))
        self._plain = bool((self.to_x == np.eye(len(self.to_x))).all()) and not plan.rubs

    @cached_property
    def integrator(self) -> Any:
        """An integrator of its own, with the numbers put in."""
        made = copy.copy(_integrator(self.plan))
        made.pars[:] = self._pars[: len(made.pars)]
        return made

    @cached_property
    def variations(self) -> Any:
        """An integrator of derivatives of its own, with the numbers put in."""
        made = copy.copy(_variations(self.plan))
        made.pars[:] = self._pars[: len(made.pars)]
        return made

    def shifts(self, sine: Any, cosine: Any) -> tuple[Any, Any]:
        """What the motion of elements adds to coordinates, (..., N) of positions and velocities."""
        shape = (*np.shape(sine), len(self.to_x))
        x, v = np.zeros(shape), np.zeros(shape)
        rate = self._pars[1]
        for k, p in self.plan.stops:
            sign, real, imaginary, offset = self._own[k, :4]
            x[..., p] = sign * (offset + real * sine + imaginary * cosine)
        for k, p in (*self.plan.stops, *self.plan.rubs):
            sign, real, imaginary, _, drift = self._own[k, :5]
            v[..., p] = sign * (drift + rate * (real * cosine - imaginary * sine))
        return x, v

    def coordinates(self, x: Array, v: Array, sine: float, cosine: float) -> Array:
        """Coordinates (2 N,) of positions and velocities (N,)."""
        more_x, more_v = self.shifts(sine, cosine)
        return np.concatenate([self.to_x @ x - more_x, self.to_v @ v - more_v])

    def motion(self, z: Array, sine: Any, cosine: Any) -> tuple[Array, Array]:
        """Positions and velocities (..., N) of coordinates (..., 2 N)."""
        n = len(self.to_x)
        more_x, more_v = self.shifts(sine, cosine)
        x, v = z[..., :n] + more_x, z[..., n:] + more_v
        if not self._plain:
            x, v = x @ self.back_x.T, v @ self.back_v.T
        return x, v

    def load(self, z: Array, sine: float, cosine: float) -> Any:
        """The integrator at coordinates (2 N,) and a phase."""
        made = self.integrator
        made.time, made.pars[0] = 0.0, math.atan2(sine, cosine)
        made.state[:] = z
        return made

    def fly(
        self,
        z: Array,
        sine: float,
        cosine: float,
        longest: float,
        pace: float = math.inf,
        early: Sequence[float] = (),
    ) -> tuple[int, float, int]:
        """Advance coordinates (2 N,), modified in place, to the first guard or a duration.

        Parameters
        ----------
        pace : float
            Limit of the steps, over the first step that Taylor's method takes by itself.
        early : ascending durations, shorter than the longest
            Steps end there. heyoka isolates roots that are not much shorter than a step.

        Returns
        -------
        guard, duration, steps
            Number of the guard, -1 where none is reached within the duration, and -2 where the
            steps are too many.

        Raises
        ------
        Diverged, CannotFollow
            When the motion runs away, or the steps collapse.
        """
        made, steps = self.load(z, sine, cosine), 0
        if pace < math.inf:
            pace *= abs(made.step()[1])
            self.load(z, sine, cosine)
        stations = [*early, longest]
        while True:
            outcome, _, _, count, *_ = made.propagate_until(
                stations[0], max_steps=_CHUNK, max_delta_t=pace
            )
            steps += count
            number = int(outcome)
            if number < 0 and number >= -len(self.plan.guards):
                z[:] = made.state
                return -1 - number, float(made.time), steps
            z_end, time = made.state, float(made.time)
            if number == _TIME_LIMIT:
                stations.pop(0)
                if stations:
                    continue
                z[:] = z_end
                return -1, time, steps
            if not np.isfinite(z_end).all() or number != _STEP_LIMIT:
                raise Diverged(f"the motion runs away within {time:.6g} from {z.tolist()}")
            if time < 1e-9 * steps * min(1.0, longest):
                raise CannotFollow(
                    f"the motion from {z.tolist()} cannot be followed: the steps of Taylor's "
                    f"method collapse to {time / steps:.1e}"
                )
            if steps >= _MOST:
                return -2, time, steps

    def coefficients(self, z: Array, sine: float, cosine: float) -> Array:
        """Taylor coefficients (2 N, order + 1) of the coordinates at a state."""
        made = self.load(z, sine, cosine)
        made.step(max_delta_t=0.0, write_tc=True)
        return np.array(made.tc)

    def path(self, z: Array, sine: float, cosine: float, longest: float) -> tuple[Array, Array]:
        """Begins (k + 1,) of steps, and their Taylor coefficients (k, 2 N, order + 1)."""
        made, begins, found = self.load(z, sine, cosine), [0.0], []
        while begins[-1] <= longest:
            outcome, _ = made.step(write_tc=True)
            found.append(np.array(made.tc))
            begins.append(float(made.time))
            if -len(self.plan.guards) <= int(outcome) < 0 or len(found) > _MOST:
                break  # what is left is rounding
            if int(outcome) != _SUCCESS:
                raise Diverged(f"the motion runs away within {made.time:.6g} from {z.tolist()}")
        return np.array(begins), np.array(found)

    def transition(
        self, z: Array, sine: float, cosine: float, duration: float
    ) -> tuple[Array, Array]:
        """Coordinates (2 N,) after a duration, and derivative (2 N, 2 N + 1) by state and phase."""
        made, m = self.variations, len(z)
        made.time, made.pars[0] = 0.0, math.atan2(sine, cosine)
        made.state[:m] = z
        made.state[m:] = np.eye(m, m + 1).ravel()
        outcome, *_ = made.propagate_until(duration)
        if int(outcome) != _TIME_LIMIT or not np.isfinite(made.state).all():
            raise Diverged(f"the motion runs away within {duration:.6g} from {z.tolist()}")
        return np.array(made.state[:m]), np.array(made.state[m:]).reshape(m, m + 1)


_SUCCESS, _STEP_LIMIT, _TIME_LIMIT = -4294967297, -4294967298, -4294967299
"""heyoka's ``taylor_outcome``: a step, the limit of steps, the end of the duration."""
