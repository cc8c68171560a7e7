"""Equilibria of flows, their bifurcations and the orbits born at a Hopf point: closed forms."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq

from dynkit import (
    Branch,
    Flow,
    Network,
    NoConvergence,
    NoCrossing,
    PoincareSection,
    continue_curve,
    continue_orbit,
    equilibrium,
    explore,
)
from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.network import Link
from dynkit.core.validation import Array, finite_array
from dynkit.data.codec import decoded, encoded
from dynkit.dynamics.equilibrium import Equilibrium
from dynkit.dynamics.flow import Crossing
from dynkit.orbits.spectrum import Spectrum
from dynkit.systems import Duffing, IntegratedFlow, Logistic, Lorenz, SymbolicFlow

SIGMA, BETA = 10.0, 8.0 / 3.0
HOPF = SIGMA * (SIGMA + BETA + 3.0) / (SIGMA - BETA - 1.0)
"""C. Sparrow, The Lorenz Equations, Springer 1982, section 1.2: 24.7368..., where the fixed points
beside the origin lose stability."""


class RepelledRing(SymbolicFlow):
    """Three oscillators r' = p r - r^3, angle' = 1, that repel each other: a double HB."""

    p: float = -0.4

    def velocity(self, x: Any, y: Any, u: Any, v: Any, r: Any, s: Any) -> Any:
        masses = (x, y), (u, v), (r, s)
        found: list[Any] = []
        for a, b in masses:
            growth = self.p - a**2 - b**2
            found.append(growth * a - b - 0.1 * (x + u + r - 3 * a))
            found.append(a + growth * b - 0.1 * (y + v + s - 3 * b))
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Brusselator(IntegratedFlow):
    """x' = a - (b + 1) x + x^2 y, y' = b x - x^2 y: HB of (a, b/a) at b = 1 + a^2, omega = a.

    G. Nicolis, I. Prigogine, Self-Organization in Nonequilibrium Systems, Wiley 1977, section 7.4.
    """

    a: float = 1.0
    b: float = 1.5
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,)).tolist()
        return np.array([self.a - (self.b + 1.0) * x + x * x * y, self.b * x - x * x * y])


@dataclass(frozen=True, kw_only=True)
class ExactBrusselator(Brusselator):
    """With derivatives."""

    def velocity_jacobian(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,)).tolist()
        return np.array([[2.0 * x * y - self.b - 1.0, x * x], [self.b - 2.0 * x * y, -x * x]])

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        x = float(state[0])
        return np.array([1.0, 0.0] if name == "a" else [-x, x])


@dataclass(frozen=True, kw_only=True)
class Ring(Flow):
    """r' = r (p (1 - p) - r^2), angle' = 2, in closed form: HB at p = 0 and p = 1, one circle."""

    p: float
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,)).tolist()
        growth = self.p * (1.0 - self.p) - x * x - y * y
        return np.array([growth * x - 2.0 * y, growth * y + 2.0 * x])

    def velocity_jacobian(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,)).tolist()
        growth = self.p * (1.0 - self.p) - x * x - y * y
        turn = np.array([[0.0, -2.0], [2.0, 0.0]])
        return np.asarray(growth * np.eye(2) - 2.0 * np.outer([x, y], [x, y]) + turn)

    def advance(self, state: Array, duration: float) -> Array:
        x = finite_array("state", state, (2,))
        growth = 2.0 * self.p * (1.0 - self.p)
        spent = -np.expm1(-growth * duration) / (0.5 * growth) if growth else 2.0 * duration
        size = np.exp(-growth * duration) + float(x @ x) * spent
        turn = np.exp(2j * duration)
        rotated = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]]) @ x
        return np.asarray(rotated / np.sqrt(size))

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        def value(time: float) -> float:
            return section.direction * section.value(self.advance(state, time))

        times = np.linspace(1e-6, min(np.pi + 1e-6, time_limit), 41)
        values = [value(time) for time in times.tolist()]
        for k in range(40):
            if values[k] < 0.0 <= values[k + 1]:
                time = float(brentq(value, times[k], times[k + 1], xtol=1e-15, rtol=1e-15))
                return Crossing(time, self.advance(state, time))
        raise NoCrossing(f"no crossing within {time_limit}")


@dataclass(frozen=True, kw_only=True)
class Fold(IntegratedFlow):
    """x' = p - x^2: SN at p = 0."""

    p: float = 1.0
    dimension = 1

    def velocity(self, state: Array) -> Array:
        return self.p - finite_array("state", state, (1,)) ** 2


