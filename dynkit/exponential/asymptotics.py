"""Parts of an exponential sum that do not decay: steady responses and drifts of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs

RESIDUAL = 1e-10
"""Largest residual of the equation of a steady response, relative to its terms; with a larger one
the pair has no steady response, as in resonance."""


@final
@dataclass(frozen=True, eq=False)
class Responses:
    """Steady responses of pairs to drivers that do not decay.

    Attributes
    ----------
    pairs
        The pairs minus their steady responses: without the links to drivers that have one.
    slots
        (R, 2) slot of a responding pair, and slot of its driver: a rotation or a constant.
    matrices
        (R, 2, 2) S: the response is S times the two numbers of the driver.
    """

    pairs: Pairs
    slots: NDArray[np.intp]
    matrices: Array

    @staticmethod
    def of(pairs: Pairs) -> Responses:
        """Return all steady responses; a mode in resonance and a pushed rigid body have none."""
        if not pairs.links.size:
            return Responses(pairs, np.empty((0, 2), dtype=np.intp), np.empty((0, 2, 2)))
        g, links = pairs.generator, pairs.links.T.tolist()
        coupling = pairs.coupling.T.reshape(-1, 2, 2)
        targets = {t for t, _ in links}
        drivers = [
            s
            for s in dict.fromkeys(s for _, s in links)
            if s not in targets and g[0, s] == g[3, s] == 0.0 == g[1, s] + g[2, s]
        ]
        known: dict[tuple[int, int], Array] = {}
        kept = [(t, s, b) for (t, s), b in zip(links, coupling, strict=True) if s not in drivers]
        waiting = sorted(targets)
        while waiting:
            # the links have no cycles, so one of them is driven by none of the others
            t = next(t for t in waiting if not any(to == t and s in waiting for to, s in links))
            waiting.remove(t)
            for d in drivers:
                push = np.zeros((2, 2))
                for (to, s), b in zip(links, coupling, strict=True):
                    if to == t and s == d:
                        push += b
                    elif to == t and (s, d) in known:
                        push += b @ known[s, d]
                if not push.any():
                    continue
                response = _steady(g[:, t].reshape(2, 2), g[:, d].reshape(2, 2), push)
                if response is None:
                    kept.append((t, d, push))
                else:
                    known[t, d] = response
        left = replace(
            pairs,
            links=np.array([[t, s] for t, s, _ in kept], dtype=np.intp).reshape(-1, 2).T,
            coupling=np.array([b.ravel() for _, _, b in kept]).reshape(-1, 4).T,
        )
        return Responses(
            left,
            np.array(list(known), dtype=np.intp).reshape(-1, 2),
            np.array(list(known.values())).reshape(-1, 2, 2),
        )

    def seen(self, row: Array) -> tuple[Array, Array]:
        """Return a row (2, n) for drivers, and for pairs minus steady responses, and its rounding.

        `row`, (2, n), is that for the pairs themselves; the rounding (2, n) is that of its change.
        """
        row, lost = row.copy(), np.zeros_like(row)
        for (t, d), matrix in zip(self.slots.tolist(), self.matrices, strict=True):
            row[:, d] += row[:, t] @ matrix
            lost[:, d] += 2.0**-48 * abs(row[:, t]) @ abs(matrix)
        return row, lost


def _steady(own: Array, drive: Array, push: Array) -> Array | None:
    """Return the solution S of S Omega = G S + push; None where no solution exists."""
    unit = np.eye(2)
    try:
        system = np.kron(unit, drive.T) - np.kron(own, unit)
        response = np.linalg.solve(system, push.ravel()).reshape(2, 2)
    except np.linalg.LinAlgError:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        off = abs(response @ drive - own @ response - push).max()
        terms = abs(push).max() + abs(response).max() * (abs(own).max() + abs(drive).max())
    return np.asarray(response) if off <= RESIDUAL * terms else None


@final
@dataclass(frozen=True, eq=False)
class Drift:
    """Motion of the rigid bodies in a sum.

    Attributes
    ----------
    rows
        (6, n) rows, two each, of value, rate and acceleration of the drift. The distance over which
        a body under drag still moves is a separate part of the value.
    rest
        (2, n) row of the terms that do not drift.
    lost
        (2, n) weights of abs(y) that bound by how much the value may be below the drift.
    """

    rows: Array
    rest: Array
    lost: Array

    @staticmethod
    def of(pairs: Pairs, row: Array) -> Drift | None:
        """Return the drift of a row (2, n); None where it is not known."""
        g = pairs.generator
        rigid = (pairs.scale == 0.0) & (g[0] == 0.0) & row.any(axis=0)
        if not rigid.any():
            return Drift(np.zeros((6, pairs.count)), row, np.zeros_like(row))
        dragged = rigid & (g[3] < 0.0)
        value, rest = np.where(rigid, row, 0.0), row.copy()
        rest[0, rigid] = 0.0
        rest[1, rigid & ~dragged] = 0.0
        value[1, dragged] = value[0, dragged] * g[1, dragged] / -g[3, dragged]
        # the final position of a body under drag is constant: exact zeros, not rounding errors
        own = g.copy()
        own[:, dragged] = 0.0
        rate = replace(pairs, generator=own).derivative_rows(value, 1)
        second = pairs.derivative_rows(rate, 1)
        lost = np.zeros_like(row)
        if dragged.any():
            constant = ~g.any(axis=0)
            if rate[:, ~constant].any():
                return None
            for t, s, b in zip(*pairs.links, pairs.coupling.T.tolist(), strict=True):
                # where a constant drives the velocity, the position lags behind the drift
                if dragged[t] and value[0, t] * b[0] < 0.0:
                    lost[0, s] += max(0.0, value[1, t] * b[2]) / -g[3, t]
        if pairs.derivative_rows(second, 1).any():
            return None
        return Drift(np.concatenate([value, rate, second]), rest, lost)


def tail_rows(responses: Responses, row: Array, steady: int) -> tuple[Array, Array, float]:
    """Return the weights and rows by which a ladder bounds a sum at all later times.

    Returns
    -------
    weights : (2, n), of the terms that decay
    drift : (6, n) rows as in `Drift`, with the values of constants
    swing : bound of all contributions of the pair `steady`
    """
    pairs = responses.pairs
    with np.errstate(over="ignore", invalid="ignore"):
        seen, rounding = responses.seen(row)
    drift = Drift.of(pairs, seen)
    rest = seen if drift is None else drift.rest
    rows = np.zeros((6, pairs.count)) if drift is None else drift.rows.copy()
    rest = rest.copy()
    still = ~pairs.generator.any(axis=0) & (pairs.scale > 0.0)
    rows[0, still] += rest[0, still]
    rest[:, still] = 0.0
    # a response near resonance may overflow: then there is no bound
    with np.errstate(over="ignore", invalid="ignore"):
        weights = pairs.bound(rest, 0) + rounding
    if drift is not None:
        weights = weights + drift.lost
    return weights, rows, float(weights[0, steady]) if steady >= 0 else 0.0
