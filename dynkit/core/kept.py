"""Results of methods that are kept because they are needed repeatedly, and copies of objects."""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np

_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")

_NONE: Any = object()
"""What stands for no result."""

ANY_CACHED = functools.cached_property
"""The class of all cached properties, also of those of users' classes."""

if TYPE_CHECKING:  # a subclass is no property to them
    cached_property = functools.cached_property
else:

    class cached_property(functools.cached_property):
        """The property of `functools` without a lock: that of Python 3.11 is shared by all objects.

        Threads compute it at the same time for different objects. For one object, all of them get
        what the first one of them has computed.
        """

        def __get__(self, instance, owner=None):
            if instance is None:
                return self
            return vars(instance).setdefault(self.attrname, self.func(instance))


def copied(one: _Found, **changes: Any) -> _Found:
    """Return a shallow copy of an object without slots, with changes of attributes.

    `copy.copy` takes eight times as long, and `dataclasses.replace` more. Nothing is validated, and
    results that the object has kept are those of the copy, too.
    """
    out = object.__new__(type(one))
    vars(out).update(vars(one), **changes)
    return out


def kept(
    method: Callable[Concatenate[Any, _Given], _Found],
) -> Callable[Concatenate[Any, _Given], _Found]:
    """Make a method keep its results with its object, for each set of positional arguments.

    Arguments are hashable, or arrays, which are compared by their numbers: an array argument must
    always have the same shape and type. Arrays that are returned are read-only.

    Examples
    --------
    >>> class Powers:
    ...     @kept
    ...     def of(self, n):
    ...         return 2.0 ** np.arange(n)
    >>> powers = Powers()
    >>> powers.of(3) is powers.of(3)
    True
    """
    name = method.__name__

    @wraps(method)
    def found(self: Any, /, *given: _Given.args, **none: _Given.kwargs) -> _Found:
        known: dict[tuple[Any, ...], _Found] = vars(self).setdefault("_kept", {})
        key: tuple[Any, ...] = (name, *given)
        try:  # to hash a key may take longer than all else, and is done once
            made: _Found = known.get(key, _NONE)
        except TypeError:  # arrays have no hash
            key = tuple(one.tobytes() if isinstance(one, np.ndarray) else one for one in key)
            made = known.get(key, _NONE)
        if made is _NONE:
            known[key] = made = method(self, *given, **none)
            if isinstance(made, np.ndarray):
                made.setflags(write=False)
        return made

    return found
