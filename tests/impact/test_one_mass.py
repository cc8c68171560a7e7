"""Single masses, balls and masses with play: the contracts, families, sweeps, refusals."""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from dynkit import sweep
from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from dynkit.testing import (
    AttractorCheck,
    MapCheck,
    attractor_checks,
    check_name,
    map_checks,
    numerical_derivative,
)
from tests.effort import shorter_searches

NAN, INF = math.nan, math.inf


def single(**arguments: Any) -> SingleImpactOscillator:
    return SingleImpactOscillator(**{"frequency": 2.8, "restitution": 0.8, **arguments})


def ball(**arguments: Any) -> BouncingBall:
    return BouncingBall(**{"frequency": 3.0, "restitution": 0.9, "amplitude": 0.1, **arguments})


def play(**arguments: Any) -> PlayOscillator:
    return PlayOscillator(**{"frequency": 1.0, "restitution": 0.5, "amplitude": 0.2, **arguments})


def table(**arguments: Any) -> MatrixOscillator:
    one = np.eye(1)
    return MatrixOscillator(M=one, C=0.1 * one, K=one, frequency=1.0, **arguments)


SYSTEMS: dict[str, ImpactOscillator] = {
    "single, chaotic": single(),
    "single, stop away": single(frequency=2.3, stop=0.1),
    "single, undamped": single(frequency=2.0, damping_ratio=0.0),
    "single, overdamped": single(frequency=2.0, damping_ratio=2.0),
    "ball": ball(),
    "ball, table at rest": ball(amplitude=0.0, restitution=1.0),
    "ball, chaotic": ball(amplitude=0.2),
    "ball, gravity of the earth": ball(gravity=9.81, amplitude=2.0),
    "play, free mass": play(),
    "play, chaotic": play(amplitude=0.0, force=1.0, damping=0.1, frequency=1.1, restitution=0.6),
    "play, spring": play(amplitude=0.0, force=1.0, spring=1.0, damping=0.1, frequency=2.1),
    "play, housing and force": play(force=-2.0, spring=0.5, damping=0.1, frequency=2.1),
}


# --- contracts ------------------------------------------------------------------------------------


@cache
def states(name: str) -> Array:
    """Five impacts, those in the past of which contact or grazing is near left out."""
    found = SYSTEMS[name].attractor(transient=300, impacts=60).states
    return found[abs(found[:, 0]) > 0.1][:5]


@pytest.mark.parametrize("check", map_checks, ids=check_name)
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_system_is_a_map(name: str, check: MapCheck) -> None:
    assert len(states(name)) == 5
    check(SYSTEMS[name], states(name))


@pytest.mark.parametrize("check", attractor_checks, ids=check_name)
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_attractor_is_an_attractor(name: str, check: AttractorCheck) -> None:
    system = SYSTEMS[name]
    check(lambda transient, count: system.attractor(transient=transient, impacts=count))


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name.startswith("play")])
def test_both_stops_are_among_the_states_that_are_checked(name: str) -> None:
    assert set(np.sign(states(name)[:, 0])) == {-1.0, 1.0}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_derivative_reaches_across_the_play_and_back_to_the_same_stop(side: float) -> None:
    # Thrown up softly against a spring that presses the mass to where it comes from.
    system = play(amplitude=0.0, force=0.3, frequency=0.01, play=1.0)
    phase = 1.5 * math.pi if side > 0.0 else 0.5 * math.pi
    for speed, follows in ((0.5, side), (1.0, -side)):
        state = np.array([side * speed, phase])
        assert math.copysign(1.0, system(state)[0]) == follows
        found, error = numerical_derivative(
            system, state, difference=system.difference, accuracy=system.accuracy
        )
        assert error.max() < 1e-6 * abs(found).max()
        off = abs(system.jacobian(state) - found)
        assert (off <= 20.0 * error + 1e-13 * abs(found).max()).all()


STICKING: dict[str, ImpactOscillator] = {
    "single": single(frequency=0.3, stop=-0.5, restitution=0.3, chatter_tolerance=1e-8),
    "ball": ball(amplitude=0.2, restitution=0.3, chatter_tolerance=1e-8),
    "play": play(amplitude=2.0, restitution=0.2, chatter_tolerance=1e-8),
}


