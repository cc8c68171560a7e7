"""Stops along functions of the coordinates: sixty digits, closed forms, contact, refusals."""

from __future__ import annotations

import math
import pickle
from functools import cache
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
import sympy as sp
from flint import arb, ctx

from dynkit import continue_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array
from dynkit.systems import (
    HardStop,
    ImpactChain,
    ImpactOscillator,
    MatrixOscillator,
    SoftStop,
)
from dynkit.systems.impact.modes.taylor import chart as taylor_chart
from dynkit.testing import MapCheck, check_name, map_checks
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.flows.cases import BITS
from tests.impact.agreement import omitted_bounces_are_within_the_error
from tests.impact.curved_cases import (
    ARM,
    BOB,
    BOWL,
    SLIDING,
    STICKING_BOB,
    Bob,
    Bowl,
    Exact,
    Pair,
    floor,
)

pytestmark = pytest.mark.usefixtures("optimised")

SYSTEMS: dict[str, Any] = {"bob": BOB, "bob, contact": STICKING_BOB, "bowl": BOWL, "arm": ARM}
STARTS: dict[str, dict[str, Any]] = {
    "bob": {"position": [1.5]},
    "bob, contact": {"position": [1.5]},
    "bowl": {"position": [0.3, 1.0], "velocity": [0.2, 0.1]},
    "arm": {"position": [-0.4, -0.9], "velocity": [0.3, 0.2]},
}


def begun(name: str, impacts: int) -> Any:
    system = SYSTEMS[name]
    return system.simulate(impacts=impacts, start=system.state(**STARTS[name]))


@pytest.mark.parametrize("name", ["bowl", "arm"])
def test_multipliers_are_those_of_disturbances_that_stay_on_the_stop(name: str) -> None:
    system, (state, _) = SYSTEMS[name], states(name)
    (factor,), _ = system.orbit_factors(state, system(state))
    assert factor.shape == (4, 4)
    frame, after = system._frame(state), system._frame(system(state))
    whole = after @ factor @ frame.T
    jacobian = system.jacobian(state)
    assert jacobian @ frame == pytest.approx(whole @ frame, abs=1e-10 * float(abs(jacobian).max()))
    assert np.linalg.matrix_rank(jacobian, tol=1e-9) <= 4


@cache
def states(name: str) -> Array:
    found: Array = begun(name, 12).states[[4, 7]]
    return found


# --- the contract, and the exact engine -----------------------------------------------------------


@pytest.mark.parametrize("check", map_checks, ids=check_name)
def test_it_is_a_map(check: MapCheck) -> None:
    check(BOB, states("bob"))


@pytest.mark.parametrize("name", ["bob, contact", "bowl", "arm"])
def test_its_derivative_is_that_of_differences(name: str) -> None:
    jacobian_is_the_derivative(SYSTEMS[name], states(name))


@pytest.mark.parametrize(("frequency", "amplitude"), [(0.9, 0.1), (0.408, 0.3)])
def test_a_function_that_is_a_coordinate_is_that_coordinate(
    frequency: float, amplitude: float
) -> None:
    own: dict[str, Any] = {"amplitude": amplitude, "restitution": 0.6, "phase": 0.3}
    exact = Pair(frequency=frequency, elements=[HardStop(1, **own)])
    named = Pair(frequency=frequency, elements=[HardStop("second", **own)])
    assert (exact.engine, named.engine) == ("exponential sums", "Taylor")
    start: dict[str, Any] = {"position": [0.5, 1.0]}
    one, two = (s.simulate(impacts=50, start=s.state(**start)) for s in (exact, named))
    assert len(one.sticking) == len(two.sticking)
    assert (frequency == 0.9) == (not len(one.sticking))
    allowed = one.error + two.error
    for a, b in ((one.position, two.position), (one.velocity, two.velocity)):
        assert (abs(a - b).max(axis=1) <= allowed).all()
    assert (allowed < 1e-10).all()


@pytest.mark.parametrize("name", SYSTEMS)
def test_numbers_are_those_of_optimised_code(name: str) -> None:
    begun(name, 2)
    modes: Any = SYSTEMS[name]._automaton.modes
    charts = [chart for mode in modes for chart in mode._charts._kept.values()]
    assert {chart.integrator.llvm_state.opt_level for chart in charts} == {3}