@dataclass(frozen=True, kw_only=True)
class Pitchfork(IntegratedFlow):
    """x' = p x - x^3: BP of x = 0 at p = 0, with x = ±sqrt(p)."""

    p: float = -1.0
    dimension = 1

    def velocity(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return self.p * x - x**3


@cache
def lorenz_branch() -> Branch:
    found = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    return continue_orbit(found, "rho", bounds=(0.5, 30.0))


@cache
def brusselator_hopf() -> Bifurcation:
    branch = continue_orbit(equilibrium(ExactBrusselator(), [1.1, 1.4]), "b", bounds=(0.5, 4.0))
    (hopf,) = branch.bifurcations
    return hopf


@pytest.mark.parametrize("rho", [1.5, 10.0, 28.0, 1e4])
def test_a_fixed_point_of_lorenz_is_as_wrong_as_it_says(rho: float) -> None:
    x = np.sqrt(BETA * (rho - 1.0))
    exact = np.array([x, x, rho - 1.0])
    found = equilibrium(Lorenz(rho=rho), 1.1 * exact)
    assert abs(found.state - exact).max() <= found.error < 1e-11 * rho
    assert found.stable == (rho < HOPF)
    assert found.residual < 1e-13


@pytest.mark.parametrize("rho", [1.5, 10.0, 28.0, 1e4])
def test_eigenvalues_are_as_wrong_as_they_say(rho: float) -> None:
    # the characteristic polynomial, Sparrow's section 1.2, in 40 digits
    x = np.sqrt(BETA * (rho - 1.0))
    found = equilibrium(Lorenz(rho=rho), [x, x, rho])
    with mpmath.workdps(40):
        s, b, r = mpmath.mpf(SIGMA), mpmath.mpf(BETA), mpmath.mpf(rho)
        roots = mpmath.polyroots([1, s + b + 1, b * (r + s), 2 * s * b * (r - 1)], maxsteps=200)
        exact = np.array([complex(root) for root in roots])
    for value, error in zip(found.eigenvalues, found.eigenvalues_error, strict=True):
        assert abs(exact - value).min() <= error < 1e-9 * abs(value)
    assert (np.diff(found.eigenvalues.real) <= 0.0).all()


def test_the_origin_is_exactly_zero() -> None:
    found = equilibrium(Lorenz(rho=15.0), [0.1, 0.1, 0.1])
    assert found.state.tolist() == [0.0, 0.0, 0.0]
    pair = np.roots([1.0, SIGMA + 1.0, SIGMA * (1.0 - 15.0)])
    assert np.allclose(found.eigenvalues.real, sorted([*pair, -BETA], reverse=True), rtol=1e-13)
    assert not found.stable


def test_bifurcations_of_lorenz_are_in_closed_form() -> None:
    found = lorenz_branch().bifurcations
    assert [b.kind for b in found] == ["HB", "BP", "HB"]
    for bifurcation, exact in zip(found, (HOPF, 1.0, HOPF), strict=True):
        assert abs(bifurcation.value - exact) <= bifurcation.error < 1e-10
    for hopf in (found[0], found[2]):
        # omega^2 = beta (sigma + rho), Sparrow's section 1.2
        omega = np.sqrt(BETA * (SIGMA + HOPF))
        assert abs(hopf.own[0] - omega) <= hopf.own_error[0] < 1e-10
        assert hopf.multiplier is not None
        assert hopf.multiplier == 1j * hopf.own[0]


def test_a_branch_point_leads_from_the_origin_to_the_other_fixed_points() -> None:
    origin = equilibrium(Lorenz(rho=0.5), [0.1, 0.1, 0.1])
    branch = continue_orbit(origin, "rho", bounds=(0.2, 30.0))
    (meeting,) = branch.bifurcations
    assert abs(meeting.value - 1.0) <= meeting.error < 1e-10
    (other,) = meeting.switch()
    assert isinstance(other, Equilibrium)
    rho = other.system.rho
    assert abs(abs(other.state[0]) - np.sqrt(BETA * (rho - 1.0))) <= other.error + 1e-13
    assert other.stable


def test_stability_changes_at_bifurcations() -> None:
    branch = lorenz_branch()
    stable = (branch.parameter < HOPF) & (abs(branch.unknowns[:, 0]) > 0.0)
    assert (branch.stable == stable).all()
    assert branch.spectrum is Spectrum.EIGENVALUES
    assert branch.label == "equilibrium"
    assert branch.error.max() < 1e-10
    assert branch.multipliers_error.shape == branch.multipliers.shape


@pytest.mark.parametrize("a", [0.1, 0.7, 1.0, 3.0])
def test_the_brusselator_has_its_hopf_point(a: float) -> None:
    start = equilibrium(ExactBrusselator(a=a, b=0.9 + a * a), [a, 1.0 / a])
    (hopf,) = continue_orbit(start, "b", bounds=(0.5, 2.0 + a * a)).bifurcations
    assert hopf.kind == "HB"
    assert abs(hopf.value - (1.0 + a * a)) <= hopf.error < 1e-10
    assert abs(hopf.own[0] - a) <= hopf.own_error[0]


def test_a_double_hopf_point_says_why_no_orbit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: object) -> None:
        raise NoConvergence("no orbit")

    # whether one is found hangs on last digits
    monkeypatch.setattr("dynkit.continuation.bifurcations.switching._stepped", failing)
    branch = continue_orbit(equilibrium(RepelledRing(), [0.0] * 6), "p", bounds=(-0.5, -0.1))
    (hopf,) = branch.bifurcations
    assert hopf.kind == "HB"
    assert hopf.value == pytest.approx(-0.3, abs=1e-12)
    with pytest.raises(NoConvergence, match="the critical pair is double, as by a symmetry"):
        hopf.switch()


