"""What is at a bifurcation of orbits of impact oscillators, in balls.

State: positions, velocities, sine and cosine of the phase, and 1, which exp(rates t) moves. What
impacts make of disturbances is the saltation matrix (M. di Bernardo et al., Piecewise-smooth
Dynamical Systems, Springer 2008, section 2.5): no formula of dynkit's is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from dynkit.systems import ImpactChain
from dynkit.systems.impact.impact_map import ImpactMap as System
from tests.impact_orbits.exact_orbits import Ball, rates_of


def block(matrix: Ball, size: int) -> Ball:
    """The first rows and columns."""
    return arb_mat([row[:size] for row in matrix.table()[:size]])


@final
class Motion:
    """An oscillator at values of some parameters, in balls."""

    def __init__(self, system: System, free: dict[str, Ball]) -> None:
        value = {name: arb(x) for name, x in system.parameters.items()} | free
        n, c = system.degrees_of_freedom, system.contact % system.degrees_of_freedom
        self.size, self.restitution, self.frequency = n, value["restitution"], value["frequency"]
        sign = 1 if system.side == "above" else -1
        self.signs, places = [sign], [value["offset"]]
        if np.isfinite(system.play):
            self.signs.append(-sign)
            places.append(value["offset"] + sign * value["play"])
        inverse, drag, spring = _matrices(system, value)
        harmonic = np.asarray(system.harmonic_forces or (0j,) * n)
        constant = np.asarray(system.constant_forces or (0.0,) * n)
        forces = inverse * arb_mat(np.transpose([harmonic.real, harmonic.imag, constant]).tolist())
        self.rates = rates_of(inverse * spring, inverse * drag, forces, self.frequency)
        self.kick = arb_mat(2 * n + 3, 1)
        for i in range(n):
            self.kick[n + i, 0] = inverse[i, c] / inverse[c, c]
        self.gaps = []
        for s, place in zip(self.signs, places, strict=True):
            row = arb_mat(1, 2 * n + 3)
            row[0, c], row[0, 2 * n], row[0, 2 * n + 2] = s, -s * value["amplitude"], -s * place
            self.gaps.append(row.mid())

    def flow(self, phase: Ball) -> Ball:
        """Over the time of a phase."""
        return (self.rates * (phase / self.frequency)).exp().mid()

    def forced(self, phase: Ball) -> Ball:
        """The motion that the forces have with no impact, at a phase."""
        n, w = 2 * self.size, self.frequency
        free, rows = block(self.rates, n), self.rates.table()
        one = arb_mat(np.eye(n).tolist())
        force = acb_mat([[acb(rows[i][n], rows[i][n + 1])] for i in range(n)])
        turned = (acb_mat(one) * acb(0, w) - acb_mat(free)).solve(force) * (acb(0, phase).exp())
        still = free.solve(arb_mat([[rows[i][n + 2]] for i in range(n)]))
        moved = [[turned[i, 0].imag - still[i, 0]] for i in range(n)]
        sine, cosine = phase.sin_cos()
        return arb_mat([*moved, [sine], [cosine], [arb(1)]]).mid()

    def impact(self, before: Ball, after: Ball, side: int) -> Ball:
        """What it makes of disturbances that are there at the same time."""
        gap, one = self.gaps[side], arb_mat(np.eye(2 * self.size + 3).tolist())
        rate = gap * self.rates
        reset = one - self.kick * rate * ((1 + self.restitution) * self.signs[side])
        late = (self.rates * after - reset * (self.rates * before)) * (1 / (rate * before)[0, 0])
        return (reset + late * gap).mid()


def _matrices(system: System, value: dict[str, Ball]) -> tuple[Ball, Ball, Ball]:
    """The inverse of the mass, damping and stiffness."""
    if isinstance(system, ImpactChain):
        one = system.replace(damping=1.0, springs=1.0)
        spring = arb_mat(one.stiffness.tolist()) * value["springs"]
        mass = arb_mat(one.mass.tolist())
        return mass.inv().mid(), spring * value["damping"], spring
    parts = system.mass, system.damping_matrix, system.stiffness
    mass, damping, stiffness = (arb_mat(part.tolist()) for part in parts)
    return mass.inv().mid(), damping, stiffness


@final
@dataclass(frozen=True)
class Impacts:
    """Equations of a bifurcation of P(n,m): (phases, impulses, own unknowns, parameters) -> zeros.

    Parameters
    ----------
    system : ImpactOscillator
    names : tuple of str
        The free parameters.
    periods : int
    sides : (n,) which stop each impact is with
    kind, event :
        As those of `Bifurcation`.
    """

    system: System
    names: tuple[str, ...]
    periods: int
    sides: tuple[int, ...]
    kind: str
    event: int

    def __call__(self, y: list[Ball]) -> list[Ball]:
        n, k = len(self.sides), len(self.names)
        motion = Motion(self.system, dict(zip(self.names, y[-k:], strict=True)))
        phases, impulses, own = y[:n], y[n : 2 * n], y[2 * n : len(y) - k]
        turn = 2 * arb.pi() * self.periods
        order = sorted(range(n), key=lambda i: float((phases[i] - phases[0]).mid()) % float(turn))
        flows = []
        for i, later in zip(order, [*order[1:], order[0]], strict=True):
            ahead = phases[later] - phases[i]
            flows.append(motion.flow(ahead - turn * ((ahead / turn).floor() if n > 1 else -1)))
        pushes = [motion.kick * (motion.signs[self.sides[i]] * impulses[i]) for i in order]
        states = self._states(motion, flows, pushes)
        out: dict[int, list[Ball]] = {}
        after = {}
        for i, free in zip(order, states, strict=True):
            state, gap = free + motion.forced(phases[i]), motion.gaps[self.sides[i]]
            rate = (gap * motion.rates * state)[0, 0]
            r = motion.restitution
            out[i] = [(gap * state)[0, 0], rate - r / (1 + r) * impulses[i]]
            after[i] = state
        zeros = [zero for i in range(n) for zero in out[i]]
        if self.kind in ("GR", "CB"):
            return zeros + self._border(motion, after, impulses, phases, own)
        product = arb_mat(np.eye(2 * motion.size + 3).tolist())
        for i, flow, push in zip(order, flows, pushes, strict=True):
            product = flow * motion.impact(after[i] - push, after[i], self.sides[i]) * product
        return zeros + self._critical(block(product, 2 * motion.size), own)

    @staticmethod
    def _states(motion: Motion, flows: list[Ball], pushes: list[Ball]) -> list[Ball]:
        """Free states just after the impacts, in the order of time."""
        n = 2 * motion.size
        around, pushed = arb_mat(np.eye(n).tolist()), arb_mat(n, 1)
        for flow, push in zip(flows, pushes, strict=True):
            flow = block(flow, n)
            around = flow * around
            pushed = flow * (pushed + arb_mat(push.table()[:n]))
        first = (arb_mat(np.eye(n).tolist()) - around).solve(pushed).mid()
        out = []
        before = first
        for flow, push in zip(flows, pushes, strict=True):
            here = before + arb_mat(push.table()[:n])
            out.append(arb_mat([*here.table(), [arb(0)], [arb(0)], [arb(0)]]))
            before = block(flow, n) * here
        return out

    def _critical(self, product: Ball, own: list[Ball]) -> list[Ball]:
        one = arb_mat(np.eye(product.nrows()).tolist())
        if self.kind == "NS":
            left = (acb_mat(product) - acb_mat(one) * acb(0, own[0]).exp()).det()
            return [left.real, left.imag]
        return [(product - one * {"SN": 1, "PD": -1}[self.kind]).det()]

    def _border(
        self,
        motion: Motion,
        after: dict[int, Ball],
        impulses: list[Ball],
        phases: list[Ball],
        own: list[Ball],
    ) -> list[Ball]:
        n, stops = len(self.sides), len(motion.signs)
        if self.event < n:
            return [impulses[self.event]]
        if self.kind == "CB":
            i = self.event - n - n * stops
            gap = motion.gaps[self.sides[i]]
            return [(gap * motion.rates * motion.rates * after[i])[0, 0]]
        i, side = divmod(self.event - n, stops)
        state = motion.flow(own[0] - phases[i]) * after[i]
        gap = motion.gaps[side]
        return [(gap * state)[0, 0], (gap * motion.rates * state)[0, 0]]
