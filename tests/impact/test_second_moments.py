"""Time averages in closed form, against quadrature of the sampled motion and many digits."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems import BouncingBall, ImpactChain
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from tests.benchmarks.extremes.cases import Case, read_cases

# The lowest natural frequency of three equal masses.
LOWEST = float(ImpactChain(masses=3, frequency=1.0).natural_frequencies[0])

MOTIONS: dict[str, ImpactOscillator] = {
    "periodic": ImpactChain(frequency=0.87),
    "chaotic": ImpactChain(frequency=0.35),
    "sticking": ImpactChain(frequency=0.408),
    "dead": ImpactChain(frequency=0.408, restitution=0.0),
    "lightly damped": ImpactChain(frequency=0.36, damping=1e-6),
    "undamped": ImpactChain(frequency=0.36, damping=0.0),
    "overdamped": ImpactChain(frequency=0.9, damping=8.0, amplitude=0.5),
    "critical": ImpactChain(masses=1, damping=2.0, frequency=0.4, offset=0.05, amplitude=1.0),
    "coupled": ImpactChain(
        masses=(1.0, 0.5, 2.0),
        springs=(1.0, 3.0, 0.7),
        damping=(0.1, 0.4, 0.2),
        restitution=0.6,
        frequency=0.5,
        offset=0.05,
    ),
    "resonant": ImpactChain(
        masses=3, damping=0.0, frequency=LOWEST, harmonic_forces=(0.1, 0.0, 0.0)
    ),
    "falling": BouncingBall(frequency=1.0, amplitude=2.0),
    "below": ImpactChain(masses=3, frequency=0.7, side="below"),
    "with play": ImpactChain(masses=3, frequency=0.7, play=1.0),
    "coarse chatter": ImpactChain(frequency=0.408, chatter_tolerance=1e-6),
}

# Modes that merge, forces at natural frequencies, heavy and no damping.
EDGES = [case for case in read_cases() if case.group in ("merging", "resonance")]

motions = pytest.mark.parametrize("motion", MOTIONS)


def simulated(motion: str, impacts: int = 60) -> ImpactRecord:
    return MOTIONS[motion].simulate(impacts=impacts)


def quadrature(record: ImpactRecord, low: float, high: float) -> Array:
    """Integrals of products of positions, the number one last, of the sampled motion.

    16 nodes of Gauss and Legendre on panels on which no product turns by more than 2 radians: an
    error below 2^32 (16!)^4 / (33 (32!)^3) = 1e-45, and below rounding for what is overdamped.
    """
    events = np.concatenate([[low, high], record.time, record.sticking.ravel()])
    events = np.unique(events[(events >= low) & (events <= high)])
    fastest = max(record.system.frequency, *abs(np.linalg.eigvals(dense(record.system))))
    panels = np.ceil(np.diff(events) * fastest).astype(int) + 1
    edges = np.concatenate(
        [
            np.linspace(a, b, k, endpoint=False)
            for a, b, k in zip(events[:-1], events[1:], panels, strict=True)
        ]
    )
    edges = np.append(edges, high)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    length = np.diff(edges)[:, None]
    times = np.clip(edges[:-1, None] + 0.5 * (nodes + 1.0) * length, low, high)
    x = record.sample(times.ravel())[0]
    x = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    return np.asarray((x * (0.5 * weights * length).ravel()[:, None]).T @ x)


def dense(system: ImpactMap) -> Array:
    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)
    return np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-inverse @ system.stiffness, -inverse @ system.damping_matrix],
        ]
    )


@motions
def test_products_are_those_of_quadrature(motion: str) -> None:
    record = simulated(motion)
    moments, end = record.second_moments(1), float(record.time[-1])
    n = record.system.degrees_of_freedom
    found = quadrature(record, 0.0, end) / end
    # times of impacts are rounded, and so are the samples of the quadrature
    rounding = 2.0**-52 * (64.0 + 4.0 * len(record)) * np.trace(found)
    assert abs(moments.products[0] / end - found[:n, :n]).max() <= moments.error + rounding


@pytest.mark.parametrize("case", EDGES, ids=lambda case: case.name)
def test_products_at_the_edges_are_those_of_quadrature(case: Case) -> None:
    system = case.system()
    record = system.simulate(impacts=12, start=case.begin(system))
    moments, end = record.second_moments(1), float(record.time[-1])
    n = system.degrees_of_freedom
    found = quadrature(record, 0.0, end) / end
    # rounding turns the modes of samples by the fastest rate times the longest flight
    turned = abs(np.linalg.eigvals(dense(system))).max() * end
    rounding = 2.0**-52 * (64.0 + 4.0 * len(record) + 4.0 * turned) * np.trace(found)
    assert abs(moments.products[0] / end - found[:n, :n]).max() <= moments.error + rounding


@motions
def test_sums_are_those_of_quadrature(motion: str) -> None:
    record = simulated(motion)
    moments, end = record.second_moments(1), float(record.time[-1])
    n = record.system.degrees_of_freedom
    found = quadrature(record, 0.0, end) / end
    rounding = 2.0**-52 * (64.0 + 4.0 * len(record)) * np.sqrt(np.trace(found))
    assert abs(moments.sums[0] / end - found[:n, n]).max() <= moments.mean_error + rounding


@motions
def test_batches_divide_the_whole(motion: str) -> None:
    record = simulated(motion)
    whole, parts = record.second_moments(1), record.second_moments(7)
    end = float(record.time[-1])
    assert abs(parts.products.sum(axis=0) - whole.products[0]).max() <= 2.0 * whole.error * end


@motions
def test_durations_of_batches_are_the_times_between_their_last_impacts(motion: str) -> None:
    record = simulated(motion)
    ends = record.time[np.arange(1, 6) * len(record) // 5 - 1]
    expected = np.diff(np.append(0.0, ends))
    # sums of rounded differences of times
    rounding = 2.0**-50 * len(record) * ends[-1]
    assert record.second_moments(5).durations == pytest.approx(expected, rel=0.0, abs=rounding)


def test_batches_may_be_given_by_their_edges() -> None:
    record = simulated("periodic", 50)
    alike, given = record.second_moments(5), record.second_moments([0, 10, 20, 30, 40, 50])
    assert given.products.tobytes() == alike.products.tobytes()
    parts = record.second_moments([0, 1, 37, 50])
    assert parts.durations == pytest.approx(np.diff([0.0, *record.time[[0, 36, 49]]]))
    for edges in ([], [0, 49], [1, 50], [0, 20, 20, 50], [0, 1.5, 50]):
        with pytest.raises(ValueError, match="batches"):
            record.second_moments(edges)  # type: ignore[arg-type]


@motions
def test_error_is_small_beside_the_products(motion: str) -> None:
    moments = simulated(motion).second_moments(1)
    # as README says of states; the coarse chatter changes positions by up to 1e-6
    limit = 1e-5 if motion == "coarse chatter" else 1e-11
    assert moments.error < limit * moments.products.max() / moments.durations[0]


@pytest.mark.plain
def test_one_mass_agrees_with_many_digits() -> None:
    chain = ImpactChain(masses=1, frequency=0.4, offset=0.05)
    start = chain.attractor().final
    record = chain.simulate(impacts=12, start=start)
    began = np.append(0.0, record.time)
    x = np.append(start.position, record.position)
    v = np.append(start.velocity, record.velocity)
    total = mpmath.mpf(0)
    with mpmath.workdps(30):
        sigma = mpmath.mpf(chain.damping) / 2
        turning = mpmath.sqrt(1 - sigma**2)
        for i, length in enumerate(map(mpmath.mpf, np.diff(began).tolist())):
            a = mpmath.mpf(x[i])
            b = (mpmath.mpf(v[i]) + sigma * a) / turning

            def square(s: Any, a: Any = a, b: Any = b) -> Any:
                wave = a * mpmath.cos(turning * s) + b * mpmath.sin(turning * s)
                return (mpmath.exp(-sigma * s) * wave) ** 2

            total += mpmath.quad(square, mpmath.linspace(0, length, 5))
        moments = record.second_moments(1)
        assert abs(moments.products[0, 0, 0] - total) <= moments.error * began[-1]


@pytest.mark.plain
def test_closed_forms_need_no_nodes() -> None:
    assert simulated("sticking").second_moments().cost.counts["nodes"] == 0


def test_no_more_batches_than_impacts() -> None:
    assert len(simulated("periodic", 5).second_moments().durations) == 5


def test_record_without_impact_is_refused() -> None:
    chain = ImpactChain(frequency=0.87, offset=-10.0)
    with pytest.raises(ValueError, match="record must hold an impact after its start; got <Imp"):
        chain.simulate(impacts=1).second_moments()


def test_no_batch_is_refused() -> None:
    with pytest.raises(ValueError, match="batches must be a positive integer; got 0"):
        simulated("periodic", 5).second_moments(0)
