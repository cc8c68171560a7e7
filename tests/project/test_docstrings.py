"""Every public method is documented, by itself or by the class that it inherits from."""

import importlib
import inspect
import pkgutil
from functools import cached_property

import dynkit
import tutorials

DOCUMENTED = (staticmethod, classmethod, property, cached_property)


def public_classes() -> list[type]:
    modules = [
        importlib.import_module(found.name)
        for package in (dynkit, tutorials)
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not found.name.endswith("__main__")
    ]
    return [
        value
        for module in modules
        for name, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__ and name[0] != "_"
    ]


def documented(owner: type, name: str) -> bool:
    return any(vars(base)[name].__doc__ for base in owner.__mro__ if name in vars(base))


def test_public_methods_are_documented() -> None:
    methods = [
        (owner, name)
        for owner in public_classes()
        for name, value in vars(owner).items()
        if name[0] != "_" and (inspect.isfunction(value) or isinstance(value, DOCUMENTED))
    ]
    assert len(methods) > 500
    assert [(owner, name) for owner, name in methods if not documented(owner, name)] == []
