"""Conservative flows on levels of an integral: families, multipliers, bifurcations, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import mpmath
import numpy as np
import pytest
from scipy.special import ellipk

from dynkit import (
    Branch,
    Hyperplane,
    MapOrbit,
    NoConvergence,
    PoincareMap,
    continue_curve,
    continue_orbit,
    equilibrium,
    periodic_orbit,
)
from dynkit.core.no_motion import Refused
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.poincare_map import Level
from dynkit.orbits.kinds import BifurcationKind
from dynkit.systems import HenonHeiles, IntegratedFlow, RestrictedThreeBody, SymbolicFlow
from dynkit.testing import (
    MapCheck,
    PoincareMapCheck,
    check_name,
    check_problem,
    map_checks,
    numerical_derivative,
    poincare_map_checks,
)
from tests.flows.cases import Parabola
from tests.flows.symbolic_flows import RigidBody, TwoSprings, Undamped

# --- the contract ---------------------------------------------------------------------------------

GALAXY: Any = HenonHeiles()
AXIS = Hyperplane(np.array([0.0, 1.0, 0.0, 0.0]))
MAPS: dict[str, tuple[PoincareMap, list[float]]] = {
    "henon heiles": (PoincareMap(GALAXY, AXIS, 50.0, level=("energy", 0.1)), [0.1, 0.1, 0.4]),
    "oblique": (
        PoincareMap(
            GALAXY, Hyperplane(np.array([0.3, 1.0, 0.2, 0.0]), 0.05), 50.0, level=("energy", 0.12)
        ),
        [0.1, 0.1, 0.4],
    ),
    "parabola": (
        PoincareMap(RigidBody(), Parabola(1, height=0.1, bend=0.3), 50.0, level=("energy", 0.4)),
        [0.3, 0.9],
    ),
    "three bodies": (
        PoincareMap(RestrictedThreeBody(), AXIS, 50.0, level=("jacobi", 3.0)),
        [0.3, 0.05, 2.0],
    ),
}


@pytest.mark.parametrize("check", [*poincare_map_checks, *map_checks], ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_it_is_a_poincare_map(name: str, check: PoincareMapCheck | MapCheck) -> None:
    system, start = MAPS[name]
    check(system, system.iterate(np.array(start), 2)[1:])


@pytest.mark.parametrize("name", MAPS)
def test_motions_stay_on_the_level(name: str) -> None:
    system, start = MAPS[name]
    assert system.level is not None
    integral, value = system.level
    for state in system.iterate(np.array(start), 20)[1:]:
        full = system.section.lift(state)
        terms = abs(system.flow.integral_gradient(integral, full)) @ abs(full)
        off = system.flow.integral(integral, full) - value
        assert abs(off) <= system.accuracy * (terms + abs(value))


@pytest.mark.parametrize("name", ["henon heiles", "oblique", "parabola"])
def test_derivatives_off_the_level_are_those_of_differences(name: str) -> None:
    system, start = MAPS[name]
    assert system.level is not None
    level = Level(system.flow, system.section, *system.level)
    state = np.array(start) + 0.03
    found, error = numerical_derivative(lambda at: level.onto(at)[0], state)
    assert (abs(level.derivative(state) - found) <= 20.0 * error + 1e-9).all()
    for parameter in system.parameters:

        def moved(value: Array, parameter: str = parameter) -> Array:
            changed = system.replace(**{parameter: float(value[0])})
            assert changed.level is not None
            return Level(changed.flow, changed.section, *changed.level).onto(state)[0]

        found, error = numerical_derivative(moved, np.array([system.parameters[parameter]]))
        off = abs(level.by_parameter(state, parameter) - found[:, 0])
        assert (off <= 20.0 * error[:, 0] + 1e-9).all()


@pytest.mark.parametrize("flow", [GALAXY, RestrictedThreeBody(), Undamped(), TwoSprings()])
def test_integrals_are_conserved_and_have_exact_derivatives(flow: SymbolicFlow) -> None:
    state = np.array([0.3, 0.2, 0.1, 0.4])[: flow.dimension]
    (name,) = flow.integrals
    rate = flow.integral_gradient(name, state) @ flow.velocity(state)
    assert abs(rate) <= 1e-14
    by_differences, error = numerical_derivative(
        lambda at: np.array([flow.integral(name, at)]), state
    )
    assert (abs(flow.integral_gradient(name, state) - by_differences[0]) <= 20.0 * error[0]).all()
    for parameter in flow.parameters:
        found = flow.integral_parameter_derivative(name, state, parameter)
        other = super(SymbolicFlow, flow).integral_parameter_derivative(name, state, parameter)
        assert found == pytest.approx(other, abs=1e-9)


# --- orbit A of Henon and Heiles ------------------------------------------------------------------


def straight(energy: float) -> MapOrbit:
    """Return the orbit along the axis x = 0."""
    system = PoincareMap(GALAXY, AXIS, time_limit=50.0, level=("energy", energy))
    return periodic_orbit(system, np.array([0.0, 0.0, np.sqrt(2.0 * energy)]))


def period_of(orbit: MapOrbit) -> float:
    system: Any = orbit.system
    return float(sum(system.return_time(state) for state in orbit.states))


def value_of(orbit: MapOrbit) -> float:
    """Return the value of the integral."""
    system: Any = orbit.system
    return float(system.level[1])


@cache
def branch_a() -> Branch:
    return continue_orbit(straight(0.1), "energy", bounds=(0.01, 0.1648))


def hill_trace(energy: Any) -> Any:
    """Return the trace of the disturbances across orbit A over its period, to 30 digits.

    With x = 0 the equations are y'' = -y + y^2 and, for disturbances, x'' = -(1 + 2 y) x. Taylor
    series of y and of two solutions x advance in steps to the second zero of y.
    """
    step, order = mpmath.mpf(1) / 4, 34

    def series(y: Any, v: Any, columns: Any) -> tuple[list[Any], list[list[Any]]]:
        a, others = [y, v], [list(column) for column in columns]
        for n in range(order):
            square = mpmath.fsum(a[i] * a[n - i] for i in range(n + 1))
            a.append((square - a[n]) / ((n + 1) * (n + 2)))
            for b in others:
                product = mpmath.fsum(a[i] * b[n - i] for i in range(n + 1))
                b.append(-(b[n] + 2 * product) / ((n + 1) * (n + 2)))
        return a, others

    def at(a: list[Any], time: Any) -> tuple[Any, Any]:
        rate = [n * c for n, c in enumerate(a)][1:]
        return mpmath.polyval(a[::-1], time), mpmath.polyval(rate[::-1], time)

    y, v, columns = mpmath.mpf(0), mpmath.sqrt(2 * energy), [(1, 0), (0, 1)]
    below = False
    while True:
        a, others = series(y, v, columns)
        y_next, v_next = at(a, step)
        if below and y_next >= 0:
            break
        y, v, columns = y_next, v_next, [at(b, step) for b in others]
        below = below or y < 0
    time = step / 2
    for _ in range(8):
        value, rate = at(a, time)
        time -= value / rate
    (one, _), (_, other) = (at(b, time) for b in others)
    return one + other


def test_the_straight_orbit_bifurcates_where_hills_equation_does() -> None:
    found = branch_a().bifurcations
    kinds = [f"{each.kind}" for each in found]
    assert kinds == [*["RS"] * 5, "PD", "PD", *["RS"] * 5, "BP", "BP"]
    marked = {2: 0.0, 5: -2.0, 6: -2.0, 8: -1.0, 12: 2.0, 13: 2.0}  # the trace there
    # M. Brack, Foundations of Physics 31 (2001) 209 (arXiv nlin/0006034): a cascade of pitchforks
    for place, target in marked.items():
        each = found[place]
        with mpmath.workdps(30):
            energy, h = mpmath.mpf(each.value), mpmath.mpf(10) ** -12
            trace = hill_trace(energy)
            slope = (hill_trace(energy + h) - trace) / h
            off = float(abs((trace - target) / slope))
        # a target as a float has an error of a rounding, too
        assert off <= each.error + 2e-16 < 1e-11


def test_multipliers_have_the_product_one_along_the_branch() -> None:
    products = branch_a().multipliers.prod(axis=1)
    assert abs(products - 1.0).max() <= 1e-11


def test_the_resonances_have_their_fractions() -> None:
    fractions = [1 / 6, 1 / 5, 1 / 4, 1 / 3, 2 / 5]
    found = [each.rotation_number for each in branch_a().bifurcations if each.kind == "RS"]
    assert found == pytest.approx([*fractions, *fractions[::-1]], abs=1e-15)


def test_the_cascade_has_the_ratio_of_the_saddle() -> None:
    """The pitchforks accumulate at 1/6; M. Brack, nlin/0006034: the ratio exp(2 pi / sqrt(3)).

    That is the ratio of every second one: rates at the saddle are 1 along the orbit and sqrt(3)
    across it.
    """
    # a branch towards the saddle within 1/6 - 5e-5 has two more pitchforks
    low, high = 0.166, 1.0 / 6.0 - 5e-5
    branch = continue_orbit(straight(low), "energy", bounds=(low, high))
    both = (*branch_a().bifurcations, *branch.bifurcations)
    rest = np.array([1.0 / 6.0 - each.value for each in both if each.kind == "BP"])
    ratio = np.exp(2.0 * np.pi / np.sqrt(3.0))
    # the energy of the first is 3 % below that of the saddle: so far is the ratio from its limit
    assert rest[:2] / rest[2:] == pytest.approx(np.full(2, ratio), rel=0.03)


def test_multipliers_of_the_straight_orbit_are_those_of_hills_equation() -> None:
    for energy in (0.02, 0.1, 0.145, 0.16):
        orbit = straight(energy)
        with mpmath.workdps(30):
            trace = float(hill_trace(mpmath.mpf(energy)))
        pair = np.roots([1.0, -trace, 1.0])
        pair = pair[np.lexsort((-pair.imag, -abs(pair)))]
        assert (abs(orbit.multipliers - pair) <= orbit.multipliers_error).all()
        assert orbit.stable is (abs(trace) <= 2.0)


def test_a_pitchfork_leads_to_orbits_without_the_symmetry() -> None:
    (fork, *_) = [each for each in branch_a().bifurcations if each.kind == "BP"]
    (orbit,) = fork.switch()
    assert orbit.stable
    assert abs(orbit.states[0, :2]).max() > 1e-5
    state = orbit.system.section.lift(orbit.states[0])
    assert GALAXY.energy(state) == pytest.approx(value_of(orbit), abs=1e-14)


def test_small_orbits_have_the_period_of_the_linear_oscillation() -> None:
    gaps = []
    for energy in (1e-3, 1e-4):
        orbit = straight(energy)
        gaps.append(period_of(orbit) - 2.0 * np.pi)
    # x'' + x = x^2: the period is 2 pi (1 + 5 a^2/12), with a^2 = 2 E
    assert gaps[1] == pytest.approx(2.0 * np.pi * 5.0 * 2e-4 / 12.0, rel=1e-3)
    assert gaps[0] / gaps[1] == pytest.approx(10.0, rel=1e-2)


def test_a_curve_of_bifurcations_scales_as_the_cubic_term() -> None:
    """With x -> x / k energies are in proportion to k^-2."""
    fork = next(each for each in branch_a().bifurcations if each.kind == "PD")
    curve = continue_curve(fork, ("energy", "k"), bounds=((0.05, 0.3), (0.98, 1.02)))
    energy, k = curve.parameters.T
    assert energy * k**2 == pytest.approx(np.full(len(k), fork.value), rel=1e-10)


def test_the_problem_keeps_the_contract() -> None:
    orbit = straight(0.1)
    problem = orbit.problem("energy")
    check_problem(problem, orbit.unknowns, problem.values)


# --- three bodies ---------------------------------------------------------------------------------

MOON: Any = RestrictedThreeBody()


@pytest.mark.parametrize("guess", [0.8, 1.15, -1.0])
def test_small_orbits_at_collinear_points_have_the_period_of_the_centre(guess: float) -> None:
    point = equilibrium(MOON, np.array([guess, 0.0, 0.0, 0.0]))
    # on the axis the pull of both bodies equals the centrifugal force
    x, mu = point.state[0], MOON.mu
    pull = (1 - mu) * (x + mu) / abs(x + mu) ** 3 + mu * (x - 1 + mu) / abs(x - 1 + mu) ** 3
    assert x == pytest.approx(pull, abs=1e-14)
    (orbit,) = point.lyapunov_orbits("jacobi", AXIS)
    frequency = abs(point.eigenvalues.imag).max()
    exponent = point.eigenvalues.real.max()
    period = period_of(orbit)
    amplitude = abs(orbit.states[0, 0] - x)
    assert abs(period * frequency / (2.0 * np.pi) - 1.0) <= 5.0 * amplitude**2 / 0.15**2
    assert np.log(orbit.multipliers[0].real) == pytest.approx(exponent * period, rel=1e-2)
    assert orbit.multipliers.prod().real == pytest.approx(1.0, abs=1e-9)


def test_a_family_of_lyapunov_orbits_is_symmetric_and_conserves_jacobis_integral() -> None:
    point = equilibrium(MOON, np.array([-1.0, 0.0, 0.0, 0.0]))
    (orbit,) = point.lyapunov_orbits("jacobi", AXIS)
    value = value_of(orbit)
    branch = continue_orbit(orbit, "jacobi", bounds=(value - 0.01, value))
    assert branch.parameter.min() == value - 0.01
    # crossings of the axis are perpendicular: x' = 0
    assert abs(branch.observable("state[1]")).max() <= 1e-12
    last = branch.orbit(int(branch.parameter.argmin()))
    state = last.system.section.lift(last.states[0])
    period = period_of(last)
    assert MOON.jacobi(MOON.advance(state, 0.3 * period)) == pytest.approx(value - 0.01, abs=1e-13)


def test_the_orbit_of_arenstorf_is_found_with_its_period() -> None:
    """E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, eq. 0.2."""
    flow: Any = RestrictedThreeBody(mu=0.012277471)
    start = np.array([0.994, 0.0, 0.0, -2.00158510637908252240537862224])
    level = "jacobi", flow.jacobi(start)
    system = PoincareMap(
        flow, Hyperplane(np.array([0.0, 1.0, 0.0, 0.0]), 0.0, -1), 30.0, level=level
    )
    orbit = periodic_orbit(system, start[[0, 2, 3]] + [1e-6, 0.0, 0.0], period=3)
    assert period_of(orbit) == pytest.approx(17.0652165601579625588917206249, abs=1e-10)
    first = orbit.states[np.argmax(orbit.states[:, 0])]
    assert first == pytest.approx(start[[0, 2, 3]], abs=1e-10)


# --- other flows, and refusals --------------------------------------------------------------------


def test_in_the_plane_a_level_is_one_orbit_with_the_period_of_elliptic_integrals() -> None:
    system = PoincareMap(
        Undamped(), Hyperplane(np.array([0.0, 1.0]), 0.0, -1), 50.0, level=("energy", -0.5)
    )
    orbit = periodic_orbit(system, np.array([1.0]))
    assert orbit.multipliers.shape == (0,)
    assert orbit.stable
    branch = continue_orbit(orbit, "energy", bounds=(-0.9, 0.9))
    for point in (branch.orbit(i) for i in range(len(branch))):
        energy = value_of(point)
        period = period_of(point)
        assert period == pytest.approx(4.0 * ellipk((1.0 + energy) / 2.0), rel=1e-12)


def test_both_families_of_two_springs_emanate_from_the_centre() -> None:
    flow = TwoSprings(second=2.0)
    point = equilibrium(flow, np.full(4, 1e-3))
    orbits = point.lyapunov_orbits("energy")
    periods = [period_of(orbit) for orbit in orbits]
    assert periods == pytest.approx(2.0 * np.pi / np.sqrt([2.0, 1.0]), rel=1e-4)
    for orbit, ratio in zip(orbits, [1.0 / np.sqrt(2.0), np.sqrt(2.0)], strict=True):
        # the other oscillation turns by this many turns in the period
        assert orbit.multipliers[0].real == pytest.approx(np.cos(2.0 * np.pi * ratio), abs=1e-3)
        assert orbit.stable


def test_resonant_frequencies_are_refused() -> None:
    centre = equilibrium(GALAXY, np.full(4, 1e-3))
    with pytest.raises(ValueError, match="must not be multiples of one another"):
        centre.lyapunov_orbits("energy")


@dataclass(frozen=True, kw_only=True)
class Integrated(IntegratedFlow):
    """The flow of Henon and Heiles by integration, with an energy as a plain function."""

    integrals = ("energy",)
    dimension = 4

    def velocity(self, state: Array) -> Array:
        x, y, u, v = finite_array("state", state, (4,))
        return np.array([u, v, -x - 2.0 * x * y, -y - x**2 + y**2])

    def energy(self, state: Array) -> float:
        x, y, u, v = state
        return float((u**2 + v**2 + x**2 + y**2) / 2.0 + x**2 * y - y**3 / 3.0)


def test_a_flow_by_integration_has_the_same_map() -> None:
    own, other = (
        PoincareMap(flow, AXIS, 50.0, level=("energy", 0.1)) for flow in (Integrated(), GALAXY)
    )
    start = np.array([0.1, 0.1, 0.4])
    assert own(start) == pytest.approx(other(start), abs=own.accuracy)
    state = np.array([0.3, 0.2, 0.1, 0.4])
    gradients = [flow.integral_gradient("energy", state) for flow in (Integrated(), GALAXY)]
    assert gradients[0] == pytest.approx(gradients[1], abs=1e-10)


@pytest.mark.parametrize("guess", [[0.0, 0.0, 0.4], [0.01, 0.02, 0.4], [0.1, 0.3, 0.35]])
def test_without_a_level_the_way_out_is_named(guess: list[float]) -> None:
    system = PoincareMap(GALAXY, AXIS, time_limit=50.0)
    with pytest.raises(NoConvergence, match="declare it in `integrals` of the flow"):
        periodic_orbit(system, np.array(guess))


def test_a_level_that_is_not_near_is_refused() -> None:
    system = PoincareMap(GALAXY, AXIS, time_limit=50.0, level=("energy", -1.0))
    with pytest.raises(Refused, match=r"no state with energy -1\.0 is near"):
        system(np.array([0.1, 0.1, 0.4]))


class Damped(SymbolicFlow):
    """An oscillator that loses the energy which it declares constant."""

    integrals = ("energy",)
    damping: float = 0.1

    def velocity(self, x: Any, v: Any) -> tuple[Any, ...]:
        return v, -x - self.damping * v

    def energy(self, x: Any, v: Any) -> Any:
        return (x**2 + v**2) / 2


def test_an_integral_that_is_not_constant_is_refused() -> None:
    turns = Hyperplane(np.array([0.0, 1.0]))
    system = PoincareMap(Damped(), turns, time_limit=20.0, level=("energy", 0.5))
    with pytest.raises(ValueError, match=r"^energy must be constant .* from 0\.5 to 0\.26"):
        periodic_orbit(system, np.array([-1.0]))
    free = PoincareMap(Damped(damping=0.0), turns, time_limit=20.0, level=("energy", 0.5))
    assert free(np.array([-1.0])) == pytest.approx([-1.0], abs=1e-13)


def test_bad_levels_are_refused() -> None:
    with pytest.raises(ValueError, match="level must be one of"):
        PoincareMap(GALAXY, AXIS, time_limit=50.0, level=("momentum", 0.1))
    with pytest.raises(ValueError, match="energy"):
        PoincareMap(GALAXY, AXIS, time_limit=50.0, level=("energy", np.nan))
    with pytest.raises(ValueError, match="integral must be one of"):
        equilibrium(GALAXY, np.zeros(4)).lyapunov_orbits("momentum")


def test_an_integral_of_other_coordinates_is_refused() -> None:
    class Swapped(SymbolicFlow):
        integrals = ("energy",)

        def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
            return rate, -angle

        def energy(self, rate: Any, angle: Any) -> Any:
            return rate**2 + angle**2

    flow: Any = Swapped()
    with pytest.raises(TypeError, match="must take the coordinates of velocity, angle, rate"):
        flow.energy(np.zeros(2))


def test_integrals_that_are_no_names_are_refused() -> None:
    with pytest.raises(TypeError, match="integrals must be a tuple of names of methods; got <func"):

        class Method(SymbolicFlow):
            integrals: ClassVar[Any] = lambda _, angle, rate: rate**2 + angle**2

            def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
                return rate, -angle


def test_angles_named_in_the_class_of_a_flow_are_refused() -> None:
    with pytest.raises(
        TypeError, match=r"angles must be given to the section .*; got \('angle',\)"
    ):

        class Turning(SymbolicFlow):
            angles = ("angle",)

            def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
                return rate, -angle


def test_resonances_and_folds_are_kinds() -> None:
    assert BifurcationKind.RS == "RS"
    assert all(each.criticality is None for each in branch_a().bifurcations)
