"""Preparation of exponential sums for the kernels: bounds and the propagation ladder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import factorial, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.exponential.asymptotics import Responses, tail_rows
from dynkit.exponential.modes import Pairs

LANES = 8
"""Slots are padded to a multiple of this, for vector instructions throughout."""

MAXIMUM_RUNGS = 61

LARGEST = 1e300
"""Upper limit of weights."""

SLOWEST = 1e-20
"""Lower limit of the fastest rate for the smallest step, whose powers must not overflow."""

SLOW = 1e-4
"""A term slower than the fastest one by this factor remains below its amplitude for a long time:
its rounding is estimated from its present size."""

LONGEST, BEYOND = 46, 20
"""Least number of rungs for propagation over long times, and number of rungs beyond those of a
search: the longest step is then 2^20 times as long, so that few steps are taken one by one."""

_ORDERS, _COUPLED_ORDERS = 26, 40
"""Numbers of terms of the Taylor series over the smallest step: of a pair, and of coupled pairs,
whose matrix may have a larger norm."""

# A call of the search examines _NUMBERS_OF_A_CALL / (n + _LEAST_SLOTS) cells of n slots. A cell of
# n = 8 to 208 slots takes 1.7 to 2.4 ns times (n + 64) at 2.5 GHz, and up to ten times as long with
# a Taylor polynomial: a call takes 10 to 100 ms.
_NUMBERS_OF_A_CALL, _LEAST_SLOTS = 1 << 22, 64


@cache
def _kernels() -> Any:
    """The modules of the kernels, imported once: an import in each call takes as long as they."""
    from dynkit.exponential import double_double_kernels, evaluation_kernels, ladder_kernels

    return double_double_kernels, evaluation_kernels, ladder_kernels


def padded(count: int) -> int:
    """Return the number of slots for `count` terms."""
    return -(-count // LANES) * LANES


def rung_sizes(pairs: Pairs) -> tuple[float, int]:
    """Return the smallest step (a power of two with abs(lambda) h <= REACH) and number of rungs."""
    fast, slow = (part.tolist() for part in pairs.rates)
    fastest = max(SLOWEST, *fast) if any(fast) else 1.0
    slowest = min([fastest, *(rate for rate in slow if rate > 0.0)])
    if pairs.grows:
        # a rigid body may move for a long time without an event: long cells are needed
        slowest = min(slowest, 1e-9 * fastest)
    smallest = 2.0 ** np.floor(np.log2(_kernels()[1].REACH / fastest))
    rungs = int(np.ceil(np.log2(8.0 * np.pi / smallest) - np.log2(slowest))) + 1
    if pairs.steadily < inf:  # bounds hold for the longest step
        rungs = min(rungs, int(np.log2(max(pairs.steadily / smallest, 1.0))) + 1)
    return float(smallest), min(max(rungs, 2), MAXIMUM_RUNGS)


@dataclass(frozen=True)
class Propagators:
    """Propagators of pairs over steps of ``smallest * 2**j``.

    Attributes
    ----------
    pairs : Pairs
    smallest : float
    rungs : number of rungs of a search
    step : (all rungs, 8, slots) propagators exp(G h), high and low parts
    links : (L, 2) targets and sources
    link_step : (2 + all rungs, L, 4) coupling, contribution in a step of each rung, and steady
        response of each link
    generator : (6, slots) entries 11, 12, 21, 22, trace and determinant of G
    responses : steady responses
    """

    pairs: Pairs
    smallest: float
    rungs: int
    step: Array
    links: NDArray[np.intp]
    link_step: Array
    generator: Array
    responses: Responses

    @staticmethod
    def of(pairs: Pairs) -> Propagators:
        """Return the propagators of pairs."""
        smallest, rungs = rung_sizes(pairs)
        step = steps(pairs, smallest, max(min(rungs + BEYOND, MAXIMUM_RUNGS + 1), LONGEST))
        responses = Responses.of(pairs)
        links = _links(pairs, smallest, len(step), responses)
        g = _pad(pairs.generator, step.shape[2])
        generator = np.concatenate([g, [g[0] + g[3], g[0] * g[3] - g[1] * g[2]]])
        return Propagators(pairs, smallest, rungs, step, *links, generator, responses)

    def turning(self, slot: int, frequency: float) -> Propagators:
        """Return the propagators with another frequency of a rotation that drives no other pair."""
        pairs = self.pairs.turning(slot, frequency)
        between = pairs.spans(slot, self.generator[1, slot], frequency)
        if not between and rung_sizes(pairs) != (self.smallest, self.rungs):
            return Propagators.of(pairs)
        step, generator = self.step.copy(), self.generator.copy()
        _fill_steps(pairs, self.smallest, slot, slot + 1, step)
        generator[1:3, slot], generator[5, slot] = (frequency, -frequency), frequency * frequency
        links, known = (self.links, self.link_step), self.responses
        left = pairs if known.pairs is self.pairs else known.pairs.turning(slot, frequency)
        responses = Responses(left, known.slots, known.matrices)
        return Propagators(pairs, self.smallest, self.rungs, step, *links, generator, responses)

    @cached_property
    def ladder(self) -> Any:
        """Ladder of a sum without terms, for propagation only."""
        kernels, slots = _kernels()[1], self.step.shape[2]
        return kernels.Ladder(
            self.step,
            np.zeros((0, 10, slots)),
            np.zeros((kernels.SEPARATE + 1, slots)),
            self.generator,
            self.links,
            self.link_step,
            offset=0.0,
            smallest=self.smallest,
            smooth=0,
            apart=False,
            grows=False,
            window=inf,
            steady=-1,
            swing=0.0,
        )


def steps(pairs: Pairs, smallest: float, rungs: int) -> Array:
    """Return propagators (rungs, 8, slots) of uncoupled pairs over ``smallest * 2**j``."""
    step = np.zeros((rungs, 8, padded(pairs.count)))
    _fill_steps(pairs, smallest, 0, pairs.count, step)
    return step


def _fill_steps(pairs: Pairs, smallest: float, first: int, last: int, step: Array) -> None:
    parts = (part.reshape(2, 2, -1) for part in (pairs.generator, pairs.generator_low))
    into = step.reshape(len(step), 2, 2, 2, step.shape[2])
    _kernels()[0].fill_steps(*parts, smallest, _ORDERS, first, last, into, np.empty((8, 2, 2)))


def _links(
    pairs: Pairs, smallest: float, rungs: int, responses: Responses
) -> tuple[NDArray[np.intp], Array]:
    """Return all direct and indirect links between slots, (L, 2), and their `link_step`."""
    if not pairs.links.size:
        return np.empty((0, 2), dtype=np.intp), np.empty((2 + rungs, 0, 4))
    slots = np.unique(pairs.links)
    m = slots.size
    parts = []
    for own in (pairs.generator, pairs.generator_low):
        matrix = np.zeros((m, 2, m, 2))
        matrix[np.arange(m), :, np.arange(m), :] = own[:, slots].T.reshape(m, 2, 2)
        parts.append(matrix)
    target, source = np.searchsorted(slots, pairs.links)
    direct = parts[0]
    for t, s, b in zip(target, source, pairs.coupling.T.reshape(-1, 2, 2), strict=True):
        direct[t, :, s] += b
    n = 2 * m
    step, work = np.empty((rungs, 2, n, n, 1)), np.empty((8, n, n))
    generators = (part.reshape(n, n, 1) for part in parts)
    _kernels()[0].fill_steps(*generators, smallest, _COUPLED_ORDERS, 0, 1, step, work)
    both = np.concatenate([direct[None], step[:, 0].reshape(rungs, m, 2, m, 2)])
    reached = np.zeros((m, m), dtype=bool)
    reached[target, source] = True
    for _ in range(m):
        reached = reached | (reached @ reached)
    to, start = np.nonzero(reached)
    links = np.stack([slots[to], slots[start]], axis=1)
    reach = np.zeros((2 + rungs, len(links), 2, 2))
    reach[:-1] = both[:, to, :, start, :].transpose(1, 0, 2, 3)
    for way, matrix in zip(responses.slots, responses.matrices, strict=True):
        reach[-1, (links == way).all(axis=1)] = matrix
    return links, reach.reshape(2 + rungs, -1, 4)


def _pad(rows: Array, slots: int) -> Array:
    """Return the first slots of rows, padded with zeros."""
    out = np.zeros((*rows.shape[:-1], slots))
    out[..., : rows.shape[-1]] = rows[..., :slots]
    return out


def _cell_bounds(bounds: Array, h: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return weights of abs(y) on the cells of each rung, and whether terms are kept.

    Both are (rungs, 2, n); `bounds` (4, rungs or 1, 2, n) are those of f, f', f'' and f^(6) on
    cells of the sizes h, (rungs, 1, 1).

    The error of the quintic Hermite polynomial of f is at most h^6/46080 sup |f^(6)|, and at most
    2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''| (the Bernstein coefficients of the polynomial). A
    term is left out of cells for which the second bound is smaller; the error of f is then at most
    sup |f|.
    """
    most, first, second, sixth = bounds
    with np.errstate(over="ignore", invalid="ignore"):
        error = sixth * h**6 / 46080.0
        kept = ~(2.0 * most + 0.4 * h * first + 0.05 * h * h * second < error)
    kept[0] = True
    # weights are finite, so that their product with a zero number is zero
    return np.fmin(np.where(kept, error, most), LARGEST), kept


