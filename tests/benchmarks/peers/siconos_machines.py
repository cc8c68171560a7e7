"""Siconos on machines with several stops, or with dry friction: time stepping of the first order.

Stops: ``MoreauJeanOSI`` with a ``LagrangianLinearTIR`` for each. Friction of constant force: a
``RelayNSL`` between slip velocity and force, with ``EulerMoreauOSI``, of the first order form.
Siconos 4.4 is Debian's package python3-siconos. It needs NumPy 1, and so an environment of its own,
with this package's requirements: ``python3 -m venv --system-site-packages``.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from dynkit.analysis.work_precision.methods import Unsuited
from dynkit.core.validation import Array
from dynkit.systems import DryFriction


def by_siconos(job: Any, step: float) -> Callable[[], Array]:
    """A run of a job of `tests.benchmarks.machines`; Unsuited where Siconos is missing."""
    try:
        kernel: Any = importlib.import_module("siconos.kernel")
    except ImportError:
        raise Unsuited("Siconos is not installed") from None
    rubs = any(isinstance(element, DryFriction) for element in job.system.elements)
    simulate = _with_friction if rubs else _with_stops
    return lambda: simulate(kernel, job, round(job.until / step))


def _with_stops(kernel: Any, job: Any, count: int) -> Array:
    s, n, step = job.system, len(job.position), job.until / count
    x, v = np.array(job.position), np.array(job.velocity)
    structure = kernel.LagrangianLinearTIDS(x, v, s.mass, s.stiffness, s.damping_matrix)
    structure.setFExtPtr(np.zeros(n))
    force = structure.fExt()  # a view: the array that was given is copied
    whole = kernel.NonSmoothDynamicalSystem(0.0, job.until)
    whole.insertDynamicalSystem(structure)
    for stop in s.elements:
        row, place = stop.sign * stop.row(n), -stop.sign * stop.offset
        relation = kernel.LagrangianLinearTIR(row.reshape(1, n).copy(), np.array([place]))
        law = kernel.NewtonImpactNSL(stop.restitution)
        whole.link(kernel.Interaction(law, relation), structure)
    times = kernel.TimeDiscretisation(0.0, step)
    simulation = kernel.TimeStepping(whole, times, kernel.MoreauJeanOSI(0.5), kernel.LCP())
    _run(simulation, force, job, count)
    return np.concatenate([structure.q(), structure.velocity()])


def _with_friction(kernel: Any, job: Any, count: int) -> Array:
    s, n, step = job.system, len(job.position), job.until / count
    inverse = np.linalg.inv(s.mass)
    flow = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-inverse @ s.stiffness, -inverse @ s.damping_matrix]]
    )
    structure = kernel.FirstOrderLinearDS(np.array([*job.position, *job.velocity]), flow)
    structure.setbPtr(np.zeros(2 * n))
    force = structure.b()
    whole = kernel.NonSmoothDynamicalSystem(0.0, job.until)
    whole.insertDynamicalSystem(structure)
    for rub in s.elements:
        row = rub.row(n)
        slip = np.append(np.zeros(n), row).reshape(1, 2 * n)
        push = np.append(np.zeros(n), inverse @ row).reshape(2 * n, 1)
        relation = kernel.FirstOrderLinearTIR(slip.copy(), push.copy())
        law = kernel.RelayNSL(1, -rub.kinetic, rub.kinetic)
        whole.link(kernel.Interaction(law, relation), structure)
    simulation = kernel.TimeStepping(whole, kernel.TimeDiscretisation(0.0, step))
    simulation.insertIntegrator(kernel.EulerMoreauOSI(0.5))
    simulation.insertNonSmoothProblem(kernel.Relay())
    _run(simulation, force[n:], job, count, inverse)
    return np.array(structure.x())


def _run(simulation: Any, force: Any, job: Any, count: int, inverse: Any = None) -> None:
    """All steps; the force, a view, is set in the middle of each."""
    s, step = job.system, job.until / count
    load = np.array(s.harmonic_forces).real
    load = load if inverse is None else inverse @ load
    for j in range(count):
        force[:] = load * np.sin(s.frequency * (j + 0.5) * step)
        simulation.computeOneStep()
        simulation.nextStep()