@pytest.mark.parametrize("name", STICKING)
def test_the_derivative_through_contact_vanishes(name: str) -> None:
    # All motions are released in the same state, at the same time.
    system = STICKING[name]
    record = system.simulate(impacts=300)
    ended = record.sticking[np.isfinite(record.sticking[:, 1])]
    before = record.states[np.searchsorted(record.time, ended[0, 0], side="right") - 1]
    following = system(before)
    earlier = system(before - [0.0, 1e-4])
    assert abs(system.difference(earlier, following)).max() < 1e-12
    assert abs(system.jacobian(before)).max() < 1e-10


# --- the same by other words ----------------------------------------------------------------------

ALIKE: dict[str, tuple[ImpactOscillator, dict[str, Any]]] = {
    "single": (
        single(damping_ratio=0.07, stop=0.1, force=1.3),
        {
            "C": [[0.14]],
            "K": [[1.0]],
            "frequency": 2.8,
            "restitution": 0.8,
            "amplitude": 0.0,
            "offset": 0.1,
            "side": "below",
            "harmonic_forces": (1.3j,),
        },
    ),
    "ball": (
        ball(gravity=9.81, amplitude=1.0),
        {
            "C": [[0.0]],
            "K": [[0.0]],
            "frequency": 3.0,
            "restitution": 0.9,
            "amplitude": 1.0,
            "constant_forces": (-9.81,),
        },
    ),
    "play": (
        play(spring=2.0, damping=0.3, force=2.0, play=1.5),
        {
            "C": [[0.3]],
            "K": [[2.0]],
            "frequency": 1.0,
            "restitution": 0.5,
            "amplitude": 0.2,
            "offset": -0.75,
            "play": 1.5,
            "harmonic_forces": (2.0,),
        },
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_the_motion_is_that_of_the_matrices(name: str) -> None:
    # Which agree with 50 digits: see test_scenes.
    system, matrices = ALIKE[name]
    other = MatrixOscillator(M=[[1.0]], **matrices)
    one = system.simulate(impacts=100)
    start = other.state(one.start.position, one.start.velocity)
    same = other.simulate(impacts=100, start=start)
    assert len(one) == 100
    assert (abs(one.states - same.states).max(axis=1) <= one.error + same.error).all()


# --- families -------------------------------------------------------------------------------------


def test_parameters_are_the_arguments() -> None:
    assert dict(single().parameters) == {
        "frequency": 2.8,
        "restitution": 0.8,
        "damping_ratio": 0.05,
        "force": 1.0,
        "stop": 0.0,
    }
    assert dict(ball().parameters) == {
        "frequency": 3.0,
        "restitution": 0.9,
        "amplitude": 0.1,
        "gravity": 1.0,
    }
    assert dict(play().parameters) == {
        "frequency": 1.0,
        "restitution": 0.5,
        "amplitude": 0.2,
        "play": 1.0,
        "spring": 0.0,
        "damping": 0.0,
        "force": 0.0,
    }


REPLACED: list[tuple[ImpactOscillator, str, float]] = [
    (single(), "force", 2.0),
    (single(), "stop", 0.3),
    (single(), "damping_ratio", 0.2),
    (ball(), "gravity", 2.0),
    (ball(), "amplitude", 0.3),
    (play(), "play", 2.0),
    (play(), "force", 0.5),
    (play(), "spring", 0.5),
    (play(), "damping", 0.5),
]


@pytest.mark.parametrize(("system", "name", "value"), REPLACED, ids=[n for _, n, _ in REPLACED])
def test_a_replaced_parameter_is_used(system: ImpactOscillator, name: str, value: float) -> None:
    arguments: dict[str, Any] = {**system.parameters, name: value}
    fresh = type(system)(**arguments)
    changed = system.replace(**{name: value})
    assert changed == fresh != system
    bits = changed.simulate(impacts=20).states.tobytes()
    assert bits == fresh.simulate(impacts=20).states.tobytes()
    assert bits != system.simulate(impacts=20).states.tobytes()


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_printed_system_makes_it_again(name: str) -> None:
    made = {kind.__name__: kind for kind in (SingleImpactOscillator, BouncingBall, PlayOscillator)}
    assert eval(repr(SYSTEMS[name]), made) == SYSTEMS[name]


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_pickled_system_is_the_same(name: str) -> None:
    system = SYSTEMS[name]
    record = system.simulate(impacts=20)
    copy = pickle.loads(pickle.dumps(system))
    assert copy == system
    assert hash(copy) == hash(system)
    assert copy.simulate(impacts=20).states.tobytes() == record.states.tobytes()


@pytest.mark.parametrize(
    ("system", "changes"),
    [
        (single(), {"force": 2.0, "stop": 0.3, "restitution": 0.1, "frequency": 2.0}),
        (ball(), {"gravity": 2.0, "amplitude": 0.1, "frequency": 2.0}),
        (play(), {"play": 2.0, "force": 0.5, "amplitude": 0.1}),
    ],
    ids=["single", "ball", "play"],
)
def test_systems_of_one_structure_share_its_modes(
    system: ImpactOscillator, changes: dict[str, float]
) -> None:
    assert system.replace(**changes).modes is system.modes


# --- sweeps ---------------------------------------------------------------------------------------

SWEEPS: list[tuple[ImpactOscillator, str, list[float], list[str]]] = [
    (single(), "frequency", [2.0, 4.0, 5.5], ["P(1,1)", "P(1,2)", "P(1,3)"]),
    (single(frequency=4.0), "force", [0.5, 1.0, 2.0], ["P(1,2)"] * 3),
    (single(frequency=4.0), "stop", [0.0, 0.1], ["P(1,2)", "no impacts"]),
    (single(frequency=4.0), "restitution", [0.6, 0.8], ["P(1,2)"] * 2),
    (single(frequency=4.0), "damping_ratio", [0.1, 0.05], ["P(1,2)"] * 2),
    (ball(), "amplitude", [0.1, 0.12], ["P(1,1)", "P(2,2)"]),
    (ball(), "gravity", [1.0, 2.0], ["P(1,1)", "no impacts"]),
    (ball(), "restitution", [0.9, 0.5], ["P(1,1)", "no impacts"]),
    (play(), "amplitude", [0.2, 0.3], ["P(2,1)"] * 2),
    (play(), "play", [1.0, 1.2], ["P(2,1)"] * 2),
    (play(amplitude=0.0, spring=1.0, damping=0.1), "force", [1.0, 1.2], ["P(2,1)"] * 2),
]


@pytest.mark.parametrize(
    ("system", "parameter", "values", "labels"), SWEEPS, ids=[f"{p} {v}" for _, p, v, _ in SWEEPS]
)
def test_every_parameter_is_swept(
    system: ImpactOscillator, parameter: str, values: list[float], labels: list[str]
) -> None:
    found = sweep(system, parameter, values, progress=False)
    assert [str(label) for label in found.labels] == labels


def test_a_sweep_follows_the_orbit() -> None:
    found = sweep(single(), "frequency", np.arange(4.0, 4.4, 0.02), keep=20, progress=False)
    fresh = single(frequency=float(found.values[-1])).attractor(transient=700, impacts=20)
    u = found.observable("relative_velocity")
    assert u[-1] == pytest.approx(fresh.states[:, 0], rel=1e-12, abs=0.0)
    assert (abs(np.diff(u[:, -1])) > 0.0).all()


def test_a_stored_sweep_is_resumed_by_its_own_system_only(tmp_path: Any) -> None:
    store = tmp_path / "sweep.h5"
    first = sweep(single(), "force", [1.0, 2.0], keep=5, store=store, progress=False)
    # The system's own value of the swept parameter has no effect.
    again = sweep(single(force=7.0), "force", [1.0, 2.0], keep=5, store=store, progress=False)
    assert again.observable("relative_velocity").tobytes() == (
        first.observable("relative_velocity").tobytes()
    )
    with pytest.raises(ValueError, match="damping_ratio"):
        sweep(single(damping_ratio=0.1), "force", [1.0, 2.0], keep=5, store=store, progress=False)


# --- refusals -------------------------------------------------------------------------------------

REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: single(damping_ratio=-0.1), "damping_ratio must not be negative; got -0.1"),
    (lambda: single(damping_ratio=NAN), "damping_ratio must be a finite number; got nan"),
    (lambda: single(force=-1), "force must not be negative; got -1"),
    (lambda: single(force="1"), "force must be a finite number; got '1'"),
    (lambda: single(stop=INF), "stop must be a finite number; got inf"),
    (lambda: single(stop=True), "stop must be a finite number; got True"),
    (lambda: single(frequency=0), "frequency must be positive; got 0"),
    (lambda: single(restitution=1.5), "restitution must lie in [0, 1]; got 1.5"),
    (lambda: single().replace(amplitude=0.1), "parameter must be one of: frequency, restitution, "),
    (lambda: single().replace(offset=0.1), "; got 'offset'"),
    (lambda: single().state([0.5]), "position[0] must not be above the table at 0.0; got 0.5"),
    (
        lambda: single().state([0.0], [0.1]),
        "velocity[0] must not be above the velocity 0.0 of the table when",
    ),
    (lambda: single().state([0.0, 0.0]), "position must have shape (1,); got shape (2,)"),
    (lambda: single()(np.array([-0.1, 0.0])), "state[0] must not be negative; got -0.1"),
    (lambda: sweep(single(), "side", [1.0]), "parameter must be one of: "),
    (lambda: sweep(single(), "force", [1.0, -1.0]), "force must not be negative; got -1.0 in"),
    (lambda: ball(gravity=0.0), "gravity must be positive; got 0.0"),
    (lambda: ball(gravity=-9.81), "gravity must be positive; got -9.81"),
    (lambda: ball(gravity=None), "gravity must be a finite number; got None"),
    (lambda: ball(amplitude=-0.1), "amplitude must not be negative; got -0.1"),
    (lambda: ball().replace(constant_forces=(1.0,)), "; got 'constant_forces'"),
    (lambda: ball().state([-0.1]), "position[0] must not be below the table at 0.0; got -0.1"),
    (lambda: table(play=np.ones(0)), "play must be a finite number; got array([], dtype=float64)"),
    (lambda: table(play=np.ones(2)), "play must be a finite number; got array([1., 1.])"),
    (lambda: play(play=0.0), "play must be positive; got 0.0"),
    (lambda: play(play=INF), "play must be a finite number; got inf"),
    (lambda: play(spring=-1.0), "spring must not be negative; got -1.0"),
    (lambda: play(damping=-1.0), "damping must not be negative; got -1.0"),
    (lambda: play(force=NAN), "force must be a finite number; got nan"),
    (lambda: play().replace(offset=1.0), "; got 'offset'"),
    (lambda: play().state([0.6]), "position[0] must not be above the table at 0.5; got 0.6"),
    (lambda: play().state([-0.6]), "position[0] must not be below the table at -0.5; got -0.6"),
    (lambda: play().state(phase=NAN), "phase must be a finite number; got nan"),
    (lambda: play()(np.array([NAN, 0.0])), "state[0] must be a finite number; got nan"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_refusals_name_argument_limit_and_value(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


@pytest.mark.parametrize("kind", [SingleImpactOscillator, BouncingBall, PlayOscillator])
@pytest.mark.parametrize("name", ["offset", "contact", "side", "harmonic_forces"])
def test_what_follows_from_the_arguments_is_none(kind: type[Any], name: str) -> None:
    with pytest.raises(TypeError, match=name):
        kind(frequency=1.0, **{name: 0})


EXTREME: dict[str, ImpactOscillator] = {
    "single, damping ratio 1e8": single(damping_ratio=1e8),
    "single, critical damping": single(damping_ratio=1.0),
    "single, no force": single(force=0.0),
    "single, force 1e100": single(force=1e100),
    "single, force 1e-100": single(force=1e-100),
    "single, stop 1e6": single(stop=1e6),
    "single, stop -1e6": single(stop=-1e6),
    "single, resonance": single(frequency=1.0, damping_ratio=0.0),
    "ball, gravity 1e-8": ball(gravity=1e-8),
    "ball, gravity 1e8": ball(gravity=1e8),
    "ball, amplitude 1e-300": ball(amplitude=1e-300),
    "ball, amplitude 1e8": ball(amplitude=1e8),
    "ball, frequency 1e-8": ball(frequency=1e-8),
    "ball, frequency 1e8": ball(frequency=1e8),
    "play, play 1e-8": play(play=1e-8),
    "play, play 1e8": play(play=1e8),
    "play, force 1e8": play(force=1e8),
    "play, spring 1e8": play(spring=1e8),
    "play, damping 1e8": play(damping=1e8),
    "play, restitution 0": play(restitution=0.0),
    "play, restitution 1": play(restitution=1.0),
}


@pytest.mark.parametrize("name", EXTREME)
def test_extremes_end_with_finite_numbers_and_a_name(name: str) -> None:
    with shorter_searches(100_000):
        record = EXTREME[name].simulate(impacts=300)
    assert np.isfinite(record.states).all()
    assert (np.diff(record.time, prepend=0.0) >= 0.0).all()
    assert len(record) == 300 or record.ending is not Ending.COUNT_REACHED
