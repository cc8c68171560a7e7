"""Structures whose energies are not quadratic: the exact engine, thirty digits, closed forms."""

from __future__ import annotations

import math
import pickle
import sys
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from scipy.special import ellipkinc

from dynkit import continue_orbit, periodic_orbit, sweep
from dynkit.analysis import POD, LyapunovSpectrum
from dynkit.core.no_motion import Diverged
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    FPUTChain,
    HardStop,
    ImpactChain,
    ImpactDuffing,
    ImpactPendulum,
    Jenkins,
    MatrixOscillator,
    PlasticBelow,
    SoftStop,
    TodaChain,
    extensions,
)
from dynkit.systems.impact.modes.taylor import chart as taylor_chart
from dynkit.systems.symbolic import taylor
from dynkit.testing import (
    AttractorCheck,
    MapCheck,
    attractor_checks,
    check_name,
    map_checks,
    numerical_derivative,
    parameter_derivatives_are_right,
)
from dynkit.testing.maps import jacobian_is_the_derivative
from tests.impact.agreement import omitted_bounces_are_within_the_error
from tests.impact.disguised import disguised
from tests.impact.taylor_cases import (
    Bead,
    Disguised,
    DoublePendulumAtAStop,
    DrivenPivot,
    TodaRing,
    Turntable,
)
from tests.impact.toda_many_digits import ManyDigits, run

TABLE = HardStop(-1, amplitude=0.1, restitution=0.85, name="table")
SOFT = SoftStop(0, offset=0.02, stiffness=50.0, damping=0.2)

LINEAR: dict[str, dict[str, Any]] = {
    "ten masses": {"masses": 10, "frequency": 0.87},
    "chatter and contact": {"masses": 10, "frequency": 0.408},
    "two masses, contact": {"masses": 2, "frequency": 0.2, "restitution": 0.4},
    "play": {"masses": 2, "frequency": 1.1, "play": 0.3, "amplitude": 0.05},
    "below, dead": {"masses": 3, "frequency": 0.8, "side": "below", "restitution": 0.0},
    "law": {"masses": 3, "frequency": 0.4, "restitution": PlasticBelow(0.05)},
    "soft": {"masses": 2, "frequency": 0.9, "elements": [TABLE, SOFT]},
    "soft alone": {
        "masses": 2,
        "frequency": 0.9,
        "elements": [SoftStop(1, amplitude=0.1, stiffness=50.0, damping=0.2, preload=0.01)],
    },
    "belt": {
        "masses": 2,
        "frequency": 0.9,
        "elements": [TABLE, DryFriction(0, force=0.02, static=0.03, velocity=0.1)],
    },
    "driven friction": {
        "masses": 2,
        "frequency": 0.7,
        "harmonic_forces": [0.8, 0.0],
        "elements": [DryFriction(0, force=0.3), SoftStop(1, offset=-0.2, stiffness=20.0)],
    },
    "a cycle on a belt": {
        "masses": 1,
        "damping": 0.0,
        "frequency": 1.0,
        "elements": [DryFriction(0, force=0.5, static=0.8, velocity=0.2)],
    },
    "masses hit each other": {
        "masses": 3,
        "frequency": 0.9,
        "elements": [TABLE, HardStop((0, 1), offset=-0.05, restitution=0.5)],
    },
    "joints": {
        "masses": 3,
        "frequency": 0.7,
        "harmonic_forces": [0.0, 0.0, 0.8],
        "elements": [
            Jenkins(0, stiffness=1.5, force=0.1, velocity=0.1),
            Jenkins((1, 2), stiffness=3.0, force=0.1),
            Jenkins((1, 2), stiffness=1.0, force=0.15),
            HardStop(2, offset=-0.5, restitution=0.6),
        ],
    },
    "a joint at the table": {
        "masses": 2,
        "frequency": 0.4,
        "elements": [
            HardStop(-1, amplitude=0.1, restitution=0.3),
            Jenkins(1, stiffness=2.0, force=0.02, side="below"),
        ],
    },
}


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_structure_moves_as_by_the_exact_engine(name: str) -> None:
    exact, other = ImpactChain(**LINEAR[name]), Disguised(**LINEAR[name])
    assert (exact.engine, other.engine) == ("exponential sums", "Taylor")
    impacts = 50 if "contact" in name else 12
    one, two = exact.simulate(impacts=impacts), other.simulate(impacts=impacts)
    away = abs(exact.difference(one.states, two.states)).max(axis=1)
    assert (away <= one.error + two.error).all()
    assert len(one.sticking) == len(two.sticking)
    assert repr(one.events) == repr(two.events)
    times = np.linspace(0.0, 0.5 * float(one.time[-1]), 40)
    for a, b in zip(one.sample(times), two.sample(times), strict=True):
        assert abs(a - b).max() < 1e-9
    for what in (each for each in exact.observables if each.endswith(("force", "impulse"))):
        given = () if what.endswith("impulse") else (times,)
        forces = one.observable(what, *given), two.observable(what, *given)
        assert abs(forces[0] - forces[1]).max() < 1e-7


