"""How periodic orbits depend on what is in the matrices of the structure."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.impact.driven import DrivenStructure
    from dynkit.systems.impact.orbits.solution import Solution

LARGEST = 50
"""Of so many coordinates at most: the cost grows with the third power of their number."""

_AGREEMENT = 1e-12


def matrices_of(oscillator: DrivenStructure) -> Array:
    """Mass, damping and stiffness, (3, N, N)."""
    return np.stack([oscillator.mass, oscillator.damping_matrix, oscillator.stiffness])


def linear_change(matrices: Callable[[float], Array], value: float) -> Array | None:
    """Derivative (3, N, N) of matrices that are linear in a parameter; None where they are not.

    Differences are exact then, whatever the step; steps towards zero stay in the range of a
    parameter that has a bound.
    """
    step = -0.25 * np.copysign(2.0 ** np.floor(np.log2(abs(value))), value) if value else 0.25
    here, near, far = (matrices(value + k * step) for k in (0.0, 1.0, 2.0))
    first, second = (near - here) / step, (far - near) / step
    size = max(float(abs(first).max()), float(abs(here).max()) / abs(step))
    if not float(abs(first - second).max()) <= _AGREEMENT * size:
        return None
    return np.asarray((far - here) / (2.0 * step))


def residual_change(
    oscillator: DrivenStructure, solution: Solution, change: Array
) -> tuple[Array, Array]:
    """Derivatives (n,) of gaps and of their rates at the impacts, by a change of the matrices.

    The response to a unit impulse once a period is exp(A s) z, z = b + exp(A T) z, with the matrix
    A of the positions and velocities; so its change is that of exponentials, and of b where masses
    change.

    References
    ----------
    A. H. Al-Mohy, N. J. Higham, Computing the Frechet derivative of the matrix exponential, SIAM
    Journal on Matrix Analysis and Applications 30 (2009) 1639-1657.
    """
    from scipy.linalg import expm_frechet

    mass, damping, stiffness = matrices_of(oscillator)
    n = len(mass)
    c = oscillator.contact % n
    inverse = np.linalg.inv(mass)
    flow, by = np.zeros((2, 2 * n, 2 * n))
    flow[:n, n:] = np.eye(n)
    flow[n:, :n], flow[n:, n:] = -inverse @ stiffness, -inverse @ damping
    by[n:, :n] = -inverse @ (change[2] + change[0] @ flow[n:, :n])
    by[n:, n:] = -inverse @ (change[1] + change[0] @ flow[n:, n:])
    kick, kick_by = np.zeros((2, 2 * n))
    response = inverse[:, c]
    response_by = -inverse @ change[0] @ response
    kick[n:] = response / response[c]
    kick_by[n:] = (response_by - kick[n:] * response_by[c]) / response[c]

    def spread(time: float) -> tuple[Array, Array]:
        moved, moved_by = expm_frechet(flow * time, by * time)
        return np.asarray(moved), np.asarray(moved_by)

    period, period_by = spread(solution.period)
    closing = np.eye(2 * n) - period
    state = np.linalg.solve(closing, kick)
    state_by = np.linalg.solve(closing, kick_by + period_by @ state)
    count = len(solution.sides)
    responses = np.empty((2, count, count))
    for i in range(count):
        for j in range(count):
            moved_by = state_by
            if i != j:
                moved, by_time = spread(float(solution.since[i, j]))
                moved_by = by_time @ state + moved @ state_by
            responses[:, i, j] = moved_by[c], moved_by[n + c]
    free = solution.signs * (responses @ (solution.signs * solution.impulses))
    t, w = solution.terms, solution.terms.frequency
    rigidity = stiffness + 1j * w * damping - w * w * mass
    stiffer = change[2] + 1j * w * change[1] - w * w * change[0]
    shape = -np.linalg.solve(rigidity, stiffer @ t.shape)[c] if t.shape.any() else 0.0
    still = -np.linalg.solve(stiffness, change[2] @ t.still)[c] if t.still.any() else 0.0
    turned = shape * np.exp(1j * solution.phases)
    gaps = solution.signs * (turned.imag + still) + free[0]
    return gaps, solution.signs * (1j * w * turned).imag + free[1]
