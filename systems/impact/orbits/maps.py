"""Orbits of the impact map where no equations by itinerary are known: from motions near them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynkit.core.validation import positive_integer
from dynkit.orbits.newton import NoConvergence
from dynkit.systems.impact.simulation.state import TWO_PI, ImpactState

if TYPE_CHECKING:
    from dynkit.orbits.map_orbit import MapOrbit
    from dynkit.systems.impact.impact_map import ImpactMap

_TRANSIENT, _WHOLE = 700, 1e-6


def map_orbit_from(
    system: ImpactMap, impacts: object, periods: object, start: ImpactState | None
) -> MapOrbit:
    """The orbit of n impacts near the motion from a state, or after a transient.

    Raises
    ------
    NoConvergence
        When Newton's method does not converge, or the orbit has another period.
    NoMotion
        When there are fewer impacts.
    """
    from dynkit.orbits.periodic_orbit import periodic_orbit

    n, m = positive_integer("impacts", impacts), positive_integer("periods", periods)
    state = system._entered(start)
    if start is None:
        state = system._run(state, _TRANSIENT, store=False).final
    guess: Any = system.simulate(impacts=n, start=state).states
    orbit = periodic_orbit(system, guess, period=n)
    again = system.simulate(impacts=n, start=system.impact_state(orbit.states[0]))
    turns = float(again.time[-1]) * system.frequency / TWO_PI
    if abs(turns - m) > _WHOLE * m:
        raise NoConvergence(
            f"the orbit of {n} impacts near this motion has {turns:.6g} periods, not {m}"
        )
    return orbit