# --- sixty digits ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bob", "bowl", "arm"])
def test_impacts_are_those_of_sixty_digits(name: str) -> None:
    system, record = SYSTEMS[name], begun(name, 2 if name == "arm" else 4)
    x, v = record.start.position, record.start.velocity
    with ctx.workprec(BITS):
        start = [*(arb(y) for y in (*x.tolist(), *v.tolist())), arb(0)]
        exact = Exact(system).after(start, record.time)
        rates = [Exact(system).rate(s[1:]) for s in exact]
    n = system.degrees_of_freedom
    for k, (time, *state) in enumerate(exact):
        off = [float(a - arb(b)) for a, b in zip(state, record.position[k].tolist(), strict=False)]
        off += [
            float(a - arb(b))
            for a, b in zip(state[n : 2 * n], record.velocity[k].tolist(), strict=True)
        ]
        off += [float(time - arb(float(record.time[k])))]
        off += [float(rates[k] - arb(float(record.relative_velocity[k])))]
        assert max(map(abs, off)) <= record.error[k] < 1e-11


@pytest.mark.parametrize("name", ["bob", "bowl", "arm"])
def test_the_jacobian_is_that_of_sixty_digits(name: str) -> None:
    system, state = SYSTEMS[name], states(name)[0]
    n, exact, small = system.degrees_of_freedom, Exact(SYSTEMS[name]), 1e-12
    begin = system.impact_state(state)
    time = system.simulate(impacts=1, start=begin).time[0]
    # a disturbance that stays on the stop: of velocities, and of the phase with the positions
    row = system._curves[0].gradient(begin.position)
    moving = np.linspace(0.5, 1.0, n)
    stop, w = exact.stop, system.frequency
    sine, cosine = math.sin(state[-1] - stop.phase), math.cos(state[-1] - stop.phase)
    climb = stop.amplitude * cosine * row / (row @ row)
    with ctx.workprec(BITS):
        ends = []
        for sign in (1, -1):
            d = sign * small
            x = [arb(y) + arb(d) * arb(c) for y, c in zip(begin.position, climb, strict=True)]
            v = [arb(y) + arb(d) * arb(c) for y, c in zip(begin.velocity, moving, strict=True)]
            ((_, *end),) = exact.after([*x, *v, arb(float(state[-1])) + arb(d)], [time])
            ends.append([*end[: 2 * n], exact.rate(end), end[-1]])
        change = [float((p - q) / (2 * arb(small))) for p, q in zip(*ends, strict=True)]
    bend = system._curves[0].bend(begin.position, begin.velocity)
    rate = stop.sign * (bend @ climb + row @ moving + w * stop.amplitude * sine)
    found = system.jacobian(state) @ [*climb, *moving, rate, 1.0]
    assert np.linalg.norm(found - change) <= 1e-10 * np.linalg.norm(change)


def test_a_ball_that_slides_leaves_the_bowl_where_it_does_in_sixty_digits() -> None:
    still = SLIDING.replace(**{"floor.amplitude": 0.0})
    x = 0.5
    begin = still.state(position=[x, 0.4 * x**2], velocity=[0.3, 0.8 * x * 0.3])
    record = still.simulate(impacts=1, start=begin)
    ((start, release),) = record.sticking
    assert start == 0.0
    exact = Exact(still)
    with ctx.workprec(BITS):
        s = [arb(y) for y in (*begin.position.tolist(), *begin.velocity.tolist(), 0.0)]
        time, s = exact.until(s, release, held=True)
        length, s = exact.until(s, float(arb(float(record.time[0])) - time))
        s = exact.hit(s)
    assert abs(float(time - arb(release))) < 1e-12
    assert abs(float(time + length - arb(float(record.time[0])))) <= record.error[0]
    off = [float(a - arb(b)) for a, b in zip(s, record.position[0].tolist(), strict=False)]
    off += [float(a - arb(b)) for a, b in zip(s[2:4], record.velocity[0].tolist(), strict=True)]
    assert max(map(abs, off)) <= record.error[0] < 1e-11


# --- closed forms ---------------------------------------------------------------------------------


