"""Every way in which a branch ends has a name, and what is bad is refused in one line."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from dynkit.continuation.continuing import continue_orbit
from dynkit.dynamics.equilibrium import equilibrium, shrinks
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.periodic_orbit import periodic_orbit
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.orbits.solving import solve
from dynkit.systems import Brusselator, ImpactChain, Logistic, VanDerPol
from tests.continuation.families import Cycle, CycleProblem, Flat
from tests.continuation.starts import flat, logistic


def reasons(orbit: PeriodicOrbit, name: str, **options: Any) -> list[str]:
    return [ending.reason.name for ending in continue_orbit(orbit, name, **options).endings]


def test_the_last_point_is_on_the_bound() -> None:
    branch = continue_orbit(logistic(), "rate", bounds=(2.1, 3.7))
    assert list(branch.parameter[[0, -1]]) == [2.1, 3.7]
    assert [str(e) for e in branch.endings] == [
        "the bound was reached: rate 2.1",
        "the bound was reached: rate 3.7",
    ]


def test_an_orbit_on_the_bound_goes_one_way() -> None:
    branch = continue_orbit(logistic(2.5), "rate", bounds=(2.5, 3.7))
    assert list(branch.parameter[[0, -1]]) == [2.5, 3.7]


def test_the_number_of_points_is_a_limit() -> None:
    branch = continue_orbit(logistic(2.5), "rate", bounds=(0.5, 4.0), points=5)
    assert len(branch) == 9
    assert [ending.reason.name for ending in branch.endings] == ["LIMIT", "LIMIT"]
    assert str(branch.endings[1]).startswith("the number of points was reached: 5, at rate 2.")


def test_a_branch_ends_where_the_equations_do() -> None:
    branch = continue_orbit(flat("root", -1.0, 1.0), "p", bounds=(-3.0, 3.0))
    assert sorted(e.reason.name for e in branch.endings) == ["BOUND", "NO_SOLUTION"]
    assert abs(branch.parameter.min()) < 1e-6
    (message,) = (str(e) for e in branch.endings if e.reason.name == "NO_SOLUTION")
    assert message.endswith("the square root is not defined")


def test_a_branch_of_cycles_ends_at_its_hopf_bifurcation() -> None:
    rest = equilibrium(Brusselator(b=1.5), [1.0, 1.5])
    (hopf,) = continue_orbit(rest, "b", bounds=(1.5, 2.5)).bifurcations
    (cycle,) = hopf.switch()
    branch = continue_orbit(cycle, "b", bounds=(1.5, 2.5))
    assert sorted(e.reason.name for e in branch.endings) == ["BOUND", "EQUILIBRIUM"]
    (message,) = (str(e) for e in branch.endings if e.reason.name == "EQUILIBRIUM")
    assert message == "it shrinks to an equilibrium, at a Hopf bifurcation: near b 2"
    assert abs(branch.parameter.min() - 2.0) < 1e-6


def test_a_cycle_about_an_equilibrium_that_is_none_of_its_size_does_not_shrink() -> None:
    """Its radius is 2, and its frequency nearly that of the equilibrium."""
    cycle = periodic_orbit(
        PoincareMap(VanDerPol(mu=0.01), Hyperplane(np.array([0.0, 1.0])), 20.0), [-2.0]
    )
    assert not shrinks(cycle)


def test_a_branch_ends_where_newton_does_not_converge() -> None:
    # at a corner there is no direction
    branch = continue_orbit(flat("kink", -1.0, 1.0), "p", bounds=(-0.1, 1.2))
    assert sorted(e.reason.name for e in branch.endings) == ["BOUND", "NO_CONVERGENCE"]
    assert abs(branch.parameter.min()) < 1e-6


def test_a_closed_branch_has_two_ends_of_one_name() -> None:
    assert reasons(flat("circle", 1.0, 0.0, 1.0), "p", bounds=(-2.0, 2.0)) == ["CLOSED"] * 2


def test_a_circle_cut_by_its_bounds_is_not_closed() -> None:
    assert reasons(flat("circle", 1.0, 0.0, 1.0), "p", bounds=(-0.5, 2.0)) == ["BOUND"] * 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bounds": (3.0, 2.0)}, r"bounds must be \(low, high\) with low < high; got \(3.0, 2.0\)"),
        ({"bounds": (2.6, 3.0)}, r"rate must lie in \[2.6, 3.0\]; got 2.5"),
        ({"bounds": (2.0, np.nan)}, r"bounds\[1\] must be a finite number; got nan"),
        ({"bounds": (2.0, "3")}, r"bounds\[1\] must be a finite number; got '3'"),
        ({"bounds": 3.0}, "bounds must be two numbers; got 3.0"),
        ({"bounds": [[1, 2], [3]]}, r"bounds\[0\] must be a finite number; got \[1, 2\]"),
        ({"bounds": np.array(3.0)}, r"bounds must be two numbers; got array\(3\.\)"),
        ({"bounds": (2.0, 3.0), "step": 0.0}, "step must be positive; got 0.0"),
        ({"bounds": (2.0, 3.0), "largest_step": -1}, "largest_step must be positive; got -1"),
        ({"bounds": (2.0, 3.0), "points": 0}, "points must be a positive integer; got 0"),
    ],
)
def test_bad_options_are_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        continue_orbit(logistic(2.5), "rate", **options)


def test_a_parameter_that_the_system_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^parameter must be one of: rate; got 'speed'$"):
        continue_orbit(logistic(), "speed", bounds=(0.0, 1.0))


def test_what_is_no_orbit_is_refused() -> None:
    system: Any = Logistic(2.5)
    with pytest.raises(
        ValueError, match=r"^orbit must be a PeriodicOrbit or an Equilibrium; got Logistic"
    ):
        continue_orbit(system, "rate", bounds=(2.0, 3.0))
    attractor: Any = ImpactChain(masses=1, frequency=0.9).attractor(transient=5, impacts=5)
    with pytest.raises(ValueError, match=r">, whose periodic_orbit\(\) gives one$"):
        continue_orbit(attractor, "frequency", bounds=(0.8, 1.0))
    with pytest.raises(ValueError, match=r"^orbit must solve its equations; got a residual of "):
        continue_orbit(Cycle(Logistic(2.5), np.array([0.5])), "rate", bounds=(2.0, 3.0))


def test_an_inadmissible_start_is_refused_where_none_is_wanted() -> None:
    start = flat("cusp", 0.0, 0.0, 1.0, border=0.5)
    with pytest.raises(ValueError, match=r"^orbit must be admissible where inadmissible=False"):
        continue_orbit(start, "p", bounds=(-1.0, 1.0), inadmissible=False)


NONE = np.empty(0)


def test_no_orbit_is_an_error_that_says_how_far_it_came() -> None:
    # x^2 + 4 = 0 has no solution
    problem = CycleProblem(Flat("circle", p=2.0, q=0.0), 1, ())
    with pytest.raises(NoConvergence, match=r"^no periodic orbit found from the guess after "):
        solve(problem, np.array([0.3]), NONE)


def test_newton_converges_quadratically() -> None:
    # Newton's method on f = c - x^2 leaves f' = -(f / 2x)^2, with x >= 0.8 all the way from above
    problem = CycleProblem(Flat("circle", p=0.6, q=1.0), 1, ())
    x, history = solve(problem, np.array([1.2]), NONE)
    assert abs(x[0] - 0.8) < 1e-15
    assert len(history) > 4
    for before, after in pairwise(history):
        assert after <= (before / 1.6) ** 2 + 2.0**-52


def test_located_bifurcations_have_a_quadratic_history() -> None:
    branch = continue_orbit(flat("cusp", 0.0, 0.0, 1.0), "p", bounds=(-1.5, 1.5))
    for bifurcation in branch.bifurcations:
        for before, after in pairwise(bifurcation.history):
            # second derivatives of f are below 6 |x| < 12 here, first ones of the pair above 1
            assert after <= 12.0 * before**2 + 1e-9 * before + 1e-15


@dataclass(frozen=True, kw_only=True)
class _Half(Logistic):
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate < 1.0:
            raise ValueError(f"rate must not be less than 1; got {self.rate}")


def test_a_singular_orbit_at_the_end_of_a_range_goes_one_way() -> None:
    # at rate 1 the branch of zero is crossed by another one
    orbit = periodic_orbit(_Half(rate=1.0), [0.0])
    branch = continue_orbit(orbit, "rate", bounds=(0.5, 1.5))
    assert list(branch.parameter[[0, -1]]) == [1.0, 1.5]
    assert branch.endings[0].reason.name == "NO_SOLUTION"


@dataclass(frozen=True, kw_only=True)
class Loaded(ImpactChain):
    """A chain that a load on its first mass makes softer: without stiffness at 1."""

    load: float = 0.5

    def potential(self, x: Any) -> Any:
        return super().potential(x) - self.load * x[0] ** 2 / 2


def test_a_branch_ends_where_energies_are_refused() -> None:
    chain = Loaded(masses=2, frequency=0.87, restitution=0.8)
    orbit = chain.attractor().periodic_orbit()
    branch = continue_orbit(orbit, "load", bounds=(0.3, 3.0), step=0.1, largest_step=0.25)
    assert branch.parameter.min() == 0.3
    assert 1.0 - 1e-6 < branch.parameter.max() <= 1.0


def test_orbits_close_to_a_value_that_energies_refuse_are_continued() -> None:
    orbit = Loaded(masses=2, frequency=0.87, restitution=0.8, load=0.99).periodic_orbit()
    branch = continue_orbit(orbit, "load", bounds=(0.98, 0.999))
    assert list(branch.parameter[[0, -1]]) == [0.98, 0.999]
