"""Responses of a structure to impulses at its contact coordinate, repeated period by period."""

from __future__ import annotations

import math
from functools import cached_property
from typing import final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.constrained import mode_of
from dynkit.systems.impact.modes.mode import Mode, Transitions
from dynkit.systems.impact.modes.structure import Contact, Excitation


@final
class FreeMotion:
    """A structure without table and harmonic forces, in the slots of the kernels.

    States are (2, slots).

    Parameters
    ----------
    contact : Contact
    constant : (N,) array, optional
        Constant forces.

    Attributes
    ----------
    neutral : (b,)
        Slots of motions without restoring force, and of what dashpots couple to them: no response
        of them is periodic by itself.
    rows : (4, 2 slots)
        Give the contact coordinate and its first three derivatives from a state.
    kick : (2, slots)
        Change of the state by an impulse that changes the contact velocity by one.
    """

    def __init__(self, contact: Contact, constant: Array | None = None) -> None:
        n = len(contact.row)
        forces = np.zeros(n) if constant is None else constant
        self.mode: Mode = mode_of(
            contact.structure,
            Excitation(1.0, np.zeros(n, dtype=complex), forces, turns=False),
            (),
            (),
            [contact.row],
            [contact.row],
        )
        row = self.mode.row(contact.row)
        self.rows = np.stack(
            [self.mode.pairs.derivative_rows(row, order).ravel() for order in range(4)]
        )
        self._row = row
        self.kick = self.mode.placed(contact.kick[:2])
        self.neutral = _neutral(self.mode)
        self._bound = np.setdiff1d(self.mode.layout.modes, self.neutral)
        self._returns: list[tuple[float, Transitions, Array]] = []

    def bounds(self, lasts: float) -> Array:
        """Weights (4, 2, slots) of abs(state) that bound the terms of the contact coordinate.

        And of its derivatives of order 1, 2 and 6: for ever, or where some of the motion has no
        restoring force for so long.
        """
        return self._bounds(lasts) if len(self.neutral) else self._for_ever

    @cached_property
    def _for_ever(self) -> Array:
        return self._bounds(math.inf)

    def _bounds(self, lasts: float) -> Array:
        pairs = self.mode.pairs
        return np.stack([pairs.bound(self._row, order, lasts) for order in (0, 1, 2, 6)])

    @cached_property
    def vectors(self) -> Array:
        """(4, 2N) kick, its rate of change, and the rows of place and velocity, of the modes."""
        modes = self.mode.layout.modes
        place, speed = self.rows[:2].reshape(2, 2, -1)[..., modes]
        kick, pushed = self.kick[:, modes], self.mode.rate(self.kick)[:, modes]
        return np.stack([kick, pushed, place, speed]).reshape(4, -1)

    @cached_property
    def pushes(self) -> Array:
        """(2, slots, 2) kick, and its rate of change."""
        return np.stack([self.kick, self.mode.rate(self.kick)], axis=-1)

    @cached_property
    def bend(self) -> float:
        """What a kick changes in the acceleration of the contact coordinate."""
        return float((self.rows[2] * self.kick.ravel()).sum())

    @cached_property
    def spread(self) -> float:
        """How much faster the fastest mode decays than the slowest one."""
        g = self.mode.pairs.generator[:, self.mode.layout.modes]
        half = 0.5 * (g[0] + g[3])
        root = np.sqrt(np.maximum(half * half - (g[0] * g[3] - g[1] * g[2]), 0.0))
        return float((half + root).max() - (half - root).min())

    def repeated(self, period: float) -> tuple[Transitions, Array]:
        """Transitions over a period, and the periodic state just after a unit impulse in each.

        Of what is neutral no transitions, and the state after one impulse. The state is (2, slots),
        read-only; those of the last two periods are kept.

        Raises
        ------
        NoSolution
            When the free motion has that period itself.
        """
        for known, transitions, kicked in self._returns:
            if known == period:
                return transitions, kicked
        transitions = self.mode.transitions(np.array([period]), self._bound)
        kicked = np.asarray(transitions.periodic(self.kick))
        kicked.setflags(write=False)
        self._returns = [(period, transitions, kicked), *self._returns[:1]]
        return transitions, kicked

    def start(self, numbers: Array, constant: float = 1.0) -> Array:
        """The state (2, slots) of what is neutral, (2 b,), under a part of the constant forces."""
        state = np.zeros_like(self.kick)
        state[:, self.neutral] = numbers.reshape(2, -1)
        if self.mode.layout.constant >= 0:
            state[0, self.mode.layout.constant] = constant
        return state

    def neutral_numbers(self, states: Array) -> Array:
        """Of states (..., 2, slots) what is neutral, (..., 2 b)."""
        return np.asarray(states[..., self.neutral].reshape(*states.shape[:-2], -1))


def _neutral(mode: Mode) -> NDArray[np.intp]:
    """Slots of modes whose generator is singular, and all that are linked to them."""
    pairs, modes = mode.pairs, mode.layout.modes
    g = pairs.generator[:, modes]
    found = set(modes[g[0] * g[3] == g[1] * g[2]].tolist())
    links = [{*pair} & {*modes.tolist()} for pair in pairs.links.T.tolist()]
    while joined := [pair for pair in links if pair & found and not pair <= found]:
        found.update(*joined)
    return np.array(sorted(found), dtype=np.intp)


_motions: WeakKeyDictionary[Contact, FreeMotion] = WeakKeyDictionary()


def free_motion(contact: Contact) -> FreeMotion:
    """The free motion of a structure without forces, made once."""
    if contact not in _motions:
        _motions[contact] = FreeMotion(contact)
    return _motions[contact]


def forced_motion(contact: Contact, excitation: Excitation) -> FreeMotion:
    """The same under the constant forces, where some of the motion has no restoring force.

    Elsewhere it is at rest in another place: see `Terms`.
    """
    motion = free_motion(contact)
    if not len(motion.neutral) or not excitation.constant.any():
        return motion
    return FreeMotion(contact, excitation.constant)
