"""Labels beside bifurcations, where motions pass slowly, settle slowly, and multipliers change."""

import math
from typing import Any

import numpy as np
import pytest
import sympy

from dynkit import periodic_orbit
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.systems import Logistic, SymbolicMap

DISTANCES = 10.0 ** np.linspace(-9.5, -4.0, 23)
"""Of the parameter from the bifurcation."""


def label_at(rate: float, transient: int = 1000, keep: int = 100) -> OrbitLabel:
    motion = Logistic(rate=rate).attractor(start=[0.3], transient=transient, keep=keep)
    return motion.label


@pytest.mark.parametrize("keep", [100, 200])
@pytest.mark.parametrize(
    ("fold", "period"),
    [
        (1.0 + math.sqrt(8.0), 3),  # in closed form; the others are folds of branches
        (3.960101882689952, 4),
        (3.7381723752659624, 5),
        (3.990257307413384, 5),
        (3.9777604409369727, 6),
    ],
)
def test_motions_that_pass_where_an_orbit_was_do_not_get_its_period(
    fold: float, period: int, keep: int
) -> None:
    """Below the fold the motion is chaotic, with laminar phases as long as distance^-1/2."""
    labels = [label_at(fold - distance, keep=keep) for distance in DISTANCES]
    assert not [label for label in labels if label.iterates == period]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("transient", [100, 300, 1000])
def test_multipliers_beside_period_doublings_are_within_their_errors(
    sign: float, transient: int
) -> None:
    """P(1) has the multiplier 2 - rate, P(2) the multiplier 4 + 2 rate - rate^2."""
    found = 0
    for distance in 10.0 ** np.linspace(-4.0, -1.5, 23):
        for place in (3.0, 1.0 + math.sqrt(6.0)):
            rate = place + sign * float(distance)
            label = label_at(rate, transient)
            exact = {1: 2.0 - rate, 2: 4.0 + 2.0 * rate - rate**2}
            if label.iterates not in exact:  # P(4), or not settled
                assert label.kind is OrbitKind.UNSETTLED or rate > 3.4
                continue
            assert label.iterates == 1 + (rate > 3.0)
            assert label.multiplier is not None
            multiplier = abs(exact[label.iterates])
            assert abs(label.multiplier - multiplier) <= label.multiplier_error
            assert label.stable in (None, True)
            found += 1
    assert found >= 10


@pytest.mark.parametrize("period", [3, 5])
def test_multipliers_beside_folds_are_within_their_errors(period: int) -> None:
    fold = {3: 1.0 + math.sqrt(8.0), 5: 3.7381723752659624}[period]
    found = 0
    for distance in DISTANCES[DISTANCES > 1e-7]:
        system = Logistic(rate=fold + float(distance))
        orbit = periodic_orbit(
            system, system.attractor(start=[0.3], transient=300_000).final, period=period
        )
        label = label_at(system.rate)
        if label.iterates == period:
            assert label.multiplier is not None
            gap = abs(label.multiplier - abs(orbit.multipliers[0]))
            assert gap <= label.multiplier_error + orbit.multipliers_error[0]
            assert label.stable in (None, True)
            found += 1
    assert found >= 8


class Turning(SymbolicMap):
    """A circle of radius sqrt(mu), on which states turn by angle + twist mu, in skewed axes."""

    mu: float = 0.01
    angle: float = 1.0
    twist: float = 0.3

    def next_state(self, u: Any, v: Any) -> tuple[Any, Any]:
        x, y = u + v / 3, v - u / 5
        square = x**2 + y**2
        turn, growth = self.angle + self.twist * square, 1 + self.mu - square
        next_x = growth * (sympy.cos(turn) * x - sympy.sin(turn) * y)
        next_y = growth * (sympy.sin(turn) * x + sympy.cos(turn) * y)
        return (next_x - next_y / 3) * 15 / 16, (next_y + next_x / 5) * 15 / 16


NEAR_RESONANCES = [
    (0.00028496234706, 2.40800078005897, -0.72539907784849),
    (0.00039552069262, 1.21555759291700, -0.49685108277990),
    (0.00033596394411, 2.82428964862828, -0.41816529627597),
    (0.00014770835397, 2.06695572165368, -0.78067239231520),
    (0.00040198350018, 1.50306646585160, 0.67381630161622),
]
"""Where labels were P(274), P(274), P(287), P(76) and P(163)."""


@pytest.mark.parametrize("transient", [0, 300, 1000])
def test_tori_near_a_resonance_do_not_get_its_period(transient: int) -> None:
    random = np.random.default_rng(transient)
    cases = NEAR_RESONANCES + [
        (10.0 ** random.uniform(-5.0, -1.0), random.uniform(0.3, 2.9), random.uniform(-1.0, 1.0))
        for _ in range(20)
    ]
    for mu, angle, twist in cases:
        system = Turning(mu=mu, angle=angle, twist=twist)
        label = system.attractor(start=[0.3, 0.1], transient=transient, keep=100).label
        assert label.kind in (OrbitKind.QUASI_PERIODIC, OrbitKind.UNSETTLED)
        if label.kind is OrbitKind.QUASI_PERIODIC and label.curves == 1:
            turns = (angle + twist * mu) / (2.0 * math.pi)
            assert abs(label.rotation_number - min(turns, 1.0 - turns)) <= label.rotation_error
