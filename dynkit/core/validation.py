"""Checks of arguments, with one form of message: ``<name> must <limit>; got <value>``.

Booleans, strings and NaN are refused as numbers; NumPy's scalars are numbers.
"""

import math
import os
from collections.abc import Callable, Iterable
from functools import cache
from types import UnionType
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

_Scalar = TypeVar("_Scalar", bound=np.generic)

_DOUBLES = np.dtype(np.float64)

# A Python loop over this many numbers is faster than a call of NumPy.
_SHORT = 64

# Squares of larger numbers, and their sums, may overflow, those of its inverse underflow.
_LARGEST = 1e145

# Counts are kept in integers of 64 bits.
_COUNTS = 2**63

# A union that is written in a call is made in each of them, which takes longer than the check.
INTEGERS = int, np.integer
NUMBERS = (*INTEGERS, float, np.floating)
SCALARS = int, float, np.generic


def finite_scalar(name: str, value: object) -> float:
    """Return the value as a float when it is a single finite real number.

    Raises
    ------
    ValueError
        For booleans, strings, arrays, complex numbers, NaN and infinities.

    Examples
    --------
    >>> finite_scalar("offset", 2)
    2.0
    >>> finite_scalar("offset", "2")
    Traceback (most recent call last):
    ...
    ValueError: offset must be a finite number; got '2'
    """
    if isinstance(value, NUMBERS) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isfinite(number):
            return number
    raise _refusal(name, "be a finite number", value)


def positive(name: str, value: object) -> float:
    """Return the value as a float when it is finite and greater than zero.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> positive("frequency", 0)
    Traceback (most recent call last):
    ...
    ValueError: frequency must be positive; got 0
    """
    number = finite_scalar(name, value)
    if number <= 0.0:
        raise _refusal(name, "be positive", value)
    return number


def non_negative(name: str, value: object) -> float:
    """Return the value as a float when it is finite and not less than zero.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> non_negative("damping", -0.1)
    Traceback (most recent call last):
    ...
    ValueError: damping must not be negative; got -0.1
    """
    number = finite_scalar(name, value)
    if number < 0.0:
        raise _refusal(name, "not be negative", value)
    return number


def in_interval(name: str, value: object, low: float, high: float) -> float:
    """Return the value as a float when it lies in the closed interval [low, high].

    Raises
    ------
    ValueError
        When it does not.

    Examples
    --------
    >>> in_interval("restitution", 1.2, 0, 1)
    Traceback (most recent call last):
    ...
    ValueError: restitution must lie in [0, 1]; got 1.2
    """
    number = finite_scalar(name, value)
    if not low <= number <= high:
        raise _refusal(name, f"lie in [{low}, {high}]", value)
    return number


def positive_integer(name: str, value: object) -> int:
    """Return the value as an int when it is an integer greater than zero; 3.0 is not an integer.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> positive_integer("masses", 0)
    Traceback (most recent call last):
    ...
    ValueError: masses must be a positive integer; got 0
    """
    return _integer_from(1, name, "be a positive integer", value)


def non_negative_integer(name: str, value: object) -> int:
    """Return the value as an int when it is zero or a positive integer.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> non_negative_integer("transient", -5)
    Traceback (most recent call last):
    ...
    ValueError: transient must be zero or a positive integer; got -5
    """
    return _integer_from(0, name, "be zero or a positive integer", value)


def index_in(name: str, value: object, low: int, high: int) -> int:
    """Return the value as an int when it is an integer of the closed interval [low, high].

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> index_in("place", 1.5, 0, 4)
    Traceback (most recent call last):
    ...
    ValueError: place must be an integer; got 1.5
    """
    if not isinstance(value, INTEGERS) or isinstance(value, bool):
        raise _refusal(name, "be an integer", value)
    if not low <= value <= high:
        raise _refusal(name, f"lie in [{low}, {high}]", value)
    return int(value)


def boolean(name: str, value: object) -> bool:
    """Return the value as a bool when it is True or False; numbers and words are refused.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> boolean("follow", "no")
    Traceback (most recent call last):
    ...
    ValueError: follow must be True or False; got 'no'
    """
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise _refusal(name, "be True or False", value)


