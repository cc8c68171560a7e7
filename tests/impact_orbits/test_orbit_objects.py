"""Orbits as objects: samples, arrays, copies, and what is refused."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from dynkit.continuation.continuing import continue_orbit
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.plotting.figures import new_figure
from dynkit.systems.impact.elements.friction import DryFriction
from dynkit.systems.impact.elements.stops import SoftStop
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from tests.impact_orbits import sticking_cases
from tests.impact_orbits.structures import SYSTEMS
from tests.impact_orbits.test_many_impacts import FREQUENCIES, SEARCHED, searched, settled

TURN = 2.0 * math.pi


def play_orbit() -> ImpactOrbit:
    """Stops hit in turn."""
    system = PlayOscillator(
        play=1.0, spring=0.5, damping=0.1, force=1.0, amplitude=0.2, frequency=1.6, restitution=0.6
    )
    attractor: Any = system.attractor()
    orbit: ImpactOrbit = attractor.periodic_orbit()
    assert set(np.signbit(orbit.relative_velocity)) == {True, False}
    return orbit


ORBITS: dict[str, Callable[[], ImpactOrbit]] = {
    **{f"chain at {w}": lambda w=w: settled(w) for w in FREQUENCIES},  # type: ignore[misc]
    "play": play_orbit,
    "below": SYSTEMS["chain, below"].periodic_orbit,
    "forces": SYSTEMS["chain, forces"].periodic_orbit,
    "contact inside": SYSTEMS["chain, contact inside"].periodic_orbit,
    "linked pairs": SYSTEMS["triple"].periodic_orbit,
}


STICKING: dict[str, Callable[[], ImpactOrbit]] = {
    f"sticking: {name}": partial(sticking_cases.orbit_of, name) for name in sticking_cases.SYSTEMS
}
ANY: dict[str, Callable[[], ImpactOrbit]] = {**ORBITS, **STICKING}
FEW = pytest.mark.parametrize(
    "orbit_of", [partial(settled, 0.33), STICKING["sticking: chain of 3, 0.3"]], ids=["P", "P(inf)"]
)
"""One orbit of each kind, for what is refused alike."""


# --- samples --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ORBITS)
def test_samples_are_those_of_a_simulation(name: str) -> None:
    orbit = ORBITS[name]()
    system = orbit.system
    start = system.impact_state(orbit.states[0])
    record = system.simulate(impacts=orbit.impacts + 1, start=start)
    times = np.linspace(0.0, orbit.period, 200, endpoint=False)
    # At the impacts the velocity jumps: which side is seen depends on rounding.
    times = times[abs(times[:, None] - orbit.time).min(axis=1) > 1e-6]
    growth, product = 1.0, np.eye(system.dimension)
    for state in orbit.states:
        product = system.jacobian(state) @ product
        growth = max(growth, float(abs(product).sum(axis=1).max()))
    bound = 10.0 * (growth * orbit.error + record.error.max())
    for found, wanted in zip(orbit.sample(times), record.sample(times), strict=True):
        # The bound is still far below the size of the motion.
        assert abs(found - wanted).max() <= bound < 1e-5


@pytest.mark.parametrize("name", ANY)
def test_samples_repeat_themselves(name: str) -> None:
    orbit = ANY[name]()
    times = np.linspace(0.0, orbit.period, 50, endpoint=False) + 1e-3
    first = orbit.sample(times)
    for turns in (-3, 1, 1000):
        again = orbit.sample(times + turns * orbit.period)
        for a, b in zip(first, again, strict=True):
            # Times are rounded to an ulp of themselves.
            assert abs(a - b).max() <= (1e-10 if name in STICKING else 1e-11)


@pytest.mark.parametrize("name", ORBITS)
def test_samples_at_impacts_are_the_states_just_after(name: str) -> None:
    orbit = ORBITS[name]()
    position, velocity = orbit.sample(orbit.time)
    others = np.delete(np.arange(orbit.system.degrees_of_freedom), orbit.system.contact)
    found = np.concatenate([position[:, others], velocity[:, others]], axis=1)
    assert found == pytest.approx(orbit.states[:, :-2], abs=1e-13)


def test_samples_are_finite_and_of_the_shape_that_was_asked_for() -> None:
    orbit = settled(0.28)
    position, velocity = orbit.sample([0.0, 1e6, -1e6])
    assert position.shape == velocity.shape == (3, 10)
    assert np.isfinite(position).all()


@FEW
def test_no_times_give_no_samples(orbit_of: Callable[[], Any]) -> None:
    position, velocity = orbit_of().sample([])
    assert position.shape == velocity.shape == (0, orbit_of().system.degrees_of_freedom)


@FEW
@pytest.mark.parametrize("times", [math.nan, [math.nan], [math.inf], 1.0, [[1.0]], "now"])
def test_times_that_are_no_times_are_refused(orbit_of: Callable[[], Any], times: object) -> None:
    with pytest.raises(ValueError, match=r"^times.* must") as refused:
        orbit_of().sample(times)
    assert "\n" not in str(refused.value)


# --- arrays ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ANY)
def test_arrays_cannot_be_changed(name: str) -> None:
    orbit = ANY[name]()
    arrays = [orbit.states, orbit.unknowns, orbit.multipliers, orbit.phases]
    arrays += [orbit.impulses, orbit.contacts, orbit.bounces]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


@pytest.mark.parametrize("name", ORBITS)
def test_states_velocities_and_phases_agree(name: str) -> None:
    orbit = ORBITS[name]()
    r = orbit.system.restitution
    assert orbit.states.shape == (orbit.impacts, orbit.system.dimension)
    assert orbit.states[:, -1] == pytest.approx(orbit.phases % TURN)
    assert np.array_equal(orbit.relative_velocity, orbit.states[:, -2])
    assert abs(orbit.relative_velocity) == pytest.approx(r / (1.0 + r) * orbit.impulses)
    assert orbit.time[0] == 0.0
    assert orbit.time == pytest.approx((orbit.phases - orbit.phases[0]) / orbit.system.frequency)


def test_observables_are_those_of_a_diagram() -> None:
    orbit = settled(0.33)
    assert np.array_equal(orbit.observable("phase"), orbit.states[:, -1])
    assert np.array_equal(orbit.observable("relative_velocity"), orbit.relative_velocity)
    assert np.array_equal(orbit.observable("time"), orbit.time)


def test_phases_just_below_zero_are_below_a_turn() -> None:
    problem: Any = settled(0.87)._problem
    x, p = np.array([-1e-17, 0.3]), np.empty(0)
    orbit = problem.orbit(x, p, (0.0,))
    assert orbit.phases.tolist() == [-1e-17]
    assert orbit.states[:, -1].tolist() == orbit.bounces[:, 1].tolist() == [0.0]
    assert orbit.observable("phase").tolist() == [0.0]
    places = [problem.touching(k, x, x[:1], p) for k in range(len(problem.events(x, p)))]
    assert {place["phase"] for place in places} == {0.0}
    assert {place["time"] for place in places} == {0.0}


@pytest.mark.parametrize("name", ANY)
def test_impacts_are_counted_and_contacts_are_those_of_orbits_that_stick(name: str) -> None:
    orbit = ANY[name]()
    assert orbit.sticks == (name in STICKING)
    assert orbit.label == f"P({orbit.impacts},{orbit.periods})"
    assert orbit.impacts == (math.inf if orbit.sticks else len(orbit.impulses))
    assert orbit.contacts.shape == (len(orbit.phases) if orbit.sticks else 0, 2)
    assert (orbit.chatter_error > 0.0) <= orbit.sticks


@pytest.mark.parametrize("name", ANY)
def test_impulses_times_and_bounces_agree_with_the_velocities(name: str) -> None:
    orbit = ANY[name]()
    r = orbit.system.restitution
    assert abs(orbit.relative_velocity) == pytest.approx(r / (1.0 + r) * orbit.impulses)
    named = np.stack([orbit.observable(x) for x in ("time", "phase", "relative_velocity")], axis=1)
    assert np.array_equal(orbit.time, orbit.observable("time"))
    # those of chatters come after each passage
    assert all((orbit.bounces == row).all(axis=1).any() for row in named)
    assert orbit.sticks or np.array_equal(orbit.bounces, named)


@FEW
@pytest.mark.parametrize("name", ["colour", "x", "energy", ""])
def test_an_unknown_observable_is_refused(orbit_of: Callable[[], Any], name: str) -> None:
    message = rf"^name must be one of: relative_velocity, phase, time; got '{name}'$"
    with pytest.raises(ValueError, match=message):
        orbit_of().observable(name)


@FEW
@pytest.mark.parametrize("name", ["colour", "nonsense", "", "masses", "contact"])
def test_an_unknown_parameter_is_refused(orbit_of: Callable[[], Any], name: str) -> None:
    with pytest.raises(ValueError, match=rf"^parameter must be one of: .*; got '{name}'$"):
        orbit_of().problem("frequency", name)


def test_equations_can_have_any_parameters_free() -> None:
    problem = settled(0.33).problem("frequency", "offset")
    assert problem.names == ("frequency", "offset")
    assert problem.values.tolist() == [0.33, 0.0]
    assert problem.free("amplitude").values.tolist() == [0.1]


@pytest.mark.parametrize("name", ORBITS)
def test_a_problem_makes_the_orbit_again(name: str) -> None:
    orbit = ORBITS[name]()
    problem = orbit.problem("frequency")
    again = problem.orbit(orbit.unknowns, problem.values, orbit.history)
    assert np.array_equal(again.states, orbit.states)
    assert np.array_equal(again.multipliers, orbit.multipliers)
    assert again.admissible == orbit.admissible
    assert again.residual == orbit.residual
    assert again.system == orbit.system


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda o: pickle.loads(pickle.dumps(o))]
)
@pytest.mark.parametrize("name", ANY)
def test_copies_are_the_same_orbit(name: str, again: Callable[[Any], Any]) -> None:
    orbit = ANY[name]()
    twin = again(orbit)
    assert (twin.system, twin.label, twin.history) == (orbit.system, orbit.label, orbit.history)
    assert twin.states.tobytes() == orbit.states.tobytes()
    assert twin.multipliers.tobytes() == orbit.multipliers.tobytes()
    with pytest.raises(ValueError, match="read-only"):
        twin.unknowns[0] = 0.0


@pytest.mark.parametrize("name", ANY)
def test_an_orbit_is_shown_in_one_line(name: str) -> None:
    orbit = ANY[name]()
    shown = repr(orbit)
    assert "\n" not in shown
    assert shown.startswith(f"<{orbit.label} of {type(orbit.system).__name__}(")
    assert name in ORBITS or len(shown) < 200
    assert ("unstable" in shown) != orbit.stable
    assert ("inadmissible" in shown) != orbit.admissible
    assert isinstance(orbit, PeriodicOrbit)


@FEW
def test_a_label_is_known_where_the_equations_have_no_solution(orbit_of: Callable[[], Any]) -> None:
    problem = orbit_of().problem()
    nowhere = problem.orbit(np.zeros(problem.size), np.empty(0), (math.inf,))
    assert nowhere.label == orbit_of().label


@pytest.mark.parametrize("name", SEARCHED)
def test_an_orbit_tells_what_it_cost(name: str) -> None:
    assert all(orbit.cost.seconds > 0.0 for orbit in searched(name))


# --- guesses --------------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_guess_may_begin_at_any_impact_and_in_any_period(frequency: float) -> None:
    orbit = settled(frequency)
    for first in range(orbit.impacts):
        turned = np.append(orbit.phases[first:], orbit.phases[:first] + TURN * orbit.periods)
        guess = turned + TURN * (5 * first - 7)
        again = orbit.system.periodic_orbit(periods=orbit.periods, phases=guess)
        off = orbit.system.difference(again.states, np.roll(orbit.states, -first, axis=0))
        assert abs(off).max() <= orbit.error + again.error
        assert 0.0 <= again.phases[0] < TURN


def test_the_first_of_the_orbits_is_given_without_a_guess() -> None:
    system = SYSTEMS["single, stop"]
    orbits = system.periodic_orbits(impacts=4, periods=5)
    assert np.array_equal(system.periodic_orbit(impacts=4, periods=5).states, orbits[0].states)


def test_a_search_gives_the_same_every_time() -> None:
    system = SYSTEMS["double"]
    once, again = (system.periodic_orbits(impacts=2, periods=4) for _ in range(2))
    assert [o.unknowns.tolist() for o in once] == [o.unknowns.tolist() for o in again]


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"impacts": 0}, "impacts must be"),
        ({"impacts": 1.5}, "impacts must be"),
        ({"periods": 0}, "periods must be"),
        ({"periods": -1}, "periods must be"),
        ({"periods": True}, "periods must be"),
        ({"phases": []}, "phases must ascend .* got \\[\\]"),
        ({"phases": [1.0, 0.5]}, "phases must ascend .* 1 periods of 2 pi; got \\[1.0, 0.5\\]"),
        ({"phases": [1.0, 1.0]}, "phases must ascend"),
        ({"phases": [1.0, 8.0]}, "phases must ascend"),
        ({"phases": [math.nan]}, r"phases\[0\] must"),
        ({"phases": 1.0}, "phases must"),
        ({"phases": [1.0], "sides": [1]}, "sides must lie in \\[0, 0\\]; got \\[1"),
        ({"phases": [1.0], "sides": [0, 0]}, "sides must"),
        ({"phases": [1.0], "sides": [0.5]}, "sides must"),
        ({"phases": [1.0], "sides": [-1]}, "sides must"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as refusal:
        ImpactChain(masses=2, frequency=0.87).periodic_orbit(**arguments)
    assert "\n" not in str(refusal.value)


def test_a_far_stop_that_is_no_stop_is_refused() -> None:
    with pytest.raises(ValueError, match="sides must lie in \\[0, 1\\]; got \\[2"):
        SYSTEMS["play"].periodic_orbit(phases=[1.0], sides=[2])


FREE: dict[str, ImpactOscillator] = {
    "ball": BouncingBall(frequency=3.0, amplitude=0.1),
    "mass in a play": PlayOscillator(frequency=1.0, amplitude=0.2),
    "chain without a wall": ImpactChain(masses=3, springs=(0.0, 1.0, 1.0), frequency=0.9),
    "resisted chain": MatrixOscillator(
        M=np.eye(2),
        C=np.diag([0.1, 0.0]),
        K=[[1.0, -1.0], [-1.0, 1.0]],
        frequency=0.9,
    ),
}


@pytest.mark.parametrize("name", [name for name in FREE if name != "ball"])
def test_what_no_force_brings_back_has_no_orbit_of_one_impact(name: str) -> None:
    assert FREE[name].periodic_orbits() == []
    with pytest.raises(ValueError, match=r"no orbit P\(1,1\) was found"):
        FREE[name].periodic_orbit()
    with pytest.raises(NoConvergence, match="no periodic orbit found from the guess"):
        FREE[name].periodic_orbit(phases=[1.0])


@pytest.mark.parametrize("sticking", [False, True])
@pytest.mark.parametrize("search", [ImpactChain.periodic_orbit, ImpactChain.periodic_orbits])
def test_a_system_that_nothing_drives_is_refused(
    search: Callable[..., object], *, sticking: bool
) -> None:
    quiet = ImpactChain(masses=2, frequency=0.87, amplitude=0.0, constant_forces=(0.0, -1.0))
    message = "^system must be driven: amplitude and harmonic_forces are zero$"
    with pytest.raises(ValueError, match=message):
        search(quiet, sticking=sticking)


def test_forces_at_resonance_without_damping_have_no_steady_response() -> None:
    system = MatrixOscillator(
        M=[[1.0]], C=[[0.0]], K=[[1.0]], frequency=1.0, harmonic_forces=(1.0,)
    )
    with pytest.raises(ValueError, match="system must have a steady response"):
        system.periodic_orbit()


def test_where_there_is_no_orbit_an_error_says_so() -> None:
    distant = ImpactChain(masses=2, frequency=3.0, offset=-50.0)
    assert distant.periodic_orbits() == []
    with pytest.raises(ValueError, match="no orbit P\\(1,1\\) was found"):
        distant.periodic_orbit()
    with pytest.raises(NoConvergence, match="no periodic orbit found from the guess"):
        distant.periodic_orbit(phases=[1.0])


def test_an_attractor_that_is_no_orbit_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"^attractor must be P\(n,m\) or P\(inf,m\); its label is 'chao"
    ):
        ImpactChain(frequency=1.346).attractor().periodic_orbit()


def test_an_orbit_of_a_family_is_not_isolated() -> None:
    """The second mass oscillates freely, and in the period of the forcing, with any amplitude."""
    free: dict[str, Any] = {"M": np.eye(2), "C": np.zeros((2, 2)), "contact": 0}
    system = MatrixOscillator(frequency=1.0, K=np.diag([1.44, 1.0]), **free)
    assert not system.periodic_orbit().isolated
    assert MatrixOscillator(frequency=0.9, K=np.diag([1.44, 1.0]), **free).periodic_orbit().isolated


def test_branches_without_a_hard_stop_have_the_states_as_observables_and_are_drawn() -> None:
    pad = SoftStop(0, offset=-0.5, stiffness=3.0, name="pad")
    machine = ImpactChain(
        masses=1, damping=0.05, frequency=0.3, harmonic_forces=[0.2], elements=[pad]
    )
    orbit = machine.attractor().periodic_orbit()
    # x'' + 0.05 x' + x = 0.2 sin(phase) before the pad is reached, at phase zero
    np.testing.assert_allclose(
        [orbit.observable("state[0]"), orbit.observable("state[1]")],
        [[part] for part in steady(0.2, 0.05, 0.3)],
        rtol=1e-12,
    )
    branch = continue_orbit(orbit, "frequency", bounds=(0.3, 0.9), largest_step=0.2)
    (line, *_) = branch.plot(new_figure()[1][0]).lines
    ends = [branch.orbit(i).states[0, 0] for i in (0, -1)]
    drawn = np.asarray(line.get_ydata(), dtype=float)
    assert ends[0] in drawn
    np.testing.assert_array_equal(branch.observable("state[0]")[[0, -1], 0], ends)


def steady(force: float, damping: float, frequency: float) -> tuple[float, float]:
    """Displacement and velocity of the steady response at phase zero."""
    response = force / (1.0 - frequency**2 + 1j * damping * frequency)
    return response.imag, (1j * frequency * response).imag


def test_cycles_that_nothing_drives_have_the_states_as_observables() -> None:
    belt = DryFriction(0, force=0.5, static=0.8, velocity=0.2, name="belt")
    block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[belt])
    cycle = block.periodic_orbit(start=block.state([0.0], [0.2]))
    np.testing.assert_array_equal(cycle.observable("state[1]"), cycle.states[:, 1])
    with pytest.raises(ValueError, match="name must be"):
        cycle.observable("state[2]")
