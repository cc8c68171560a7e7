"""What elements do in a motion: gaps, rates, forces and impulses."""

from itertools import pairwise
from math import atan, pi, sqrt
from typing import Any

import numpy as np
import pytest
from mpmath import mp

import dynkit
from dynkit.analysis import BifurcationDiagram
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator, SoftStop
from dynkit.systems.impact.records.event_counts import element_names
from tests.effort import is_thorough
from tests.impact.test_friction import random_machine as with_friction
from tests.impact.test_rough_stops import random_machine as on_rough_ground
from tests.reference.soft_stops import DIGITS, SoftStopReference


def free(elements: list[Any], weight: float = 0.0, mass: float = 1.0) -> MatrixOscillator:
    return MatrixOscillator(
        M=[[mass]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        constant_forces=[-weight],
        elements=elements,
    )


def test_a_floor_bears_the_weight_once_the_ball_has_come_to_rest() -> None:
    r, mass, weight, height = 0.5, 2.0, 3.0, 0.75
    ball = free([HardStop(0, restitution=r, name="floor")], weight, mass)
    record = ball.simulate(impacts=100, start=ball.state([height], [0.0]))
    g = weight / mass
    fall, first = sqrt(2.0 * height / g), sqrt(2.0 * height * g)
    rest = fall + 2.0 * first / g * r / (1.0 - r)
    times = np.linspace(0.0, 2.0 * rest, 501)
    force = record.observable("floor.contact_force", times)
    assert force[times < 0.999 * rest].max() == 0.0
    assert force[times > rest] == pytest.approx(np.full((times > rest).sum(), weight), rel=1e-15)
    expected = mass * (1.0 + r) * first * r ** np.arange(len(record))
    assert record.observable("floor.impulse") == pytest.approx(expected, rel=1e-12)
    rate = record.observable("floor.relative_velocity")
    assert rate.tobytes() == record.relative_velocity.tobytes()
    gap = record.observable("floor.gap", times)
    assert gap == pytest.approx(record.sample(times)[0][:, 0], abs=1e-14)


def test_a_table_carries_a_mass_by_weight_and_acceleration() -> None:
    a, w, weight = 0.3, 1.2, 1.0
    table = HardStop(0, amplitude=a, restitution=0.4, name="table")
    ride = free([table], weight).replace(frequency=w)
    start = ride.state([0.0], [a * w])
    record = ride.simulate(impacts=5, start=start)
    assert record.ending.name == "CONTACT_FOR_EVER"
    times = np.linspace(0.0, 30.0, 400)
    expected = weight - a * w * w * np.sin(w * times)
    assert record.observable("table.contact_force", times) == pytest.approx(expected, abs=1e-14)
    assert not record.observable("table.gap", times).any()


def test_a_soft_stop_pushes_by_spring_and_dashpot_and_never_pulls() -> None:
    # A mass of one hits a cushion: x'' = -k x - c x' from x = 0, x' = -u on, until the force is 0.
    k, c, u = 9.0, 1.2, 0.7
    ball = free([SoftStop(0, stiffness=k, damping=c, name="pad")])
    record = ball.simulate(impacts=2, start=ball.state([1.0], [-u]))
    decay, w = 0.5 * c, sqrt(k - 0.25 * c * c)
    begin = 1.0 / u
    since = np.linspace(0.0, 2.0, 301)
    x = -u / w * np.exp(-decay * since) * np.sin(w * since)
    v = -u * np.exp(-decay * since) * (np.cos(w * since) - decay / w * np.sin(w * since))
    push = -k * x - c * v
    ends = int(np.argmax(push < 0.0))
    expected = np.where(np.arange(len(since)) < ends, push, 0.0)
    found = record.observable("pad.contact_force", begin + since)
    assert found[1:] == pytest.approx(expected[1:], abs=1e-13)
    assert push[0] == pytest.approx(c * u)
    assert record.observable("pad.relative_velocity", begin + since[:ends]) == pytest.approx(
        v[:ends], abs=1e-13
    )


def test_a_belt_pulls_by_its_force_or_as_the_spring_does() -> None:
    kinetic, static, velocity = 0.5, 0.8, 0.2
    block = ImpactChain(
        masses=1,
        damping=0.0,
        frequency=1.0,
        harmonic_forces=[1e-300],
        elements=[DryFriction(0, force=kinetic, static=static, velocity=velocity, name="belt")],
    )
    stiffness = block.stiffness[0, 0]
    record = block.simulate(impacts=20)
    times = np.linspace(record.time[5], record.time[-1], 2001)
    x, v = (part[:, 0] for part in record.sample(times))
    force = record.observable("belt.friction_force", times)
    slip = record.observable("belt.slip_velocity", times)
    sticks = slip == 0.0
    assert 100 < sticks.sum() < 1900
    assert force[~sticks] == pytest.approx(np.full((~sticks).sum(), kinetic), abs=1e-14)
    assert force[sticks] == pytest.approx(stiffness * x[sticks], abs=1e-13)
    assert slip == pytest.approx(v - velocity, abs=1e-13)
    a = static - kinetic
    assert stiffness == 1.0
    period = 2.0 * (pi - atan(a / velocity)) + 2.0 * a / velocity
    assert sticks.mean() == pytest.approx(2.0 * a / velocity / period, abs=0.02)


def test_friction_is_named_the_same_from_both_sides() -> None:
    given: dict[str, Any] = {"force": 0.2, "static": 0.3, "velocity": 0.1, "name": "belt"}
    times = np.linspace(0.0, 40.0, 200)
    found = []
    for side in ("above", "below"):
        block = ImpactChain(
            masses=1,
            damping=0.1,
            frequency=0.4,
            harmonic_forces=[0.6],
            elements=[DryFriction(0, side=side, **given)],
        )
        record = block.simulate(impacts=30, start=block.state([0.3], [0.5]))
        found.append([record.observable(name, times) for name in block.observables[2:]])
    assert np.array(found[0]) == pytest.approx(np.array(found[1]), abs=1e-11)


def test_an_impact_on_what_lies_gives_impulses_to_both_stops() -> None:
    # Newton's law with complementarity: the upper ball throws nothing off, the floor takes as much.
    pile = MatrixOscillator(
        M=np.eye(2),
        C=np.zeros((2, 2)),
        K=np.zeros((2, 2)),
        frequency=1.0,
        constant_forces=[-1.0, -1.0],
        elements=[
            HardStop(0, restitution=0.5, name="floor"),
            HardStop((0, 1), restitution=0.5, name="upper"),
        ],
    )
    record = pile.simulate(impacts=3, start=pile.state([0.0, 0.5], [0.0, 0.0]))
    impulses = np.stack([record.observable(f"{name}.impulse") for name in ("floor", "upper")])
    expected = 1.5 * 0.5 ** np.arange(3)
    assert impulses == pytest.approx(np.stack([expected, expected]), rel=1e-12)
    assert record.observable("floor.contact_force", [0.0, 0.9]) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("machine", [with_friction, on_rough_ground])
@pytest.mark.parametrize("seed", range(12 if is_thorough() else 10))
def test_forces_of_random_machines_are_those_of_many_digits(machine: Any, seed: int) -> None:
    hit = machine is on_rough_ground or seed % 2 == 0
    chain, place, velocity = machine(seed, **({"hit": hit} if machine is with_friction else {}))
    record = chain.simulate(impacts=4, start=chain.state(place, velocity))
    run = record._run
    cut = run.switches.before[run.switches.speed > 0.0]  # the reference does not end chatter
    count = min([len(record), *cut.tolist()])
    if record.ambiguous is not None:
        count = min(count, record.ambiguous)
    with mp.workdps(DIGITS):
        reference = SoftStopReference(chain)
        start = np.concatenate([place, velocity])
        (reference.impacts if hit else reference.periods)(start, count)
        pushes = np.array(reference.pushes, dtype=float).reshape(count, -1)
    kinds: list[type] = [HardStop, SoftStop, DryFriction]
    names = element_names(chain)
    order = sorted(names, key=lambda name: kinds.index(type(chain._elements[names.index(name)])))
    size = abs(chain.stiffness).max() + abs(chain.damping_matrix).max() + chain.frequency
    size += max((getattr(e, "stiffness", 0.0) for e in chain.elements), default=0.0)
    for name, exact in zip(order, pushes.T, strict=True):
        element = chain._elements[names.index(name)]
        what = "friction_force" if isinstance(element, DryFriction) else "contact_force"
        found = record.observable(f"{name}.{what}")[:count]
        turned = element.sign if isinstance(element, DryFriction) else 1
        off = abs(found - turned * exact)
        assert (off <= 10.0 * size * record.error[:count] + 2.0**-50).all()
        assert off.max(initial=0.0) < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_forces_and_impulses_are_the_change_of_momentum(seed: int) -> None:
    chain, place, velocity = with_friction(seed, hit=True)
    record = chain.simulate(impacts=6, start=chain.state(place, velocity))
    run = record._run
    if (run.switches.speed > 0.0).any():  # what is left out of a chatter is no impact
        return
    end = float(record.time[-1])
    edges = np.unique(np.clip(run.segments.begin, 0.0, end))
    nodes, weights = np.polynomial.legendre.leggauss(24)
    gained = np.zeros(chain.degrees_of_freedom)
    names = element_names(chain)
    for low, high in pairwise(edges.tolist()):
        times = low + 0.5 * (high - low) * (1.0 + nodes)
        w = 0.5 * (high - low) * weights
        x, v = record.sample(times)
        phase = chain.frequency * times
        outer = np.outer(np.sin(phase), np.real(chain.harmonic_forces)) + chain.constant_forces
        gained += w @ (outer - x @ chain.stiffness - v @ chain.damping_matrix)
        for name, element in zip(names, chain._elements, strict=True):
            friction = isinstance(element, DryFriction)
            what = "friction_force" if friction else "contact_force"
            row = element.row(chain.degrees_of_freedom) * (1 if friction else element.sign)
            gained += (w @ record.observable(f"{name}.{what}", times)) * row
    for name, element in zip(names, chain._elements, strict=True):
        if isinstance(element, HardStop):
            row = element.sign * element.row(chain.degrees_of_freedom)
            gained += record.observable(f"{name}.impulse").sum() * row
    change = chain.mass @ (record.velocity[-1] - velocity)
    assert gained == pytest.approx(change, abs=1e-9)


def test_sweeps_and_diagrams_take_observables_of_elements() -> None:
    brake = ImpactChain(
        masses=2,
        damping=0.02,
        frequency=1.0,
        harmonic_forces=[0.0, 0.3],
        elements=[
            DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt"),
            DryFriction((0, 1), force=0.05),
        ],
    )
    names = ["belt.slip_velocity", "belt.friction_force"]
    found = dynkit.sweep(
        brake,
        "belt.velocity",
        [0.1, 0.2],
        observables=names,
        transient=50,
        keep=5,
        progress=False,
    )
    motion = found.attractor(1)
    for name in names:
        assert found.observable(name)[1].tobytes() == motion.observable(name).tobytes()
    axes = BifurcationDiagram.of(found, labelled=False).plot(observable=names[0])
    assert axes.get_ylabel() == "belt slip velocity"
    table = ImpactChain(masses=2, frequency=0.9)
    assert "table.impulse" in table.observables
    attractor = table.attractor(transient=20, keep=10)
    u = attractor.observable("relative_velocity")
    assert attractor.observable("table.impulse") == pytest.approx(u * (1 + 1 / 0.85), rel=1e-12)


def test_the_number_of_the_stop_of_each_impact_is_an_observable() -> None:
    stops = [HardStop(2, amplitude=0.2, restitution=0.6), HardStop(0)]
    system = ImpactChain(masses=3, frequency=0.8, elements=stops)
    record = system.simulate(impacts=40)
    assert len(set(record.element.tolist())) == 2
    assert record.observable("element").tolist() == record.element.tolist()
    given: Any = {"transient": 0, "keep": 40, "observables": ["element"], "progress": False}
    kept = dynkit.sweep(system, "frequency", [0.8], **given)
    assert kept.observable("element")[0].tolist() == record.element.tolist()


def test_bad_names_and_times_are_refused() -> None:
    record = ImpactChain(masses=2, frequency=0.9).simulate(impacts=5)
    with pytest.raises(ValueError, match=r"name must be one of: .*table.impulse; got 'belt.gap'"):
        record.observable("belt.gap")
    with pytest.raises(ValueError, match=r"name must be one of: .*; got 'table.impulse'"):
        record.observable("table.impulse", [0.0])
    with pytest.raises(ValueError, match=r"name must be one of: .*; got 'energy'"):
        record.observable("energy", [0.0])
    with pytest.raises(ValueError, match=r"times\[0\] must lie in"):
        record.observable("table.gap", [1e9])
    with pytest.raises(ValueError, match=r"times\[0\] must be a finite number"):
        record.observable("table.gap", [np.nan])
