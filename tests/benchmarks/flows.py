"""Error against run time of flows: dynkit beside SciPy, heyoka by itself, and diffrax.

Errors are those against Taylor series of sixty digits, relative to the largest coordinate. What the
peers integrate is compiled where that is their way: heyoka and diffrax compile, SciPy calls Python.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, final

import heyoka as hy
import numpy as np
from flint import arb
from scipy.integrate import solve_ivp

from dynkit.analysis.work_precision.drawing import Job, draw_all
from dynkit.analysis.work_precision.measurement import Measurement
from dynkit.core.validation import Array
from dynkit.plotting.figures import write_figure
from dynkit.systems import HenonHeiles, Lorenz, SymbolicFlow, VanDerPol
from tests.benchmarks.report import by_job, measured
from tests.flows.cases import VelocityOf, followed_in_many_digits

Rates: TypeAlias = Callable[[Any], list[Any]]
"""Rates of a state, in numbers of any kind: floats, flint's, expressions of heyoka, JAX's."""

Run: TypeAlias = Callable[[], Array]

TOLERANCES = (1e-4, 1e-7, 1e-10, 1e-13)
_DOUBLE = 2.0**-52


def lorenz(s: Any) -> list[Any]:
    return [10.0 * (s[1] - s[0]), s[0] * (28.0 - s[2]) - s[1], s[0] * s[1] - s[2] * 8.0 / 3.0]


def galaxy(s: Any) -> list[Any]:
    x, y, u, v = (s[i] for i in range(4))
    return [u, v, -x - 2.0 * x * y, -y - x * x + y * y]


def van_der_pol(s: Any) -> list[Any]:
    return [s[1], 20.0 * (1.0 - s[0] * s[0]) * s[1] - s[0]]


@final
@dataclass(frozen=True)
class FlowJob:
    """A flow, its rates written out once more, a start, and a duration."""

    flow: SymbolicFlow
    rates: Rates
    start: tuple[float, ...]
    duration: float


JOBS = {
    "Lorenz, 10 units of time": FlowJob(Lorenz(), lorenz, (1.0, 2.0, 20.0), 10.0),
    "Henon-Heiles, 100 units": FlowJob(HenonHeiles(), galaxy, (0.1, 0.2, 0.3, -0.1), 100.0),
    "van der Pol, mu = 20, 60 units": FlowJob(VanDerPol(mu=20.0), van_der_pol, (2.0, 0.0), 60.0),
}


def exact(job: FlowJob) -> Array:
    """Return the state at the end, by Taylor series of sixty digits."""
    velocity: VelocityOf = job.rates
    if job.rates is lorenz:  # the float 8/3 is not the number: divide as the others do
        velocity = _lorenz_in_balls
    end = followed_in_many_digits(velocity, list(job.start), job.duration)
    return np.array([float(x) for x in end])


def _lorenz_in_balls(s: Any) -> list[Any]:
    beta = arb(8.0 / 3.0)
    return [10 * (s[1] - s[0]), s[0] * (28 - s[2]) - s[1], s[0] * s[1] - beta * s[2]]


# --- methods --------------------------------------------------------------------------------------


def by_dynkit(job: FlowJob, _: float) -> Run:
    """`SymbolicFlow.advance`, whose accuracy is that of doubles."""
    return lambda: job.flow.advance(np.array(job.start), job.duration)


def by_scipy(method: str, job: FlowJob, tolerance: float) -> Run:
    def rates(_: float, state: Array) -> Any:
        return job.rates(state.tolist())

    span, jacobian = (0.0, job.duration), {}
    if method == "Radau":
        jacobian = {"jac": lambda _, state: job.flow.velocity_jacobian(state)}
    options: Any = {"method": method, "rtol": tolerance, "atol": tolerance, **jacobian}
    return lambda: np.asarray(solve_ivp(rates, span, job.start, **options).y[:, -1])


def by_heyoka(job: FlowJob, tolerance: float) -> Run:
    variables = hy.make_vars(*(f"x{i}" for i in range(len(job.start))))
    system = list(zip(variables, job.rates(variables), strict=True))
    integrator = hy.taylor_adaptive(system, list(job.start), tol=max(tolerance, _DOUBLE))

    def run() -> Array:
        integrator.time = 0.0
        integrator.state[:] = job.start
        integrator.propagate_until(job.duration)
        return np.array(integrator.state)

    return run


def by_diffrax(job: FlowJob, tolerance: float) -> Run:
    diffrax, jax = importlib.import_module("diffrax"), importlib.import_module("jax")
    jax.config.update("jax_enable_x64", True)
    term = diffrax.ODETerm(lambda _t, y, _args: jax.numpy.stack(job.rates(y)))
    control = diffrax.PIDController(rtol=tolerance, atol=tolerance)

    def solved(start: Any) -> Any:
        found = diffrax.diffeqsolve(
            term, diffrax.Dopri8(), 0.0, job.duration, None, start,
            stepsize_controller=control, max_steps=10**6,
        )  # fmt: skip
        return found.ys[-1]

    run: Any = jax.jit(solved)
    start = jax.numpy.array(job.start)
    return lambda: np.asarray(run(start).block_until_ready())


Method: TypeAlias = Callable[[FlowJob, float], Run]

METHODS: dict[str, tuple[Method, Sequence[float]]] = {
    "dynkit": (by_dynkit, (_DOUBLE,)),
    "heyoka": (by_heyoka, (*TOLERANCES, _DOUBLE)),
    "DOP853": (partial(by_scipy, "DOP853"), TOLERANCES),
    "RK45": (partial(by_scipy, "RK45"), TOLERANCES[:3]),
    "Radau": (partial(by_scipy, "Radau"), TOLERANCES[:3]),
    "diffrax Dopri8": (by_diffrax, TOLERANCES),
}


def measurements(jobs: Sequence[str] | None = None) -> Iterator[Measurement]:
    """Yield the measurement of each method at each tolerance on the jobs, by name."""
    for name in JOBS if jobs is None else jobs:
        job = JOBS[name]
        end = exact(job)
        size = float(abs(end).max())
        for method, (prepare, tolerances) in METHODS.items():
            for tolerance in tolerances:
                entry = partial(Measurement, job=name, method=method)
                try:
                    run = prepare(job, tolerance)
                except ModuleNotFoundError as missing:
                    yield entry(tolerance=math.nan, remark=f"{missing.name} is not installed")
                    break
                found, seconds = measured(run)
                error = float(abs(found - end).max()) / size
                yield entry(tolerance=tolerance, error=error, seconds=seconds, starts=1)


def flows(out: Path | None = None, resolution: float = 600.0) -> list[Measurement]:
    """Measure all, and write the figure if a file is named."""
    found = list(measurements())
    if out is not None:
        panels = [
            (
                Job(name, 1, math.nan, 0.0),
                [[one for one in found if (one.job, one.method) == (name, m)] for m in METHODS],
            )
            for name in JOBS
        ]
        write_figure("out", out, draw_all(panels), resolution)
        print(f"written: {out}")
    return found


if __name__ == "__main__":
    print(by_job(flows(Path(sys.argv[1]) if len(sys.argv) > 1 else None)))
