"""Periodic responses of a structure to impulses at its contact coordinate."""

from __future__ import annotations

from functools import cached_property
from typing import Any, final
from weakref import WeakKeyDictionary

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.mechanics import Drive, Regime, Structure, free_regime
from dynkit.systems.impact.motion import evolve


@final
class FreeMotion:
    """A structure without table and forces, in the slots of the kernels: states are (2, slots).

    Attributes
    ----------
    rows : (4, 2 slots)
        Give the contact coordinate and its first three derivatives from a state.
    bounds : (4, 2, slots)
        Weights of abs(state) that bound the terms of the contact coordinate and of its derivatives
        of order 1, 2 and 6 for ever.
    kick : (2, slots)
        Change of the state by an impulse that changes the contact velocity by one.
    """

    def __init__(self, structure: Structure) -> None:
        n = structure.size
        quiet = Drive(1.0, 0.0, np.zeros(n, dtype=complex), np.zeros(n))
        self.regime: Regime = free_regime(structure, quiet)
        row = self.regime.row(np.eye(n)[structure.contact])
        self._ladder = self.regime.sum(row, 0.0)
        self.rows = np.stack(
            [self.regime.pairs.derivative_rows(row, order).ravel() for order in range(4)]
        )
        self.bounds = np.stack([self.regime.pairs.bound(row, order) for order in (0, 1, 2, 6)])
        self.kick = np.zeros((2, self.regime.layout.slots))
        self.kick[:, self.regime.layout.modes] = structure.kick[:2]
        self._linked = np.unique(self._ladder.links)
        self._alone = np.setdiff1d(self.regime.layout.modes, self._linked)
        self._returns: list[tuple[float, Transitions, Array]] = []

    @cached_property
    def vectors(self) -> Array:
        """(4, 2N) kick, its rate of change, and the rows of place and velocity, of the modes."""
        modes = self.regime.layout.modes
        place, speed = self.rows[:2].reshape(2, 2, -1)[..., modes]
        kick, pushed = self.kick[:, modes], self.rate(self.kick)[:, modes]
        return np.stack([kick, pushed, place, speed]).reshape(4, -1)

    @property
    def rigid(self) -> bool:
        """Whether a part of the motion has no restoring force: no response is periodic then."""
        pairs, modes = self.regime.pairs, self.regime.layout.modes
        g = pairs.generator[:, modes]
        return bool((g[0] * g[3] == g[1] * g[2]).any())

    def after(self, states: Array, which: Any, durations: Array) -> Array:
        """States (k, 2, slots) at durations (k,) from some of the states (m, 2, slots)."""
        return evolve(self._ladder, states, which, durations)

    def rate(self, states: Array) -> Array:
        """Rates of change (..., 2, slots) of states."""
        g = self._ladder.generator
        y, z = states[..., 0, :], states[..., 1, :]
        out = np.stack([g[0] * y + g[1] * z, g[2] * y + g[3] * z], axis=-2)
        for (t, s), b in zip(self._ladder.links.tolist(), self._ladder.link_step[0], strict=True):
            out[..., t] += states[..., s] @ b.reshape(2, 2).T
        return out

    def repeated(self, period: float) -> tuple[Transitions, Array]:
        """Transitions over a period, and the periodic state just after a unit impulse in each.

        The state is (2, slots), read-only; those of the last two periods are kept.

        Raises
        ------
        NoSolution
            When the free motion has that period itself.
        """
        for known, transitions, kicked in self._returns:
            if known == period:
                return transitions, kicked
        transitions = self.transitions(np.array([period]))
        kicked = np.asarray(transitions.periodic(self.kick))
        kicked.setflags(write=False)
        self._returns = [(period, transitions, kicked), *self._returns[:1]]
        return transitions, kicked

    def transitions(self, durations: Array) -> Transitions:
        """Transitions over the durations (k,)."""
        slots = self.kick.shape[1]
        starts = np.zeros((2 + 2 * len(self._linked), 2, slots))
        starts[0, 0, self._alone] = starts[1, 1, self._alone] = 1.0
        for i, slot in enumerate(self._linked.tolist()):
            starts[2 + 2 * i, 0, slot] = starts[3 + 2 * i, 1, slot] = 1.0
        count, k = len(starts), len(durations)
        which = np.tile(np.arange(count), k)
        ends = self.after(starts, which, np.repeat(durations, count))
        ends = ends.reshape(k, count, 2, slots)
        alone = ends[:, :2].transpose(0, 2, 1, 3)[..., self._alone]
        linked = ends[:, 2:][..., self._linked].transpose(0, 2, 3, 1)
        return Transitions(self._alone, self._linked, alone, linked)


