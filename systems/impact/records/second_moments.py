"""Time averages of a motion: integrals of positions and of their products, in closed form."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.validation import Array, with_squares_in_range
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw, share
from dynkit.systems.impact.modes.eigen_coordinates import EigenCoordinates
from dynkit.systems.impact.modes.taylor.mode import TaylorMode
from dynkit.systems.impact.simulation.runs import band_factor
from dynkit.systems.impact.simulation.state import Motion
from dynkit.systems.impact.simulation.trajectory import Trajectory, in_steps
from dynkit.systems.impact.variational.tangents import before_impacts

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

_EPS = 2.0**-52

# If a sum of two rates is smaller than this part of 1 / (mean duration), the closed form would
# divide by a small number. Then the integrals of the single intervals are summed instead.
_SLOW = 1e-3

# Quadrature replaces closed forms whose rounding errors may exceed this part of the largest moment.
_LOST = 1e-10

# Gauss-Legendre panels: number of nodes, and largest product of rate and length. For a term exp(z
# s) the error of a panel is less than |z h|^32 (16!)^4 / (33 (32!)^3) = 3e-26 for |z h| = 8. This
# leaves ten digits for terms that grow like a polynomial.
_NODES, _REACH = 16, 8.0
# Error of averages over the steps of Taylor's method, in units of 2^-52 of the largest average.
_OF_STEPS = 256.0
# Number of intervals that are summed up first, to reduce the rounding errors of long sums.
_BLOCK = 64

_CHUNK, MOST_NODES = 1 << 16, 1 << 25


@final
@dataclass(frozen=True, eq=False, repr=False)
class SecondMoments(Saved):
    """Integrals over time of the positions x and of x x^T, in batches of successive impacts.

    Attributes
    ----------
    products : (b, N, N)
        Integrals of x x^T over each batch.
    sums : (b, N)
        Integrals of x.
    durations : (b,)
    error, mean_error : float
        Bounds, to leading order, on the effect of rounding and of omitted bounces on any entry of
        the means of x x^T and of x. They hold for the computed motion. They do not include the
        growth of disturbances in chaos, which changes single states but not their distribution.
    cost : Cost
        Seconds; numbers of impacts, and of nodes of quadrature where closed forms lose digits.
    """

    _stored: ClassVar = ("products", "sums", "durations", "error", "mean_error", "cost")
    products: Array
    sums: Array
    durations: Array
    error: float
    mean_error: float
    cost: Cost

    def __repr__(self) -> str:
        batches, coordinates = self.sums.shape
        time = f"time {self.durations.sum():.6g} in {batches} batches"
        return f"<SecondMoments of {coordinates} coordinates: {time}, error {self.error:.1e}>"

    def dataset(self) -> Dataset:
        """Return the integrals as a dataset over ``batch``, ``mass`` and ``other``, from 1."""
        masses = np.arange(1, self.sums.shape[-1] + 1)
        return Dataset(
            {"mass": ("mass", masses), "other": ("other", masses)},
            {
                "duration": ("batch", self.durations),
                "sum": (("batch", "mass"), self.sums),
                "product": (("batch", "mass", "other"), self.products),
                "error": ((), self.error),
                "mean_error": ((), self.mean_error),
            },
            described(
                "Integrals over time of positions and of their products",
                cost=self.cost,
                error="bound on the error of any mean of a product; mean_error, of a position",
            ),
        )


@final
@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals in one mode: states at their starts, durations, and numbers of impacts before."""

    mode: Any
    starts: Array
    durations: Array
    impact: NDArray[np.intp]


