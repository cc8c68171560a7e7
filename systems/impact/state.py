"""States of an impact oscillator."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, final

from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.oscillator import ImpactOscillator


class Motion(Enum):
    """Where in its motion an impact oscillator is; the value is what the user reads."""

    FLIGHT = "in flight"
    TABLE = "on the table"
    RELEASE = "just released by the table"


@final
@dataclass(frozen=True, eq=False)
class ImpactState:
    """Positions, velocities and phase of an impact oscillator, from its `state` or a record.

    A simulation that starts from a record's final state goes on bit for bit.

    Attributes
    ----------
    position, velocity : (N,) arrays, read-only
    phase : float
        Phase of the table in [0, 2 pi).
    relative_velocity : float
        Contact velocity less the table's; exact after an impact, where the difference of the two
        velocities would have lost digits.
    motion : Motion
    """

    position: Array
    velocity: Array
    phase: float
    relative_velocity: float
    motion: Motion
    _system: ImpactOscillator = field(repr=False)
    _coordinates: Array = field(repr=False)
