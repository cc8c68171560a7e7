"""Periodic responses of a structure to impulses at its contact coordinate."""

from __future__ import annotations

from functools import cached_property
from typing import final
from weakref import WeakKeyDictionary

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.mode import Mode, Transitions, free_mode
from dynkit.systems.impact.structure import Drive, Structure


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
        self.mode: Mode = free_mode(structure, quiet)
        row = self.mode.row(np.eye(n)[structure.contact])
        self.rows = np.stack(
            [self.mode.pairs.derivative_rows(row, order).ravel() for order in range(4)]
        )
        self.bounds = np.stack([self.mode.pairs.bound(row, order) for order in (0, 1, 2, 6)])
        self.kick = self.mode.placed(structure.kick[:2])
        self._returns: list[tuple[float, Transitions, Array]] = []

    @cached_property
    def vectors(self) -> Array:
        """(4, 2N) kick, its rate of change, and the rows of place and velocity, of the modes."""
        modes = self.mode.layout.modes
        place, speed = self.rows[:2].reshape(2, 2, -1)[..., modes]
        kick, pushed = self.kick[:, modes], self.mode.rate(self.kick)[:, modes]
        return np.stack([kick, pushed, place, speed]).reshape(4, -1)

    @property
    def rigid(self) -> bool:
        """Whether a part of the motion has no restoring force: no response is periodic then."""
        pairs, modes = self.mode.pairs, self.mode.layout.modes
        g = pairs.generator[:, modes]
        return bool((g[0] * g[3] == g[1] * g[2]).any())

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
        transitions = self.mode.transitions(np.array([period]))
        kicked = np.asarray(transitions.periodic(self.kick))
        kicked.setflags(write=False)
        self._returns = [(period, transitions, kicked), *self._returns[:1]]
        return transitions, kicked


_motions: WeakKeyDictionary[Structure, FreeMotion] = WeakKeyDictionary()


def free_motion(structure: Structure) -> FreeMotion:
    """The free motion of a structure, made once."""
    if structure not in _motions:
        _motions[structure] = FreeMotion(structure)
    return _motions[structure]
