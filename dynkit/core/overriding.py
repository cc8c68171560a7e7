"""Rules for subclasses of users: an override has effect in all results, or the class is refused.

A class must not override members that its bases mark by `typing.final` or list as `_closed`. It
must annotate a field of a base to which it gives another default. A method that is derived from
other methods, its originals, such as a jacobian, is inherited only together with them. If an
original is overridden or replaced, the class has the general method of the last base, such as
differences. Results that many instances share, such as the matrices of energies, are computed again
when a field that their computation reads is different, or when the code of the class has changed.
Stores and workers compare a digest of this code (`user_code`).
"""

from __future__ import annotations

import inspect
from abc import ABCMeta
from collections.abc import Mapping
from threading import RLock
from typing import Any, ClassVar, cast

from dynkit.core.user_code import is_users


class _Renewing(ABCMeta):
    """Updates the inherited methods of a class when an original or a derived method is replaced."""

    _following: Mapping[str, tuple[str, ...]]

    def __setattr__(cls, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        cls._renew(name)

    def __delattr__(cls, name: str) -> None:
        super().__delattr__(name)
        cls._renew(name)

    def _renew(cls, name: str) -> None:
        if any(name in (derived, *originals) for derived, originals in cls._following.items()):
            _inherit(cls)
            for each in cast("Any", cls).__subclasses__():
                each._renew(name)


class Extensible(metaclass=_Renewing):
    """A class that users may subclass by the rules of this module.

    Raises
    ------
    TypeError
        When a class is defined that breaks a rule.
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """For each derived method, by name, the names of its originals."""

    _closed: ClassVar[frozenset[str]] = frozenset()
    """Names of members that classes of users must not override."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "_used" not in vars(cls):
            _refuse_final(cls)
            _refuse_bare_fields(cls)
            _inherit(cls)


def watching(kind: type) -> Any:
    """Return a subclass whose instances record the names of the attributes that are read."""
    with _lock:
        if "_watching" not in vars(kind):
            type.__setattr__(kind, "_watching", _watching(kind))
        return vars(kind)["_watching"]


_lock = RLock()


def _watching(kind: Any) -> Any:
    def read(self: Any, name: str) -> Any:
        used.add(name)
        return super(made, self).__getattribute__(name)

    used: set[str] = set()
    made: Any = type(kind)(kind.__name__, (kind,), {"__getattribute__": read, "_used": used})
    return made


def used_of(kind: type) -> frozenset[str]:
    """Return the names of attributes that instances of `watching` have read so far."""
    known = vars(kind).get("_watching")
    return frozenset(known._used) if known else frozenset()


def open_members(kind: type) -> list[str]:
    """Return the public names of methods and properties that a subclass may override."""
    bases = [base for base in kind.__mro__ if issubclass(base, Extensible)]
    members = (pair for base in bases for pair in vars(base).items())
    names = {name for name, member in members if hasattr(member, "__get__")}
    public = {name for name in names if name == "__call__" or not name.startswith("_")}
    return sorted(public.difference(*map(_final_in, bases)))


def _final_in(base: type) -> set[str]:
    """Return the names of the members that subclasses of a class must not override."""
    return {n for n, m in vars(base).items() if _is_marked(m)}.union(vars(base).get("_closed", ()))


def _is_marked(member: Any) -> bool:
    # look into the member's own dictionary: an instance of a final class has it from its class
    parts = (each for each in (member, getattr(member, "fget", None)) if not isinstance(each, type))
    return any("__final__" in getattr(each, "__dict__", ()) for each in parts)


def _refuse_final(cls: type) -> None:
    """Refuse overrides of members that a base marks as final, also by another of the bases."""
    before: set[str] = set()
    for base in cls.__mro__:
        if base is not cls and "__final__" in vars(base):
            raise TypeError(
                f"{cls.__name__} must not be a subclass of {base.__name__}, which is final"
            )
        for name in sorted(before & _final_in(base)):
            known = open_members(next(b for b in cls.__mro__[1:] if issubclass(b, Extensible)))
            raise TypeError(
                f"{cls.__name__} must not override {name} of {base.__name__}, which is final: some "
                f"results would ignore it; a subclass may override {', '.join(known)}"
            )
        before |= vars(base).keys() if is_users(base) else set()


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


def _inherit(cls: Any) -> None:
    """Give a class the derived methods of its bases that belong to its originals."""
    found = dict(vars(cls).get("_inherited", {}))
    for name in found.keys() & vars(cls).keys():
        if vars(cls)[name] is found[name]:
            type.__delattr__(cls, name)
    for name, originals in cls._following.items():
        bases = [base for base in cls.__mro__ if name in vars(base)]
        # the method of the last base works with any original
        holds = next((b for b in bases[:-1] if not _stale(cls, b, originals)), bases[-1])
        if holds is not bases[0]:
            _refuse_circle(cls, name, _stale(cls, bases[0], originals))
            found[name] = vars(holds)[name]
            type.__setattr__(cls, name, found[name])
    type.__setattr__(cls, "_inherited", found)


def _stale(cls: type, base: type, originals: tuple[str, ...]) -> list[str]:
    """Return the originals of a base that a class before it in `cls.__mro__` defines."""
    before = cls.__mro__[: cls.__mro__.index(base)]
    known = (each for each in originals if hasattr(base, each))
    concrete = (n for n in known if not getattr(getattr(base, n), "__isabstractmethod__", False))
    return [each for each in concrete if any(each in vars(b) for b in before)]


def _refuse_circle(cls: type, name: str, stale: list[str]) -> None:
    """Refuse a class in which differences of an original call the method that they compute."""
    for original in stale:
        bases = [base for base in cls.__mro__ if original in vars(base)]
        members = (vars(base)[original] for base in bases[:-1])
        codes = (getattr(getattr(each, "fget", each), "__code__", None) for each in members)
        if any(name in code.co_names for code in codes if code is not None):
            raise TypeError(
                f"{cls.__name__} must define {name}, too, as it overrides {original}, which calls "
                f"{name}: that of its base class belongs to another {original}"
            )
