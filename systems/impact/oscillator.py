"""Impact oscillators: linear structures whose last coordinate hits a vibrating table."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from dynkit.flows import NoCrossing
from dynkit.maps import Map
from dynkit.systems.impact.attractor import ImpactAttractor
from dynkit.systems.impact.derivatives import impact_derivative
from dynkit.systems.impact.mechanics import Contact, Structure, Table, gap_ladder, structure_of
from dynkit.systems.impact.record import Ending, ImpactRecord
from dynkit.systems.impact.runs import Run, run
from dynkit.systems.impact.state import ImpactState, Motion
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.validation import (
    Array,
    finite_array,
    finite_scalar,
    in_interval,
    non_negative,
    non_negative_integer,
    positive,
    positive_integer,
)

TWO_PI = 2.0 * math.pi

_CACHES = frozenset({"_structure", "_table", "_gap", "_contact"})


@dataclass(frozen=True, kw_only=True)
class ImpactOscillator(LagrangianStructure, Map):
    """The map from just after one impact with a vibrating table to just after the next.

    A subclass owes its energies, as every `LagrangianStructure` does. The last coordinate x_N is
    free to hit the table at x_T = amplitude sin(phase) + offset, phase' = frequency, and stays on
    the far side: gap x_N - x_T >= 0. An impact turns the relative velocity u- into -restitution u-
    and changes nothing else.

    As a `Map` its states are the 2N section coordinates: positions x_1..x_{N-1}, velocities
    v_1..v_{N-1}, relative velocity u just after the impact, phase of the table.

    Parameters
    ----------
    frequency : float
        Angular frequency of the table, positive.
    restitution : float
        Coefficient of restitution in [0, 1].
    amplitude, offset : float
        Of the table; the amplitude is not negative.
    chatter_tolerance : float
        Chatter is replaced by contact when that changes no position or velocity by more than this,
        to leading order; 0 for never. The changes made are summed up in the record's
        ``chatter_error``.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, equations 8 to 12 and
    15.
    """

    frequency: float
    restitution: float = 0.85
    amplitude: float = 0.1
    offset: float = 0.0
    chatter_tolerance: float = 1e-16

    structure_independent: ClassVar[frozenset[str]] = _CACHES | {
        "frequency",
        "restitution",
        "amplitude",
        "offset",
        "chatter_tolerance",
    }

    observables: ClassVar[tuple[str, ...]] = ("relative_velocity", "phase", "energy", "time")
    """What a sweep can keep of every impact: names of arrays of the record."""

    def __post_init__(self) -> None:
        self._set("frequency", positive("frequency", self.frequency))
        self._set("restitution", in_interval("restitution", self.restitution, 0, 1))
        self._set("amplitude", non_negative("amplitude", self.amplitude))
        self._set("offset", finite_scalar("offset", self.offset))
        self._set("chatter_tolerance", non_negative("chatter_tolerance", self.chatter_tolerance))

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in super().__getstate__().items() if k not in _CACHES}

    # --- the family -------------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:
        """The numbers that set this oscillator apart in its family, by name."""
        return {
            k: v for k, v in super().parameters.items() if k not in ("chatter_tolerance", "masses")
        }

    def replace(self, **parameters: Any) -> Self:
        """Return the same oscillator with some of its arguments changed.

        Raises
        ------
        ValueError
            When a name is not an argument of this class, or a value is refused.
        """
        known = [entry.name for entry in dataclasses.fields(self)]
        for name in parameters:
            if name not in known:
                raise ValueError(f"parameter must be one of: {', '.join(known)}; got {name!r}")
        return dataclasses.replace(self, **parameters)

    @property
    def identity(self) -> Mapping[str, object]:
        """Everything that the motion depends on, by name: fields, and matrices of the energies."""
        fields = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        matrices = ("mass", "damping_matrix", "stiffness")
        return {**fields, **{name: getattr(self, name) for name in matrices}}

    @property
    def natural_frequencies(self) -> Array:
        """Natural frequencies of the structure in free flight, undamped, ascending, (N,)."""
        return self.modes.frequencies

    @property
    def modal_matrix(self) -> Array:
        """Mass-normalised modal matrix, (N, N), one mode per column, its last row not negative."""
        return self.modes.matrix

    # --- what the kernels take --------------------------------------------------------------------

    @cached_property
    def _structure(self) -> Structure:
        return structure_of(self)

    @property
    def _table(self) -> Table:
        return Table(self.amplitude, self.offset, self.frequency)

    @cached_property
    def _gap(self) -> Any:
        return gap_ladder(self._structure, self._table)

    @cached_property
    def _contact(self) -> Contact:
        return Contact(self._structure, self._table)

    # --- states -----------------------------------------------------------------------------------

    def state(
        self, position: object = None, velocity: object = None, phase: float = 0.0
    ) -> ImpactState:
        """Return a state to start from, in flight or on the table.

        Parameters
        ----------
        position, velocity : (N,) array_like
            By default at rest in the shape of the first mode with modal amplitude one, on the far
            side of the table (the start of Cusumano & Bai).
        phase : float
            Phase of the table, taken modulo 2 pi.

        Raises
        ------
        ValueError
            When a number is not finite; when the contact mass is below the table by more than
            rounding, or on it and moving into it.
        """
        n = self.degrees_of_freedom
        x = (
            self.modal_matrix[:, 0]
            if position is None
            else finite_array("position", position, (n,))
        )
        v = np.zeros(n) if velocity is None else finite_array("velocity", velocity, (n,))
        angle = finite_scalar("phase", phase)
        sine, cosine = math.sin(angle), math.cos(angle)
        table = self.amplitude * sine + self.offset
        speed = self.amplitude * self.frequency * cosine
        gap, u = float(x[-1]) - table, float(v[-1]) - speed
        rounding = 4.0 * 2.0**-53 * (abs(float(x[-1])) + self.amplitude + abs(self.offset))
        if gap < -rounding:
            raise ValueError(
                f"position[{n - 1}] must not be below the table at {table}; got {float(x[-1])}"
            )
        motion = Motion.FLIGHT
        if gap <= rounding:
            motion = Motion.TABLE
            rounding = 4.0 * 2.0**-53 * (abs(float(v[-1])) + abs(speed))
            if u < -rounding:
                raise ValueError(
                    f"velocity[{n - 1}] must not be below the table's {speed} when the mass is on "
                    f"the table; got {float(v[-1])}"
                )
            u = 0.0 if u <= rounding else u
        return self._make_state(x, v, sine, cosine, u, motion)

    def _make_state(
        self, x: Array, v: Array, sine: float, cosine: float, u: float, motion: Motion
    ) -> ImpactState:
        n = self.degrees_of_freedom
        y = np.zeros((2, self._gap.step.shape[2]))
        with np.errstate(over="ignore", invalid="ignore"):  # told by _state_of
            y[:, :n] = self._structure.free.coordinates(x, v)
        y[:, n] = sine, cosine
        return self._state_of(y, u, motion)

    def _state_of(self, y: Array, u: float, motion: Motion) -> ImpactState:
        n = self.degrees_of_freedom
        coordinates = y.copy()
        free = self._structure.free
        with np.errstate(over="ignore", invalid="ignore"):
            x, v = free.positions(y[:, :n]), free.velocities(y[:, :n])
        if not np.isfinite([x, v]).all():
            raise ValueError(f"positions and velocities must not overflow; got {x} and {v}")
        for array in (x, v, coordinates):
            array.setflags(write=False)
        phase = math.atan2(float(y[0, n]), float(y[1, n])) % TWO_PI
        return ImpactState(x, v, phase, float(u), motion, self, coordinates)

    def _entered(self, start: ImpactState | None) -> ImpactState:
        """A state of this oscillator, from one of an oscillator with other parameters.

        On the table the contact mass is put onto the table of this oscillator, with the same
        relative velocity.
        """
        if start is None:
            return self.state()
        if not isinstance(start, ImpactState):
            raise ValueError(f"start must be an ImpactState; got {start!r}")
        if start._system is self or start._system == self:
            return start
        n = self.degrees_of_freedom
        if start.position.shape != (n,):
            raise ValueError(f"start must have {n} masses; got {start.position.size}")
        sine, cosine = (float(part) for part in start._coordinates[:, start.position.size])
        x, v = start.position.copy(), start.velocity.copy()
        table = self.amplitude * sine + self.offset
        if start.motion is Motion.FLIGHT:
            if x[-1] < table:
                raise ValueError(
                    f"start must not be below the table at {table}; got {float(x[-1])}"
                )
        else:
            x[-1] = table
            v[-1] = self.amplitude * self.frequency * cosine + start.relative_velocity
        # Where the table released it under other parameters, its contact force is not zero here.
        motion = Motion.FLIGHT if start.motion is Motion.FLIGHT else Motion.TABLE
        return self._make_state(x, v, sine, cosine, start.relative_velocity, motion)

    def pack_state(self, state: ImpactState) -> Array:
        """Return numbers, one array, from which `unpack_state` makes the same state, bit for bit.

        A state of an oscillator with other parameters becomes one of this oscillator first, as in
        `simulate`.

        Raises
        ------
        ValueError
            When it is no state of this structure, or below the table.
        """
        own = self._entered(state)
        motion = tuple(Motion).index(own.motion)
        return np.concatenate([[motion, own.relative_velocity], own._coordinates.ravel()])

    def unpack_state(self, packed: Array) -> ImpactState:
        """Return the state of this oscillator that `pack_state` turned into numbers.

        Raises
        ------
        ValueError
            When they are not finite, or not as many as a state of this oscillator has.
        """
        slots = self._gap.step.shape[2]
        numbers = finite_array("packed", packed, (2 + 2 * slots,))
        motion = tuple(Motion)[int(numbers[0])]
        return self._state_of(numbers[2:].reshape(2, slots), float(numbers[1]), motion)

    # --- simulation -------------------------------------------------------------------------------

    def simulate(self, *, impacts: int, start: ImpactState | None = None) -> ImpactRecord:
        """Simulate until so many impacts have happened, or none can happen any more.

        Parameters
        ----------
        impacts : int
            How many impacts to record.
        start : ImpactState, optional
            From `state` or from another record's ``final``; by default ``state()``. From an
            oscillator with other parameters it keeps its phase, and a mass on the table stays on it
            with the same relative velocity.

        Returns
        -------
        ImpactRecord

        Raises
        ------
        ValueError
            When impacts is no positive integer, or the start is not one of this structure's or
            below the table.
        """
        count = positive_integer("impacts", impacts)
        return ImpactRecord(self, self._run(self._entered(start), count, store=True))

    def attractor(
        self, *, transient: int = 700, impacts: int = 100, start: ImpactState | None = None
    ) -> ImpactAttractor:
        """Return what is left of the motion after a number of impacts.

        Parameters
        ----------
        transient, impacts : int
            How many impacts to skip, and how many to keep.
        start : ImpactState, optional
            As in `simulate`.
        """
        skipped = non_negative_integer("transient", transient)
        count = positive_integer("impacts", impacts)
        state = self._entered(start)
        if skipped:
            before = self._run(state, skipped, store=False)
            return ImpactAttractor(
                self,
                skipped,
                ImpactRecord(self, self._run(before.final, count, store=True)),
                before,
            )
        return ImpactAttractor(
            self, 0, ImpactRecord(self, self._run(state, count, store=True)), None
        )

    def _run(
        self, start: ImpactState, count: int, *, store: bool, noise: float = 0.0, seed: int = 1
    ) -> Run:
        return run(self, start, count, store=store, noise=noise, seed=seed)

    # --- the map ----------------------------------------------------------------------------------

    @property
    def dimension(self) -> int:
        return 2 * self.degrees_of_freedom

    def section_state(self, state: ImpactState) -> Array:
        """Section coordinates, (2N,), of a state on the table."""
        return np.concatenate(
            [state.position[:-1], state.velocity[:-1], [state.relative_velocity, state.phase]]
        )

    def impact_state(self, state: Array) -> ImpactState:
        """The state just after an impact that has the given section coordinates, (2N,).

        Raises
        ------
        ValueError
            When the state is not finite or not of that shape, or the relative velocity is negative.
        """
        y = finite_array("state", state, (self.dimension,))
        n = self.degrees_of_freedom
        u, phase = non_negative(f"state[{2 * n - 2}]", y[2 * n - 2]), float(y[2 * n - 1])
        sine, cosine = math.sin(phase), math.cos(phase)
        x = np.append(y[: n - 1], self.amplitude * sine + self.offset)
        v = np.append(y[n - 1 : 2 * n - 2], self.amplitude * self.frequency * cosine + u)
        return self._make_state(x, v, sine, cosine, u, Motion.TABLE)

    def __call__(self, state: Array) -> Array:
        done = self._run(self.impact_state(state), 1, store=False)
        if done.impacts < 1:
            raise NoCrossing(f"there is no next impact: {tuple(Ending)[done.ending].value}")
        return self.section_state(done.final)

    def jacobian(self, state: Array) -> Array:
        return impact_derivative(self, self.impact_state(state))

    def difference(self, a: Array, b: Array) -> Array:
        out = np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)
        # Symmetric in both directions, unlike the remainder operator.
        out[..., -1] -= TWO_PI * np.rint(out[..., -1] / TWO_PI)
        return out