def ladder(row: Array, offset: float, propagators: Propagators, steady: int) -> Any:
    """Return the `Ladder` of the exponential sum ``offset + row . y``.

    Parameters
    ----------
    row : (2, seen)
        Coefficients of the first slots, on which the sum depends.
    steady
        Slot of the table, a sine and cosine; -1 for none.
    """
    pairs = propagators.pairs
    fast = pairs.rates[0]
    slow = (pairs.scale > 0.0) & (fast > 0.0) & (fast < SLOW * fast.max(initial=0.0))
    slow[: row.shape[1]] &= row.any(axis=0)
    slow[row.shape[1] :] = False
    slow[[steady] if steady >= 0 else []] = False  # its amplitude is constant
    if pairs.independent:
        found = _alone(row, slow, propagators, steady)
    else:
        found = _joint(row, slow, propagators, steady)
    return propagators.ladder._replace(
        offset=float(offset), grows=pairs.grows or bool(slow.any()), steady=steady, **found
    )


def turned(one: Any, propagators: Propagators) -> Any:
    """Return the `Ladder` of a sum with other propagators: those after `Propagators.turning`.

    If the other pairs are not affected, only the slot of the rotation is computed again.
    """
    pairs, row, slot = propagators.pairs, one.rows[:2], one.steady
    alike = slot >= 0 and pairs.independent and not one.grows
    turns = propagators.generator[1, slot], one.generator[1, slot]
    if not (alike and pairs.spans(slot, *turns)):
        return ladder(row, one.offset, propagators, slot)
    found = _alone(row, np.zeros(pairs.count, dtype=bool), propagators, slot, one)
    return one._replace(step=propagators.step, generator=propagators.generator, **found)


