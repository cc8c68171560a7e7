"""Time averages of a motion and of its products, in batches: exact, or from samples."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, final, runtime_checkable

import numpy as np

from dynkit.analysis.batches import Edges
from dynkit.analysis.motions import source_of
from dynkit.analysis.regimes import RegimeChange, regime_change
from dynkit.core.cost import Cost
from dynkit.core.validation import Array, ascending, finite_array, with_squares_in_range
from dynkit.dynamics.attractor import Attractor

BATCHES = 32
"""Number of batches of a motion that is long enough."""

# Number of standard deviations of the sum of errors over gaps in the error of the trapezoidal rule.
_SCATTERS = 4.0


@final
@dataclass(frozen=True, eq=False)
class Averages:
    """Integrals over time in b batches; without times, sums over samples of duration one.

    Parameters
    ----------
    products : (b, N, N) array
        Integrals of x x^T.
    sums : (b, N) array
        Integrals of x.
    durations : (b,) array
    error, mean_error : float
        Bounds of the errors of any entry of the means of x x^T and of x.
    cost : Cost
    """

    products: Array
    sums: Array
    durations: Array
    error: float
    mean_error: float
    cost: Cost


@runtime_checkable
class KnowsAverages(Protocol):
    """A motion with exact time averages."""

    def second_moments(self, batches: int | Sequence[int]) -> Any:
        """Return averages in at most this number of batches, with the attributes of `Averages`.

        Instead of the number, `batches` may be the edges of the batches: numbers of states, from 0.
        """
        ...


def change_of(source: object) -> RegimeChange | None:
    """Return the change of regime of the states of a motion; None for samples."""
    if not isinstance(source, KnowsAverages | Attractor):
        return None
    states: Array = getattr(source, "states")  # noqa: B009  # attractors and records have them
    return regime_change(with_squares(states))


def with_squares(values: Array) -> Array:
    """Return columns (k, 2n) of values (k, n) and of their squares, for tests of regimes."""
    return np.column_stack([values, values**2])


def averages_of(source: object, times: object = None) -> Callable[[], Any]:
    """Check an attractor, a record or samples (k, N); return a function for their averages."""
    if isinstance(source, KnowsAverages):
        if times is not None:
            raise ValueError("times must not be given with a motion whose averages are exact")
        return partial(_exact, source)
    source = source_of(source)
    if isinstance(source, Attractor):
        source = source.states
    samples = with_squares_in_range("source", finite_array("source", source, (None, None)).copy())
    if len(samples) < 2 or not samples.shape[1]:
        raise ValueError(f"source must hold two samples or more; got shape {samples.shape}")
    if times is None:
        return partial(_sums, samples, np.ones(len(samples)), None)
    at = ascending("times", finite_array("times", times, (len(samples),)))
    return partial(_sums, samples, _halves(at), at)


def _exact(source: KnowsAverages) -> Averages:
    """Return exact averages; ValueError where squares of positions have lost their digits."""
    found: Averages = source.second_moments(BATCHES)
    squares = np.diagonal(found.products.sum(axis=0)) / found.durations.sum()
    with_squares_in_range("root mean squares of positions", np.sqrt(squares))
    return found


def averages_over(block: Attractor, edges: Edges) -> Any:
    """Return averages of an attractor in batches of its states with these edges, (b + 1,)."""
    if isinstance(block, KnowsAverages):
        return block.second_moments(edges.tolist())
    return _sums(block.states, np.ones(len(block.states)), None, edges)


def _sums(
    samples: Array, weights: Array, times: Array | None, edges: Edges | None = None
) -> Averages:
    """Return averages of samples (k, N) with weights (k,).

    With times the weights are those of the trapezoidal rule, and its error is included.
    """
    began = time.perf_counter()
    if edges is None:
        count = min(BATCHES, len(samples))
        batches = np.array_split(np.arange(len(samples)), count)
    else:
        batches = np.split(np.arange(len(samples)), edges[1:-1])
    products = np.array([(samples[b] * weights[b, None]).T @ samples[b] for b in batches])
    sums = np.array([weights[b] @ samples[b] for b in batches])
    rounding = 2.0**-52 * max(map(len, batches))
    error = rounding * float((samples * samples).max())
    mean_error = rounding * float(abs(samples).max())
    if times is not None:
        error += max(_trapezoidal_error(column[:, None] * samples, times) for column in samples.T)
        mean_error += _trapezoidal_error(samples, times)
    durations = np.array([weights[b].sum() for b in batches])
    cost = Cost(time.perf_counter() - began, {"samples": len(samples)})
    return Averages(products, sums, durations, error, mean_error, cost)


def _trapezoidal_error(values: Array, times: Array) -> float:
    """Return the largest error of averages of values (k, m) by the trapezoidal rule.

    The error over a gap h is h^3 / 12 times the second derivative. It is estimated twice, with the
    next sample before and after the gap. Errors of gaps may cancel in the sum; the differences of
    the two estimates are added as independent errors. Two samples have no second derivative: their
    error is infinite.
    """
    if len(times) < 3:
        return np.inf
    gaps = np.diff(times)[:, None]
    bends = np.diff(np.diff(values, axis=0) / gaps, axis=0) / (gaps[:-1] + gaps[1:])
    after = gaps**3 / 6.0 * np.concatenate([bends, bends[-1:]])
    before = gaps**3 / 6.0 * np.concatenate([bends[:1], bends])
    largest = np.maximum(abs(after.sum(axis=0)), abs(before.sum(axis=0)))
    scatter = np.sqrt(((after - before) ** 2).sum(axis=0))
    return float((largest + _SCATTERS * scatter).max()) / float(times[-1] - times[0])


def _halves(times: Array) -> Array:
    gaps = np.diff(times)
    return np.asarray(0.5 * (np.append(0.0, gaps) + np.append(gaps, 0.0)))
