"""Coordinates in which Taylor's method follows a structure, and its compiled integrators.

`Chart` is the interface between the event loop and a mode that is not linear. It converts positions
and velocities to coordinates, among them the gaps of stops and the slip velocities of friction, so
that nothing cancels near contact. It advances to the earliest guard, and it computes the Taylor
coefficients of a state and the derivative of the flow. Numbers are runtime parameters: other values
need no compilation.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, lru_cache, wraps
from threading import RLock, local
from typing import Any, final

import numpy as np

from dynkit.core.kept import cached_property, kept
from dynkit.core.no_motion import CannotFollow, Diverged
from dynkit.core.validation import Array
from dynkit.systems.impact.modes.taylor.equations import Plan, system_of
from dynkit.systems.impact.modes.taylor.scene import Scene
from dynkit.systems.impact.modes.taylor.signs import Signs

_MOST_KEPT = 64
"""Number of compiled integrators in each cache."""

_LARGE = 60
"""Number of equations above which heyoka's compact mode is used, which compiles much faster.

Variational equations with variable masses use it, too: for two masses they compile in 2 s instead
of 32 s, and run half as fast."""

_TOLERANCE = 2.4e-16
"""Tolerance that gives order 19, whose remainder is below rounding; heyoka's default, 8 percent
smaller, needs order 20. For variables below one the tolerance is absolute: see `Plan.digits`."""

_SHORTEST = 1e-3
"""Smallest limit of the step length, in radians of the phase."""

_FINER, _FINEST = 0.25, 0.01
"""Where an event was missed, the flight is repeated with steps shorter by this factor, down to
this part of the first step."""

_FINE = 1e-8, 1e-6, 1e-4, 1e-2
"""Parts of a period at which the first steps of a repeated flight end."""

_CHUNK, _MOST = 1_000, 200_000
"""Largest number of steps of Taylor's method in one call, and in one flight."""


def _heyoka() -> Any:
    from dynkit.systems.symbolic.taylor import heyoka

    return heyoka("a structure whose energies are not quadratic")


def _code() -> dict[str, Any]:
    from dynkit.systems.symbolic.taylor import CODE

    return CODE


@final
class _Compiled(local):
    """A compiled integrator. An integrator holds one motion, so each thread has a copy, `here`."""

    def __init__(self, integrator: Any) -> None:
        self.integrator = integrator

    @cached_property
    def here(self) -> Any:
        return copy.copy(self.integrator)


def _method(plan: Plan) -> dict[str, Any]:
    """Options of integrators: sums in any order; callers check that states are finite."""
    return {"tol": math.ldexp(_TOLERANCE, -plan.digits), "fast_math": True, **_code()}


@lru_cache(_MOST_KEPT)
def _integrator(plan: Plan) -> _Compiled:
    """Integrator of a plan; its terminal events are the zeros of the guards.

    Where a gap becomes positive, an impact was missed, or the gap was negative by rounding. To
    detect this costs nothing if both directions are one event, but only with two events, which a
    careful plan has, can the motion continue.
    """
    hy = _heyoka()
    variables, rates, guards = system_of(hy, plan)
    down, both, up = (getattr(hy.event_direction, name) for name in ("negative", "any", "positive"))
    ways = [both if i in plan.impacts else down for i in range(len(guards))]
    if plan.careful:
        ways = [down] * len(guards)
    events = [
        hy.t_event(guard, direction=way, cooldown=0.0)
        for guard, way in zip(guards, ways, strict=True)
    ]
    events += [hy.t_event(guards[i], direction=up) for i in plan.impacts if plan.careful]
    made = hy.taylor_adaptive(
        list(zip(variables, rates, strict=True)),
        [0.0] * len(variables),
        compact_mode=len(variables) > _LARGE,
        t_events=events,
        **_method(plan),
    )
    return _Compiled(made)


def _moved(hy: Any, plan: Plan, places: tuple[int, ...], given: list[Any]) -> tuple[Any, Any]:
    """Expressions with numbers that change in proportion to one parameter, and this parameter.

    The directions of change are the parameters after it.
    """
    part = hy.par[plan.size]
    moved = {hy.par[p]: hy.par[p] + part * hy.par[plan.size + 1 + k] for k, p in enumerate(places)}
    return hy.subs(given, moved) if given else [], part


