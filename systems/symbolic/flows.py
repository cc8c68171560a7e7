"""Flows given by expressions, integrated by Taylor's method to machine precision."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from functools import cache, partial, wraps
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import CannotFollow, NoCrossing
from dynkit.core.smooth_map import stretched
from dynkit.core.stretching import Stretching
from dynkit.core.validation import (
    Array,
    non_negative,
    non_negative_integer,
    one_of,
    positive,
)
from dynkit.dynamics.flow import Crossing, Flow, Part
from dynkit.dynamics.hybrid_flow import HybridFlow
from dynkit.dynamics.section import Stroboscope
from dynkit.systems.flows.crossings import ON_SECTION, Search, checked_search
from dynkit.systems.symbolic.family import CodedFamily, Program, coordinate_names, program_of

if TYPE_CHECKING:
    from dynkit.dynamics.section import PoincareSection
    from dynkit.systems.symbolic.taylor import Taylor


_ROUNDING, _TURN = 2.0**-52, 2.0 * math.pi
# Number of disturbed motions for an error estimate; disturbance of each step, in rounding errors.
_TWINS, _ROUNDINGS = 3, 4.0
# Least size to which disturbances are relative. The truncation error of a step is a hundredth of a
# rounding error of the largest coordinate, or of one if all coordinates are smaller.
_LEAST = 2.0**-7
_QUARTERS = 4
# Numbers of parts of an interval, tried in turn; largest error of a logarithm; and the number of
# first intervals from which this error is judged.
_PARTS, _SURE, _PROBE = (1, 2, 4, 8, 16, 32, 64, 128), 1e-6, 16


class SymbolicFlow(CodedFamily, Flow):
    """A flow given by expressions: derivatives by SymPy, integration by heyoka's Taylor method.

    A subclass must implement ``velocity(self, x, y, ...)``, which takes one SymPy symbol for each
    coordinate and returns a tuple of their rates. The fields of the class, ``alpha: float = 9.0``,
    are its parameters: within the method ``self.alpha`` is a symbol, too. A driven flow has its
    phase, or its time, as the last coordinate. An argument named ``t`` is time; its rate need not
    be returned.

    First integrals are methods of the same coordinates that return one expression; the class
    variable `integrals` has their names. Called with a state, they return a number.

    The method is called once for a class, not for each value of a parameter. Its expressions must
    be smooth, without comparisons, Abs, Min, Max or step functions. `IntegratedFlow` takes any
    velocity. Called with a state, ``velocity(state)`` returns numbers.

    Steps are of order 20, with errors of the size of rounding. `accuracy` is an estimate of the
    error after tens of steps; `advance_error` estimates that of a given motion. Derivatives are
    those of the variational equations. Choose units in which the coordinates are of order one.
    Motions whose steps become too short, as in stiff flows and near singularities, raise
    `CannotFollow`; motions that diverge raise `Diverged`. ``IntegratedFlow(method="Radau")``
    integrates stiff flows.

    This class needs heyoka: ``pip install 'dynkit[flows]'``.

    Raises
    ------
    ValueError
        When a number is not finite. At the first integration, when ``velocity`` does not return a
        tuple of smooth expressions, one for each coordinate.
    TypeError
        At the first integration, when ``velocity`` compares symbols.
    ImportError
        At the first integration, when heyoka is not installed.

    References
    ----------
    F. Biscani, D. Izzo, Revisiting high-order Taylor methods for astrodynamics and celestial
    mechanics, Monthly Notices of the Royal Astronomical Society 504 (2021) 2614-2628.

    Examples
    --------
    >>> import sympy
    >>> class Pendulum(SymbolicFlow):
    ...     damping: float = 0.1
    ...
    ...     def velocity(self, angle, rate):
    ...         return rate, -sympy.sin(angle) - self.damping * rate
    >>> pendulum = Pendulum(damping=0.0)
    >>> pendulum.advance([1.0, 0.0], 10.0)
    array([-0.99894981, -0.04203338])
    >>> pendulum.advance_error([1.0, 0.0], 10.0) < 1e-13
    True

    The period of a swing, compared with its closed form:

    >>> from dynkit import Hyperplane, PoincareMap
    >>> from scipy.special import ellipk
    >>> swing = PoincareMap(pendulum, Hyperplane([0.0, 1.0], direction=-1), time_limit=100.0)
    >>> bool(abs(swing.return_time([1.0]) - 4.0 * ellipk(np.sin(0.5) ** 2)) < 1e-14)
    True
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        take_states(cls, ["velocity"])
        if not isinstance(cls.integrals, tuple):
            raise TypeError(f"integrals must be a tuple of names of methods; got {cls.integrals!r}")
        if isinstance(angles := vars(cls).get("angles"), tuple | list):
            raise TypeError(
                "angles must be given to the section or the ResetMap of a flow, as indices of its "
                f"coordinates; got {angles!r} in the class {cls.__name__}"
            )
        take_states(cls, cls.integrals, scalar=True)

    @property
    def accuracy(self) -> float:
        """Error of a crossing, relative to a state of order one: 128 rounding errors."""
        return 128.0 * _ROUNDING

    @final
    def velocity_jacobian(self, state: Array) -> Array:
        return self._tangent(self._program, state)

    @final
    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        return self._by_parameter(self._program, state, name)

    @final
    def integral_gradient(self, name: str, state: Array) -> Array:
        return self._scalar_gradient(one_of("integral", name, self.integrals), state)

    @final
    def integral_parameter_derivative(self, name: str, state: Array, parameter: str) -> float:
        program = self._method(one_of("integral", name, self.integrals), scalar=True)
        return float(self._by_parameter(program, state, parameter)[0])

    def _scalar_gradient(self, name: str, state: Array) -> Array:
        """Return the derivative, (d,), of the expression that a method returns."""
        code = self._method(name, scalar=True).tangent
        return self._filled(code, state, (self.dimension + 1,))[1:].copy()

    def _method(self, name: str, scalar: bool = False) -> Program:
        """Return the program of another method than the velocity, with the same coordinates."""
        program = program_of(self, name, scalar=scalar)
        found = tuple(symbol.name for symbol in program.expressions.coordinates)
        if found != self._coordinates:
            wanted = ", ".join(self._coordinates)
            raise TypeError(
                f"{program.name} must take the coordinates of velocity, {wanted}; "
                f"got {', '.join(found)}"
            )
        return program

    @final
    def advance(self, state: Array, duration: float) -> Array:
        """Return the state, (d,), a duration >= 0 after a state, (d,).

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or the duration is negative.
        Diverged
            When the motion diverges to infinity.
        CannotFollow
            When more than 10^7 steps are needed: the flow is stiff, or near a singularity.
        """
        length = non_negative("duration", duration)
        return self._taylor.advance(self._numbers, self._checked(state), length)

    @final
    def advance_error(self, state: Array, duration: float) -> float:
        """Return an estimate of the error of `advance`, from three disturbed motions.

        They are disturbed before every step by four rounding errors of the largest coordinate, or
        of 1/128 if this is larger, with random signs in every coordinate. The estimate is the
        largest distance of their ends from the end of `advance`.

        Raises
        ------
        ValueError, NoMotion
            As `advance`.
        """
        end, start = self.advance(state, duration), self._checked(state)
        worst = 0.0
        for seed in range(_TWINS if duration else 0):
            signs, twin, left = np.random.default_rng(seed), start, float(duration)
            while left > 0.0:
                size = _ROUNDINGS * _ROUNDING * max(float(abs(twin).max()), _LEAST)
                twin = twin + size * signs.choice((-1.0, 1.0), size=twin.size)
                step = next(self._taylor.steps(self._numbers, twin, left))
                twin, left = step.state, left - step.time
            worst = max(worst, float(np.linalg.norm(twin - end)))
        return worst

    def _disturbance(self, state: Array, sizes: Array) -> Array:  # noqa: ARG002
        return _ROUNDINGS * _ROUNDING * np.maximum(sizes, _LEAST * max(float(sizes.max()), 1.0))

    @final
    def derivative(self, state: Array, duration: float) -> Array:
        """Return the derivative, (d, d), of the advanced state with respect to the state.

        Raises
        ------
        ValueError, NoMotion
            As `advance`.
        """
        length = non_negative("duration", duration)
        _, derivatives = self._taylor.transitions(self._numbers, self._checked(state), length, 1)
        return derivatives.reshape(self.dimension, self.dimension)

    @final
    def parameter_derivative(self, state: Array, duration: float, name: str) -> Array:
        """Return the derivative, (d,), of the advanced state with respect to a parameter.

        Raises
        ------
        ValueError
            As `advance`; and when there is no such parameter.
        NoMotion
            As `advance`.
        """
        self.value_of(name)
        length, place = non_negative("duration", duration), list(self.parameters).index(name)
        return self._taylor.by_parameter(self._numbers, self._checked(state), length, place)

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        start, limit = checked_search(self, state, section, time_limit)
        if isinstance(section, Stroboscope) and self._is_clock:
            rate = float(self.velocity(start)[-1])
            if rate > 0.0:
                return self._flash(start, section, rate, limit)
        follow = partial(self._taylor.steps, self._numbers)
        return Search(self.velocity, section, follow).first(start, limit)

    @cached_property
    def _is_clock(self) -> bool:
        """Whether the rate of the last coordinate does not depend on the state."""
        return all(slope == 0 for slope in self._program.expressions.jacobian[-self.dimension :])

    def _flash(self, start: Array, section: Stroboscope, rate: float, limit: float) -> Crossing:
        """Return the next crossing of a stroboscope; the last coordinate has a constant rate."""
        to_come = -math.atan2(section.value(start), float(section.gradient(start)[-1])) % _TURN
        if to_come <= ON_SECTION * (1.0 + float(np.linalg.norm(start))):
            to_come += _TURN
        time = to_come / rate
        if time > limit:
            raise NoCrossing(f"no crossing within {limit}")
        try:
            return Crossing(time, self.advance(start, time))
        except CannotFollow as end:
            raise NoCrossing(f"no crossing within {limit}: {end}") from end

    def stretching(self, state: Array, interval: float, n: int) -> Stretching:
        count, duration = non_negative_integer("n", n), positive("interval", interval)
        start = self._checked(state)
        for parts in _PARTS:
            few = min(count, _PROBE)  # their errors show whether the parts are short enough
            found = self._stretched(start, duration, few, parts)
            if parts < _PARTS[-1] and found.errors.max(initial=0.0) > _SURE:
                continue
            if few < count:
                found = self._stretched(start, duration, count, parts)
            if found.errors.max(initial=0.0) <= _SURE:
                break
        return found

    def _stretched(self, state: Array, duration: float, count: int, parts: int) -> Stretching:
        """Return the stretching of a frame by intervals, each divided into parts."""
        d, step = self.dimension, duration / parts
        here, derivatives = self._taylor.transitions(self._numbers, state, step, count * parts)
        frame = np.eye(d)
        off = (self.accuracy * np.linalg.norm(derivatives, axis=(1, 2))).reshape(count, parts)
        steps = zip(derivatives.reshape(count, parts, d, d), off, strict=True)
        logs, errors = stretched(list(steps), frame)
        return Stretching(logs, errors, np.full(count, duration), here, frame)

    def _part(self, state: Array, duration: float) -> Part:
        """Return one part, computed by its quarters: so growth reversed within it is noticed."""
        step = duration / _QUARTERS
        here, growths = self._taylor.transitions(self._numbers, state, step, _QUARTERS)
        for i in reversed(range(_QUARTERS - 1)):
            growths[i] = growths[i + 1] @ growths[i]
        size = max(1.0, float(np.linalg.svd(growths, compute_uv=False).max()))
        return Part(here, growths[0], size, self.accuracy * size)

    @property
    def _coordinates(self) -> tuple[str, ...]:
        return coordinate_names(type(self).velocity)

    @cached_property
    def _program(self) -> Program:
        return program_of(self, "velocity")

    @cached_property
    def _taylor(self) -> Taylor:
        return _taylor_of(self._program)


