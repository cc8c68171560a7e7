"""Impact laws: the coefficient of restitution as a function of the approach velocity."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.overriding import Extensible
from dynkit.core.validation import Array, check_fields, finite_scalar, in_interval, non_negative

if TYPE_CHECKING:
    from dynkit.systems.impact.elements.law_programs import Program

JUMP = 2.0**-40
"""Relative half-width of the velocity interval in which `ImpactLaw.jumps` looks for a jump."""

_SLOW, _ELASTIC = 1e-300, 1e-6
"""Velocity at which r is taken as its limit r(0+), and the distance |r - 1| below which this limit
counts as 1."""


@dataclass(frozen=True)
class ImpactLaw(Extensible, ABC):
    """Restitution r(u) as a function of the approach velocity u > 0 of an impact.

    A subclass is a frozen dataclass whose fields are numbers. It must implement only `expression`:
    the reset of an impact, the slope d(r u)/du for tangent vectors, and the end of chatter are
    derived from that expression. It may override `tail`.

    The fields are parameters of the machine, such as ``"table.restitution.velocity"``. A change of
    a value needs no new compilation; a new law compiles in milliseconds.

    Raises
    ------
    ValueError
        When a field is not a finite number. During a simulation, when r(u) of an impact is not in
        [0, 1].

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from dynkit.systems import ImpactChain, ImpactLaw
    >>> @dataclass(frozen=True)
    ... class Softening(ImpactLaw):
    ...     largest: float = 0.9
    ...     velocity: float = 0.5
    ...     def expression(self, velocity):
    ...         return self.largest / (1 + velocity / self.velocity)
    >>> law = Softening()
    >>> law.at([0.0, 0.5])
    array([0.9 , 0.45])
    >>> chain = ImpactChain(frequency=0.87, restitution=law)
    >>> print(chain.replace(**{"restitution.velocity": 2.0}).attractor().label)
    P(1,3)
    """

    _following: ClassVar[Mapping[str, tuple[str, ...]]] = {"tail": ("expression",)}

    def __post_init__(self) -> None:
        check_fields(self, **dict.fromkeys(self.numbers, finite_scalar))

    @abstractmethod
    def expression(self, velocity: Any) -> Any:
        """Return r as a SymPy expression of the approach velocity, a positive symbol.

        It may contain the functions of a `SymbolicMap`: sums, products, powers, exp, log, sin, cos,
        tanh, erf and others, Abs, Min, Max and Piecewise.
        """

    @property
    def tail(self) -> tuple[float, float, float, float, float]:
        """Asymptotic restitution of slow impacts: (r(0+), C, p, E, q).

        If r(0+) = 1, the law is 1 - C u^p + E u^q + ... with p < q, and chatter ends for p < 1.
        Then C = 0 means that chatter does not end, that p is less than 0.1, or that 1 - r is not a
        power of u; in these cases no chatter is cut short, and all its bounces are simulated.
        """
        from dynkit.systems.impact.elements.law_programs import tail_of

        slowest = float(self._values(np.array([_SLOW]))[0])
        if abs(slowest - 1.0) > _ELASTIC:
            return slowest, 0.0, 0.0, 0.0, 0.0
        return tail_of(self._given, self._velocity)

    @property
    @final
    def numbers(self) -> Mapping[str, float]:
        """Parameters of the law, by the names of its fields."""
        return {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}

    @final
    def at(self, velocities: object) -> Array:
        """Restitution at approach velocities, an array of any shape.

        Raises
        ------
        ValueError
            When the restitution is not in [0, 1].
        """
        asked = np.asarray(velocities, dtype=float)
        found = self._values(asked)
        for k in np.flatnonzero(~((found >= 0.0) & (found <= 1.0)))[:1].tolist():
            raise ValueError(
                f"restitution must lie in [0, 1]; got {found.flat[k]} by {self!r} at the approach "
                f"velocity {asked.flat[k]}"
            )
        return found

    @final
    def slope(self, velocities: Array) -> Array:
        """Derivative of the rebound velocity r(u) u at approach velocities."""
        return _evaluated(self._slope_program, velocities)

    @final
    def approach(self, velocities: Array, rebounds: Array) -> Array:
        """Approach velocities (n,), made more accurate by the known rebound velocities (n,).

        A small approach velocity has lost digits by cancellation; the rebound velocity has not. One
        Newton step corrects the former, if the step is less than a thousandth of the velocity.
        """
        u: Array = np.maximum(velocities, np.finfo(float).tiny)
        slope = self.slope(u)
        with np.errstate(divide="ignore", invalid="ignore"):
            change = (rebounds - self._values(u) * u) / slope
        return np.where(abs(change) < 1e-3 * u, u + change, u)

    @final
    def jumps(self, velocity: float) -> bool:
        """Whether the rebound velocity is discontinuous at a velocity, to within rounding."""
        around = velocity * np.array([1.0 - JUMP, 1.0 + JUMP])
        below, above = self._values(around) * around
        change = above - below - float(self.slope(np.array([velocity]))[0]) * np.diff(around)[0]
        return bool(not abs(change) <= 0.5 * JUMP**0.5 * velocity)

    @final
    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Velocities at which the law jumps, ascending: constants c of conditions such as u < c."""
        return tuple(sorted(set(self._conditions.values())))

    @final
    def piece(self, velocity: float) -> int:
        """Number of the interval between `breaks` that contains a velocity."""
        return bisect_right(self.breaks, velocity)

    @final
    def continued(self, piece: int, velocities: Array) -> tuple[Array, Array]:
        """Restitution and slope of the rebound velocity, continued from one interval to others."""
        value, slope = self._pieces[piece]
        return _evaluated(value, velocities), _evaluated(slope, velocities)

    @final
    def bounces(self, velocities: Array) -> Array:
        """Sum of the velocities of a bounce and of all later ones, divided by its own velocity.

        Infinite if the bounces never end.
        """
        from dynkit.systems.impact.elements.law_kernels import sum_all

        (code, numbers), found = self._program, np.empty(velocities.shape)
        own = code.address, numbers, np.array(self.tail, dtype=float)
        sum_all(*own, velocities.ravel(), np.empty(1), found.reshape(-1))
        return found

    @final
    @cached_property
    def _program(self) -> Program:
        """Program of the restitution for the kernels, see `law_kernels`."""
        from dynkit.systems.impact.elements.law_programs import program_of

        return program_of(self._given, self._velocity)

    @cached_property
    def _slope_program(self) -> Program:
        from dynkit.systems.impact.elements.law_programs import slope_of

        return slope_of(self._given, self._velocity)

    @cached_property
    def _conditions(self) -> dict[Any, float]:
        """Conditions on the velocity at which the law jumps, each with its velocity."""
        from sympy.core.relational import Relational

        found = {}
        for condition in self._given.atoms(Relational):
            bounds = [side for side in condition.args if side != self._velocity]
            if len(bounds) == 1 and bounds[0].is_number and self.jumps(float(bounds[0])):
                found[condition] = float(bounds[0])
        return found

    @cached_property
    def _pieces(self) -> list[tuple[Program, Program]]:
        """Programs of the restitution and of the slope, for each interval between `breaks`."""
        from dynkit.systems.impact.elements.law_programs import program_of, slope_of

        edges, u, found = (0.0, *self.breaks), self._velocity, []
        for k, low in enumerate(edges):
            inside = 0.5 * (low + edges[k + 1]) if k + 1 < len(edges) else 2.0 * low + 1.0
            own = self._given.xreplace({c: c.subs(u, inside) for c in self._conditions})
            found.append((program_of(own, u), slope_of(own, u)))
        return found

    @cached_property
    def _velocity(self) -> Any:
        from sympy import Symbol

        return Symbol("u", positive=True)

    @cached_property
    def _given(self) -> Any:
        from dynkit.systems.impact.elements.law_programs import checked

        return checked(self.expression(self._velocity), self._velocity)

    def _values(self, velocities: Array) -> Array:
        return _evaluated(self._program, velocities)

    def __getstate__(self) -> dict[str, object]:
        return dict(self.numbers)


