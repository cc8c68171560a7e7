"""What could make the resonances: frequencies of chains by several rules, against those found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dynkit.systems import ImpactChain
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.arrays import Array
from tutorials.cusumano_bai_1993.resonances.branches import contacts_of
from tutorials.cusumano_bai_1993.workshop import Workshop

_STEP = 0.025
LOW, HIGH, FINE = 0.85, 1.20, 0.005
"""A resonance is sought from the lowest to the highest of these multiples of m times the bilinear
frequency, in coarse steps, then in fine ones about the best."""


class Modes(NamedTuple):
    """Undamped frequencies of a chain.

    Parameters
    ----------
    free : (N,) array
        With its tip free.
    stuck : (N - 1,) array
        With its tip held.
    passage : float
        Time that a long wave takes along the springs.
    """

    free: Array
    stuck: Array
    passage: float


def modes_of(chain: ImpactChain) -> Modes:
    """Return the frequencies of a chain."""
    from scipy.linalg import eigh

    mass, stiffness = np.asarray(chain.mass), np.asarray(chain.stiffness)
    free = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
    stuck = np.sqrt(eigh(stiffness[:-1, :-1], mass[:-1, :-1], eigvals_only=True))
    # From the sums along a row: each spring holds the mass before it and that behind.
    springs = np.cumsum(stiffness.sum(axis=1)[::-1])[::-1]
    springs = -np.append(-springs[0], np.diag(stiffness, 1))
    return Modes(free, stuck, float(np.sqrt(np.diag(mass) / springs).sum()))


def bilinear(modes: Modes) -> float:
    """Return the frequency of half a period of the free chain and half a one of the stuck chain."""
    free, stuck = float(modes.free[0]), float(modes.stuck[0])
    return 2.0 * free * stuck / (free + stuck)


RULES: Mapping[str, Callable[[Modes], float]] = {
    "$w_1$": lambda modes: float(modes.free[0]),
    "$W_1$": lambda modes: float(modes.stuck[0]),
    "$w_2/2$": lambda modes: float(modes.free[1]) / 2.0,
    "mean of $w_1$, $W_1$": lambda modes: float(modes.free[0] + modes.stuck[0]) / 2.0,
    "wave": lambda modes: 2.0 * np.pi / (3.0 * modes.passage),
    "bilinear": bilinear,
}
"""What the frequency of the motion, that of the table over m, may be, by its name."""


@dataclass(frozen=True)
class Resonance:
    """Where the energy of a chain is largest near m times its bilinear frequency.

    Parameters
    ----------
    name : str
        Of the chain.
    periods : int
        m, the table periods in a period of the motion.
    modes : Modes
    frequency : float
        Of the table.
    energy : float
        The largest just after an impact.
    step : float
        Of the finest grid that it was sought on.
    sticks : bool
        Whether the motion there does.
    """

    name: str
    periods: int
    modes: Modes
    frequency: float
    energy: float
    step: float
    sticks: bool

    @property
    def base(self) -> float:
        """The frequency of the motion."""
        return self.frequency / self.periods

    def deviation(self, rule: str) -> float:
        """Return how far the frequency found is above that of a rule, relative."""
        return self.base / RULES[rule](self.modes) - 1.0


def chains(workshop: Workshop) -> dict[str, ImpactChain]:
    """Return chains that differ from the paper's, by what is different."""
    chain, n = workshop.chain(paper.FREQUENCIES[0]), paper.MASSES
    ones = (1.0,) * (n - 1)
    return {
        "$N = 5$": chain.replace(masses=5),
        "$N = 7$": chain.replace(masses=7),
        "$N = 14$": chain.replace(masses=14),
        "$N = 20$": chain.replace(masses=20),
        "wall spring 0.2": chain.replace(springs=(0.2, *ones)),
        "masses 0.5 to 2": chain.replace(masses=tuple(np.linspace(0.5, 2.0, n).tolist())),
        "first mass 10": chain.replace(masses=(10.0, *ones)),
        "damping 0.3": chain.replace(damping=0.3),
        "restitution 0": chain.replace(restitution=0.0),
    }


def resonance(name: str, chain: ImpactChain, periods: int) -> Resonance:
    """Return the resonance of a chain, in a sweep of the frequency as the paper made it."""
    modes = modes_of(chain)
    unit = periods * bilinear(modes)
    coarse = np.arange(LOW, HIGH + 0.5 * _STEP, _STEP)
    near, _, _ = _highest(chain, unit * coarse)
    fine = np.arange(near / unit - _STEP, near / unit + 1.1 * _STEP, FINE)
    at, energy, sticks = _highest(chain, unit * fine)
    return Resonance(name, periods, modes, at, energy, unit * FINE, sticks)


def _highest(chain: ImpactChain, values: Array) -> tuple[float, float, bool]:
    """Where the largest energy of a sweep is, how large, and whether the motion sticks there."""
    sweep = Workshop.swept(chain.replace(frequency=float(values[0])), values)
    energies = np.nanmax(sweep.observable("energy"), axis=1)
    top = int(energies.argmax())
    at = float(sweep.values[top])
    sticks = len(contacts_of(sweep, top)) > 0
    return at, float(energies[top]), sticks


def spread(found: Sequence[Resonance], rule: str) -> tuple[float, float]:
    """Return the root mean square and the largest modulus of a rule's deviations."""
    deviations = np.array([each.deviation(rule) for each in found])
    return float(np.sqrt((deviations**2).mean())), float(abs(deviations).max())


def holding_force(chain: ImpactChain, frequency: float) -> float:
    """Return the amplitude of the force that holds the tip on the table for ever, over its own.

    In the steady motion of the stuck chain: of the force, over the amplitude of the table.
    """
    w = frequency
    dynamic = chain.stiffness + 1j * w * chain.damping_matrix - w * w * chain.mass
    others = np.linalg.solve(dynamic[:-1, :-1], -dynamic[:-1, -1])
    return float(abs(dynamic[-1, -1] + dynamic[-1, :-1] @ others))


def drive(modes: Modes, periods: int) -> float:
    """Return how much a table drives a contact with the force of half a period of the stuck mode.

    Modulus of the integral of sin s exp(i m k s) over s from 0 to pi, with k the bilinear frequency
    over that of the stuck mode; times m, as the table's velocity.
    """
    k = periods * bilinear(modes) / float(modes.stuck[0])
    if k == 1.0:
        return periods * 0.5 * np.pi
    return float(abs(periods * 2.0 * np.cos(0.5 * np.pi * k) / (1.0 - k * k)))


def mismatch(modes: Modes, periods: int) -> float:
    """Return how far a tip that comes back reversed is from the table, in amplitudes of the table.

    It left the table half a period of the first free mode before, where the table had the negative
    of the tip's position and velocity now: |1 + exp(i angle)|, with the angle of the table's turn.
    """
    angle = periods * bilinear(modes) * np.pi / float(modes.free[0])
    return float(2.0 * abs(np.cos(0.5 * angle)))
