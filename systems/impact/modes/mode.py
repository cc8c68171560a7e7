"""Linear modes: propagation of states, changes of basis, transition matrices."""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property, copied, kept
from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import cells_of_a_call, ladder, workspace
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.modes.bases import row_by_row
from dynkit.systems.impact.modes.steady_response import Forced
from dynkit.systems.impact.modes.structure import Contact, Excitation, Structure

RESONANCE = "the free motion of the structure has that multiplier itself"
"""Message of `NoSolution` if there is no periodic response."""


@final
class Mode:
    """A linear mode of the motion, packed into the slots of the kernels' arrays.

    Attributes
    ----------
    structure : Structure or None
        Structure of the coordinates that are not held.
    forced : Forced
    layout : Layout
    propagators : Propagators
        Propagators of all slots.
    bodies : int
        Number of coordinates without sliders.
    """

    def __init__(
        self,
        structure: Structure | None,
        forced: Forced,
        excitation: Excitation,
        seen: NDArray[np.bool_],
    ) -> None:
        self.structure = structure
        self.forced = forced
        self.layout, self.propagators = forced.arranged(~seen, turns=excitation.turns)
        self._sums: dict[bytes, Any] = {}
        self.bodies = len(forced.rest)
        self._anchored = self._anchors = np.zeros(0, dtype=np.intp)
        self._drifts = np.zeros(0)

    def turned(self, frequency: float) -> Mode | None:
        """The mode at another forcing frequency; None if its parts depend on the frequency."""
        forced = self.forced.turned(frequency)
        if forced is None:
            return None
        out = copied(self, forced=forced, _sums={})
        if self.layout.table >= 0:
            out.propagators = self.propagators.turning(self.layout.table, frequency)
        return out

    def anchor(self, stuck: int, places: list[int], drifts: Array, bodies: int) -> None:
        """Define the sticking sliders by their coordinates (s,) and surface velocities (s,).

        Their pairs are the first ones among the last `stuck` pairs of the mode. All coordinates
        from number `bodies` on are sliders.
        """
        count = len(self.layout.modes)
        self._anchors = np.arange(count - stuck, count - stuck + len(drifts))
        self._anchored, self._drifts, self.bodies = np.array(places, np.intp), drifts, bodies

    def coordinates(self, x: Array, v: Array, sine: Any, cosine: Any, one: Any = 1.0) -> Array:
        """Coordinates (..., 2, m) of positions and velocities (..., N).

        Velocities of sticking sliders are replaced by those of their surfaces.
        """
        forced, there = self.forced, self._anchored
        if len(there):
            v, turning = v.copy(), forced.turning[there]
            v[..., there] = np.multiply.outer(sine, turning.real)
            v[..., there] += np.multiply.outer(cosine, turning.imag)
            v[..., there] += np.multiply.outer(one, forced.drift[there] + self._drifts)
        if forced.shifts:
            x = x - np.multiply.outer(one, forced.rest)
            v = v - np.multiply.outer(one, forced.drift)
        return self.steady(forced.coordinates(x, v, sine, cosine), one)

    def steady(self, q: Array, one: Any = 1.0) -> Array:
        """Give sticking sliders their exact velocities; coordinates (..., 2, m), in place."""
        if len(self._anchors):
            q[..., 1, self._anchors] = np.multiply.outer(one, self._drifts)
        return q

    @property
    def pairs(self) -> Pairs:
        """The 2x2 blocks by which the states in all slots evolve."""
        return self.propagators.pairs

    def row(self, coefficients: Array) -> Array:
        """Row (2, slots) that gives a combination (N,) of positions, relative to `forced.rest`."""
        out = np.zeros((2, self.layout.slots))
        if self.forced.basis is not None:
            own = self.forced.gathered(coefficients)
            out[:, self.layout.modes] = self.forced.basis.position_row(own)
        if self.layout.table >= 0:
            turn = coefficients @ self.forced.shape
            out[:, self.layout.table] = turn.real, turn.imag
        return out

    def placed(self, rows: Array) -> Array:
        """Copy numbers (..., m) into the slots of the modes, (..., slots); others are zero."""
        out = np.zeros((*rows.shape[:-1], self.layout.slots))
        out[..., self.layout.own] = rows
        return out

    def states(self, q: Array, sine: Any, cosine: Any) -> Array:
        """States (..., 2, slots) of coordinates (..., 2, m) and the phase."""
        out = self.placed(q)
        if self.layout.table >= 0:
            out[..., 0, self.layout.table], out[..., 1, self.layout.table] = sine, cosine
        if self.layout.constant >= 0:
            out[..., 0, self.layout.constant] = 1.0
        return out

    def parts(self, states: Array) -> tuple[Array, Array, Array]:
        """Coordinates (..., 2, m), sine and cosine (...) of states (..., 2, slots)."""
        q = states[..., self.layout.own]
        if self.layout.table < 0:
            none = np.zeros(q.shape[:-2])
            return q, none, none
        return q, states[..., 0, self.layout.table], states[..., 1, self.layout.table]

    def units(self) -> tuple[Array, Array]:
        """Positions and velocities (2 slots, N) of unit states, relative to `forced.rest`."""
        forced, layout = self.forced, self.layout
        x, v = np.zeros((2, 2, layout.slots, len(forced.rest)))
        if forced.basis is not None:
            for part, own in zip((x, v), forced.basis.units(), strict=True):
                part[:, layout.modes] = forced.spread(own).reshape(2, len(layout.modes), -1)
        if layout.table >= 0:
            x[:, layout.table] = forced.shape.real, forced.shape.imag
            v[:, layout.table] = forced.turning.real, forced.turning.imag
        shape = 2 * layout.slots, len(forced.rest)
        return x.reshape(shape), v.reshape(shape)

    def driven(self) -> tuple[Array, Array]:
        """Steady positions and velocities (3, N): factors of sine and of cosine, constant parts."""
        forced = self.forced
        x = np.stack([forced.shape.real, forced.shape.imag, forced.rest])
        v = np.stack([forced.turning.real, forced.turning.imag, forced.drift])
        return x, v

    def contact(self, row: Array) -> Contact:
        """The contact along a row (N,), restricted to the coordinates that are not held."""
        assert self.structure is not None
        return self.structure.contact(self.forced.gathered(row))

    def pushed(self, row: Array) -> Array:
        """Velocity changes (N,) of an impulse that changes the rate of a row (N,) by one."""
        return self.forced.spread(self.contact(row).kick_velocity)

    def seen_from(self, one: Mode, stop: Element | None = None) -> Array:
        """Affine change of basis (2 slots, 2 slots of the other mode + 1) from another mode.

        The state is continuous; if a stop is given, the rate of its gap becomes zero.
        """
        x, v = one.driven()
        if stop is not None:
            row, moving = stop.row(len(one.forced.rest)), 1j * self.forced.frequency * stop.phasor
            lost = v @ row - (moving.real, moving.imag, 0.0)
            v -= np.outer(lost, one.pushed(row))
        sine, cosine, unit = np.eye(3)
        driven = self.states(self.coordinates(x, v, sine, cosine, unit), sine, cosine)
        a, b = one.layout, self.layout
        if b.constant >= 0:
            driven[:2, 0, b.constant] = 0.0
        out = np.zeros((2 * b.slots, 2 * a.slots + 1))
        places = (np.append(layout.modes, layout.slots + layout.modes) for layout in (b, a))
        out[np.ix_(*places)] = self._modes_from(one, stop)
        if a.table >= 0:
            out[:, a.table], out[:, a.slots + a.table] = driven[:2].reshape(2, -1)
        out[:, -1] = driven[2].ravel()
        return out

    def _modes_from(self, one: Mode, stop: Element | None) -> Array:
        """Change of basis of the modes alone, (2 modes, 2 other modes); cached in the basis."""
        basis, other = self.forced.basis, one.forced.basis
        if basis is None or other is None:
            return np.zeros((2 * len(self.layout.modes), 2 * len(one.layout.modes)))
        row = None if stop is None else stop.row(len(one.forced.rest))
        key = other, None if row is None else row.tobytes()
        if key not in basis.changes:
            x, v = map(one.forced.spread, other.units())
            if row is not None:
                v = v - np.outer(v @ row, one.pushed(row))
            v[:, self._anchored] = 0.0
            units = basis.coordinates(self.forced.own(x), self.forced.own(v))
            basis.changes[key] = np.ascontiguousarray(units.reshape(len(units), -1).T)
        return basis.changes[key]

    def sum(self, row: Array, offset: float) -> Any:
        """The exponential sum ``offset + row . y``, packed for the kernels."""
        row = row[:, : self.layout.seen]
        key = row.tobytes()
        if key not in self._sums:
            self._sums[key] = ladder(row, offset, self.propagators, self.layout.table)
        return self._sums[key]._replace(offset=float(offset))

    # --- the motion -------------------------------------------------------------------------------

    def motion(self, states: Array) -> tuple[Array, Array]:
        """Positions and velocities (k, N) of states (k, 2, slots)."""
        q, sine, cosine = self.parts(states)
        x, v = self.forced.positions(q, sine, cosine), self.forced.velocities(q, sine, cosine)
        return x[..., : self.bodies], v[..., : self.bodies]

    def sliders(self, states: Array) -> Array:
        """Positions (k, J) of the sliders in states (k, 2, slots)."""
        if self.bodies == len(self.forced.rest):
            return np.empty((len(states), 0))
        return self.forced.positions(*self.parts(states))[..., self.bodies :]

    def after(self, starts: Array, which: Any, durations: Array) -> Array:
        """States (m, 2, slots) after durations (m,), each from its start among (k, 2, slots)."""
        from dynkit.exponential.sampling_kernels import sample

        ladder, work = self.propagators.ladder, self.work
        out, starts = np.empty((len(durations), *starts.shape[1:])), np.ascontiguousarray(starts)
        size = cells_of_a_call(starts.shape[2])
        for begin in range(0, len(durations), size):
            now = slice(begin, begin + size)
            sample(ladder, starts, which[now], durations[now], work, out[now])
        return out

    @cached_property
    def work(self) -> Any:
        """Work arrays of kernels; shared by threads, as kernels hold Python's global lock."""
        return workspace(self.layout.slots)

    def rate(self, states: Array) -> Array:
        """Rates of change (..., 2, slots) of states."""
        from dynkit.systems.impact.modes.transition_kernels import rates

        out, ladder = np.empty(states.shape), self.propagators.ladder
        count = math.prod(states.shape[:-2])
        flat = np.ascontiguousarray(states).reshape(count, *states.shape[-2:])
        rates(ladder, flat, out.reshape(flat.shape))
        return out

    @kept
    def _apart(self, slots: Any) -> tuple[Any, Any]:
        """Slots without links, and slots with links, each ascending."""
        linked = np.intersect1d(self.propagators.links, slots)
        return np.setdiff1d(slots, linked), linked

    def repeated(self, period: float, kicks: Array) -> tuple[Transitions, Array, Array]:
        """Transitions over a period, and the periodic response to kicks (k, 2, slots).

        Each kick is repeated after every period. The response consists of the states (k, 2, slots)
        just after the kicks and of their derivatives with respect to the period.

        Raises
        ------
        NoSolution
            When the free motion has this period, as at a resonance without damping.
        """
        from dynkit.systems.impact.modes.transition_kernels import repeat_kicks

        alone, linked = self._apart(self.layout.modes)
        if len(linked):
            transitions = self.transitions(np.array([period]))
            kicked = transitions.periodic(kicks)
            return transitions, kicked, transitions.periodic(self.rate(kicked - kicks))
        own, joint = np.zeros((1, 2, 2, self.layout.slots)), np.empty((1, 2, 0, 0))
        kicked, moved = np.empty(kicks.shape), np.empty(kicks.shape)
        ladder, lasts = self.propagators.ladder, np.array([period])
        if not repeat_kicks(ladder, self.work, alone, lasts, kicks, own, joint, kicked, moved):
            raise NoSolution(RESONANCE)
        return Transitions(alone, linked, own, joint), kicked, moved

    def transitions(self, durations: Array, among: Any = None) -> Transitions:
        """Transitions over durations (k,) for some slots; by default for those of the modes."""
        from dynkit.systems.impact.modes.transition_kernels import fly_units

        alone, linked = self._apart(self.layout.modes if among is None else among)
        k, b, slots = len(durations), len(linked), self.layout.slots
        own, joint = np.zeros((k, 2, 2, slots)), np.empty((k, 2, b, 2 * b))
        ladder, size = self.propagators.ladder, cells_of_a_call(slots)
        for begin in range(0, k, size):
            now = slice(begin, begin + size)
            fly_units(ladder, self.work, alone, linked, durations[now], own[now], joint[now])
        return Transitions(alone, linked, own, joint)


