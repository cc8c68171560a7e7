"""Flows of expressions: sixty digits, the literature, derivatives, refusals, and no heyoka."""

from __future__ import annotations

import pickle
import sys
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.special import mathieu_a, mathieu_b

from dynkit import (
    Hyperplane,
    MapAttractor,
    PoincareMap,
    Stroboscope,
    continue_orbit,
    equilibrium,
    periodic_orbit,
)
from dynkit.analysis import LyapunovSpectrum, Sensitivity
from dynkit.core.no_motion import CannotFollow, Diverged, NoCrossing
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.section import PoincareSection
from dynkit.systems import (
    Brusselator,
    Chua,
    DoublePendulum,
    Duffing,
    HenonHeiles,
    IntegratedFlow,
    Lorenz,
    ParametricPendulum,
    Rossler,
    SymbolicFlow,
    VanDerPol,
)
from dynkit.systems.symbolic import taylor
from dynkit.testing import (
    FlowCheck,
    MapCheck,
    PoincareMapCheck,
    check_name,
    flow_checks,
    map_checks,
    numerical_derivative,
    poincare_map_checks,
)
from tests.flows import integrated_flows
from tests.flows.cases import FLOWS, STATES, Parabola, advanced_in_many_digits
from tests.flows.symbolic_flows import Cycle, EveryFunction, Explosion, Kicked, TodaRing
from tests.flows.test_accuracy import (
    DURATIONS,
    RANDOM_BOXES,
    RETURNS,
    crossing_in_many_digits,
    derivative_in_many_digits,
)

ROUNDING = 2.0**-52
SYMBOLIC: dict[str, SymbolicFlow] = {
    "duffing": Duffing(),
    "lorenz": Lorenz(),
    "rossler": Rossler(),
}
SHIPPED: dict[str, tuple[SymbolicFlow, list[list[float]]]] = {
    "van der pol": (VanDerPol(mu=2.0), [[1.0, 0.5], [-2.0, 1.0]]),
    "parametric pendulum": (ParametricPendulum(), [[0.5, 0.1, 0.2], [3.0, -0.4, 2.0]]),
    "chua": (Chua(), [[0.5, 0.1, -0.5], [1.5, -0.2, -1.0]]),
    "brusselator": (Brusselator(), [[1.0, 2.0], [0.5, 3.0]]),
    "henon heiles": (HenonHeiles(), [[0.1, 0.2, 0.3, -0.1], [0.0, -0.2, 0.4, 0.1]]),
    "double pendulum": (DoublePendulum(0.5, 1.5), [[0.5, -0.3, 0.2, 0.1], [2.0, 1.0, 0.0, 0.5]]),
    "every function": (EveryFunction(), [[0.5, 1.0], [-0.3, 0.2]]),
    "ring of Toda": (
        TodaRing(),
        [[0.1, 0.5, -0.3, 0.2, -0.1, 0.4], [1.0, 0.0, 0.0, 0.0, 0.5, 0.0]],
    ),
    "driven by time": (Kicked(), [[0.5, 0.1, 0.3], [1.0, -0.3, 2.0]]),
}


def at(*numbers: float) -> Array:
    return np.array(numbers)


# --- the contracts --------------------------------------------------------------------------------


@pytest.mark.parametrize("check", flow_checks, ids=check_name)
@pytest.mark.parametrize("name", [*SYMBOLIC, *SHIPPED])
def test_it_is_a_flow(name: str, check: FlowCheck) -> None:
    if name in SYMBOLIC:
        check(SYMBOLIC[name], STATES[name])
    else:
        flow, states = SHIPPED[name]
        check(flow, np.array(states))


PLANES: dict[str, tuple[str, PoincareSection, list[list[float]]]] = {
    "stroboscope": ("duffing", Stroboscope(3, phase=2.5), [[0.5, 0.2], [-1.2, 0.4]]),
    "maxima": (
        "duffing",
        Hyperplane(at(0.0, 1.0, 0.0), 0.0, -1, angles=[2]),
        [[1.2, 0.3], [-0.3, 2.0]],
    ),
    "parabola": ("duffing", Parabola(1, height=-0.1, bend=0.4), [[1.1, 0.3], [-0.8, 2.0]]),
    "plane": ("lorenz", Hyperplane(at(0.0, 0.0, 1.0), 27.0, -1), [[2.0, 2.0], [-3.0, 0.5]]),
    "oblique": ("lorenz", Hyperplane(at(1.0, -0.5, 0.2), 3.0), [[-8.0, 18.0], [-5.0, 16.0]]),
    "rossler": ("rossler", Hyperplane(at(1.0, 0.0, 0.0)), [[-8.0, 0.03], [-5.0, 0.03]]),
}


