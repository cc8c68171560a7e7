"""Subclasses of users: an override counts wherever its class is used, or it is refused."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping
from functools import lru_cache
from threading import RLock
from types import CodeType
from typing import Any, ClassVar


class Extensible:
    """A class that users may subclass.

    A class must not override what its bases mark by `typing.final`, and must annotate fields of its
    bases to which it gives other defaults. Methods that follow from others, such as a jacobian, are
    not inherited together with an overridden original: in their place is the method of the next
    base that computes them from any original, for instance by differences.

    Raises
    ------
    TypeError
        When a class is defined that breaks these rules.
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """For methods that follow from others, by name, the names of these originals."""

    _stands_for: ClassVar[type]
    """Of a class that dynkit makes from another one: that class."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "_stands_for" in vars(cls):
            return
        _refuse_final(cls)
        _refuse_bare_fields(cls)
        for name, originals in cls._following.items():
            _inherit(cls, name, originals)


def watching(kind: type) -> Any:
    """Return a subclass whose instances note the names of attributes that are read."""
    with _lock:
        if "_watching" not in vars(kind):
            setattr(kind, "_watching", _watching(kind))  # noqa: B010
        return vars(kind)["_watching"]


_lock = RLock()


def _watching(kind: Any) -> Any:
    def read(self: Any, name: str) -> Any:
        used.add(name)
        return super(made, self).__getattribute__(name)

    used: set[str] = set()
    own = {"__getattribute__": read, "_used": used, "_stands_for": kind}
    made: Any = type(kind)(kind.__name__, (kind,), own)
    return made


def used_of(kind: type) -> frozenset[str]:
    """Return the names of attributes that instances of `watching` have read so far."""
    known = vars(kind).get("_watching")
    return frozenset(known._used) if known else frozenset()


def members_of(kind: type) -> tuple[tuple[str, _Member], ...]:
    """Return which members of a user's classes have been read, to notice that one is replaced."""
    own = _own_bases(kind)
    if not own:
        return ()
    names = sorted(name for name in used_of(kind) if not name.startswith("__"))
    found = ((n, next((vars(base)[n] for base in own if n in vars(base)), None)) for n in names)
    return tuple((name, _Member(member)) for name, member in found if member is not None)


class _Member:
    """A member of a class, equal to itself alone."""

    def __init__(self, member: Any) -> None:
        self._member = member

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Member) and self._member is other._member

    def __hash__(self) -> int:
        return id(self._member)


def code_of(kind: type) -> str:
    """Return a digest of the methods of a class that are not this package's; empty for none.

    Docstrings and comments do not enter, nor do functions outside of the class. The digest belongs
    to one version of Python.
    """
    own = _own_bases(kind)
    members = [pair for base in own for pair in sorted(vars(base).items(), key=lambda p: p[0])]
    codes = [(name, *_contents(function)) for name, each in members if (function := _plain(each))]
    return hashlib.sha256(repr(codes).encode()).hexdigest() if codes else ""


_SHIPPED = "dynkit", "builtins", "abc", "typing"


@lru_cache(maxsize=256)
def _own_bases(kind: type) -> tuple[type, ...]:
    """The class and its bases that are not this package's."""
    return tuple(base for base in kind.__mro__ if base.__module__.partition(".")[0] not in _SHIPPED)


def _plain(member: Any) -> Any:
    """The written function of a method, property, static method or function of Numba, or None."""
    for name in ("fget", "func", "__func__", "py_func", "__wrapped__"):
        member = getattr(member, name, None) or member
    code = getattr(member, "__code__", None)
    # methods that `dataclass` makes have no file
    return member if code is not None and code.co_filename != "<string>" else None


def _contents(function: Any) -> tuple[object, ...]:
    """Instructions, names and constants of a function, without its docstring."""
    code, found = function.__code__, []
    for each in code.co_consts:
        if isinstance(each, CodeType):
            found.append(repr((each.co_code, each.co_names, each.co_consts)))
        elif isinstance(each, frozenset):
            found.append(repr(sorted(map(repr, each))))
        elif each is not None and each != function.__doc__:
            found.append(repr(each))
    return code.co_code, code.co_names, code.co_varnames, found


def _refuse_final(cls: type) -> None:
    """Refuse overrides of what a base marks as final, also by a base of another family."""
    final: dict[str, type] = {}
    for base in reversed(cls.__mro__):
        own = vars(base)
        if base is not cls and own.get("__final__"):
            raise TypeError(
                f"{cls.__name__} must not be a subclass of {base.__name__}, which is final"
            )
        for name in final.keys() & own.keys():
            raise TypeError(
                f"{cls.__name__} must not override {name} of {final[name].__name__}, which is "
                "final: an override would have no effect in compiled code"
            )
        marked = (name for name, member in own.items() if _is_final(member))
        final |= dict.fromkeys(marked, base)


def _is_final(member: object) -> bool:
    member = getattr(member, "fget", None) or member
    # an instance of a final class has this attribute by its class
    return not isinstance(member, type) and "__final__" in getattr(member, "__dict__", ())


def _refuse_bare_fields(cls: type) -> None:
    """Refuse class attributes that a field of a base would hide in every instance."""
    inherited = getattr(cls, "__dataclass_fields__", {})
    own = vars(cls).keys() - inspect.get_annotations(cls).keys()
    for name in sorted(own & inherited.keys()):
        kind = inherited[name].type
        raise TypeError(
            f"{cls.__name__} must annotate {name}, a field of its base class, as in "
            f"`{name}: {getattr(kind, '__name__', kind)} = ...`; got {vars(cls)[name]!r}"
        )


def _inherit(cls: type, name: str, originals: tuple[str, ...]) -> None:
    """Inherit a method from the first base whose method holds for the originals of the class."""
    bases = _definers(cls, name)
    stale = [each for each in originals if not _holds(cls, bases[0], name, each)]
    if not stale:
        return
    for each in (each for each in stale if _uses(cls, each, name)):
        raise TypeError(
            f"{cls.__name__} must define {name}, too, as it overrides {each}, which calls {name}: "
            f"that of {bases[0].__name__} belongs to another {each}"
        )
    holds = (base for base in bases if all(_holds(cls, base, name, each) for each in originals))
    setattr(cls, name, vars(next(holds))[name])


def _definers(cls: type, name: str) -> list[type]:
    return [base for base in cls.__mro__ if name in vars(base)]


def _holds(cls: type, base: type, name: str, original: str) -> bool:
    """Whether a base's method does not belong to an original that the class has overridden."""
    known = getattr(base, original, None)
    if known is None or getattr(known, "__isabstractmethod__", False):
        return True
    order = cls.__mro__
    first = base is _definers(cls, name)[-1]  # it takes any original
    return first or order.index(base) <= order.index(_definers(cls, original)[0])


def _uses(cls: type, original: str, name: str) -> bool:
    """Whether an original calls the method that follows from it, as a linear map its jacobian."""
    members = (vars(base)[original] for base in _definers(cls, original)[:-1])
    codes = (getattr(getattr(each, "fget", each), "__code__", None) for each in members)
    return any(name in code.co_names for code in codes if code is not None)
