"""Conversion of results to plain data and back: numbers, texts, arrays, and records of them.

The annotations of a class are the schema by which its data are written and read. No class is looked
up by a name from a file. A class may define

1. ``_stored``, the names of the attributes and cached properties that are stored; by default the
   public fields of a dataclass or named tuple;
2. ``_stored_if_known``, the names of cached properties that are stored if they were computed;
3. ``_given``, the name of an attribute that is not stored, such as the system of a motion: the
   reader of the file supplies it;
4. ``_restored()``, which returns the object with the attributes that are derived from these, or
   raises ValueError if they do not fit together. By default `dataset` is called for its checks.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
import types
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import ANY_CACHED

Arrays = dict[str, NDArray[Any]]
_KINDS = {np.float64: "f", np.complex128: "c", np.bool_: "b", np.int64: "i"}


def encoded(name: str, value: Any, arrays: Arrays) -> Any:
    """Return a value as a tree for JSON; its arrays are added to `arrays` by name, in place.

    Raises
    ------
    TypeError
        When a part of the value is not plain data.
    """
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return name
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, complex):
        return [value.real, value.imag]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if _is_record(kind := type(value)):
        told = {"kind": kind.__name__} if hasattr(kind, "_restored") else {}
        unknown = {key for key in _if_known(kind) if key not in vars(value)}
        value = told | {key: getattr(value, key) for key in schema(kind) if key not in unknown}
    if isinstance(value, Mapping):
        return {
            str(key): encoded(f"{name}/{key}".lstrip("/"), part, arrays)
            for key, part in value.items()
        }
    if isinstance(value, Sequence):
        return [encoded(f"{name}/{i}", part, arrays) for i, part in enumerate(value)]
    raise TypeError(f"{name} must be plain data; got {value!r}")


def decoded(
    hint: Any, name: str, tree: Any, arrays: Mapping[str, NDArray[Any]], given: Any = None
) -> Any:
    """Return the value of an annotated type from the tree and the arrays of `encoded`.

    `given` is the object of `_given`. Its ``_solutions`` are the classes of objects that may be
    annotated by an abstract class or a protocol.

    Raises
    ------
    LookupError, TypeError, ValueError
        When a part is missing, or has another type.
    """
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if tree is None and type(None) in parts:
            return None
        (hint,) = (part for part in parts if part is not type(None))
        return decoded(hint, name, tree, arrays, given)
    if origin is np.ndarray or hint is Any:  # real or complex
        array = arrays[_is(str, name, tree)]
        if array.dtype.kind not in ("fc" if hint is Any else _KINDS[get_args(parts[1])[0]]):
            raise ValueError(f"{name} is {array.dtype} {array.shape}")
        array.setflags(write=False)
        return array
    if origin in (tuple, Sequence):
        rows = _is(list, name, tree)
        alike = origin is Sequence or parts[1:] == (...,)
        hints = [parts[0]] * len(rows) if alike else parts
        each = enumerate(zip(hints, rows, strict=True))
        return tuple(decoded(of, f"{name}/{i}", row, arrays, given) for i, (of, row) in each)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key_of, of = parts
        items = _is(dict, name, tree).items()
        return {key_of(key): decoded(of, f"{name}/{key}", row, arrays, given) for key, row in items}
    if origin is Literal:
        return parts[parts.index(tree)]
    if hint is complex:
        return complex(*tree) if isinstance(tree, list) else complex(_is(float, name, tree))
    if hint is float:
        return float(_is(float, name, float(tree) if type(tree) is int else tree))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint[_is(str, name, tree)]
    protocol = getattr(hint, "_is_protocol", False)
    if protocol or inspect.isabstract(hint):
        kinds = {kind.__name__: kind for kind in given._solutions}
        hint = kinds[_is(str, f"{name}/kind", _is(dict, name, tree)["kind"])]
    if _is_record(hint):
        rows, known = _is(dict, name, tree), schema(hint)
        optional = _arguments(hint) | dict.fromkeys(_if_known(hint), True)
        found = {
            key: decoded(of, f"{name}/{key}", rows[key], arrays, given)
            for key, of in known.items()
            if key in rows or not optional.get(key)  # older stores lack newer optional fields
        }
        if name_of_given := getattr(hint, "_given", None):
            found[name_of_given] = given
        record = _made(hint, found)
        if hasattr(hint, "_restored"):
            return record._restored()
        if hasattr(hint, "dataset"):  # it raises for arrays whose shapes do not agree
            record.dataset()
        return record
    return _is(hint, name, tree)


def _is(kind: type, name: str, value: Any) -> Any:
    if type(value) is not kind:
        raise TypeError(f"{name} is {value!r}")
    return value


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and (
        dataclasses.is_dataclass(kind) or hasattr(kind, "_fields") or hasattr(kind, "_stored")
    )


def schema(kind: Any) -> dict[str, Any]:
    """Return the stored attributes of a class, by name, with their annotated types."""
    public = [name for name in _arguments(kind) if not name.startswith("_")]
    found = {}
    for name in (*getattr(kind, "_stored", public), *_if_known(kind)):
        member = getattr(kind, name, None)
        if isinstance(member, ANY_CACHED):
            found[name] = get_type_hints(member.func)["return"]
        else:
            found[name] = _hint(kind, name)
    return found


def _if_known(kind: Any) -> tuple[str, ...]:
    return getattr(kind, "_stored_if_known", ())


def _hint(kind: type, name: str) -> Any:
    """Return the annotated type of an attribute.

    Other annotations are not evaluated, because their names may exist for type checkers only.
    """
    base = next(base for base in kind.__mro__ if name in inspect.get_annotations(base))
    alone = types.SimpleNamespace(__annotations__={name: inspect.get_annotations(base)[name]})
    return get_type_hints(alone, vars(sys.modules[base.__module__]))[name]


def _arguments(kind: Any) -> dict[str, bool]:
    """Return the names of a record's arguments, and whether each has a default."""
    if dataclasses.is_dataclass(kind):
        missing = dataclasses.MISSING
        return {
            entry.name: entry.default is not missing or entry.default_factory is not missing
            for entry in dataclasses.fields(kind)
            if entry.init
        }
    return {name: name in kind._field_defaults for name in getattr(kind, "_fields", ())}


def _made(kind: Any, found: dict[str, Any]) -> Any:
    """Return the record with the stored values.

    Private arguments are not stored; those without a default are None. A class with other arguments
    that are not stored, such as an attractor, is created without its ``__init__``.
    """
    arguments = _arguments(kind)
    needed = [name for name, optional in arguments.items() if not optional and name not in found]
    if not arguments or any(not name.startswith("_") for name in needed):
        record = object.__new__(kind)
        vars(record).update(found)
        return record
    given = {name: value for name, value in found.items() if name in arguments}
    record = kind(**given, **dict.fromkeys(needed))
    if len(given) < len(found):
        vars(record).update({name: found[name] for name in found.keys() - given.keys()})
    return record