def test_without_derivatives_the_error_is_larger_and_holds() -> None:
    start = equilibrium(Brusselator(), [1.1, 1.4])
    (hopf,) = continue_orbit(start, "b", bounds=(1.5, 2.5)).bifurcations
    assert abs(hopf.value - 2.0) <= hopf.error < 1e-8


def test_hopf_points_in_two_parameters_are_a_parabola() -> None:
    curve = continue_curve(brusselator_hopf(), ("a", "b"), bounds=((0.3, 3.0), (1.0, 6.0)))
    a, b = curve.parameters.T
    assert abs(b - 1.0 - a**2).max() < 1e-12
    assert abs(curve.own[:, 0] - a).max() < 1e-12


def test_a_curve_of_hopf_points_ends_where_the_frequency_vanishes() -> None:
    # at a = 0 both eigenvalues are zero
    curve = continue_curve(brusselator_hopf(), ("a", "b"), bounds=((-1.0, 2.0), (0.5, 4.0)))
    assert "DOUBLE_ZERO" in [ending.reason.name for ending in curve.endings]
    assert curve.own.min() == pytest.approx(1e-3, rel=1e-9)


def test_a_fold_is_solved_for() -> None:
    branch = continue_orbit(equilibrium(Fold(), [0.9]), "p", bounds=(-1.0, 2.0))
    (fold,) = branch.bifurcations
    assert fold.kind == "SN"
    assert abs(fold.value) <= fold.error < 1e-10
    assert fold.multiplier == 0.0
    assert not fold.switch()


def test_a_pitchfork_is_switched_to_its_other_branches() -> None:
    branch = continue_orbit(equilibrium(Pitchfork(), [0.1]), "p", bounds=(-2.0, 1.0))
    (meeting,) = branch.bifurcations
    assert meeting.kind == "BP"
    assert abs(meeting.value) <= meeting.error < 1e-10
    (other,) = meeting.switch()
    assert abs(other.state[0] ** 2 - other.system.p) < 1e-12
    both = continue_orbit(other, "p", bounds=(-1.0, 1.0))
    # one parabola: it turns where it meets the straight branch, and is symmetric about it
    assert abs(both.unknowns[:, 0] ** 2 - both.parameter).max() < 1e-9


