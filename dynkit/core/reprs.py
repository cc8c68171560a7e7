"""Representations of objects: one line of text, and a table in notebooks."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from dynkit.core.cost import Cost

Facts = dict[str, object]
"""Rows of a table: values by name."""

_LONGEST = 40
"""Arrays and tuples of numbers whose text is longer than this are shown by their shape."""

_SIXTH = 1e-6
"""A number with a larger error, relative to its size, is shown with its error."""

_LEFT = ' style="text-align:left"'


class Tabled:
    """An object that notebooks show as a table with its repr as caption.

    A subclass lists its rows in `_facts`, and may add further tables in `_tables`. Neither
    simulates or computes a result: a table shows only known values.
    """

    def _facts(self) -> Facts:
        """Return the rows, by name; `written` formats the values and None is left out.

        An error that is already known becomes a row even when it is not among the facts.
        """
        return {}

    def _tables(self) -> Iterable[str]:
        """Return further tables, made by `table`."""
        return ()

    def _caption(self) -> str:
        return repr(self).removeprefix("<").removesuffix(">")

    def _repr_html_(self) -> str:
        facts = self._facts()
        last = {"error": getattr(self, "__dict__", {}).get("error"), "cost": None}
        last |= {name: facts.pop(name) for name in last if name in facts}
        if isinstance(last["error"], float | np.ndarray):  # a field named error may be a text
            last["error"] = largest(last["error"])
        rows = [(name, value) for name, value in (facts | last).items() if value is not None]
        return "".join([table(self._caption(), rows, most=40), *self._tables()])


class Shown(Tabled):
    """A system whose repr shows arguments that differ from their defaults; notebooks show all.

    The repr of a dataclass shows the fields that differ from their defaults; that of another class
    shows its ``parameters``. Long arrays are shown by their shapes. A repr without such arrays is
    an expression that makes the system again.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # a dataclass would generate a repr with all its fields where the body defines none
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return system_repr(self)

    def _caption(self) -> str:
        return type(self).__name__

    def _facts(self) -> Facts:
        return {
            name: value if isinstance(value, str) else _shortened(value)
            for name, value, _ in _arguments(self)
            if _shape(value) != (0,)
        }


def system_repr(system: object, digits: int | None = None, without: Collection[str] = ()) -> str:
    """Return the class of a system and the arguments that differ from their defaults.

    Parameters
    ----------
    system : object
    digits : int, optional
        Significant digits of numbers; by default as many as reproduce them exactly.
    without : collection of str
        Arguments that are left out.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> system_repr(ImpactChain(masses=2, frequency=2.0**0.5, restitution=0.85), digits=3)
    'ImpactChain(frequency=1.41, masses=2)'
    """
    shown = [
        f"{name}={_shortened(value, digits)}"
        for name, value, default in _arguments(system)
        if name not in without and not _same(value, default)
    ]
    return f"{type(system).__name__}({', '.join(shown)})"


def line_of(system: object, kind: str, swept: Collection[str] = ()) -> str:
    """Return a system in one line, without the swept parameters.

    Where the system is None, the line is the name of its class: the last part of ``kind``.
    """
    return kind.rpartition(".")[2] if system is None else system_repr(system, 6, swept)


def _arguments(system: Any) -> list[tuple[str, object, object]]:
    """Return names, values and defaults of a system's arguments."""
    if not dataclasses.is_dataclass(system):
        parameters = getattr(system, "parameters", {})
        return [(name, value, dataclasses.MISSING) for name, value in parameters.items()]
    return [
        (entry.name, getattr(system, entry.name), entry.default)
        for entry in dataclasses.fields(system)
        if entry.repr and entry.name not in getattr(system, "_unshown", ())
    ]


def _same(value: object, default: object) -> bool:
    if default is dataclasses.MISSING or _shape(value) != _shape(default):
        return False
    return bool(np.all(value == default))