def test_ten_masses_agree_to_eleven_digits_after_fifty_impacts() -> None:
    exact, other = (kind(masses=10, frequency=0.87) for kind in (ImpactChain, Disguised))
    away = []
    for velocity in 0.02 * np.random.default_rng(0).standard_normal((9, 10)):
        ends = [
            chain.simulate(impacts=50, start=chain.state(velocity=velocity)).states[-1]
            for chain in (exact, other)
        ]
        away.append(abs(exact.difference(*ends)).max())
    # chaos: from a few starts the roundings of either engine grow to more
    assert np.median(away) < 1e-11


def test_contact_begins_and_ends_as_by_the_exact_engine() -> None:
    exact, other = (kind(masses=10, frequency=0.408) for kind in (ImpactChain, Disguised))
    one, two = (chain.simulate(impacts=300) for chain in (exact, other))
    assert len(one.sticking) == 4
    assert abs(one.sticking[:3] - two.sticking[:3]).max() < 1e-9
    assert one.chatter_error == pytest.approx(two.chatter_error, rel=1e-6)


@pytest.mark.parametrize("name", ["ten masses", "play", "soft", "belt", "joints"])
def test_measures_are_those_of_the_exact_engine(name: str) -> None:
    exact, other = ImpactChain(**LINEAR[name]), Disguised(**LINEAR[name])
    one, two = exact.simulate(impacts=10), other.simulate(impacts=10)
    moments = one.second_moments(), two.second_moments()
    away = abs(moments[0].products.sum(axis=0) - moments[1].products.sum(axis=0)).max()
    bound = moments[0].error + moments[1].error + 1e-11
    assert away < bound * moments[0].durations.sum()
    balances = one.energy_balance(), two.energy_balance()
    assert balances[1].error < 1e-12
    for source, work in balances[0].work.items():
        assert balances[1].work[source] == pytest.approx(work, abs=1e-11)
    state = one.states[5]
    assert abs(exact.jacobian(state) - other.jacobian(state)).max() < 1e-9


# --- thirty digits --------------------------------------------------------------------------------

NUMBERS: dict[str, Any] = {
    "masses": 2,
    "frequency": 0.9,
    "damping": 0.1,
    "amplitude": 0.1,
    "restitution": 0.85,
}


@pytest.mark.usefixtures("optimised")
def test_errors_of_toda_s_chain_are_below_their_estimates() -> None:
    record = TodaChain(**NUMBERS).simulate(impacts=7)
    with mp.workdps(32):
        exact = run(ManyDigits(**NUMBERS), record.states[0].tolist(), 6)
        system = record.system
        for i, (row, state) in enumerate(zip(exact, record.states[1:], strict=True), start=1):
            away = [mp.mpf(a) - b for a, b in zip(state[:-1].tolist(), row[:-2], strict=True)]
            turn = float((row[-2] - mp.mpf(float(state[-1]))) % (2 * mp.pi))
            off = max(*(abs(float(part)) for part in away), min(turn, 2 * math.pi - turn))
            assert off <= record.error[i]
    assert record.error[-1] < 1e-11
    assert system.engine == "Taylor"


