"""heyoka: Taylor's method compiled for the system, with terminal events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, final

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
    Unsuited,
)
from dynkit.analysis.work_precision.models import ImpactModel
from dynkit.core.validation import Array

LARGE = 20
"""From so many coordinates on, heyoka's code is made compact, which compiles much faster."""

COOLDOWN = 0.01
"""Part of the shortest bounce after an event in which it is not found again."""


@final
class Heyoka(ImpactMethod):
    """``taylor_adaptive`` with a terminal event; its tolerance is heyoka's ``tol``.

    Two integrators, of flight and of contact, are compiled before the time is taken.

    Parameters
    ----------
    tolerances : sequence of float
    budget : int
        Steps.

    References
    ----------
    F. Biscani, D. Izzo, Revisiting high-order Taylor methods for astrodynamics and celestial
    mechanics, Monthly Notices of the Royal Astronomical Society 504 (2021) 2614-2628; of events:
    Reliable event detection for Taylor methods in astrodynamics, arXiv:2204.09948 (2022).
    """

    name = "heyoka"

    def __init__(
        self,
        tolerances: Sequence[float] = (1e-3, 1e-6, 1e-9, 1e-12, 2.0**-52),
        budget: int = 300_000,
    ) -> None:
        self.tolerances = tuple(tolerances)
        self.budget = budget
        self._compiled: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        try:
            import heyoka
        except ImportError:
            raise Unsuited("heyoka is not installed: it comes with the extra dev") from None
        heyoka.set_logger_level_error()  # it warns on stdout of polynomials in short bounces
        model = ImpactModel.of(exact)
        parts = (model.mass, model.damping, model.stiffness, model.harmonic, model.constant)
        key = (*(part.tobytes() for part in parts), model.contact, tolerance)
        key = (*key, model.amplitude, model.frequency)
        if key not in self._compiled:
            self._compiled[key] = _compiled(heyoka, model, tolerance)
        pair, cut = self._compiled[key], smallest_bounce(model, tolerance)
        contact = ContactMatrices(model)
        return lambda budget: simulate(_Taylor(heyoka, contact, pair, budget), cut)


@final
class _Taylor(Integrator):
    def __init__(
        self, heyoka: Any, contact: ContactMatrices, pair: tuple[Any, Any], budget: int
    ) -> None:
        super().__init__(contact)
        model = contact.model
        self._limit = heyoka.taylor_outcome.time_limit
        self._exhausted = heyoka.taylor_outcome.step_limit
        self._flight, self._held = pair
        self._left = self._budget = budget
        own = [model.amplitude, model.frequency, model.offset, model.phase, float(model.sign)]
        for integrator in pair:
            if integrator is not None:
                integrator.pars[:] = own

    def fly(
        self, time: float, state: Array, end: float, flight: float
    ) -> tuple[float, Array, bool]:
        # after an impact of its own it knows that the event is not to be found again
        return self._run(self._flight, time, state, end, keep=flight < math.inf or time > 0.0)

    def pass_freely(self, time: float, state: Array, end: float) -> Array:
        keep = False
        while time < end:
            time, state, keep = self._run(self._flight, time, state, end, keep=keep)
        return state

    def hold(self, time: float, state: Array, end: float) -> tuple[float, Array, bool]:
        if self._held is None:
            raise GaveUp("gave up: nothing is left to integrate in contact")
        return self._run(self._held, time, state, end, keep=False)

    def work(self) -> dict[str, int]:
        return {"steps": self._budget - self._left}

    def _run(
        self, integrator: Any, time: float, state: Array, end: float, *, keep: bool
    ) -> tuple[float, Array, bool]:
        if not keep:
            integrator.reset_cooldowns()
        integrator.time = time
        integrator.state[:] = state
        outcome, _, _, steps, *_ = integrator.propagate_until(end, max_steps=max(self._left, 1))
        self._left -= steps
        if outcome == self._exhausted or self._left <= 0:
            raise OverBudget("steps")
        hit = int(outcome) == -1  # the first terminal event
        if not hit and outcome != self._limit:
            raise GaveUp(f"gave up: {outcome}")
        return float(integrator.time), integrator.state.copy(), hit


def _compiled(heyoka: Any, model: ImpactModel, tolerance: float) -> tuple[Any, Any]:
    """Integrators of flight and of contact; the table is in their parameters."""
    n, c = model.size, model.contact
    amplitude, frequency, offset, phase, sign = (heyoka.par[i] for i in range(5))
    angle = frequency * heyoka.time + phase
    sine, cosine = heyoka.sin(angle), heyoka.cos(angle)
    table = (
        amplitude * sine + offset,
        amplitude * frequency * cosine,
        -frequency * frequency * amplitude * sine,
    )
    names = [f"{letter}{i}" for letter in "xv" for i in range(n)]
    z = heyoka.make_vars(*names) if n else []

    def combined(row: Array, terms: Sequence[Any]) -> list[Any]:
        return [float(a) * term for a, term in zip(row, terms, strict=True) if a != 0.0]

    inverse = np.linalg.inv(model.mass)
    # heyoka's own cooldown is longer than the last bounces of a chatter
    pulls = [float((inverse @ part)[c, c]) for part in (model.stiffness, model.damping)]
    acceleration = model.amplitude * (model.frequency**2 + model.frequency * pulls[1] + pulls[0])
    rest = COOLDOWN * smallest_bounce(model, tolerance) / acceleration if acceleration else -1.0

    def made(equations: list[Any], event: Any) -> Any:
        falls = heyoka.t_event(event, direction=heyoka.event_direction.negative, cooldown=rest)
        return heyoka.taylor_adaptive(
            equations,
            [0.0] * len(equations),
            t_events=[falls],
            tol=tolerance,
            compact_mode=n > LARGE,
            pars=[0.0] * 5,
        )

    rows = np.concatenate([-inverse @ model.stiffness, -inverse @ model.damping], axis=1)
    turn = [sine, cosine, heyoka.expression(1.0)]
    acting = np.stack([model.harmonic.real, model.harmonic.imag, model.constant], axis=1)
    equations = [(z[i], z[n + i]) for i in range(n)]
    for i, row in enumerate(rows):
        terms = combined(row, z) + combined((inverse @ acting)[i], turn)
        equations.append((z[n + i], heyoka.sum(terms)))
    flight = made(equations, sign * (z[c] - table[0]))
    if n == 1:
        return flight, None
    contact, inner = ContactMatrices(model), [int(i) for i in model.others]
    y = [z[i] for i in inner] + [z[n + i] for i in inner]
    pushed = contact.inverse @ acting[inner]
    equations = [(z[i], z[n + i]) for i in inner]
    for k, i in enumerate(inner):
        terms = combined(contact.matrix[n - 1 + k], y) + combined(contact.drive[k], table)
        equations.append((z[n + i], heyoka.sum(terms + combined(pushed[k], turn))))
    own = model.mass[c, inner] @ pushed - acting[c]
    force = combined(contact.row, y) + combined(contact.own, table) + combined(own, turn)
    return flight, made(equations, sign * heyoka.sum(force))
