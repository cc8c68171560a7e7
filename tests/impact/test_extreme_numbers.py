"""Numbers so unlike each other that rounding decides: what is found, and what is claimed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import Propagators
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.reference.general_oscillator import GeneralOscillator


@pytest.mark.parametrize("spring", [1e-10, 1e-13, 1e-14])
@pytest.mark.parametrize("masses", [1, 2, 3])
@pytest.mark.parametrize("dashpots", [False, True])
def test_a_rest_that_is_far_away_is_counted_among_the_errors(
    spring: float, masses: int, dashpots: bool
) -> None:
    # Under weights, the rest 4e9 to 4e13 times as far away as the motion is large.
    k = np.diag([spring, *[1.3] * (masses - 1)]) + np.diag([*[1.3] * (masses - 1), 0.0])
    k -= 1.3 * (np.eye(masses, k=1) + np.eye(masses, k=-1))
    c = np.diag(0.013 * np.arange(1.0, masses + 1)) if dashpots else 0.1 * k
    weights = [-0.37 + 0.1 * i for i in range(masses)]
    system = MatrixOscillator(
        M=1.7 * np.eye(masses), C=c, K=k, frequency=1.1, restitution=0.5, amplitude=0.3, offset=0.1,
        constant_forces=weights,
    )  # fmt: skip
    place, speed = [0.7 + 0.1 * i for i in range(masses)], [0.1] * masses
    record = system.simulate(impacts=6, start=system.state(place, speed, 0.3))
    exact = GeneralOscillator(
        system.mass.tolist(),
        system.damping_matrix.tolist(),
        system.stiffness.tolist(),
        frequency=1.1,
        restitution=0.5,
        amplitude=0.3,
        offset=0.1,
        constant_forces=weights,
    ).simulate(place, speed, 0.3, 6)
    assert len(record) == len(exact.impacts) == 6
    for i, impact in enumerate(exact.impacts):
        found = [*record.position[i], *record.velocity[i], record.relative_velocity[i]]
        truth = [*impact.position, *impact.velocity, impact.relative_velocity]
        off = max(abs(float(y - x)) for x, y in zip(found, truth, strict=True))
        assert off <= record.error[i]
        late = abs(float(record.time[i] - impact.time))
        assert late <= record.error[i] / system.frequency + math.ulp(record.time[i])
        # Rounding of the rest, over the approach: not the width of the band.
        assert i or late < 100.0 * 2.0**-52 / spring


@pytest.mark.parametrize(
    "system",
    [
        BouncingBall(frequency=2.0, amplitude=0.25, restitution=0.0),
        BouncingBall(frequency=0.5, amplitude=4.0, restitution=0.3),
        SingleImpactOscillator(frequency=0.8, stop=-1.0, force=1.0, restitution=0.3),
        ImpactChain(
            masses=2, frequency=1.5, springs=(1.0, 0.0), damping=0.3, amplitude=0.0,
            harmonic_forces=(1.0, 0.5), constant_forces=(0.0, -0.5),
        ),
    ],
    ids=["ball", "slow ball", "below a stop", "beside a chain"],
)  # fmt: skip
def test_a_force_that_only_just_vanishes_holds_for_ever(system: ImpactOscillator) -> None:
    # At one phase of each period the table need not press, and need not pull.
    record = system.simulate(impacts=3000)
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert record.cost.counts["cells"] < 20_000


@pytest.mark.parametrize("factor", [1.0 - 1e-9, 1.0 + 1e-9])
def test_a_little_less_or_more_tells_whether_it_holds(factor: float) -> None:
    ball = BouncingBall(frequency=2.0, amplitude=0.25 * factor, restitution=0.0)
    record = ball.simulate(impacts=50)
    assert (record.ending is Ending.CONTACT_FOR_EVER) == (factor < 1.0)


@pytest.mark.parametrize("size", [1.0, 1e-100, 1e-160, 1e-190])
def test_a_swing_whose_square_underflows_is_a_swing(size: float) -> None:
    def simulated(size: float) -> tuple[Ending, list[float]]:
        system = MatrixOscillator(
            M=np.eye(2), C=[[0.9, 0.1], [0.1, 0.3]], K=[[1e12, -1.0], [-1.0, 3.0]],
            frequency=1.3, amplitude=size, offset=-0.9 * size, restitution=0.5,
        )  # fmt: skip
        record = system.simulate(impacts=6, start=system.state([0.0, 0.0], [0.0, 0.0]))
        return record.ending, (record.relative_velocity / size).tolist()

    ending, speeds = simulated(size)
    assert ending is Ending.COUNT_REACHED
    assert speeds == pytest.approx(simulated(1.0)[1], rel=1e-12)


def test_norms_of_clusters_do_not_underflow() -> None:
    oscillator, _ = Pairs.oscillators(*np.array([[1.0], [0.0], [0.1], [0.0]]))
    joined = Pairs.join(oscillator, oscillator, Pairs.rotation(0.7))
    pairs = Pairs(joined.generator, joined.generator_low, joined.scale, cluster=np.array([0, 0, 2]))
    row = np.array([[3e-180, 4e-180, 5e-200], [0.0, 0.0, 0.0]])
    assert pairs.bound(row, 0)[0] == pytest.approx([5e-180, 5e-180, 5e-200], rel=1e-15, abs=0.0)


def test_a_million_of_the_longest_steps_are_not_taken_one_by_one() -> None:
    # Of a body that nothing holds, and that takes 1e100 to come from one stop to the other.
    pairs = Pairs.oscillators(*np.zeros((4, 1)))[0]
    steps = Propagators.of(pairs)
    assert steps.rungs < 60
    searched = 1e6 * 2.0 ** (steps.rungs - 1)
    assert searched < 4.0 * 2.0 ** len(steps.step)


@pytest.mark.parametrize("mass", [1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize("masses", [2, 3])
def test_a_mass_that_weighs_next_to_nothing_costs_few_cells(mass: float, masses: int) -> None:
    # Its time constant of 10 mass does not set the cells once its exponential has died out, not
    # even where the gap has hardly opened.
    chain = ImpactChain(
        masses=(mass, *[1.0] * (masses - 1)), damping=0.05, frequency=0.87, restitution=0.0,
        amplitude=0.25,
    )  # fmt: skip
    place = 0.3 * np.arange(1.0, masses + 1)
    speed = np.append(np.zeros(masses - 1), -1.0)
    record = chain.simulate(impacts=6, start=chain.state(place, speed, 0.3))
    assert record.ending is Ending.COUNT_REACHED
    assert len(record.sticking) > 1
    assert record.cost.counts["cells"] < 1000