@pytest.mark.usefixtures("optimised")
def test_the_derivative_of_the_impact_map_is_that_of_thirty_digits() -> None:
    system = TodaChain(**NUMBERS)
    record = system.simulate(impacts=40)
    flights = np.diff(record.time)
    state = record.states[int(np.argmin(np.where(flights > 0.5, flights, np.inf)))]
    with mp.workdps(32):
        exact, h = ManyDigits(**NUMBERS), mp.mpf(10) ** -10
        columns = []
        for j in range(4):
            ends = []
            for sign in (1, -1):
                given = [mp.mpf(value) for value in state.tolist()]
                given[j] += sign * h
                ends.append(exact.next_impact(given)[:-1])
            columns.append([float((a - b) / (2 * h)) for a, b in zip(*ends, strict=True)])
    found = np.array(columns).T
    assert abs(system.jacobian(state) - found).max() < 1e-12 * abs(found).max()


# --- integrals and closed forms -------------------------------------------------------------------


def far() -> SoftStop:
    """A stop that nothing reaches; it moves, so that there are periods."""
    return SoftStop(0, offset=-1e3, amplitude=1.0, stiffness=1.0)


def lax(x: Array, v: Array) -> Array:
    """Flaschka's integrals: eigenvalues of the Lax matrix of a ring."""
    matrix, n = np.diag(0.5 * v), len(x)
    for i in range(n):
        j = (i + 1) % n
        matrix[i, j] = matrix[j, i] = 0.5 * math.exp(0.5 * (x[j] - x[i]))
    return np.asarray(np.linalg.eigvalsh(matrix))


def test_the_integrals_of_toda_s_ring_stay_over_time_1000() -> None:
    ring = TodaRing(masses=4, frequency=1.0, elements=[far()])
    start = ring.state([0.3, -0.2, 0.1, -0.2], [0.5, -0.1, 0.2, -0.6])
    record = ring.simulate(impacts=160, start=start)
    assert record.time[-1] > 1000.0
    found = [lax(x, v) for x, v in zip(record.position, record.velocity, strict=True)]
    assert abs(np.array(found) - lax(start.position, start.velocity)).max() < 1e-13


def test_a_soliton_has_its_shape_and_speed() -> None:
    # M. Toda, Theory of Nonlinear Lattices, 2nd edition, Springer 1989, section 3.1
    n, kappa = 40, 1.2
    rate = math.sinh(kappa)

    def wave(time: float) -> tuple[Array, Array]:
        at = kappa * (np.arange(-1, n) - 16.0) - rate * time
        logs, slopes = np.logaddexp(0.0, 2.0 * at), -2.0 * rate / (1.0 + np.exp(-2.0 * at))
        return logs[1:] - logs[:-1], slopes[1:] - slopes[:-1]

    ring = TodaRing(masses=n, twist=2.0 * kappa, frequency=1.5, elements=[far()])
    found = ring.simulate(impacts=1, start=ring.state(*wave(0.0)))
    x, v = wave(float(found.time[0]))
    assert rate * found.time[0] / kappa > 5.0
    assert abs(found.position[0] - x).max() < 1e-11
    assert abs(found.velocity[0] - v).max() < 1e-11


def test_small_oscillations_tend_to_the_linear_chain_in_second_order() -> None:
    linear = ImpactChain(masses=3, frequency=1.0, elements=[far()])
    toda = TodaChain(masses=3, frequency=1.0, elements=[far()])
    assert toda.natural_frequencies == pytest.approx(linear.natural_frequencies, rel=1e-14)
    sizes, away = np.array([1e-2, 1e-3, 1e-4]), []
    for size in sizes:
        ends = [
            system.simulate(impacts=1, start=system.state(size * np.array([1.0, -0.5, 0.7])))
            for system in (linear, toda)
        ]
        away.append(float(abs(ends[0].position - ends[1].position).max()))
    order = np.polyfit(np.log(sizes), np.log(away), 1)[0]
    assert abs(order - 2.0) < 0.02


