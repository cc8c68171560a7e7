"""Floquet multipliers of periodic motions with impacts of one mode."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.systems.impact.orbits.itineraries.motion import LATE, ROUNDING
from dynkit.systems.impact.variational.saltation import saltation

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.mode import Transitions
    from dynkit.systems.impact.orbits.itineraries.one_mode.responses import (
        ResponseSolution,
        Windows,
    )

LARGE = 50
"""Least number of coordinates for multipliers from a secular equation, without a full matrix."""

FEW = 4
"""Largest number of impacts for this: the rank of all saltations together must be small."""

_STEPS, _TOLERANCE, _AGREEMENT = 100, 1e-14, 1e-9
"""Of the iteration: largest number of steps, relative last step, relative error of the trace."""


def multipliers(solution: ResponseSolution) -> Any:
    """Floquet multipliers (2N,), complex, the largest modulus first."""
    slots = solution.mode.layout.modes
    if not solution.impulses.all():
        # The derivative of a grazing impact is infinite.
        found = np.zeros(2 * len(slots), dtype=complex)
        found[0] = np.inf
        return found
    flights, sides, numbers = _passages(solution)
    if len(sides) <= FEW and len(flights.alone) >= LARGE and not len(flights.linked):
        roots = _secular(flights, _jumps(solution.windows, sides, numbers))
        if roots is not None:
            return roots[np.lexsort((-roots.imag, -abs(roots)))]
    return product_eigenvalues(_struck(solution, flights.matrices(slots), sides, numbers))


def factors(solution: ResponseSolution) -> tuple[Array, Array] | None:
    """Matrices (n, 2N, 2N) from each impact to the next, and their rounding errors.

    None where an impact only grazes. The errors are those of the entries, and those due to the
    rounded period. See `Problem.factors`.
    """
    if not solution.impulses.all():
        return None
    flights, *jumps = _passages(solution)
    slots = solution.mode.layout.modes
    matrices = flights.matrices(slots)
    states = np.zeros((*matrices.shape[:2], 2, solution.mode.layout.slots))
    states[..., slots] = matrices.transpose(0, 2, 1).reshape(*states.shape[:2], 2, -1)
    rates = solution.mode.rate(states)[..., slots].reshape(matrices.shape).transpose(0, 2, 1)
    found, changed = (_struck(solution, part, *jumps) for part in (matrices, rates))
    late = LATE * solution.period * (_norms(changed) / _norms(found)).max()
    return found, (ROUNDING + float(late)) * _norms(found)


def monodromy_from(solution: ResponseSolution, i: int) -> Array:
    """Monodromy matrix (2N, 2N) of one period, from just before impact `i` in the order of time."""
    slots = solution.mode.layout.modes
    flights, *jumps = _passages(solution)
    found = np.eye(2 * len(slots))
    for matrix in np.roll(_struck(solution, flights.matrices(slots), *jumps), 1 - i, axis=0):
        found = matrix @ found
    return found


def _norms(matrices: Array) -> Array:
    return np.asarray(np.linalg.norm(matrices, axis=(1, 2)))


def _struck(solution: ResponseSolution, matrices: Array, sides: Any, numbers: Array) -> Array:
    """Matrices (n, 2N, 2N) of flights, each with the impact that ends it."""
    from dynkit.systems.impact.variational.tangent_kernels import strike

    frames = np.ascontiguousarray(matrices.transpose(0, 2, 1))
    strike(solution.windows.vectors, sides, numbers, frames)
    return frames.transpose(0, 2, 1)


def _passages(solution: ResponseSolution) -> tuple[Transitions, Any, Array]:
    """Flights after each impact in order, stops (n,) of the impacts that end them, saltations.

    The numbers of the saltations are (n, 2): see `saltation`.
    """
    windows, order = solution.windows, np.argsort(solution.event_phases, kind="stable")
    one = len(order) == 1
    flights = solution.transition if one else solution.mode.transitions(solution.lasts[order])
    r, sides = solution.restitutions, solution.sides
    rates = -solution.impulses / (1.0 + r)
    bends = solution.gaps[2] - solution.impulses * windows.turns[sides]
    ends = np.append(order[1:], order[:1])
    return flights, sides[ends], saltation(r, rates, bends)[ends]


def _jumps(windows: Windows, sides: Any, numbers: Array) -> list[tuple[Array, Array]]:
    """U and V, both (2, slots, 2); 1 + U V' is the saltation matrix of each impact."""
    jumps = []
    for side, (p, q) in zip(sides.tolist(), numbers.tolist(), strict=True):
        place, speed = windows.rows[side, :2].reshape(2, 2, -1)
        right = np.array([p * place + q * speed, q * place]).transpose(1, 2, 0)
        jumps.append((windows.pushes[side], right))
    return jumps