def of_type(name: str, value: object, kind: type | UnionType, what: str) -> None:
    """Refuse a value of another type than the one that is described.

    Raises
    ------
    ValueError

    Examples
    --------
    >>> of_type("angles", 0, tuple | list, "a sequence of indices")
    Traceback (most recent call last):
    ...
    ValueError: angles must be a sequence of indices; got 0
    """
    if not isinstance(value, kind):
        raise _refusal(name, f"be {what}", value)


def one_of(name: str, value: Any, known: Iterable[str]) -> str:
    """Return the value when it is one of the known names.

    Raises
    ------
    ValueError
        When it is not.

    Examples
    --------
    >>> one_of("norm", "largest", ("maximum", "euclidean"))
    Traceback (most recent call last):
    ...
    ValueError: norm must be one of: maximum, euclidean; got 'largest'
    """
    names = tuple(known)
    if not isinstance(value, str) or value not in names:
        limit = f"be one of: {', '.join(names)}" if names else "be a known name, and there is none"
        raise _refusal(name, limit, value)
    return str(value)


def within_memory(name: str, value: int, size: float) -> int:
    """Return a count after a check that its arrays fit into the memory of this machine.

    Parameters
    ----------
    name : str
    value : int
    size : float
        Least number of bytes that arrays of this count take.

    Raises
    ------
    ValueError
        When the machine has less memory; the error comes before any allocation.

    Examples
    --------
    >>> within_memory("impacts", 5, 240.0)
    5
    """
    memory = _memory()
    if size > memory:
        raise ValueError(
            f"{name} must fit into {memory / 2**30:.3g} GiB of memory; got {value}, which takes "
            f"{size / 2**30:.3g} GiB"
        )
    return value


@cache
def _memory() -> float:
    """Return the bytes of this machine's memory; infinity where they are not known."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return math.inf


def unmasked(name: str, value: object) -> None:
    """Refuse an array with masked elements: the numbers behind a mask are not data.

    Raises
    ------
    ValueError
        When an element is masked; the message names the first one.
    """
    mask = getattr(value, "mask", None) if isinstance(value, np.ma.MaskedArray) else None
    if mask is not None and np.any(mask):
        index = ", ".join(str(int(i)) for i in np.argwhere(mask)[0]) if np.ndim(mask) else ""
        raise ValueError(f"{name} must have no masked element; got one{index and f' at [{index}]'}")


def finite_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """Return the value as an array of finite floats of the given shape.

    Parameters
    ----------
    name : str
        The argument's name, as the user wrote it.
    value : array_like
        An array that already fits is returned without a copy.
    shape : tuple of int or None
        The required shape; None leaves that length free.

    Raises
    ------
    ValueError
        When the shape differs, the elements are not real numbers, or an element is not finite; the
        message names the first such element.

    Examples
    --------
    >>> finite_array("state", [0.0, float("nan")], (2,))
    Traceback (most recent call last):
    ...
    ValueError: state[1] must be a finite number; got nan
    >>> finite_array("state", [0.0, 1.0], (3,))
    Traceback (most recent call last):
    ...
    ValueError: state must have shape (3,); got shape (2,)
    """
    if (
        type(value) is np.ndarray
        and value.dtype is _DOUBLES
        and value.shape == shape
        and value.ndim == 1
        and value.size <= _SHORT
        and math.isfinite(sum(value.tolist()))
    ):
        return value  # already a short finite vector of this shape, such as a map's state
    unmasked(name, value)
    array = regular_array(name, value)
    if array.dtype.kind not in "iuf" and array.size:
        raise _refusal(name, "be an array of real numbers", value)
    array = np.asarray(array, dtype=np.float64)
    lengths = array.shape
    if len(lengths) != len(shape) or any(
        asked is not None and asked != found for asked, found in zip(shape, lengths, strict=True)
    ):
        if set(shape) == {None}:
            asked_for = f"{len(shape)} dimension{'s' * (len(shape) > 1)}"
        else:
            asked_for = "shape " + str(tuple("any" if n is None else n for n in shape))
            asked_for = asked_for.replace("'any'", "n") + ", for any n" * (None in shape)
        advice = f"; a single coordinate is {name}[:, None]" if _is_column(lengths, shape) else ""
        raise ValueError(f"{name} must have {asked_for}; got shape {lengths}{advice}")
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        place = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise _refusal(place, "be a finite number", float(array[index]))
    return array


def returned(owner: object, value: object, size: int, method: str = "") -> Array:
    """Return the result of a user's method as an array of floats, (size,), finite or not.

    The message names the owner's class, and the method as in ``".velocity"``.

    Raises
    ------
    ValueError
        When it is not an array of so many real numbers.
    """
    if type(value) is np.ndarray and value.dtype is _DOUBLES and value.shape == (size,):
        return value
    found = np.asarray(value)
    if found.shape != (size,) or found.dtype.kind not in "fiu":
        name = f"{type(owner).__name__}{method}"
        raise ValueError(f"{name} must return {size} real numbers, ({size},); got {value!r}")
    return np.asarray(found, dtype=np.float64)


def ascending(name: str, value: object) -> Array:
    """Return the value as a new array (n,) of finite, strictly ascending floats.

    Raises
    ------
    ValueError
        As `finite_array`; and when an element does not exceed the one before.

    Examples
    --------
    >>> ascending("times", [0.0, 1.0, 1.0])
    Traceback (most recent call last):
    ...
    ValueError: times[2] must exceed times[1]; got 1.0
    """
    array = finite_array(name, value, (None,)).copy()
    for i in np.flatnonzero(np.diff(array) <= 0.0)[:1].tolist():
        raise _refusal(f"{name}[{i + 1}]", f"exceed {name}[{i}]", array[i + 1])
    return array


def with_squares_in_range(name: str, array: Array) -> Array:
    """Return an array whose squares, and sums of them, neither overflow nor underflow.

    Raises
    ------
    ValueError
        When the largest number exceeds 1e145, or is below 1e-145 and not zero.

    Examples
    --------
    >>> with_squares_in_range("source", np.array([0.0, 1e-200]))
    Traceback (most recent call last):
    ...
    ValueError: source must be zero, or at least 1e-145 in size; got 1e-200
    """
    largest = float(abs(array).max(initial=0.0))
    if largest > _LARGEST:
        raise _refusal(name, f"not exceed {_LARGEST:g} in size", largest)
    if 0.0 < largest < 1.0 / _LARGEST:
        raise _refusal(name, f"be zero, or at least {1.0 / _LARGEST:g} in size", largest)
    return array


def read_only(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Make an array read-only in place, and return it."""
    array.setflags(write=False)
    return array


