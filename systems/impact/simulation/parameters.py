"""Parameters with derivatives in closed form."""

from __future__ import annotations

import math
from typing import Any

from dynkit.systems.structure.lagrangian import share_derivation

EXACT = ("frequency", "restitution", "amplitude", "offset", "play")
"""Parameters with derivatives in closed form."""

OUTSIDE = (*EXACT, "harmonic_forces", "constant_forces", "contact", "side")
"""Parameters of the table and of the forces, which are no parameters of the structure."""


def changes_alone(oscillator: Any, name: str) -> bool:
    """Whether a parameter is one of `EXACT`, and no other parameter depends on it."""
    here = oscillator
    if name not in EXACT or name not in here.parameters or not math.isfinite(getattr(here, name)):
        return False
    there = here.replace(**{name: 0.5 * getattr(here, name) or 0.5})
    same = all(getattr(here, other) == getattr(there, other) for other in OUTSIDE if other != name)
    return same and share_derivation(here, there)
