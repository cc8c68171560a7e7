"""Impact laws: restitution that depends on the approach velocity."""

import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest
import sympy
from mpmath import mp

import dynkit
from dynkit import sweep
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.no_motion import NoDerivative
from dynkit.core.validation import Array
from dynkit.systems import (
    BouncingBall,
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactLaw,
    MatrixOscillator,
    PlasticBelow,
    PlayOscillator,
    ViscoelasticSpheres,
)
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.own_laws import Constant, Hardening, Rooted
from tests.reference.friction import in_many_digits

LAWS = [
    ViscoelasticSpheres(0.8),
    ViscoelasticSpheres(0.8, second=0.2),
    PlasticBelow(0.02, rebound=0.8),
    Hardening(0.5, 1.0),
    Constant(0.7),
    Rooted(1.5, 0.3),
]


def ball(law: Any, tolerance: float = 1e-16) -> MatrixOscillator:
    """A unit mass under a unit weight above a floor at rest."""
    return MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        constant_forces=[-1.0],
        amplitude=0.0,
        restitution=law,
        chatter_tolerance=tolerance,
    )


def dropped(law: ImpactLaw, speed: float, count: int) -> tuple[list[Any], list[Any]]:
    """Times of impacts of a ball thrown up, and how fast it leaves, in many digits."""
    r, u, time = in_many_digits(law), mp.mpf(speed), mp.mpf(0)
    times, speeds = [], []
    for _ in range(count):
        time += 2 * u
        u = r(u) * u
        times.append(time)
        speeds.append(u)
    return times, speeds


# --- the law itself -------------------------------------------------------------------------------


@pytest.mark.plain
@pytest.mark.parametrize("law", LAWS)
def test_values_and_slopes_are_those_of_the_expression(law: ImpactLaw) -> None:
    r, velocities = in_many_digits(law), 10.0 ** np.linspace(-12.0, 1.0, 40)
    with mp.workdps(40):
        for u in velocities.tolist():
            assert law.at(u) == pytest.approx(float(r(mp.mpf(u))), rel=1e-14, abs=1e-16)
            slope = mp.diff(lambda x: r(x) * x, mp.mpf(u), h=mp.mpf(u) * mp.mpf(10) ** -12)
            assert law.slope(np.array([u]))[0] == pytest.approx(float(slope), rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("second", [0.3, 0.1, 0.2])
@pytest.mark.parametrize("first", [0.3, 0.1, 0.2])
def test_laws_of_one_shape_have_their_own_numbers(first: float, second: float) -> None:
    """Equal numbers are one number of the code, different ones are two."""
    law = ViscoelasticSpheres(first, second)
    expected = 1.0 - first * 1e-4**0.2 + second * 1e-4**0.4
    assert law.at(1e-4) == pytest.approx(expected, rel=1e-15)
    assert PlasticBelow(first, second).at([0.15, 0.25]).tolist() == [
        second * (first <= 0.15),
        second * (first <= 0.25),
    ]


u = sympy.Symbol("u", positive=True)


@pytest.mark.plain
@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (sympy.Min(1, u) / 2 + sympy.Abs(u - 2) / 10, lambda x: min(1, x) / 2 + abs(x - 2) / 10),
        (sympy.Piecewise((u / 4, u <= 1), (0.5, (u > 2) & (u < 3)), (0.1, True)), None),
        (sympy.Piecewise((0.3, (u < 1) | (u >= 2)), (0.6, True)), None),
        (sympy.cos(u) ** 2 * sympy.atan(u) / 2 + sympy.sin(u) ** 2 / 5, None),
        ((1 - sympy.log(u + 1) * sympy.tanh(u) / 9) * sympy.exp(-u) + sympy.pi / 100, None),
        (1 / (1 - sympy.log(u / 9)), None),
    ],
)
def test_any_function_of_the_list_is_evaluated(
    expression: Any, value: Callable[[float], float] | None
) -> None:
    @dataclass(frozen=True)
    class Own(ImpactLaw):
        def expression(self, velocity: Any) -> Any:
            return expression.subs(u, velocity)

    law = Own()
    other: Any = value or sympy.lambdify(u, expression, "mpmath")
    for x in (0.2, 0.9, 1.0, 1.5, 2.0, 2.4, 3.5):
        assert law.at(x) == pytest.approx(float(other(x)), rel=1e-13)
        slope = (law.at(x + 1e-6) * (x + 1e-6) - law.at(x - 1e-6) * (x - 1e-6)) / 2e-6
        if x not in (1.0, 2.0):
            assert law.slope(np.array([x]))[0] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("speed", [1e-8, 1e-3, 0.5])