def _of_symbols(function: Any) -> bool:
    """Whether a method is not abstract and takes symbols only."""
    made = hasattr(function, "_takes_states") or getattr(function, "__isabstractmethod__", False)
    return function is not None and not made


def take_states(cls: type, names: Iterable[str], scalar: bool = False) -> None:
    """Make methods of a class and of its bases accept one state, (d,), of numbers as well.

    A scalar method returns one expression; for a state it returns one number.
    """
    for name in names:
        function: Any = getattr(cls, name, None)
        if _of_symbols(function):
            setattr(cls, name, _of_states_too(name, function, scalar))


def _of_states_too(name: str, function: Callable[..., Any], scalar: bool) -> Callable[..., Any]:
    """Return a method that takes symbols, or one state, (d,), of numbers."""
    velocity, names = name == "velocity", list(inspect.signature(function).parameters)

    @wraps(function)
    def method(self: SymbolicFlow, *arguments: Any) -> Any:
        from sympy import Expr

        if len(arguments) != 1 or isinstance(arguments[0], Expr):
            found = function(self, *arguments)
            timed = velocity and names[-1] == "t" and isinstance(found, tuple)
            return (*found, 1) if timed and len(found) == len(arguments) - 1 else found
        program = self._program if velocity else self._method(name, scalar)
        found = self._filled(program.step, arguments[0], (1 if scalar else self.dimension,))
        return float(found[0]) if scalar else found

    method._takes_states = True  # type: ignore[attr-defined]
    return method