@pytest.mark.parametrize("restitution", [1.0, 0.9])
def test_a_pendulum_between_stops_keeps_the_time_of_elliptic_integrals(restitution: float) -> None:
    pendulum = ImpactPendulum(damping=0.0, frequency=1.0, stop=1.0, restitution=restitution)
    record = pendulum.simulate(impacts=8, start=pendulum.state([0.0], [2.0]))
    speed, times = math.sqrt(4.0 - 2.0 * (1.0 - math.cos(1.0))), []
    for bounce in range(8):
        energy = 0.5 * speed**2 + 1.0 - math.cos(1.0)
        k = math.sqrt(2.0 / energy)  # x' = 2 sqrt(1 - k^2 sin^2(x / 2)) / k, beyond the top
        m = k * k
        full = 2.0 * k * float(ellipkinc(0.5, m)) if m < 1.0 else _oscillating(energy)
        times.append(0.5 * full if bounce == 0 else full)
        speed *= restitution
    assert record.time == pytest.approx(np.cumsum(times), rel=1e-13)
    assert abs(record.relative_velocity[-1]) == pytest.approx(speed, rel=1e-12)


def _oscillating(energy: float) -> float:
    """Time from one stop to the other below the top: sin(x/2) = k sin(phi)."""
    k = math.sqrt(0.5 * energy)
    return 2.0 * float(ellipkinc(math.asin(math.sin(0.5) / k), k * k))


def test_a_bead_on_a_wire_bounces_for_ever_and_keeps_its_energy() -> None:
    bead = Bead(frequency=1.0, restitution=1.0, amplitude=0.0, offset=-0.5)
    record = bead.simulate(impacts=200, start=bead.state([0.7], [0.4]))
    start = 0.5 * (1.0 + 0.49) * 0.16 + 0.245
    assert abs(record.energy - start).max() < 1e-13
    assert abs(np.diff(record.time) - np.diff(record.time)[0]).max() < 1e-11


# --- every measure --------------------------------------------------------------------------------

SYSTEMS: dict[str, Any] = {
    "toda": TodaChain(masses=3, frequency=0.9),
    "toda, contact": TodaChain(masses=2, frequency=0.2, restitution=0.4),
    "fput": FPUTChain(masses=2, quadratic=0.3, frequency=0.9),
    "toda, soft": TodaChain(masses=2, frequency=0.9, elements=[TABLE, SOFT]),
    "toda, periods": TodaChain(
        masses=2, frequency=0.9, elements=[SoftStop(1, amplitude=0.1, stiffness=50.0, damping=0.2)]
    ),
    "two wells": ImpactDuffing(frequency=1.2, force=0.4, linear=-1.0, offset=0.1, amplitude=0.0),
    "pendulum": ImpactPendulum(frequency=0.8, force=0.5),
    "pivot": DrivenPivot(frequency=1.9, amplitude=0.0, offset=-0.1, restitution=0.7),
    "bead, contact": Bead(frequency=0.7, offset=0.1, amplitude=0.4, restitution=0.3),
    "pendulum, contact": ImpactPendulum(frequency=0.5, force=0.9, stop=0.5, restitution=0.2),
    "double pendulum": DoublePendulumAtAStop(frequency=1.1, offset=-0.2, amplitude=0.3),
    "turntable": Turntable(frequency=0.9, offset=-0.1, amplitude=0.2),
}


MAPS = ("toda", "toda, periods", "pivot", "bead, contact", "double pendulum", "turntable")


@cache
def states(name: str) -> Array:
    found: Array = SYSTEMS[name].attractor(transient=50, impacts=2).states
    return found