@final
class Transitions:
    """Transition matrices over k durations.

    Parameters
    ----------
    alone, linked : (a,), (b,)
        Slots of pairs without links, and with links.
    own : (k, 2, 2, slots)
        2x2 transition matrices of the slots without links; zero in other slots.
    joint : (k, 2, b, 2 b)
        Transition matrices of the linked slots; columns: both coordinates of the first slot, then
        those of the second, and so on.
    """

    def __init__(self, alone: Any, linked: Any, own: Array, joint: Array) -> None:
        self.alone, self.linked, self.own, self.joint = alone, linked, own, joint

    def __getitem__(self, part: slice) -> Transitions:
        return Transitions(self.alone, self.linked, self.own[part], self.joint[part])

    @cached_property
    def _dense(self) -> Array:
        """Joint matrices (k, 2 b, 2 b), with rows in the order of the columns."""
        k, _, b, _ = self.joint.shape
        return self.joint.transpose(0, 2, 1, 3).reshape(k, 2 * b, 2 * b)

    def matrices(self, slots: Any) -> Array:
        """Transition matrices (k, 2 N, 2 N) of slots (N,); first, then second coordinates."""
        k, n = len(self.own), len(slots)
        out, at = np.zeros((k, 2, n, 2, n)), np.arange(n)
        out[:, :, at, :, at] = self.own[..., slots].transpose(3, 0, 1, 2)
        if len(self.linked):
            order = np.argsort(slots)
            at = order[np.searchsorted(slots, self.linked, sorter=order)]
            joint = self.joint.reshape(k, 2, len(at), len(at), 2)
            for j in range(2):
                out[:, :, at[:, None], j, at[None, :]] = joint[..., j].transpose(0, 1, 2, 3)
        return out.reshape(k, 2 * n, 2 * n)

    def amplification(self, slots: int) -> Array:
        """Factors (slots,) by which a periodic response amplifies rounding errors.

        The period is the first duration. The factors are large near a resonance without damping.
        """
        out = np.zeros(slots)
        (a, b), (c, d) = self.own[0][..., self.alone]
        whole, left = a * d - b * c, (1.0 - a) * (1.0 - d) - b * c
        # of (1 - E)^-1 E: both diagonal entries, half the sum of squared entries, the determinant
        one, other, twist = (a - whole) / left, (d - whole) / left, whole / left
        half = 0.5 * (one * one + other * other + (b * b + c * c) / (left * left))
        out[self.alone] = np.sqrt(half + np.sqrt(np.maximum(half * half - twist * twist, 0.0)))
        if len(self.linked):
            joint = self._dense[0]
            back = np.linalg.inv(np.eye(len(joint)) - joint)
            out[self.linked] = np.linalg.norm(back @ joint, 2)
        return out

    def periodic(self, states: Array, multiplier: complex = 1.0) -> Any:
        """Solve z = state + transition(z) / multiplier, (k, 2, slots), over the first duration.

        The given states are kicks that are repeated after every period, each time multiplied by the
        multiplier; z are the states just after the kicks. In slots without transition, z is the
        state after one kick.

        Raises
        ------
        NoSolution
            When the multiplier is also a multiplier of the free motion.
        """
        from dynkit.systems.impact.modes.transition_kernels import repeat

        number = np.result_type(np.float64, multiplier).type(multiplier)
        out = np.empty(states.shape, dtype=type(number))
        if not repeat(self.own, states, number, out):
            raise NoSolution(RESONANCE)
        if len(self.linked):
            flat = states[..., self.linked].swapaxes(-1, -2).reshape(len(states), -1)
            matrix = np.eye(flat.shape[1]) - self._dense[0] / multiplier
            found = np.linalg.solve(matrix, flat.T).T.reshape(len(states), -1, 2)
            out[..., self.linked] = found.swapaxes(-1, -2)
        return out


def transformed(matrix: Array, states: Array) -> Array:
    """States (k, 2, slots) in another basis, by an affine matrix from `Mode.seen_from`."""
    flat = states.reshape(len(states), states.shape[1] * states.shape[2])
    out = np.broadcast_to(matrix[:, -1], (len(flat), len(matrix)))
    if flat.shape[1]:  # a single mass on a table at rest has no state
        out = row_by_row(flat, matrix[:, :-1]) + out
    return np.asarray(out.reshape(len(states), 2, len(matrix) // 2))
