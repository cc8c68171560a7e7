"""Crossings of integrated flows: against closed forms, near tangency, at the start, at the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings, strategies as st

from dynkit import Hyperplane, PoincareMap, PoincareSection
from dynkit.core.no_motion import CannotFollow, NoCrossing
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.systems import IntegratedFlow, SymbolicFlow
from dynkit.systems.flows.crossings import Look, Search
from dynkit.systems.flows.integration import METHODS, integrated_steps
from tests.flows.cases import FLOWS, ROUNDING, STATES, Parabola, Rotation
from tests.flows.integrated_flows import Lorenz

SECTIONS: list[PoincareSection] = [
    Hyperplane(np.array([1.0, 0.3, 0.0]), 0.1),
    Hyperplane(np.array([1.0, -0.2, 0.0]), 0.3, -1),
    Parabola(1, height=0.1, bend=0.3),
    Parabola(1, height=0.2, bend=-0.1, direction=-1),
]


def circle(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def plane_at(angle: float, offset: float, direction: int = 1) -> Hyperplane:
    """The plane x cos(angle) + y sin(angle) = offset."""
    return Hyperplane(circle(angle), offset, direction)


def first(flow: IntegratedFlow, start: Array, section: PoincareSection) -> Crossing:
    return flow.next_crossing(start, section, time_limit=100.0)


# --- where, and when ------------------------------------------------------------------------------


@given(
    st.floats(0.0, 6.28),
    st.floats(1e-3, 6.28),
    st.floats(-0.99, 0.99),
    st.sampled_from([1, -1]),
    st.sampled_from([1e-12, 1e-8, 1e-4]),
)
@settings(max_examples=60)
def test_a_crossing_of_a_circle_comes_when_its_closed_form_says(
    start: float, time: float, offset: float, direction: int, tolerance: float
) -> None:
    # cos(t - angle) rises through the offset before its maximum, and falls through it after
    plane = plane_at(start + time + direction * np.arccos(offset), offset, direction)
    hit = first(Rotation(tolerance=tolerance), circle(start), plane)
    # some tens of steps, each off by the tolerance; the value's rate is sqrt(1 - offset^2)
    assert abs(hit.time - time) <= 100.0 * tolerance / np.sqrt(1.0 - offset**2)


@pytest.mark.parametrize("section", SECTIONS, ids=["plane", "plane -", "parabola", "parabola -"])
@pytest.mark.parametrize("name", FLOWS)
def test_at_a_crossing_the_value_is_rounding(name: str, section: PoincareSection) -> None:
    for start in STATES[name]:
        hit = first(FLOWS[name], start, section)
        reach = np.linalg.norm(section.gradient(hit.state)) * (1.0 + np.linalg.norm(hit.state))
        assert abs(section.value(hit.state)) <= 2.0 * ROUNDING * reach


@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
@pytest.mark.parametrize("name", FLOWS)
def test_a_crossing_is_on_the_motion(name: str, tolerance: float) -> None:
    flow = FLOWS[name].replace(tolerance=tolerance)
    for start in STATES[name]:
        hit = first(flow, start, SECTIONS[0])
        off = np.linalg.norm(flow.advance(start, hit.time) - hit.state)
        # both are integrated: their errors may add up
        assert off <= 2.0 * flow.advance_error(start, hit.time)


@pytest.mark.parametrize("direction", [1, -1])
def test_passages_the_other_way_do_not_count(direction: int) -> None:
    hit = first(Rotation(), circle(0.0), plane_at(0.0, 0.5, direction))
    falls, rises = np.arccos(0.5), 2.0 * np.pi - np.arccos(0.5)
    assert hit.time == pytest.approx(rises if direction > 0 else falls, abs=1e-10)


def test_a_longer_time_limit_changes_nothing() -> None:
    short = Lorenz().next_crossing(STATES["lorenz"][0], SECTIONS[0], time_limit=5.0)
    long = Lorenz().next_crossing(STATES["lorenz"][0], SECTIONS[0], time_limit=5e5)
    assert short.time == long.time


# --- near tangency --------------------------------------------------------------------------------

STARTS = np.linspace(0.0, 6.0, 25)
GRAZING = 1.0  # the angle at which a circle comes nearest to the plane


@pytest.mark.parametrize(
    ("depth", "tolerance"),
    [(1e-1, 1e-3), (1e-2, 1e-4), (1e-3, 1e-6), (1e-5, 1e-8), (1e-7, 1e-10), (1e-9, 1e-12)],
)
def test_passages_deeper_than_the_error_are_found(depth: float, tolerance: float) -> None:
    """A circle of radius 1 and the plane at 1 - depth: they meet for 2 sqrt(2 depth)."""
    half = np.arccos(1.0 - depth)
    for start in STARTS:
        hit = first(Rotation(tolerance=tolerance), circle(start), plane_at(GRAZING, 1.0 - depth))
        expected = (GRAZING - half - start) % (2.0 * np.pi)
        assert abs(hit.time - expected) <= 100.0 * tolerance / half


@pytest.mark.parametrize(("height", "tolerance"), [(1e-2, 1e-4), (1e-5, 1e-8), (1e-9, 1e-12)])
def test_misses_wider_than_the_error_are_no_crossings(height: float, tolerance: float) -> None:
    for start in STARTS:
        with pytest.raises(NoCrossing, match=r"^no crossing within 20\.0$"):
            Rotation(tolerance=tolerance).next_crossing(
                circle(start), plane_at(GRAZING, 1.0 + height), time_limit=20.0
            )


@pytest.mark.parametrize("start", STARTS[1:])
def test_a_touch_is_passed_or_reported_where_it_is(start: float) -> None:
    try:
        hit = Rotation().next_crossing(circle(start), plane_at(start - 1.0, 1.0), time_limit=20.0)
    except NoCrossing:
        return
    # a value of 1e-12 at 1 - t^2/2, after one turn or two or three
    late = (hit.time + 1.0 + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(late) <= 1e-5


# --- at the start ---------------------------------------------------------------------------------


@pytest.mark.parametrize("aside", [0.0, 1e-16, -1e-16, 1e-14, -1e-14])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("offset", [0.0, 0.6, -0.95])
def test_a_start_on_the_section_has_not_crossed_it(
    offset: float, direction: int, aside: float
) -> None:
    start = circle(-direction * np.arccos(offset)) + np.array([aside, 0.0, 0.0])
    hit = first(Rotation(), start, plane_at(0.0, offset, direction))
    assert hit.time == pytest.approx(2.0 * np.pi, abs=1e-10)


@pytest.mark.parametrize("before", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_start_just_before_the_section_crosses_it_at_once(before: float) -> None:
    hit = first(Rotation(), circle(-before), plane_at(np.pi / 2.0, 0.0))
    assert hit.time == pytest.approx(before, abs=1e-15)


@pytest.mark.parametrize("after", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_start_just_beyond_the_section_crosses_it_a_turn_later(after: float) -> None:
    hit = first(Rotation(), circle(after), plane_at(np.pi / 2.0, 0.0))
    assert hit.time == pytest.approx(2.0 * np.pi - after, abs=1e-10)


@pytest.mark.parametrize("depth", [1e-1, 1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-12])
def test_a_start_that_leaves_backwards_returns_soon(depth: float, tolerance: float) -> None:
    """On the plane at 1 - depth and beyond it for 2 arccos(1 - depth), seen from the far side."""
    half = np.arccos(1.0 - depth)
    hit = first(Rotation(tolerance=tolerance), circle(-half), plane_at(0.0, 1.0 - depth, -1))
    # the start's rounding moves the other end by as much over the rate
    assert hit.time == pytest.approx(2.0 * half, abs=10.0 * half * tolerance + 1e-15 / half)


@pytest.mark.parametrize("name", FLOWS)
def test_the_next_search_starts_where_the_last_one_ended(name: str) -> None:
    flow, section = FLOWS[name], SECTIONS[0]
    hit = first(flow, STATES[name][0], section)
    again = first(flow, hit.state, section)
    direct = PoincareMap(flow, section, time_limit=100.0).return_time(section.reduce(hit.state))
    assert again.time == pytest.approx(direct, rel=1e-9)
    assert again.time > 0.1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rest_on_the_section_crosses_nothing(sign: float) -> None:
    # the fixed points lie on the plane z = rho - 1; at rho = 20 they are stable
    lorenz = Lorenz(rho=20.0)
    x = sign * np.sqrt(lorenz.beta * 19.0)
    for direction in (1, -1):
        with pytest.raises(NoCrossing):
            lorenz.next_crossing(
                np.array([x, x, 19.0]),
                Hyperplane(np.array([0.0, 0.0, 1.0]), 19.0, direction),
                time_limit=50.0,
            )


# --- on long steps --------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Cubic(IntegratedFlow):
    """A coordinate, its rate and its acceleration, whose rate is 6: steps have any length."""

    dimension = 3

    def velocity(self, state: Array) -> Array:
        _, v, a = finite_array("state", state, (3,))
        return np.array([v, a, 6.0])


class SymbolicCubic(SymbolicFlow):
    def velocity(self, x: sp.Expr, v: sp.Expr, a: sp.Expr) -> tuple[sp.Expr, ...]:
        return v, a, 0 * x + 6


@pytest.mark.parametrize("flow", [Cubic(), SymbolicCubic()], ids=["RK", "Taylor"])
def test_three_crossings_within_one_step_are_seen(flow: Flow) -> None:
    # the monic cubic in time with zeros at these crossings
    whole = np.poly([10.0, 10.1, 10.2])
    start = np.array([whole[3], whole[2], 2.0 * whole[1]])
    hit = flow.next_crossing(start, Hyperplane(np.array([1.0, 0.0, 0.0]), 0.0, -1), 100.0)
    assert hit.time == pytest.approx(10.1, abs=1e-6)


# --- at the end -----------------------------------------------------------------------------------


def test_a_crossing_just_within_the_time_limit_is_found() -> None:
    hit = Rotation().next_crossing(circle(0.0), plane_at(np.pi / 2, 0.5), np.pi / 6 + 1e-9)
    assert hit.time == pytest.approx(np.pi / 6, abs=1e-12)


@dataclass(frozen=True, kw_only=True)
class InOtherUnits(IntegratedFlow):
    """The rotation (sin t, cos t, 0) with its second coordinate in other units."""

    size: float = 1e8
    dimension = 3

    def velocity(self, state: Array) -> Array:
        x, y, _ = finite_array("state", state, (3,))
        return np.array([y / self.size, -self.size * x, 0.0])


class SymbolicInOtherUnits(SymbolicFlow):
    size: float = 1e8

    def velocity(self, x: sp.Expr, y: sp.Expr, z: sp.Expr) -> tuple[sp.Expr, ...]:
        return y / self.size, -self.size * x, 0 * z


@pytest.mark.parametrize("flow", [InOtherUnits(), SymbolicInOtherUnits()], ids=["RK", "Taylor"])
def test_a_crossing_of_a_coordinate_in_other_units_is_not_missed(flow: Flow) -> None:
    # where y is zero its rounding remains that of the motion, 1e8
    plane = Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, -1)
    starts = np.linspace(-3.0, 1.5, 100)
    times = [
        flow.next_crossing(np.array([np.sin(a), 1e8 * np.cos(a), 0.0]), plane, 100.0).time
        for a in starts.tolist()
    ]
    assert times == pytest.approx(0.5 * np.pi - starts)


@pytest.mark.parametrize("flow", [InOtherUnits(), SymbolicInOtherUnits()], ids=["RK", "Taylor"])
def test_a_crossing_of_a_coordinate_in_other_units_is_counted_once(flow: Flow) -> None:
    plane = Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, -1)
    for a in np.linspace(-3.0, 1.5, 100).tolist():
        start = np.array([np.sin(a), 1e8 * np.cos(a), 0.0])
        hit = flow.next_crossing(start, plane, 100.0)
        again = flow.next_crossing(hit.state, plane, 100.0)
        assert again.time == pytest.approx(2.0 * np.pi)


def test_a_crossing_just_after_the_time_limit_is_not() -> None:
    with pytest.raises(NoCrossing, match=r"^no crossing within 0\.52359877"):
        Rotation().next_crossing(circle(0.0), plane_at(np.pi / 2, 0.5), np.pi / 6 - 1e-9)


@dataclass(frozen=True, kw_only=True)
class Explosion(IntegratedFlow):
    """x' = x^2, which is infinite at time 1/x, and y' = 1."""

    @property
    def dimension(self) -> int:
        return 2

    def velocity(self, state: Array) -> Array:
        x, _ = finite_array("state", state, (2,))
        return np.array([x * x, 1.0])

    def velocity_jacobian(self, state: Array) -> Array:
        x, _ = finite_array("state", state, (2,))
        return np.array([[2.0 * x, 0.0], [0.0, 0.0]])


def test_a_motion_that_runs_away_does_not_cross() -> None:
    with pytest.raises(
        NoCrossing, match=r"no crossing within 9\.0: the motion cannot be followed beyond time 1: "
    ):
        Explosion().next_crossing(np.array([1.0, 0.0]), Hyperplane(np.eye(2)[1], 2.0), 9.0)


def test_a_crossing_before_the_motion_runs_away_is_found() -> None:
    hit = Explosion().next_crossing(np.array([1.0, 0.0]), Hyperplane(np.eye(2)[1], 0.75), 9.0)
    assert hit.state == pytest.approx([4.0, 0.75], rel=1e-10)


@pytest.mark.parametrize("duration", [1.001, 1.5, 1e6])
def test_states_that_run_away_are_refused(duration: float) -> None:
    message = rf"^the motion from \[1\.0, 0\.0\] cannot be followed for {duration}: beyond time 1"
    for function in (Explosion().advance, Explosion().derivative):
        with pytest.raises(CannotFollow, match=message):
            function(np.array([1.0, 0.0]), duration)


# --- steps that do not reach the section ----------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_within_a_step_the_state_changes_by_no_more_than_the_bound(method: str) -> None:
    flow = Lorenz(method=method, tolerance=1e-6)
    how: dict[str, Any] = {"method": method, "jacobian": flow.velocity_jacobian}
    rows = np.random.default_rng(0).normal(size=(20, 3))
    excess = []
    for step in integrated_steps(flow.velocity, 1e-6, np.array([8.0, 3.0, 20.0]), 2.0, **how):
        states = np.array(step.paths(np.linspace(step.begin, step.time, 50).tolist()))
        for row in rows:
            change = abs((states - states[0]) @ row).max()
            assert change <= step.reach(row) * (1.0 + 1e-12)
            excess.append(step.reach(row) / change)
    assert np.median(excess) < 3.0


@pytest.mark.parametrize("method", METHODS)
def test_steps_far_from_the_section_are_looked_at_once(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flow, start = Lorenz(method=method, tolerance=1e-9), np.array([8.0, 3.0, 20.0])
    plain, times = Search._look, []

    def looking(search: Search, time: float, *rest: Any) -> Look:
        times.append(time)
        return plain(search, time, *rest)

    monkeypatch.setattr(Search, "_look", looking)
    hit = first(flow, start, Hyperplane(np.eye(3)[2], 27.0, -1))
    how: dict[str, Any] = {"method": method, "jacobian": flow.velocity_jacobian}
    count = len(list(integrated_steps(flow.velocity, 1e-9, start, hit.time, **how)))
    assert count > 10
    assert len(times) < 2 * count
