"""Steady response of linear structures to harmonic and constant forces, in modal coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.kept import cached_property, copied
from dynkit.core.validation import Array
from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import Propagators, padded
from dynkit.systems.impact.modes.bases import Basis, energy_of, row_by_row
from dynkit.systems.structure.double_double import column_sums, two_product

RESONANT = 1e-3
"""Relative distance of a mode's eigenvalue from i times the forcing frequency below which a link
from the table's slot drives the mode. Its steady response would be so large that the remaining
motion would lose digits by cancellation."""

DISTURBANCE = 8.0
"""Relative size, in units of 2^-52, of the disturbances by which `ImpactRecord.error` is estimated.
Steady responses that lose more than this factor by cancellation are refined."""

HIDDEN = 2.0**-80
"""Share of a mode in a guard, relative to the largest share, below which it is left out."""


@final
@dataclass(frozen=True)
class Layout:
    """Slots of the kernels' arrays: first those that a search for events uses, then all others.

    Attributes
    ----------
    modes : (m,) slot of each mode
    table, constant : slots of the sine and cosine of the phase and of the number one, -1 for none
    seen, slots : number of slots that a search uses, and of all slots
    """

    modes: NDArray[np.intp]
    table: int
    constant: int
    seen: int
    slots: int

    @cached_property
    def own(self) -> Any:
        """Index of the modes' slots: a slice, which gives a view, if they are the first ones."""
        count = len(self.modes)
        return slice(count) if (self.modes == np.arange(count)).all() else self.modes

    @staticmethod
    def of(hidden: NDArray[np.bool_], *, table: bool, constant: bool) -> Layout:
        """The layout for modes (m,), of which the hidden ones are left out of searches."""
        shown = int((~hidden).sum())
        modes = np.empty(len(hidden), dtype=np.intp)
        modes[~hidden] = np.arange(shown)
        seen = padded(shown + table + constant)
        modes[hidden] = seen + np.arange(len(hidden) - shown)
        return Layout(
            modes,
            shown if table else -1,
            shown + table if constant else -1,
            seen,
            seen + padded(len(hidden) - shown),
        )


@final
@dataclass(frozen=True, eq=False)
class Load:
    """Forces on some coordinates of a structure, and the given motion of the others.

    Attributes
    ----------
    frequency : float
    harmonic : (m,) complex, the force is Im(harmonic exp(i phase))
    constant : (m,)
    shape : (N,) complex, given harmonic motion Im(shape exp(i phase)) of the other coordinates
    rest : (N,) given place of the other coordinates
    """

    frequency: float
    harmonic: Any
    constant: Array
    shape: Any
    rest: Array


