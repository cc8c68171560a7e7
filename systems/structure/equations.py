"""Equations of motion from energies of any smooth form, by Lagrange's equations.

Numbers in the energies are replaced by symbols. Structures whose energies differ only in these
numbers share the derivatives, and the code compiled from them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.structure.energies import expression_of, shown, symbols
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import SymmetricMatrix, check_definite

if TYPE_CHECKING:
    import sympy

    from dynkit.systems.structure.lagrangian import LagrangianStructure

_KINETIC, _POTENTIAL, _DISSIPATION = "kinetic", "potential", "dissipation"
_ARGUMENTS = {
    _KINETIC: ("x", "v", "phase"),
    _POTENTIAL: ("x", "phase"),
    _DISSIPATION: ("x", "v", "phase"),
}
_GIVEN = {_KINETIC: "v", _POTENTIAL: "x", _DISSIPATION: "v"}

_SMALL = 64
"""Integers up to this, and fractions of such integers, are not replaced by symbols."""

_SMOOTH = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "erf"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
}
_MOST_KEPT = 64
"""Largest number of forms of energies whose derivatives are kept."""


@final
@dataclass(frozen=True, eq=False)
class Equations:
    """M(x, phase) x'' = f(x, x', phase), phase' = rate, as expressions with symbols for numbers.

    Attributes
    ----------
    x, v : (N,) symbols of coordinates and velocities
    phase, rate : symbols
    numbers : (p,) symbols of the numbers in the energies
    mass : (N, N) expressions, M
    force : (N,) expressions, f: the forces of the energies
    energy : expression, the Hamiltonian v dT/dv - T + V
    loss : expression, the power lost by dissipation
    source : expression, the rate of the energy due to the dependence on the phase
    text : the energies, with symbols for numbers
    """

    x: tuple[sympy.Symbol, ...]
    v: tuple[sympy.Symbol, ...]
    phase: sympy.Symbol
    rate: sympy.Symbol
    numbers: tuple[sympy.Symbol, ...]
    mass: tuple[tuple[sympy.Expr, ...], ...]
    force: tuple[sympy.Expr, ...]
    energy: sympy.Expr
    loss: sympy.Expr
    source: sympy.Expr
    text: str

    @property
    def size(self) -> int:
        """The number of coordinates, N."""
        return len(self.x)

    @cached_property
    def turns(self) -> bool:
        """Whether the energies depend on the phase."""
        parts = (*self.force, *(entry for row in self.mass for entry in row))
        return any(self.phase in part.free_symbols for part in parts)

    @cached_property
    def constant_mass(self) -> bool:
        """Whether the mass matrix depends on no coordinate and not on the phase."""
        moving = {*self.x, self.phase}
        return not any(moving & entry.free_symbols for row in self.mass for entry in row)

    @cached_property
    def inertia(self) -> Any:
        """Code that fills (N, N + 1) with M and, in the last column, f."""
        rows = zip(self.mass, self.force, strict=True)
        return self._code([entry for mass, force in rows for entry in (*mass, force)])

    @cached_property
    def mass_changes(self) -> Any:
        """Code that fills (N, N, N + 1 + p) with derivatives of M by x, phase and numbers."""
        by = (*self.x, self.phase, *self.numbers)
        return self._code([entry.diff(each) for row in self.mass for entry in row for each in by])

    @cached_property
    def tangent(self) -> Any:
        """Code that fills (N, 2 N) with the derivatives of f by x and by v."""
        return self._code(_jacobian(self.force, (*self.x, *self.v)))

    @cached_property
    def energies(self) -> Any:
        """Code that fills (3,) with the energy, the loss and the source."""
        return self._code([self.energy, self.loss, self.source])

    def _code(self, values: Sequence[sympy.Expr]) -> Any:
        from dynkit.systems.symbolic.machine_code import compiled

        given = (*self.x, *self.v, self.phase)
        return compiled("the energies", values, given, (*self.numbers, self.rate))


@final
class Motion:
    """Equations of motion with the numbers of one structure.

    Attributes
    ----------
    equations : Equations
    numbers : (p,) float
        Complex if they have imaginary changes.
    """

    def __init__(self, equations: Equations, numbers: Array) -> None:
        self.equations, self.numbers = equations, numbers

    @property
    def text(self) -> str:
        """The energies, for stores."""
        return f"{self.equations.text}, {self.numbers.tolist()}"

    def inertia(self, rate: float, x: Array, v: Array, phase: float) -> tuple[Array, Array]:
        """M, (N, N), and f, (N,), at positions and velocities (N,)."""
        n = len(x)
        found = self._filled("inertia", rate, x, v, phase, (n, n + 1))
        return found[:, :n], found[:, n]

    def mass(self, x: Array, phase: Any) -> Array:
        """M, (N, N), at positions (N,) and a phase.

        Positions, phase and numbers may have imaginary changes: see
        `dynkit.core.differences.STEP`.
        """
        n, changes = len(x), np.concatenate([x, [phase], self.numbers])
        given = 0.0, changes[:n].real, np.zeros(n), float(changes[n].real)
        found = self._filled("inertia", *given, (n, n + 1))[:, :n]
        if not np.iscomplexobj(changes):
            return found
        by = self._filled("mass_changes", *given, (n, n, len(changes)))
        return np.asarray(found + 1j * (by @ changes.imag))

    def tangent(self, rate: float, x: Array, v: Array, phase: float) -> tuple[Array, Array]:
        """Derivatives (N, N) of f by positions and by velocities."""
        n = len(x)
        found = self._filled("tangent", rate, x, v, phase, (n, 2 * n))
        return found[:, :n], found[:, n:]

    def energies(self, rate: float, x: Array, v: Array, phase: float) -> Array:
        """Energy, power lost, and power gained by the dependence on the phase: (3,)."""
        return self._filled("energies", rate, x, v, phase, (3,))

    def shifts(self, rate: float) -> tuple[Array, Array]:
        """Directions (N, m) along which mass and force are constant, and derivatives (N, N) of f.

        Candidates are integer directions along which no force changes at some states. Derivatives
        of the expressions prove that mass and force are constant along them. Without a proof m is
        0. The derivatives of f are those by v.
        """
        from scipy.linalg import null_space

        n, random = self.equations.size, np.random.default_rng(0)
        states, found = random.uniform(-1.0, 1.0, (_STATES, 2, n)), []
        with np.errstate(all="ignore"):
            found = [self.tangent(rate, x, v, 0.1 * k) for k, (x, v) in enumerate(states)]
        free, by_x = np.zeros((n, 0)), np.concatenate([each for each, _ in found])
        if np.isfinite(by_x).all() and (free := null_space(by_x, rcond=_UNSEEN)).size:
            free = in_echelon(free)
            whole = np.rint(free)
            proved = abs(free - whole).max() < _UNSEEN and all(
                _is_shift(self.equations, tuple(map(int, d))) for d in whole.T
            )
            free = whole[:, : whole.shape[1] * proved]
        return np.asarray(free), found[0][1]

    def _filled(
        self, code: str, rate: float, x: Array, v: Array, phase: float, shape: tuple[int, ...]
    ) -> Array:
        from dynkit.systems.symbolic import kernels

        out, parameters = np.empty(shape), np.append(self.numbers.real, rate)
        state = np.concatenate([x, v, [phase]])
        kernels.apply(getattr(self.equations, code).address, state, parameters, out)
        return out


_STATES, _UNSEEN = 3, 1e-10
"""Number of states at which shifts are sought; relative change of forces that counts as none."""


@lru_cache(_MOST_KEPT)
def _is_shift(equations: Equations, direction: tuple[int, ...]) -> bool:
    """Whether the mass matrix and all forces are constant along a direction of the coordinates."""
    from sympy import Add, expand

    pairs = list(zip(direction, equations.x, strict=True))
    parts = (*equations.force, *(entry for row in equations.mass for entry in row))
    return all(expand(Add(*(d * part.diff(x) for d, x in pairs if d))) == 0 for part in parts)


def in_echelon(directions: Array) -> Array:
    """Basis (N, m) of the same span: each direction has a coordinate 1 that is 0 in all others."""
    from scipy.linalg import qr

    own = qr(directions.T, mode="r", pivoting=True)[1][: directions.shape[1]]
    return np.asarray(directions @ np.linalg.inv(directions[own]))


def has_arguments_of_its_own(structure: LagrangianStructure) -> bool:
    """Whether an energy takes more arguments than those of a linear structure.

    These are the velocities of kinetic energy and dissipation, and the coordinates of the
    potential.

    Raises
    ------
    TypeError
        When an energy has an argument of an unknown name.
    """
    return any(_arguments(structure, name) != (own,) for name, own in _GIVEN.items())


def motion_of(structure: LagrangianStructure, size: int) -> Motion:
    """Derive the equations of motion of a structure from its energies.

    Raises
    ------
    ValueError
        Naming the energy: when an expression holds other symbols, is not finite, real or smooth, or
        when the kinetic energy is not quadratic in the velocities.
    TypeError
        When an energy has an argument of an unknown name.
    """
    from sympy import Symbol

    given: dict[str, Any] = {
        "x": symbols("x", size),
        "v": symbols("v", size),
        "phase": Symbol("phase", real=True),
    }
    found = []
    for name in _GIVEN:
        taken = _arguments(structure, name)
        expression = getattr(structure, name)(*(given[each] for each in taken))
        allowed = {"phase": {given["phase"]}} | {k: set(given[k]) for k in ("x", "v")}
        found.append(checked(name, expression, set().union(*(allowed[each] for each in taken))))
    numbers: dict[Any, Any] = {}
    forms = tuple(form_of(each, numbers) for each in found)
    equations = _equations(size, forms, tuple(numbers.values()))
    return Motion(equations, np.array([float(value) for value in numbers]))


@lru_cache(_MOST_KEPT)
def _equations(
    size: int, forms: tuple[sympy.Expr, ...], numbers: tuple[sympy.Symbol, ...]
) -> Equations:
    from sympy import Add, Symbol

    x, v = symbols("x", size), symbols("v", size)
    phase, rate = Symbol("phase", real=True), Symbol("rate", real=True)
    kinetic, potential, dissipation = forms
    momentum = gradient(kinetic, v)
    mass = tuple(tuple(row) for row in _rows(_jacobian(momentum, v), size))
    for entry in (entry for row in mass for entry in row):
        if entry.free_symbols & set(v):
            raise ValueError(
                f"kinetic must be at most quadratic in the velocities; the mass matrix holds "
                f"{shown(entry)}"
            )
    by_x, pull = gradient(kinetic, x), gradient(potential, x)
    drag = gradient(dissipation, v)
    carried = _rows(_jacobian(momentum, (*x, phase)), size + 1)
    forces = []
    for i in range(size):
        moved = [term * speed for term, speed in zip(carried[i], (*v, rate), strict=True)]
        forces.append(Add(by_x[i], -pull[i], -drag[i], *(-term for term in moved)))
    loss = Add(*(force * speed for force, speed in zip(drag, v, strict=True)))
    # H = v dT/dv - T + V changes by the forces and by its own dependence on the phase.
    source = rate * (potential - kinetic).diff(phase)
    energy = Add(*(p * u for p, u in zip(momentum, v, strict=True)), -kinetic, potential)
    rest = energy, loss, source, str(forms)
    return Equations(x, v, phase, rate, numbers, mass, tuple(forces), *rest)


def gradient(expression: sympy.Expr, by: Sequence[sympy.Symbol]) -> list[sympy.Expr]:
    """Derivatives of an expression, term by term: each term by the symbols that it contains."""
    from sympy import Add

    parts: dict[Any, list[Any]] = {symbol: [] for symbol in by}
    for term in Add.make_args(expression):
        for symbol in term.free_symbols:
            if symbol in parts:
                parts[symbol].append(term.diff(symbol))
    return [Add(*parts[symbol]) for symbol in by]


def _jacobian(expressions: Iterable[sympy.Expr], by: Sequence[sympy.Symbol]) -> list[sympy.Expr]:
    return [entry for expression in expressions for entry in gradient(expression, by)]


def _rows(flat: list[sympy.Expr], width: int) -> list[list[sympy.Expr]]:
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def _arguments(structure: LagrangianStructure, name: str) -> tuple[str, ...]:
    """Names of the arguments of an energy; a single argument may have any name."""
    function: Callable[..., Any] = getattr(structure, name)
    names = tuple(inspect.signature(function).parameters)
    if len(names) == 1:
        return (_GIVEN[name],)
    known = _ARGUMENTS[name]
    for given in names:
        if given not in known:
            listed = ", ".join(known)
            raise TypeError(f"{name} must take arguments among {listed}; got {given}")
    return names


def checked(name: str, given: object, known: set[sympy.Symbol]) -> sympy.Expr:
    """Return the result of a method as an expression, after a check.

    Raises
    ------
    ValueError
        Naming the method: when the result is not smooth, finite and real, or has other symbols than
        the known ones.
    """
    from sympy import I, nan, oo, zoo
    from sympy.core.function import Application

    expression = expression_of(name, given)
    if expression.has(nan, oo, -oo, zoo, I):
        raise ValueError(f"{name} must be finite and real; got {shown(expression)}")
    for symbol in sorted(expression.free_symbols - known, key=str)[:1]:
        names = ", ".join(sorted(map(str, known))[:3])
        raise ValueError(f"{name} must be an expression in {names}, ...; got {symbol}")
    for call in sorted(expression.atoms(Application), key=str):
        if type(call).__name__ not in _SMOOTH:
            raise ValueError(
                f"{name} must be made of smooth functions; got {shown(call)}. SoftStop, HardStop "
                "and DryFriction are elements"
            )
    return expression


def form_of(expression: Any, numbers: dict[Any, Any]) -> Any:
    """Replace each number of an expression by a symbol; `numbers` gets these symbols, in place."""
    from sympy import Add, Symbol

    if expression.is_Number:
        small = expression.is_Rational and max(abs(expression.p), expression.q) <= _SMALL
        if small:
            return expression
        if expression not in numbers:
            numbers[expression] = Symbol(f"p_{len(numbers)}", real=True)
        return numbers[expression]
    if expression.is_Add:
        # The order of SymPy's terms depends on their numbers.
        terms = [term.as_coeff_Mul() for term in expression.args]
        terms.sort(key=lambda term: term[1].sort_key())
        return Add(*(form_of(number, numbers) * form_of(rest, numbers) for number, rest in terms))
    if expression.is_Pow:
        base, exponent = expression.args
        if exponent.is_Number:
            return form_of(base, numbers) ** exponent
    if not expression.args:
        return expression
    return expression.func(*(form_of(part, numbers) for part in expression.args))


def derivation_of(structure: LagrangianStructure, size: int) -> Derivation:
    """Return the equations of motion, and the matrices of small oscillations about zero.

    Raises
    ------
    ValueError, TypeError
        As `motion_of`; and when the energies are not finite at zero, or the mass matrix is not
        positive definite there.
    """
    motion, zero = motion_of(structure, size), np.zeros(size)
    with np.errstate(all="ignore"):
        mass, force = motion.inertia(0.0, zero, zero, 0.0)
        by_x, by_v = motion.tangent(0.0, zero, zero, 0.0)
    for name, part in (("kinetic", mass), ("potential", np.append(force, by_x))):
        if not np.isfinite(part).all():
            raise ValueError(
                f"{name} must be smooth at zero, from where coordinates are measured; "
                "its derivatives are infinite there"
            )
    check_definite("the mass matrix of kinetic at zero", mass)
    parts = (0.5 * (part + part.T) for part in (mass, -by_v, -by_x))
    m, c, k = map(SymmetricMatrix.from_dense, parts)
    return Derivation(m, c, k, exact=False, motion=motion)


def small_oscillations(mass: Array, stiffness: Array) -> Array:
    """Mass-normalised modal matrix, (N, N), of a stiffness that need not be semidefinite."""
    from scipy.linalg import eigh

    _, matrix = eigh(stiffness, mass)
    return np.asarray(matrix * np.where(matrix[-1] < 0.0, -1.0, 1.0))
