"""Families: systems with named numeric parameters."""

import dataclasses
import inspect
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, Self, cast, final, get_origin

import numpy as np

from dynkit.core.kept import ANY_CACHED
from dynkit.core.overriding import Extensible
from dynkit.core.reprs import Shown
from dynkit.core.user_code import code_of
from dynkit.core.validation import one_of

_NUMBERS = (int, float, np.integer, np.floating)


class Family(Extensible, Shown):
    """A family of systems with named numeric parameters, changed by `replace`.

    The fields in the body of a subclass, such as ``rate: float = 3.0``, are its arguments, as in a
    frozen dataclass, with or without the decorator. Fields that are numbers are its parameters. A
    class that defines ``__init__`` defines `parameters` and `replace` as well.

    Raises
    ------
    TypeError
        When a class is defined with a field that has the name of a method or property of its bases.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        _refuse_hiding(cls)
        for base in cls.__mro__[1:]:  # a base class has its decorator applied by now
            _make_dataclass(base)
        super().__init_subclass__(**options)

    def __new__(cls, *_: Any, **__: Any) -> Self:
        if "__dataclass_fields__" not in vars(cls):
            _make_dataclass(cls)
        return super().__new__(cls)

    @property
    def parameters(self) -> Mapping[str, float]:
        """The numeric parameters of this member of the family, by name."""
        values = {name: getattr(self, name) for name in arguments(type(self))}
        return {
            name: float(value)
            for name, value in values.items()
            if isinstance(value, _NUMBERS) and not isinstance(value, bool)
        }

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that the motion depends on, by name; stores compare it.

        For a class outside of this package, `code` is a digest of its code.
        """
        instance: Any = self  # is_dataclass would narrow the type
        own = {"code": digest} if (digest := code_of(type(self))) else {}
        if not dataclasses.is_dataclass(instance):
            return {**self.parameters, **own}
        fields = dataclasses.fields(instance)
        return {entry.name: getattr(instance, entry.name) for entry in fields} | own

    @final
    def value_of(self, name: str) -> float:
        """Return one of `parameters`.

        Raises
        ------
        ValueError
            When there is no parameter of this name.
        """
        values = self.parameters
        if not values:
            raise ValueError(
                f"parameter must be a field of {type(self).__name__}, such as `rate: float = 1.0` "
                f"in the class, and there is none; got {name!r}"
            )
        return values[one_of("parameter", name, values)]

    def replace(self, **parameters: float) -> Self:
        """Return the same object with some of its parameters changed.

        Raises
        ------
        ValueError
            When a name is not one of `parameters`, or a value is refused.
        """
        for name in parameters:
            self.value_of(name)
        if not parameters:
            return self
        if not arguments(type(self)):
            raise TypeError(f"{type(self).__name__} has parameters but does not define `replace`")
        changed: Self = dataclasses.replace(cast("Any", self), **parameters)
        return changed

    def _examine(self) -> None:
        """Raise ValueError when quantities derived from the values show that they are invalid."""


@lru_cache
def cached_in(kind: type) -> frozenset[str]:
    """Return the names of attributes of a class that follow from its fields.

    They are cached properties, and where `kept` methods keep their results.
    """
    members = (pair for base in kind.__mro__ for pair in vars(base).items())
    cached = (name for name, member in members if isinstance(member, ANY_CACHED))
    return frozenset(("_kept", *cached))


def without_cached(instance: object) -> dict[str, Any]:
    """Return the attributes of an object without its cached properties, for pickle."""
    kind: Any = type(instance)
    return {name: v for name, v in vars(instance).items() if name not in cached_in(kind)}


def _make_dataclass(cls: type) -> None:
    """Make a class of a family with fields in its body a frozen dataclass, unless it is one."""
    own = vars(cls)
    if not issubclass(cls, Family) or "__dataclass_fields__" in own or "__init__" in own:
        return
    if any(_is_field(kind) for kind in inspect.get_annotations(cls).values()):
        inherited = getattr(cls, "__dataclass_fields__", {}).values()
        dataclasses.dataclass(frozen=True, kw_only=any(f.kw_only for f in inherited))(cls)


def _refuse_hiding(cls: type) -> None:
    """Refuse fields of a class that hide a method or property of its bases, such as `stiffness`."""
    for name, annotation in inspect.get_annotations(cls).items():
        base = next((base for base in cls.__mro__[1:] if name in vars(base)), object)
        hidden = vars(base).get(name)
        computed = callable(hidden) or isinstance(hidden, (property, ANY_CACHED))
        abstract = getattr(hidden, "__isabstractmethod__", False)
        if computed and not abstract and _is_field(annotation):
            raise TypeError(
                f"{cls.__name__} must not have a field {name!r}: {base.__name__} has a method or "
                "property of this name; give the field another one"
            )


def _is_field(annotation: Any) -> bool:
    if isinstance(annotation, str):
        return "ClassVar" not in annotation
    return ClassVar not in (annotation, get_origin(annotation))


@lru_cache(maxsize=256)  # asked for at every step of a branch
def arguments(kind: Any) -> tuple[str, ...]:
    """Return the names of the arguments of a dataclass; none for another class."""
    if not dataclasses.is_dataclass(kind):
        return ()
    return tuple(entry.name for entry in dataclasses.fields(kind) if entry.init)