def test_a_ball_in_a_bowl_keeps_its_energy_but_for_what_impacts_take() -> None:
    system = Bowl(
        frequency=2.0, constant_forces=(0.0, -1.0), elements=floor(amplitude=0.0, restitution=0.9)
    )
    begin = system.state(position=[0.5, 1.0], velocity=[0.1, 0.0])
    record = system.simulate(impacts=20, start=begin)
    energy = 0.5 * (record.velocity**2).sum(axis=1) + record.position[:, 1]
    # the normal part of the velocity before an impact is u / r
    row = np.stack([-0.8 * record.position[:, 0], np.ones(20)], axis=1)
    normal = record.relative_velocity**2 / (row**2).sum(axis=1)
    lost = 0.5 * normal * (1.0 / 0.9**2 - 1.0)
    expected = 0.5 * 0.1**2 + 1.0 - np.cumsum(lost)
    assert energy == pytest.approx(expected, abs=1e-12)
    assert abs(system._curves[0](record.position)).max() < 1e-14
    # tangents: an impact changes no velocity along the bowl, and flights are parabolas
    times = 0.5 * (record.time[1:] + record.time[:-1])
    x, _ = record.sample(times)
    flight = times - record.time[:-1]
    fall = record.position[:-1] + record.velocity[:-1] * flight[:, None]
    fall[:, 1] -= 0.5 * flight**2
    assert abs(x - fall).max() < 1e-12


# --- contact --------------------------------------------------------------------------------------


def test_in_contact_the_gap_is_zero_and_the_floor_presses() -> None:
    record = begun("bob, contact", 100)
    assert len(record.sticking) >= 5
    begin, end = record.sticking[1]
    times = np.linspace(begin, end, 9)[1:-1]
    x, v = record.sample(times)
    turn = 2.7 * times
    assert abs(1.0 - np.cos(x[:, 0]) - 0.3 - 0.1 * np.sin(turn)).max() < 1e-13
    assert abs(np.sin(x[:, 0]) * v[:, 0] - 0.27 * np.cos(turn)).max() < 1e-12
    force = record.observable("floor.contact_force", np.append(times, end))
    assert (force[:-1] > 0.0).all()
    assert abs(force[-1]) < 1e-12
    a = (-0.729 * np.sin(turn) - np.cos(x[:, 0]) * v[:, 0] ** 2) / np.sin(x[:, 0])
    balance = (a + np.sin(x[:, 0]) + 0.05 * v[:, 0]) / np.sin(x[:, 0])
    assert force[:-1] == pytest.approx(balance, abs=1e-11)
    assert str(STICKING_BOB.attractor(start=record.final, transient=50).label) == "P(inf,1)"


def test_a_ball_slides_through_its_bowl() -> None:
    begin = SLIDING.state(position=[0.8, 1.0])
    record = SLIDING.simulate(impacts=60, start=begin)
    assert len(record.sticking) > 3
    spans = record.sticking[:-1]
    times = np.concatenate([np.linspace(a, b, 5)[1:-1] for a, b in spans])
    x, v = record.sample(times)
    assert abs(x[:, 1] - 0.4 * x[:, 0] ** 2 - 0.02 * np.sin(3.0 * times)).max() < 1e-12
    rate = v[:, 1] - 0.8 * x[:, 0] * v[:, 0] - 0.06 * np.cos(3.0 * times)
    assert abs(rate).max() < 1e-12


@pytest.mark.parametrize(
    ("system", "position"), [(STICKING_BOB, [1.5]), (SLIDING, [0.8, 1.0])], ids=["bob", "sliding"]
)
def test_bounces_that_are_left_out_change_no_more_than_is_said(
    system: Any, position: list[float]
) -> None:
    omitted_bounces_are_within_the_error(system, position=position)


@pytest.mark.parametrize("name", SYSTEMS)
def test_energies_balance(name: str) -> None:
    balance = begun(name, 30).energy_balance()
    assert balance.error < 1e-12
    assert balance.dissipated["floor"] > 0.0


# --- what everything else does with it ------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_simulation_goes_on_from_its_end_bit_for_bit(name: str) -> None:
    system = SYSTEMS[name]
    whole, half = begun(name, 20), begun(name, 10)
    rest = system.simulate(impacts=10, start=half.final)
    assert np.concatenate([half.states, rest.states]).tobytes() == whole.states.tobytes()
    again = pickle.loads(pickle.dumps(system))
    assert again == system
    start = again.state(**STARTS[name])
    assert again.simulate(impacts=3, start=start).states.tobytes() == whole.states[:3].tobytes()


