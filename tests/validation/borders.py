"""Where orbits that stick end (CB) against 30 digits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from flint import arb, ctx

from dynkit import Bifurcation, NoConvergence, continue_orbit
from tests.impact_orbits.exact_borders import border
from tests.impact_orbits.exact_sticking import BITS
from tests.reference.random_cases import Kept
from tests.reference.random_sticking import FILE, sticking_orbit

NAMES = ("offset", "amplitude", "frequency")
ROWS = 2
"""Every so manieth orbit is followed."""


def borders_of_sticking_orbits(every: int) -> Iterator[tuple[float, float]]:
    """CB of P(inf,m) as the offset, the amplitude or the frequency changes."""
    kept = Kept.load(FILE)
    for row in range(0, len(kept.number), ROWS * every):
        for found in borders_of(int(kept.number[row])):
            with suppress(ArithmeticError):  # 30 digits do not find the orbit
                yield off(found)


def off(found: Bifurcation) -> tuple[float, float]:
    """True and claimed error of a border."""
    with ctx.workprec(BITS):
        true = float(abs(arb(found.value) - border(found)).mid())
    return true, found.error + 2.0**-53 * abs(found.value)


def borders_of(number: int) -> list[Bifurcation]:
    """Those between which the orbit of this number is a motion."""
    orbit = sticking_orbit(number)
    assert orbit is not None
    name = NAMES[number % 3]
    here = orbit.system.value_of(name)
    bounds = (here - 0.1, here + 0.1) if name == "offset" else (0.3 * here, 2.0 * here)
    try:
        branch = continue_orbit(
            orbit, name, bounds=bounds, step=0.1, largest_step=0.5, points=8, inadmissible=False
        )
    except NoConvergence:
        return []
    return [found for found in branch.bifurcations if found.kind == "CB"]