_motions: WeakKeyDictionary[Structure, FreeMotion] = WeakKeyDictionary()


def free_motion(structure: Structure) -> FreeMotion:
    """The free motion of a structure, made once."""
    if structure not in _motions:
        _motions[structure] = FreeMotion(structure)
    return _motions[structure]


@final
class Transitions:
    """What becomes of all states in some durations.

    Parameters
    ----------
    alone, linked : (a,), (b,)
        Slots of the pairs that nothing links, and of those that something does.
    own : (k, 2, 2, a)
        Transition matrices of the former.
    joint : (k, 2, b, 2 b)
        Of the latter; columns are both numbers of a slot, one slot after the other.
    """

    def __init__(self, alone: Any, linked: Any, own: Array, joint: Array) -> None:
        self.alone, self.linked, self.own, self.joint = alone, linked, own, joint

    def __getitem__(self, part: slice) -> Transitions:
        return Transitions(self.alone, self.linked, self.own[part], self.joint[part])

    @cached_property
    def _dense(self) -> Array:
        """Joint matrices (k, 2 b, 2 b), rows ordered as the columns are."""
        k, _, b, _ = self.joint.shape
        return self.joint.transpose(0, 2, 1, 3).reshape(k, 2 * b, 2 * b)

    def apply(self, k: int, states: Array) -> Array:
        """Images (..., 2, slots) of states after the duration number `k`."""
        out = np.zeros_like(states)
        out[..., self.alone] = np.einsum("ijs,...js->...is", self.own[k], states[..., self.alone])
        if len(self.linked):
            flat = np.swapaxes(states[..., self.linked], -1, -2)
            shape = flat.shape
            moved = flat.reshape(*shape[:-2], -1) @ self._dense[k].T
            out[..., self.linked] = np.swapaxes(moved.reshape(shape), -1, -2)
        return out

    def matrices(self, slots: Any) -> Array:
        """Transition matrices (k, 2 N, 2 N) of the states of some slots (N,), both rows in turn."""
        k, n = len(self.own), len(slots)
        out = np.zeros((k, 2, n, 2, n))
        place = np.searchsorted(slots, self.alone, sorter=np.argsort(slots))
        at = np.argsort(slots)[place]
        for i in range(2):
            for j in range(2):
                out[:, i, at, j, at] = self.own[:, i, j]
        if len(self.linked):
            at = np.argsort(slots)[np.searchsorted(slots, self.linked, sorter=np.argsort(slots))]
            joint = self.joint.reshape(k, 2, len(at), len(at), 2)
            for j in range(2):
                out[:, :, at[:, None], j, at[None, :]] = joint[..., j].transpose(0, 1, 2, 3)
        return out.reshape(k, 2 * n, 2 * n)

    def amplification(self, slots: int) -> Array:
        """By how much the rounding of the first of them grows, (slots,), in a periodic response.

        It is large near a resonance without damping.
        """
        out = np.zeros(slots)
        parts = [(self.alone, np.moveaxis(self.own[0], -1, 0))]
        if len(self.linked):
            parts.append((self.linked, self._dense[:1]))
        for at, matrices in parts:
            back = np.linalg.inv(np.eye(matrices.shape[-1]) - matrices)
            out[at] = np.linalg.norm(back @ matrices, 2, axis=(1, 2))
        return out

    def periodic(self, state: Array, multiplier: complex = 1.0) -> Any:
        """Return z, (2, slots), with z = state + transition(z) / multiplier, over the first one.

        The state just after a kick that is repeated after every period, multiplied each time.

        Raises
        ------
        NoSolution
            When the multiplier is one of the free motion's own.
        """
        own = self.own[0] / multiplier
        a, b, c, d = 1.0 - own[0, 0], -own[0, 1], -own[1, 0], 1.0 - own[1, 1]
        determinant = a * d - b * c
        if (determinant == 0.0).any():
            raise NoSolution("the free motion of the structure has that multiplier itself")
        out = np.zeros(state.shape, dtype=np.result_type(state, own))
        y, z = state[:, self.alone]
        out[:, self.alone] = np.stack([d * y - b * z, a * z - c * y]) / determinant
        if len(self.linked):
            flat = state[:, self.linked].T.ravel()
            matrix = np.eye(flat.size) - self._dense[0] / multiplier
            out[:, self.linked] = np.linalg.solve(matrix, flat).reshape(-1, 2).T
        return out
