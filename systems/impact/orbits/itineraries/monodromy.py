"""Floquet multipliers of periodic impact motions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues
from dynkit.systems.impact.orbits.itineraries.motion import LATE, ROUNDING
from dynkit.systems.impact.variational.saltation import saltation

if TYPE_CHECKING:
    from dynkit.systems.impact.modes.mode import Transitions
    from dynkit.systems.impact.orbits.itineraries.responses import ResponseSolution

LARGE = 50
"""From so many coordinates on, the multipliers are found without a matrix of all of them."""

FEW = 4
"""Only for orbits of at most so many impacts, whose jumps are of low rank together."""

_STEPS, _TOLERANCE, _AGREEMENT = 100, 1e-14, 1e-9


def multipliers(solution: ResponseSolution) -> Any:
    """Floquet multipliers (2N,), complex, the largest modulus first."""
    slots = solution.mode.layout.modes
    if not solution.impulses.all():
        # An impact that only grazes stretches without bound.
        found = np.zeros(2 * len(slots), dtype=complex)
        found[0] = np.inf
        return found
    flights, jumps = _passages(solution)
    if len(jumps) <= FEW and len(flights.alone) >= LARGE and not len(flights.linked):
        roots = _secular(flights, jumps)
        if roots is not None:
            return roots[np.lexsort((-roots.imag, -abs(roots)))]
    return product_eigenvalues(_jumped(flights.matrices(slots), slots, jumps))


def factors(solution: ResponseSolution) -> tuple[Array, Array] | None:
    """Matrices (n, 2N, 2N) from each impact to the next, and their rounding; see `Problem.factors`.

    None where an impact only grazes. Entries are rounded, and flights, of which they are functions,
    last as long as a period that is rounded.
    """
    if not solution.impulses.all():
        return None
    flights, jumps = _passages(solution)
    slots = solution.mode.layout.modes
    matrices = flights.matrices(slots)
    states = np.zeros((*matrices.shape[:2], 2, solution.mode.layout.slots))
    states[..., slots] = matrices.transpose(0, 2, 1).reshape(*states.shape[:2], 2, -1)
    rates = solution.mode.rate(states)[..., slots].reshape(matrices.shape).transpose(0, 2, 1)
    found, changed = (_jumped(part, slots, jumps) for part in (matrices, rates))
    late = LATE * solution.period * (_norms(changed) / _norms(found)).max()
    return found, (ROUNDING + float(late)) * _norms(found)


def _norms(matrices: Array) -> Array:
    return np.asarray(np.linalg.norm(matrices, axis=(1, 2)))


def _jumped(matrices: Array, slots: Any, jumps: list[tuple[Array, Array]]) -> Array:
    """Matrices (n, 2N, 2N) of flights, and of the impact after each; modified in place."""
    for matrix, (left, right) in zip(matrices, jumps, strict=True):
        flat = left[:, slots].reshape(-1, 2), right[:, slots].reshape(-1, 2)
        matrix += flat[0] @ (flat[1].T @ matrix)
    return matrices


def _passages(solution: ResponseSolution) -> tuple[Transitions, list[tuple[Array, Array]]]:
    """Flights after each impact in turn, and what the next impact makes of their ends.

    An impact takes a disturbance of the free state times 1 + U V', both (2, slots, 2): see
    `saltation`.
    """
    windows, order = solution.windows, np.argsort(solution.event_phases)
    one = len(order) == 1
    flights = solution.transition if one else solution.mode.transitions(solution.lasts[order])
    r, sides = solution.restitutions, solution.sides
    rates = -solution.impulses / (1.0 + r)
    turns = (windows.rows[:, 2] * windows.kicks.reshape(len(windows.kicks), -1)).sum(axis=1)
    bends = solution.gaps[2] - solution.impulses * turns[sides]
    numbers = saltation(r, rates, bends)
    jumps = []
    for i in np.roll(order, -1).tolist():
        (p, q), side = numbers[i].tolist(), sides[i]
        place, speed = windows.rows[side, :2].reshape(2, 2, -1)
        right = np.array([p * place + q * speed, q * place]).transpose(1, 2, 0)
        jumps.append((windows.pushes[side], right))
    return flights, jumps


def _secular(flights: Transitions, jumps: list[tuple[Array, Array]]) -> Any | None:
    """Eigenvalues of the product as roots of its secular equation; None where that fails.

    The product is D + U V' with D of 2 by 2 blocks and U, V of rank 2n. The sum of the roots is
    compared with the trace.
    """
    from dynkit.systems.impact.orbits.itineraries.secular_kernels import simultaneous_roots

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
    """Eigenvalues half +- sqrt(spread) of blocks, moved a little apart."""
    root = np.sqrt(spreads + 0j)
    guesses = np.concatenate([halves + root, halves - root])
    random = np.random.default_rng(0)
    shift = random.normal(size=guesses.size) + 1j * random.normal(size=guesses.size)
    return guesses + 1e-3 * shift * (abs(guesses) + 1e-9 * abs(guesses).max())
