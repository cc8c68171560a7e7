"""Names of a package that are imported when they are first asked for."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def lazy_names(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Module-level ``__getattr__`` and ``__dir__`` (PEP 562) for a package.

    Parameters
    ----------
    package
        The package's ``__name__``.
    homes
        For each public name the module that defines it.

    Returns
    -------
    tuple
        The two functions. A name is looked up once and then stands in the package itself.

    Examples
    --------
    >>> getattr_, dir_ = lazy_names("dynkit", {"sqrt": "math"})
    >>> getattr_("cbrt")
    Traceback (most recent call last):
    AttributeError: module 'dynkit' has no attribute 'cbrt'
    """

    def __getattr__(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return __getattr__, __dir__
