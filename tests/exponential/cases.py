"""Many sums over a few sets of exponents, and their first roots by the kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynkit.exponential.evaluation_kernels import BOUND, START
from dynkit.exponential.polynomial_kernels import LIMIT, NEVER
from dynkit.exponential.propagators import workspace
from dynkit.exponential.search_kernels import FOREVER, search
from dynkit.exponential.sums import ExponentialSum

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Group:
    """Cases (m,) of sums over the same frequencies and decays (n,)."""

    frequency: Array
    decay: Array
    value: Array
    rate: Array
    offset: Array


@dataclass(frozen=True)
class Found:
    """Times (m,), infinite for none; rates; rounding bands; up to where the search is certain."""

    time: Array
    rate: Array
    band: Array
    searched: Array


def find(group: Group, *, slopes: Array | None = None, limit: int = 1_000_000) -> Found:
    """First roots of all cases; with `slopes` f starts from zero with these slopes."""
    zero = np.zeros_like(group.frequency)
    template = ExponentialSum(zero, zero, group.frequency, group.decay, 1.0)
    ladder, state = template._prepared
    work = workspace(state.shape[1])
    factor = 8.0 + state.shape[1]
    m, n = group.value.shape
    out = np.empty((4, m))
    for i in range(m):
        work.states[START] = 0.0
        work.states[START, 0, :n] = group.value[i]
        work.states[START, 1, :n] = group.rate[i]
        reach = float((ladder.rows[BOUND : BOUND + 2] * abs(work.states[START])).sum())
        sums = ladder._replace(offset=float(group.offset[i]))
        outcome, k, e, rate, _ = search(
            sums,
            0 if slopes is None else 1,
            0.0 if slopes is None else float(slopes[i]),
            factor,
            True,
            limit,
            limit,
            FOREVER,
            work,
        )
        end = k * ladder.smallest + e
        none = outcome in (NEVER, LIMIT)
        out[0, i] = np.inf if none else end
        out[1, i] = np.nan if none else rate
        out[2, i] = factor * 2.0**-52 * (reach + abs(float(group.offset[i])))
        out[3, i] = np.inf if outcome == NEVER else end
    return Found(*out)


def chain_like(rng: np.random.Generator, modes: int) -> tuple[Array, Array]:
    """Frequencies and decays of a damped chain and an undamped table, with random damping."""
    w = 2.0 * np.sin((2 * np.arange(1, modes + 1) - 1) * np.pi / (2 * (2 * modes + 1)))
    damping = rng.choice([0.0, 0.001, 0.01, 0.1, 0.5])
    frequency = np.append(w, rng.uniform(0.14, 2.0))
    return frequency, np.append(0.5 * damping * w**2, 0.0)


def random_group(rng: np.random.Generator, frequency: Array, decay: Array, count: int) -> Group:
    """Random states, the offset such that f(0) is positive."""
    n = frequency.size
    size = 10.0 ** rng.uniform(-3.0, 0.0, (count, n))
    value = size * rng.normal(size=(count, n))
    rate = size * frequency * rng.normal(size=(count, n))
    offset = abs(value.sum(axis=1)) * rng.uniform(1.0, 2.0, count)
    return Group(frequency, decay, value, rate, offset)
