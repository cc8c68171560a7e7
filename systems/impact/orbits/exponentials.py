"""Exponentials of the state matrices of linear modes, real or with imaginary changes.

A complex matrix A + i h dA has the step h = `STEP`; dA is the change of A.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.differences import STEP
from dynkit.core.validation import Array
from dynkit.orbits.newton import NoSolution

_TERMS = 18
"""Terms of the series of exp(A) for A of norm one: the first omitted one is below 1e-17."""
_POWERS = np.arange(1, _TERMS + 1)
_FACTORIALS = np.array([math.factorial(k) for k in _POWERS.tolist()], dtype=float)

_BLOCK = 5
_WEIGHTS = np.array([1.0 / math.factorial(k) for k in range(4 * _BLOCK)]).reshape(4, _BLOCK)
_WITHOUT_ONE = _WEIGHTS.copy()
_WITHOUT_ONE[0, 0] = 0.0

_BRIEF, _LONGEST = 4.0, 2.0**50
"""Norm of A t up to which a series without scaling loses few digits; largest norm allowed."""


def lifted(flow: Array, times: Array) -> Array:
    """exp(A t) - 1, (k, d, d), of one matrix at short times (k,); all share the powers of A."""
    halvings = np.ceil(np.log2(np.maximum(_norm(flow) * times, 1.0))).astype(int)
    powers = np.empty((_TERMS, *flow.shape))
    powers[0] = flow
    for k in range(1, _TERMS):
        np.matmul(flow, powers[k - 1], out=powers[k])
    weights = (times * 0.5**halvings)[:, None] ** _POWERS / _FACTORIALS
    out = (weights @ powers.reshape(_TERMS, -1)).reshape(len(times), *flow.shape)
    return np.asarray(_squared(out, halvings.tolist(), 0.0))


def carried(flow: Any, states: Array, times: Array) -> Array:
    """Changes (k, D) of states (k, D) after times (k,), due to the imaginary change of a matrix.

    For short times, states and changes are summed as one series; for long times see `gained`.
    """
    size, out, some = _norm(flow) * times, np.zeros(states.shape), _leading(flow[None])
    brief, d, count = size <= _BRIEF, len(flow), len(some)
    if not count:
        return out
    if not brief.all():
        flows = np.broadcast_to(flow, (int((~brief).sum()), *flow.shape))
        out[~brief] = gained(flows, states[~brief], times[~brief], np.ones(len(flow)))
    if brief.any():
        unit = float(times[brief].max()) or 1.0
        (both,) = _beside(unit * flow[None], some)
        orders = np.arange(1, 18 + int(4.0 * size[brief].max()))
        terms = np.zeros((len(orders) + 1, d + count, count))
        terms[0, d:] = np.eye(count)
        for k in orders.tolist():
            np.matmul(both, terms[k - 1] / k, out=terms[k])
        weights = (times[brief, None] / unit) ** orders
        moved = weights @ terms[1:, :d].reshape(len(orders), -1)
        out[brief] = (moved.reshape(-1, d, count) @ states[brief][:, some, None])[..., 0]
    return out


def gained(flows: Any, states: Array, times: Array, measures: Array) -> Array:
    """Changes (k, D) of states after times (k,) by the imaginary changes of flows (k, D, D)."""
    scaled, d = _scaled(flows, times, measures), flows.shape[1]
    some, begun = _leading(flows), states / measures
    if not len(some):
        return np.zeros(states.shape)
    if 2 * len(some) > d:
        found = (exponentials(scaled).imag / STEP @ begun[:, :, None])[..., 0]
    else:
        both = exponentials(_beside(scaled, some))
        found = (both[:, :d, d:] @ begun[:, some, None])[..., 0]
    return np.asarray(found * measures)


def _beside(flows: Any, some: NDArray[np.intp]) -> Array:
    """Real matrices that propagate changes of states together with the coordinates `some`."""
    d, size = flows.shape[1], flows.shape[1] + len(some)
    out = np.zeros((len(flows), size, size))
    out[:, :d, :d], out[:, :d, d:] = flows.real, flows.imag[:, :, some] / STEP
    out[:, d:, d:] = flows.real[:, some][:, :, some]
    return out


def _leading(flows: Any) -> NDArray[np.intp]:
    """Indices of the coordinates that the changes of matrices multiply, and of those driving them.

    These coordinates evolve by themselves. An example is the phase where the frequency changes.
    """
    links, some = flows.real.any(axis=0), flows.imag.any(axis=(0, 1))
    while (more := some | links[some].any(axis=0)).sum() > some.sum():
        some = more
    return np.flatnonzero(some)


def exponentials(matrices: Any) -> Any:
    """exp(A), (k, d, d), real or with imaginary changes, by scaled series.

    Entries that overflow are infinite. The polynomial is summed in four blocks of five powers. For
    flights of an oscillator with stiff springs, the rounding error of SciPy's expm is three to
    thirty times as large.

    References
    ----------
    M. S. Paterson, L. J. Stockmeyer, On the number of nonscalar multiplications necessary to
    evaluate polynomials, SIAM Journal on Computing 2 (1973) 60-66.
    """
    return _doubled(matrices, 1.0)


def _doubled(matrices: Any, one: float) -> Any:
    """exp(A) if `one` is 1, exp(A) - 1 if it is 0."""
    norms = np.maximum.reduce(np.add.reduce(abs(matrices), axis=1), axis=1).tolist()
    if not all(norm < _LONGEST for norm in norms):
        raise NoSolution("the time between two events is too long for the fastest mode")
    halvings = [math.ceil(math.log2(max(norm, 1.0))) for norm in norms]
    powers = np.empty((_BLOCK + 1, *matrices.shape), dtype=matrices.dtype)
    powers[0] = 0.0
    powers[0].reshape(len(matrices), -1)[:, :: matrices.shape[1] + 1] = 1.0
    np.multiply(matrices, np.array([0.5**n for n in halvings])[:, None, None], out=powers[1])
    for k in range(2, _BLOCK + 1):
        np.matmul(powers[k - 1], powers[1], out=powers[k])
    lower, block = powers[:_BLOCK].reshape(_BLOCK, -1), powers[_BLOCK]
    *sums, out = ((_WEIGHTS if one else _WITHOUT_ONE) @ lower).reshape(-1, *matrices.shape)
    out += block / math.factorial(_WEIGHTS.size)
    for part in reversed(sums):
        out = out @ block
        out += part
    with np.errstate(over="ignore", invalid="ignore"):
        return _squared(out, halvings, one)


def _squared(out: Any, times: Sequence[int], one: float) -> Any:
    """Square exponentials (k, d, d) repeatedly, (k,) times; if `one` is 0 they are exp(A) - 1."""
    least = min(times, default=0)
    for k in range(max(times, default=0)):
        if k < least:
            out = out @ out if one else out @ out + 2.0 * out
            continue
        some = [i for i, more in enumerate(times) if more > k]
        half = out[some]
        out[some] = half @ half if one else half @ half + 2.0 * half
    return out


def _norm(flow: Any) -> float:
    return float(abs(flow).sum(axis=0).max())


def run_through(flow: Array, start: Array, times: Array, measures: Array) -> Array:
    """States (k, D) at times (k,) from a start; by doubling if the times are equal steps from 0."""
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
    """exp(A t), (n, D, D), computed in units in which states are of order one."""
    return _measured(exponentials, flows, lasts, measures)


def changed(flows: Any, lasts: Any, measures: Array) -> Any:
    """exp(A t) - 1, (n, D, D), as in `moved`, with small relative error for short times."""
    return _measured(partial(_doubled, one=0.0), flows, lasts, measures)


def _measured(function: Any, flows: Any, lasts: Any, measures: Array) -> Any:
    return np.asarray(function(_scaled(flows, lasts, measures))) * measures[:, None] / measures


def _scaled(flows: Any, lasts: Any, measures: Array) -> Any:
    return flows * measures / measures[:, None] * np.asarray(lasts)[:, None, None]
