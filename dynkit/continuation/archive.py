"""Branches and curves in stores: orbits are made of what is read where one like them is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynkit.data import store
from dynkit.data.dataset import Variables
from dynkit.orbits.problem import PeriodicOrbit

if TYPE_CHECKING:
    from dynkit.core.smooth_map import SmoothMap
    from dynkit.core.validation import Array

ERROR = (
    "to first order a bound on the distance from the exact curve, "
    "in ranges of parameters and typical sizes of unknowns"
)
"""What `error` means."""


def identity_of(system: SmoothMap, free: Mapping[str, float]) -> dict[str, str]:
    """Return what a store says of a system; free parameters stand at their first values."""
    return store.identity_of(system.replace(**free))


def refuse_other_orbits(
    file: Path,
    archive: store.Archive,
    label: str,
    unknowns: Array,
    orbit: PeriodicOrbit,
    free: Mapping[str, float],
) -> None:
    """Refuse an orbit of another kind or system than that of a branch or a curve in a store.

    Raises
    ------
    ValueError
        Naming what differs.
    """
    if orbit.label != label:
        raise ValueError(f"store {file} was made with orbits {label}; got {orbit.label}")
    for name in free:
        if name not in orbit.system.parameters:
            raise ValueError(
                f"store {file} was made with parameter {name}; got a system without it"
            )
    store.refuse_other_system(file, archive, orbit.system.replace(**free))
    size, given = unknowns.shape[1], orbit.problem(*free).size
    if given != size:
        raise ValueError(f"store {file} was made with {size} unknowns; got {given}")


def error_known(found: Any) -> Variables:
    """Return the error of a branch or a curve, where it is known or can be worked out."""
    if found._problem is None and "error" not in vars(found):
        return {}
    return {"error": ("point", found.error)}


def ends(endings: Sequence[object]) -> dict[str, str]:
    """Return attributes that say why and where a branch or a curve begins and ends."""
    return {"begins_where": str(endings[0]), "ends_where": str(endings[1])}