@final
class Forced:
    """Motion of N coordinates: m of them move in a basis under forces, the others are prescribed.

    Positions are Im(shape exp(i phase)) + rest plus those of the basis, velocities are
    Im(turning exp(i phase)) + drift plus those of the basis. With ties (h, m), the positions of h
    other coordinates also contain ties times those of the basis.
    """

    def __init__(
        self,
        basis: Basis | None,
        free: NDArray[np.intp],
        load: Load,
        tied: NDArray[np.intp] | None = None,
        ties: Array | None = None,
    ) -> None:
        self.basis = basis
        self.free = free
        self._tied, self._ties = tied, ties
        self.frequency = load.frequency
        self.shape = np.array(load.shape, dtype=complex)
        self.turning = 1j * load.frequency * self.shape
        self.rest = np.array(load.rest, dtype=float)
        self.drift = np.zeros_like(self.rest)
        self._rest_given: Array = abs(self.rest)
        self._still = np.zeros(0)
        self._own_links: list[tuple[int, bool, Array]] = []
        if basis is not None and (load.harmonic.any() or load.constant.any()):
            forces = np.stack([load.harmonic.real, load.harmonic.imag, load.constant])
            response = self._response(basis, basis.pushes(forces))
            sine, cosine, still = basis.positions(response)
            self.shape += self.spread(sine) + 1j * self.spread(cosine)
            self.rest += self.spread(still)
            # Not i times the frequency times the shape: a mode driven by a link is not included.
            sine, cosine, still = basis.velocities(response)
            self.turning += self.spread(sine) + 1j * self.spread(cosine)
            self.drift += self.spread(still)
            self._still = response[2]
        self.turns = bool(load.harmonic.any() or self.shape.any())
        self.shifts = bool(self.rest.any() or self.drift.any())

    def turned(self, frequency: float) -> Forced | None:
        """The motion at another frequency; None if harmonic or resonant parts depend on it."""
        if self.turns or self._own_links:
            return None
        return copied(self, frequency=frequency)

    @cached_property
    def rest_terms(self) -> Array:
        """Sums (N,) of the absolute values of the terms that add up to `rest`."""
        terms = self._rest_given.copy()
        if self.basis is not None and self._still.any():
            places = self.basis.units()[0]
            sums = abs(places * self._still.reshape(-1, 1)).sum(axis=0)
            terms += self.spread(sums, absolute=True)
        return np.asarray(terms)

    def spread(self, own: Array, *, absolute: bool = False) -> Array:
        """Extend numbers (..., m) of the basis's coordinates to all coordinates, (..., N)."""
        if len(self.free) == self.rest.size:
            return own
        out = np.zeros((*own.shape[:-1], self.rest.size))
        out[..., self.free] = own
        if self._ties is not None:
            ties = abs(self._ties) if absolute else self._ties
            out[..., self._tied] = row_by_row(own, ties)
        return out

    def own(self, x: Array) -> Array:
        """Select the basis's coordinates (..., m) from all coordinates (..., N)."""
        return x if len(self.free) == self.rest.size else x[..., self.free]

    def gathered(self, row: Array) -> Array:
        """Express a combination (N,) of all coordinates by the basis's coordinates, (m,)."""
        out = self.own(row)
        return out if self._ties is None else out + row[self._tied] @ self._ties

    def _response(self, basis: Basis, push: Array) -> Array:
        """Steady response (3, 2, m) to pushes (3, 2, m); modes without one go to `_own_links`."""
        pairs, w = basis.pairs, self.frequency
        g = pairs.generator
        trace, determinant = g[0] + g[3], g[0] * g[3] - g[1] * g[2]
        distance = abs(determinant - w * w - 1j * w * trace)
        terms = w * w + abs(determinant) + w * abs(trace)
        resonant = distance < RESONANT * terms
        product = abs(g[0] * g[3]) + abs(g[1] * g[2])
        lossy = distance < terms / DISTURBANCE, abs(determinant) < product / DISTURBANCE
        response = np.zeros_like(push)
        chained = np.unique(pairs.links[0])
        alone = np.ones(pairs.count, dtype=bool)
        alone[chained] = False
        # Sources of links have higher numbers than their targets, and are solved first.
        for modes in (np.flatnonzero(alone), *chained[::-1, None]):
            for target, source, b in zip(*pairs.links, pairs.coupling.T, strict=True):
                if len(modes) == 1 and target == modes[0]:
                    push[..., target] += response[..., source] @ b.reshape(2, 2).T
            for turning, none in ((True, resonant[modes]), (False, determinant[modes] == 0.0)):
                part, loses = (slice(0, 2), lossy[0]) if turning else (slice(2, 3), lossy[1])
                pushed = push[part][..., modes].any(axis=(0, 1))
                for k in modes[none & pushed].tolist():
                    self._own_links.append((k, turning, push[part, :, k].T))
                solved = modes[~none & pushed]
                if not len(solved):
                    continue
                own, low = (p[:, solved].T.reshape(-1, 2, 2) for p in (g, pairs.generator_low))
                rate, pushes = w if turning else 0.0, push[part][..., solved]
                response[part][..., solved] = _steady(own, low, rate, pushes, loses[solved])
        return response

    def arranged(self, hidden: NDArray[np.bool_], *, turns: bool) -> tuple[Layout, Propagators]:
        """Layout of all slots, and their propagators; hidden modes without links come last.

        Parts that do not depend on the frequency are cached in the basis.
        """
        if self.basis is None or self._own_links:
            layout, pairs = self._arranged(hidden, turns=turns)
            return layout, Propagators.of(pairs)
        key, known = (hidden.tobytes(), turns), self.basis.arranged
        if key in known:
            layout, propagators = known[key]
            if turns:
                propagators = propagators.turning(layout.table, self.frequency)
        else:
            layout, pairs = self._arranged(hidden, turns=turns)
            propagators = Propagators.of(pairs)
        known[key] = layout, propagators
        return layout, propagators

    def _arranged(self, hidden: NDArray[np.bool_], *, turns: bool) -> tuple[Layout, Pairs]:
        own = Pairs.empty() if self.basis is None else self.basis.pairs
        hidden = hidden.copy()
        hidden[own.links.ravel()] = False
        hidden[[k for k, _, _ in self._own_links]] = False
        layout = Layout.of(
            hidden, table=turns, constant=not all(turning for _, turning, _ in self._own_links)
        )
        table, one = Pairs.rotation(self.frequency), Pairs.constant()
        parts = [(own, layout.modes)]
        parts += [(table, np.array([layout.table]))] * turns
        parts += [(one, np.array([layout.constant]))] * (layout.constant >= 0)
        pairs = Pairs.join(*(part for part, _ in parts))
        pairs = pairs.placed(np.concatenate([slots for _, slots in parts]), layout.slots)
        for k, turning, push in self._own_links:
            coupling = push.ravel() if turning else np.array([push[0, 0], 0.0, push[1, 0], 0.0])
            source = layout.table if turning else layout.constant
            pairs = pairs.linked([[layout.modes[k]], [source]], coupling[:, None])
        return layout, pairs

    # --- coordinates (..., 2, m) of the modes, with the sine and cosine of the phase --------------

    def displacements(self, q: Array, sine: Any, cosine: Any) -> Array:
        """Positions (..., N) minus `rest`."""
        return np.asarray(self._own(q, "positions") + self._turned(sine, cosine, self.shape))

    def positions(self, q: Array, sine: Any, cosine: Any) -> Array:
        """Positions (..., N)."""
        return np.asarray(self.displacements(q, sine, cosine) + self.rest)

    def speeds(self, q: Array, sine: Any, cosine: Any) -> Array:
        """Velocities (..., N) minus `drift`."""
        return np.asarray(self._own(q, "velocities") + self._turned(sine, cosine, self.turning))

    def velocities(self, q: Array, sine: Any, cosine: Any) -> Array:
        """Velocities (..., N)."""
        return np.asarray(self.speeds(q, sine, cosine) + self.drift)

    def _turned(self, sine: Any, cosine: Any, shape: Any) -> Any:
        if not self.turns:
            return 0.0
        return np.multiply.outer(sine, shape.real) + np.multiply.outer(cosine, shape.imag)

    def _own(self, q: Array, what: Literal["positions", "velocities"]) -> Array:
        if self.basis is None:
            return np.zeros((*q.shape[:-2], self.rest.size))
        return self.spread(getattr(self.basis, what)(q))

    def coordinates(self, d: Array, v: Array, sine: Any, cosine: Any) -> Array:
        """Coordinates (..., 2, m) of positions minus `rest`, velocities minus `drift`, (..., N)."""
        if self.basis is None:
            return np.zeros((*d.shape[:-1], 2, 0))
        if self.turns:
            d = d - self._turned(sine, cosine, self.shape)
            v = v - self._turned(sine, cosine, self.turning)
        return self.basis.coordinates(d[..., self.free], v[..., self.free])

    def energies(self, q: Array, sine: Any, cosine: Any, mass: Array, stiffness: Array) -> Array:
        """Kinetic plus elastic energy (...) of all coordinates."""
        if self.basis is not None and not (self.turns or self.shifts):
            return self.basis.energies(q)
        x, v = self.positions(q, sine, cosine), self.velocities(q, sine, cosine)
        return energy_of(x, v, mass, stiffness)


