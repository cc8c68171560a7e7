"""The continuum limit: rods against d'Alembert's closed form, and against the complete chain."""

from typing import Any

import numpy as np
import pytest

from dynkit.systems import ImpactChain, ImpactRod
from dynkit.systems.impact.simulation.trajectory import Ending

FREE = ImpactRod(masses=50, far_end="free", amplitude=0.0, frequency=1.0)
FIXED = ImpactRod(masses=60, amplitude=0.0, offset=-100.0, frequency=1.0, damping=0.002)


def order(sizes: Any, errors: Any) -> Any:
    return -np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def energy_norm(rod: Any, x: Any, v: Any) -> Any:
    return np.sqrt(v @ rod.mass @ v + x @ rod.stiffness @ x)


@pytest.fixture(scope="module")
def falls() -> Any:
    """Free rods that reach a stop at time 0.5 with velocity -1, up to their release."""
    rods = [FREE.replace(masses=masses) for masses in (50, 100, 200, 400)]
    return rods, [rod.simulate(impacts=20, start=rod.moving(0.5, -1.0)) for rod in rods]


def test_a_free_rod_stays_for_two_travel_times_and_leaves_as_it_came(falls: Any) -> None:
    rods, records = falls
    contact = [record.sticking[-1, 1] - record.time[0] for record in records]
    left = [rod.mass[-1] @ record.events.velocity[-1] for rod, record in zip(*falls, strict=True)]
    sizes = [rod.masses for rod in rods]
    # the force is zero at first, and rises: by rounding the end may hit the stop twice
    assert all(record.time.max() - 0.5 < 1e-9 for record in records)
    # the front of a chain's wave is an Airy function of width N^(-2/3)
    assert 0.55 < order(sizes, np.abs(np.subtract(contact, 2.0))) < 0.75
    assert 0.55 < order(sizes, np.abs(np.subtract(left, 1.0))) < 0.85
    assert abs(left[-1] - 1.0) < 0.01


@pytest.mark.parametrize("masses", [3, 5, 9, 10, 14, 16])
def test_a_free_rod_that_has_left_its_stop_never_returns(masses: int) -> None:
    rod = FREE.replace(masses=masses)
    assert rod.natural_frequencies[0] == 0.0
    assert rod.simulate(impacts=20, start=rod.moving(0.5, -1.0)).ending is Ending.NO_FURTHER_CONTACT


@pytest.mark.parametrize("time", [0.5, 1.5])
def test_states_of_a_bouncing_rod_tend_to_the_waves_of_dalembert(falls: Any, time: Any) -> None:
    rods, records = falls
    places, speeds = [], []
    for rod, record in zip(rods, records, strict=True):
        x, v = record.sample([0.5 + time])
        depth = 1.0 - rod.nodes
        # each point falls until the front comes, rests until the reflected front comes, then rises
        exact = -np.minimum(time, depth) + np.maximum(time - (2.0 - depth), 0.0)
        places.append(abs(rod.displacements(x[0]) - exact).max())
        exact = np.where(time < depth, -1.0, np.where(time > 2.0 - depth, 1.0, 0.0))
        speeds.append(np.sqrt(np.mean((rod.displacements(v[0]) - exact) ** 2)))
    sizes = [rod.masses for rod in rods]
    assert 0.55 < order(sizes, places) < 0.8
    assert 0.22 < order(sizes, speeds) < 0.42  # a jump over a width of N^(-2/3), in mean square


def test_a_rod_with_a_fixed_end_is_held_until_its_first_wave_returns() -> None:
    """Released with strain 1, the end meets a stop at x = 1/2 at time 1/2, with velocity -1.

    The front of strain 0 that left the end at time 0 comes back from the wall at time 2, with
    strain -1. Until then the contact force is that of strain 1, and then it would be -1.
    """
    sizes, errors = (50, 100, 200, 400), []
    for masses in sizes:
        rod = ImpactRod(masses=masses, amplitude=0.0, offset=0.5, frequency=1.0)
        record = rod.simulate(impacts=20, start=rod.moving(1.0, 0.0))
        ends = record.sticking[:, 1]  # ripples behind the front may lift the end at first
        errors.append([record.time[0] - 0.5, ends[ends < 2.5].max() - 2.0])
    met, released = abs(np.array(errors)).T
    assert met.max() < 0.001
    assert 0.55 < order(sizes, released) < 0.8


