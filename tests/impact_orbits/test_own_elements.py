"""Orbits of machines with an element of one's own: a stop that is harder beyond a depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynkit import continue_orbit, periodic_orbit
from dynkit.analysis import TimeSeries
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import Element, ImpactChain, Regime, Watch
from dynkit.testing import check_element
from tests.impact_orbits.bent_cases import WIDE


@dataclass(frozen=True, kw_only=True)
class TwoZoneStop(Element):
    """A stop of one stiffness down to a depth, and of another one beyond."""

    soft: float
    hard: float
    depth: float

    @property
    def regimes(self) -> tuple[Regime, ...]:
        touched = Watch(to=1, gap=1.0, order=1)
        left = Watch(to=0, gap=-1.0, order=1)
        deeper = Watch(to=2, gap=1.0, level=self.depth, order=1)
        back = Watch(to=1, gap=-1.0, level=-self.depth)
        more = (self.soft - self.hard) * self.depth
        return (
            Regime((touched,)),
            Regime((left, deeper), stiffness=self.soft),
            Regime((back,), push=more, stiffness=self.hard),
        )


def _machine(**numbers: float) -> Any:
    pad = TwoZoneStop(0, offset=-0.2, soft=5.0, hard=60.0, depth=0.1, name="pad")
    chain = ImpactChain(
        masses=2, damping=0.05, frequency=0.7, harmonic_forces=[0.6, 0.0], elements=[pad]
    )
    return chain.replace(**numbers)


def test_the_element_keeps_the_contract() -> None:
    machine = _machine()
    check_element(machine.elements[0], machine)


def test_an_orbit_that_enters_both_zones_has_the_multipliers_of_the_map() -> None:
    machine = _machine()
    orbit = machine.attractor().periodic_orbit()
    section = machine.attractor().states[-1]
    of_map = periodic_orbit(machine, section)
    off = machine.difference(np.asarray(orbit.states)[0], of_map.states[0])
    assert abs(off).max() <= orbit.error + of_map.error < 1e-11
    assert abs(orbit.multipliers - of_map.multipliers).max() < 1e-11


def test_a_branch_grazes_where_the_stop_is_only_just_left_between_two_dips() -> None:
    orbit = _machine().attractor().periodic_orbit()
    branch = continue_orbit(orbit, "pad.depth", bounds=(0.05, 0.3), **WIDE)
    (grazing,) = [b for b in branch.bifurcations if b.kind is BifurcationKind.GR]
    section, machine = grazing.orbit.states[0], _machine(**{"pad.depth": float(grazing.value)})
    start = machine.state(section[:2], section[2:])
    attractor = machine.attractor(start=start, transient=0, keep=2)
    assert abs(attractor.states[-1] - section).max() < 1e-12
    times = np.linspace(0.0, 2.0 * np.pi / 0.7, 40_001)
    gap = TimeSeries(attractor, times, coordinate=0).values + 0.2
    inside = gap[1:-1]
    highest = inside[(inside > gap[:-2]) & (inside > gap[2:])]
    assert abs(highest).min() < 1e-7