def test_the_sum_of_all_bounces_is_that_of_many_digits(law: ImpactLaw, speed: float) -> None:
    with mp.workdps(25):
        r, v, total = in_many_digits(law), mp.mpf(speed), mp.mpf(0)
        count = 10_000 if law.tail[0] == 1.0 else 400
        for _ in range(count):
            total += v
            v *= r(v)
        found, rest = (float(law.bounces(np.array([float(u)]))[0]) for u in (speed, v or 1.0))
        # beyond 4096 of them the kernel takes a series in x < 1/(4096 p), up to x^2 of it
        assert found == pytest.approx(float((total + v * rest) / speed), rel=(5 / 4096) ** 2)


def test_a_law_that_loses_too_little_at_slow_impacts_never_ends() -> None:
    for law in (Rooted(0.4, 1.0), Rooted(0.0, 0.5), ViscoelasticSpheres(0.0), Constant(1.0)):
        assert np.isinf(law.bounces(np.array([1e-3])))
        record = ball(law).simulate(impacts=300, start=ball(law).state([0.0], [0.3]))
        assert record.ending is Ending.COUNT_REACHED
        assert not len(record.sticking)


@pytest.mark.parametrize(
    ("expression", "tail"),
    [
        (sympy.exp(-0.4 * u**0.5), (1.0, 0.4, 0.5, 0.08, 1.0)),
        (sympy.Max(0, 1 - 0.3 * u ** sympy.Rational(1, 5)), (1.0, 0.3, 0.2, 0.0, 0.0)),
        (1 - 0.4 * sympy.tanh(u**0.3), (1.0, 0.4, 0.3, 0.4 / 3, 0.9)),
        (1 - 0.3 * u**0.2 + 0.05 * u, (1.0, 0.3, 0.2, 0.05, 1.0)),
        (1 - sympy.sqrt(u) * sympy.log(1 + 1 / u) / 9, (1.0, 0.0, 0.0, 0.0, 0.0)),
        (1 / (1 + u), (1.0, 0.0, 0.0, 0.0, 0.0)),
        (0.9 - u**0.5, (0.9, 0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_how_slow_impacts_rebound_is_found(expression: Any, tail: tuple[float, ...]) -> None:
    found = law_of(lambda velocity: expression.subs(u, velocity))
    assert found.tail == pytest.approx(tail, rel=1e-9)


# --- motions --------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
def test_a_ball_bounces_as_in_many_digits(law: ImpactLaw) -> None:
    system = ball(law)
    record = system.simulate(impacts=40, start=system.state([0.0], [1.2]))
    count = len(record)
    assert count >= 5
    with mp.workdps(40):
        times, left = dropped(law, 1.2, count)
        late = np.array(
            [float(mp.mpf(t) - e) for t, e in zip(record.time.tolist(), times, strict=True)]
        )
        speeds = np.array(list(map(float, left)))
    assert (abs(record.relative_velocity - speeds) <= record.error).all()
    assert (abs(late) <= record.error + 2.0**-50 * record.time).all()
    assert record.error.max() < 1e-11


@pytest.mark.parametrize("law", [ViscoelasticSpheres(0.3), ViscoelasticSpheres(0.6, 0.2)])
def test_chatter_of_viscoelastic_spheres_ends_where_the_bounces_add_up(
    law: ViscoelasticSpheres,
) -> None:
    system = ball(law)
    record = system.simulate(impacts=5000, start=system.state([0.0], [1.2]))
    assert record.ending is Ending.CONTACT_FOR_EVER
    ((begin, end),) = record.sticking.tolist()
    assert end == np.inf
    with mp.workdps(30):
        c, e = mp.mpf(law.dissipation), mp.mpf(law.second)
        times, speeds = dropped(law, 1.2, 30_000)
        v = speeds[-1]  # 1e-16: the rest takes 2 v (5/(4 x) - 1/10 + E/C^2 + O(x)), x = C v^(1/5)
        rest = 2 * v * (mp.mpf(5) / 4 / (c * v ** mp.mpf("0.2")) - mp.mpf(1) / 10 + e / c**2)
        expected = float(times[-1] + rest)
    assert begin == pytest.approx(expected, abs=1e-12)
    # as the paper of the law says: (5/2) u^(4/5) / (a C), the smaller u the closer
    u, left = float(record.relative_velocity[-1]), expected - record.time[-1]
    if not law.second:
        assert left == pytest.approx(2.5 * u**0.8 / law.dissipation, rel=0.02)


def test_a_plastic_law_sticks_at_the_first_slow_impact() -> None:
    system = ball(PlasticBelow(0.3, rebound=0.8))
    record = system.simulate(impacts=50, start=system.state([0.0], [1.0]))
    # 0.8^5 = 0.328 is the last rebound that is fast enough to rebound again
    assert record.relative_velocity == pytest.approx(
        [0.8, 0.64, 0.512, 0.4096, 0.32768, 0.262144, 0.0]
    )
    assert record.ending is Ending.CONTACT_FOR_EVER
    assert record.sticking[0, 0] == pytest.approx(record.time[-1], rel=1e-15)
    assert record.chatter_error == 0.0


@pytest.mark.parametrize("frequency", [0.87, 0.408])
def test_a_constant_law_does_what_its_number_does(frequency: float) -> None:
    number = ImpactChain(frequency=frequency)
    law = number.replace(restitution=Constant(0.85))
    one, other = (system.simulate(impacts=120) for system in (number, law))
    assert len(one.sticking) == len(other.sticking)
    assert abs(number.difference(one.states, other.states)).max() <= 1e-13
    assert (abs(number.difference(one.states, other.states)).max(axis=1) <= one.error).all()
    assert other.sticking == pytest.approx(one.sticking, abs=1e-13)


@pytest.mark.parametrize("law", LAWS)
def test_where_a_chatter_is_cut_makes_no_difference(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=4, frequency=0.08, restitution=law, amplitude=0.3)
    cut, later = (
        chain.replace(chatter_tolerance=tolerance).simulate(impacts=4000)
        for tolerance in (1e-15, 1e-18)
    )
    # the last contact of a record need not have ended
    count = min(len(cut.sticking), len(later.sticking), 4) - 1
    assert count >= 1
    assert cut.sticking[:count] == pytest.approx(later.sticking[:count], abs=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_the_energy_balance_closes(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=4, frequency=0.3, restitution=law, amplitude=0.3)
    balance = chain.simulate(impacts=200).energy_balance()
    size = sum(map(abs, balance.work.values())) + abs(balance.change)
    assert balance.error < 1e-12 * size
    assert balance.dissipated["table"] > 0.0


@pytest.mark.parametrize("law", [ViscoelasticSpheres(0.8), Hardening(0.5, 1.0)])
def test_moments_and_samples_are_those_of_the_bounces(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=2, frequency=0.3, restitution=law, amplitude=0.3)
    record = chain.simulate(impacts=300)
    assert len(record.sticking) >= 1
    moments = record.second_moments()
    times = np.linspace(0.0, record.time[-1], 400_001)
    x, _ = record.sample(times)
    gap = x[:, -1] - 0.3 * np.sin(0.3 * times)
    assert gap.min() > -1e-12
    mean = np.trapezoid(x, times, axis=0) / times[-1]
    assert abs(moments.sums.sum(axis=0) / times[-1] - mean).max() < 1e-6
    # in the bounces that are left out the gap is that of a parabola between their impacts
    begin = record._run.switches.time[0]
    rest, speed = record._run.switches.rest[0], record._run.switches.speed[0]
    inside = begin + rest * np.linspace(0.0, 1.0, 2001)
    x, v = record.sample(inside)
    gap = x[:, -1] - 0.3 * np.sin(0.3 * inside)
    assert gap.min() >= -1e-15
    assert gap.max() < speed * rest
    assert abs(v[0, -1] - 0.3 * 0.3 * np.cos(0.3 * begin) - speed) < 1e-12


def test_a_far_stop_has_the_same_law() -> None:
    law = ViscoelasticSpheres(0.4)
    pair = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=law)
    record = pair.simulate(impacts=60)
    assert (record.relative_velocity < 0.0).any()
    before = abs(record.velocity[:-1, 0] - 0.0)
    assert before.max() < 10.0
    balance = record.energy_balance()
    assert balance.error < 1e-12 * max(1.0, sum(map(abs, balance.work.values())))


# --- derivatives ----------------------------------------------------------------------------------


def slopes_agree(chain: Any, states: Array, step: float = 1e-7) -> int:
    checked = 0
    for state in states:
        exact = chain.jacobian(state)
        for k in range(chain.dimension):
            move = step * np.eye(chain.dimension)[k]
            change = chain.difference(chain(state + move), chain(state - move)) / (2.0 * step)
            assert abs(exact[:, k] - change).max() < 2e-6 * max(1.0, abs(exact).max())
        checked += 1
    return checked


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_are_differences(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=2, frequency=0.87, restitution=law)
    record = chain.simulate(impacts=60)
    fast = record.relative_velocity[40:] > 0.01
    assert slopes_agree(chain, record.states[40:][fast][:6]) >= 3


@pytest.mark.parametrize("side", [0.9, 1.1])
def test_derivatives_are_right_on_both_sides_of_a_jump(side: float) -> None:
    chain = ImpactChain(masses=2, frequency=0.87, restitution=0.8)
    state = chain.simulate(impacts=60).states[-1]
    hit = chain(state)[-2] / 0.8
    law = PlasticBelow(hit * side, rebound=0.8)
    jumping = chain.replace(restitution=law)
    exact = jumping.jacobian(state)
    assert slopes_agree(jumping, state[None]) == 1
    assert np.linalg.matrix_rank(exact) == (4 if side < 1.0 else 3)
    with pytest.raises(NoDerivative, match="the impact law jumps at the approach velocity"):
        chain.replace(restitution=PlasticBelow(hit, rebound=0.8)).jacobian(state)


def test_an_impact_at_a_jump_has_a_large_error() -> None:
    system = ball(PlasticBelow(0.4, rebound=0.8))
    record = system.simulate(impacts=2, start=system.state([0.0], [0.5]))  # 0.8 * 0.5
    assert record.error[-1] > 0.1
    apart = ball(PlasticBelow(0.41, rebound=0.8))
    assert apart.simulate(impacts=2, start=apart.state([0.0], [0.5])).error[-1] < 1e-13


@pytest.mark.parametrize("law", LAWS)
def test_tangents_stretch_as_derivatives_do(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=2, frequency=0.87, restitution=law)
    attractor = chain.attractor()
    n = attractor.label.iterates
    assert n is not None
    # over a period: coordinates in which disturbances are followed change by nothing
    factors = [chain.jacobian(state) for state in attractor.states[:n]]
    logs = chain.stretching(attractor.states[0], 40 * n).logs[20 * n :]
    volume = sum(np.linalg.slogdet(factor)[1] for factor in factors)
    assert logs.sum() == pytest.approx(20 * volume, abs=1e-6)
    product = np.linalg.multi_dot([np.eye(chain.dimension), *factors[::-1]])
    largest = np.log(abs(np.linalg.eigvals(product)).max())
    spectrum = LyapunovSpectrum(attractor, iterations=200 * n)
    assert spectrum.exponents[0] * n == pytest.approx(largest, abs=0.01)


def test_parameter_derivatives_of_a_law_are_those_of_differences() -> None:
    chain = ImpactChain(masses=2, frequency=0.87, restitution=Hardening(0.5, 1.0))
    state = chain.simulate(impacts=60).states[-1]
    for name in ("amplitude", "restitution.low", "restitution.scale"):
        found, value, step = chain.parameter_derivative(state, name), chain.parameters[name], 1e-6
        there, back = (chain.replace(**{name: value + d})(state) for d in (step, -step))
        assert found == pytest.approx(chain.difference(there, back) / (2.0 * step), abs=1e-7)


# --- parameters, files, processes -----------------------------------------------------------------


def test_numbers_of_a_law_are_parameters() -> None:
    machine = ImpactChain(
        masses=2,
        frequency=0.9,
        elements=[HardStop(1, restitution=PlasticBelow(0.02), amplitude=0.1, name="table")],
    )
    assert machine.parameters["table.restitution.velocity"] == 0.02
    other = machine.replace(**{"table.restitution.rebound": 0.6, "table.amplitude": 0.2})
    assert other.elements[0].restitution == PlasticBelow(0.02, rebound=0.6)
    assert other.elements[0].amplitude == 0.2
    plain = ImpactChain(masses=2, frequency=0.9, restitution=PlasticBelow(0.02))
    assert plain.parameters["restitution.velocity"] == 0.02
    assert plain.replace(**{"restitution.velocity": 0.5}).restitution == PlasticBelow(0.5)
    for system, name in ((machine, "table.restitution.velocity"), (plain, "restitution.velocity")):
        found = sweep(system, name, [0.01, 0.2], transient=30, keep=5)
        alone = system.replace(**{name: 0.2}).attractor(transient=30, keep=5)
        assert len(found.values) == 2
        assert alone.record.relative_velocity.shape == (5,)


@pytest.mark.parametrize("law", LAWS)
def test_laws_travel_between_processes(law: ImpactLaw) -> None:
    chain = ImpactChain(masses=2, frequency=0.9, restitution=law)
    states = chain.simulate(impacts=20).states
    again = pickle.loads(pickle.dumps(chain))
    assert again == chain
    assert again.restitution == law
    assert np.array_equal(again.simulate(impacts=20).states, states)


def test_processes_sweep_laws_of_ones_own() -> None:
    chain = ImpactChain(masses=2, frequency=0.9, restitution=Hardening(0.5, 1.0))
    asked: Any = {"parameter": "restitution.low", "values": [0.3, 0.6], "transient": 30, "keep": 5}
    asked |= {"follow": False, "progress": False}
    alone = sweep(chain, **asked)
    with ProcessPoolExecutor(1, get_context("spawn")) as executor:
        there = sweep(chain, **asked, executor=executor)
    assert np.array_equal(
        there.observable("relative_velocity"), alone.observable("relative_velocity")
    )


def test_a_store_knows_the_law(tmp_path: Any) -> None:
    chain = ImpactChain(masses=2, frequency=0.9, restitution=Hardening(0.5, 1.0))
    other = chain.replace(**{"restitution.low": 0.6})
    from dynkit.data.store import identity_of

    assert identity_of(chain) != identity_of(other)
    assert "u/(u + 1.0)" in identity_of(chain)["system.law"]
    assert "system.law" not in identity_of(chain.replace(restitution=0.8))
    found = sweep(chain, "frequency", [0.9, 0.95], transient=30, keep=5)
    found.save(tmp_path / "sweep.h5")
    assert type(found).load(tmp_path / "sweep.h5", chain).values.tolist() == [0.9, 0.95]
    with pytest.raises(ValueError, match="restitution"):
        type(found).load(tmp_path / "sweep.h5", other)


def test_no_law_is_compiled_for() -> None:
    from dynkit.systems.impact.simulation import loop_kernels as kernels

    chain = ImpactChain(masses=2, frequency=0.9, restitution=LAWS[0])
    chain.simulate(impacts=5)  # what a number does not need is compiled by the first law
    compiled: Any = kernels.run
    before = len(compiled.signatures)
    for law in LAWS[1:]:
        chain.replace(restitution=law).simulate(impacts=5)
    assert len(compiled.signatures) == before


def test_orbits_by_impulses_refuse_a_law_and_those_of_the_map_do_not() -> None:
    chain = ImpactChain(frequency=0.87, restitution=ViscoelasticSpheres(0.2))
    attractor = chain.attractor()
    assert str(attractor.label) == "P(1,3)"
    orbit = attractor.periodic_orbit()
    assert orbit.error < 1e-10
    assert abs(orbit.multipliers).max() == pytest.approx(abs(attractor.label.multiplier), rel=1e-5)
    with pytest.raises(NotImplementedError, match="ViscoelasticSpheres"):
        chain.periodic_orbit(phases=[0.1], periods=3)
    assert dynkit.periodic_orbit(chain, attractor.states[-1:]).stable


# --- refusals -------------------------------------------------------------------------------------


def law_of(expression: Any) -> ImpactLaw:
    @dataclass(frozen=True)
    class Given(ImpactLaw):
        def expression(self, velocity: Any) -> Any:
            return expression(velocity)

    return Given()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PlasticBelow(-0.1), "velocity must not be negative; got -0.1"),
        (lambda: PlasticBelow(0.1, rebound=1.2), r"rebound must lie in \[0, 1\]; got 1.2"),
        (lambda: ViscoelasticSpheres(np.nan), "dissipation must be"),
        (lambda: Hardening("x", 1.0), "low must be"),  # type: ignore[arg-type]
        (lambda: HardStop(0, restitution="soft"), "restitution must be"),  # type: ignore[arg-type]
        (lambda: HardStop(0, restitution=1.5), r"restitution must lie in \[0, 1\]; got 1.5"),
        (lambda: law_of(lambda u: "u").at(1.0), "expression must return a SymPy expression"),
        (lambda: law_of(lambda u: u * sympy.Symbol("c")).at(1.0), "the velocity alone; got c, too"),
        (lambda: law_of(sympy.gamma).at(1.0), "expression must be made of .*; got gamma"),
        (lambda: Hardening(-0.5, 1.0).at(0.1), r"restitution must lie in \[0, 1\]; got -0.36"),
    ],
)
def test_bad_laws_are_refused_by_name(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_a_law_may_have_many_operations() -> None:
    law = law_of(lambda u: (60 + sum(sympy.sin(k * u) for k in range(1, 60))) / 120)
    velocities = np.array([1e-3, 0.1, 1.0, 3.0])
    expected = (60 + sum(np.sin(k * velocities) for k in range(1, 60))) / 120
    assert np.allclose(law.at(velocities), expected, rtol=0.0, atol=1e-14)


def test_the_slope_of_a_law_with_steps_is_that_between_them() -> None:
    law = law_of(lambda u: (1 + sympy.floor(4 * u) / 8) * sympy.Rational(1, 2))
    velocities = np.array([0.1, 0.3, 0.6])
    assert law.slope(velocities) == pytest.approx(law.at(velocities), rel=1e-15)


def test_laws_that_differ_in_numbers_share_their_machine_code() -> None:
    one, other = Hardening(0.3, 1.0), Hardening(0.2, 2.0)
    assert one._program.code is other._program.code
    assert one.at(0.4) != other.at(0.4)


def test_a_law_that_leaves_its_range_is_refused_where_that_happens() -> None:
    chain = ImpactChain(masses=2, frequency=0.9, restitution=Hardening(0.2, -1.0))
    with pytest.raises(
        ValueError,
        match=r"\[0, 1\]; got -?\d.* by Hardening\(low=0.2, scale=-1.0\) at the approach velocity",
    ):
        chain.simulate(impacts=50)


def test_friction_may_turn_in_the_bounces_of_a_law() -> None:
    machine = ImpactChain(
        masses=2,
        frequency=0.4,
        elements=[
            HardStop(1, restitution=ViscoelasticSpheres(0.8), amplitude=0.3, name="table"),
            DryFriction(1, force=0.01),
        ],
    )
    one, other = (
        machine.replace(chatter_tolerance=tolerance).simulate(impacts=1500)
        for tolerance in (1e-15, 1e-17)
    )
    count = min(len(one.sticking), len(other.sticking)) - 1
    assert count >= 1
    assert abs(one.sticking[:count] - other.sticking[:count]).max() < 1e-9
    assert one.energy_balance().error < 1e-11


def test_a_bouncing_ball_takes_a_law() -> None:
    ball = BouncingBall(amplitude=0.1, frequency=3.0, restitution=PlasticBelow(0.1, rebound=0.5))
    assert ball.attractor().label.counts is None or len(ball.simulate(impacts=10))
    assert replace(PlasticBelow(0.1), rebound=0.4).rebound == 0.4


def test_a_law_of_an_element_is_replaced_by_a_number_or_another_law() -> None:
    stop = HardStop(1, amplitude=0.1, restitution=PlasticBelow(0.05, rebound=0.6), name="rock")
    machine = ImpactChain(masses=2, frequency=0.9, elements=[stop])
    for law in (0.7, ViscoelasticSpheres(0.2)):
        (replaced,) = machine.replace(**{"rock.restitution": law}).elements
        assert isinstance(replaced, HardStop)
        assert replaced.restitution == law
    with pytest.raises(ValueError, match=r"restitution must lie in \[0, 1\]; got 1.5"):
        machine.replace(**{"rock.restitution": 1.5})