@pytest.mark.parametrize("check", [*poincare_map_checks, *map_checks], ids=check_name)
@pytest.mark.parametrize("name", PLANES)
def test_it_has_poincare_maps(name: str, check: PoincareMapCheck | MapCheck) -> None:
    flow, section, points = PLANES[name]
    check(PoincareMap(SYMBOLIC[flow], section, time_limit=50.0), np.array(points))


@pytest.mark.parametrize("name", PLANES)
def test_crossings_are_those_of_an_integrated_flow(name: str) -> None:
    flow, section, points = PLANES[name]
    for point in points:
        found, other = (
            PoincareMap(each, section, time_limit=50.0).crossing(np.array(point))
            for each in (SYMBOLIC[flow], FLOWS[flow])
        )
        allowed = FLOWS[flow].accuracy * (1.0 + float(np.linalg.norm(other.state)))
        assert found.state == pytest.approx(other.state, abs=allowed)
        assert found.time == pytest.approx(other.time, abs=allowed)


@pytest.mark.parametrize("name", SHIPPED)
def test_derivatives_of_the_velocity_are_those_of_differences(name: str) -> None:
    flow, states = SHIPPED[name]
    for state in np.array(states):
        found, error = numerical_derivative(flow.velocity, state)
        off = abs(flow.velocity_jacobian(state) - found)
        assert (off <= 20.0 * error + 1e-13 * abs(found).max()).all()
        for parameter in flow.parameters:
            by = flow.velocity_parameter_derivative(state, parameter)
            by_differences = Flow.velocity_parameter_derivative(flow, state, parameter)
            assert by == pytest.approx(by_differences, abs=1e-9 * (1.0 + float(abs(by).max())))


# --- sixty digits ---------------------------------------------------------------------------------


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", SYMBOLIC)
def test_actual_errors_lie_under_the_estimate(name: str, seed: int) -> None:
    flow, draw = SYMBOLIC[name].replace(), np.random.default_rng(seed)
    start = draw.uniform(*RANDOM_BOXES[name])
    duration = float(draw.uniform(0.0, DURATIONS[name]))
    exact = advanced_in_many_digits(FLOWS[name], start.tolist(), duration)
    off = np.linalg.norm(flow.advance(start, duration) - np.array([float(x) for x in exact]))
    assert off <= flow.advance_error(start, duration)
    assert off <= flow.accuracy * max(1.0, float(np.linalg.norm(start)))


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("place", range(2))
@pytest.mark.parametrize("name", SYMBOLIC)
def test_derivatives_are_those_of_sixty_digits(name: str, place: int) -> None:
    flow, start = SYMBOLIC[name].replace(), STATES[name][place]
    expected = derivative_in_many_digits(FLOWS[name], start, 0.5)
    off = np.linalg.norm(flow.derivative(start, 0.5) - expected)
    # a rounding of the state moves the derivative, too, by its own growth
    assert off <= flow.accuracy * np.linalg.norm(expected) ** 2


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("name", RETURNS)
def test_returns_are_right_to_rounding(name: str) -> None:
    section, reduced = RETURNS[name]
    hit = PoincareMap(SYMBOLIC[name].replace(), section, time_limit=50.0).crossing(
        np.array(reduced)
    )
    time, state = crossing_in_many_digits(name)
    assert hit.state == pytest.approx(state, abs=16.0 * ROUNDING * float(np.linalg.norm(state)))
    assert hit.time == pytest.approx(time, rel=16.0 * ROUNDING)


@pytest.mark.parametrize("name", ["henon heiles", "double pendulum"])
def test_energy_is_kept_over_a_thousand_units_of_time(name: str) -> None:
    flow, states = SHIPPED[name]
    energy = {"henon heiles": _galaxy, "double pendulum": _pendulum}[name]
    start = np.array(states[0])
    before, after = energy(flow, start), energy(flow, flow.advance(start, 1000.0))
    # a random walk of one rounding a step, of which there are some thousands
    assert after == pytest.approx(before, abs=100.0 * ROUNDING * (1.0 + abs(before)))