def _steady(own: Array, low: Array, w: float, push: Array, lossy: NDArray[np.bool_]) -> Array:
    """Steady responses R (c, 2, k) of k modes: R Omega = (own + low) R + push.

    Omega is the rate matrix of (sine, cosine), or zero for constant pushes. Responses that lose
    digits by cancellation near a resonance are refined once.
    """
    count = len(push)
    omega = np.array([[0.0, w], [-w, 0.0]])[:count, :count]
    unit = np.eye(count)
    system = np.kron(np.eye(2), omega.T) - np.einsum("kij,ab->kiajb", own, unit).reshape(
        len(own), 2 * count, 2 * count
    )

    def solved(right: Array) -> Array:
        given = right.transpose(2, 1, 0).reshape(len(own), 2 * count, 1)
        return np.asarray(np.linalg.solve(system, given).reshape(-1, 2, count).transpose(2, 1, 0))

    found = solved(push)
    if not lossy.any():
        return found
    rates, less = (part.transpose(1, 2, 0) for part in (own, low))
    turning = np.array([w, -w])[:count, None, None]
    factors = [np.broadcast_to(p, push.shape) for p in (1.0, rates[:, 0], rates[:, 1], turning)]
    values = np.broadcast_arrays(push, found[:, :1], found[:, 1:], found[::-1])
    missed = column_sums(two_product(np.stack(factors), np.stack(values))).high
    missed = missed + less[:, 0] * found[:, :1] + less[:, 1] * found[:, 1:]
    return np.where(lossy, found + solved(missed), found)
