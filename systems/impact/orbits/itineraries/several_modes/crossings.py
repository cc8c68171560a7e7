"""Floquet multipliers of motions of several modes, those of a `ShootingSolution`."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import null_space

from dynkit.core.validation import Array
from dynkit.orbits.multipliers import product_eigenvalues

_ROUNDING = 2.0**-52
_GRAZES = 256.0 * _ROUNDING
"""Relative rate of a guard, |rate| / (frequency * size), below which it is only grazed."""
_PARTING = 1e-5
"""Step of central differences, in radians of the phase: it balances rounding and curvature."""


def multipliers(s: Any) -> Any:
    """Floquet multipliers (2N + J,), the largest first; some of P(inf,m) are zero."""
    factors, _ = s.factors
    kept = s.dimension - s.progression.shift.shape[1] - (not s.driven)
    found = np.zeros(kept, dtype=complex)
    if s.course.sticks and not s.impulses.all():
        # the derivative of a grazing impact is infinite
        found[0] = np.inf
        return found
    own = product_eigenvalues(factors)[: len(found)] if factors.size else found[:0]
    found[: len(own)] = own
    return found


def factors_of(s: Any) -> tuple[Array, Array]:
    """Tangent maps from just before each event to just before the next, and rounding errors.

    For an undriven machine their product maps the surface where the first guard is zero to itself.
    For P(inf,m) there is one matrix from each node to the next, for changes that keep contact.
    """
    d, m = s.dimension, s.measures[: s.dimension]
    rows = s.guards.copy()
    rows[0] *= s.driven
    found = [_passed(s, i, row)[:d, :d] for i, row in enumerate(rows)]
    if not s.driven:
        moving = s.moving[-1, :d]
        row = s.guards[0][:d]
        found[-1] -= np.outer(moving / (row @ moving), row @ found[-1])
    factors = np.array(found) * m / m[:, None]
    if s.course.sticks:
        factors = _in_contact(s, factors)
    elif s.progression.shift.size:
        across = null_space((s.progression.shift / m[:, None]).T)
        factors = across.T @ factors @ across
    grown = 16.0 + s.norms
    if s.course.sticks:
        grown = grown.sum() + np.zeros(len(factors))
    return factors, _ROUNDING * grown * abs(factors).max(axis=(1, 2), initial=0.0)


def monodromy_from(s: Any, i: int) -> Array:
    """Monodromy matrix (2N + J, 2N + J) from just before event `i` to a period later."""
    d, m = s.dimension, s.measures[: s.dimension]
    found = np.eye(s.dimension)
    for k in np.roll(np.arange(s.events), -i).tolist():
        found = _passed(s, k, s.guards[k])[:d, :d] @ found
    return np.asarray(found * m / m[:, None])


def _passed(s: Any, i: int, row: Array) -> Array:
    """Tangent map (D, D) from just before event `i`, with guard `row`, to just before the next."""
    moving, passed = s.moving[i - 1], s.resets[i].copy()
    if i in s.impulse_of:
        j = s.impulse_of[i]
        own = np.outer(s.kicks[i], s.rates[j]) * (1.0 + s.rebounds[1, j])
        passed = s.resets[i] @ (np.eye(len(own)) - own)
    rate, least = float(row @ moving), _GRAZES * float(s.frequency)
    if i in s.impulse_of or abs(rate) > least * float(abs(row) @ s.measures):
        later = row / rate if rate else row
        passed = s.transitions[i] @ (passed - np.outer(passed @ moving, later))
        return np.asarray(passed + np.outer(s.moving[i], later))
    return np.asarray(s.transitions[i] @ (passed + np.outer(_parting(s, i), row)))


def _parting(s: Any, i: int) -> Array:
    """Limit (D,) of the jump of the state's rate at event `i`, divided by the guard's rate.

    Where a guard is only grazed, both are zero; the limit is the ratio of their time derivatives.
    """
    moving, step = s.moving[i - 1], _PARTING / s.clock
    ends = s.reached[i - 1] + step * moving, s.reached[i - 1] - step * moving
    ahead, behind = (
        (s.flights(s.following[i - 1].mode).rates(z[None])[0], s.resets[i] @ z) for z in ends
    )
    slope = ahead[0] - behind[0]
    there = s.flights(s.following[i].mode)
    changed = there.rates(ahead[1][None])[0] - there.rates(behind[1][None])[0]
    bend = float(s.guards[i] @ slope)
    return np.asarray((changed - s.resets[i] @ slope) / bend if bend else 0.0 * slope)


def held_directions(s: Any, node: int) -> Array:
    """Orthonormal scaled changes (2N + J, d) that keep the contacts closed just before a node."""
    i, m = s.course.nodes[node], s.measures[: s.dimension]
    mode, z = s.itinerary[i].mode, s.before[i]
    stops, own = [k for k in mode.held if k < len(s.oscillator._stops)], s.flights(mode)
    rows = [of(k, z)[1][: s.dimension] * m for k in stops for of in (own.gap_of, own.rate_of)]
    rows += list((s.progression.shift / m[:, None]).T)
    return np.asarray(null_space(np.array(rows).reshape(len(rows), len(m))))


def _in_contact(s: Any, factors: Array) -> Array:
    """Tangent maps from each node to the next one, of changes that keep the contacts closed."""
    count, found = len(s.course.nodes), []
    bases = [held_directions(s, node) for node in range(count)]
    if len({basis.shape for basis in bases}) > 1:
        return factors
    ends = [*s.course.nodes[1:], s.events]
    for k, (begin, end) in enumerate(zip(s.course.nodes, ends, strict=True)):
        moved = bases[k]
        for factor in factors[begin:end]:
            moved = factor @ moved
        found.append(bases[(k + 1) % count].T @ moved)
    return np.array(found)