def _galaxy(flow: Any, state: Any) -> Any:
    """M. Henon, C. Heiles, Astronomical Journal 69 (1964) 73."""
    x, y, u, v = state
    return (u**2 + v**2 + x**2 + y**2) / 2 + flow.k * (x**2 * y - y**3 / 3)


def _kinetic(flow: Any, a: Any, b: Any, u: Any, v: Any) -> Any:
    m, r = flow.mass, flow.length
    cos = sp.cos if isinstance(a, sp.Expr) else np.cos
    return (1 + m) * u**2 / 2 + m * r**2 * v**2 / 2 + m * r * u * v * cos(a - b)


def _potential(flow: Any, a: Any, b: Any) -> Any:
    cos = sp.cos if isinstance(a, sp.Expr) else np.cos
    return -(1 + flow.mass) * cos(a) - flow.mass * flow.length * cos(b)


def _pendulum(flow: Any, state: Any) -> Any:
    a, b, u, v = state
    return _kinetic(flow, a, b, u, v) + _potential(flow, a, b)


def test_the_double_pendulum_is_that_of_lagrange() -> None:
    flow: Any = DoublePendulum(0.5, 1.5)
    state = [0.5, -0.3, 0.2, 0.1]
    a, b, u, v = sp.symbols("a b u v", real=True)
    lagrangian = _kinetic(flow, a, b, u, v) - _potential(flow, a, b)
    mass = sp.hessian(lagrangian, (u, v))
    force = [
        lagrangian.diff(q) - sum(lagrangian.diff(w, p) * r for p, r in ((a, u), (b, v)))
        for q, w in ((a, u), (b, v))
    ]
    values = dict(zip((a, b, u, v), state, strict=True))
    matrix = np.array(mass.subs(values), dtype=float)
    expected = np.linalg.solve(matrix, [float(each.subs(values)) for each in force])
    assert flow.velocity(np.array(state))[2:] == pytest.approx(expected, rel=1e-14)


# --- numbers of the literature --------------------------------------------------------------------


def test_lorenz_exponents_are_those_of_the_literature() -> None:
    # D. Viswanath, Physica D 190 (2004) 115: .9056; the sum is -(sigma + 1 + beta)
    found = LyapunovSpectrum.of_flow(Lorenz(), at(1.0, 2.0, 20.0), interval=0.5, iterations=20_000)
    assert (abs(found.exponents - [0.9056, 0.0, -14.5723]) <= 5.0 * found.error).all()
    assert found.sum == pytest.approx(-(10.0 + 1.0 + 8.0 / 3.0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "period"),
    # D. Viswanath, Nonlinearity 16 (2003) 1035, table 1
    [("AB", 1.5586522107162), ("AAB", 2.3059072639399)],
)
def test_orbits_of_lorenz_have_the_periods_of_viswanath(name: str, period: float) -> None:
    system, motion = _lorenz_returning()
    found = periodic_orbit(system, _nearest(motion, len(name)))
    assert found.duration == pytest.approx(period, abs=1e-13)


@cache
def _lorenz_returning() -> tuple[PoincareMap, Array]:
    plane = Hyperplane(at(0.0, 0.0, 1.0), 27.0, -1)
    system = PoincareMap(Lorenz(), plane, time_limit=10.0)
    return system, system.iterate(at(2.0, 2.0), 1200)[100:]


def _nearest(states: Array, count: int) -> Array:
    """The piece of a motion that comes back nearest after so many crossings, not earlier."""
    gaps = np.linalg.norm(states[count:] - states[:-count], axis=1)
    once = np.linalg.norm(states[1:] - states[:-1], axis=1)[: len(gaps)]
    best = int(np.argmin(np.where(once > 1.0, gaps, np.inf)))
    return states[best : best + count]


@pytest.mark.parametrize("mu", [0.1, 0.5, 1.0, 2.0, 3.0, 5.0])
def test_multipliers_of_van_der_pol_are_those_of_liouville(mu: float) -> None:
    """The multiplier is the exponential of the divergence's integral over a period."""
    maxima = PoincareMap(VanDerPol(mu=mu), Hyperplane(at(0.0, 1.0), direction=-1), 50.0)
    cycle = periodic_orbit(maxima, np.array([[2.0]]))
    (state,) = cycle.states
    period = maxima.return_time(state)
    along = Cycle(mu=mu).advance(at(*state, 0.0, 0.0), period)[2]
    (multiplier,) = cycle.multipliers
    # the integral's error is relative to the sum of its terms' sizes, some tens
    assert multiplier.real == pytest.approx(np.exp(along), rel=1e-11)
    assert multiplier.imag == 0.0