Restitution: TypeAlias = float | ImpactLaw


@final
@dataclass(frozen=True)
class PlasticBelow(ImpactLaw):
    """No rebound below a velocity, constant restitution above it.

    Slow impacts end in contact at once. The law jumps at this velocity: the outcome of an impact at
    it, to within rounding, is uncertain; the `error` is then large, and derivatives are refused.

    Parameters
    ----------
    velocity : float
        Smallest approach velocity with a rebound, not negative.
    rebound : float
        Coefficient of restitution of faster impacts, in [0, 1].

    Examples
    --------
    >>> from dynkit.systems import ImpactChain, PlasticBelow
    >>> chain = ImpactChain(frequency=0.4, restitution=PlasticBelow(0.05, rebound=0.85))
    >>> chain.simulate(impacts=100).events
    <Events: 100 impacts, 25 contacts, 25 releases>
    """

    velocity: float
    rebound: float = 0.85

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", non_negative("velocity", self.velocity))
        object.__setattr__(self, "rebound", in_interval("rebound", self.rebound, 0, 1))

    def expression(self, velocity: Any) -> Any:
        from sympy import Float, Integer, Lt, Piecewise

        # evaluate=False: SymPy takes milliseconds to find that it cannot decide the condition
        slow = Integer(0), Lt(velocity, self.velocity, evaluate=False)
        return Piecewise(slow, (Float(self.rebound), True), evaluate=False)


