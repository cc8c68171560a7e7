"""Options of a run: from the command line, from a TOML file, or from both."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dynkit.core.validation import finite_array, finite_scalar

if TYPE_CHECKING:
    from dynkit.core.validation import Array
    from dynkit.systems.impact.chain import ImpactChain

Options: TypeAlias = dict[str, Any]

# More values than this were not meant.
_MOST_VALUES = 1_000_000


@dataclass(frozen=True)
class Option:
    """One option: its name on the command line and in a file, and its help."""

    name: str
    metavar: str
    help: str
    kind: str = "numbers"  # or "text", or "switch"


CHAIN = (
    Option("masses", "N|M1,M2,...", "how many unit masses, or the masses themselves (10)"),
    Option("springs", "K|K1,K2,...", "spring constants, from the wall outwards (1)"),
    Option("damping", "G|C1,C2,...", "dashpots, a multiple of the springs; or each (0.1)"),
    Option("restitution", "R", "coefficient of restitution, in [0, 1] (0.85)"),
    Option("amplitude", "A", "of the table (0.1)"),
    Option("offset", "A0", "of the table (0)"),
    Option("frequency", "W", "angular frequency of the table"),
)
_TRANSIENT = Option("transient", "COUNT", "impacts to skip (700)")
_OBSERVABLE = "NAME[,NAME...]"

SIMULATE = (
    *CHAIN,
    _TRANSIENT,
    Option("impacts", "COUNT", "impacts to keep (100)"),
    Option("position", "X1,X2,...", "of the masses, to start from (the first mode)"),
    Option("velocity", "V1,V2,...", "of the masses, to start from (0)"),
    Option("phase", "PHASE", "of the table, to start from (0)"),
    Option(
        "observable",
        _OBSERVABLE,
        "among time, phase, relative_velocity, energy, position, velocity (the first four)",
    ),
    Option("out", "FILE", "file to write: .csv, .npz, .h5, .png or .svg", kind="text"),
)
SWEEP = (
    *CHAIN,
    Option("parameter", "NAME", "what to sweep (frequency)", kind="text"),
    Option("from", "VALUE", "first value"),
    Option("to", "VALUE", "last value"),
    Option("step", "STEP", "from one value to the next; may be negative"),
    Option("values", "V1,V2,...", "the values themselves, instead of --from, --to, --step"),
    _TRANSIENT,
    Option("keep", "COUNT", "impacts to keep at each value (100)"),
    Option("observable", _OBSERVABLE, "what to keep (relative_velocity)"),
    Option("labels", "", "say of each value what motion it is, P(1,3) or so (yes)", kind="switch"),
    Option("error", "", "estimate the error at each value, by three more runs (no)", kind="switch"),
    Option("progress", "", "show how far it is (yes)", kind="switch"),
    Option("store", "FILE.h5", "keep what is finished here, and resume from it", kind="text"),
    Option("out", "FILE", "file to write: .csv, .npz, .h5, .png or .svg", kind="text"),
)
CONTINUE = (
    *CHAIN,
    Option("impacts", "N", "to start from an orbit P(N,M) (1), instead of the attractor's"),
    Option("periods", "M", "of the table in that orbit (1)"),
    Option("transient", "COUNT", "impacts to skip to the attractor (700)"),
    Option("parameter", "NAME", "what changes along the branch (frequency)", kind="text"),
    Option("from", "VALUE", "its least value"),
    Option("to", "VALUE", "its greatest value"),
    Option("store", "FILE.h5", "keep the branch here; dynkit.Branch.load reads it", kind="text"),
    Option("out", "FILE", "figure to write: .png or .svg", kind="text"),
)
MAP = (
    *CHAIN,
    Option("x", "NAME,FROM,TO,COUNT", "parameter along x, and its values"),
    Option("y", "NAME,FROM,TO,COUNT", "parameter along y, and its values"),
    _TRANSIENT,
    Option("keep", "COUNT", "impacts to keep at each pair (100)"),
    Option("workers", "COUNT", "processes that simulate (1)"),
    Option("progress", "", "show how far it is (yes)", kind="switch"),
    Option("store", "FILE.h5", "keep what is finished here, and resume from it", kind="text"),
    Option("out", "FILE", "file to write: .csv, .npz, .h5, .png or .svg", kind="text"),
)
_RANGE = ("from", "to", "step")


def gather(known: Sequence[Option], file: str | None, given: Mapping[str, object]) -> Options:
    """Return what was asked for, by name; what was given goes before what stands in the file.

    Raises
    ------
    ValueError
        When the file cannot be read, is not TOML, or holds an unknown key.
    """
    names = [option.name for option in known]
    options = {} if file is None else _read(Path(file), names)
    asked = {
        option.name: _parsed(given[option.name], option)
        for option in known
        if given.get(option.name) is not None
    }
    if "values" in asked:
        options = {name: value for name, value in options.items() if name not in _RANGE}
    if any(name in asked for name in _RANGE):
        options.pop("values", None)
    return {**options, **asked}


def _read(file: Path, names: Sequence[str]) -> Options:
    try:
        # a byte-order mark, as some editors write, is no part of the text
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


def _parsed(value: object, option: Option) -> object:
    """Return what a text on the command line stands for, as TOML would have it."""
    if option.kind == "text" or not isinstance(value, str):
        return value
    parts = [_number(part.strip()) for part in value.split(",")]
    return parts if len(parts) > 1 else parts[0]


def _number(text: str) -> object:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def chain_of(options: Options) -> ImpactChain:
    """Return the chain that the options describe.

    Raises
    ------
    ValueError
        When the frequency is missing or a value is refused.
    """
    from dynkit.systems.impact.chain import ImpactChain

    arguments = {option.name: options[option.name] for option in CHAIN if option.name in options}
    if "frequency" not in arguments:
        raise ValueError("frequency must be given")
    return ImpactChain(**arguments)


def names_of(options: Options, name: str, default: tuple[str, ...]) -> tuple[str, ...]:
    """Return one or more names, given as a text or as a list of texts.

    Raises
    ------
    ValueError
        When there are none, or they are no texts.
    """
    value = options.get(name, default)
    names = (value,) if isinstance(value, str) else tuple(value) if _is_list(value) else ()
    if not names or not all(isinstance(each, str) and each for each in names):
        raise ValueError(f"{name} must be one or more names; got {value!r}")
    return names


def text_of(options: Options, name: str, default: str | None = None) -> str | None:
    """Return a text.

    Raises
    ------
    ValueError
        When it is none.
    """
    value = options.get(name, default)
    if value is not None and not (isinstance(value, str) and value):
        raise ValueError(f"{name} must be a name; got {value!r}")
    return value


def switch_of(options: Options, name: str, *, default: bool) -> bool:
    """Return true or false.

    Raises
    ------
    ValueError
        When it is neither.
    """
    value = options.get(name, default)
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false; got {value!r}")
    return value


def values_of(options: Options) -> Array:
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
    import numpy as np

    if "values" in options:
        for name in _RANGE:
            if name in options:
                raise ValueError(f"{name} must not be given beside values; got {options[name]!r}")
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
    # a last step that is short by rounding only is a whole one
    count = (last - first) / step + 1e-6
    if count >= _MOST_VALUES:
        raise ValueError(f"step must not give more than {_MOST_VALUES} values; got {step}")
    values: Array = first + step * np.arange(int(count) + 1.0)
    # steps such as 0.002 have no exact binary form: 0.872, not 0.8720000000000001
    short = np.round(values, 12)
    rounding = 4.0 * np.spacing(np.maximum(abs(values), abs(first)))
    return np.where(abs(short - values) <= rounding, short, values)


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple)