def _secular(flights: Transitions, jumps: list[tuple[Array, Array]]) -> Any | None:
    """Eigenvalues of the monodromy matrix as roots of its secular equation; None if this fails.

    The matrix is D + U V' with D of 2 by 2 blocks and U, V of rank 2n. The sum of the roots must
    agree with the trace.
    """
    from dynkit.systems.impact.orbits.itineraries.one_mode.secular_kernels import simultaneous_roots

    count = len(flights.alone)
    blocks = np.broadcast_to(np.eye(2)[..., None], (2, 2, count))
    left, right = np.empty((2, count, 0)), np.empty((2, count, 0))
    for flight, (u, v) in zip(flights.own[..., flights.alone], jumps, strict=True):
        u, v = u[:, flights.alone], v[:, flights.alone]
        # (1 + u v') F (D + U V')
        blocks = np.einsum("ijs,jks->iks", flight, blocks)
        left = np.einsum("ijs,jsr->isr", flight, left)
        crossed = np.einsum("isq,isr->qr", left, v)
        added = np.einsum("ijs,isr->jsr", blocks, v) + np.einsum("isq,qr->isr", right, crossed)
        left = np.concatenate([left, u], axis=2)
        right = np.concatenate([right, added], axis=2)
    (a, b), (c, d) = blocks
    halves = 0.5 * (a + d)
    spreads = halves * halves - (a * d - b * c)
    adjugates = np.array([[d, -b], [-c, a]])
    rank, roots = left.shape[2], _guesses(halves, spreads)
    x, y = roots.real.copy(), roots.imag.copy()
    missing = simultaneous_roots(
        halves,
        spreads,
        np.einsum("pir,pqi,qis->rsi", right, adjugates, left, order="C"),
        np.einsum("pir,pis->rsi", right, left, order="C"),
        x,
        y,
        np.ones(2 * count, dtype=np.bool_),
        _STEPS,
        _TOLERANCE,
        1e-3 * _TOLERANCE * float(abs(roots).max()),
        np.empty((4, count)),
        np.empty((2, rank, rank), dtype=complex),
    )
    roots = x + 1j * y
    if missing or not np.isfinite(roots).all():
        return None
    trace = float(2.0 * halves.sum() + (left * right).sum())
    sizes = abs(roots).sum()
    if abs(roots.sum() - trace) > _AGREEMENT * sizes:
        return None
    roots.imag[abs(roots.imag) <= 1e-10 * abs(roots)] = 0.0
    return roots


def _guesses(halves: Array, spreads: Array) -> Any:
    """Eigenvalues half +- sqrt(spread) of the blocks, slightly shifted so that all are distinct."""
    root = np.sqrt(spreads + 0j)
    guesses = np.concatenate([halves + root, halves - root])
    random = np.random.default_rng(0)
    shift = random.normal(size=guesses.size) + 1j * random.normal(size=guesses.size)
    return guesses + 1e-3 * shift * (abs(guesses) + 1e-9 * abs(guesses).max())