def _alone(
    row: Array, slow: NDArray[np.bool_], propagators: Propagators, steady: int, known: Any = None
) -> dict[str, Any]:
    """Return the fields of a ladder for a row of independent pairs.

    With a known ladder only slot `steady` is computed.
    """
    _, kernels, ladder_kernels = _kernels()
    pairs, seen, first, last = propagators.pairs, padded(row.shape[1]), 0, row.shape[1]
    if known is None:
        rows = np.zeros((kernels.SEPARATE + 1, seen))
        cell = np.zeros((propagators.rungs, 10, seen))
    else:
        rows, cell, first, last = known.rows.copy(), known.cell.copy(), steady, steady + 1
    smooth = ladder_kernels.fill_sum(
        pairs.generator,
        pairs.scale,
        slow.astype(float),
        np.ascontiguousarray(row),
        float(factorial(kernels.DEGREE + 1)),
        LARGEST,
        propagators.smallest,
        propagators.step,
        rows,
        cell,
        np.empty((2, kernels.DEGREE + 2, 2)),
        first,
        last,
    )
    return {
        "cell": cell,
        "rows": rows,
        "smooth": smooth,
        "apart": known.apart if known else bool(np.any(pairs.scale[: row.shape[1]] == 0.0)),
        "swing": float(rows[kernels.TAIL, steady]) if steady >= 0 else 0.0,
    }


