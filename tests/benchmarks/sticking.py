"""Speed of orbits that stick: a point corrected, a branch, and simulation beside chaos."""

from __future__ import annotations

from time import process_time

from dynkit import continue_orbit
from dynkit.orbits.newton import solve
from dynkit.systems import ImpactChain
from tests.benchmarks.lyapunov import processor_time
from tests.benchmarks.report import table

CASES = (
    ("P(inf,1), 0.202", 0.202, 1, 0.85, (0.19, 0.21)),
    ("P(inf,2), 0.408", 0.408, 2, 0.85, (0.39, 0.42)),
    ("P(inf,1), 0.408, without rebound", 0.408, 1, 0.0, (0.39, 0.42)),
)


def sticking() -> None:
    """Print the tables."""
    rows = []
    for name, frequency, periods, restitution, bounds in CASES:
        chain = ImpactChain(frequency=frequency, restitution=restitution)
        began = process_time()
        orbit = chain.periodic_orbit(sticking=True, periods=periods)
        search = process_time() - began
        problem = orbit.problem("frequency")
        p = problem.values + 1e-5

        def corrected() -> None:
            x, _ = solve(problem, orbit.unknowns, p)  # noqa: B023
            problem.multipliers(x, p)  # noqa: B023

        point = processor_time(corrected)
        began = process_time()
        branch = continue_orbit(orbit, "frequency", bounds=bounds)
        seconds = process_time() - began
        found = ", ".join(f"{b.kind} {b.value:.10g}" for b in branch.bifurcations)
        rows.append(
            (name, f"{search:.2f}", f"{1e3 * point:.1f}", len(branch), f"{seconds:.2f}", found)
        )
    head = ("orbit", "search (s)", "point (ms)", "points", "branch (s)", "bifurcations")
    table("Orbits that stick, N = 10, processor time", head, rows)
    speeds = []
    for frequency, motion in ((0.35, "chaos"), (0.408, "sticking")):
        chain = ImpactChain(frequency=frequency)
        start = chain.simulate(impacts=3000).final
        seconds = processor_time(lambda: chain.simulate(impacts=20_000, start=start))  # noqa: B023
        speeds.append((frequency, motion, f"{1e6 * seconds / 20_000:.2f}"))
    table("Impacts, N = 10, processor time", ("frequency", "motion", "us per impact"), speeds)


if __name__ == "__main__":
    sticking()
