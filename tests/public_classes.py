"""The classes that a user meets: public names, and all that their public members give."""

from __future__ import annotations

import ast
import doctest
import inspect
import sys
from collections.abc import Iterator
from functools import cache, cached_property
from importlib import import_module
from types import FunctionType, ModuleType
from typing import Any

import matplotlib.pyplot as plt

from dynkit.data.result import Result

PACKAGES = ("dynkit", "dynkit.systems", "dynkit.analysis")


def measures() -> dict[str, type[Result]]:
    """The results among the public names of `dynkit.analysis`."""
    package = import_module("dynkit.analysis")
    members = [getattr(package, name) for name in package.__all__]
    kinds = [kind for kind in members if inspect.isclass(kind) and issubclass(kind, Result)]
    return {kind.__name__: kind for kind in kinds}


def example(kind: type) -> Any:
    """The first of a class that the example of its docstring makes."""
    text, known = inspect.getdoc(kind) or "", dict(vars(import_module(kind.__module__)))
    test = doctest.DocTestParser().get_doctest(text, known, kind.__name__, None, None)
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    failed, _ = doctest.DocTestRunner(optionflags=options).run(
        test, out=sys.stdout.write, clear_globs=False
    )
    plt.close("all")
    assert not failed, kind
    return next(value for value in test.globs.values() if isinstance(value, kind))


def public_classes() -> dict[type, str]:
    """Classes, and where each was found, but for enumerations and exceptions."""
    return {kind: place for kind, place in classes_met().items() if not _only_named(kind)}


@cache
def classes_met() -> dict[type, str]:
    """All classes, and where each was found."""
    found: dict[type, str] = {}
    waiting = list(_public_names())
    while waiting:
        kind, place = waiting.pop(0)
        if kind not in found:
            found[kind] = place
            waiting += [(other, f"{kind.__name__}.{name}") for name, other in _given(kind)]
    return found


def _only_named(kind: type) -> bool:
    from enum import Enum

    return issubclass(kind, Enum | BaseException)


def _public_names() -> Iterator[tuple[type, str]]:
    for package in map(import_module, PACKAGES):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isclass(value):
                yield value, package.__name__
            elif isinstance(value, FunctionType):
                for kind in _named(value.__annotations__["return"], value.__module__):
                    yield kind, name


def _given(kind: type) -> Iterator[tuple[str, type]]:
    """What fields, properties and methods of a class say that they give."""
    for base in kind.__mro__:
        if not base.__module__.startswith("dynkit"):
            continue
        fields = vars(base).get("__annotations__", {})
        said = {name: text for name, text in fields.items() if not name.startswith("_")}
        for name, member in vars(base).items():
            function = _function(member)
            if function is not None and (name == "__call__" or not name.startswith("_")):
                said[name] = function.__annotations__.get("return", "None")
        for name, text in said.items():
            yield from ((name, other) for other in _named(text, base.__module__))


def _function(member: object) -> FunctionType | None:
    if isinstance(member, property):
        member = member.fget
    elif isinstance(member, cached_property):
        member = member.func
    elif isinstance(member, classmethod | staticmethod):
        member = member.__func__
    return member if isinstance(member, FunctionType) else None


def _named(annotation: object, module: str) -> Iterator[type]:
    """The classes of dynkit in an annotation."""
    if inspect.isclass(annotation):
        yield from [annotation] if annotation.__module__.startswith("dynkit") else []
        return
    for node in ast.walk(ast.parse(str(annotation), mode="eval")):
        name = getattr(node, "id", getattr(node, "value", None))
        kind = _names(module).get(name) if isinstance(name, str) else None
        if inspect.isclass(kind) and kind.__module__.startswith("dynkit"):
            yield kind


@cache
def _names(module: str) -> dict[str, object]:
    """What the names of a module mean, those that only type checkers import among them."""
    home: ModuleType = import_module(module)
    found: dict[str, object] = {}
    for node in ast.walk(ast.parse(inspect.getsource(home))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dynkit"):
            source = import_module(node.module or "")
            for alias in node.names:
                found[alias.asname or alias.name] = getattr(source, alias.name, None)
    return {**found, **vars(home)}