@cache
def _taylor_of(program: Program) -> Taylor:
    from dynkit.systems.symbolic.taylor import Taylor

    return Taylor(program.name, program.expressions)


class SymbolicHybridFlow(SymbolicFlow, HybridFlow):
    """A `SymbolicFlow` whose state jumps: guard and reset are expressions, too.

    Besides ``velocity`` a subclass must implement two methods of the same coordinates:

    1. ``guard(self, x, y, ...)`` returns one expression. The state jumps when it falls to zero, if
       it was positive before.
    2. ``reset(self, x, y, ...)`` returns the tuple of coordinates just after the jump.

    It may implement ``armed(self, x, y, ...)``, one expression: where it is not positive, the guard
    is ignored. The fields of the class are parameters of all methods. Called with a state, these
    methods return numbers. Derivatives are exact.

    ``ResetMap(flow, time_limit)`` is the map from one jump to the next, with orbits, multipliers,
    exponents, branches and labels.

    Raises
    ------
    ValueError, TypeError, ImportError
        As `SymbolicFlow`; and when a method does not take the coordinates of ``velocity``.

    Examples
    --------
    A neuron that fires when its potential is one. Each spike increases a fatigue, which decays
    between spikes: its multiplier is exp(-period / decay).

    >>> import numpy as np
    >>> from dynkit import ResetMap, periodic_orbit
    >>> class Neuron(SymbolicHybridFlow):
    ...     current: float = 1.5
    ...     decay: float = 2.0
    ...
    ...     def velocity(self, potential, fatigue):
    ...         return self.current - potential, -fatigue / self.decay
    ...
    ...     def guard(self, potential, fatigue):
    ...         return 1 - potential
    ...
    ...     def reset(self, potential, fatigue):
    ...         return 0, fatigue + 1
    >>> spikes = ResetMap(Neuron(), time_limit=100.0)
    >>> orbit = periodic_orbit(spikes, [0.0, 1.0])
    >>> bool(abs(spikes.return_time(orbit.states[0]) - np.log(3.0)) < 1e-14)
    True
    >>> bool(abs(orbit.multipliers[0] - 3.0 ** -0.5) < 1e-14)
    True
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        scalars = ["guard"] + ["armed"] * (cls.armed is not HybridFlow.armed)
        take_states(cls, scalars, scalar=True)
        take_states(cls, ["reset"])

    def guard_gradient(self, state: Array) -> Array:
        return self._scalar_gradient("guard", state)

    def guard_parameter_derivative(self, state: Array, name: str) -> float:
        return float(self._by_parameter(self._method("guard", scalar=True), state, name)[0])

    def reset_jacobian(self, state: Array) -> Array:
        return self._tangent(self._method("reset"), state)

    def reset_parameter_derivative(self, state: Array, name: str) -> Array:
        return self._by_parameter(self._method("reset"), state, name)
