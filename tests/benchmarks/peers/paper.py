"""The algorithm of Cusumano & Bai (1993) as a peer: Newton's method from a sampled bracket."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import (
    FoundImpacts,
    GaveUp,
    ImpactMethod,
    OverBudget,
    Simulation,
    Unsuited,
)
from dynkit.analysis.work_precision.models import ImpactModel
from dynkit.core.validation import Array

SAMPLES = 20
"""Samples in the shortest period, of the table or of a mode that oscillates."""

SHORTEST = 1e-6
"""A shorter flight is contact, as in the paper."""

MOST = 20_000
"""Impacts that are kept."""


@final
class PaperAlgorithm(ImpactMethod):
    """Closed-form modal motion, a sampled bracket, Newton's method; sticking below 1e-6.

    Compiled, as the original was. Its tolerance is that of the times: Newton's method ends with a
    correction below it. Samples are taken 20 times in the shortest period of a mode that
    oscillates. Only for damping that does not couple the modes, and for a table without forces.

    Parameters
    ----------
    tolerances : sequence of float
    budget : int
        Samples.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, equations 9 to 15.
    """

    name = "paper"

    def __init__(
        self,
        tolerances: Sequence[float] = (1e-1, 1e-2, 1e-4, 1e-6, 1e-12),
        budget: int = 20_000_000,
    ) -> None:
        self.tolerances = tuple(tolerances)
        self.budget = budget

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        model = ImpactModel.of(exact)
        if model.forced:
            raise Unsuited("not made for it: forces")
        parts = _parts(model)
        _simulate(replace(model, until=parts.step), parts, tolerance, self.budget)  # compiles
        return lambda budget: _simulate(model, parts, tolerance, budget)


@final
@dataclass(frozen=True, eq=False)
class _Parts:
    """Modes of flight and of contact, and the changes between them, as the kernel takes them."""

    shape: Array
    start: Array
    modes: Array
    rows: Array
    harmonic: Array
    kick: Array
    held_modes: Array
    held_rows: Array
    held_harmonic: Array
    to_held: Array
    to_held_shift: Array
    to_free: Array
    to_free_shift: Array
    step: float


def _parts(model: ImpactModel) -> _Parts:
    c, others, sign = model.contact, model.others, model.sign
    n, w = model.size, model.frequency
    if model.mass[c, others].any():
        raise Unsuited("not made for it: the mass matrix couples the contact coordinate")
    modes, shape = _modes(model.mass, model.damping, model.stiffness)
    inner = np.ix_(others, others)
    held_modes, held_shape = _modes(model.mass[inner], model.damping[inner], model.stiffness[inner])
    # what the table makes of the held modes: the forced motion, and where they rest
    driven = -held_shape.T @ np.stack(
        [model.stiffness[others, c], model.damping[others, c]], axis=1
    )
    moving = model.amplitude * (driven[:, 0] + 1j * w * driven[:, 1])
    with np.errstate(all="ignore"):
        forced = moving / (held_modes[0] - w * w + 2j * w * held_modes[1])
        rest = driven[:, 0] * model.offset / held_modes[0] if n > 1 else np.zeros(0)
    pull = np.stack([model.stiffness[c, others], model.damping[c, others]])
    own = model.stiffness[c, c] + 1j * w * model.damping[c, c] - w * w * model.mass[c, c]
    turning = model.amplitude * own + (pull[0] + 1j * w * pull[1]) @ (held_shape @ forced)
    resting = model.stiffness[c, c] * model.offset + pull[0] @ (held_shape @ rest)
    table = np.array([model.amplitude, 0.0, model.offset])
    particular = np.stack([forced.real, forced.imag, rest], axis=1)
    whole = shape.T @ model.mass
    q = np.stack([whole @ model.position, whole @ model.velocity])
    periods = [2.0 * math.pi / w]
    for square, sigma in (*modes.T, *held_modes.T):
        if square > sigma * sigma:
            periods.append(2.0 * math.pi / math.sqrt(square - sigma * sigma))
    return _Parts(
        shape,
        q,
        modes,
        np.stack([sign * shape[c], np.zeros(n)]),
        -sign * table,
        sign * whole @ model.kick,
        held_modes,
        sign * pull @ held_shape,
        sign * np.array([turning.real, turning.imag, resting]),
        held_shape.T @ model.mass[inner] @ shape[others],
        -particular,
        whole[:, others] @ held_shape,
        whole[:, others] @ held_shape @ particular + np.outer(whole[:, c], table),
        min(periods) / SAMPLES,
    )


def _modes(mass: Array, damping: Array, stiffness: Array) -> tuple[Array, Array]:
    """Squares of the frequencies and decay rates (2, n), and shapes (n, n), of unit modal mass."""
    from scipy.linalg import eigh

    if not len(mass):
        return np.zeros((2, 0)), np.zeros((0, 0))
    squares, shape = eigh(stiffness, mass)
    rates = shape.T @ damping @ shape
    decay = 0.5 * np.diagonal(rates)
    coupling = abs(rates - np.diag(2.0 * decay)).max()
    if coupling > 1e-9 * abs(rates).max(initial=1e-300):
        raise Unsuited("not made for it: dashpots that couple the modes")
    return np.stack([squares, decay]), shape


def _steps(modes: Array, h: float) -> Array:
    """Motions (n, 4) of the modes over a step."""
    from tests.benchmarks.peers.paper_kernels import motion

    return np.array([motion(square, sigma, h) for square, sigma in modes.T]).reshape(-1, 4)


def _simulate(model: ImpactModel, parts: _Parts, tolerance: float, budget: int) -> FoundImpacts:
    from tests.benchmarks.peers.paper_kernels import BUDGET, DONE, FULL, simulate_modes

    n = model.size
    times, states, releases = np.empty(MOST), np.empty((MOST, 2, n)), np.empty(MOST)
    status, impacts, released, samples = simulate_modes(
        parts.modes, parts.rows, parts.harmonic, parts.kick, _steps(parts.modes, parts.step),
        parts.held_modes, parts.held_rows, parts.held_harmonic,
        _steps(parts.held_modes, parts.step),
        parts.to_held, parts.to_held_shift, parts.to_free, parts.to_free_shift,
        np.array([model.frequency, model.phase]), parts.start.copy(), np.empty((2, n - 1)),
        np.empty((2, n)), model.restitution, parts.step, tolerance, SHORTEST, model.until, budget,
        times, states, releases,
    )  # fmt: skip
    if status != DONE:
        if status == BUDGET:
            raise OverBudget("samples")
        reason = f"more than {MOST} impacts" if status == FULL else "Newton's method fails"
        raise GaveUp(f"gave up: {reason}")
    kept = states[:impacts]
    x, v = kept[:, 0] @ parts.shape.T, kept[:, 1] @ parts.shape.T
    return FoundImpacts(times[:impacts], x, v, releases[:released], {"samples": samples})