@final
@dataclass(frozen=True)
class ViscoelasticSpheres(ImpactLaw):
    """Restitution max(0, 1 - C u^(1/5) + C_2 u^(2/5)) of viscoelastic spheres.

    Slow impacts are elastic, r(0+) = 1, and yet chatter ends: at a contact acceleration a, after a
    time of about (5/2) u^(4/5) / (a C). The series is valid for small C u^(1/5). Where it is
    negative, the restitution is zero; with C_2 = 0 this holds for all fast impacts.

    Parameters
    ----------
    dissipation : float
        C, not negative.
    second : float
        C_2, not negative; for spheres it is 3/5 C^2.

    References
    ----------
    T. Schwager, T. Poeschel, Coefficient of normal restitution of viscous particles and cooling
    rate of granular gases, Physical Review E 57 (1998) 650-654. R. Ramirez, T. Poeschel, N. V.
    Brilliantov, T. Schwager, Coefficient of restitution of colliding viscoelastic spheres, Physical
    Review E 60 (1999) 4465-4472.

    Examples
    --------
    >>> from dynkit.systems import BouncingBall, ViscoelasticSpheres
    >>> ball = BouncingBall(frequency=3.0, restitution=ViscoelasticSpheres(0.3), amplitude=0.0)
    >>> ball.simulate(impacts=1000).ending.value
    'the mass stays on the stop for ever'
    """

    dissipation: float
    second: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self, **dict.fromkeys(self.numbers, non_negative))

    def expression(self, velocity: Any) -> Any:
        from sympy import Max, Rational

        root = velocity ** Rational(1, 5)
        return Max(0, 1 - self.dissipation * root + self.second * root**2, evaluate=False)

    @property
    def tail(self) -> tuple[float, float, float, float, float]:
        return 1.0, self.dissipation, 0.2, self.second, 0.4


def checked_restitution(name: str, given: Any) -> Restitution:
    """Return a coefficient in [0, 1] or a law; ValueError for anything else."""
    if isinstance(given, ImpactLaw):
        return given
    return in_interval(name, given, 0, 1)


def law_text(restitution: Restitution) -> str:
    """Text that identifies a law in stored results; empty for a number."""
    if not isinstance(restitution, ImpactLaw):
        return ""
    return f"{restitution!r}: {restitution._given}"


def rebound(restitution: Restitution, rates: Array) -> tuple[Any, Any]:
    """Restitution and slope of the rebound velocity, at rates (n,) of the gap before impacts.

    With a law, both are zero where the rate is not negative, as at a grazing contact.
    """
    if not isinstance(restitution, ImpactLaw):
        return restitution, restitution
    found, hit = np.zeros((2, len(rates))), rates < 0.0
    found[:, hit] = restitution.at(-rates[hit]), restitution.slope(-rates[hit])
    return found[0], found[1]


def share(restitution: Restitution, speeds: Array) -> Any:
    """Speed of each bounce (n,), divided by the sum of its own and all later speeds."""
    if isinstance(restitution, ImpactLaw):
        return 1.0 / restitution.bounces(speeds)
    return 1.0 - restitution


def _evaluated(program: Program, velocities: Array) -> Array:
    from dynkit.systems.symbolic.kernels import apply_all

    asked = np.ascontiguousarray(velocities, dtype=float).reshape(-1, 1)
    found = np.empty(asked.shape)
    apply_all(program.code.address, asked, program.numbers, found)
    return found.reshape(np.shape(velocities))