# by a parameter a Taylor map is differentiated by differences, which are the same for all
@pytest.mark.parametrize(
    ("name", "check"),
    [
        pytest.param(name, check, id=f"{name}-{check_name(check)}")
        for name in MAPS
        for check in map_checks
        if name == "bead, contact" or check is not parameter_derivatives_are_right
    ],
)
def test_every_one_is_a_map(name: str, check: MapCheck) -> None:
    check(SYSTEMS[name], states(name))


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name not in MAPS])
def test_the_derivative_of_the_map_is_that_of_differences(name: str) -> None:
    jacobian_is_the_derivative(SYSTEMS[name], states(name))


@pytest.mark.parametrize("check", attractor_checks, ids=check_name)
@pytest.mark.parametrize("name", ["toda, contact", "toda, soft"])
def test_attractors_are_attractors(name: str, check: AttractorCheck) -> None:
    system = SYSTEMS[name]
    check(lambda transient, count: system.attractor(transient=transient, impacts=count))


@pytest.mark.parametrize("name", ["toda, contact", "bead, contact", "pendulum, contact"])
def test_bounces_that_are_left_out_change_no_more_than_is_said(name: str) -> None:
    omitted_bounces_are_within_the_error(SYSTEMS[name])


@pytest.mark.parametrize("name", SYSTEMS)
def test_energies_balance(name: str) -> None:
    balance = SYSTEMS[name].simulate(impacts=6).energy_balance()
    assert balance.error < 1e-12
    assert sum(balance.dissipated.values()) > 0.0


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_simulation_goes_on_from_its_end_bit_for_bit(name: str) -> None:
    system = SYSTEMS[name]
    whole, half = system.simulate(impacts=8), system.simulate(impacts=4)
    rest = system.simulate(impacts=4, start=half.final)
    assert np.concatenate([half.states, rest.states]).tobytes() == whole.states.tobytes()
    again = pickle.loads(pickle.dumps(system))
    assert again == system
    assert again.simulate(impacts=3).states.tobytes() == whole.states[:3].tobytes()


def test_a_chain_of_one_s_own_needs_its_potential_only() -> None:
    class Own(ImpactChain):
        def potential(self, x: Any) -> Any:
            return sum(sp.exp(e) - 1 - e for e in extensions(x))

    own, shipped = (kind(masses=3, frequency=0.9) for kind in (Own, TodaChain))
    one, two = own.simulate(impacts=20).states, shipped.simulate(impacts=20).states
    assert abs(own.difference(one, two)).max() < 1e-12


def test_chains_of_linear_springs_keep_the_exact_engine_bit_for_bit() -> None:
    one = FPUTChain(masses=3, quadratic=0.0, cubic=0.0, frequency=0.9)
    two = ImpactChain(masses=3, frequency=0.9)
    assert one.engine == "exponential sums"
    assert one.simulate(impacts=30).states.tobytes() == two.simulate(impacts=30).states.tobytes()


def test_another_value_of_a_parameter_compiles_nothing() -> None:
    chain = FPUTChain(masses=3, frequency=0.91, damping=0.13)
    chain.simulate(impacts=3)
    before = taylor_chart._integrator.cache_info().misses
    for change in ({"damping": 0.17}, {"cubic": 0.7}, {"frequency": 1.1}, {"amplitude": 0.2}):
        chain.replace(**change).simulate(impacts=3)
    assert taylor_chart._integrator.cache_info().misses == before


