"""Results of stores, with the system that the text entries of a store describe."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from typing import Any

import dynkit.systems
from dynkit.cli.options import ELEMENTS, LAWS
from dynkit.continuation.curves import BifurcationCurve
from dynkit.continuation.network import Network
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.results.solution_curve import SolutionCurve
from dynkit.core.no_motion import NoMotion
from dynkit.data import store
from dynkit.data.atomic_files import place
from dynkit.dynamics.attractor import MapAttractor
from dynkit.dynamics.equilibrium import equilibrium
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.map import Map
from dynkit.orbits.equations import ProblemSolution
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.periodic_orbit import periodic_orbit
from dynkit.sweeps.basins import Basins
from dynkit.sweeps.planes import ParameterMap
from dynkit.sweeps.sweeping import Sweep
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.driven_structure import OF_TABLE

_KINDS: Mapping[str, Any] = {kind._kind.KIND: kind for kind in (Sweep, ParameterMap)}
_SAVED: Mapping[str, Any] = {
    kind.__name__: kind for kind in (Branch, BifurcationCurve, Network, Basins)
}
_MOTIONS: Mapping[str, Any] = {
    kind.__name__: kind
    for kind in (ImpactRecord, ImpactAttractor, ImpactOrbit, MapAttractor, MapOrbit)
}
_LARGEST = 1 << 31
_MADE: Mapping[str, Callable[..., Any]] = {**ELEMENTS, **LAWS}
_CLOSING = re.compile(r"""('[^']*'|"[^"]*"|\([^(),'"]+(?<!e)[-+][^(),'"]+j\))|(?<=[^(,\s])\)""")
"""Pattern of quoted texts and complex numbers, and of closing brackets that follow neither "(" nor
a comma."""


def loaded(path: str) -> Any:
    """Return the result of a store, with its system where the store describes it.

    Raises
    ------
    ValueError
        When the file is missing, too large, damaged, or no store of a result that is shown.
    """
    file = place("store", path)
    if file.is_file() and file.stat().st_size > _LARGEST:
        size = file.stat().st_size / 1e9
        raise ValueError(f"results must be at most 2 GB; got {size:.1f} GB in {file}")
    archive = store.read(file)
    kind = archive.entries.get("kind", "")
    if not any(kind in known for known in (_KINDS, _SAVED, _MOTIONS)):
        raise ValueError(
            "results must be a store of a sweep, a map of two parameters, a branch, a curve of "
            "bifurcations, a network, basins, an attractor, a record or an orbit; "
            f"got {kind or 'no kind'} in {file}"
        )
    system = _system(file, archive)
    if kind in _MOTIONS:
        if system is None:
            name = archive.entries.get("system", "no system")
            raise ValueError(
                f"results must be a motion of a system of dynkit.systems; got one of {name}: in "
                f"Python, load it with its system by {kind}.load, and call its method view"
            )
        return _MOTIONS[kind].load(file, system)
    if kind in _KINDS:
        return _KINDS[kind].load(file, system)
    if kind == "Basins":
        return Basins.load(file, system)
    found: Any = _SAVED[kind].load(file)
    if system is None:
        return found
    if isinstance(found, SolutionCurve):
        orbit = _orbit(found, system)
        return found if orbit is None else _with_orbit(found, file, orbit)
    orbits = [_orbit(branch, system) for branch in found.branches]
    return Network.load(file, [orbit for orbit in orbits if orbit is not None])


def _with_orbit(curve: SolutionCurve, file: Any, orbit: ProblemSolution) -> SolutionCurve:
    try:
        return type(curve).load(file, orbit)
    except ValueError:  # the label is the same, but the equations are others
        return curve


def _orbit(curve: SolutionCurve, system: Any) -> ProblemSolution | None:
    """Return an orbit of a curve, solved for from its unknowns; None where that fails."""
    place = len(curve) // 2
    x = curve.unknowns[place]
    try:
        here = system.replace(**{name: float(p[place]) for name, p in curve._free.items()})
        if isinstance(here, Flow):
            return equilibrium(here, x)
        if not isinstance(here, ImpactMap):
            return periodic_orbit(here, x.reshape(-1, here.dimension))
        impacts, _, periods = curve.label[2:-1].partition(",")
        if impacts.isdigit() and not here.elements:
            found: ProblemSolution = here.periodic_orbit(
                phases=x[: int(impacts)], periods=int(periods)
            )
        else:
            found = here.attractor().periodic_orbit()
    except (NoConvergence, NoMotion, NotImplementedError, ValueError):
        return None
    return found if found.label == curve.label else None


def _system(file: Any, archive: store.Archive) -> Map | Any:
    """Return the system that the entries of a store describe; None where they do not."""
    entries = archive.entries
    name = entries.get("system", "").rpartition(".")[2]
    kind = getattr(dynkit.systems, name) if name in dir(dynkit.systems) else None
    if kind is None or f"{kind.__module__}.{kind.__qualname__}" != entries["system"]:
        return None
    known = {key.removeprefix("system."): text for key, text in entries.items() if "." in key}
    fields = [each.name for each in getattr(kind, "__dataclass_fields__", {}).values() if each.init]
    try:
        made = {field: _again(value_of(known[field])) for field in fields if field in known}
        if made.get("elements"):
            made = {field: value for field, value in made.items() if field not in OF_TABLE}
        elif "elements" in made:
            del made["elements"]
        system = kind(**made)
        store.refuse_other_system(file, archive, system)
    except (TypeError, ValueError, RecursionError):  # the last from deeply nested brackets
        return None
    return system


def _again(value: Any) -> Any:
    """Return a value with the elements and laws that texts in it describe."""
    if isinstance(value, tuple):
        return tuple(map(_again, value))
    described = isinstance(value, str) and value.partition("(")[0] in _MADE
    return value_of(value) if described else value


def value_of(text: str) -> Any:
    """Return the value of a text: a number, a text, a tuple, or an element with its arguments.

    A number may be complex.

    Raises
    ------
    ValueError
        When it is anything else.

    Examples
    --------
    >>> value_of("(1.5, 'above', (inf,))"), value_of("HardStop(2, offset=0.5)").offset
    ((1.5, 'above', (inf,)), 0.5)
    >>> value_of("((0.5-2j), 1j)"), value_of("((1+0j))"), value_of("(-1e-05j)")
    (((0.5-2j), 1j), ((1+0j),), ((-0-1e-05j),))
    """
    closed = _CLOSING.sub(lambda found: found[1] or ",)", text)  # "(1.0)" means a tuple
    try:
        return _read(ast.parse(closed, mode="eval").body)
    except SyntaxError as fault:
        raise ValueError(f"text must be one value; got {text!r}") from fault


def _read(node: ast.expr) -> Any:
    match node:
        case ast.Constant(bool() | int() | float() | complex() | str() | None as value):
            return value
        case ast.Name("inf" | "nan" as name):
            return float(name)
        case ast.UnaryOp(ast.USub(), operand):
            return -_read(operand)
        case ast.BinOp(left, ast.Add() | ast.Sub() as sign, ast.Constant(complex(imag=part))):
            return complex(_read(left), part if isinstance(sign, ast.Add) else -part)
        case ast.Tuple(parts):
            return tuple(map(_read, parts))
        case ast.Call(ast.Name(kind), parts, named) if kind in _MADE:
            own = {str(each.arg): _read(each.value) for each in named}
            return _MADE[kind](*map(_read, parts), **own)
    raise ValueError(f"text must be one value; got {ast.unparse(node)}")
