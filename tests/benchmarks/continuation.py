"""Speed of continuation: points per second, bifurcations and stability included."""

from __future__ import annotations

from time import process_time

from dynkit import PeriodicOrbit, continue_orbit
from dynkit.systems import ImpactChain
from tests.benchmarks.report import table

CASES = (
    ("P(1,3), N = 10", 10, 0.87, (0.7, 1.1)),
    ("P(8,2), N = 10", 10, 0.42, (0.419, 0.4203)),
    ("P(1,3), N = 100", 100, 0.87, (0.85, 0.89)),
    ("P(1,3), N = 1000", 1000, 0.87, (0.8699, 0.8701)),
)


def continuation() -> None:
    """Print the table."""
    rows = []
    for name, masses, frequency, bounds in CASES:
        chain = ImpactChain(masses=masses, frequency=frequency)
        orbit: PeriodicOrbit
        if name.startswith("P(1,3)"):
            orbit = chain.periodic_orbit(periods=3)
        else:
            orbit = chain.attractor(transient=1500).periodic_orbit()
        seconds = float("inf")
        for _ in range(3 if masses < 1000 else 1):
            began = process_time()
            branch = continue_orbit(orbit, "frequency", bounds=bounds)
            seconds = min(seconds, process_time() - began)
        found = ", ".join(f"{b.kind} {b.value:.6g}" for b in branch.bifurcations)
        rows.append((name, len(branch), found, f"{len(branch) / seconds:.3g}"))
    table("Continuation", ("branch", "points", "bifurcations", "points per second"), rows)
