"""Where orbits that stick end (CB) against 30 digits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from flint import arb, ctx

from dynkit import Bifurcation, NoConvergence, PeriodicOrbit, continue_orbit
from tests.impact_orbits.exact_borders import border
from tests.impact_orbits.exact_sticking import BITS
from tests.reference.random_cases import Kept
from tests.reference.random_sticking import FILE, random_sticking, sticking_orbit

NAMES = ("offset", "amplitude", "frequency")
ROWS = 2
"""Every so manieth orbit is followed."""

NEAR = (
    (47, 0.535), (72, 0.125), (234, 0.0623),
    (588, 0.0141), (645, -0.00315), (645, 0.0817),
    (707, 0.204), (864, 0.0654), (957, 0.000322), (1383, -0.0204), (1543, 0.042), (1557, 0.0182),
    (1557, 0.0696), (1956, 0.0263), (2070, -0.0986), (2185, 0.0846), (2200, 0.0816),
    (2311, 0.131), (2311, 0.0775), (2364, 0.0219),
)  # fmt: skip
"""Orbits by their number, and values of their parameter near which they end.

Of every eleventh orbit that is kept: one in six ends where `borders_of` follows it. Three that take
long are left out. These values are 3 % of the way from where it ends to where it is kept.
"""
PART = 0.06
"""Of that way: so far an orbit of `NEAR` is followed in both directions."""


def borders_of_sticking_orbits(every: int) -> Iterator[tuple[float, float]]:
    """CB of P(inf,m) as the offset, the amplitude or the frequency changes."""
    kept = Kept.load(FILE)
    for row in range(0, len(kept.number), ROWS * every):
        for found in borders_of(int(kept.number[row])):
            with suppress(ArithmeticError):  # 30 digits do not find the orbit
                yield off(found)


def borders_nearby(every: int) -> Iterator[tuple[float, float]]:
    """The same of orbits that are known to end nearby, which take few steps."""
    for number, value in NEAR[::every]:
        for found in borders_near(number, value):
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
        return _borders(orbit, name, bounds, step=0.1)
    except NoConvergence:
        return []


def borders_near(number: int, value: float) -> list[Bifurcation]:
    """Those near a value of the parameter of the orbit of this number."""
    system, name = random_sticking(number), NAMES[number % 3]
    reach = PART * abs(system.value_of(name) - value)
    there = system.replace(**{name: value})
    orbit = there.attractor(transient=500, impacts=200).periodic_orbit()
    return _borders(orbit, name, (value - reach, value + reach), step=0.5)


def _borders(
    orbit: PeriodicOrbit, name: str, bounds: tuple[float, float], step: float
) -> list[Bifurcation]:
    branch = continue_orbit(
        orbit, name, bounds=bounds, step=step, largest_step=0.5, points=8, inadmissible=False
    )
    return [found for found in branch.bifurcations if found.kind == "CB"]
