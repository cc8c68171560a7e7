"""Points of branches, with bifurcations and multipliers, in impacts of the warm kernel."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from dynkit import continue_orbit
from dynkit.systems import ImpactChain
from tests.benchmarks.impacts import kernel
from tests.benchmarks.report import Line, in_turns

CASES = (
    ("P(1,3), 10 masses", 10, 0.87, {"periods": 3}, (0.7, 1.1), 900),
    ("P(8,2), 10 masses", 10, 0.42, None, (0.419, 0.4203), None),
    ("P(1,3), 100 masses", 100, 0.87, {"periods": 3}, (0.85, 0.89), None),
    ("P(1,3), 1000 masses", 1000, 0.87, {"periods": 3}, (0.8699, 0.8701), None),
    ("P(inf,1), 10 masses", 10, 0.202, {"sticking": True}, (0.19, 0.21), None),
    ("P(inf,2), 10 masses", 10, 0.408, {"sticking": True, "periods": 2}, (0.39, 0.42), None),
)


def continuation() -> Iterator[Line]:
    """The lines of this file."""
    impact = kernel()
    for name, masses, frequency, search, bounds, most in CASES:
        chain = ImpactChain(masses=masses, frequency=frequency)
        if search is None:
            orbit = chain.attractor(transient=1500).periodic_orbit()
        else:
            orbit = chain.periodic_orbit(**search)
        branch = continue_orbit(orbit, "frequency", bounds=bounds)
        again = partial(continue_orbit, orbit, "frequency", bounds=bounds)
        (seconds,) = in_turns(again, runs=3 if masses < 1000 else 1)
        point = seconds / len(branch)
        yield Line(f"point of a branch, {name}", point, "an impact of a long run", impact, most)
    large = ImpactChain(masses=1000, frequency=0.87)
    orbit = large.periodic_orbit(periods=3)
    problem = orbit.problem("frequency")
    (multipliers,) = in_turns(
        lambda: problem.multipliers(orbit.unknowns, problem.values + 1e-9), runs=3
    )
    yield Line("multipliers of P(1,3), 1000 masses", multipliers, "limit", 0.2, 1)
