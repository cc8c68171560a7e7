"""What is known of the points of a branch, and of what happens between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, final

from dynkit.core.validation import Array
from dynkit.orbits.events import Event
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.spectrum import Spectrum


@final
class Crossing(NamedTuple):
    """What happens within a step: the kind, the event of GR and CB, and whether it is the end."""

    kind: BifurcationKind
    event: int = -1
    ends: bool = False


@final
class Located(NamedTuple):
    """A bifurcation that was solved for: all unknowns, and how wrong they may be.

    `errors`, (m + e + 1,), are those of `x`, `own` and `p`.
    """

    crossing: Crossing
    x: Array
    own: Array
    p: Array
    errors: Array
    multiplier: complex | None
    direction: Any
    history: tuple[float, ...]
    seconds: float
    steps: int


@final
@dataclass(frozen=True, slots=True)
class Seen:
    """What is known of the orbit of a point; `crossings` are those since the point before.

    At the `branch_point` among them, if there is one, the branch goes along `flat`, in scaled
    unknowns, if it folds there: it is symmetric about the one that it meets.
    """

    kind: Spectrum
    spectrum: Any
    admissible: bool
    events: tuple[Event, ...]
    flip: bool
    pairs: int
    inside: int
    crossings: tuple[Crossing, ...] = ()
    branch_point: Located | None = None
    flat: Array | None = None