def second_moments(
    oscillator: DrivenStructure, run: Trajectory, edges: NDArray[np.intp]
) -> SecondMoments:
    """Moments of a run from its start to its last impact, which must be after the start.

    The edges (b + 1,) are the numbers of impacts between which the batches lie, from 0 to all.

    Raises
    ------
    ValueError
        When squares of modal coordinates overflow.
    """
    began = time.perf_counter()
    n = oscillator.degrees_of_freedom
    moments = np.zeros((len(edges) - 1, n + 1, n + 1))
    lost = np.zeros((n + 1, n + 1))
    nodes, smooth = 0, oscillator._motion is not None
    for part in intervals(run):
        largest = abs(part.starts).max(initial=1.0)
        with_squares_in_range("modal coordinates", np.array([largest]))
        inner, own_lost = _closed_form(part, edges)
        largest = inner[:, :n, :n].sum(axis=0).max(initial=0.0)
        if not own_lost[:n, :n].max(initial=0.0) <= _LOST * largest:
            other, other_lost, count = _quadrature(part, edges)
            nodes += count
            if not own_lost.max() <= other_lost.max():
                inner, own_lost = other, other_lost
        moments += inner
        lost += own_lost
    for element, kick in _kicks(oscillator):
        lost += np.outer(kick, _left_out(oscillator, run, moments, element))
    lost += _clock_error(oscillator, run)
    if not (oscillator._strobed or smooth):
        lost += _impact_error(oscillator, run, moments.sum(axis=0))
    if not np.isfinite(lost).all():
        raise ValueError(
            f"intervals must not need more than {MOST_NODES} nodes of quadrature where modes merge"
        )
    total = float(moments[:, n, n].sum())
    return SecondMoments(
        moments[:, :n, :n],
        moments[:, :n, n],
        moments[:, n, n],
        float(lost[:n, :n].max()) / total,
        float(lost[:n, n].max()) / total,
        Cost(time.perf_counter() - began, {"impacts": run.impacts, "nodes": nodes}),
    )


def intervals(run: Trajectory) -> Iterator[Intervals]:
    """Intervals before the last impact, grouped by mode."""
    parts = run.segments
    last = int(np.searchsorted(parts.point, run.impacts))
    durations = np.diff(parts.begin)[:last]
    # Segments after a switch form a group of their own: those in a chatter are much shorter.
    for after in (False, True):
        now = np.flatnonzero((parts.kind[:last] != EventKind.IMPACT) == after)
        for mode, here in run.modes(parts.mode[now]):
            some = now[here]
            yield Intervals(mode, parts.of(mode, some), durations[some], parts.point[some])


def _closed_form(part: Intervals, edges: NDArray[np.intp]) -> tuple[Array, Array]:
    """Moments (b, N + 1, N + 1) of positions and one, and a bound of the errors of their sum."""
    size = part.mode.bodies + 1
    out = np.zeros((len(edges) - 1, size, size))
    eigen = None if isinstance(part.mode, TaylorMode) else EigenCoordinates.of(part.mode)
    if eigen is None or not np.isfinite(eigen.condition):
        return out, np.full(out.shape[1:], np.inf)
    rates, back, m = eigen.rates, eigen.back, len(eigen.rates)
    mean = float(part.durations.mean()) if len(part.durations) else 1.0
    # integrals of c c^T, and of c times the conjugate of c
    turning = np.stack([rates[:, None] + rates, rates[:, None] + rates.conj()])
    slow = abs(turning) * mean < _SLOW
    divisor = np.where(slow, 1.0, turning)
    conjugate, first, second = np.nonzero(slow)
    forward = eigen.forward.T
    flat = part.starts.reshape(len(part.starts), len(forward))
    norms = np.zeros((4, m))
    places = np.searchsorted(part.impact, edges).tolist()
    for batch, (begin, stop) in enumerate(pairwise(places)):
        change, grown = np.zeros((2, m, m), dtype=complex), np.zeros(len(first), dtype=complex)
        for low in range(begin, stop, _BLOCK):
            now = slice(low, min(low + _BLOCK, stop))
            t = part.durations[now, None]
            start = np.ones((len(t), m), dtype=complex)
            start[:, :-1] = flat[now] @ forward
            end = start * np.exp(rates * t)
            pairs = np.stack([start, start.conj()])
            change += end.T @ np.stack([end, end.conj()]) - start.T @ pairs
            other = pairs[conjugate, :, second].T
            grown += (start[:, first] * other * _grown(turning[slow], t)).sum(axis=0)
            begins, ends = abs(start) ** 2, abs(end) ** 2
            sums = begins, ends, ends * (t * eigen.fastest) ** 2, begins * t
            norms += np.stack(sums).sum(axis=1)
        integrals = change / divisor
        integrals[slow] = grown
        plain, crossed = integrals
        whole = back @ plain @ back.T + back @ crossed @ back.conj().T
        out[batch] = 0.5 * whole.real
    begins, ends, turned, over_time = np.sqrt(norms)
    size = _EPS * (8 + m) * eigen.condition
    ends_error = size * (np.outer(begins, begins) + np.outer(ends, ends))
    ends_error += 4.0 * _EPS * (np.outer(turned, ends) + np.outer(ends, turned))
    error = np.where(slow, 2.0 * size * np.outer(over_time, over_time), ends_error / abs(divisor))
    return out, 0.5 * abs(back) @ error.sum(axis=0) @ abs(back).T


