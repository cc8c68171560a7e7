"""Linear structures given by their energies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Hashable
from threading import RLock
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.overriding import Extensible, used_of, watching
from dynkit.core.parameters import cached_in, without_cached
from dynkit.core.reprs import Facts, Shown
from dynkit.core.user_code import reading_of
from dynkit.core.validation import Array, positive_integer
from dynkit.systems.structure.energies import quadratic_form, symbols
from dynkit.systems.structure.modes import Derivation, Modes
from dynkit.systems.structure.symmetric import SymmetricMatrix, check_definite, check_semidefinite

if TYPE_CHECKING:
    import sympy

# Limit on the elements of a matrix, summed over all cached derivations: about 160 MB.
_MOST_KEPT = 4_000_000

# Limit on the number of derivations: modes of machines with elements are kept with each, about
# half a MB.
_MOST = 64

# A table shows at most `_MODES` modes. It derives no modes for more than `_MASSES` masses.
_MODES, _MASSES = 5, 100


class LagrangianStructure(Extensible, Shown, ABC):
    """A linear structure M x'' + C x' + K x = f, given by its energies as SymPy expressions.

    A subclass must have:

    1. `degrees_of_freedom`, a property or a class attribute;
    2. ``kinetic(v)`` and ``potential(x)``, and ``dissipation(v)`` where there are losses. Each gets
       a tuple of real SymPy symbols, one per degree of freedom, and returns a quadratic form in
       them. The coordinates are measured from equilibrium. The coefficients are numbers, computed
       from the structure's own parameters;
    3. no attribute that changes: matrices and modes are derived once, at first access. A frozen
       dataclass is best.

    Equal structures share one derivation in each process. Two structures are equal when their
    classes and their fields are equal (or their attributes, if they are no dataclasses). Fields
    named in `structure_independent` may differ, unless an energy of this class uses them. A
    derivation is shared only if all fields are numbers, strings, arrays or tuples of these.

    For many bodies write long sums as ``sympy.Add(*terms)``: Python's ``sum`` takes quadratic time.

    Examples
    --------
    Two masses with a spring between them, the first one tied to the wall by a softer spring:

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Pair(LagrangianStructure):
    ...     soft: float
    ...     degrees_of_freedom = 2
    ...
    ...     def kinetic(self, v):
    ...         return (v[0] ** 2 + v[1] ** 2) / 2
    ...
    ...     def potential(self, x):
    ...         return self.soft * x[0] ** 2 / 2 + (x[1] - x[0]) ** 2 / 2
    >>> Pair(soft=0.5).stiffness
    array([[ 1.5, -1. ],
           [-1. ,  1. ]])
    >>> Pair(soft=0.5).modes.frequencies
    array([0.46821319, 1.51022396])
    """

    structure_independent: ClassVar[frozenset[str]] = frozenset()
    """Names of the fields that do not enter the energies, unless an energy of a subclass uses them.
    """

    @property
    @abstractmethod
    def degrees_of_freedom(self) -> int:
        """The number of coordinates, N."""

    @abstractmethod
    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        """Kinetic energy, a positive definite quadratic form in the N velocities."""

    @abstractmethod
    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        """Potential energy, a positive semidefinite quadratic form in the N coordinates.

        A constant is allowed: it has no effect.
        """

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:  # noqa: ARG002
        """Rayleigh's dissipation function D, half the power lost: the damping force is -dD/dv.

        It is a positive semidefinite quadratic form in the N velocities, zero by default.
        """
        from sympy import Integer

        return Integer(0)

    @property
    @final
    def mass(self) -> Array:
        """Mass matrix M, read-only, shape (N, N): second derivatives of the kinetic energy.

        Raises
        ------
        ValueError
            When an energy is not a quadratic form, or not definite as required. The message names
            the energy and the term. Every access to a matrix or to the modes can raise it.
        """
        return self._derivation.mass.dense

    @property
    @final
    def damping_matrix(self) -> Array:
        """Damping matrix C, read-only, shape (N, N): second derivatives of the dissipation."""
        return self._derivation.damping.dense

    @property
    @final
    def stiffness(self) -> Array:
        """Stiffness matrix K, read-only, shape (N, N): second derivatives of the potential."""
        return self._derivation.stiffness.dense

    @property
    @final
    def modes(self) -> Modes:
        """Normal modes, computed from the exact coefficients of the energies.

        A frequency is exactly 0 where the potential energy is singular up to double-double
        rounding. Rigid-body motions are recognised if springs are written as squares of
        differences.
        """
        return self._derivation.modes

    @cached_property
    def _derivation(self) -> Derivation:
        return shared_derivation(self)

    def _has_energies(self, *own: object) -> bool:
        """Whether kinetic, potential and dissipation are given functions, not others in place."""
        kind = type(self)
        return (kind.kinetic, kind.potential, kind.dissipation) == own

    def _matrices(self) -> tuple[SymmetricMatrix, ...]:
        """M, C and K: second derivatives of the energies, each element rounded once."""
        size = positive_integer("degrees_of_freedom", self.degrees_of_freedom)
        v, x = symbols("v", size), symbols("x", size)
        mass = quadratic_form("kinetic", self.kinetic(v), v)
        stiffness = quadratic_form("potential", self.potential(x), x)
        return mass, quadratic_form("dissipation", self.dissipation(v), v), stiffness

    def _derive(self) -> Derivation:
        mass, damping, stiffness = self._matrices()
        check_definite("the mass matrix of kinetic", mass.dense)
        check_semidefinite("the stiffness matrix of potential", stiffness.dense)
        check_semidefinite("the damping matrix of dissipation", damping.dense)
        return Derivation(mass, damping, stiffness, exact=True)

    def _facts(self) -> Facts:
        n = self.degrees_of_freedom
        facts: Facts = {**super()._facts(), "degrees of freedom": n}
        if n > _MASSES and "_derivation" not in vars(self):
            return facts
        try:
            modes = self.modes
        except ValueError as refusal:
            return {**facts, "modes": refusal}
        found = zip(modes.frequencies[:_MODES], modes.decay, strict=False)
        for k, (frequency, decay) in enumerate(found, start=1):
            ratio = f", damping ratio {decay / frequency:.4g}" if frequency else ", a rigid body"
            facts[f"mode {k}"] = f"natural frequency {frequency:.6g}{ratio}"
        return facts

    def __getstate__(self) -> dict[str, object]:
        return without_cached(self)


_Structure = TypeVar("_Structure", bound=LagrangianStructure)

_lock = RLock()


_kept: OrderedDict[Hashable, Derivation] = OrderedDict()
"""The last used derivations: one, or at most `_MOST` with `_MOST_KEPT` matrix elements."""


def shared_derivation(structure: LagrangianStructure) -> Derivation:
    """Return the derivation of a structure, which equal structures share."""
    key = _key(structure)
    with _lock:
        if key is None:
            return watched(structure)._derive()
        if key not in _kept:
            found = watched(structure)._derive()
            key = _key(structure)  # the used fields are known now
            _kept[key] = found
            while len(_kept) > 1 and (
                len(_kept) > _MOST or sum(d.mass.size**2 for d in _kept.values()) > _MOST_KEPT
            ):
                _kept.popitem(last=False)
        _kept.move_to_end(key)
        return _kept[key]


def share_derivation(one: LagrangianStructure, other: LagrangianStructure) -> bool:
    """Whether two structures have the same energies, even if no derivation is kept."""
    key = _key(one)
    return key is not None and key == _key(other)


def watched(structure: _Structure) -> _Structure:
    """Return the same structure, of a class that records the fields that energies use."""
    found: Any = object.__new__(watching(type(structure)))
    vars(found).update(without_cached(structure))
    return cast("_Structure", found)


def independent(kind: type[LagrangianStructure]) -> frozenset[str]:
    """Return the names of fields that no energy of a class has used so far."""
    return kind.structure_independent - used_of(kind)


def _key(structure: LagrangianStructure) -> Hashable | None:
    """Key that is equal for structures with the same energies; None if a field has no key."""
    kind = type(structure)
    # A dataclass's fields are among its attributes.
    used = sorted(vars(structure).keys() - independent(kind) - cached_in(kind))
    try:
        values = tuple((name, _frozen(getattr(structure, name))) for name in used)
    except TypeError:
        return None
    # The key holds the functions, since a method of a class can be replaced.
    return kind, kind.kinetic, kind.potential, kind.dissipation, reading_of(kind), values


def _frozen(value: object) -> Hashable:
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        return value
    if isinstance(value, tuple) and set(map(type, value)) == {float}:
        return value
    if isinstance(value, tuple):
        return tuple(map(_frozen, value))
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.dtype.str, value.shape, value.tobytes()
    raise TypeError