def test_toda_s_chain_has_orbits_branches_exponents_and_modes() -> None:
    chain = TodaChain(masses=3, frequency=0.9)
    attractor = chain.attractor(transient=300)
    assert str(attractor.label) == "P(1,1)"
    orbit = attractor.periodic_orbit()
    assert orbit.residual < 1e-12
    by_differences = numerical_derivative(chain, orbit.states[0], difference=chain.difference)[0]
    moduli = np.sort(abs(np.linalg.eigvals(by_differences)))
    assert np.sort(abs(orbit.multipliers)) == pytest.approx(moduli, abs=1e-8)
    branch = continue_orbit(orbit, "frequency", bounds=(0.89, 0.91))
    for place in (0, -1):
        there = chain.replace(frequency=float(branch.parameter[place]))
        settled = there.attractor(start=attractor.final).states[-1]
        assert abs(branch.orbit(place).states[0] - settled).max() < 1e-9
    spectrum = LyapunovSpectrum(attractor, iterations=200)
    # a complex pair turns: averages over n iterates are off by a part of 1 / n
    assert abs(spectrum.exponents[0] - math.log(abs(orbit.multipliers[0]))) < 1.0 / 200.0
    assert POD(attractor).rank(0.99) <= 3


def test_a_cycle_that_nothing_drives_has_its_period() -> None:
    belt = DryFriction(0, force=0.5, static=0.8, velocity=0.2)
    linear = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[belt])
    periods: list[Any] = []
    for cubic in (1e-4, 2e-4):
        block = FPUTChain(masses=1, damping=0.0, frequency=1.0, cubic=cubic, elements=[belt])
        label = block.attractor(transient=20, impacts=20).label
        assert str(label) == "P(1)"
        periods.append(label.period)
    # in first order it is that of the linear spring
    found = 2.0 * periods[0] - periods[1]
    assert found == pytest.approx(linear.attractor(transient=20, impacts=20).label.period, abs=1e-6)


def test_sweeps_of_toda_s_chain() -> None:
    found = sweep(
        TodaChain(masses=2, frequency=0.9), "frequency", [0.9, 0.95], transient=50, keep=5
    )
    assert len(found) == 2


# --- refusals -------------------------------------------------------------------------------------


def chain_with(**energies: Any) -> ImpactChain:
    """A chain of two masses with other energies."""

    class Own(ImpactChain):
        pass

    for name, function in energies.items():
        setattr(Own, name, function)
    return Own(masses=2, frequency=0.9)


