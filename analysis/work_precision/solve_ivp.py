"""SciPy's `solve_ivp` with a terminal event, as a user of SciPy would write it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, TypeAlias, final

import numpy as np

from dynkit.analysis.work_precision.event_driven import (
    ContactMatrices,
    Integrator,
    simulate,
    smallest_bounce,
)
from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    GaveUp,
    ImpactMethod,
    OverBudget,
    Simulation,
)
from dynkit.analysis.work_precision.models import ImpactModel, first_order
from dynkit.core.validation import Array

Solver: TypeAlias = Literal["RK45", "DOP853", "Radau", "LSODA"]

BUDGETS: dict[str, int] = {"Radau": 40_000}
"""Numbers of evaluations that take some seconds, for solvers whose 150,000 take longer."""

ABSOLUTE = 1e-2
"""Ratio of the absolute to the relative tolerance, in units of the start's largest coordinate."""

LONGEST = 0.1
"""Longest step, relative to the table's period, which step control alone would not resolve."""


@final
class SolveIVP(ImpactMethod):
    """One ``solve_ivp`` per flight; its tolerance is the relative one.

    The right-hand side is one product of a matrix and a vector; implicit solvers get the Jacobian.
    The first step after an impact is a quarter of the expected flight, so that no bounce is stepped
    over.

    Parameters
    ----------
    solver : {"RK45", "DOP853", "Radau", "LSODA"}
    tolerances : sequence of float
    budget : int, optional
        Evaluations of the right-hand side; by default a number that takes some seconds.
    """

    def __init__(
        self,
        solver: Solver,
        tolerances: Sequence[float] = (1e-3, 1e-6, 1e-9, 1e-12),
        budget: int | None = None,
    ) -> None:
        self.name = self.solver = solver
        self.tolerances = tuple(tolerances)
        self.budget = BUDGETS.get(solver, 150_000) if budget is None else budget

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        import scipy.integrate  # noqa: F401

        model = ImpactModel.of(exact)
        contact, cut = ContactMatrices(model), smallest_bounce(model, tolerance)
        return lambda budget: simulate(_SciPy(contact, self.solver, tolerance, budget), cut)


@final
class _SciPy(Integrator):
    def __init__(
        self, contact: ContactMatrices, solver: str, tolerance: float, budget: int
    ) -> None:
        super().__init__(contact)
        model = contact.model
        self._inverse, self._matrix = first_order(model.mass, model.damping, model.stiffness)
        size = max(float(abs(model.position).max()), model.amplitude)
        self._options: dict[str, Any] = {
            "method": solver,
            "rtol": max(tolerance, 100.0 * 2.0**-52),  # the least that solve_ivp accepts
            "atol": ABSOLUTE * tolerance * (size or 1.0),
            "max_step": LONGEST * 2.0 * math.pi / model.frequency,
        }
        self._implicit = solver in ("Radau", "LSODA")
        self._left = self._budget = budget

    def fly(
        self, time: float, state: Array, end: float, flight: float
    ) -> tuple[float, Array, bool]:
        model, c, sign = self.model, self.model.contact, self.model.sign

        def gap(t: float, y: Array) -> float:
            return sign * (float(y[c]) - model.table(t)[0])

        first = 0.25 * flight if flight < math.inf else None
        return self._until(self._rate, gap, self._matrix, (time, state, end), first)

    def pass_freely(self, time: float, state: Array, end: float) -> Array:
        return self._until(self._rate, None, self._matrix, (time, state, end), None)[1]

    def hold(self, time: float, state: Array, end: float) -> tuple[float, Array, bool]:
        contact = self.contact
        return self._until(contact.rate, contact.force, contact.matrix, (time, state, end), None)

    def work(self) -> dict[str, int]:
        return {"evaluations": self._budget - self._left}

    def _rate(self, t: float, y: Array) -> Array:
        out = self._matrix @ y
        if self.model.forced:
            out[self.model.size :] += self._inverse @ self.model.forces(t)
        return np.asarray(out)

    def _until(
        self,
        rate: Callable[[float, Array], Array],
        event: Callable[[float, Array], float] | None,
        matrix: Array,
        begin: tuple[float, Array, float],
        first: float | None,
    ) -> tuple[float, Array, bool]:
        from scipy.integrate import solve_ivp

        time, state, end = begin
        if not time < end:
            return time, state, False

        def counted(t: float, y: Array) -> Array:
            self._left -= 1
            if self._left < 0:
                raise OverBudget("evaluations")
            return rate(t, y)

        options = {**self._options, **({"jac": matrix} if self._implicit else {})}
        if self._options["method"] == "LSODA":
            options["jac"] = lambda _t, _y: matrix  # LSODA requires a function
        if first is not None:
            options["first_step"] = min(first, end - time)
        if event is not None:
            falling = options["events"] = partial(event)
            vars(falling).update(terminal=True, direction=-1.0)  # a downward zero ends the flight
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # LSODA warns before it reports its failure
            try:
                found = solve_ivp(counted, (time, end), state, **options)
            except ValueError as failure:
                if "different signs" not in str(failure):  # a message of its root finder
                    raise
                raise GaveUp(f"gave up: {failure}") from None
        if found.status < 0:
            raise GaveUp(f"gave up: {found.message}")
        return float(found.t[-1]), np.asarray(found.y[:, -1]), found.status == 1