def test_another_value_of_a_parameter_compiles_nothing() -> None:
    system: Any = BOB.replace(length=1.1)
    system.simulate(impacts=3, start=system.state(position=[1.5]))
    before = taylor_chart._integrator.cache_info().misses
    for name in ("drag", "length", "frequency", "floor.amplitude", "floor.offset"):
        changed = system.replace(**{name: 1.03 * system.parameters[name]})
        changed.simulate(impacts=3, start=changed.state(position=[1.5]))
        assert changed.identity != system.identity
    assert taylor_chart._integrator.cache_info().misses == before


def test_orbits_and_branches() -> None:
    system: Any = Bob(frequency=4.0, elements=floor(amplitude=0.05, offset=0.3, restitution=0.9))
    attractor = system.attractor(start=system.state(position=[1.5]), transient=300)
    assert str(attractor.label) == "P(1,1)"
    orbit = attractor.periodic_orbit()
    assert orbit.residual < 1e-12
    known = np.linalg.eigvals(system.jacobian(orbit.states[0]))
    assert orbit.multipliers_resolved.tolist() == [True, True]
    assert np.poly([*orbit.multipliers, 0.0, 0.0]) == pytest.approx(np.poly(known), abs=1e-9)
    spectrum = LyapunovSpectrum(attractor, iterations=128)
    sizes = np.log(abs(orbit.multipliers))
    assert spectrum.exponents.sum() == pytest.approx(sizes.sum(), abs=1e-6)
    branch = continue_orbit(orbit, "floor.amplitude", bounds=(0.049, 0.051))
    there = system.replace(**{"floor.amplitude": float(branch.parameter[0])})
    settled = there.attractor(start=attractor.final, transient=300).states[-1]
    assert abs(branch.orbit(0).states[0] - settled).max() < 1e-8


def test_figures() -> None:
    record = begun("bowl", 5)
    record.plot()
    BOWL.plot()
    record.animate(frames=2)._draw_was_started = True
    plt.close("all")


# --- refusals -------------------------------------------------------------------------------------


class Wrong(Bob):
    def corner(self, x: Any) -> Any:
        return sp.Abs(x[0])

    def constant(self, x: Any) -> Any:
        return sp.Integer(2)

    def strange(self, x: Any) -> Any:
        return x[0] + sp.Symbol("y")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("depth", "coordinate must be the name of a method of the oscillator; got 'depth'"),
        ("drag", "coordinate must be the name of a method of the oscillator; got 'drag'"),
        ("not a name", "coordinate must be a name like 'height'; got 'not a name'"),
        ("corner", "corner must be made of smooth functions; got Abs"),
        ("constant", "constant must depend on the coordinates; got 2"),
        ("strange", "strange must be an expression in x_1, ...; got y"),
    ],
)
def test_functions_that_cannot_be_followed_are_named(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _ = Wrong(frequency=1.0, elements=[HardStop(name)]).engine


def test_a_start_beyond_the_stop_is_refused() -> None:
    with pytest.raises(Refused, match=r"height of the position must not be below stop 'floor' at"):
        BOB.state(position=[0.1])
    with pytest.raises(Refused, match="position must be given"):
        _ = Bob(frequency=1.0, elements=floor(offset=3.0)).default_start


def test_structures_by_matrices_and_chains_take_it() -> None:
    class Matrix(MatrixOscillator):
        def height(self, x: Any) -> Any:
            return x[1] + x[0] ** 2 / 4

    class Chain(ImpactChain):
        def height(self, x: Any) -> Any:
            return x[-1] + x[0] ** 2 / 4

    stop = floor(amplitude=0.1)
    chain = Chain(masses=2, frequency=0.9, elements=stop)
    matrix = Matrix(
        M=chain.mass, C=chain.damping_matrix, K=chain.stiffness, frequency=0.9, elements=stop
    )
    assert chain.engine == matrix.engine == "Taylor"
    one, two = (system.simulate(impacts=20) for system in (chain, matrix))
    assert abs(one.states - two.states).max() <= one.error[-1] + two.error[-1] < 1e-11


def test_a_soft_stop_beside_it() -> None:
    beside = [
        *floor(offset=0.3, amplitude=0.05),
        SoftStop(0, offset=2.0, stiffness=9.0, side="below"),
    ]
    system: ImpactOscillator = Bob(frequency=2.0, elements=beside)
    record = system.simulate(impacts=20, start=system.state(position=[1.9], velocity=[1.0]))
    assert record.energy_balance().error < 1e-12
    assert record.error[-1] < 1e-10