@lru_cache(_MOST_KEPT)
def _variations(plan: Plan, places: tuple[int, ...] | None = None) -> _Compiled:
    """Integrator with derivatives by the state and the phase, or by a change of some numbers."""
    hy = _heyoka()
    variables, rates, _ = system_of(hy, plan)
    by = [*variables, hy.par[0]]
    if places is not None:
        rates, part = _moved(hy, plan, places, rates)
        by = [part]
    system = hy.var_ode_sys(list(zip(variables, rates, strict=True)), by)
    large = plan.eliminates or len(system.sys) > _LARGE
    options = {"compact_mode": large, **_method(plan)}
    return _Compiled(hy.taylor_adaptive(system, [0.0] * len(variables), **options))


@lru_cache(_MOST_KEPT)
def _gradients(plan: Plan, places: tuple[int, ...] | None, *, rates: bool) -> Any:
    """Compiled derivatives of the rates, or of the guards.

    They are taken by the coordinates and the phase, or by a change of some numbers.
    """
    hy = _heyoka()
    variables, *own = system_of(hy, plan)
    given = own[0 if rates else 1]
    by = [*variables, hy.par[0]]
    if places is not None:
        given, part = _moved(hy, plan, places, given)
        by = [part]
    found = [hy.diff(value, each) for value in given for each in by]
    return hy.cfunc(found, vars=variables, compact_mode=len(found) > _LARGE, **_code())


@cache
def _outcomes() -> tuple[int, int, int]:
    """Codes of heyoka for a full step, the limit of steps, and the end of the duration."""
    known = _heyoka().taylor_outcome
    return int(known.success), int(known.step_limit), int(known.time_limit)


def _propagate(made: Any, duration: float, z: Array) -> None:
    """Advance an integrator by a duration; error messages name the coordinates at the start."""
    outcome, *_ = made.propagate_until(duration)
    if int(outcome) != _outcomes()[2] or not np.isfinite(made.state).all():
        raise Diverged(f"the motion runs away within {duration:.6g} from {z.tolist()}")