def _grown(rates: Any, t: Array) -> Any:
    """Integrals (k, p) of exp(rate s) over [0, t], for rates (p,) and durations (k, 1)."""
    still = rates == 0.0
    return np.where(still, t, np.expm1(rates * t) / np.where(still, 1.0, rates))


def quadrature(part: Intervals) -> Iterator[tuple[NDArray[np.intp], Array, Array]]:
    """Nodes of Gauss-Legendre quadrature over intervals, in batches.

    Each batch has the interval numbers (k,), weights (k,) and states (k, 2, slots) of its nodes.
    They are dense enough for products of two exponential sums.
    """
    if isinstance(part.mode, TaylorMode):
        pairs = zip(part.starts, part.durations.tolist(), strict=True)
        for i, (start, duration) in enumerate(pairs):
            weights, states = part.mode.quadrature(start, duration)
            yield np.full(len(weights), i), weights, states
        return
    panels = _panels(part)
    repeats = panels.astype(np.intp)
    which = np.repeat(np.arange(len(repeats)), repeats)
    place = np.arange(len(which)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    length = (part.durations / panels)[which]
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    size = _CHUNK // _NODES
    for low in range(0, len(which), size):
        now = slice(low, low + size)
        at = (place[now, None] + 0.5 * (nodes + 1.0)) * length[now, None]
        weight = 0.5 * weights * length[now, None]
        row = np.repeat(which[now], _NODES)
        yield row, weight.ravel(), part.mode.after(part.starts, row, at.ravel())


def nodes_needed(part: Intervals) -> int | None:
    """Number of nodes of `quadrature`; None for more than `MOST_NODES`; 0 for Taylor's method."""
    if isinstance(part.mode, TaylorMode):
        return 0
    count = _panels(part).sum() * _NODES
    return int(count) if count <= MOST_NODES else None


def _panels(part: Intervals) -> Array:
    return np.maximum(np.ceil(part.durations * _fastest(part) / _REACH), 1.0)


def _fastest(part: Intervals) -> float:
    return 2.0 * float(part.mode.pairs.rates[0].max(initial=0.0))


def _quadrature(part: Intervals, edges: NDArray[np.intp]) -> tuple[Array, Array, int]:
    """Moments and bound as in `_closed_form`, by `quadrature`; then the number of nodes."""
    mode, nodes = part.mode, 0
    n = mode.bodies
    out = np.zeros((len(edges) - 1, n + 1, n + 1))
    if nodes_needed(part) is None:
        return out, np.full(out.shape[1:], np.inf), 0
    batch = np.searchsorted(edges, part.impact, side="right") - 1
    for row, weights, states in quadrature(part):
        x = np.ones((len(row), n + 1))
        x[:, :n] = mode.motion(states)[0]
        weighted = x * weights[:, None]
        for b in np.unique(batch[row]).tolist():
            own = batch[row] == b
            out[b] += weighted[own].T @ x[own]
        nodes += len(row)
    root = np.sqrt(np.diagonal(out.sum(axis=0)))
    if isinstance(mode, TaylorMode):
        return out, _OF_STEPS * _EPS * np.outer(root, root), nodes
    # Rounding errors of positions are relative to the terms of which they are sums.
    terms = np.sqrt(part.durations @ _terms(part) ** 2)
    phases = _fastest(part) * float(part.durations.max(initial=0.0))
    lost = 0.5 * _EPS * (8.0 + 2.0 * n + phases) * (np.outer(terms, root) + np.outer(root, terms))
    return out, lost, nodes


def _terms(part: Intervals) -> Array:
    """Bounds (k, N + 1) of the sums of absolute terms of positions in each interval; last, one."""
    mode, rest = part.mode, part.mode.forced.rest_terms
    rows = np.stack([mode.row(unit) for unit in np.eye(len(rest))[: mode.bodies]])
    weights = mode.pairs.bounds(rows, float(part.durations.max(initial=0.0)))
    terms = np.einsum("nij,kij->kn", weights, abs(part.starts)) + rest[: mode.bodies]
    return np.concatenate([terms, np.ones((len(terms), 1))], axis=1)


def _clock_error(oscillator: DrivenStructure, run: Trajectory) -> Array:
    """Bound (N + 1, N + 1) of the effect of rounded times, whose differences are durations."""
    root = np.sqrt(_EPS * (run.time @ _positions(oscillator, run) ** 2))
    return np.asarray(np.outer(root, root))


def _impact_error(oscillator: DrivenStructure, run: Trajectory, moments: Array) -> Array:
    """Bound (N + 1, N + 1) of the effect of impacts at gaps that are zero only to rounding.

    If the rounding error of a gap is g, and the gap closes at the rate u with the acceleration a,
    the time of the impact is wrong by s = g / |u|, at most sqrt(2 g / |a|). g is relative to the
    terms of which the gap is the sum; after a flight of duration t from the table it is at most
    t^2 / 2 times the rounding error of the acceleration.

    Let k be the velocity changes by a unit jump of the gap's rate. Positions change by (1 + r) g k,
    which is as small as other rounding errors. Velocities after the impact change by (1 + r) (|a| s
    + h) k, where h is the rounding error of u.
    Positions in the next flight, of duration t, change by at most t times that. Its integral of x_i
    x_j changes by this change times t (|k_i x_j| + |k_j x_i|) / 2. The averages R end at the last
    impact: they change by (x x^T - R) s over the whole duration.
    """
    free = oscillator._free
    x, states = _positions(oscillator, run), run.free_states[1:]
    rates, bends = before_impacts(oscillator, run)
    flights = np.diff(run.time, prepend=0.0)
    from_table = np.full(run.impacts, True)
    from_table[0] = run.start.motion is Motion.TABLE
    from_table[run.before[: run.ended]] = False
    terms = np.empty((3, run.impacts))
    for element, gap in enumerate(oscillator._gaps):
        rows, (own,) = abs(gap.rows[:6]).reshape(3, 2, -1), np.nonzero(run.element == element)
        for now in (own[part] for part in in_steps(len(own))):
            terms[:, now] = np.einsum("oij,kij->ok", rows, abs(states[now, :, : rows.shape[2]]))
        terms[0, own] += abs(gap.offset)
    place, speed, bent = band_factor(free.layout.slots) * _EPS * terms
    left = np.where(from_table, np.minimum(place, 0.5 * bent * flights**2), place)
    with np.errstate(divide="ignore", invalid="ignore"):
        late = np.fmin(left / abs(rates), np.sqrt(2.0 * left / abs(bends)))
    late = np.where(np.isfinite(late), late, 0.0)
    # A mass that comes to rest on the table does not keep an error of its velocity.
    following = np.append(np.where(from_table, flights, 0.0)[1:], 0.0)
    laws = [s.restitution for s in oscillator._stops]
    restitution = np.array([1.0 if isinstance(r, ImpactLaw) else r for r in laws])[run.element]
    pushed = (1.0 + restitution) * (abs(bends) * late + speed) * following**2
    moved = np.zeros((x.shape[1], x.shape[1]))
    for element, kick in _kicks(oscillator):
        own = run.element == element
        moved += 0.5 * np.outer(kick, pushed[own] @ abs(x[own]))
    ended = abs(np.outer(x[-1], x[-1]) - moments / moments[-1, -1]) * late[-1]
    return np.asarray(moved + moved.T + ended)


def _positions(oscillator: DrivenStructure, run: Trajectory) -> Array:
    """Positions (impacts, N + 1) at the impacts; the last column is one."""
    n, forced = oscillator.degrees_of_freedom, oscillator._free.forced
    x = np.empty((run.impacts, n + 1))
    x[:, n] = 1.0
    for now in in_steps(run.impacts):
        x[now, :n] = forced.positions(*(part[now] for part in run.coordinates))[:, :n]
    return x


def _kicks(oscillator: DrivenStructure) -> Iterator[tuple[int, Array]]:
    """For each stop, absolute velocity changes by a unit jump of the gap's rate, (N + 1,)."""
    for element, contact in enumerate(oscillator._contacts):
        yield element, np.append(abs(contact.kick_velocity[: oscillator.degrees_of_freedom]), 0.0)


def _left_out(oscillator: DrivenStructure, run: Trajectory, moments: Array, element: int) -> Array:
    """Bound (N + 1,) of the integrals over bounces that were omitted, by contact at a stop."""
    parts, stop = run.segments, oscillator._stops[element]
    own = (parts.element == element) & (parts.speed > 0.0) & (parts.point < run.impacts)
    # All bounces are lower than the first one, a parabola.
    first = share(stop.restitution, parts.speed[own])
    height = 0.25 * parts.speed[own] * parts.rest[own] * first
    squares = np.diagonal(moments.sum(axis=0))
    return np.asarray(2.0 * np.sqrt((height**2 * parts.rest[own]).sum() * squares))
