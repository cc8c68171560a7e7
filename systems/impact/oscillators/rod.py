"""A uniform elastic rod whose end hits a stop: the limit of chains of many masses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    check_fields,
    finite_array,
    finite_scalar,
    non_negative,
    of_type,
    positive,
    positive_integer,
    within_memory,
)
from dynkit.systems.impact.elements.element import Element, EventKind
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import Motion
from dynkit.systems.structure.double_double import two_product
from dynkit.systems.structure.modes import Derivation
from dynkit.systems.structure.symmetric import SymmetricMatrix

_LARGEST = 1e30
"""Largest frequency, node distance and mass of a rod; the smallest is the reciprocal of this."""

if TYPE_CHECKING:
    import sympy

    from dynkit.systems.impact.simulation.state import ImpactState


@dataclass(frozen=True, kw_only=True)
class ImpactRod(ImpactOscillator):
    """A uniform elastic rod, whose near end hits a vibrating table, as a chain of equal masses.

    The chain has nodes at equal distances h from the far end to the near end; the masses are
    density h, and half of it at a free end. For many masses it tends to the rod with wave speed c:
    density (u_tt - c^2 u_ss - c^2 damping u_sst) = 0. The near end has restitution 0: an impact
    stops the last half mass alone, and the end stays on the table until the contact force vanishes.
    The restitution of the whole rod is a result (1 for a free rod without damping), not a
    parameter.

    The coordinates are (q_1, ..., q_n, x): x is the displacement of the near end, and q are the
    mass-normalised amplitudes of modes of the chain with that end held. Modes above `kept_modes`
    are left out (Craig and Bampton's reduction). In contact, the coordinate x is held and the modes
    are uncoupled: the modes left out have no effect as long as the table is at rest.
    `truncation_errors` bounds their effect.

    Parameters
    ----------
    masses : int
        Number N of masses that move, at least 2.
    kept_modes : int, optional
        Number n of modes of the held chain that are kept, at most N - 1. All by default: the
        complete chain.
    length, wave_speed, density : float
        Positive; the density is mass by length.
    damping : float
        Ratio of dashpot to spring constants, a time; not negative.
    far_end : {"fixed", "free"}
        Condition at the other end.
    frequency, amplitude, offset, side, chatter_tolerance
        As for `ImpactOscillator`.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    R. R. Craig, M. C. C. Bampton, Coupling of substructures for dynamic analyses, AIAA Journal 6
    (1968) 1313-1319. K. F. Graff, Wave Motion in Elastic Solids, 1975, section 2.4.

    Examples
    --------
    A free rod that falls on a stop leaves it after two travel times of a wave, 2 length / c:

    >>> rod = ImpactRod(masses=200, far_end="free", amplitude=0.0, frequency=1.0)
    >>> record = rod.simulate(impacts=20, start=rod.moving(0.5, -1.0))
    >>> float((record.events.time[-1] - record.time[0]).round(1))
    2.0
    """

    masses: int = 100
    kept_modes: int | None = None
    length: float = 1.0
    wave_speed: float = 1.0
    density: float = 1.0
    damping: float = 0.0
    far_end: str = "fixed"
    restitution: float = field(init=False, repr=False, default=0.0)
    contact: int = field(init=False, repr=False, default=-1)
    play: float = field(init=False, repr=False, default=math.inf)
    harmonic_forces: tuple[complex, ...] = field(init=False, repr=False, default=())
    constant_forces: tuple[float, ...] = field(init=False, repr=False, default=())
    elements: tuple[Element, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        count = positive_integer("masses", self.masses)
        if count < 2:
            raise ValueError(f"masses must be at least 2; got {count}")
        self._set("masses", count)
        if self.kept_modes is not None:
            kept = positive_integer("kept_modes", self.kept_modes)
            if kept > count - 1:
                raise ValueError(f"kept_modes must be at most {count - 1}; got {kept}")
            self._set("kept_modes", kept)
        check_fields(self, length=positive, wave_speed=positive, density=positive)
        check_fields(self, damping=non_negative)
        if self.far_end not in ("fixed", "free"):
            raise ValueError(f"far_end must be 'fixed' or 'free'; got {self.far_end!r}")
        within_memory("masses", count, 4.0 * 8.0 * self.degrees_of_freedom**2)
        h = self._spacing
        for name, value in (("length", h), ("density", self.density * h)):
            if not 1.0 / _LARGEST <= value <= _LARGEST:
                limits = f"between {1.0 / _LARGEST:g} and {_LARGEST:g}"
                got = getattr(self, name)
                raise ValueError(f"{name} must give distances and masses {limits}; got {got}")
        if not 1.0 / _LARGEST <= 2.0 * self.wave_speed / h <= _LARGEST:
            low, high = (f"{0.5 * h * w:.3g}" for w in (1.0 / _LARGEST, _LARGEST))
            given = f"length {self.length} and {count} masses; got {self.wave_speed}"
            raise ValueError(f"wave_speed must lie in [{low}, {high}] with {given}")
        super().__post_init__()

    @property
    @final
    def degrees_of_freedom(self) -> int:
        return (self.masses - 1 if self.kept_modes is None else self.kept_modes) + 1

    # --- the chain and its reduction --------------------------------------------------------------

    @property
    def _spacing(self) -> float:
        return self.length / (self.masses - (self.far_end == "free"))

    @cached_property
    def _chain(self) -> tuple[Array, Array, Array]:
        """Angles, frequencies and couplings (N - 1,) of all modes of the chain with its end held.

        Mode k has the shape sin (fixed far end) or cos (free far end) of ``angle * node``. Its
        coupling is the sum over the nodes of mass times shape times the displacement by a unit
        displacement of the near end.
        """
        h, k = self._spacing, np.arange(1, self.masses)
        angles = (k - (0.5 if self.far_end == "free" else 0.0)) * (math.pi * h / self.length)
        couplings = math.sqrt(self.density / (2.0 * self.length)) * h / np.tan(0.5 * angles)
        couplings[1::2] *= -1.0
        frequencies = 2.0 * self.wave_speed / h * np.sin(0.5 * angles)
        found = np.asarray([angles, frequencies, couplings], dtype=np.float64)
        return found[0], found[1], found[2]

    @property
    def _left_out(self) -> slice:
        return slice(self.degrees_of_freedom - 1, None)

    @property
    def _end(self) -> tuple[float, float]:
        """Mass and stiffness of the coordinate of the near end."""
        h, whole = self._spacing, self.density * self.length
        if self.far_end == "free":
            return whole, 0.0
        stiffness = self.density * self.wave_speed**2 / self.length
        return whole / 3.0 + self.density * h * h / (6.0 * self.length), stiffness

    @final
    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        mass, couplings = self._end[0], self._chain[2].tolist()
        ends = sum((m * v[-1] * p for m, p in zip(couplings, v[:-1], strict=False)), 0 * v[-1])
        return sum((p**2 / 2 for p in v[:-1]), ends) + mass * v[-1] ** 2 / 2

    @final
    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return sum(k * y**2 / 2 for k, y in zip(self._springs.tolist(), x, strict=True))

    @final
    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self.damping * self.potential(v)

    @property
    def _springs(self) -> Array:
        """The diagonal (n + 1,) of the stiffness matrix."""
        return np.append(self._chain[1][: self.degrees_of_freedom - 1] ** 2, self._end[1])

    def _derive(self) -> Derivation:
        n = self.degrees_of_freedom
        mass = np.eye(n)
        mass[-1, :-1] = mass[:-1, -1] = self._chain[2][: n - 1]
        mass[-1, -1] = self._end[0]
        stiffness = SymmetricMatrix.from_dense(np.diag(self._springs))
        # exact products: the damping stays exactly proportional to the stiffness
        high, low = two_product(stiffness.high, np.full_like(stiffness.high, self.damping))
        some = high != 0.0
        rows = stiffness.rows[some]
        damping = SymmetricMatrix(n, rows, rows, high[some], low[some])
        return Derivation(SymmetricMatrix.from_dense(mass), damping, stiffness, exact=False)

    # --- states and shapes ------------------------------------------------------------------------

    @property
    @final
    def nodes(self) -> Array:
        """Positions (N,) of the masses along the rod, from the far end; the near end is last."""
        first = int(self.far_end == "fixed")
        return np.asarray(self._spacing * np.arange(first, self.masses + first), dtype=np.float64)

    @final
    def moving(self, displacement: float, velocity: float, phase: float = 0.0) -> ImpactState:
        """A state with the static shape under a given displacement of the near end.

        A free rod is displaced as a whole; a fixed rod is stretched uniformly. Velocities have the
        same shape.

        Raises
        ------
        ValueError
            As `state`.
        """
        x, v = np.zeros((2, self.degrees_of_freedom))
        x[-1] = finite_scalar("displacement", displacement)
        v[-1] = finite_scalar("velocity", velocity)
        return self.state(x, v, phase)

    @final
    def displacements(self, coordinates: object) -> Array:
        """Displacements (..., N) of the masses from coordinates (..., n + 1); or their velocities.

        Raises
        ------
        ValueError
            When coordinates are not finite numbers, or their last axis is not n + 1.
        """
        given = finite_array("coordinates", coordinates, (None,) * np.asarray(coordinates).ndim)
        if given.shape[-1:] != (self.degrees_of_freedom,):
            n = self.degrees_of_freedom
            raise ValueError(f"coordinates must have shape (..., {n}); got {given.shape}")
        shapes, ramp = self._shapes
        return np.asarray(given[..., :-1] @ shapes + given[..., -1:] * ramp)

    @final
    def reduced(self, displacements: object) -> Array:
        """Coordinates (n + 1,) of displacements (N,) of the masses, or of their velocities.

        If modes are left out, the result is the nearest state, in the norm of kinetic energy, with
        the same displacement of the near end.

        Raises
        ------
        ValueError
            When displacements are not N finite numbers.
        """
        given = finite_array("displacements", displacements, (self.masses,))
        shapes, ramp = self._shapes
        rest = (given - given[-1] * ramp) * (self.density * self._spacing)
        if self.far_end == "free":
            rest[0] *= 0.5
        return np.append(shapes @ rest, given[-1])

    @property
    def _shapes(self) -> tuple[Array, Array]:
        """Shapes (n, N) of the kept modes, and of a unit displacement of the near end (N,)."""
        angles = self._chain[0][: self.degrees_of_freedom - 1]
        turned = np.outer(angles, self.nodes / self._spacing)
        shapes = np.cos(turned) if self.far_end == "free" else np.sin(turned)
        shapes *= math.sqrt(2.0 / (self.density * self.length))
        shapes[:, -1] = 0.0
        free = self.far_end == "free"
        return shapes, np.ones(self.masses) if free else self.nodes / self.length

    # --- effect of the modes that are left out ----------------------------------------------------

    @final
    def truncation_errors(self, record: ImpactRecord) -> Array:
        """Bounds (k,) of the effect of the modes that are left out, for each event of a record.

        The effect is the distance from the complete chain in the norm of energy: the square root of
        twice the energy of the difference. Each bound limits the increase of this distance over the
        interval since the event before, and at the impact of the event. It is proved if both
        motions have the event at the same time. For events at different times nothing is proved:
        chaos amplifies any distance. The proof is in the documentation, on the page of impacts.

        Parameters
        ----------
        record : ImpactRecord
            A motion of this rod.

        Raises
        ------
        ValueError
            When the record belongs to another system.
        """
        of_type("record", record, ImpactRecord, "an ImpactRecord")
        if record.system != self:
            raise ValueError(f"record must be one of this rod; got one of {record.system!r}")
        events, start = record.events, record.start
        times = np.append(0.0, events.time)
        positions = np.vstack([start.position, events.position])
        velocities = np.vstack([start.velocity, events.velocity])
        modes = np.append(0, events.mode)
        modes[0] = start.motion is not Motion.FLIGHT
        couplings, frequencies = self._chain[2][self._left_out], self._chain[1][self._left_out]
        flexible = math.sqrt(math.fsum((couplings / frequencies) ** 2))
        sudden = math.sqrt(math.fsum(couplings**2))
        out = np.empty(len(events))
        table = self.amplitude * self.frequency**2
        for k, span in enumerate(np.diff(times).tolist()):
            if modes[k]:
                swings, end = table * (1.0 + self.frequency * span), velocities[k + 1, -1]
            else:
                swings, end = self._swings(positions[k], velocities[k], span)
            out[k] = 4.0 * flexible * swings
            if events.kind[k] == EventKind.IMPACT:
                out[k] += sudden * abs(velocities[k + 1, -1] - end)
        return out

    def _swings(self, position: Array, velocity: Array, span: float) -> tuple[float, float]:
        """For the near end in a flight: first |acceleration| plus its variation; last velocity."""
        modes, c, k = self.modes, self.damping_matrix, self.stiffness
        to_modes, tip = modes.matrix.T @ self.mass, modes.matrix[-1]
        acceleration = modes.matrix @ (modes.matrix.T @ -(c @ velocity + k @ position))
        w, d = modes.frequencies, modes.decay
        # Half of the difference of a mode's two rates; almost equal rates are set 2e-6 w apart.
        half = np.sqrt((d * d - w * w).astype(complex))
        half = np.where(abs(half) < 1e-6 * w, 1e-6j * w, half)
        half[w == 0.0] = 1.0  # a rigid body is not accelerated
        rates = np.stack([-d + half, -d - half])
        # p = velocities, r = their rates: p = a exp(rate 0 t) + b exp(rate 1 t)
        p, r = to_modes @ velocity, np.where(w == 0.0, 0.0, to_modes @ acceleration)
        a = np.stack([r - rates[1] * p, rates[0] * p - r]) / (2.0 * half)
        grown = np.exp(rates * span)
        last = float(tip @ np.where(w == 0.0, p, (a * grown).sum(axis=0).real))
        loss = np.maximum(-rates.real, 1e-300)
        lasting = np.minimum(-np.expm1(-loss * span) / loss, span)
        moving = np.where(w == 0.0, 0.0, abs(a * rates**2) * lasting)
        return abs(float(acceleration[-1])) + float((abs(tip) * moving).sum()), last
