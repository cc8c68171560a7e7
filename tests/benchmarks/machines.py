"""Error against run time of machines: two stops, and dry friction, beside time stepping.

Errors are those of positions and velocities at the end, against 60 digits. Moreau's scheme with a
fixed step is that of Siconos, a library, and the same in NumPy, for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, final

import numpy as np
from flint import arb, ctx
from scipy.integrate import solve_ivp

from dynkit.analysis.work_precision.measurement import Measurement
from dynkit.analysis.work_precision.methods import Unsuited
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain
from tests.benchmarks.peers.siconos_machines import by_siconos
from tests.benchmarks.report import by_job, measured
from tests.reference.machines import BITS, Machine

Run: TypeAlias = Callable[[], Array]

STEPS = (1e-2, 1e-3, 1e-4)
"""Of time stepping, in units of time."""


@final
@dataclass(frozen=True)
class MachineJob:
    """A machine, its start, and the time at which it is looked at."""

    system: ImpactChain
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    until: float


JOBS = {
    "two stops": MachineJob(
        ImpactChain(
            masses=2,
            damping=0.1,
            frequency=1.3,
            harmonic_forces=[0.0, 1.0],
            elements=[
                HardStop(1, offset=-0.4, restitution=0.7),
                HardStop(1, offset=0.9, side="below", restitution=0.7),
            ],
        ),
        (0.0, 0.0),
        (0.0, 0.0),
        20.0,
    ),
    "friction": MachineJob(
        ImpactChain(
            masses=2,
            damping=0.01,
            frequency=0.5,
            harmonic_forces=[0.0, 1.0],
            elements=[DryFriction(1, force=0.6)],
        ),
        (0.5, 1.0),
        (0.0, 0.0),
        20.0,
    ),
}


def exact(job: MachineJob) -> Array:
    """Positions and velocities at the end, in 60 digits."""
    machine = Machine(job.system)
    x, v = np.array(job.position), np.array(job.velocity)
    start = machine.start(x, v, np.empty(0), 0.0, 1.0)
    events, reason = machine.motion(start, job.until)
    if reason:
        raise RuntimeError(f"the motion must be followed to {job.until}; {reason}")
    with ctx.workprec(BITS):
        last = events[-1]
        flow = machine.flow(last.regimes)
        assert flow is not None
        end = (flow.matrix * (arb(job.until) - last.time)).exp() * last.state
        return np.array([float(end[i, 0].mid()) for i in range(2 * len(x))])


# --- methods --------------------------------------------------------------------------------------


def by_dynkit(job: MachineJob, _: float) -> Run:
    """Simulation until an impact, or a period, beyond the end."""
    count = 2 + int(job.until * job.system.frequency)

    def run() -> Array:
        start = job.system.state(job.position, job.velocity)
        record = job.system.simulate(impacts=count, start=start)
        return np.concatenate([part[0] for part in record.sample([job.until])])

    return run


def by_moreau(job: MachineJob, step: float) -> Run:
    """Moreau's scheme with theta = 1/2: where a contact is met a step ends as the laws say."""
    s, n, count = job.system, len(job.position), round(job.until / step)
    mass, damping, stiffness = s.mass, s.damping_matrix, s.stiffness
    whole = mass + 0.5 * step * damping + 0.25 * step * step * stiffness
    inverse = np.linalg.inv(whole)
    load = np.array(s.harmonic_forces).real
    rows = [(e, e.sign * e.row(n)) for e in s.elements]
    pushes = [inverse @ row for _, row in rows]

    def run() -> Array:
        x, v = np.array(job.position), np.array(job.velocity)
        for j in range(count):
            force = load * np.sin(s.frequency * (j + 0.5) * step)
            force = force - stiffness @ (x + 0.5 * step * v) - damping @ v
            new = v + step * (inverse @ force)
            for (element, row), push in zip(rows, pushes, strict=True):
                if isinstance(element, DryFriction):
                    most = step * element.kinetic
                    new += np.clip(-(row @ new) / (row @ push), -most, most) * push
                elif row @ (x + 0.5 * step * v) - element.sign * element.offset <= 0.0:
                    wanted = row @ new + element.restitution * (row @ v)
                    new += max(-wanted / (row @ push), 0.0) * push
            x, v = x + 0.5 * step * (v + new), new
        return np.concatenate([x, v])

    return run


def by_scipy(job: MachineJob, tolerance: float) -> Run:
    """DOP853 from impact to impact; friction is not for it, since its stick is no root."""
    s, n = job.system, len(job.position)
    if any(isinstance(element, DryFriction) for element in s.elements):
        raise Unsuited("stick is no root of a function")
    inverse, load = np.linalg.inv(s.mass), np.array(s.harmonic_forces).real

    def rates(t: float, z: Array) -> Array:
        force = load * np.sin(s.frequency * t) - s.stiffness @ z[:n] - s.damping_matrix @ z[n:]
        return np.concatenate([z[n:], inverse @ force])

    def gap_of(stop: Any) -> Any:
        row = stop.sign * np.append(stop.row(n), np.zeros(n))

        def gap(_: float, z: Array) -> float:
            return float(row @ z - stop.sign * stop.offset)

        gap.terminal, gap.direction = True, -1.0  # type: ignore[attr-defined]
        return gap

    gaps = [gap_of(stop) for stop in s.elements]
    options: Any = {"method": "DOP853", "rtol": tolerance, "atol": tolerance, "events": gaps}

    def run() -> Array:
        z, begin = np.array([*job.position, *job.velocity]), 0.0
        while True:
            found = solve_ivp(rates, (begin, job.until), z, **options)
            z, begin = found.y[:, -1].copy(), float(found.t[-1])
            if found.status == 0:
                return z
            (hit,) = (k for k, times in enumerate(found.t_events or ()) if len(times))
            stop = s.elements[hit]
            row = stop.row(n)
            push = inverse @ row
            z[n:] -= (1.0 + stop.restitution) * (row @ z[n:]) / (row @ push) * push

    return run


Method: TypeAlias = Callable[[MachineJob, float], Run]

METHODS: dict[str, tuple[Method, Sequence[float]]] = {
    "dynkit": (by_dynkit, (0.0,)),
    "DOP853": (by_scipy, (1e-4, 1e-8, 1e-12)),
    "Moreau": (by_moreau, STEPS),
    "Siconos": (by_siconos, STEPS),
}


def machines() -> Iterator[Measurement]:
    """Yield the measurement of each method at each tolerance on the jobs."""
    for name, job in JOBS.items():
        end = exact(job)
        for method, (prepare, tolerances) in METHODS.items():
            for tolerance in tolerances:
                entry = partial(Measurement, job=name, method=method)
                try:
                    run = prepare(job, tolerance)
                except Unsuited as reason:
                    yield entry(tolerance=math.nan, remark=str(reason))
                    break
                found, seconds = measured(run)
                error = float(abs(found - end).max())
                yield entry(tolerance=tolerance, error=error, seconds=seconds, starts=1)


if __name__ == "__main__":
    print(by_job(machines()))