def test_the_cycle_of_van_der_pol_has_the_period_of_the_series() -> None:
    """C. M. Andersen, J. F. Geer, SIAM J. Appl. Math. 42 (1982) 678: the frequency's series."""
    mu = 0.1
    maxima = PoincareMap(VanDerPol(mu=mu), Hyperplane(at(0.0, 1.0), direction=-1), 50.0)
    cycle = periodic_orbit(maxima, np.array([[2.0]]))
    series = 1.0 - mu**2 / 16.0 + 17.0 * mu**4 / 3072.0 + 35.0 * mu**6 / 884736.0
    period = maxima.return_time(cycle.states[0])
    # the next term is of order mu^8, with a coefficient below 1e-3
    assert 2.0 * np.pi / period == pytest.approx(series, abs=1e-11)


@pytest.mark.parametrize("amplitude", [0.05, 0.2, 0.4])
@pytest.mark.parametrize(
    ("angle", "characteristic", "order", "trace"),
    [(np.pi, mathieu_a, 0, 2.0), (0.0, mathieu_a, 1, -2.0), (0.0, mathieu_b, 1, -2.0)],
)
def test_the_parametric_pendulum_has_the_borders_of_mathieu(
    amplitude: float, angle: float, characteristic: Any, order: int, trace: float
) -> None:
    # y'' + (a - 2 q cos 2z) y = 0 with the phase 2z: a = 4 / w^2, below zero upside down, |q| = 2 A
    number = float(characteristic(order, 2.0 * amplitude))
    frequency = 2.0 / np.sqrt(abs(number))
    pendulum = ParametricPendulum(damping=0.0, amplitude=amplitude, frequency=frequency)
    stroboscopic = PoincareMap(pendulum, Stroboscope(3), time_limit=20.0 / frequency)
    matrix = stroboscopic.jacobian(at(angle, 0.0))
    assert np.sign(number) == (-1.0 if angle else 1.0)
    assert np.trace(matrix) == pytest.approx(trace, abs=1e-11)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-11)


class Rotor(SymbolicFlow):
    """A rotor that a field, which turns at the given frequency, pulls along."""

    damping: float = 0.5
    frequency: float = 0.8

    def velocity(self, angle: Any, rate: Any, phase: Any) -> tuple[Any, ...]:
        pull = -self.damping * (rate - self.frequency) - sp.sin(angle - phase)
        return rate, pull, self.frequency


def test_a_rotor_that_turns_with_its_drive_has_a_periodic_orbit() -> None:
    turning = PoincareMap(Rotor(), Stroboscope(3, angles=[0]), time_limit=20.0)
    attractor: Any = turning.attractor(start=at(0.3, 0.5))
    orbit = attractor.periodic_orbit()
    assert turning.difference(orbit.states, at(0.0, 0.8)) == pytest.approx(0.0, abs=1e-13)
    # beside angle = phase: y'' + damping y' + y = 0
    rates = np.roots([1.0, 0.5, 1.0])
    assert orbit.multipliers == pytest.approx(np.exp(rates * 2.0 * np.pi / 0.8), abs=1e-12)


def test_the_brusselator_has_a_hopf_point_in_closed_form() -> None:
    a = 1.3
    rest = equilibrium(Brusselator(a=a, b=1.0), at(a, 1.0 / a))
    branch = continue_orbit(rest, "b", bounds=(1.0, 4.0))
    (found,) = branch.bifurcations
    assert found.kind == "HB"
    assert found.value == pytest.approx(1.0 + a * a, abs=1e-12)


def test_the_fixed_points_of_chua_are_in_closed_form() -> None:
    found = equilibrium(Chua(), at(1.6, 0.0, -1.6))
    assert found.state == pytest.approx([np.sqrt(8.0 / 3.0), 0.0, -np.sqrt(8.0 / 3.0)], abs=1e-14)