def _alone(method: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a method of a chart to hold its lock, since an integrator has only one motion."""

    @wraps(method)
    def locked(self: Chart, *arguments: Any) -> Any:
        with self.lock:
            return method(self, *arguments)

    return locked


@final
class Chart:
    """One set of coordinates of a mode: positions and velocities, some replaced by gaps or slips.

    Positions (N + J,) include those of the J sliders. Coordinates z have two halves of N + J + K
    numbers, M in all. The first half holds N positions, the remaining stretch of each slider's
    spring until it yields, and K further numbers: the gaps along functions, and a zero for each
    friction whose slip velocity follows from other coordinates. The second half holds N velocities,
    the slip velocities of sliders, the rates of these gaps, and these slip velocities.

    Bare coordinates (2 N + J,) are N positions, the stretches of springs, and N velocities. For an
    element along a function, the slider's position, times minus the element's sign, replaces the
    stretch.

    Attributes
    ----------
    plan : Plan
    scene : Scene
    to_x, back_x : (N + J, N + J)
        From positions to bare coordinates and back.
    to_v, back_v : (N, N)
        The same for velocities.
    joints : (J, 2)
        For each slider, the side on which it is nearer to yielding, and the stretch at which it
        yields.
    events : tuple of int
        For each guard of the plan, the number of this guard in the mode.
    places, speeds : dict
        Places of gaps in the first half of the coordinates, and of their rates, or of other slip
        velocities, in the second half, by the numbers of elements.
    springs : dict
        Places of the springs of sliders in the first half, by the numbers of elements.
    watched : callable
        Values and rounding errors of guards of the mode, from their numbers and a motion.
    """

    def __init__(
        self,
        plan: Plan,
        scene: Scene,
        pars: Array,
        to: tuple[Array, Array],
        back: tuple[Array, Array],
        joints: Array,
        events: tuple[int, ...],
        watched: Callable[..., list[tuple[float, float]]],
    ) -> None:
        self.plan, self.scene, self._pars, self.watched = plan, scene, pars, watched
        self.to_x, self.to_v = to
        self.back_x, self.back_v = back
        self._size, self._joints, self._events = len(self.to_v), joints, events
        self._more = (*scene.parted, *plan.dragged)
        self._bent = [(k, i) for i, k in enumerate(plan.sliders) if k in scene.curves]
        more = {k: len(self.to_x) + i for i, k in enumerate(self._more)}
        self.springs = {k: self._size + i for i, k in enumerate(plan.sliders)}
        self.places = dict(plan.stops) | {k: more[k] for k in scene.parted}
        self.speeds = dict((*plan.stops, *plan.rubs)) | self.springs | more
        self.lock = RLock()
        self._limits: dict[str, Any] = {"max_steps": _CHUNK}
        if plan.careful:
            self._limits["write_tc"] = True
        self._plain = bool((self.to_x == np.eye(len(self.to_x))).all()) and not plan.rubs

    @cached_property
    def integrator(self) -> Any:
        """The integrator of this chart, with its numbers set."""
        made = copy.copy(_integrator(self.plan).integrator)
        made.pars[:] = self._pars[: len(made.pars)]
        size = 2 * (len(self.to_x) + len(self._more))
        self._z_of, self._turn_of, self._pars_of = *np.split(made.state, [size]), made.pars
        return made

    @cached_property
    def _unguarded(self) -> Plan:
        return self.plan.without_guards

    @cached_property
    def _eventless(self) -> _Compiled:
        return _integrator(self._unguarded)

    @kept
    def _varied(self, places: tuple[int, ...] | None) -> _Compiled:
        """Integrator with derivatives by the state and phase, or by a change of some numbers."""
        plan = self._unguarded if places is None else self._unguarded.where(places)
        return _variations(plan, places)

    def _begun(self, compiled: _Compiled, sine: float, cosine: float, *more: float) -> Any:
        """The thread's integrator at time zero, with the phase, the numbers and further numbers.

        The integrator may lack the last parameters, if its equations do not contain them.
        """
        made = compiled.here
        numbers = np.concatenate([self._pars[: self._unguarded.size], more])
        made.time, made.pars[:] = 0.0, numbers[: len(made.pars)]
        made.pars[:1] = math.atan2(sine, cosine)
        return made

    def shifts(self, sine: Any, cosine: Any, one: Any = 1.0) -> tuple[Any, Any]:
        """Difference between ``to_x @ x``, ``to_v @ v`` and bare positions and velocities.

        It is due to the motion of elements, (..., N + J) and (..., N), and linear in sine, cosine
        and one.
        """
        shape = np.shape(sine)
        x, v = np.zeros((*shape, len(self.to_x))), np.zeros((*shape, self._size))
        elements, w = self.scene.elements, self.scene.excitation.frequency
        for k, p in self.plan.stops:
            element = elements[k]
            x[..., p] = element.sign * (element.offset * one + element.swing(sine, cosine))
        for k, p in (*self.plan.stops, *self.plan.rubs):
            element = elements[k]
            v[..., p] = element.sign * (element.drift * one + element.swing_rate(w, sine, cosine))
        return x, v

    def coordinates(self, x: Array, v: Array, sine: float, cosine: float) -> Array:
        """Coordinates (M,) of positions (N + J,) and velocities (N,), or (N + J,)."""
        n = self._size
        more_x, more_v = self.shifts(sine, cosine)
        v = v[:n]
        parts = self.to_x @ x - more_x, self.to_v @ v - more_v
        if not self.plan.sliders and not self._more:
            return np.concatenate(parts)
        side, reach = self._joints.T
        gaps, rates, x = [], [], x[:n]
        parts[0][n:] = reach - side * (parts[0][n:] + self._along(x))
        for k in (*self.plan.sliders, *self._more):
            gap, rate = self.scene.gap(k, x, v, sine, cosine)
            gaps += [gap] if k in self.places else []
            gaps += [0.0] if k in self.plan.dragged else []
            rates.append(rate)
        return np.concatenate([parts[0], gaps, parts[1], rates])

    def _along(self, x: Array) -> Array:
        """Terms of the stretches (..., J) along functions that bare coordinates leave out."""
        out = np.zeros((*x.shape[:-1], len(self.plan.sliders)))
        for k, i in self._bent:
            out[..., i] = self.scene.elements[k].sign * self.scene.curves[k](x)
        return out

    def stretched(self, k: int, left: Array) -> Array:
        """Taylor coefficients (order + 1,) of a stretch, from those of the remaining stretch."""
        side, reach = self._joints[self.plan.sliders.index(k)]
        out = -side * left
        out[0] += side * reach
        return np.asarray(out)

    def kicked(self, x: Array, change: Array) -> Array:
        """Changes of the second half of the coordinates due to changes (N,) of velocities."""
        rows, elements = self.scene.rows_at(x), self.scene.elements
        carried = (*self.plan.sliders, *self._more)
        rates = [elements[k].sign * (rows[k] @ change) for k in carried]
        return np.concatenate([self.to_v @ change, rates])

    def bare(self, z: Array, sine: float, cosine: float) -> Array:
        """Bare coordinates (2 N + J,) from coordinates (M,)."""
        first, second = np.split(z, 2)
        first, (side, reach) = first[: len(self.to_x)].copy(), self._joints.T
        first[self._size :] = side * (reach - first[self._size :])
        if self._bent:
            first[self._size :] -= self._along(self.motion(z, sine, cosine)[0][: self._size])
        return np.concatenate([first, second[: self._size]])

    def motion(self, z: Array, sine: Any, cosine: Any, one: Any = 1.0) -> tuple[Array, Array]:
        """Positions (..., N + J) and velocities (..., N) from coordinates, which may be bare.

        If `one` is a series, all arguments are series of Taylor coefficients, of bare coordinates.
        """
        n, p = self._size, len(self.to_x)
        half = p if z.shape[-1] == n + p else z.shape[-1] // 2
        more_x, more_v = self.shifts(sine, cosine, one)
        x, v = z[..., :p] + more_x, z[..., half : half + n] + more_v
        if self.plan.sliders and z.shape[-1] != n + p:
            side, reach = self._joints.T
            x[..., n:] = side * (reach - x[..., n:])
        if not self._plain:
            x, v = x @ self.back_x.T, v @ self.back_v.T
        for k, i in self._bent if z.shape[-1] != n + p else ():
            x[..., n + i] += self.scene.curves[k](x[..., :n])
        return x, v

    def load(self, z: Array, sine: float, cosine: float) -> Any:
        """Set the integrator to coordinates (M,) and a phase, and return it."""
        made = self.integrator
        made.time = 0.0
        if self.plan.equations.turns:
            self._pars_of[:1] = math.atan2(sine, cosine)
        if len(self._turn_of):
            self._turn_of[:] = sine, cosine
        self._z_of[:] = z
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
        """Advance coordinates (M,), modified in place, to the first guard.

        The caller must hold `lock`. If no guard is reached within the duration, the coordinates do
        not change, and `reached` has those at the end. A flight in which heyoka missed an event is
        repeated with shorter steps.

        Parameters
        ----------
        pace : float
            Limit of the step length, divided by the first step that Taylor's method chooses.
        early : ascending durations, shorter than the longest
            A step ends at each of these, since heyoka fails to isolate roots much shorter than a
            step.

        Returns
        -------
        guard, duration, steps
            Number of the guard; -1 if none is reached within the duration; -2 after too many steps.

        Raises
        ------
        Diverged, CannotFollow
            When the motion runs away, or the step length becomes too small, also because events
            are missed.
        """
        made, steps, guards = self.load(z, sine, cosine), 0, len(self.plan.guards)
        _, step_limit, time_limit = _outcomes()
        limit, guarded = math.inf, self.plan.impacts
        if pace < math.inf:
            # the first step may be very short, as a guard may end it
            limit = max(pace * abs(made.step()[1]), _SHORTEST / self._pars[1])
            self.load(z, sine, cosine)
        stations = [*early, longest]
        limits = dict(self._limits)
        if self.scene.curves:  # steps along a free flight, a polynomial, have no limit of their own
            limit = min(limit, math.tau / self._pars[1])
        if limit < math.inf:
            limits["max_delta_t"] = limit
        while True:
            outcome, _, _, count, _, _ = made.propagate_until(stations[0], **limits)
            steps += count
            number = int(outcome)
            if number >= -guards:
                if guards and self._signs.amiss(z, sine, cosine, -1 - number):
                    return self._again(z, sine, cosine, longest, pace, early)
                z[:] = self._z_of
                return self._events[-1 - number], made.time, steps
            z_end, time = self._z_of, made.time
            if number == time_limit and len(stations) > 1:
                stations.pop(0)
                continue
            ended = number in (time_limit, step_limit) and guards
            if ended and self._signs.amiss(z, sine, cosine):
                return self._again(z, sine, cosine, longest, pace, early)
            if number == time_limit:
                return -1, time, steps
            if number >= -guards - len(guarded):
                if self._signs.rises(-1 - guards - number, z, sine, cosine):
                    return self._again(z, sine, cosine, longest, pace, early)
                if (steps := steps + 1) < _MOST:
                    continue
            elif not np.isfinite(z_end).all() or number != step_limit:
                raise Diverged(f"the motion runs away within {time:.6g} from {z.tolist()}")
            if time < 1e-9 * steps * min(1.0, longest):
                raise CannotFollow(
                    f"the motion from {z.tolist()} cannot be followed: the steps of Taylor's "
                    f"method collapse to {time / steps:.1e}"
                )
            if steps >= _MOST:
                return -2, time, steps

    # --- events that heyoka misses ----------------------------------------------------------------

    @cached_property
    def _signs(self) -> Signs:
        return Signs(self)

    @cached_property
    def _careful(self) -> Chart:
        """The same coordinates, with events of gaps that become positive."""
        ways = (self.to_x, self.to_v), (self.back_x, self.back_v)
        plan = replace(self.plan, careful=True)
        joints, events = self._joints, self._events
        return Chart(plan, self.scene, self._pars, *ways, joints, events, self.watched)

    def _again(
        self,
        z: Array,
        sine: float,
        cosine: float,
        longest: float,
        pace: float,
        early: Sequence[float],
    ) -> tuple[int, float, int]:
        """Repeat a flight in which an event may be missed: carefully, then with shorter steps."""
        if not self.plan.careful:
            found = self._careful.fly(z, sine, cosine, longest, pace, early)
            self._z_of[:] = self._careful._z_of
            return found
        if pace < _FINEST:
            raise CannotFollow(
                f"the motion from {z.tolist()} cannot be followed: an event is missed, also with "
                f"steps of {pace:.1e} times the length that Taylor's method chooses"
            )
        fine = {t for part in _FINE if (t := part * math.tau / self._pars[1]) < longest}
        finer = _FINER * min(pace, 1.0), sorted({*early, *fine})
        return self.fly(z, sine, cosine, longest, *finer)

    @property
    def reached(self) -> Array:
        """Coordinates (M,) at the end of the last flight."""
        return np.array(self._z_of)

    @_alone
    def coefficients(self, z: Array, sine: float, cosine: float) -> Array:
        """Taylor coefficients (M, order + 1) of the coordinates at a state."""
        made = self.load(z, sine, cosine)
        made.step(max_delta_t=0.0, write_tc=True)
        return np.array(made.tc[: len(z)])

    def path(self, z: Array, sine: float, cosine: float, longest: float) -> tuple[Array, Array]:
        """Begins (k + 1,) of steps, and Taylor coefficients (k, 2 N + J, order + 1) of bare z."""
        made, begins, found = self._begun(self._eventless, sine, cosine), [0.0], []
        made.state[:] = self.bare(z, sine, cosine)
        (success, _, time_limit), period = _outcomes(), math.tau / self._pars[1]
        while begins[-1] <= longest:
            outcome, _ = made.step(max_delta_t=period, write_tc=True)
            found.append(np.array(made.tc))
            begins.append(float(made.time))
            if len(found) > _MOST:
                raise CannotFollow(f"the motion from {z.tolist()} has too many steps")
            if int(outcome) not in (success, time_limit):
                raise Diverged(f"the motion runs away within {made.time:.6g} from {z.tolist()}")
        return np.array(begins), np.array(found)

    def transition(
        self, z: Array, sine: float, cosine: float, duration: float
    ) -> tuple[Array, Array]:
        """Bare coordinates (m,) after a duration, and their derivative (m, m + 1).

        It is the derivative by the bare coordinates and the phase at the start.
        """
        made, m = self._begun(self._varied(None), sine, cosine), len(self.to_x) + self._size
        made.state[:m] = self.bare(z, sine, cosine)
        made.state[m:] = np.eye(m, m + 1).ravel()
        _propagate(made, duration, z)
        return np.array(made.state[:m]), np.array(made.state[m:]).reshape(m, m + 1)

    def gradients(
        self, z: Array, sine: float, cosine: float, change: Array | None = None, *, rates: bool
    ) -> Array:
        """Derivatives of the rates (m,) of bare coordinates, or of the guards (k,).

        They are taken by these coordinates and the phase, (..., m + 1), or by a change of the
        numbers, (...,).
        """
        plan = replace(self.plan, carries=False)
        places, more = None, np.empty(0)
        if change is not None:
            places = tuple(np.flatnonzero(change).tolist())
            plan, more = plan.where(places), np.append(0.0, change[list(places)])
        made = _gradients(plan, places, rates=rates)
        pars = np.concatenate([self._pars, more])
        pars[0] = math.atan2(sine, cosine)
        bare = self.bare(z, sine, cosine)
        found = np.asarray(made(bare, pars=pars[: made.nparams], time=0.0))
        return found if change is not None else found.reshape(-1, len(bare) + 1)

    def changed(
        self, z: Array, sine: float, cosine: float, duration: float, change: Array
    ) -> Array:
        """Derivative of bare coordinates (m,) after a duration by a change of the numbers."""
        m = len(self.to_x) + self._size
        places = tuple(np.flatnonzero(change[: self._unguarded.size]).tolist())
        made = self._begun(self._varied(places), sine, cosine, 0.0, *change[list(places)])
        made.state[:m], made.state[m:] = self.bare(z, sine, cosine), 0.0
        _propagate(made, duration, z)
        return np.array(made.state[m:])