def test_the_orbit_born_at_a_hopf_point_grows_as_a_square_root() -> None:
    hopf = brusselator_hopf()
    (orbit,) = hopf.switch()
    assert orbit.label == "P(1)"
    assert orbit.stable
    returns = orbit.system
    assert returns.return_time(orbit.states[0]) == pytest.approx(2.0 * np.pi, rel=1e-4)
    branch = continue_orbit(orbit, "b", bounds=(1.9, 2.01), points=6)
    # the plane goes through the equilibria to first order: what is left of it is the oscillation
    amplitude = abs(branch.unknowns[:, 0] - branch.parameter)
    beyond = branch.parameter - 2.0
    far = beyond > 1e-5  # the rounding of returns is 1e-8 of the parameter at the smallest orbit
    slope = np.polyfit(np.log(beyond[far]), np.log(amplitude[far]), 1)[0]
    assert far.sum() >= 5
    assert slope == pytest.approx(0.5, abs=0.02)


def test_the_orbit_born_at_the_hopf_point_of_lorenz_is_unstable_and_below_it() -> None:
    hopf = lorenz_branch().bifurcations[0]
    (orbit,) = hopf.switch()
    assert orbit.system.flow.rho < HOPF
    assert not orbit.stable
    period = orbit.system.return_time(orbit.states[0])
    assert period == pytest.approx(2.0 * np.pi / hopf.own[0], rel=1e-3)


def test_a_stored_branch_of_equilibria_has_the_same_bits(tmp_path: Path) -> None:
    branch = lorenz_branch()
    branch.save(tmp_path / "branch.h5")
    loaded = Branch.load(tmp_path / "branch.h5", equilibrium(Lorenz(rho=15.0), [6, 6, 14]))
    assert loaded.multipliers.tobytes() == branch.multipliers.tobytes()
    assert loaded.stable.tolist() == branch.stable.tolist()
    assert [b.kind for b in loaded.bifurcations] == ["HB", "BP", "HB"]
    assert isinstance(loaded.orbit(0), Equilibrium)


def test_a_store_from_before_there_were_equilibria_is_read() -> None:
    arrays: dict[str, Any] = {}
    tree = encoded("", lorenz_branch(), arrays)
    del tree["spectrum"]
    assert decoded(Branch, "", tree, arrays).spectrum is Spectrum.MULTIPLIERS


def test_a_branch_of_equilibria_is_drawn() -> None:
    axes = lorenz_branch().plot()
    assert axes.get_ylabel() == "flow[0]"
    assert {"stable", "unstable"} <= {line.get_label() for line in axes.get_lines()}


def test_an_equilibrium_says_what_it_is() -> None:
    found = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    assert repr(found) == "<equilibrium of Lorenz(rho=15): stable>"
    assert found.observable("flow[2]") == pytest.approx(14.0)
    assert found.admissible
    assert found.cost.counts["newton steps"] >= 1
    with pytest.raises(ValueError, match=r"^name must be one of"):
        found.observable("flow[3]")


