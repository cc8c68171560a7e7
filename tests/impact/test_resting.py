"""Rest on a soft stop with a preload: by a force between zero and the preload."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpmath import mp

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop
from tests.reference.soft_stops import DIGITS, SoftStopReference


def pad(load: float = 0.0, side: str = "above", **numbers: Any) -> MatrixOscillator:
    """A unit mass under a unit weight on a pad with a preload of three weights, and a load."""
    sign = 1.0 if side == "above" else -1.0
    own: dict[str, Any] = {"stiffness": 0.0, "preload": 3.0, "name": "pad"} | numbers
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=2.0 * np.pi / 3.0,
        constant_forces=[-sign],
        harmonic_forces=[-sign * load],
        elements=[
            SoftStop(0, side=side, **own),
        ],
    )


@pytest.mark.parametrize("load", [0.0, 0.9, -0.9])
@pytest.mark.parametrize("numbers", [{}, {"stiffness": 2.0}, {"stiffness": 2.0, "damping": 0.3}])
def test_a_load_less_than_the_preload_moves_nothing(load: float, numbers: dict[str, Any]) -> None:
    machine = pad(load, **numbers)
    record = machine.simulate(impacts=5, start=machine.state([0.0], [0.0]))
    times = np.linspace(0.0, record.time[-1], 30)
    position, velocity = record.sample(times)
    assert not position.any()
    assert not velocity.any()
    force = 1.0 + load * np.sin(machine.frequency * times)
    assert record.observable("pad.contact_force", times) == pytest.approx(force, abs=1e-14)
    assert len(record.events) == 0
    assert record.error[-1] < 1e-14
    assert record.final.closed == (0,)
    assert machine.unpack_state(machine.pack_state(record.final)).closed == (0,)


@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize("load", [2.5, -2.5])
def test_rest_lasts_until_the_load_is_zero_or_exceeds_the_preload(load: float, side: str) -> None:
    # The force is 1 + q sin(w t): it is 3 where the sine is 2/q, and 0 where it is -1/q.
    stiff = 2.0
    machine = pad(load, side, stiffness=stiff)
    sign, w = 1.0 if side == "above" else -1.0, machine.frequency
    record = machine.simulate(impacts=1, start=machine.state([0.0], [0.0]))
    events = record.events
    begins = np.arcsin((2.0 if load > 0.0 else 1.0) / 2.5) / w
    assert events.time[0] == pytest.approx(begins, rel=1e-14)
    t = begins + 0.2
    with mp.workdps(30):
        # x'' + k x = 2 - q sin(w t) while it presses, x'' = -1 - q sin(w t) above
        k, q, f, b = mp.mpf(stiff if load > 0.0 else 0.0), mp.mpf(load), mp.mpf(w), mp.mpf(begins)
        level = mp.mpf(2 if load > 0.0 else -1)

        def push(s: Any) -> Any:
            kernel = mp.sin(mp.sqrt(k) * (t - s)) / mp.sqrt(k) if k else t - s
            return kernel * (level - q * mp.sin(f * s))

        place = float(mp.quad(push, [b, t]))
    assert sign * record.sample(np.array([t]))[0][0, 0] == pytest.approx(place, abs=1e-14)
    assert (place < 0.0) is (load > 0.0)


def test_a_start_at_the_edge_with_another_force_leaves_at_once() -> None:
    heavy = pad().replace(constant_forces=[-4.0])
    record = heavy.simulate(impacts=1, start=heavy.state([0.0], [0.0]))
    assert record.sample(np.array([0.5]))[0][0, 0] == pytest.approx(-0.125, abs=1e-15)
    lifted = pad().replace(constant_forces=[0.5])
    record = lifted.simulate(impacts=1, start=lifted.state([0.0], [0.0]))
    assert record.sample(np.array([0.5]))[0][0, 0] == pytest.approx(0.0625, abs=1e-15)
    moving = pad(amplitude=0.1)  # at rest on the pad is to move with it
    velocity = 0.1 * moving.frequency
    record = moving.simulate(impacts=3, start=moving.state([0.0], [velocity]))
    times = np.linspace(0.0, 4.0, 20)
    place = 0.1 * np.sin(moving.frequency * times)
    assert record.sample(times)[0][:, 0] == pytest.approx(place, abs=1e-14)


def random_machine(seed: int) -> tuple[ImpactChain, Array, Array]:
    """A chain whose first mass rests on a pad, with a hard stop and friction elsewhere."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 4))
    offset = random.uniform(-0.2, 0.2)
    elements: list[Any] = [
        SoftStop(
            0,
            offset=offset,
            stiffness=random.choice([0.0, random.uniform(0.5, 5.0)]),
            damping=random.choice([0.0, 0.3]),
            preload=random.uniform(0.5, 2.5),
            name="pad",
        ),
        HardStop(
            n - 1,
            offset=-0.3,
            amplitude=0.1,
            restitution=random.choice([0.0, random.uniform(0.3, 0.8)]),
        ),
    ]
    if n > 2:
        elements.append(DryFriction(1, force=random.uniform(0.02, 0.2)))
    chain = ImpactChain(
        masses=tuple(random.uniform(0.5, 2.0, n).tolist()),
        damping=0.05,
        frequency=random.uniform(0.4, 1.5),
        harmonic_forces=random.uniform(-1.0, 1.0, n),
        constant_forces=[-1.0, *([0.0] * (n - 2)), -0.4],
        elements=[elements[k] for k in random.permutation(len(elements))],
    )
    place, velocity = random.normal(size=(2, n))
    place[0], velocity[0], place[-1] = offset, 0.0, 0.3 + abs(place[-1])
    return chain, place, velocity


