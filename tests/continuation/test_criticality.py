"""Criticality against exact normal forms, switched branches and simulated motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynkit import Map, continue_orbit, equilibrium, periodic_orbit
from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.results.branch import Branch
from dynkit.core.validation import Array, finite_array
from dynkit.systems import DelayedLogistic, Henon, ImpactChain, Logistic, Lorenz, SymbolicFlow
from tests.continuation.doublings import growth_of_born
from tests.continuation.starts import delayed_logistic


def of_kind(branch: Branch, kind: str) -> list[Bifurcation]:
    return [b for b in branch.bifurcations if b.kind == kind]


def known(bifurcation: Bifurcation) -> Any:
    assert bifurcation.criticality is not None
    return bifurcation.criticality


# --- textbooks ------------------------------------------------------------------------------------


def test_the_first_period_doubling_of_the_logistic_map() -> None:
    """c = (f''/2)^2 = 9 where f = 3 x (1 - x), with xi counting x."""
    branch = continue_orbit(periodic_orbit(Logistic(rate=2.5), [0.6]), "rate", bounds=(2.0, 3.2))
    (doubling,) = of_kind(branch, "PD")
    found = known(doubling)
    unit = float(doubling.direction[0]) ** 2
    assert abs(found.coefficient / unit - 9.0) <= found.error / unit < 1e-10
    assert (found.supercritical, found.stable, found.side) == (True, True, 1)
    assert str(found) == "supercritical, stable, at larger values"


def test_the_second_period_doubling_of_the_logistic_map() -> None:
    """By the derivatives of f(f(x)): c = g''^2 / 4 + g''' / 6 at 1 + sqrt(6)."""
    start = periodic_orbit(Logistic(rate=3.2), [0.5], period=2)
    branch = continue_orbit(start, "rate", bounds=(3.1, 3.5))
    (doubling,) = of_kind(branch, "PD")
    rate = 1.0 + np.sqrt(6.0)
    x = float(doubling.orbit.states[0, 0])
    first, last = (rate * (1.0 - 2.0 * y) for y in (x, rate * x * (1.0 - x)))
    bend = -2.0 * rate
    second = bend * first**2 + last * bend
    third = 3.0 * bend * first * bend
    found, unit = known(doubling), float(doubling.direction[0]) ** 2
    exact = unit * (0.25 * second**2 + third / 6.0)
    assert abs(found.coefficient - exact) <= found.error < 1e-8


def test_the_torus_of_the_delayed_logistic_map() -> None:
    """Kuznetsov, example 4.2, has -2 for an eigenvector whose square is 2: supercritical."""
    branch = continue_orbit(delayed_logistic(), "rate", bounds=(1.5, 2.5))
    (torus,) = of_kind(branch, "NS")
    found = known(torus)
    assert abs(found.coefficient + 1.0) <= found.error < 1e-10
    assert (found.supercritical, found.stable, found.side) == (True, True, 1)


@dataclass(frozen=True)
class Rough(DelayedLogistic):
    """The delayed logistic map as if its values had errors of 1e-7."""

    @property
    def accuracy(self) -> float:
        return 1e-7


def test_a_torus_whose_place_has_six_digits_has_its_criticality() -> None:
    branch = continue_orbit(
        periodic_orbit(Rough(rate=1.8), [0.45, 0.45]), "rate", bounds=(1.5, 2.5)
    )
    (torus,) = of_kind(branch, "NS")
    assert torus.error > 1e-6
    found = known(torus)
    assert abs(found.coefficient + 1.0) <= found.error < 1e-2
    assert (found.supercritical, found.stable, found.side) == (True, True, 1)


@dataclass(frozen=True, kw_only=True)
class Rest(SymbolicFlow):
    """A fold at force 0 in any unit of time and of the force."""

    rate: float
    unit: float
    force: float

    def velocity(self, x: Any, y: Any) -> tuple[Any, ...]:
        pushed = self.force / self.unit - x**2 + 0.3 * x**3 + 0.1 * x * y
        return self.rate * pushed, self.rate * (0.2 * x - y)


@pytest.mark.parametrize(("rate", "unit"), [(1e-9, 1.0), (1e9, 1.0), (1.0, 1e-18), (1.0, 1e18)])
def test_a_fold_has_the_same_orbits_in_all_units(rate: float, unit: float) -> None:
    rest = equilibrium(Rest(rate=rate, unit=unit, force=0.5 * unit), [0.7, 0.14])
    branch = continue_orbit(rest, "force", bounds=(-0.5 * unit, 0.6 * unit))
    (fold,) = of_kind(branch, "SN")
    found = known(fold)
    assert (found.side, found.stable) == (1, True)
    # at the fold x = y = 0, on the curve y = 0.2 x, and the left null vector is (1, 0)
    exact = -(1.0 - 0.1 * 0.2) * float(fold.direction[0]) * rate
    assert abs(abs(found.coefficient) - abs(exact)) <= found.error < 1e-11 * rate


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_the_coefficient_of_a_torus_scales_with_the_unit_of_the_states(size: float) -> None:
    """The coefficient is that of a square of the state."""

    def at(s: float) -> Bifurcation:
        orbit = periodic_orbit(DelayedLogistic(rate=1.9 / s, s=s), [0.47 * s, 0.47 * s])
        return continue_orbit(orbit, "rate", bounds=(1.2 / s, 2.3 / s)).bifurcations[0]

    known, found = at(1.0).criticality, at(size).criticality
    assert known is not None
    assert found is not None
    assert found.supercritical
    assert found.side == known.side == 1
    wrong = known.error + found.error * size**2
    assert abs(found.coefficient * size**2 - known.coefficient) <= wrong
    assert found.error * size**2 < 10.0 * known.error


def test_the_fold_of_the_henon_map() -> None:
    """b by the left and right eigenvectors of (1 - a x^2 + y, b x), or of its own form."""
    branch = continue_orbit(
        periodic_orbit(Henon(a=0.2, b=0.3), [0.6, 0.2]), "a", bounds=(-1.0, 0.3), points=400
    )
    (fold,) = of_kind(branch, "SN")
    system, state = fold.orbit.system, fold.orbit.states[0]
    jacobian = system.jacobian(state)
    values, vectors = np.linalg.eig(jacobian)
    k = int(np.argmin(abs(values - 1.0)))
    left, way = np.linalg.inv(vectors)[k].real, vectors[:, k].real
    # the map is quadratic: differences of its derivative are exact but for rounding
    second = (system.jacobian(state + way) - system.jacobian(state - way)) / 2.0
    scaled = float(way @ fold.direction) / float(way @ way)
    found = known(fold)
    assert abs(found.coefficient - scaled * 0.5 * float(left @ second @ way)) < found.error + 1e-7
    assert (found.supercritical, found.stable, found.side) == (None, True, 1)
    assert str(found) == "one of them stable, at larger values"


def test_the_oscillations_of_the_lorenz_equations_are_subcritical() -> None:
    start = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    branch = continue_orbit(start, "rho", bounds=(10.0, 30.0))
    (hopf,) = of_kind(branch, "HB")
    found = known(hopf)
    assert found.coefficient - found.error > 0.0
    assert (found.supercritical, found.stable, found.side) == (False, False, -1)
    (orbit,) = hopf.switch()
    assert orbit.system.flow.rho < hopf.value
    assert not orbit.stable


# --- polynomial maps: exact derivatives -----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Polynomial(Map):
    """x' = (1 + growth) A x + B(x, x) / 2 + C(x, x, x) / 6, of three coordinates."""

    growth: float
    seed: int
    angle: float

    dimension = 3

    def tensors(self) -> tuple[Array, Array, Array]:
        random = np.random.default_rng(self.seed)
        basis = random.normal(size=(3, 3))
        inner = np.zeros((3, 3))
        turn = np.array([[np.cos(self.angle), -np.sin(self.angle)], [np.sin(self.angle), 0.0]])
        turn[1, 1] = np.cos(self.angle)
        inner[:2, :2] = turn
        if self.angle == np.pi:
            inner[1, 1] = 0.3
        inner[2, 2] = random.uniform(-0.8, 0.8)
        linear = basis @ inner @ np.linalg.inv(basis)
        two, three = random.normal(size=(3, 3, 3)), random.normal(size=(3, 3, 3, 3))
        two = (two + two.transpose(0, 2, 1)) / 2.0
        orders = [
            (0, 1, 2, 3),
            (0, 1, 3, 2),
            (0, 2, 1, 3),
            (0, 2, 3, 1),
            (0, 3, 1, 2),
            (0, 3, 2, 1),
        ]
        return linear, two, np.sum([three.transpose(order) for order in orders], axis=0) / 6.0

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (3,))
        linear, two, three = self.tensors()
        cubic = np.einsum("ijkl,j,k,l", three, x, x, x) / 6.0
        square = np.einsum("ijk,j,k", two, x, x) / 2.0
        return np.asarray((1.0 + self.growth) * linear @ x + square + cubic)

    def jacobian(self, state: Array) -> Array:
        x = finite_array("state", state, (3,))
        linear, two, three = self.tensors()
        cubic = np.einsum("ijkl,k,l", three, x, x) / 2.0
        return np.asarray((1.0 + self.growth) * linear + two @ x + cubic)

    def coefficient(self) -> tuple[float, Any]:
        """Kuznetsov, sections 5.4.2 and 5.4.3; and the eigenvector."""
        linear, two, three = self.tensors()
        values, vectors = np.linalg.eig(linear)
        value = np.exp(1j * self.angle)
        k = int(np.argmin(abs(values - value)))
        q, left, unit = vectors[:, k], np.linalg.inv(vectors)[k], np.eye(3)

        def b(u: Any, v: Any) -> Any:
            return np.einsum("ijk,j,k", two, u, v)

        if self.angle == np.pi:
            mean = np.linalg.solve(unit - linear, b(q, q))
            cubic = np.einsum("ijkl,j,k,l", three, q, q, q)
            return float((left @ (cubic + 3.0 * b(q, mean))).real / 6.0), q.real
        mean = np.linalg.solve(unit - linear, b(q, q.conj()))
        double = np.linalg.solve(value**2 * unit - linear, b(q, q))
        cubic = np.einsum("ijkl,j,k,l", three, q, q, q.conj())
        number = left @ (cubic + 2.0 * b(q, mean) + b(q.conj(), double))
        return float(0.5 * (number / value).real), q


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("angle", [np.pi, 0.7, 1.3, 2.4])
def test_random_maps_have_their_coefficients_within_the_errors(seed: int, angle: float) -> None:
    system = Polynomial(-0.05, seed, angle)
    branch = continue_orbit(periodic_orbit(system, [0.0, 0.0, 0.0]), "growth", bounds=(-0.1, 0.1))
    (found,) = of_kind(branch, "PD" if angle == np.pi else "NS")
    exact, q = system.coefficient()
    if angle == np.pi:
        exact *= float(found.direction @ found.direction) / float(q @ q)
    criticality = known(found)
    assert abs(criticality.coefficient - exact) <= criticality.error + 1e-13 * abs(exact)
    assert criticality.error < 1e-6 * max(1.0, abs(exact))
    supercritical = exact > 0.0 if angle == np.pi else exact < 0.0
    assert criticality.supercritical == supercritical
    assert criticality.side == (1 if supercritical else -1)
    assert criticality.stable == supercritical


@dataclass(frozen=True)
class Rounded(Map):
    """-(1 + growth) x + x^2 + x^3, whose derivative has rounding errors up to 1e-12."""

    growth: float
    seed: int
    dimension = 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.asarray(-(1.0 + self.growth) * x + x**2 + x**3)

    def jacobian(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        random = np.random.default_rng([self.seed, int(x.view(np.uint64)[0])])
        rounding = 1e-12 * random.uniform(-1.0, 1.0, 1)
        return np.diag(-(1.0 + self.growth) + 2.0 * x + 3.0 * x**2 + rounding)


@pytest.mark.parametrize("seed", range(20))
def test_rounding_of_derivatives_is_within_the_error_and_costs_few_digits(seed: int) -> None:
    """c = (f''/2)^2 + f'''/6 = 2."""
    start = periodic_orbit(Rounded(-0.1, seed), [0.0])
    (doubling,) = of_kind(continue_orbit(start, "growth", bounds=(-0.12, 0.05)), "PD")
    found, unit = known(doubling), float(doubling.direction[0]) ** 2
    assert abs(found.coefficient / unit - 2.0) <= found.error / unit < 2e-8


@dataclass(frozen=True)
class Bent(Map):
    """g - (1 + growth/2) w + 100 w^2 with w = x - g, where the fixed point g is on a parabola."""

    growth: float
    dimension = 1

    def away(self, state: Array) -> Array:
        return finite_array("state", state, (1,)) - (self.growth + 5.0 * self.growth**2)

    def __call__(self, state: Array) -> Array:
        w = self.away(state)
        return np.asarray(state - w - (1.0 + 0.5 * self.growth) * w + 100.0 * w**2)

    def jacobian(self, state: Array) -> Array:
        return np.diag(200.0 * self.away(state) - 1.0 - 0.5 * self.growth)


@pytest.mark.parametrize("growth", [-0.14, -0.125, -0.1, -0.09])
def test_orbits_are_born_beyond_the_doubling_of_a_bent_branch(growth: float) -> None:
    """The multiplier is -1 - growth / 2, and along chords it changes with their slope as well."""
    start = periodic_orbit(Bent(growth), [growth + 5.0 * growth**2])
    branch = continue_orbit(start, "growth", bounds=(-0.2, 0.2))
    (doubling,) = of_kind(branch, "PD")
    (born,) = doubling.switch()
    assert (born.system.growth > doubling.value, born.stable) == (True, True)
    found = known(doubling)
    assert (found.side, found.supercritical, found.stable) == (1, True, True)


# --- where nothing is certain ---------------------------------------------------------------------


@dataclass(frozen=True)
class Flat(Map):
    """-(1 + growth) x + x^2 - x^3: at growth 0 the coefficient of the doubling is zero."""

    growth: float
    dimension = 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.asarray(-(1.0 + self.growth) * x + x**2 - x**3)

    def jacobian(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return np.diag(-(1.0 + self.growth) + 2.0 * x - 3.0 * x**2)


def test_a_coefficient_that_is_zero_is_not_certain() -> None:
    branch = continue_orbit(periodic_orbit(Flat(-0.1), [0.0]), "growth", bounds=(-0.2, 0.2))
    (doubling,) = of_kind(branch, "PD")
    found = known(doubling)
    assert abs(found.coefficient) <= found.error < 1e-8
    assert (found.supercritical, found.stable, found.side) == (None, None, 0)
    assert str(found) == "not certain"


@dataclass(frozen=True)
class Micro(Map):
    """-(1 + growth) u + b u^2 - b^2 u^3 with u in units of 1e-6: the coefficient is zero."""

    growth: float
    b: float
    dimension = 1

    def __call__(self, state: Array) -> Array:
        u = finite_array("state", state, (1,)) / 1e-6
        return np.asarray(1e-6 * (-(1.0 + self.growth) * u + self.b * u**2 - self.b**2 * u**3))


@pytest.mark.parametrize("b", np.linspace(0.55, 3.85, 12))
def test_rounding_that_grows_with_the_step_is_within_the_error(b: float) -> None:
    """Differences over 1e5 times the unit of a map, of derivatives with an accuracy of 1e-11."""
    branch = continue_orbit(periodic_orbit(Micro(-0.1, b), [0.0]), "growth", bounds=(-0.2, 0.2))
    found = known(of_kind(branch, "PD")[0])
    assert abs(found.coefficient) <= found.error < 1e-9 * b**2 / 1e-12
    assert str(found) == "not certain"


@pytest.mark.parametrize("order", [3, 4])
def test_near_a_strong_resonance_there_is_no_criticality(order: int) -> None:
    system = Polynomial(-0.05, 1, 2.0 * np.pi / order)
    branch = continue_orbit(periodic_orbit(system, [0.0, 0.0, 0.0]), "growth", bounds=(-0.1, 0.1))
    (torus,) = of_kind(branch, "NS")
    assert torus.criticality is None


def test_a_branch_loaded_without_its_orbit_has_none(tmp_path: Any) -> None:
    branch = continue_orbit(delayed_logistic(), "rate", bounds=(1.5, 2.5))
    branch.save(tmp_path / "branch.h5")
    (torus,) = of_kind(Branch.load(tmp_path / "branch.h5"), "NS")
    with pytest.raises(ValueError, match=r"orbit must be given to Branch\.load"):
        _ = torus.criticality


# --- impact oscillators ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("masses", "frequency", "restitution"), [(3, 0.9, 0.7), (2, 1.1, 0.6), (10, 1.3, 0.6)]
)
def test_orbits_of_twice_the_period_are_born_as_said(
    masses: int, frequency: float, restitution: float
) -> None:
    system = ImpactChain(masses=masses, frequency=frequency, restitution=restitution)
    compared = 0
    for orbit in system.find_orbits(impacts=1, periods=4):
        bounds = frequency - 0.3, frequency + 0.3
        for doubling in of_kind(continue_orbit(orbit, "frequency", bounds=bounds), "PD"):
            found = known(doubling)
            (born,) = doubling.switch()
            assert np.sign(born.system.frequency - doubling.value) == found.side
            assert born.stable == found.stable
            assert found.error < 1e-3 * abs(found.coefficient)
            assert growth_of_born(doubling, born) == pytest.approx(1.0, abs=0.02)
            compared += 1
    assert compared >= 3


def test_an_invariant_curve_of_the_chain_is_as_large_as_the_coefficient_says() -> None:
    """|z|^2 = -(growth of the multiplier) / Re d, to first order in the growth."""
    system = ImpactChain(masses=10, frequency=1.02)
    start = system.periodic_orbit(periods=2)
    branch = continue_orbit(start, "frequency", bounds=(1.0, 1.03))
    torus = min(of_kind(branch, "NS"), key=lambda b: abs(b.value - 1.00669))
    found = known(torus)
    assert (found.supercritical, found.stable) == (True, True)
    value = torus.value + found.side * 2e-5
    orbit = system.replace(frequency=value).periodic_orbit(periods=2)
    size, growth = invariant_curve(orbit)
    assert abs(size / (-growth / found.coefficient) - 1.0) < 0.05


def invariant_curve(orbit: Any) -> tuple[float, float]:
    """Mean of |z|^2 on the curve around an orbit, and ln |mu|."""
    system, state = orbit.system, orbit.states[0]
    values, vectors = np.linalg.eig(system.jacobian(state))
    k = int(np.argmax(abs(values)))
    left = np.linalg.inv(vectors)[k]
    growth = float(np.log(abs(values[k])))
    moved = state + 1e-3 * vectors[:, k].real
    count = int(min(30.0 / growth, 400_000))
    states = system.attractor(
        start=system.impact_state(moved), transient=count, impacts=20_000
    ).states
    z = system.difference(states, state) @ left
    return float(np.mean(abs(z) ** 2)), growth


def test_a_period_doubling_of_impacts_has_the_coefficient_of_its_map_of_returns() -> None:
    """The same number by another way: phases and impulses here, states and their map there."""
    system = ImpactChain(masses=10, frequency=1.02)
    branch = continue_orbit(system.periodic_orbit(periods=2), "frequency", bounds=(1.0, 1.1))
    (doubling,) = of_kind(branch, "PD")
    assert doubling.admissible
    problem: Any = doubling.problem
    twice, start, way = problem.doubled(doubling.unknowns, doubling.direction)
    p, h = np.array([doubling.value]), 1e-4
    ends = [twice.solution(start + sign * h * way, p).states[0] for sign in (1.0, -1.0)]
    q = doubling.orbit.system.difference(*ends) / (2.0 * h)
    jacobian, state = problem.returns(doubling.unknowns, p)
    here, h = jacobian(state), 1e-3
    ahead, behind = jacobian(state + h * q), jacobian(state - h * q)
    first, second = (ahead - behind) / (2.0 * h), (ahead - 2.0 * here + behind) / h**2
    values, vectors = np.linalg.eig(here)
    left = np.linalg.inv(vectors)[np.argmin(abs(values + 1.0))]
    mean = np.linalg.solve(np.eye(len(q)) - here, first @ q)
    cubic = (left @ (second @ q + 3.0 * first @ mean) / (6.0 * left @ q)).real
    assert known(doubling).coefficient == pytest.approx(cubic, rel=1e-4)


def test_a_torus_of_no_motion_has_no_criticality() -> None:
    system = ImpactChain(masses=10, frequency=1.3)
    branch = continue_orbit(system.periodic_orbit(periods=2), "frequency", bounds=(1.2, 1.4))
    (torus,) = [b for b in of_kind(branch, "NS") if not b.admissible]
    assert torus.criticality is None