@pytest.mark.parametrize("rod", [FREE, FIXED], ids=["free", "fixed"])
def test_all_modes_are_the_chain_of_masses(rod: Any) -> None:
    n, h = rod.masses, rod.nodes[1] - rod.nodes[0]
    masses: Any = np.full(n, h)
    springs: Any = np.full(n, 1.0 / h)
    masses[-1] = h / 2.0
    if rod.far_end == "free":
        masses[0], springs[0] = h / 2.0, 0.0
    chain = ImpactChain(masses=masses, springs=springs, damping=rod.damping, frequency=1.0)
    assert rod.modes.frequencies == pytest.approx(chain.modes.frequencies, rel=1e-9, abs=1e-9)
    assert rod.modes.decay == pytest.approx(chain.modes.decay, rel=1e-9, abs=1e-9)
    tips = abs(rod.modes.matrix[-1]), abs(chain.modes.matrix[-1])
    assert tips[0] == pytest.approx(tips[1], rel=1e-8)
    u = np.random.default_rng(1).normal(size=n)
    q = rod.reduced(u)
    assert rod.displacements(q) == pytest.approx(u, abs=1e-12)
    assert q @ rod.mass @ q == pytest.approx(u @ (masses * u))
    assert q @ rod.stiffness @ q == pytest.approx(u @ chain.stiffness @ u)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("far_end", ["fixed", "free"])
def test_left_out_modes_change_flights_by_less_than_the_bound(
    seed: Any, damping: Any, far_end: Any
) -> None:
    rng = np.random.default_rng(seed)
    whole = ImpactRod(masses=60, damping=damping, far_end=far_end, amplitude=0.0, frequency=1.0)
    kept = int(rng.integers(3, 30))
    part = whole.replace(kept_modes=kept)
    x, v = rng.normal(size=(2, kept + 1)) / np.append(np.arange(1, kept + 1) ** 2, 1.0)
    # a stop that the kept motion reaches, and the whole one a little before or after
    x[-1], v[-1] = 1.0 + abs(x[-1]), -abs(v[-1]) - 10.0
    record = part.simulate(impacts=1, start=part.state(x, v))
    time = record.time[0]
    free = whole.replace(offset=-1e3)
    left = np.zeros(59 - kept)
    padded = [np.concatenate([y[:-1], left, y[-1:]]) for y in (x, v)]
    start = free.state(padded[0], padded[1])
    bound = part.truncation_errors(record)[0]
    before = part.replace(offset=-1e3)
    for t in np.linspace(0.1, 1.0, 7) * time:
        there, here = (
            rod.simulate(impacts=1, start=s).sample([t])
            for rod, s in ((free, start), (before, before.state(x, v)))
        )
        apart = [
            a[0] - np.concatenate([b[0, :-1], left, b[0, -1:]])
            for a, b in zip(there, here, strict=True)
        ]
        assert energy_norm(whole, *apart) <= bound


def test_an_impact_adds_the_kinetic_energy_of_the_left_out_modes() -> None:
    part = FREE.replace(kept_modes=7)
    records = [rod.simulate(impacts=1, start=rod.moving(0.5, -1.0)) for rod in (FREE, part)]
    (v,), (w,) = (record.events.velocity for record in records)
    v[:7] -= w[:7]
    bound = part.truncation_errors(records[1])
    assert abs(v[:7]).max() < 1e-12  # contact does not change the kept modes
    assert bound == pytest.approx([energy_norm(FREE, 0.0 * v, v)], rel=1e-9)
    assert FREE.truncation_errors(records[0]) == pytest.approx([0.0], abs=1e-12)


def test_left_out_modes_matter_less_the_more_are_kept() -> None:
    rod = ImpactRod(masses=10000, damping=0.05, frequency=2.0, kept_modes=20)
    found = []
    for kept in (20, 40, 80):
        more = rod.replace(kept_modes=kept)
        found.append(float(np.median(more.truncation_errors(more.simulate(impacts=40)))))
    assert found[0] > 1.7 * found[1] > 1.7**2 * found[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"masses": 1}, "masses must be at least 2; got 1"),
        ({"kept_modes": 100}, "kept_modes must be at most 99; got 100"),
        ({"far_end": "loose"}, "far_end must be 'fixed' or 'free'; got 'loose'"),
        ({"wave_speed": 0.0}, "wave_speed must"),
    ],
)
def test_bad_arguments_are_refused(arguments: Any, message: Any) -> None:
    with pytest.raises(ValueError, match=message):
        ImpactRod(frequency=1.0, **arguments)


def test_arrays_of_another_rod_are_refused() -> None:
    with pytest.raises(ValueError, match=r"coordinates must have shape \(..., 50\)"):
        FREE.displacements([1.0])
    with pytest.raises(ValueError, match="displacements"):
        FREE.reduced([1.0])
    with pytest.raises(ValueError, match="record must be one of this rod"):
        FREE.truncation_errors(FREE.replace(masses=51).simulate(impacts=1, start=None))


def test_a_rod_whose_energies_are_overridden_is_refused() -> None:
    with pytest.raises(TypeError, match="OnSprings must not override potential of ImpactRod"):

        class OnSprings(ImpactRod):
            def potential(self, x: Any) -> Any:  # type: ignore[misc]
                return super().potential(x) + x[0] ** 2