@pytest.mark.parametrize(
    ("energies", "message"),
    [
        ({"potential": lambda _, x: 1 / x[0]}, "potential must be smooth at zero"),
        ({"potential": lambda _, x: sp.Abs(x[0]) + x[1] ** 4}, "smooth functions; got Abs"),
        (
            {"potential": lambda _, x: x[0] ** 4 + sp.Symbol("y")},
            "holds y, which is not among them",
        ),
        ({"potential": lambda _, x: x[0] ** 4 + sp.zoo}, "coefficient zoo, which is not finite"),
        ({"potential": lambda _, x: sp.exp(x[0]) + sp.exp(sp.I)}, "which is not a real number"),
        ({"potential": lambda _, x: (x[0] ** 4,)}, "potential must return a SymPy expression"),
        ({"potential": lambda _, x: x[0] ** 2 + x[0]}, "give it as constant_forces"),
        ({"kinetic": lambda _, v: v[0] ** 4 + v[1] ** 2}, "at most quadratic in the velocities"),
        ({"kinetic": lambda _, x, v: x[0] ** 2 * v[0] ** 2 + v[1] ** 2}, "must be positive defin"),
    ],
)
def test_energies_that_cannot_be_followed_are_named(energies: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _ = chain_with(**energies).engine


def test_unknown_arguments_of_energies_are_named() -> None:
    with pytest.raises(TypeError, match="potential must take arguments among x, phase; got time"):
        _ = chain_with(potential=lambda _, x, time: x[0] ** 2 * time).engine


@pytest.mark.parametrize("load", [0.0, 0.5, 1.2, 3.0])
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_rest_on_a_preloaded_stop_is_that_of_the_exact_engine(load: float, damping: float) -> None:
    pad = SoftStop(1, stiffness=10.0, damping=damping, preload=2.5, name="pad")
    exact, taylor = (
        kind(
            masses=2,
            frequency=1.0,
            damping=0.1,
            constant_forces=[0.0, -1.0],
            harmonic_forces=[0.1, load],
            elements=[pad],
        )
        for kind in (ImpactChain, Disguised)
    )
    records = [
        each.simulate(impacts=4, start=each.state([0, 0], [0, 0])) for each in (exact, taylor)
    ]
    bound = sum(record.error for record in records) + 4.0 * 2.0**-52
    assert (abs(np.subtract(*(r.position for r in records))).max(axis=1) <= bound).all()
    kinds = [(r.events.element.tolist(), r.events.kind.tolist()) for r in records]
    assert kinds[0] == kinds[1]


@pytest.mark.parametrize("force", np.linspace(0.6, 1.0, 8))
def test_friction_breaks_away_where_all_coordinates_are_zero(force: float) -> None:
    # rounding of the force that is overcome may have either sign
    block = ImpactDuffing(frequency=1.0, force=force, elements=[DryFriction(0, force=0.3)])
    events = block.simulate(impacts=1, start=block.state([0.0], [0.0])).events
    assert events.time[0] == pytest.approx(math.asin(0.3 / force), abs=1e-15)
    assert len(events) < 8


# --- guards that are zero as a flight begins ------------------------------------------------------


@pytest.mark.parametrize("place", [0.27, 0.3, 0.33, 0.36, 0.39])
def test_a_mass_that_returns_soon_after_its_release_hits_its_stop(place: float) -> None:
    springs = [[1.5, -0.75, 0.0], [-0.75, 1.5, -0.75], [0.0, -0.75, 0.75]]
    exact = MatrixOscillator(
        M=np.diag([1.75, 1.5, 1.25]),
        C=np.zeros((3, 3)),
        K=springs,
        frequency=0.9,
        constant_forces=[-0.75, -0.75, -0.375],
        elements=[HardStop(1, offset=-0.375, restitution=0.0)],
    )
    records = [
        machine.simulate(impacts=6, start=machine.state([place, -0.375, 0.0], [0.0, 0.0, 0.0]))
        for machine in (exact, disguised(exact))
    ]
    assert records[1].time == pytest.approx(records[0].time, abs=1e-10)


@pytest.mark.parametrize("speeds", [(0.5, 0.05), (0.3, 0.01), (0.5, 0.25)])
def test_a_mass_that_leaves_one_of_two_stops_returns_to_it(speeds: tuple[float, float]) -> None:
    exact = MatrixOscillator(
        M=np.diag([1.0, 2.0]),
        C=np.zeros((2, 2)),
        K=[[2.0, -1.0], [-1.0, 2.0]],
        frequency=1.0,
        constant_forces=[-1.0, -1.0],
        elements=[HardStop(0, restitution=0.75), HardStop(1, restitution=0.75)],
    )
    records = [
        machine.simulate(impacts=6, start=machine.state([0.0, 0.0], speeds))
        for machine in (exact, disguised(exact))
    ]
    assert (records[1].element == records[0].element).all()
    assert records[1].time == pytest.approx(records[0].time, abs=1e-13)


@pytest.mark.parametrize("speed", [1e-3, 0.3])
def test_a_mass_leaves_a_stop_where_no_force_acts(speed: float) -> None:
    # half a period of x'' = -x - x^3 with x'^2 = (a - x^2) (x^2 + b) / 2
    duffing = ImpactDuffing(frequency=1.0, damping=0.0, amplitude=0.0)
    (time,) = duffing.simulate(impacts=1, start=duffing.state([0.0], [speed])).time
    a = math.sqrt(1.0 + 2.0 * speed**2) - 1.0
    b = a + 2.0
    exact = 2.0 * math.sqrt(2.0 / (a + b)) * ellipkinc(math.pi / 2, a / (a + b))
    assert time == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.5, 1.0])
