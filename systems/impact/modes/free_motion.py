"""Free motion of a structure, and its response to impulses along a contact row."""

from __future__ import annotations

from typing import final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.impact.modes.constrained import mode_of
from dynkit.systems.impact.modes.mode import Mode
from dynkit.systems.impact.modes.structure import Contact, Excitation


@final
class FreeMotion:
    """Free motion of a structure, without table and forces; states are (2, slots).

    Parameters
    ----------
    contact : Contact

    Attributes
    ----------
    neutral : (b,)
        Slots of motions without restoring force, and of motions that dashpots couple to these.
        Repeated kicks of one such slot alone have no periodic response.
    kick : (2, slots)
        Change of the state due to an impulse that changes the contact velocity by one.
    """

    def __init__(self, contact: Contact) -> None:
        none = np.zeros(len(contact.row))
        self.mode: Mode = mode_of(
            contact.structure,
            Excitation(1.0, none.astype(complex), none, turns=False),
            (),
            (),
            [contact.row],
            [contact.row],
        )
        self._row = self.mode.row(contact.row)
        self.kick = self.mode.placed(contact.kick[:2])
        self.neutral = _neutral(self.mode)

    @cached_property
    def vectors(self) -> Array:
        """Kick, its rate of change, rows of contact position and velocity: (4, 2N), modes only."""
        modes = self.mode.layout.modes
        rows = [self.mode.pairs.derivative_rows(self._row, order) for order in (0, 1)]
        place, speed = np.stack(rows)[..., modes]
        kick, pushed = self.kick[:, modes], self.mode.rate(self.kick)[:, modes]
        return np.stack([kick, pushed, place, speed]).reshape(4, -1)

    @cached_property
    def spread(self) -> float:
        """Difference between the decay rates of the fastest and the slowest decaying mode."""
        g = self.mode.pairs.generator[:, self.mode.layout.modes]
        half = 0.5 * (g[0] + g[3])
        root = np.sqrt(np.maximum(half * half - (g[0] * g[3] - g[1] * g[2]), 0.0))
        return float((half + root).max() - (half - root).min())


def _neutral(mode: Mode) -> NDArray[np.intp]:
    """Slots of modes whose 2x2 block is singular, and of all modes linked to them."""
    pairs, modes = mode.pairs, mode.layout.modes
    g = pairs.generator[:, modes]
    found = set(modes[g[0] * g[3] == g[1] * g[2]].tolist())
    links = [{*pair} & {*modes.tolist()} for pair in pairs.links.T.tolist()]
    while joined := [pair for pair in links if pair & found and not pair <= found]:
        found.update(*joined)
    return np.array(sorted(found), dtype=np.intp)


_motions: WeakKeyDictionary[Contact, FreeMotion] = WeakKeyDictionary()


def free_motion(contact: Contact) -> FreeMotion:
    """The free motion of a structure without forces; computed once."""
    found = _motions.get(contact)
    if found is None:
        found = _motions[contact] = FreeMotion(contact)
    return found