def test_the_branch_of_duffing_is_that_of_the_integrated_flow() -> None:
    values = []
    for flow in (Duffing(force=0.2), integrated_flows.Duffing(force=0.2)):
        strobed = PoincareMap(flow, Stroboscope(3), time_limit=10.0)
        orbit = MapAttractor(strobed, at(1.2, 0.1), 100, 20).periodic_orbit()
        branch = continue_orbit(orbit, "force", bounds=(0.19, 0.28))
        values.append([(found.kind, found.value) for found in branch.bifurcations])
    (first, second), (other, another) = values[0] * 2, values[1] * 2
    assert first[0] == other[0] == "PD"
    assert second[1] == pytest.approx(another[1], abs=1e-9)


# --- what happens by itself -----------------------------------------------------------------------


def test_stretching_is_that_of_short_intervals() -> None:
    flow, start = Lorenz(), at(1.0, 2.0, 20.0)
    whole = flow.stretching(start, 1.0, 5)
    short = Flow.stretching(flow, start, 1.0 / 16.0, 80)
    assert whole.logs == pytest.approx(short.logs.reshape(5, 16, 3).sum(axis=1), abs=1e-7)
    assert (abs(whole.logs.sum(axis=1) + 10.0 + 1.0 + 8.0 / 3.0) <= whole.errors.sum(axis=1)).all()
    assert whole.times is not None
    assert whole.times.tolist() == [1.0] * 5


def test_an_argument_t_is_time() -> None:
    flow: Flow = Kicked()
    assert flow.dimension == 3
    assert flow.velocity(at(0.1, 0.2, 0.0)).tolist() == [0.2, -np.sin(0.1) + 0.3, 1.0]
    assert flow.advance(at(0.1, 0.2, 0.5), 2.0)[2] == pytest.approx(2.5, rel=4.0 * ROUNDING)


def test_a_flow_is_compiled_once_for_all_values_of_its_parameters() -> None:
    calls = []

    class Counted(SymbolicFlow):
        rate: float = 1.0

        def velocity(self, x: Any) -> tuple[Any, ...]:
            calls.append(self.rate)
            return (-self.rate * x,)

    flows = [Counted(rate=float(rate)) for rate in np.linspace(0.5, 2.0, 10)]
    for flow in flows:
        ends = flow.advance(at(1.0), 1.0)
        assert ends == pytest.approx(np.exp(-flow.rate), rel=4.0 * ROUNDING)
        assert flow.derivative(at(1.0), 1.0)[0, 0] == pytest.approx(np.exp(-flow.rate), rel=1e-15)
    assert len(calls) == 1
    assert len({id(flow._taylor) for flow in flows}) == 1


def test_it_can_be_sent() -> None:
    flow = Duffing(force=0.25)
    before = flow.advance(at(1.0, 0.0, 0.0), 3.0)
    sent = pickle.loads(pickle.dumps(flow))
    assert sent == flow
    assert sent.advance(at(1.0, 0.0, 0.0), 3.0).tobytes() == before.tobytes()


def test_motions_that_run_away_diverge() -> None:
    assert Explosion().advance(at(0.5), 1.0) == pytest.approx(1.0, rel=1e-14)
    for follow in (Explosion().advance, Explosion().derivative):
        with pytest.raises(Diverged, match=r"from \[1.0\] cannot be followed for 2.0"):
            follow(at(1.0), 2.0)


def test_where_steps_collapse_the_flow_cannot_be_followed() -> None:
    stiff = VanDerPol(mu=1e8)
    with pytest.raises(CannotFollow, match=r"the flow is stiff .* or near a singularity"):
        stiff.advance(at(2.0, 0.0), 1000.0)
    strobed = PoincareMap(stiff, Hyperplane(at(0.0, 1.0), direction=-1), time_limit=1000.0)
    message = r"^no crossing within 1000\.0: the motion cannot be followed beyond time .* stiff"
    with pytest.raises(NoCrossing, match=message):
        strobed(at(2.0))


def test_no_crossing_comes_late() -> None:
    section = PoincareMap(Duffing(), Stroboscope(3), time_limit=5.0)
    with pytest.raises(NoCrossing, match=r"no crossing within 5\.0"):
        section(at(1.0, 0.0))
    plane = PoincareMap(Lorenz(), Hyperplane(at(0.0, 0.0, 1.0), 200.0), time_limit=5.0)
    with pytest.raises(NoCrossing, match=r"no crossing within 5\.0"):
        plane(at(1.0, 1.0))


# --- refusals -------------------------------------------------------------------------------------


