"""Exponentials of the flows of linear modes, real or with imaginary changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution

_TERMS, _LONGEST = 18, 2.0**50
"""Of a series of exp(A) where A is of norm one: the next one is below 1e-17; largest norms."""
_POWERS = np.arange(1, _TERMS + 1)
_FACTORIALS = np.array([math.factorial(k) for k in _POWERS.tolist()], dtype=float)

_BRIEF = 4.0
"""Norm of A t up to which a series loses few digits."""

_BLOCK = 5
_WEIGHTS = np.array([1.0 / math.factorial(k) for k in range(4 * _BLOCK)]).reshape(4, _BLOCK)


def lifted(flow: Any, times: Array) -> Any:
    """exp(A t) - 1, (k, d, d), of one matrix at short times (k,), whose powers are shared."""
    halvings = _halvings(_norm(flow) * times)
    powers = np.empty((_TERMS, *flow.shape), dtype=flow.dtype)
    powers[0] = flow
    for k in range(1, _TERMS):
        np.matmul(flow, powers[k - 1], out=powers[k])
    weights = (times * 0.5**halvings)[:, None] ** _POWERS / _FACTORIALS
    both = powers.reshape(_TERMS, -1).view(float)
    out: Any = (weights @ both).view(flow.dtype).reshape(len(times), *flow.shape)
    return _doubled(out, halvings, lambda part: 2.0 * part + part @ part)


def carried(flow: Any, states: Array, times: Array) -> Array:
    """Changes (k, D) of states after times (k,) by the imaginary changes of a flow.

    Series of the states (k, D) at the begin, and of their changes, for times that are not long.
    """
    size, out = _norm(flow) * times, np.zeros(states.shape)
    long, brief = np.flatnonzero(size > _BRIEF), np.flatnonzero(size <= _BRIEF)
    if len(long):
        flown = exponentials(flow * times[long, None, None])
        out[long] = (flown.imag / STEP @ states[long, :, None])[..., 0]
    if len(brief):
        d, change = len(flow), flow.imag / STEP
        both, terms, lasts = np.vstack([flow.real, change]), states[brief].T, times[brief]
        later = total = change @ terms * lasts
        for k in range(2, 18 + math.ceil(4.0 * float(size[brief].max()))):
            moved = both @ terms
            terms = moved[:d] * (lasts / (k - 1))
            later = (flow.real @ later + both[d:] @ terms) * (lasts / k)
            total = total + later
        out[brief] = total.T
    return out


def exponentials(matrices: Any) -> Any:
    """exp(A), (k, d, d), of small matrices, real or with imaginary changes, by scaled series.

    A library's function takes ten times as long for those of a few rows. Infinite where they
    overflow. The polynomial is summed in four blocks of five powers.

    References
    ----------
    M. S. Paterson, L. J. Stockmeyer, On the number of nonscalar multiplications necessary to
    evaluate polynomials, SIAM Journal on Computing 2 (1973) 60-66.
    """
    norms = abs(matrices).sum(axis=1).max(axis=1)
    if not (norms < _LONGEST).all():
        raise NoSolution("the time between two events is too long for the fastest mode")
    halvings = _halvings(norms)
    powers = np.empty((_BLOCK + 1, *matrices.shape), dtype=matrices.dtype)
    powers[0] = np.eye(matrices.shape[1])
    np.multiply(matrices, (0.5**halvings)[:, None, None], out=powers[1])
    for k in range(1, _BLOCK):
        np.matmul(powers[k], powers[1], out=powers[k + 1])
    both = powers[:_BLOCK].reshape(_BLOCK, -1).view(float)
    *sums, out = (_WEIGHTS @ both).view(matrices.dtype).reshape(len(_WEIGHTS), *matrices.shape)
    out += powers[_BLOCK] / math.factorial(_WEIGHTS.size)
    for part in reversed(sums):
        out = out @ powers[_BLOCK] + part
    with np.errstate(over="ignore", invalid="ignore"):
        return _doubled(out, halvings, lambda part: part @ part)


def _halvings(sizes: Array) -> Any:
    """How often each of some sizes, (k,), is halved until it is one at most."""
    return np.ceil(np.log2(np.maximum(sizes, 1.0))).astype(int)


def _doubled(out: Any, halvings: Any, double: Callable[[Any], Any]) -> Any:
    """Functions (k, d, d) of halved arguments, doubled as often as each was halved."""
    for k in range(int(halvings.max(initial=0))):
        some = np.flatnonzero(halvings > k)
        if len(some) == len(out):
            out = double(out)
        else:
            out[some] = double(out[some])
    return out


def _norm(flow: Any) -> float:
    return float(abs(flow).sum(axis=0).max())


def run_through(flow: Array, start: Array, times: Array, measures: Array) -> Array:
    """States (k, D) at times (k,) from a start; of equal steps from zero on by doubling."""
    count, step = len(times), float(times[-1]) / max(len(times) - 1, 1)
    if count < 4 or times[0] != 0.0 or (abs(np.diff(times) - step) > 1e-12 * times[-1]).any():
        each = np.broadcast_to(flow, (count, *flow.shape))
        return np.asarray(moved(each, times, measures) @ start)
    matrix, out = moved(flow[None], np.array([step]), measures)[0], start[None]
    while len(out) < count:
        out = np.concatenate([out, out @ matrix.T])
        matrix = matrix @ matrix
    return out[:count]


def moved(flows: Any, lasts: Any, measures: Array) -> Any:
    """exp(A t), (n, D, D), in units in which states are of order one."""
    scaled = flows * measures / measures[:, None] * np.asarray(lasts)[:, None, None]
    return np.asarray(exponentials(scaled)) * measures[:, None] / measures