def _shape(value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:  # rows of different lengths
        return (len(value),)


def _shortened(value: object, digits: int | None = None) -> str:
    if isinstance(value, float | np.floating):
        return repr(float(value)) if digits is None else f"{value:.{digits}g}"
    if isinstance(value, np.generic):
        return repr(value.item())
    if not isinstance(value, tuple | list | np.ndarray):
        return repr(value)
    text = repr(value.tolist() if isinstance(value, np.ndarray) else value)
    if len(text) <= _LONGEST:
        return text
    if any(dataclasses.is_dataclass(item) for item in value):
        return f"({', '.join(map(_kind, value))})"
    return f"<{' x '.join(map(str, _shape(value)))} numbers>"


def _kind(item: object) -> str:
    """Return the class of an element, and its name if it has one.

    Examples
    --------
    >>> from dynkit.systems import HardStop
    >>> print(_kind(HardStop(0, name="wall")), _kind(HardStop(0)))
    HardStop 'wall' HardStop
    """
    name = getattr(item, "name", "")
    return f"{type(item).__name__} {name!r}" if name else type(item).__name__


# --- tables ---------------------------------------------------------------------------------------


def table(
    caption: str, rows: Iterable[Sequence[object]], heads: Sequence[str] = (), most: int = 12
) -> str:
    """Return a table in HTML, without colours, for light and dark pages.

    Parameters
    ----------
    caption : str
    rows : sequences of object
        The first entry of each names the row. Floats have six digits; all text is escaped.
    heads : sequence of str
        Heads of the columns, if any.
    most : int
        Largest number of rows; a last row says how many more there are.

    Examples
    --------
    >>> print(table("a < b", [("rate", 1.0 / 3.0)]).replace(' style="text-align:left"', ""))
    <table><caption>a &lt; b</caption><tr><th>rate</th><td>0.333333</td></tr></table>
    """
    all_rows = [list(row) for row in rows]
    shown = all_rows[:most]
    if len(all_rows) > most:
        shown.append([f"... {len(all_rows) - most} more"])
    lines = [f"<th{_LEFT}>{escape(head)}</th>" for head in heads]
    parts = [f"<tr>{''.join(lines)}</tr>"] if lines else []
    for name, *values in shown:
        cells = "".join(f"<td{_LEFT}>{escape(written(value))}</td>" for value in values)
        parts.append(f"<tr><th{_LEFT}>{escape(written(name))}</th>{cells}</tr>")
    return f"<table><caption{_LEFT}>{escape(caption)}</caption>{''.join(parts)}</table>"


def written(value: object) -> str:
    """Return the text of a value in a table.

    Examples
    --------
    >>> written(2.0**0.5), written(0.6 + 0.8j), written(3), written(None), written(True)
    ('1.41421', '0.6+0.8j', '3', 'none', 'yes')
    >>> written(np.array([2.0, 1.0])), written(np.array([True, False])), written(("x", "y"))
    ('2 values, 1 to 2', '1 of 2', 'x, y')
    """
    if isinstance(value, np.ndarray):
        return _counted(value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ", ".join(map(written, value))
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {written(part)}" for name, part in value.items()) or "none"
    if isinstance(value, Cost):
        return costing(value)
    if isinstance(value, complex | np.complexfloating):
        return f"{value.real:.6g}" if value.imag == 0.0 else f"{value:.6g}"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    return "none" if value is None else str(value)


def _counted(array: Any) -> str:
    if array.dtype.kind == "b":
        return f"{array.sum()} of {array.size}"
    count = f"{' x '.join(map(str, array.shape))} values"
    return f"{count}, {span(array)}" if array.dtype.kind in "fiu" else count


def largest(errors: Any) -> str:
    """Return an error, or the largest of several that are not NaN, with two digits.

    Examples
    --------
    >>> largest(2.0**-52), largest([1e-3, 2e-3, np.nan]), largest([np.nan])
    ('2.2e-16', 'up to 2.0e-03', 'none')
    """
    array = np.asarray(errors)
    if not array.ndim:
        return f"{float(array):.1e}"
    known = array[~np.isnan(array)]
    return f"up to {known.max():.1e}" if known.size else "none"


def measured(value: float, error: float, digits: int) -> str:
    """Return a number with so many digits, and its error if not even six of them are known.

    Examples
    --------
    >>> measured(1.0 / 3.0, 1e-12, 10), measured(1.0 / 3.0, 0.25, 10)
    ('0.3333333333', '0.3333333333 +- 0.2')
    """
    text = f"{value:.{digits}g}"
    return text if error <= _SIXTH * abs(value) else f"{text} +- {error:.1g}"


def span(values: Any) -> str:
    """Return the range of some numbers in words, NaN left out.

    Examples
    --------
    >>> span([2.0, 1.0, 3.0]), span([1.0]), span([np.nan])
    ('1 to 3', '1', 'none')
    """
    numbers = np.asarray(values, dtype=float)
    numbers = numbers[~np.isnan(numbers)]
    if not numbers.size:
        return "none"
    low, high = float(numbers.min()), float(numbers.max())
    return written(low) if low == high else f"{written(low)} to {written(high)}"


def costing(cost: Cost) -> str:
    """Return a cost in words.

    Examples
    --------
    >>> costing(Cost(0.25, {"impacts": 800}))
    '0.25 s, 800 impacts'
    """
    counts = [f"{count} {name.replace('_', ' ')}" for name, count in cost.counts.items()]
    return ", ".join([f"{cost.seconds:.3g} s", *counts])