def _bad(function: Any) -> SymbolicFlow:
    class Bad(SymbolicFlow):
        a: float = 1.0

        def velocity(self, x: Any, y: Any) -> Any:
            return function(self, x, y)

    return Bad()


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        (lambda s, x, y: (x,), ValueError, "velocity must return 2 expressions"),
        (lambda s, x, y: x, ValueError, "must return a tuple of 2 expressions"),
        (lambda s, x, y: (x, sp.Abs(y)), ValueError, "must be smooth: Taylor's method has no fabs"),
        (lambda s, x, y: (x, sp.Max(x, y)), ValueError, "must be smooth.*no comparison"),
        (lambda s, x, y: (x, sp.gamma(y)), ValueError, "functions that can be compiled; got gamma"),
        (lambda s, x, y: (x, y if x > 0 else x), TypeError, "must not compare symbols"),
    ],
    ids=["count", "tuple", "corner", "choice", "unknown", "comparison"],
)
def test_what_is_no_smooth_flow_is_refused(
    function: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        _bad(function).advance(np.zeros(2), 1.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: VanDerPol(mu=np.nan), "mu must be a finite number; got nan"),
        (lambda: VanDerPol().replace(nu=1.0), "parameter must be one of: mu; got 'nu'"),
        (lambda: VanDerPol().advance(at(1.0), 1.0), r"state must have shape \(2,\)"),
        (lambda: VanDerPol().advance(at(1.0, 0.0), -1.0), "duration must not be negative"),
        (
            lambda: Kicked().advance(at(1.0, np.inf, 0.0), 1.0),
            r"state\[1\] must be a finite number",
        ),
        (
            lambda: VanDerPol().parameter_derivative(at(1.0, 0.0), 1.0, "nu"),
            "parameter must be one of: mu; got 'nu'",
        ),
        (lambda: VanDerPol().stretching(at(1.0, 0.0), 0.0, 3), "interval must be positive"),
        (
            lambda: VanDerPol().next_crossing(at(1.0, 0.0), Stroboscope(3), 1.0),
            "section must have the flow's dimension 2; got 3",
        ),
    ],
)
def test_bad_arguments_are_named(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_without_heyoka_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "heyoka", None)
    taylor.heyoka.cache_clear()

    class Fresh(SymbolicFlow):
        def velocity(self, x: Any) -> tuple[Any, ...]:
            return (-x,)

    fresh: Flow = Fresh()
    with pytest.raises(ImportError, match=r"needs heyoka.*pip install 'dynkit\[flows\]'"):
        fresh.advance(at(1.0), 1.0)
    assert fresh.velocity(at(2.0)).tolist() == [-2.0]
    assert integrated_flows.Lorenz().advance(at(1.0, 2.0, 20.0), 0.1).shape == (3,)


class Shifted(SymbolicFlow):
    """A cycle of radius one around (centre, 0): it touches the line x = 0 at the centre one."""

    centre: float = 0.5

    def velocity(self, x: Any, y: Any) -> tuple[Any, ...]:
        aside = x - self.centre
        inward = 1 - aside**2 - y**2
        return aside * inward - y, y * inward + aside


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("beyond", [1e-11, 1e-13])
def test_a_motion_that_turns_back_at_the_section_grazes_it(direction: int, beyond: float) -> None:
    line = Hyperplane(np.array([1.0, 0.0]), direction=direction)
    for start in (0.0, 2.0):
        on_cycle = np.array([1.0 + beyond + np.cos(start), np.sin(start)])
        with pytest.raises(NoCrossing, match="the motion grazes the section and turns back"):
            Shifted(centre=1.0 + beyond).next_crossing(on_cycle, line, 20.0)


def test_a_motion_that_turns_back_before_the_section_does_not_graze_it() -> None:
    line = Hyperplane(np.array([1.0, 0.0]), direction=-1)
    with pytest.raises(NoCrossing, match=r"no crossing within 20\.0$"):
        Shifted(centre=1.0 + 1e-8).next_crossing(np.array([2.0, 0.0]), line, 20.0)


