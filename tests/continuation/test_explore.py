"""Networks of branches that are found without being told where."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit import Network, explore, periodic_orbit
from dynkit.continuation import exploring
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.network import Finish
from dynkit.continuation.results.branch import Branch
from dynkit.continuation.results.membership import Trail
from dynkit.systems import Henon, ImpactChain, Logistic
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact.one_mass import DIGITS, flight_matrix

TEN_DIGITS = 1e-10

LOGISTIC = (2.8, 3.98)
BOX = [(0.1, 1.0)]


def values(network: Network, kind: str, label: str) -> list[float]:
    return sorted(value for x in network.find(label) for value in values_of(x, kind))


def values_of(branch: Branch, kind: str) -> list[float]:
    return [b.value for b in branch.bifurcations if b.kind == kind]


def agree(found: list[float], exact: list[float], within: float) -> bool:
    return len(found) == len(exact) and bool(abs(np.subtract(found, exact)).max() < within)


@pytest.fixture(scope="module")
def logistic() -> Network:
    return explore(Logistic(rate=2.9), "rate", LOGISTIC, iterates=8, box=BOX, values=4)


# --- the logistic map -----------------------------------------------------------------------------


def test_the_tree_of_period_doublings_is_found(logistic: Network) -> None:
    # R. M. May, Nature 261 (1976) 459-467; 3.5440903596 and 3.5644072661 solve algebraic equations
    # (I. S. Kotsireas, K. Karamanos, Int. J. Bifurcation Chaos 14 (2004) 2417-2423).
    assert agree(values(logistic, "PD", "P(1)"), [3.0], TEN_DIGITS)
    assert agree(values(logistic, "PD", "P(2)"), [1.0 + 6.0**0.5], TEN_DIGITS)
    assert agree(values(logistic, "PD", "P(4)")[:1], [3.5440903596], 1e-9)
    (cascade,) = (b for b in logistic.find("P(8)") if "BP 3.5440" in repr(b))
    assert cascade.parameter.max() == LOGISTIC[1]


def test_the_window_of_period_three_is_found(logistic: Network) -> None:
    assert agree(values(logistic, "SN", "P(3)"), [1.0 + 8.0**0.5], TEN_DIGITS)
    (doubled,) = values(logistic, "PD", "P(3)")
    assert any(agree(values_of(b, "BP"), [doubled], TEN_DIGITS) for b in logistic.find("P(6)"))


def test_the_network_says_what_branches_off_what(logistic: Network) -> None:
    led = {
        (logistic.branches[link.branch].label, logistic.branches[link.to].label)
        for link in logistic.links
        if logistic.branches[link.branch].bifurcations[link.bifurcation].kind == "PD"
    }
    assert led == {("P(1)", "P(2)"), ("P(2)", "P(4)"), ("P(4)", "P(8)"), ("P(3)", "P(6)")}
    doubled = [link for link in logistic.links if logistic.branches[link.branch].label == "P(4)"]
    # the P(4) that is born in a pair doubles, too
    assert len({link.to for link in doubled if logistic.branches[link.to].label == "P(8)"}) == 2


def test_doubled_branches_lead_back_to_where_they_come_from(logistic: Network) -> None:
    back = {
        (logistic.branches[link.branch].label, logistic.branches[link.to].label)
        for link in logistic.links
        if logistic.branches[link.branch].bifurcations[link.bifurcation].kind == "BP"
    }
    assert back == {("P(2)", "P(1)"), ("P(4)", "P(2)"), ("P(8)", "P(4)"), ("P(6)", "P(3)")}


def test_a_network_says_what_was_searched_and_never_that_all_was_found(logistic: Network) -> None:
    assert logistic.finish is Finish.COMPLETE
    assert logistic.unexplored == ()
    assert logistic.message == (
        "the search went to its end; searched: P(1) to P(8) with states in [0, 1] at 6 values of "
        "rate from 2.8 to 3.98, resolved up to P(8) at 6 of them"
    )
    assert "all" not in " ".join(finish.value for finish in Finish).split()


def test_a_search_that_runs_out_of_calls_is_no_claim() -> None:
    network = explore(
        Logistic(rate=4.0), "rate", (3.9, 4.0), iterates=7, box=BOX, values=1, calls=4_400
    )
    assert "resolved up to P(" in network.message
    assert "resolved up to P(7) at 3 of them" not in network.message


def necklaces(period: int) -> int:
    """Orbits of least period n of the logistic map at 4, as many as aperiodic binary necklaces."""
    points = 2**period
    return (
        int(points - sum(k * necklaces(k) for k in range(1, period) if period % k == 0)) // period
    )


def test_all_orbits_of_the_logistic_map_at_four_are_reached() -> None:
    # conjugate to the tent map: x = sin^2(pi k / (2^n - 1)) and sin^2(pi k / (2^n + 1))
    network = explore(Logistic(rate=3.9), "rate", (3.5, 4.0), iterates=6, box=BOX, values=1)
    counts = Counter(orbit.label for orbit in network.orbits(4.0))
    assert counts == {f"P({n})": necklaces(n) for n in range(1, 7)}


def places_on(branch: Branch) -> list[int]:
    """Numbers of some points of a branch."""
    places: list[int] = np.unique(np.linspace(0, len(branch) - 1, 7).astype(int)[1:-1]).tolist()
    return places


def on(branch: Branch, other: Branch) -> int:
    """How many of these points lie on another branch."""
    trail = Trail(other)
    return sum(trail.holds(branch.orbit(i)) for i in places_on(branch))


def overlaps(network: Network) -> list[tuple[int, int]]:
    return [
        (i, j)
        for i, a in enumerate(network.branches)
        for j, b in enumerate(network.branches)
        if i != j and a.label == b.label and on(a, b)
    ]


def test_no_branch_of_the_logistic_map_is_found_twice(logistic: Network) -> None:
    assert overlaps(logistic) == []


def test_every_point_lies_on_its_own_branch(logistic: Network) -> None:
    for branch in logistic.branches:
        assert on(branch, branch) == len(places_on(branch))


def test_the_same_arguments_give_the_same_network() -> None:
    """Whatever the value of the parameter that changes."""
    first, again = (
        explore(Logistic(rate=rate), "rate", LOGISTIC, iterates=4, box=BOX, values=1)
        for rate in (2.9, 3.3)
    )
    assert len(first) >= 5
    assert again.links == first.links
    for one, other in zip(again.branches, first.branches, strict=True):
        assert np.array_equal(one.unknowns, other.unknowns)
        assert np.array_equal(one.parameter, other.parameter)


def test_the_network_takes_one_line(logistic: Network) -> None:
    assert repr(logistic).startswith(f"<Network of {len(logistic)} branches of P(1), P(2), P(3)")
    assert "\n" not in repr(logistic)


def test_henon_is_explored_in_the_same_way() -> None:
    # towards a = 0 a branch grows to infinity
    box = [(-2.0, 2.0), (-1.0, 1.0)]
    network = explore(Henon(a=0.5, b=0.3), "a", (0.05, 1.0), iterates=4, box=box, values=1)
    box = [(-9.0, 9.0), (-3.0, 3.0)]
    folded = explore(Henon(a=-0.1, b=0.3), "a", (-0.2, -0.05), iterates=2, box=box, values=1)
    # the fixed points fold at -(1 - b)^2 / 4 and double at 3 (1 - b)^2 / 4
    assert agree(values(folded, "SN", "P(1)"), [-0.1225], TEN_DIGITS)
    assert agree(values(network, "PD", "P(1)"), [0.3675], TEN_DIGITS)
    assert len(network.find("P(4)")) == 1


# --- what ends an exploration ---------------------------------------------------------------------


def test_a_budget_of_branches_is_kept() -> None:
    network = explore(
        Logistic(rate=2.9), "rate", LOGISTIC, iterates=8, box=BOX, values=4, branches=3
    )
    assert len(network) == 3
    assert network.finish is Finish.BUDGET
    assert network.message.startswith("the budget was used up; left unexplored: ")
    assert network.unexplored


def test_a_budget_of_points_ends_the_last_branch() -> None:
    network = explore(
        Logistic(rate=2.9), "rate", LOGISTIC, seeds=[periodic_orbit(Logistic(2.9), [0.6])], points=5
    )
    (branch,) = network.branches
    assert {ending.reason.name for ending in branch.endings} <= {"LIMIT", "BOUND"}
    assert len(branch) < 10


def test_what_is_left_is_named() -> None:
    network = explore(
        Logistic(rate=2.9),
        "rate",
        LOGISTIC,
        seeds=[periodic_orbit(Logistic(2.9), [0.6])],
        branches=1,
    )
    ((branch, bifurcation, why),) = network.unexplored
    assert (branch, bifurcation) == (0, 0)
    assert why == "the budget was used up"
    assert network.message == (
        "the budget was used up; left unexplored: 1 bifurcations; "
        "searched: nothing but the orbits given"
    )


@pytest.mark.parametrize(
    ("raised", "finish"),
    [(KeyboardInterrupt(), Finish.INTERRUPTED), (MemoryError("no room"), Finish.FAILED)],
)
def test_nothing_is_lost_when_it_is_ended(
    monkeypatch: pytest.MonkeyPatch, raised: BaseException, finish: Finish
) -> None:
    calls = iter(range(10))

    def ended(*arguments: object, **options: object) -> Branch:
        if next(calls) == 2:
            raise raised
        return continue_orbit(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(exploring, "continue_orbit", ended)
    network = explore(Logistic(rate=2.9), "rate", LOGISTIC, iterates=4, box=BOX, values=2)
    assert network.finish is finish
    assert len(network) == 2
    assert str(raised) in network.message
    assert network.unexplored


# --- stores ---------------------------------------------------------------------------------------


def test_a_network_is_read_as_it_was_written(logistic: Network, tmp_path: Path) -> None:
    logistic.save(tmp_path / "network.h5")
    orbits = [branch.orbit(0) for branch in logistic.branches]
    found = Network.load(tmp_path / "network.h5", orbits)
    assert found.links == logistic.links
    assert repr(found) == repr(logistic)
    for one, other in zip(found.branches, logistic.branches, strict=True):
        assert np.array_equal(one.unknowns, other.unknowns)
        assert np.array_equal(one.observable("state[0]"), other.observable("state[0]"))


def test_a_network_is_read_without_orbits(logistic: Network, tmp_path: Path) -> None:
    logistic.save(tmp_path / "network.h5")
    found = Network.load(tmp_path / "network.h5")
    assert [b.value for b in found.bifurcations] == [b.value for b in logistic.bifurcations]


def test_another_store_is_refused(logistic: Network, tmp_path: Path) -> None:
    logistic.branches[0].save(tmp_path / "branch.h5")
    with pytest.raises(ValueError, match="store must hold a Network; got"):
        Network.load(tmp_path / "branch.h5")


# --- one mass: isolated closed branches -----------------------------------------------------------

# A table below the mass at rest: it is hit only where the response is large.
RESTING = ImpactChain(
    masses=1, damping=0.1, restitution=0.7, amplitude=0.1, offset=-0.2, frequency=2.0
)


def discriminant(system: ImpactChain, periods: int, frequency: mpf) -> mpf:
    """Of the quadratic equation for the impulse of P(1,m); orbits exist where it is positive.

    See `tests.impact.one_mass`; without forces on the mass the steady gap is the table's motion.
    """
    c, k = mpf(float(system.damping_matrix[0, 0])), mpf(float(system.stiffness[0, 0]))
    r, w = mpf(system.restitution), frequency
    middle = -mpf(system.offset)
    flight = flight_matrix(c, k, 2 * periods * mp.pi / w)
    p, q = (mpmath.eye(2) - flight) ** -1 * mpmath.matrix([0, 1])
    s = r / (1 + r) - q
    square, linear = p * p + (s / w) ** 2, middle * p
    return linear * linear - square * (middle * middle - mpf(system.amplitude) ** 2)


def folds(system: ImpactChain, periods: int, brackets: list[tuple[float, float]]) -> list[float]:
    with mp.workdps(DIGITS):
        return [
            float(
                mpmath.findroot(
                    lambda w: discriminant(system, periods, w), bracket, solver="anderson"
                )
            )
            for bracket in brackets
        ]


@pytest.fixture(scope="module")
def isolated() -> Network:
    return explore(RESTING, "frequency", (1.0, 6.0), iterates=1, periods=3, values=40)


def test_isolated_branches_are_found_with_both_their_folds(isolated: Network) -> None:
    assert all(branch.closed for branch in isolated.branches)
    exact = folds(RESTING, 3, [(1.5, 1.7), (1.7, 1.9), (3.0, 3.2), (5.6, 5.8)])
    found = values(isolated, "SN", "P(1,3)")
    assert agree(found, exact, 1e-9)
    assert len(isolated.find("P(1,3)")) == 2


def test_isolated_branches_of_other_periods_too(isolated: Network) -> None:
    for periods, brackets in ((1, [(1.0, 1.2), (1.6, 1.8)]), (2, [(2.0, 2.2), (3.6, 3.8)])):
        found = values(isolated, "SN", f"P(1,{periods})")
        assert agree(found, folds(RESTING, periods, brackets), 1e-9)


def test_no_isolated_branch_is_found_twice(isolated: Network) -> None:
    assert overlaps(isolated) == []


# --- the chain of ten masses ----------------------------------------------------------------------

AROUND = (0.78, 0.82)


@pytest.fixture(scope="module")
def chain() -> Network:
    return explore(ImpactChain(frequency=0.80), "frequency", AROUND, periods=3, values=2)


def stable_orbits(network: Network, frequency: float) -> list[ImpactOrbit]:
    return [
        orbit
        for orbit in network.orbits(frequency)
        if isinstance(orbit, ImpactOrbit) and orbit.stable and orbit.admissible
    ]


def test_stable_orbits_that_the_default_start_does_not_reach(chain: Network) -> None:
    """Simulated from where they are, they stay; the default start leads elsewhere."""
    stable, unreached = stable_orbits(chain, 0.80), 0
    assert len(stable) == 2
    for orbit in stable:
        state = orbit.system.impact_state(orbit.states[0])
        kept = orbit.system.attractor(transient=400, impacts=20, start=state)
        assert str(kept.label) == orbit.label
        at_rest = orbit.system.attractor(transient=2000, impacts=20)
        there, here = (
            np.sort(a.record.relative_velocity[-orbit.impacts :]) for a in (at_rest, kept)
        )
        expected = np.sort(orbit.relative_velocity)
        assert abs(here - expected).max() < 1e-9
        unreached += bool(abs(there - expected).max() > 1e-3)
    assert unreached >= 1


def test_no_branch_of_the_chain_is_found_twice(chain: Network) -> None:
    assert overlaps(chain) == []


def test_grazing_leads_to_orbits_of_one_impact_more(chain: Network) -> None:
    led = {
        (chain.branches[link.branch].label, chain.branches[link.to].label)
        for link in chain.links
        if chain.branches[link.branch].bifurcations[link.bifurcation].kind == "GR"
    }
    assert ("P(1,3)", "P(2,3)") in led
    assert ("P(2,3)", "P(1,3)") in led


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parameter": "r"}, "parameter must be one of: rate; got 'r'"),
        ({"bounds": (3.0, 2.0)}, "bounds must be .low, high. with low < high; got .3.0, 2.0."),
        ({"iterates": 0}, "iterates must be a positive integer; got 0"),
        ({"values": 0}, "values must be a positive integer; got 0"),
        ({"branches": 0}, "branches must be a positive integer; got 0"),
        ({"points": -1}, "points must be a positive integer; got -1"),
        ({"box": None}, "box or seeds must be given for a system without find_orbits; got"),
        ({"box": [(1.0, 0.0)]}, "box.0. must be .low, high. with low < high; got .1.0, 0.0."),
        ({"box": [0.0, 1.0]}, "box must have shape .1, 2.; got shape .2,."),
        ({"seeds": []}, "box must not be given together with seeds"),
    ],
)
def test_bad_input_is_refused(options: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"parameter": "rate", "bounds": (2.8, 3.2), "box": BOX, **options}
    with pytest.raises(ValueError, match=message):
        explore(Logistic(rate=2.9), **given)  # type: ignore[arg-type]
