"""Digests of the code of users' classes, and detection of changes."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterator, Mapping
from dis import Instruction, get_instructions
from functools import lru_cache
from types import CodeType, ModuleType
from typing import Any, final

import numpy as np

_SIMPLE = bool, int, float, complex, str, bytes, np.generic
_SHIPPED = {"dynkit", *sys.stdlib_module_names} - {"__main__"}


def code_of(kind: type) -> str:
    """Return a digest of the code of a user's class; empty for a class of this package.

    The digest includes the methods and constants of the class. It also includes the functions,
    classes and constants that these use by name from their modules and closures, unless they belong
    to a library. Constants are numbers, texts, arrays, and tuples and frozen sets of these. The
    digest does not include docstrings, comments, defaults of fields, and attributes that a method
    itself assigns. It differs between versions of Python.
    """
    return reading_of(kind).digest


def reading_of(kind: type) -> Reading:
    """Return the `Reading` of a class; a new one if a part of its code was replaced."""
    kept = _kept(kind)
    if not kept[0].holds():
        kept[0] = Reading(kind)
    return kept[0]


@lru_cache(maxsize=256)
def _kept(kind: type) -> list[Reading]:
    return [Reading(kind)]


def is_users(kind: type) -> bool:
    """Whether a class belongs neither to this package nor to Python."""
    top, module = _top(kind.__module__), sys.modules.get(kind.__module__)
    # a class made by a call has the module of its metaclass: compare by name
    named = top == "dynkit" or getattr(module, kind.__name__, None) is kind
    return not (named and top in _SHIPPED)


def overridden_in(kind: type) -> set[str]:
    """Return the public names that users' classes define anew, among the bases of a class."""
    own: set[str] = set()
    known: set[str] = set()
    for base in kind.__mro__:
        (own if is_users(base) else known).update(vars(base))
    return {name for name in own & known if not name.startswith("_")}


@final
class Reading:
    """The code that was read for the digest of a class, and the places where it was read.

    A reading equals only itself.
    """

    def __init__(self, kind: type) -> None:
        self._package = _top(kind.__module__)
        self._numbers: dict[int, int] = {}
        self._sizes: list[tuple[Mapping[str, Any], int]] = []
        self._read: list[tuple[Mapping[str, Any], str, Any]] = []
        found = self._of_classes(kind)
        self.digest = hashlib.sha256(repr(found).encode()).hexdigest() if any(found) else ""

    def holds(self) -> bool:
        """Whether all values that were read are still in their places."""
        return all(len(space) == size for space, size in self._sizes) and all(
            space.get(name) is value for space, name, value in self._read
        )

    def _of(self, value: Any) -> object:
        """Return a description of a value whose repr is the same in all processes."""
        if isinstance(value, _SIMPLE) or value is None:
            return repr(value)
        if isinstance(value, tuple):
            return tuple(map(self._of, value))
        if isinstance(value, frozenset):
            return sorted(map(repr, value))
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            return value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
        if isinstance(value, CodeType):
            return self._of_code(value)
        function = _plain(value)
        value = value if function is None else function
        if id(value) in self._numbers:
            return self._numbers[id(value)]
        if function is not None and self._follows(function.__globals__.get("__name__", "")):
            self._numbers[id(function)] = len(self._numbers)
            return self._of_function(function)
        if isinstance(value, type) and self._follows(value.__module__):
            return self._of_classes(value)
        kind = type(value).__qualname__
        return getattr(value, "__qualname__", None) or getattr(value, "__name__", kind)

    def _of_classes(self, kind: type) -> list[list[object]]:
        own = (base for base in kind.__mro__ if is_users(base))
        return [self._of_class(base) for base in own if id(base) not in self._numbers]

    def _of_class(self, kind: type) -> list[object]:
        self._numbers[id(kind)] = len(self._numbers)
        members, kinds = vars(kind), inspect.get_annotations(kind)
        self._sizes.append((members, len(members)))
        functions = [function for each in members.values() if (function := _plain(each))]
        assigned = _names(functions, "STORE_ATTR")
        found: list[object] = []
        for name, member in sorted(members.items()):
            field = name in kinds and "ClassVar" not in str(kinds[name])
            special = name.startswith("__") or name in _OWN
            if _plain(member) is None and (special or field or name in assigned):
                continue
            self._read.append((members, name, member))
            found.append((name, self._of(member)))
        return found

    def _of_function(self, function: Any) -> object:
        code, space = function.__code__, function.__globals__
        assigned, parts = _names([function], "STORE_GLOBAL"), []
        attributes = _names([function], "LOAD_ATTR", "LOAD_METHOD")
        for name in sorted(_names([function], "LOAD_GLOBAL", "LOAD_NAME") - assigned):
            parts.append((name, self._at(space, name)))
            value = space.get(name)
            if isinstance(value, ModuleType) and self._follows(value.__name__):
                inside = vars(value)
                parts += [(n, self._at(inside, n)) for n in sorted(attributes & inside.keys())]
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            try:
                parts.append((name, self._of(cell.cell_contents)))
            except ValueError:  # the cell is empty
                continue
        defaults = function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))
        return self._of_code(code), parts, self._of(defaults)

    def _at(self, space: Mapping[str, Any], name: str) -> object:
        self._read.append((space, name, space.get(name)))
        return self._of(space.get(name))

    def _of_code(self, code: CodeType) -> object:
        arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        return arguments, [(each.opname, self._of(each.argval)) for each in get_instructions(code)]

    def _follows(self, module: str) -> bool:
        """Whether a module is the user's: in the package of the class, or in no library."""
        top, file = _top(module), getattr(sys.modules.get(module), "__file__", None) or ""
        return top == self._package or not (
            top in _SHIPPED or "site-packages" in file or "dist-packages" in file
        )


_OWN = {"_following", "_inherited", "_stored", "_watching"}
"""Attributes that this package gives to users' classes."""


def _top(module: str) -> str:
    return module.partition(".")[0]


def _plain(member: Any) -> Any:
    """Return the Python function behind a method, property, or function of Numba; None without one.

    Decorators of this package and of Python are removed.
    """
    for name in ("fget", "func", "__func__", "py_func"):
        member = getattr(member, name, None) or member
    while _top(getattr(member, "__globals__", {}).get("__name__", "dynkit")) in _SHIPPED:
        if not hasattr(member, "__wrapped__"):
            break
        member = member.__wrapped__
    code = getattr(member, "__code__", None)
    # methods that `dataclass` makes have no file
    return member if isinstance(code, CodeType) and code.co_filename != "<string>" else None


def _names(functions: list[Any], *operations: str) -> set[str]:
    """Return the names in these operations of functions, and of functions within them."""
    found = (each for function in functions for each in _instructions(function.__code__))
    return {each.argval for each in found if each.opname in operations}


def _instructions(code: CodeType) -> Iterator[Instruction]:
    for each in get_instructions(code):
        yield each
        if isinstance(each.argval, CodeType):
            yield from _instructions(each.argval)
