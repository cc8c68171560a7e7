"""How often runs of stationary chaos are said to change their regime, of systems of many kinds.

Long memory is the hard case: laminar phases of intermittent chaos (the logistic map just below its
window of period 3, one mass at 2.79, ten masses at 1.346), halves of an attractor between which a
motion seldom moves (the cubic map above the crisis at 2.598).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

from dynkit.analysis.regimes import regime_change
from dynkit.core.validation import Array
from dynkit.systems import ImpactChain, SingleImpactOscillator
from tests.analysis import test_averages as averages

LENGTH = 500
"""Values of a run: so short that laminar phases are a part of it, see `_SHORTEST` of the test."""

CLAIM, FAILURE = 0.005, 1e-6
"""Claimed chance of a false alarm; chance that a right claim fails the test, on any processor."""

_PIECE = 100_000


class FalseAlarms(NamedTuple):
    """Runs, those that are said to change, and how many may be: with the claim more are rare.

    Of 20,000 runs 151 may be said to change. With twice the chance that is claimed 200 are, and all
    but one campaign in 5,000 exceed 151.
    """

    runs: int
    alarms: int

    @property
    def most(self) -> int:
        return int(binom.isf(FAILURE, self.runs, CLAIM))

    def __str__(self) -> str:
        return f"{self.runs} | {self.alarms} | {self.most}"


def false_alarms(name: str, runs: int) -> FalseAlarms:
    """Of so many runs, or a few more: each column of a system is as long as others."""
    columns = SYSTEMS[name](-(-runs // averages.RUNS) * LENGTH)
    cut = columns.reshape(-1, LENGTH, columns.shape[1]).transpose(0, 2, 1).reshape(-1, LENGTH, 1)
    return FalseAlarms(len(cut), sum(regime_change(run) is not None for run in cut))


def iterated(step: Callable[[Array], Array], seen: Callable[[Array], Array], n: int) -> Array:
    """What is seen (n, runs) of iterates of a map of the line, after 3000 others."""
    x, values = np.random.default_rng(0).uniform(0.2, 0.8, averages.RUNS), []
    for _ in range(n + 3000):
        x = step(x)
        values.append(seen(x))
    return np.array(values[3000:])


def ikeda(n: int) -> Array:
    """Real part (n, runs) of the Ikeda map."""
    z, values = np.random.default_rng(0).uniform(-0.1, 0.1, averages.RUNS) + 0.0j, []
    for _ in range(n + 300):
        z = 1.0 + 0.9 * z * np.exp(1j * (0.4 - 6.0 / (1.0 + abs(z) ** 2)))
        values.append(z.real)
    return np.array(values[300:])


def growth(system: ImpactChain | SingleImpactOscillator, n: int) -> Array:
    """Log growth (n, runs), parts of one motion, along the direction that grows fastest."""
    state, total, logs = system.attractor(transient=5000).states[-1], n * averages.RUNS, []
    for first in range(0, total, _PIECE):
        found = system.stretching(state, min(_PIECE, total - first))
        state = found.state
        logs.append(found.logs[:, 0].copy())
    return np.concatenate(logs).reshape(averages.RUNS, n).T


SYSTEMS: dict[str, Callable[[int], Array]] = {
    "Henon map": averages.henon,
    "logistic map at 4": averages.logistic,
    "Lorenz flow": averages.lorenz,
    "Ikeda map": ikeda,
    "tent map at 1.9": partial(iterated, lambda x: 1.9 * np.minimum(x, 1.0 - x), np.copy),
    "logistic map at 3.8282": partial(
        iterated, lambda x: 3.8282 * x * (1.0 - x), lambda x: np.log(abs(1.0 - 2.0 * x))
    ),
    "cubic map at 2.62": partial(iterated, lambda x: 2.62 * x - x**3, np.copy),
    "one mass at 2.79": partial(growth, SingleImpactOscillator(frequency=2.79)),
    "one mass at 2.8": partial(growth, SingleImpactOscillator(frequency=2.8)),
    "ten masses at 1.346": partial(growth, ImpactChain(frequency=1.346)),
}
