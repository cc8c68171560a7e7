"""Taylor's method by heyoka, compiled once per class, with the variational equations."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.no_motion import CannotFollow, Diverged
from dynkit.core.validation import Array
from dynkit.systems.flows.integration import Step
from dynkit.systems.symbolic.translation import Value, translate

if TYPE_CHECKING:
    import sympy

    from dynkit.systems.symbolic.family import Expressions

_MOST, _CHUNK = 10**7, 50_000
"""Largest number of steps, half a minute of work; it is estimated after every `_CHUNK` steps."""

_LARGE = 30
"""For more equations than this heyoka makes compact code, which compiles much faster."""

CODE: dict[str, Any] = {"opt_level": 3}
"""LLVM's optimisation level. At level 0 compilation takes a tenth of the time, the code twice."""

_BITS, _MOST_CLASSES = 20, 10
"""Step, in bits, between tolerances for small states, and largest number of such steps.

Steps are large so that few integrators are compiled.
"""

_SMOOTH = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sqrt", "erf"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
}


@cache
def heyoka(user: str = "SymbolicFlow") -> ModuleType:
    """Return the heyoka library without its warnings; `user` is the name in the error message.

    Raises
    ------
    ImportError
        When heyoka is not installed.
    """
    try:
        import heyoka as module
    except ImportError as missing:
        raise ImportError(
            f"{user} needs heyoka, which is not installed: pip install 'dynkit[flows]'"
        ) from missing
    module.set_logger_level_critical()  # it writes warnings to stdout
    found: ModuleType = module
    return found


@final
class Taylor:
    """Integrators of one class of flows: of states, and of states with their derivatives.

    Each integrator is compiled when a method first needs it. An integrator has one motion at a
    time, so every method takes the lock.
    """

    def __init__(self, name: str, expressions: Expressions) -> None:
        self._library: Any = heyoka()
        self._lock = RLock()
        self._dimension = len(expressions.coordinates)
        self._parameters = [self._library.par[i] for i in range(len(expressions.parameters))]
        names = [f"x{i}" for i in range(self._dimension)]
        self._variables = [self._library.expression(each) for each in names]
        symbols = zip(
            (*expressions.coordinates, *expressions.parameters),
            (*self._variables, *self._parameters),
            strict=True,
        )
        made = translate(name, expressions.values, dict(symbols), _Series(name, self._library))
        self._system = list(zip(self._variables, made, strict=True))
        used = set().union(*(value.free_symbols for value in expressions.values))
        self._occurring = {i for i, each in enumerate(expressions.parameters) if each in used}
        self._integrators: dict[tuple[int | None, int], Any] = {}

    def advance(self, parameters: Array, state: Array, duration: float) -> Array:
        """Return the state, (d,), after a duration."""
        with self._lock:
            integrator = self._at(None, parameters, state, self._size(parameters, state))
            self._run(integrator, state, duration)
            return np.array(integrator.state[: self._dimension])

    def transitions(
        self, parameters: Array, state: Array, duration: float, count: int
    ) -> tuple[Array, Array]:
        """Return the state after successive durations, and their derivatives, (count, d, d)."""
        d, identity = self._dimension, np.eye(self._dimension).ravel()
        derivatives = np.empty((count, d, d))
        with self._lock:
            integrator = self._at(-1, parameters, state, self._size(parameters, state))
            now = integrator.state
            for derivative in derivatives:
                integrator.time = 0.0
                now[d:] = identity
                self._run(integrator, now[:d].copy(), duration)
                derivative[:] = now[d:].reshape(d, d)
            return now[:d].copy(), derivatives

    def by_parameter(self, parameters: Array, state: Array, duration: float, place: int) -> Array:
        """Return the derivative, (d,), of the state after a duration by one of the parameters."""
        if place not in self._occurring:
            return np.zeros(self._dimension)
        with self._lock:
            integrator = self._at(place, parameters, state, self._size(parameters, state))
            integrator.state[self._dimension :] = 0.0
            self._run(integrator, state, duration)
            return np.array(integrator.state[self._dimension :])

    def steps(self, parameters: Array, state: Array, duration: float) -> Iterator[Step]:
        """Yield every step of the method, with the polynomials of its motion.

        Raises
        ------
        CannotFollow, Diverged
            As `advance`.
        """
        here, time, size = state, 0.0, self._size(parameters, state)
        for count in range(_MOST):
            left = duration - time
            with self._lock:
                integrator = self._at(None, parameters, here, size)
                outcome, step = integrator.step(max_delta_t=left, write_tc=True)
                end, coefficients = np.array(integrator.state), np.array(integrator.tc)
            if outcome == self._library.taylor_outcome.err_nf_state or not np.isfinite(end).all():
                raise Diverged(_lost(state, duration, time, "the motion runs away"))
            last = outcome == self._library.taylor_outcome.time_limit
            if count and count % _CHUNK == 0 and (why := _slow(count, duration, time)):
                raise CannotFollow(f"beyond time {time:.6g}: {why}")
            begin, time, here = time, duration if last else time + step, end
            yield TaylorStep(begin, time, end, coefficients)
            if last:
                return

    def _size(self, parameters: Array, state: Array) -> float:
        """Largest coordinate of a start; of one at zero, that a step later."""
        if state.any():
            return float(abs(state).max())
        with self._lock:
            integrator = self._at(None, parameters, state, 0.0)
            integrator.step()
            return float(abs(integrator.state).max())

    def _at(self, kind: int | None, parameters: Array, state: Array, size: float) -> Any:
        """Return an integrator, set to a state, with the tolerance for a motion of some size.

        `kind` is None for states, -1 for derivatives by states, or the number of a parameter for
        derivatives by this parameter.
        """
        digits = digits_of(size)
        if (kind, digits) not in self._integrators:
            hy, equations = self._library, self._system
            system: Any = equations
            if kind is not None:
                by = self._variables if kind < 0 else [self._parameters[kind]]
                system = hy.var_ode_sys(equations, by)
                equations = system.sys
            self._integrators[kind, digits] = hy.taylor_adaptive(
                system,
                [0.0] * self._dimension,
                tol=math.ldexp(1.0, -52 - digits),
                compact_mode=len(equations) > _LARGE,
                **CODE,
            )
        integrator = self._integrators[kind, digits]
        integrator.time = 0.0
        integrator.state[: self._dimension] = state
        integrator.pars[:] = parameters[: len(integrator.pars)]  # without unused last parameters
        return integrator

    def _run(self, integrator: Any, state: Array, duration: float) -> None:
        """Integrate for a duration; raise Diverged or CannotFollow if the motion ends before."""
        outcomes, count = self._library.taylor_outcome, 0
        while duration > 0.0:
            outcome, *_ = integrator.propagate_until(duration, max_steps=_CHUNK)
            time = float(integrator.time)
            if outcome == outcomes.err_nf_state:
                raise Diverged(_lost(state, duration, time, "the motion runs away"))
            if outcome == outcomes.time_limit:
                return
            count += _CHUNK
            if why := _slow(count, duration, time):
                raise CannotFollow(_lost(state, duration, time, why))