@pytest.mark.parametrize("seed", range(8))
def test_random_machines_move_as_in_many_digits(seed: int) -> None:
    chain, place, velocity = random_machine(seed)
    record = chain.simulate(impacts=4, start=chain.state(place, velocity))
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]
    count = min([len(record), *cut.tolist()])
    assert count >= 1
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain, 0.02)
        found = reference.impacts(np.concatenate([place, velocity]), count)
        states = np.array([[float(number) for number in z] for _, z in found])
    motion = np.concatenate([record.position, record.velocity], axis=1)[:count]
    apart = abs(motion - states[:, : chain.dimension]).max(axis=1)
    assert (apart <= record.error[:count]).all()
    assert apart.max() < 1e-10


def test_labels_derivatives_and_orbits_of_a_machine_that_rests() -> None:
    machine = ImpactChain(
        masses=2,
        damping=0.1,
        frequency=1.0,
        harmonic_forces=[0.0, 0.8],
        constant_forces=[-1.0, -0.2],
        elements=[
            SoftStop(0, preload=4.0, stiffness=1.0, name="pad"),
            HardStop(1, offset=-0.1, restitution=0.5, name="table"),
        ],
    )
    start = machine.state([0.0, 0.5], [0.0, 0.0])
    record = machine.simulate(impacts=40, start=start)
    assert abs(record.position[:, 0]).max() < 1e-15
    balance = record.energy_balance()
    assert balance.error < 1e-12
    assert balance.work["pad"] == 0.0
    attractor = machine.attractor(start=start)
    counts = attractor.label.counts
    assert counts is not None
    assert counts["pad.rests"] == 0  # it rests for ever
    # As the last mass alone, between the wall of the first one and nothing.
    alone = MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.0]],
        frequency=1.0,
        harmonic_forces=[0.8],
        constant_forces=[-0.2],
        elements=[HardStop(0, offset=-0.1, restitution=0.5, name="table")],
    )
    single = alone.simulate(impacts=40, start=alone.state([0.5], [0.0]))
    assert record.time == pytest.approx(single.time, abs=1e-11)
    exact = machine.jacobian(record.states[-1])
    other = alone.jacobian(single.states[-1])
    assert exact[np.ix_([2, 3], [2, 3])] == pytest.approx(other, abs=1e-9)
    with pytest.raises(NotImplementedError, match="must not rest on a preloaded stop"):
        attractor.periodic_orbit()


def test_what_shares_a_row_does_not_rest() -> None:
    # The shares would be open: it crosses the edges, as before.
    both = pad().replace(
        elements=[
            SoftStop(0, stiffness=0.0, preload=3.0, name="pad"),
            DryFriction(0, force=0.1, name="rub"),
        ]
    )
    assert both.state([0.0], [0.0]).closed == (1,)