@pytest.mark.parametrize(
    ("flow", "guess", "message"),
    [
        (Logistic(2.5), [0.5], r"^flow must be a Flow; got Logistic"),
        (Lorenz(), [0.5], r"^guess must"),
        (Lorenz(), [0.5, np.nan, 1.0], r"^guess"),
    ],
)
def test_bad_input_is_refused(flow: Any, guess: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        equilibrium(flow, guess)


def test_a_flow_that_never_rests_has_none() -> None:
    # the phase of the forcing goes on
    with pytest.raises(NoConvergence, match=r"^no equilibrium found from the guess"):
        equilibrium(Duffing(), [0.1, 0.1, 0.1])


def test_an_unknown_parameter_is_refused() -> None:
    found = equilibrium(Lorenz(rho=15.0), [6.0, 6.0, 14.0])
    with pytest.raises(ValueError, match=r"^parameter must be one of: .*; got 'speed'$"):
        continue_orbit(found, "speed", bounds=(0.0, 1.0))


# --- networks -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ring() -> Network:
    start = equilibrium(Ring(p=-0.3), [0.0, 0.0])
    return explore(Ring(p=-0.3), "p", (-0.5, 1.5), seeds=[start])


def test_a_network_leads_from_equilibria_to_the_orbits_of_both_hopf_points(ring: Network) -> None:
    """The circle r^2 = p (1 - p), found from both ends on two planes, is one branch."""
    assert [branch.label for branch in ring.branches] == ["equilibrium", "P(1)"]
    assert [b.kind for b in ring.branches[0].bifurcations] == ["HB", "HB"]
    assert ring.links == (Link(0, 0, 1), Link(0, 1, 1))
    assert ring.unexplored == ()
    equilibria, orbits = ring.orbits(0.3)
    assert not equilibria.stable
    assert orbits.stable
    assert abs(orbits.observable("norm")[0] - np.sqrt(0.3 * 0.7)) < 1e-10


def test_hopf_points_of_the_ring_are_supercritical(ring: Network) -> None:
    """Re c = -2: z' = -z |z|^2, and z is the square root of two times the normal form's."""
    for hopf, side in zip(ring.branches[0].bifurcations, (1, -1), strict=True):
        found = hopf.criticality
        assert found is not None
        assert (found.supercritical, found.side) == (True, side)
        assert abs(found.coefficient + 2.0) <= found.error < 1e-8


def test_a_network_of_equilibria_and_orbits_is_drawn_by_the_norm(ring: Network) -> None:
    assert ring.plot().get_ylabel() == "norm"
    plt.close("all")


def test_a_network_of_a_flow_is_the_same_by_an_executor(ring: Network) -> None:
    start = equilibrium(Ring(p=-0.3), [0.0, 0.0])
    with ThreadPoolExecutor(2) as executor:
        again = explore(Ring(p=-0.3), "p", (-0.5, 1.5), seeds=[start], executor=executor)
    assert again.links == ring.links
    pairs = zip(again.branches, ring.branches, strict=True)
    assert all((one.unknowns == other.unknowns).all() for one, other in pairs)


def test_a_network_of_equilibria_comes_back_from_a_store(ring: Network, tmp_path: Path) -> None:
    ring.save(tmp_path / "ring.h5")
    start = equilibrium(Ring(p=-0.3), [0.0, 0.0])
    (loaded, _) = Network.load(tmp_path / "ring.h5", [start]).branches
    assert loaded.orbit(0).label == "equilibrium"
    assert (loaded.unknowns == ring.branches[0].unknowns).all()


def test_a_flow_is_explored_from_equilibria_only() -> None:
    with pytest.raises(ValueError, match="seeds must be equilibria, for a flow; got None"):
        explore(Ring(p=-0.3), "p", (-0.5, 1.5))
    with pytest.raises(ValueError, match=r"seeds\[0\] must be a PeriodicOrbit or an Equilibrium"):
        explore(Ring(p=-0.3), "p", (-0.5, 1.5), seeds=[5])  # type: ignore[list-item]
    start = equilibrium(Lorenz(rho=0.5), [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"seeds\[0\] must have a parameter 'p'; got <equilib"):
        explore(Ring(p=-0.3), "p", (-0.5, 1.5), seeds=[start])
    with pytest.raises(ValueError, match="system must be a Map or a Flow; got 5"):
        explore(5, "p", (-0.5, 1.5))  # type: ignore[arg-type]


def test_branches_of_the_lorenz_equations_hang_together() -> None:
    start = equilibrium(Lorenz(rho=0.5), [0.0, 0.0, 0.0])
    network = explore(Lorenz(rho=0.5), "rho", (0.2, 10.0), seeds=[start])
    assert [branch.label for branch in network.branches] == ["equilibrium", "equilibrium"]
    assert all(link.to == 1 for link in network.links if link.branch == 0)


class Autocatalysis(SymbolicFlow):
    """The Brusselator: its equilibrium is (a, b / a)."""

    a: float = 1.0
    b: float = 1.5

    def velocity(self, x: Any, y: Any) -> Any:
        return self.a + x**2 * y - (self.b + 1.0) * x, self.b * x - x**2 * y


@pytest.mark.parametrize("far", [20.0, 1e3, 1e6, 1e9])
def test_a_far_guess_leads_to_an_equilibrium_or_to_none(far: float) -> None:
    try:
        found = equilibrium(Autocatalysis(), [far, 3.0])
    except NoConvergence:
        return
    assert abs(found.state - [1.0, 1.5]).max() <= found.error < 1e-12


def test_where_the_velocity_is_not_zero_there_is_no_equilibrium() -> None:
    with pytest.raises(NoConvergence, match="the derivative is singular"):
        equilibrium(Autocatalysis(), [1e6, 3.0])