def _joint(
    row: Array, slow: NDArray[np.bool_], propagators: Propagators, steady: int
) -> dict[str, Any]:
    """Return the fields of a ladder for a row of pairs that drive one another, or grow."""
    degree, pairs = _kernels()[1].DEGREE, propagators.pairs
    step, rungs = propagators.step, propagators.rungs
    seen = padded(row.shape[1])
    full = _pad(row, pairs.count)
    h = np.asarray(propagators.smallest * 2.0 ** np.arange(rungs), dtype=np.float64)
    window = float(h[-1]) if pairs.grows else inf
    with np.errstate(over="ignore", invalid="ignore"):
        derivatives = pairs.derivatives(full, degree + 2)
        size, first, second, fourth, sixth, last = pairs.bounds(
            derivatives[[0, 1, 2, 4, 6, degree + 1]], window
        )
        last /= factorial(degree + 1)
        each = np.stack([size, first, second, sixth])[:, None]
        if pairs.grows:
            each = pairs.bounds(derivatives[[0, 1, 2, 6]], h).swapaxes(0, 1)
        weights, kept = _cell_bounds(each, h[:, None, None])
    rows = _pad(derivatives[:4].reshape(8, -1), seen)
    tail, drift, swing = tail_rows(propagators.responses, full, steady)
    if pairs.grows:
        size = pairs.bound(full, 0)
        size = np.where(np.isfinite(size), size, pairs.bound(full, 0, 0.0))
    size[:, slow] = abs(full[:, slow])
    bounds = [size, fourth, last, tail, drift]
    bounds.append((pairs.scale == 0.0).astype(float)[None])
    rows = np.concatenate([rows, _pad(np.concatenate(bounds), seen)])
    cell, b = np.empty((rungs, 10, seen)), propagators.link_step[1 : 1 + rungs, :, None]
    upper, lower = rows[0:6:2], rows[1:6:2]
    for k in range(2):
        own = step[:rungs, k, None, :seen], step[:rungs, k + 2, None, :seen]
        cell[:, k:6:2] = upper * own[0] + lower * own[1]
        for i, (t, s) in enumerate(propagators.links.tolist()):  # all linked slots are seen
            cell[:, k:6:2, s] += upper[:, t] * b[:, i, :, k] + lower[:, t] * b[:, i, :, k + 2]
    cell[:, 6:8], cell[:, 8:] = _pad(weights, seen), _pad(kept.astype(float), seen)
    return {
        "cell": cell,
        "rows": rows,
        "smooth": int(np.logical_and.accumulate(kept.all(axis=(1, 2))).sum()) - 1,
        "apart": bool(np.any(pairs.scale[: row.shape[1]] == 0.0)) or len(propagators.links) > 0,
        "window": float(window),
        "swing": swing,
    }


def workspace(slots: int) -> Any:
    """Return the buffers of a search."""
    kernels = _kernels()[1]
    return kernels.Workspace(
        np.zeros((kernels.STATES, 2, slots)),
        np.zeros(kernels.DEGREE + 1),
        np.zeros(kernels.PLACES, dtype=np.int64),
        np.zeros(kernels.LEVELS),
        np.zeros(kernels.CODES, dtype=np.int64),
    )


def cells_of_a_call(slots: int) -> int:
    """Return the number of cells after which a search returns, so that it can be interrupted."""
    return _NUMBERS_OF_A_CALL // (slots + _LEAST_SLOTS)
