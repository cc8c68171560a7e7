"""Oscillators composed of elements: what users type, and what they are refused."""

import pickle
from dataclasses import dataclass
from math import atan, cos, exp, inf, nan, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit
from dynkit.analysis import POD, LyapunovSpectrum
from dynkit.systems import (
    BouncingBall,
    Element,
    HardStop,
    ImpactChain,
    MatrixOscillator,
    Regime,
    SingleImpactOscillator,
    SoftStop,
    Watch,
)
from dynkit.systems.impact.elements.element import IMPACT, EventKind
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.example_systems import Spring

TABLE = HardStop(-1, amplitude=0.1, restitution=0.6, name="table")
CUSHION = SoftStop(0, offset=0.05, stiffness=7.0, damping=0.6)
PAIR = ImpactChain(masses=2, frequency=0.9, elements=[TABLE, CUSHION])
FAR = HardStop(0, offset=-1e3)


def test_a_hard_stop_alone_is_the_default_table() -> None:
    one = ImpactChain(masses=3, frequency=0.87, restitution=0.8, amplitude=0.2, offset=-0.1)
    stop = HardStop(2, restitution=0.8, amplitude=0.2, offset=-0.1)
    other = ImpactChain(masses=3, frequency=0.87, elements=[stop])
    assert (other.simulate(impacts=50).states == one.simulate(impacts=50).states).all()
    below = ImpactChain(masses=3, frequency=0.87, contact=1, side="below", offset=0.3)
    stop = HardStop(1, amplitude=0.1, offset=0.3, side="below")
    again = MatrixOscillator(
        M=below.mass, C=below.damping_matrix, K=below.stiffness, frequency=0.87, elements=[stop]
    )
    states = below.simulate(impacts=50).states
    assert again.simulate(impacts=50).states == pytest.approx(states, abs=1e-12)


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        (TABLE, "elements must be a sequence of elements; got HardStop"),
        (3, "elements must be a sequence"),
        ([], "elements must hold one element at least; got none"),
        (["table"], r"elements\[0\] must be an element like HardStop; got 'table'"),
        ([HardStop(2)], r"elements\[0\].coordinate must .*; got 2"),
        ([TABLE, SoftStop(-3, stiffness=1.0)], r"elements\[1\].coordinate must .*; got -3"),
        ([TABLE, SoftStop((0, -2), stiffness=1.0)], "must be a pair of two coordinates"),
        ([TABLE, SoftStop([1.0, 2.0, 0.5], stiffness=1.0)], r"\[1\].coordinate must .*shape"),
        ([TABLE, SoftStop([0.0, 0.0], stiffness=1.0)], "must be a row that is not zero"),
        ([TABLE, SoftStop(0, stiffness=1.0, name="table")], "different names; got 'table' twice"),
    ],
)
def test_elements_that_are_none_are_refused(elements: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ImpactChain(masses=2, frequency=0.9, elements=elements)


@pytest.mark.parametrize(
    ("kind", "numbers", "message"),
    [
        (HardStop, {"restitution": 1.5}, "restitution must lie in"),
        (HardStop, {"amplitude": -0.1}, "amplitude must"),
        (HardStop, {"offset": nan}, "offset must"),
        (HardStop, {"side": "left"}, "side must be one of"),
        (HardStop, {"name": "my table"}, "name must be a name like"),
        *((HardStop, {"name": name}, "name must be a name like") for name in (None, True, np.nan)),
        (SoftStop, {"stiffness": -1.0}, "stiffness must"),
        (SoftStop, {"stiffness": inf}, "stiffness must"),
        (SoftStop, {"stiffness": 0.0}, "stiffness must be positive where damping and preload are"),
        (SoftStop, {"stiffness": 1.0, "preload": -0.1}, "preload must not be negative; got -0.1"),
        (SoftStop, {"stiffness": 1.0, "preload": np.nan}, "preload must be"),
        (SoftStop, {"stiffness": 1.0, "damping": nan}, "damping must"),
        (SoftStop, {"stiffness": 1.0, "phase": inf}, "phase must"),
    ],
)
def test_numbers_that_are_none_are_refused(kind: Any, numbers: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        kind(0, **numbers)


@pytest.mark.parametrize("numbers", [{"stiffness": 1e150}, {"stiffness": 1.0, "damping": 1e300}])
def test_stops_too_stiff_for_their_masses_are_refused(numbers: Any) -> None:
    name, elements = list(numbers)[-1], [TABLE, SoftStop(0, **numbers)]
    for place, own in ((1, elements), (0, elements[::-1])):
        pair = ImpactChain(masses=2, frequency=0.9, elements=own)
        message = (
            rf"elements\[{place}\].{name}, over the mass that it acts on, must not exceed 1e\+60"
        )
        with pytest.raises(ValueError, match=message):
            pair.simulate(impacts=1)


@pytest.mark.parametrize("forces", ["a", [1j, "a"], [1j, None]])
def test_harmonic_forces_that_are_no_numbers_are_refused(forces: Any) -> None:
    with pytest.raises(ValueError, match="harmonic_forces must be an array of complex numbers"):
        ImpactChain(masses=2, frequency=1.0, harmonic_forces=forces)


@pytest.mark.parametrize("coordinate", ["a", 1.5, True, None, [], (0, 0.5, nan)])
def test_coordinates_that_are_none_are_refused(coordinate: Any) -> None:
    with pytest.raises(ValueError, match=r"coordinate(\[2\])? must"):
        ImpactChain(masses=2, frequency=0.9, elements=[TABLE, SoftStop(coordinate, stiffness=1.0)])


@pytest.mark.parametrize("name", ["restitution", "amplitude", "offset", "contact", "play"])
def test_numbers_of_the_table_are_those_of_its_element(name: str) -> None:
    given: Any = {name: 0.2 if name != "contact" else 0}
    with pytest.raises(ValueError, match=f"{name} must not be given beside elements"):
        ImpactChain(masses=2, frequency=0.9, elements=[HardStop(1, offset=1.0)], **given)
    with pytest.raises(ValueError, match="must"):
        PAIR.replace(**{name: 3})


def test_special_oscillators_have_their_own_stops() -> None:
    for kind in (SingleImpactOscillator, BouncingBall):
        called: Any = kind
        with pytest.raises(TypeError, match="elements"):
            called(frequency=1.0, elements=[HardStop(0)])


def test_numbers_of_elements_are_parameters() -> None:
    names = "offset", "amplitude", "phase", "stiffness", "damping", "preload"
    own = [f"elements[1].{n}" for n in names]
    table = [f"table.{n}" for n in ("offset", "amplitude", "phase", "restitution")]
    assert set(PAIR.parameters) == {"frequency", "damping", "springs", *own, *table}
    other = PAIR.replace(
        **{"table.restitution": 0.7, "elements[1].stiffness": 9.0, "frequency": 1.0}
    )
    assert (other.restitution, other.elements[1].stiffness, other.frequency) == (0.7, 9.0, 1.0)
    alone = PAIR.replace(elements=[TABLE])
    assert alone.elements == (HardStop(1, amplitude=0.1, restitution=0.6, name="table"),)
    assert alone.restitution == 0.6
    with pytest.raises(ValueError, match=r"parameter must be one of: .*elements\[1\].stiffness"):
        PAIR.replace(**{"elements[1].force": 1.0})
    with pytest.raises(ValueError, match="stiffness must"):
        PAIR.replace(**{"elements[1].stiffness": -9.0})
    assert pickle.loads(pickle.dumps(PAIR)) == PAIR


def test_motions_are_measured_as_those_of_a_table() -> None:
    attractor = PAIR.attractor(transient=300, impacts=60)
    assert attractor.label.name.startswith("P(")
    assert POD(attractor).rank(0.9) <= 2
    exponents = LyapunovSpectrum(attractor, 200).exponents
    assert exponents[0] < 0.0
    n, product = attractor.label.iterates, np.eye(PAIR.dimension)
    assert n is not None
    for state in attractor.states[-1 - n : -1]:
        product = PAIR.jacobian(state) @ product
    largest = abs(np.linalg.eigvals(product)).max()
    assert attractor.label.multiplier == pytest.approx(largest, rel=1e-6)


def test_numbers_of_elements_are_swept_and_stored(tmp_path: Path) -> None:
    store, name = tmp_path / "sweep.h5", "elements[1].stiffness"
    kept: Any = {"transient": 200, "keep": 40}
    values = [6.0, 7.0, 8.0]
    swept = dynkit.sweep(PAIR, name, values, store=store, **kept)
    again = dynkit.sweep(PAIR, name, values, store=store, **kept)
    for k, value in enumerate(values):
        alone = PAIR.replace(**{name: value}).attractor(**kept)
        assert str(swept.labels[k]) == str(again.labels[k]) == str(alone.label)
    with pytest.raises(ValueError, match=r"was made with elements.*got"):
        dynkit.sweep(
            PAIR.replace(**{"elements[1].offset": 0.01}), name, values, store=store, **kept
        )


def test_orbits_with_soft_stops_are_those_of_the_map() -> None:
    attractor = PAIR.attractor(transient=300, impacts=60)
    with pytest.raises(NotImplementedError, match="table of one coordinate, alone; got SoftStop"):
        PAIR.periodic_orbit(phases=[0.1])
    guess = attractor.states[-1]
    given = dynkit.periodic_orbit(PAIR, guess, period=attractor.label.iterates)
    for orbit in (given, attractor.periodic_orbit()):
        assert orbit.stable
        assert len(orbit.states) == attractor.label.iterates
        assert abs(orbit.states - attractor.states[-len(orbit.states) :]).max() < 1e-6


def test_a_bilinear_oscillator_has_the_period_of_two_halves() -> None:
    one = ImpactChain(
        masses=1, damping=0.0, frequency=1.0, elements=[FAR, SoftStop(0, stiffness=3.0)]
    )
    record = one.simulate(impacts=1, start=one.state([1.0]))
    assert record.ending is Ending.SEARCH_LIMIT
    events = record.events
    assert (events.kind == EventKind.SWITCH).all()
    assert (events.element == 1).all()
    periods = np.diff(events.time[:2001:2])
    assert abs(periods - (pi + pi / sqrt(4.0))).max() < 1e-11
    x, v = record.sample(events.time[:1000])
    assert abs(x).max() < 1e-11
    assert abs(abs(v) - 1.0).max() < 1e-11


def in_other_coordinates(chain: ImpactChain, change: Any) -> MatrixOscillator:
    """The same chain in coordinates y with x = change y, its table a stop along a row of them."""
    m, c, k = chain.mass, chain.damping_matrix, chain.stiffness
    parts = (change.T @ part @ change for part in (m, c, k))
    mass, damping, stiffness = (0.5 * (part + part.T) for part in parts)
    stop = HardStop(change[-1], amplitude=chain.amplitude, restitution=chain.restitution)
    return MatrixOscillator(
        M=mass, C=damping, K=stiffness, frequency=chain.frequency, elements=[stop]
    )


@pytest.mark.parametrize(("frequency", "impacts"), [(0.87, 30), (0.408, 60)])
def test_motion_does_not_depend_on_the_coordinates(frequency: float, impacts: int) -> None:
    change = np.array([[1.0, 0.0, 0.5], [0.25, 1.0, 0.0], [-0.5, 0.75, 1.0]])
    chain = ImpactChain(masses=3, frequency=frequency, damping=0.3, restitution=0.6, amplitude=0.3)
    other = in_other_coordinates(chain, change)
    start = chain.state([0.3, 0.5, 1.0])
    back = np.linalg.inv(change)
    one = chain.simulate(impacts=impacts, start=start)
    two = other.simulate(impacts=impacts, start=other.state(back @ start.position))
    apart = 1e-9
    assert two.time == pytest.approx(one.time, abs=apart)
    assert abs(two.position @ change.T - one.position).max() < apart
    assert abs(two.velocity @ change.T - one.velocity).max() < apart
    assert two.sticking == pytest.approx(one.sticking, abs=apart)
    assert len(one.sticking)
    times = np.linspace(0.0, 0.99 * one.time[-1], 200)
    assert abs(two.sample(times)[0] @ change.T - one.sample(times)[0]).max() < 1e-8
    moments, others = one.second_moments(), two.second_moments()
    total = others.products.sum(axis=0)
    assert abs(change @ total @ change.T - moments.products.sum(axis=0)).max() < 1e-8
    # derivatives are similar: the same product of singular values, and of eigenvalues
    for a, b in zip(one.states[2:8], two.states[2:8], strict=True):
        found, expected = other.jacobian(b), chain.jacobian(a)
        assert np.linalg.matrix_rank(found, 1e-9) == np.linalg.matrix_rank(expected, 1e-9)
    long, longer = chain.attractor(transient=500), other.attractor(transient=500)
    assert str(longer.label) == str(long.label)
    assert longer.label.multiplier == pytest.approx(long.label.multiplier, abs=1e-6)
    exponents = [LyapunovSpectrum(each, 400).exponents[:2] for each in (long, longer)]
    assert exponents[1] == pytest.approx(exponents[0], abs=2e-2)


@pytest.mark.parametrize("along", [(0, 1), [0.5, -1.0, 1.5]])
def test_derivatives_along_a_row_are_differences(along: Any) -> None:
    stop = HardStop(along, amplitude=0.2, restitution=0.6, phase=0.4, offset=-0.1)
    chain = ImpactChain(masses=3, frequency=0.9, elements=[stop])
    states = chain.simulate(impacts=200).states
    clear = states[states[:, -2] > 0.1][:4]  # no chatter, which a step changes
    assert len(clear) == 4
    for state in clear:
        exact, size = chain.jacobian(state), 1e-6
        for step in size * np.eye(chain.dimension):
            change = chain.difference(chain(state + step), chain(state - step)) / (2.0 * size)
            own = exact @ (step / size)
            assert abs(own - change).max() < 1e-5 * max(1.0, abs(exact).max())
        for name, value in (("elements[0].phase", 0.4), ("frequency", 0.9)):
            by = chain.parameter_derivative(state, name)
            later, sooner = (chain.replace(**{name: value + d}) for d in (1e-6, -1e-6))
            change = chain.difference(later(state), sooner(state)) / 2e-6
            assert by == pytest.approx(change, abs=1e-6, rel=1e-6)


def test_two_masses_on_springs_of_their_own_collide_every_half_period() -> None:
    """Their distance bounces at zero with the period of a spring; their centre never learns."""
    pair = MatrixOscillator(
        M=np.eye(2),
        C=np.zeros((2, 2)),
        K=np.eye(2),
        frequency=1.0,
        elements=[HardStop((0, 1), restitution=0.9)],
    )
    record = pair.simulate(impacts=20, start=pair.state([0.5, 0.5], [0.0, 1.0]))
    assert record.time == pytest.approx(pi * np.arange(1, 21), abs=1e-13)
    assert record.relative_velocity == pytest.approx(0.9 ** np.arange(1, 21), rel=1e-13)
    x, _ = record.sample(np.linspace(0.0, 60.0, 100))
    centre, phase = x.sum(axis=1), np.linspace(0.0, 60.0, 100)
    assert centre == pytest.approx(np.cos(phase) + np.sin(phase), abs=1e-12)
    assert (x[:, 1] - x[:, 0]).min() > -1e-13
    equal = pair.replace(**{"elements[0].restitution": 1.0})
    hit = equal.simulate(impacts=1, start=equal.state([0.0, 1.0], [0.5, 0.5]))
    assert np.sort(hit.velocity[0]) == pytest.approx(np.sort(v_before(hit)), abs=1e-14)


def v_before(record: Any) -> Any:
    """Velocities just before its first impact."""
    return record.sample([np.nextafter(record.time[0], 0.0)])[1][0]


@pytest.mark.parametrize(
    ("along", "what"),
    [((0, 1), r"position\[1\] - position\[0\]"), ([1.0, 2.0], r"position along \(1.0, 2.0\)")],
)
def test_states_beyond_a_stop_are_refused_by_what_it_acts_along(along: Any, what: str) -> None:
    chain = ImpactChain(masses=2, frequency=0.9, elements=[HardStop(along, offset=-0.2)])
    with pytest.raises(ValueError, match=f"{what} must not be below the stop at -0.2; got"):
        chain.state([0.0, -1.0])
    touching = np.array([-0.2, -0.4]) if along == (0, 1) else np.array([0.0, -0.1])
    with pytest.raises(ValueError, match=what.replace("position", "velocity")):
        chain.state(touching, [0.0, -1.0])
    assert chain.state(touching).relative_velocity == 0.0


def test_the_picture_names_what_a_stop_acts_along() -> None:
    for along, name in (
        ((0, 1), "displacement $x_{2} - x_{1}$"),
        ([1.0, 2.0], "displacement $J x$"),
    ):
        stop = HardStop(along, amplitude=0.1, phase=0.5)
        chain = ImpactChain(masses=2, frequency=0.9, elements=[stop])
        record = chain.simulate(impacts=10)
        ax = record.plot()
        assert ax.get_ylabel() == name
        row = stop.row(2)
        drawn = ax.get_lines()[0]
        times = np.asarray(drawn.get_xdata())
        assert np.asarray(drawn.get_ydata()) == pytest.approx(record.sample(times)[0] @ row)


def test_a_stop_that_lags_is_a_table_at_another_phase() -> None:
    table = ImpactChain(masses=3, frequency=0.87)
    late = ImpactChain(masses=3, frequency=0.87, elements=[HardStop(2, amplitude=0.1, phase=0.7)])
    one = table.simulate(impacts=30, start=table.state(phase=0.3))
    two = late.simulate(impacts=30, start=late.state(phase=1.0))
    assert two.time == pytest.approx(one.time, abs=1e-9)
    assert abs(late.difference(two.states, one.states)[:, -1] - 0.7).max() < 1e-9
    with pytest.raises(NotImplementedError, match="table of one coordinate"):
        late.periodic_orbit(phases=[0.1])


def test_a_stiff_stop_with_a_dashpot_tends_to_a_hard_one() -> None:
    """With c = 2 z sqrt(k) a unit mass leaves it where spring and dashpot no longer push."""
    ratios, z = [], 0.2
    for stiffness in (1e4, 1e6, 1e8, 1e12):
        stop = SoftStop(0, stiffness=stiffness, damping=2.0 * z * sqrt(stiffness))
        one = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[FAR, stop])
        record = one.simulate(impacts=1, start=one.state([1.0]))
        modes = record.events.mode
        assert modes[:3].tolist() == [1, 2, 0]
        _, v = record.sample(record.events.time[:2])
        ratios.append(-v[1, 0] / v[0, 0])
    root = sqrt(1.0 - z * z)
    t = (pi - atan(2.0 * z * root / (1.0 - 2.0 * z * z))) / root
    limit = -exp(-z * t) * (cos(root * t) - z / root * sin(root * t))
    errors = abs(np.array(ratios) - limit)
    assert (errors[1:3] < 0.2 * errors[:2]).all()  # as the root of 1 / stiffness
    assert errors[-1] < 1e-5


@dataclass(frozen=True)
class Wall(Element):
    """What is no element of one's own: it is hit, or holds."""

    hit: bool = True

    @property
    def regimes(self) -> tuple[Regime, ...]:
        if self.hit:
            return (Regime((Watch(to=0, gap=1.0, event=IMPACT),)),)
        return Regime((Watch(to=1, gap=1.0),)), Regime((Watch(to=0, order=3),), holds=True)


@pytest.mark.parametrize("hit", [True, False])
def test_an_element_of_ones_own_is_no_hard_stop(hit: bool) -> None:
    with pytest.raises(ValueError, match=r"elements\[1\] must not be hit, nor hold.*got Wall"):
        ImpactChain(masses=2, frequency=0.9, elements=[TABLE, Wall(0, hit)])


def test_an_element_of_ones_own_is_one() -> None:
    own = ImpactChain(masses=2, frequency=0.9, elements=[TABLE, Spring(0, 7.0, offset=0.05)])
    soft = PAIR.replace(**{"elements[1].damping": 0.0})
    assert (own.simulate(impacts=50).states == soft.simulate(impacts=50).states).all()
    assert own.replace(**{"elements[1].stiffness": 8.0}).elements[1].stiffness == 8.0