class Scaled(SymbolicFlow):
    """Van der Pol's oscillator in units of its size, and from another origin of the rate."""

    size: float = 1.0
    origin: float = 0.0

    def velocity(self, x: sp.Expr, y: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        u, v = x / self.size, (y - self.origin) / self.size
        return self.size * v, self.size * ((1 - u**2) * v - u)


@dataclass(frozen=True, kw_only=True)
class IntegratedScaled(IntegratedFlow):
    """The same."""

    size: float = 1.0
    origin: float = 0.0
    dimension = 2

    def velocity(self, state: Array) -> Array:
        u, v = state[0] / self.size, (state[1] - self.origin) / self.size
        return np.array([self.size * v, self.size * ((1.0 - u * u) * v - u)])

    def velocity_jacobian(self, state: Array) -> Array:
        u, v = state[0] / self.size, (state[1] - self.origin) / self.size
        return np.array([[0.0, 1.0], [-2.0 * u * v - 1.0, 1.0 - u * u]])


@pytest.mark.parametrize("kind", [Scaled, IntegratedScaled])
@pytest.mark.parametrize(("size", "origin"), [(1.0, 1e6), (1e-4, 0.0), (1e-8, 0.0)])
def test_errors_cover_orbits_in_small_units_and_far_from_the_origin(
    kind: Any, size: float, origin: float
) -> None:
    def returns(flow: Flow) -> PoincareMap:
        return PoincareMap(
            flow, Hyperplane(np.array([0.0, 1.0]), flow.value_of("origin"), -1), 100.0
        )

    exact = periodic_orbit(returns(Scaled()), [2.0])
    system = returns(kind(size=size, origin=origin))
    orbit = periodic_orbit(system, [2.0 * size])
    attractor = MapAttractor(system, np.array([2.2 * size]), transient=20, iterations=10)
    for found in (orbit, attractor):
        off = abs(found.states / size - exact.states[0]).max()
        assert off <= found.error / size + exact.error


def test_the_error_of_sensitivity_covers_iterates_in_small_units() -> None:
    size = 1e-8
    plane = Hyperplane(np.array([0.0, 1.0]), 0.0, -1)
    exact = periodic_orbit(PoincareMap(Scaled(), plane, 100.0), [2.0]).states[0]
    system = PoincareMap(IntegratedScaled(size=size), plane, 100.0)
    attractor = MapAttractor(system, size * exact, transient=0, iterations=1)
    found = Sensitivity(attractor, distance=1e-3 * size, iterations=2)
    assert abs(system(size * exact) - size * exact).max() <= found.error


class Hardening(SymbolicFlow):
    """A mass on a spring that hardens, with positions in a unit of their own."""

    unit: float = 1.0

    def velocity(self, x: Any, v: Any) -> Any:
        return v, -x - 0.2 * v - 5 * (x / self.unit) ** 2 * x


@pytest.mark.parametrize("unit", [2.0**-180, 2.0**-60, 2.0**-20, 2.0**20])
def test_motions_are_the_same_in_any_unit(unit: float) -> None:
    """Taylor's method has an absolute tolerance for what is small."""
    start = np.array([1.0, 0.5])
    known, found = (Hardening(unit=u).advance(u * start, 20.0) / u for u in (1.0, unit))
    assert abs(found - known).max() < 1e-14
    known, found = (Hardening(unit=u).derivative(u * start, 20.0) for u in (1.0, unit))
    assert abs(found - known).max() < 1e-13


class Loaded(SymbolicFlow):
    """A mass on a spring under a constant load."""

    load: float = 1.0

    def velocity(self, x: Any, v: Any) -> Any:
        return v, self.load - x


@pytest.mark.parametrize("load", [1.0, 1e-6, 1e-18])
def test_motions_from_zero_have_the_digits_of_what_they_become(load: float) -> None:
    found = Loaded(load=load).advance(np.zeros(2), 3.0)
    assert found == pytest.approx(
        load * np.array([1.0 - np.cos(3.0), np.sin(3.0)]), rel=1e-13, abs=0.0
    )


def test_steps_from_zero_set_the_shared_integrator_under_the_lock_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    method, held, entered = Loaded()._taylor, [], [0]

    class Lock:
        def __enter__(self) -> None:
            entered[0] += 1

        def __exit__(self, *_: object) -> None:
            entered[0] -= 1

    def watched(*given: Any, plain: Any = method._at) -> Any:
        held.append(entered[0])
        return plain(*given)

    monkeypatch.setattr(method, "_lock", Lock())
    monkeypatch.setattr(method, "_at", watched)
    next(method.steps(at(1.0), np.zeros(2), 3.0))
    assert len(held) == 2
    assert min(held) == 1