def test_a_mass_stays_on_its_stop_where_the_contact_force_is_zero_for_an_instant(
    restitution: float, turn: float
) -> None:
    weight = -0.5 if turn == 0.5 else 0.0
    machine = disguised(
        MatrixOscillator(
            M=[[1.0]],
            C=[[0.0]],
            K=[[0.25]],
            frequency=1.0,
            harmonic_forces=[0.5],
            constant_forces=[weight],
            elements=[HardStop(0, restitution=restitution, name="stop")],
        )
    )
    record = machine.simulate(impacts=3, start=machine.state([0.0], [0.0], turn * math.pi))
    times = np.linspace(0.01, 3.1, 50)
    force = -weight - 0.5 * np.sin(turn * math.pi + times)
    assert record.observable("stop.contact_force", times) == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize("engine", ["exponential sums", "Taylor"])
@pytest.mark.parametrize("speed", [0.25, 0.3, 0.7])
def test_impacts_at_one_instant_where_all_masses_are_at_zero_are_ambiguous(
    speed: float, engine: str
) -> None:
    machine: Any = MatrixOscillator(
        M=np.eye(3),
        C=np.zeros((3, 3)),
        K=np.eye(3),
        frequency=1.0,
        elements=[HardStop((0, 1), restitution=0.75), HardStop((1, 2), restitution=0.75)],
    )
    machine = machine if machine.engine == engine else disguised(machine)
    start = machine.state([0.0, 0.0, 0.0], [-0.5, 0.0, speed])
    record = machine.simulate(impacts=2, start=start)
    assert record.time == pytest.approx([math.pi, math.pi], rel=1e-14)
    assert record.ambiguous == 0


@pytest.mark.parametrize("weight", [0.08, 0.11, 0.14])
@pytest.mark.parametrize("drive", [0.3j, -0.3j])
def test_friction_holds_a_mass_that_its_table_leaves_where_it_turns(
    drive: complex, weight: float
) -> None:
    # at the turn the friction changes its sign, so that the contact ends there
    exact = MatrixOscillator(
        M=[[1.0]],
        C=[[0.0]],
        K=[[0.0]],
        frequency=1.0,
        harmonic_forces=[drive],
        constant_forces=[-weight],
        elements=[HardStop(0, amplitude=0.2, restitution=0.0), DryFriction(0, force=0.3)],
    )
    machines = exact, disguised(exact)
    records = [k.simulate(impacts=5, start=k.state([0.0], [0.2])) for k in machines]
    for record in records:
        assert record.sample([2.0])[0] == pytest.approx(np.array([[0.2]]), abs=1e-14)
    assert records[1].time == pytest.approx(records[0].time, abs=1e-12)


def test_a_motion_that_runs_away_is_named() -> None:
    duffing = ImpactDuffing(frequency=1.0, cubic=-1.0, amplitude=0.0, offset=-9.0)
    with pytest.raises(Diverged, match="the motion runs away"):
        duffing.simulate(impacts=3, start=duffing.state([2.0], [1.0]))


def test_a_motion_without_impacts_ends_at_the_limit_of_the_search() -> None:
    chain = TodaChain(masses=2, frequency=0.9, offset=-50.0)
    record = chain.simulate(impacts=3)
    assert record.ending.name == "SEARCH_LIMIT"
    assert len(record) == 0


def test_modes_about_an_unstable_place_are_refused() -> None:
    with pytest.raises(ValueError, match="stiffness matrix of small oscillations must be positive"):
        _ = SYSTEMS["two wells"].natural_frequencies


def test_without_heyoka_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "heyoka", None)
    taylor.heyoka.cache_clear()
    chain = TodaChain(masses=2, frequency=0.9)
    taylor_chart._integrator.cache_clear()
    with pytest.raises(ImportError, match=r"needs heyoka.*pip install 'dynkit\[flows\]'"):
        chain.simulate(impacts=1)
    taylor.heyoka.cache_clear()


def test_orbits_of_the_map_are_found_from_guesses() -> None:
    chain = TodaChain(masses=3, frequency=0.9)
    states = chain.attractor(transient=100, impacts=4).states
    assert periodic_orbit(chain, states[-1]).residual < 1e-12
