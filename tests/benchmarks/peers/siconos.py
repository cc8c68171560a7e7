"""Siconos: Moreau's time stepping of a library for nonsmooth dynamics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, final

import numpy as np

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    FoundImpacts,
    ImpactMethod,
    OverBudget,
    Simulation,
    Unsuited,
)
from dynkit.analysis.work_precision.models import ImpactModel
from dynkit.core.validation import Array

CONTACT = 3
"""So many steps in a row with an impulse are a contact; fewer are bounces."""


@final
class Siconos(ImpactMethod):
    """``MoreauJeanOSI`` with theta = 1/2 in a ``TimeStepping``; its tolerance is the step.

    The step is given as a part of the table's period. The structure is a ``LagrangianLinearTIDS``
    that sees the table at rest: what the table's motion does is a force, set before each step.
    Siconos is no Python package that pip finds; it comes with distributions, or is compiled.

    Parameters
    ----------
    tolerances : sequence of float
    budget : int
        Steps.

    References
    ----------
    V. Acary et al., An introduction to Siconos, INRIA technical report 340 (2019).
    """

    name = "Siconos"

    def __init__(
        self, tolerances: Sequence[float] = (1e-2, 1e-3, 1e-4), budget: int = 400_000
    ) -> None:
        self.tolerances = tuple(tolerances)
        self.budget = budget

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        try:
            import siconos.kernel as kernel
        except ImportError:
            raise Unsuited("Siconos is not installed") from None
        model = ImpactModel.of(exact)
        h = tolerance * exact.period
        return lambda budget: _simulate(kernel, model, h, budget)


def _simulate(kernel: Any, model: ImpactModel, h: float, budget: int) -> FoundImpacts:
    steps = math.ceil(model.until / h)
    if steps > budget:
        raise OverBudget("steps")
    n, c = model.size, model.contact
    unit = np.eye(n)[c]
    columns = np.stack([model.stiffness[:, c], model.damping[:, c], model.mass[:, c]], axis=1)
    there, speed, _ = model.table(0.0)
    structure = kernel.LagrangianLinearTIDS(
        model.position - there * unit, model.velocity - speed * unit, model.mass, model.stiffness,
        model.damping,
    )  # fmt: skip
    structure.setFExtPtr(np.zeros(n))
    force = structure.fExt()  # a view: the array that was given is copied
    relation = kernel.LagrangianLinearTIR((model.sign * unit).reshape(1, n).copy())
    contact = kernel.Interaction(kernel.NewtonImpactNSL(model.restitution), relation)
    whole = kernel.NonSmoothDynamicalSystem(0.0, steps * h)
    whole.insertDynamicalSystem(structure)
    whole.link(contact, structure)
    scheme = kernel.MoreauJeanOSI(0.5)
    simulation = kernel.TimeStepping(whole, kernel.TimeDiscretisation(0.0, h), scheme, kernel.LCP())
    times: list[float] = []
    states: list[tuple[Array, Array]] = []
    releases: list[float] = []
    row = 0  # steps in a row with an impulse
    for j in range(steps):
        middle = (j + 0.5) * h
        force[:] = model.forces(middle) - columns @ np.array(model.table(middle))
        simulation.computeOneStep()
        time = (j + 1) * h
        if contact.lambda_(1)[0] > 0.0:
            row += 1
            if row == 1:
                there, speed, _ = model.table(time)
                times.append(time)
                states.append((structure.q() + there * unit, structure.velocity() + speed * unit))
        else:
            if row >= CONTACT:
                releases.append(j * h)
            row = 0
        simulation.nextStep()
    return FoundImpacts(
        np.array(times),
        np.array([x for x, _ in states]).reshape(-1, n),
        np.array([v for _, v in states]).reshape(-1, n),
        np.array(releases),
        {"steps": steps},
    )