def check_fields(instance: object, **checks: Callable[[str, Any], Any]) -> None:
    """Replace fields of a frozen dataclass by the results of their checks.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Spring:
    ...     stiffness: float
    ...
    ...     def __post_init__(self):
    ...         check_fields(self, stiffness=positive)
    >>> Spring(2)
    Spring(stiffness=2.0)
    """
    for name, check in checks.items():
        object.__setattr__(instance, name, check(name, getattr(instance, name)))


def _is_column(lengths: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    """Whether a vector was passed where rows of numbers are required."""
    return len(lengths) == 1 and len(shape) == 2 and shape[0] is None and shape[1] in (None, 1)


def all_finite(numbers: Array) -> bool:
    """Whether all numbers of a real array are finite."""
    # the sum of finite numbers may overflow: then the full check decides
    few = numbers.size <= _SHORT and math.isfinite(sum(numbers.ravel().tolist()))
    return few or bool(np.isfinite(numbers).all())


def regular_array(name: str, value: object, numbers: str = "real") -> Any:
    """Return the value as an array of any shape and type.

    Raises
    ------
    ValueError
        When its rows have different lengths.
    """
    try:
        return np.asarray(value)
    except ValueError:
        raise _refusal(name, f"be an array of {numbers} numbers", value) from None


def _integer_from(least: int, name: str, limit: str, value: object) -> int:
    if isinstance(value, INTEGERS) and not isinstance(value, bool) and value >= least:
        if value >= _COUNTS:
            raise _refusal(name, "be below 2^63", value)
        return int(value)
    raise _refusal(name, limit, value)


def _refusal(name: str, limit: str, value: object) -> ValueError:
    # item() prints 0.5 where repr() would print np.float64(0.5)
    shown = value.item() if isinstance(value, np.generic) else value
    return ValueError(f"{name} must {limit}; got {shown!r}")