@final
class TaylorStep(Step):
    """A step whose motion is a polynomial with the accuracy of the step itself."""

    def __init__(self, begin: float, time: float, state: Array, coefficients: Array) -> None:
        self.begin, self.time, self.state = begin, time, state
        self.coefficients, self._powers = coefficients, np.arange(coefficients.shape[1])

    def path(self, time: float) -> Array:
        return self.cut_short(time - self.begin)

    def cut_short(self, duration: float) -> Array:
        return np.asarray(self.coefficients @ duration**self._powers)

    def reach(self, row: Array) -> float:
        terms = abs(row @ self.coefficients[:, 1:])
        return float(terms @ (self.time - self.begin) ** self._powers[1:])


def series(
    name: str, expressions: Sequence[sympy.Expr], symbols: Mapping[sympy.Symbol, Value]
) -> list[Any]:
    """Translate expressions into heyoka's expressions; `symbols` gives those of the symbols.

    Raises
    ------
    ValueError
        When an expression is not smooth.
    """
    return translate(name, expressions, symbols, _Series(name, heyoka()))


@final
class _Series:
    """heyoka's expressions, as an `Arithmetic`; functions that are not smooth raise an error."""

    def __init__(self, name: str, library: Any) -> None:
        self._name, self._library = name, library
        self.number = library.expression
        self.compare, self.choose = self._refused("comparison"), self._refused("choice")
        self.both = self.either = self._refused("logic")
        self.add, self.subtract = operator.add, operator.sub
        self.multiply, self.divide = operator.mul, operator.truediv

    def call(self, name: str, *arguments: Value) -> Value:
        if name == "pow":
            return arguments[0] ** arguments[1]
        if name not in _SMOOTH:
            self._refuse(name)
        return getattr(self._library, name)(*arguments)

    def _refused(self, what: str) -> Callable[..., Value]:
        def refuse(*_: Value) -> Value:
            self._refuse(what)

        return refuse

    def _refuse(self, what: str) -> None:
        raise ValueError(
            f"{self._name} must be smooth: Taylor's method has no {what}; IntegratedFlow takes any "
            "velocity"
        )


def digits_of(size: float) -> int:
    """Number of bits by which the tolerance is reduced for a motion of small size.

    heyoka's tolerance is relative to the largest variable if this is above one, else absolute.
    """
    if not 0.0 < size < 2.0**-5:
        return 0
    return _BITS * min(math.ceil((-math.log2(size) - 5.0) / _BITS), _MOST_CLASSES)


def _slow(count: int, duration: float, time: float) -> str:
    """Why the steps so far, up to a time, are too many; empty if they are not."""
    if count * duration <= _MOST * time:
        return ""
    return (
        f"the steps collapse to {time / count:.1e}, and more than {_MOST} would be needed: "
        "the flow is stiff (IntegratedFlow has an implicit method), or near a singularity"
    )


def _lost(state: Sequence[float] | Array, duration: float, time: float, why: str) -> str:
    start = np.asarray(state).tolist()
    return (
        f"the motion from {start} cannot be followed for {duration}: {why}, beyond time {time:.6g}"
    )
