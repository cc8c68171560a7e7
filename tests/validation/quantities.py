"""The claims that are looked at, and how many of the cases the tests take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

from tests.validation import (
    averages,
    borders,
    branches,
    curves,
    cycles,
    derivatives,
    dimensions,
    flows,
    itineraries,
    machines,
    maps,
    multipliers,
    nonlinear,
    orbits,
    records,
    sums,
)

Pairs = Callable[[int], Iterator[tuple[float, float]]]


class Quantity(NamedTuple):
    """Pairs of true and claimed errors of every so manieth case; the tests take every `tested`.

    Where few cases have anything that is claimed, the tests take a `sample` of those that do.
    """

    pairs: Pairs
    tested: int
    sample: Pairs | None = None

    def tested_pairs(self) -> Iterator[tuple[float, float]]:
        """Those of the tests."""
        return (self.sample or self.pairs)(self.tested)


MAPS = 130
"""Every so manieth random map, one truth for all claims of it; and the oscillators beside them."""

MACHINES = 400
"""Every so manieth random machine."""

NONLINEAR = 80
"""Every so manieth of those whose springs are not linear."""

QUANTITIES = {
    "`ImpactRecord.error`, states": Quantity(records.states_of_records, 24),
    "`ImpactRecord.error`, times": Quantity(records.times_of_records, 24),
    "`ImpactRecord.error`, states of machines": Quantity(machines.states_of_machines, MACHINES),
    "`ImpactRecord.error`, times of machines": Quantity(machines.times_of_machines, MACHINES),
    "`ImpactRecord.error`, states, springs not linear": Quantity(
        nonlinear.states_of_machines, NONLINEAR
    ),
    "`ImpactRecord.error`, times, springs not linear": Quantity(
        nonlinear.times_of_machines, NONLINEAR
    ),
    "`ImpactAttractor.error`": Quantity(records.states_of_attractors, 24),
    "`MapAttractor.error`": Quantity(maps.states_of_attractors, 20),
    "`MapOrbit.error`": Quantity(maps.states_of_orbits, 18),
    "`PoincareMap.accuracy`": Quantity(flows.states_of_returns, 61),
    "`PoincareMap.accuracy`, `SymbolicFlow`": Quantity(flows.states_of_returns_of_symbols, 61),
    "`IntegratedFlow.advance_error`": Quantity(flows.states_of_times, 61),
    "`SymbolicFlow.advance_error`": Quantity(flows.states_of_times_of_symbols, 61),
    "differences of maps": Quantity(derivatives.of_maps, 61),
    "differences of velocities": Quantity(derivatives.of_velocities, 101),
    "differences of states of flows": Quantity(derivatives.of_states, 61),
    "`ExponentialSum.first_root`, times": Quantity(sums.times_of_roots, 60),
    "`ImpactOrbit.error`, P(1,m)": Quantity(orbits.states_of_orbits, 50),
    "`ImpactOrbit.error`, P(2,m), P(3,m)": Quantity(orbits.states_of_longer_orbits, 28),
    "`ImpactOrbit.error`, machines": Quantity(
        itineraries.states_of_machines,
        1,
        partial(itineraries.states_of_machines, numbers=itineraries.SETTLED),
    ),
    "`multipliers_error`, maps": Quantity(multipliers.of_maps, 180),
    "`multipliers_error`, maps without jacobian": Quantity(
        multipliers.of_maps_without_jacobian, 180
    ),
    "`multipliers_error`, P(1,m)": Quantity(multipliers.of_oscillators, 360),
    "`multipliers_error`, P(inf,m)": Quantity(multipliers.of_sticking_orbits, 110),
    "`multipliers_error`, van der Pol": Quantity(
        cycles.of_van_der_pol, 1, partial(cycles.of_van_der_pol, tolerances=(1e-7, 1e-8))
    ),
    "`multipliers_error`, cycles": Quantity(cycles.of_bent_cycles, 53),
    "`multipliers_error`, branches": Quantity(multipliers.of_branches, 25),
    "`ImpactOrbit.error`, P(inf,m)": Quantity(orbits.states_of_sticking_orbits, 90),
    "`MapOrbit.error`, machines": Quantity(
        partial(itineraries.states_of_machines, sliding=True),
        1,
        partial(itineraries.states_of_machines, numbers=itineraries.SLIDING, sliding=True),
    ),
    "`Harmonics.error`": Quantity(orbits.coefficients_of_harmonics, 50),
    "`POD.error`, exact": Quantity(averages.powers, 60),
    "`Branch.error`": Quantity(
        branches.points_of_branches,
        20,
        partial(branches.points_of_branches, numbers=(0,), points=400),
    ),
    "`Bifurcation.error`, SN, PD, NS": Quantity(branches.bifurcations_of_maps, 60),
    "`Bifurcation.error`, SN, GR": Quantity(branches.bifurcations_of_oscillators, 55),
    "`Bifurcation.error`, CB": Quantity(branches.borders_of_contact, 45),
    "`Bifurcation.error`, CB of P(inf,m)": Quantity(
        borders.borders_of_sticking_orbits, 1, borders.borders_nearby
    ),
    "`Bifurcation.error`, maps": Quantity(curves.values_of_maps, MAPS),
    "`Bifurcation.error`, maps without jacobian": Quantity(
        curves.values_without_jacobian,
        100,
        partial(curves.values_without_jacobian, numbers=curves.WITHOUT_JACOBIAN),
    ),
    "`Bifurcation.error`, P(n,m)": Quantity(
        curves.values_of_oscillators,
        MAPS,
        partial(curves.values_of_oscillators, numbers=curves.BIFURCATING),
    ),
    "`Bifurcation.unknowns_error`": Quantity(
        curves.unknowns, MAPS, partial(curves.unknowns, numbers=curves.BIFURCATING)
    ),
    "`Bifurcation.own_error`": Quantity(
        curves.angles, MAPS, partial(curves.angles, numbers=curves.BIFURCATING)
    ),
    "`BifurcationCurve.error`, maps": Quantity(curves.points_of_maps, 129),
    "`BifurcationCurve.error`, P(n,m)": Quantity(
        curves.points_of_oscillators,
        MAPS,
        partial(curves.points_of_oscillators, numbers=curves.BIFURCATING[::3]),
    ),
}

STATISTICS = {
    f"`CorrelationDimension.error`, {name}": partial(dimensions.coverage, name)
    for name in dimensions.DRIFTING | dimensions.WITH_PLATEAU
}
"""The standard errors that are looked at: their coverage in so many runs."""
