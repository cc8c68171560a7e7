"""Measures, orbits, branches and sweeps of any oscillator: each said in two ways."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, assume, given, settings, strategies as st

from dynkit import NoConvergence, Sweep, continue_orbit, sweep
from dynkit.core.no_motion import NoMotion
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from tests.effort import share
from tests.impact.any_oscillator import Begin, begins, certain

TURNING = begins(
    largest=4,
    play=False,
    restitution=st.floats(0.3, 0.9),
    amplitude=0.3,
    chatter_tolerance=1e-16,
)


@share(0.2)
@given(begins(largest=5))
def test_second_moments_are_those_of_dense_samples(begin: Begin) -> None:
    # Gauss's rule on parts of the flights; none that sticks, whose bounces are endless.
    record = begin.simulate(5)
    certain(record)
    assume(not len(record.sticking))
    assume(record.time[-1] < 200.0)
    system = begin.system
    rates = np.linalg.eigvals(np.linalg.solve(system.mass, system.damping_matrix))
    rate = float(system.natural_frequencies[-1] + abs(rates).max() + system.frequency)
    node, weight = np.polynomial.legendre.leggauss(16)
    total = np.zeros((system.degrees_of_freedom,) * 2)
    for low, high in zip(np.append(0.0, record.time), record.time, strict=False):
        edges = np.linspace(low, high, math.ceil((high - low) * rate) + 2)
        half = 0.5 * np.diff(edges)[:, None]
        x, _ = record.sample((edges[:-1, None] + half * (1.0 + node)).ravel())
        total += x.T @ ((half * weight).ravel()[:, None] * x)
    moments = record.second_moments()
    found = moments.products.sum(axis=0)
    scale = float(abs(total).max()) + float(record.time[-1])
    assert abs(found - total).max() <= 1e-11 * scale + moments.error * record.time[-1]


@share(0.2)
@given(begins(largest=5, play=False))
def test_stretching_shrinks_volumes_by_restitution_and_dashpots(begin: Begin) -> None:
    # The sum of all exponents is the mean of log |det|.
    record = begin.simulate(3)
    certain(record)
    system = begin.system
    assume(len(record) == 3)
    assume(system.restitution > 0.05)
    assume(record.relative_velocity.min() > 1e-3)
    try:
        found = system.stretching(record.states[-1], 4)
    except NoMotion:  # it ends
        assume(False)
    assume(np.isfinite(found.logs).all())
    assert found.times is not None
    trace = float(np.trace(np.linalg.solve(system.mass, system.damping_matrix)))
    expected = 2.0 * math.log(system.restitution) - trace * found.times
    assert abs(found.logs.sum(axis=1) - expected).max() <= 1e-6 * (1.0 + abs(expected).max())


def orbit_of(begin: Begin) -> ImpactOrbit:
    """The periodic orbit that a motion settles on."""
    attractor = begin.system.attractor(transient=400, impacts=30, start=begin.state)
    assume(len(attractor.record) == 30)
    n = attractor.label.iterates
    assume(n is not None)
    assert n is not None
    assume(n <= 4)
    try:
        orbit = attractor.periodic_orbit()
    except NoConvergence:  # it has not settled yet
        assume(False)
    assume(isinstance(orbit, ImpactOrbit))
    assert isinstance(orbit, ImpactOrbit)
    assume(orbit.relative_velocity.min() > 1e-3)
    return orbit


@settings(share(0.1), suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
@given(TURNING)
def test_multipliers_do_not_depend_on_where_an_orbit_begins(begin: Begin) -> None:
    orbit, system = orbit_of(begin), begin.system
    steps = [system.jacobian(state) for state in orbit.states]
    condition = math.prod(1.0 + float(abs(step).max()) for step in steps)
    assume(condition < 1e4)
    for first in range(len(steps)):
        product = np.eye(system.dimension)
        for step in steps[first:] + steps[:first]:
            product = step @ product
        found = np.poly(np.linalg.eigvals(product))
        expected = np.poly(orbit.multipliers)
        assert abs(found - expected).max() <= 1e-10 * condition * (1.0 + abs(expected).max())


@share(0.2)
@given(
    st.floats(2.0, 2.6),
    st.floats(0.02, 0.2),
    st.floats(0.6, 0.9),
    st.floats(0.0, 0.2),
    st.sampled_from([0.97, 1.03]),
)
def test_a_branch_that_is_followed_back_ends_where_it_began(
    frequency: float, damping: float, restitution: float, stop: float, ratio: float
) -> None:
    system = SingleImpactOscillator(
        frequency=frequency, damping_ratio=damping, restitution=restitution, stop=stop
    )
    orbits = system.periodic_orbits()
    assume(orbits)
    orbit, end = orbits[0], ratio * frequency
    bounds = (min(frequency, end), max(frequency, end))
    there = continue_orbit(orbit, "frequency", bounds=bounds)
    places = np.flatnonzero(there.parameter == end).tolist()
    assume(len(places) == 1)  # and no fold before
    back = continue_orbit(there.orbit(places[0]), "frequency", bounds=bounds)
    (home,) = np.flatnonzero(back.parameter == frequency).tolist()
    off = system.difference(back.orbit(home).states, orbit.states)
    assert abs(off).max() <= 1e-10 * (1.0 + abs(orbit.states).max())
    kinds = sorted((found.kind, round(found.value, 6)) for found in there.bifurcations)
    assert sorted((found.kind, round(found.value, 6)) for found in back.bifurcations) == kinds


@share(0.1)
@given(begins(largest=3), st.lists(st.floats(0.3, 3.0), min_size=1, max_size=4, unique=True))
def test_a_sweep_is_the_attractors_one_by_one(begin: Begin, values: list[float]) -> None:
    start = begin.changed(frequency=values[0]).state
    found = sweep(
        begin.system,
        "frequency",
        values,
        transient=5,
        keep=8,
        start=start,
        follow=False,
        progress=False,
    )
    for i, value in enumerate(values):
        system = begin.system.replace(frequency=value)
        single = system.attractor(transient=5, impacts=8, start=start)
        row = found.observable("relative_velocity")[i]
        kept = single.record.relative_velocity
        assert row[: len(kept)].tobytes() == kept.tobytes()
        assert np.isnan(row[len(kept) :]).all()


@share(0.1)
@given(begins(largest=3), st.lists(st.floats(0.3, 3.0), min_size=1, max_size=3, unique=True))
def test_what_is_stored_of_a_sweep_comes_back_bit_for_bit(
    begin: Begin, values: list[float]
) -> None:
    choices = {"transient": 5, "keep": 8, "start": begin.state, "progress": False}
    names = ("relative_velocity", "phase", "energy", "time")
    plain = sweep(begin.system, "frequency", values, observables=names, **choices)  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.h5"
        sweep(begin.system, "frequency", values, observables=names, store=path, **choices)  # type: ignore[arg-type]
        loaded = Sweep.load(path, begin.system)
    assert loaded.values.tobytes() == plain.values.tobytes()
    assert loaded.endings == plain.endings
    for name in names:
        assert loaded.observable(name).tobytes() == plain.observable(name).tobytes()
