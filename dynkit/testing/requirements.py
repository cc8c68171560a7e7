"""Requirements used by the checks: each raises an AssertionError that names it."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias, TypeVar

import numpy as np

# the stub of the package names it among the public names
from dynkit.core.differences import numerical_derivative as numerical_derivative  # noqa: PLC0414
from dynkit.core.no_motion import NoDerivative, NoMotion, Refused, replaced
from dynkit.core.parameters import Family
from dynkit.core.validation import Array

FLOW_ACCURACY = 1e-7
"""Largest relative difference of states of flows, which may be integrated, that count as equal."""

VectorFunction: TypeAlias = Callable[[Array], Array]

_Family = TypeVar("_Family", bound=Family)


def check_name(check: Callable[..., None]) -> str:
    """Return the name of a check, for pytest's ids."""
    return check.__name__.replace("_", " ")


def require(condition: bool, what: str, detail: str) -> None:
    """Raise AssertionError with the requirement and the finding, unless the condition holds."""
    if not condition:
        raise AssertionError(f"{what}: {detail}")


def same_bits(a: Array, b: Array) -> bool:
    """Whether two arrays have the same shape and the same bits."""
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def require_shape(name: str, array: Array, shape: tuple[int, ...]) -> None:
    """Require finite floats of this shape."""
    found = np.asarray(array)
    require(found.shape == shape, f"{name} has shape {shape}", f"got {found.shape}")
    require(found.dtype == np.float64, f"{name} holds floats", f"got {found.dtype}")
    require(bool(np.isfinite(found).all()), f"{name} is finite", f"got {found}")


def require_close(name: str, found: Array, expected: Array, accuracy: float) -> None:
    """Require equality within the accuracy, relative to one plus the largest expected entry."""
    off = float(np.abs(found - expected).max(initial=0.0))
    allowed = accuracy * (1.0 + float(np.abs(expected).max(initial=0.0)))
    require(off <= allowed, name, f"got {found}, which is {off} away from {expected}")


def require_pure(name: str, function: VectorFunction, arguments: Array) -> None:
    """Require the same bits at every call, in a new array, and unchanged arguments."""
    for argument in arguments:
        given = argument.copy()
        first = function(given)
        kept = np.array(first)
        second = function(given)
        require(same_bits(given, argument), f"{name} leaves its argument", f"{given}")
        require(not np.shares_memory(first, given), f"{name} is a new array", "it is a view")
        same = same_bits(kept, np.asarray(first)) and same_bits(kept, np.asarray(second))
        require(same, f"{name} is pure", f"got {kept}, then {second}, at {argument}")


def require_refusal(name: str, function: VectorFunction, good: Array) -> None:
    """Require ValueError for NaN, infinity and a wrong shape."""
    for wrong in (np.nan, np.inf):
        bad = good.copy()
        bad[-1] = wrong
        refused = f"{name} refuses {wrong} with ValueError"
        require(_refused(function, bad), refused, "dynkit.core.validation.finite_array does so")
    longer = np.append(good, 0.0)
    require(_refused(function, longer), f"{name} refuses a wrong shape with ValueError", "no")


def _refused(function: VectorFunction, argument: Array) -> bool:
    try:
        function(argument)
    except ValueError:
        return True
    except Exception:  # of any other kind: the contract requires ValueError
        return False
    return False


def require_derivative(
    name: str,
    claimed: Array,
    function: VectorFunction,
    point: Array,
    *,
    difference: Callable[[Array, Array], Array] = np.subtract,
    accuracy: float = 2.0**-52,
    least: float = 0.0,
) -> None:
    """Require equality to differences, within twenty times their estimated error."""
    lost = f"{name} can be compared", f"differences do not converge at {point}"
    try:
        found, error = numerical_derivative(
            function, point, difference=difference, accuracy=accuracy, least=least
        )
    except (NoDerivative, Refused) as end:
        raise AssertionError(": ".join(lost)) from end
    require_shape(name, claimed, found.shape)
    size = float(np.abs(found).max(initial=0.0))
    require(float(error.max(initial=0.0)) <= 1e-3 * max(size, 1e-3), *lost)
    off = np.abs(claimed - found) - 20.0 * error
    worst = tuple(int(i) for i in np.unravel_index(np.argmax(off), off.shape))
    require(
        float(off[worst]) <= 1e-13 * size,
        f"{name} is the derivative",
        f"entry {worst} is {claimed[worst]}; differences at {point} give "
        f"{found[worst]} +- {error[worst]}",
    )


def inside_its_range(
    system: _Family, name: str, function: Callable[[_Family, Array], Array]
) -> _Family | None:
    """Return the system with a parameter inside its range, where differences can be computed.

    The value is unchanged if it is inside already. The result is None for an infinite parameter:
    its value means that the system has no such part.
    """
    value = system.parameters[name]
    if not np.isfinite(value):
        return None
    step = 0.01 * (abs(value) or 1.0)
    for there in (value, value + step, value - step):
        try:
            inside = replaced(system, **{name: there})
            for end in (there - 0.5 * step, there + 0.5 * step):
                function(inside, np.array([end]))
        except NoMotion:
            continue
        return inside
    raise AssertionError(f"{name} can be changed: it cannot, from {value}")


def require_parameter_derivatives(
    what: str,
    system: _Family,
    call: Callable[[_Family], Array],
    derivative: Callable[[_Family, str], Array],
    **options: Any,
) -> None:
    """Require that derivatives by the parameters equal differences of a call, inside their ranges.

    Options are those of `require_derivative`.
    """

    def moved(name: str, at: _Family, value: Array) -> Array:
        return call(replaced(at, **{name: float(value[0])}))

    for name in system.parameters:
        at = inside_its_range(system, name, partial(moved, name))
        if at is None:
            continue
        found, here = derivative(at, name), np.array([at.parameters[name]])
        require_shape(f"{what} by {name}", found, call(system).shape)
        call_at = partial(moved, name, at)
        require_derivative(f"{what} by {name}", found[:, None], call_at, here, **options)
