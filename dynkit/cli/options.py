"""Options of a command, made from signatures, and their values from arguments and TOML files."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import finite_array, finite_scalar, one_of
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.elements.friction import DryFriction
from dynkit.systems.impact.elements.jenkins import Jenkins
from dynkit.systems.impact.elements.laws import PlasticBelow, ViscoelasticSpheres
from dynkit.systems.impact.elements.stops import HardStop, SoftStop
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

if TYPE_CHECKING:
    from dynkit.core.validation import Array
    from dynkit.systems.impact.simulation.state import ImpactState

# More values than this are refused as a mistake.
_MOST_VALUES = 1_000_000
_NUMBERS = "X1,X2,..."
ELEMENTS = {kind.__name__: kind for kind in (HardStop, SoftStop, DryFriction, Jenkins)}
LAWS = {kind.__name__: kind for kind in (PlasticBelow, ViscoelasticSpheres)}
_RANGE, _START = ("from", "to", "step"), ("position", "velocity", "phase")


@dataclass(frozen=True)
class Option:
    """One option: its name on the command line and in a file, and its help.

    An option without a metavar is a switch. A positional one is given by its place alone. The value
    of a name or a file is text; the values of all others are numbers, or names, separated by
    commas.
    """

    name: str
    metavar: str
    help: str
    positional: bool = False

    @property
    def text(self) -> bool:
        """Whether the value is text, which may contain commas."""
        return self.metavar in ("NAME", "FILE", "FILE.h5", "RESULTS.h5")

    def parsed(self, value: Any) -> Any:
        """Return the value of a text on the command line, in the types of TOML."""
        if self.text or not isinstance(value, str):
            return value
        parts = [_number(part.strip()) for part in value.split(",")]
        return parts if len(parts) > 1 or self.metavar == _NUMBERS else parts[0]

    def checked(self, value: Any) -> Any:
        """Return the value; ValueError for a switch that is not bool, or a text that is not str."""
        if not self.metavar and not isinstance(value, bool):
            raise ValueError(f"{self.name} must be true or false; got {value!r}")
        if self.text and not (isinstance(value, str) and value):
            raise ValueError(f"{self.name} must be a name; got {value!r}")
        return value


def _number(text: str) -> object:
    for kind in (int, float, complex):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def options_of(owner: Callable[..., object], *names: str) -> tuple[Option, ...]:
    """Return options for arguments of a class or a function, by default for all of them.

    Their names and defaults are those of the signature; their help is the first sentence about each
    argument in the docstring.

    Examples
    --------
    >>> options_of(ImpactChain, "restitution")[0].help
    'Coefficient of restitution in [0, 1]. (0.85)'
    """
    # Family defines __new__, whose signature has no arguments
    called: Any = vars(owner).get("__init__", owner)
    arguments, texts, found = inspect.signature(called).parameters, _texts(owner), []
    for name in names or [name for name in list(arguments)[1:] if name != "elements"]:
        default, kind = arguments[name].default, arguments[name].annotation
        shown = default not in (inspect.Parameter.empty, None, ()) and not isinstance(default, bool)
        words = texts.get(name, "") + (f" ({default})" if shown else "")
        found.append(Option(name, _metavar(inspect.formatannotation(kind).strip("'")), words))
    return tuple(found)


def _texts(owner: object) -> dict[str, str]:
    """Return the first sentences about arguments, by name, from a class and its base classes."""
    found: dict[str, str] = {}
    for each in getattr(owner, "__mro__", (owner,)):
        _, _, below = inspect.cleandoc(each.__doc__ or "").partition("Parameters\n----------\n")
        entries = re.findall(r"^(\w[\w, ]*) : .*\n((?: +.+\n?)*)", below.partition("\n\n")[0], re.M)
        for names, text in entries:
            first = re.split(r"(?<=\.) ", " ".join(text.replace("`", "").split()))[0]
            if first and not first.startswith("As for"):
                found = {**dict.fromkeys(names.split(", "), first), **found}
    return found


def _metavar(annotation: str) -> str:
    """Return the metavar of an annotation: that of the first kind which fits."""
    if annotation == "bool":
        return ""
    number = "COUNT" if annotation.startswith("int") else "X"
    kinds = {
        "PathLike": "FILE.h5",
        "str": "NAME",
        "tuple": f"{number}|{_NUMBERS}",
        "int": number,
        "float": number,
    }
    return next((name for kind, name in kinds.items() if kind in annotation), _NUMBERS)


MACHINE, START = options_of(ImpactChain), options_of(ImpactOscillator.state, *_START)
SYSTEM = (*MACHINE, *START)
"""Options of the chain and of its start."""

OBSERVABLE = Option("observable", "NAME,...", "observables of impacts to keep")


@final
class Asked(dict[str, Any]):
    """Values of options, by name; `typed` are the names on the command line."""

    typed: frozenset[str] = frozenset()

    @classmethod
    def of(cls, known: Iterable[Option], file: str | None, given: Mapping[str, object]) -> Asked:
        """Return the values; those on the command line override those in the file.

        Raises
        ------
        ValueError
            When the file cannot be read, is not TOML, or has an unknown key; when the value of a
            switch is not a bool, or that of a text not a str.
        """
        by_name = {option.name: option for option in known}
        options = {} if file is None else _read(Path(file), [*by_name, "elements"])
        forces = options.get("harmonic_forces")
        if isinstance(forces, list):  # TOML has no complex numbers
            options["harmonic_forces"] = [_number(x) if isinstance(x, str) else x for x in forces]
        elements = {"elements": _elements(options.pop("elements"))} if "elements" in options else {}
        direct = {
            name: option.parsed(given[name])
            for name, option in by_name.items()
            if given.get(name) is not None
        }
        if "values" in direct:
            options = {name: value for name, value in options.items() if name not in _RANGE}
        if any(name in direct for name in _RANGE):
            options.pop("values", None)
        checked = {name: by_name[name].checked(x) for name, x in {**options, **direct}.items()}
        if isinstance(checked.get("restitution"), dict):
            checked["restitution"] = _made("restitution", checked["restitution"], LAWS)
        asked = cls(checked | elements)
        asked.typed = frozenset(direct)
        return asked

    def only(self, *names: str) -> dict[str, Any]:
        """Return the values of some options, without those that were not given."""
        return {name: self[name] for name in names if name in self}

    def refuse(self, names: Iterable[str], why: str) -> None:
        """Raise when an option was given that does not fit other options.

        Raises
        ------
        ValueError
            When one of the names was given.
        """
        for name, value in self.only(*names).items():
            raise ValueError(f"{name} must not be given {why}; got {value!r}")

    def refuse_changing(self, names: Iterable[str], why: str) -> None:
        """Raise when a parameter that changes was given on the command line.

        The file of a machine may contain its value, which has no effect then.

        Raises
        ------
        ValueError
            When one of the names was given there.
        """
        self.refuse((name for name in names if name in self.typed), why)

    def chain(self, **swept: float) -> ImpactChain:
        """Return the chain; ValueError when the frequency is missing or a value is refused."""
        of_elements = {name: value for name, value in swept.items() if "." in name}
        known = (*(option.name for option in options_of(ImpactChain)), "elements")
        arguments = {**self.only(*known), **swept}
        if "frequency" not in arguments:
            raise ValueError("frequency must be given")
        own = {name: value for name, value in arguments.items() if name not in of_elements}
        return ImpactChain(**own).replace(**of_elements)

    def parameter(self, value: object, name: str = "parameter") -> str:
        """Return the name of a parameter of the chain; ValueError when it has none of this name."""
        some = ImpactChain(**{"frequency": 1.0, **self.only("masses", "elements", "restitution")})
        return one_of(name, value, some.parameters)

    def start(self, chain: ImpactChain) -> ImpactState | None:
        """Return the start, None for the default of the chain; ValueError when refused."""
        given = self.only(*_START)
        return chain.state(**given) if given else None

    def names(self, option: str, default: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
        """Return one or more names; ValueError when there are none, or one is unknown."""
        value = self.get(option, default)
        names = (value,) if isinstance(value, str) else value
        if not names or not _is_list(names) or not all(isinstance(x, str) and x for x in names):
            raise ValueError(f"{option} must be one or more names; got {value!r}")
        for name in names:
            one_of(option, name, known)
        return tuple(names)


def _read(file: Path, names: list[str]) -> dict[str, Any]:
    try:
        # some editors write a byte-order mark, which TOML does not allow
        found = tomllib.loads(file.read_bytes().decode("utf-8-sig"))
    except OSError as failure:
        raise ValueError(f"{file} cannot be read: {failure.strerror}") from failure
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as failure:
        raise ValueError(f"{file} must be a TOML file: {failure}") from failure
    except RecursionError as failure:
        raise ValueError(f"{file} must be a TOML file: it is nested too deeply") from failure
    for key in found:
        if key not in names:
            raise ValueError(f"{file} must hold only {', '.join(names)}; got {key!r}")
    return found


def _elements(given: object) -> tuple[Element, ...]:
    """Return the elements from tables with a key ``kind``; ValueError when one is refused."""
    if not (isinstance(given, list) and given):
        raise ValueError(f"elements must be tables [[elements]]; got {given!r}")
    return tuple(_made(f"elements[{k}]", table, ELEMENTS) for k, table in enumerate(given))


def _made(name: str, given: object, kinds: Mapping[str, Any]) -> Any:
    """Return the element or law that a table of a file describes; ValueError if it is refused."""
    if not isinstance(given, dict):
        raise ValueError(f"{name} must be a table with a kind; got {given!r}")
    numbers = dict(given)
    kind = kinds[one_of(f"{name}.kind", numbers.pop("kind", None), kinds)]
    fields = {key: entry for key, entry in kind.__dataclass_fields__.items() if key != "_"}
    for key in numbers:
        one_of(f"a key of {name}", key, fields)
    for key, entry in fields.items():
        if key not in numbers and entry.default is MISSING:
            raise ValueError(f"{name}.{key} must be given")
        if isinstance(numbers.get(key), dict):
            numbers[key] = _made(f"{name}.{key}", numbers[key], LAWS)
    try:
        return kind(**numbers)
    except ValueError as refusal:
        raise ValueError(f"{name}: {refusal}") from refusal


def values_of(options: Mapping[str, Any]) -> Array:
    """Return the values to sweep, (k,), from ``values``, or from ``from``, ``to`` and ``step``.

    The last value is included when a whole number of steps leads to it.

    Raises
    ------
    ValueError
        When they are missing, contradict each other, or are not finite.

    Examples
    --------
    >>> values_of({"from": 0.7, "to": 0.8, "step": 0.05}).tolist()
    [0.7, 0.75, 0.8]
    """
    if "values" in options:
        Asked(options).refuse(_RANGE, "together with values")
        given = options["values"]
        listed = finite_array("values", given if _is_list(given) else [given], (None,))
        if not len(listed):
            raise ValueError("values must hold at least one number; got none")
        return listed
    for name in _RANGE:
        if name not in options:
            raise ValueError(f"{name} must be given, or values")
    first, last, step = (finite_scalar(name, options[name]) for name in _RANGE)
    if step == 0.0 or (last - first) / step < 0.0:
        raise ValueError(f"step must lead from {first} to {last}; got {step}")
    # rounding must not lose the last value
    count = (last - first) / step + 1e-6
    if count >= _MOST_VALUES:
        raise ValueError(f"step must not give more than {_MOST_VALUES} values; got {step}")
    values: Array = first + step * np.arange(int(count) + 1.0)
    # 0.872, not 0.8720000000000001: steps such as 0.002 have no exact binary form
    short = np.round(values, 12)
    rounding = 4.0 * np.spacing(np.maximum(abs(values), abs(first)))
    return np.where(abs(short - values) <= rounding, short, values)


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple)
