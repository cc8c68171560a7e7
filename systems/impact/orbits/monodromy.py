"""Floquet multipliers of periodic impact motions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.solution import Solution


def passages(solution: Solution) -> list[Array]:
    """Derivatives (2N, 2N) of the free state just after each impact by that after the one before.

    The first is from impact 0 to impact 1. An impact with normal b, rows c and c' of place and
    velocity of the contact coordinate, impulse J, rate g' and acceleration g'' of the gap before
    it takes a disturbance times I - (1 + r) b c' + ((1 + r) g'' b + J A b) c / g'.

    References
    ----------
    P. C. Mueller, Calculation of Lyapunov exponents for dynamic systems with discontinuities,
    Chaos, Solitons & Fractals 5 (1995) 1671-1681 (saltation matrices).
    """
    motion, t = solution.motion, solution.terms
    n, slots = len(solution.sides), motion.regime.layout.modes
    r = t.restitution
    place, speed, bend = motion.rows[:3].reshape(3, 2, -1)[:, :, slots].reshape(3, -1)
    kick = motion.kick[:, slots].ravel()
    pushed = motion.rate(motion.kick)[:, slots].ravel()
    order = np.argsort(solution.phases)
    times = np.diff(solution.phases[order], append=solution.phases[order[0]] + solution.turn)
    flights = motion.transitions(times / t.frequency)
    matrices = flights.matrices(slots)
    before = solution.gaps(2) - solution.impulses * (bend @ kick)
    out = []
    for k in range(n):
        i = order[(k + 1) % n]
        impulse = solution.impulses[i]
        rate = -impulse / (1.0 + r)
        jump = np.outer((1.0 + r) * before[i] * kick + impulse * pushed, place) / rate
        jump -= (1.0 + r) * np.outer(kick, speed)
        out.append(matrices[k] + jump @ matrices[k])
    return out


def multipliers(solution: Solution) -> Any:
    """Floquet multipliers (2N,), complex, the largest modulus first."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        matrices = passages(solution)
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        # An impact that only grazes stretches without bound.
        found = np.full(len(matrices[0]), 0.0, dtype=complex)
        found[0] = np.inf
        return found
    product = matrices[0]
    for matrix in matrices[1:]:
        product = matrix @ product
    found = np.linalg.eigvals(product).astype(complex)
    return found[np.lexsort((-found.imag, -abs(found)))]
