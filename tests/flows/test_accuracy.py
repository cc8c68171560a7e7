"""What the tolerance promises, against thirty digits and closed forms."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from flint import arb, ctx

from dynkit import Hyperplane, PoincareMap, Stroboscope
from dynkit.core.validation import Array
from dynkit.systems import IntegratedFlow
from dynkit.systems.flows.integration import steps
from tests.flows.cases import (
    BITS,
    FLOWS,
    STATES,
    advanced_by_mpmath,
    advanced_in_many_digits,
)
from tests.flows.integrated_flows import Duffing

DURATIONS = {"duffing": 3.0, "lorenz": 0.7, "rossler": 3.0}
TOLERANCES = [1e-4, 1e-8, 1e-12, 1e-13]
RANDOM_BOXES = {
    "duffing": ([-1.5, -1.0, 0.0], [1.5, 1.0, 6.0]),
    "lorenz": ([-15.0, -15.0, 10.0], [15.0, 15.0, 40.0]),
    "rossler": ([-8.0, -8.0, 0.0], [8.0, 8.0, 1.0]),
}


@cache
def exact(name: str, place: int) -> Array:
    state = STATES[name][place].tolist()
    return np.array(
        [float(x) for x in advanced_in_many_digits(FLOWS[name], state, DURATIONS[name])]
    )


@pytest.mark.parametrize("name", FLOWS)
def test_the_thirty_digits_are_those_of_another_integrator(name: str) -> None:
    state = STATES[name][0].tolist()
    found = [float(x) for x in advanced_in_many_digits(FLOWS[name], state, 0.2)]
    assert found == advanced_by_mpmath(FLOWS[name], state, 0.2)


def promised(flow: IntegratedFlow, start: Array, duration: float) -> float:
    """Errors of the steps, each at most the tolerance, as the derivative carries them on."""
    ends = [
        (float(solver.t), np.array(solver.y))
        for solver in steps(flow.velocity, start, duration, flow.tolerance)
    ]
    total, carried, later = 0.0, np.eye(len(start)), duration
    for time, state in reversed(ends):
        # from each step's end to the next one's, and from there to the end
        carried = carried @ flow.derivative(state, max(later - time, 0.0))
        step_error = flow.tolerance * float(np.linalg.norm(1.0 + np.abs(state)))
        total += step_error * float(np.linalg.norm(carried, 2))
        later = time
    return total


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("place", range(2))
@pytest.mark.parametrize("name", FLOWS)
def test_the_error_is_the_steps_errors_carried_on(name: str, place: int, tolerance: float) -> None:
    flow, start = FLOWS[name].replace(tolerance=tolerance), STATES[name][place]
    off = np.linalg.norm(flow.advance(start, DURATIONS[name]) - exact(name, place))
    assert off <= promised(flow, start, DURATIONS[name])


@pytest.mark.parametrize("name", FLOWS)
def test_the_default_tolerance_gives_eleven_digits(name: str) -> None:
    # over a turn or so; relative to the size of the state
    for place, start in enumerate(STATES[name]):
        expected = exact(name, place)
        off = FLOWS[name].advance(start, DURATIONS[name]) - expected
        assert np.linalg.norm(off) <= 1e-11 * np.linalg.norm(expected)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10, 1e-11])
@pytest.mark.parametrize("name", FLOWS)
def test_the_error_is_below_its_estimate(name: str, tolerance: float) -> None:
    flow = FLOWS[name].replace(tolerance=tolerance)
    duration = DURATIONS[name]
    for start, fine in zip(*starts_and_ends(name), strict=True):
        off = np.linalg.norm(flow.advance(start, duration) - fine)
        assert off <= flow.advance_error(start, duration)


@cache
def starts_and_ends(name: str) -> tuple[Array, list[Array]]:
    starts = np.random.default_rng(0).uniform(*RANDOM_BOXES[name], size=(40, 3))
    fine = FLOWS[name].replace(tolerance=1e-13)
    return starts, [fine.advance(start, DURATIONS[name]) for start in starts]


def derivative_in_many_digits(flow: IntegratedFlow, state: Array, duration: float) -> Array:
    """Central differences: 1e-18 of truncation, and 1e-32 of the integration over the step."""
    columns = []
    with ctx.workprec(BITS):
        step = arb(10) ** -9
        for i in range(len(state)):
            ahead, behind = list(map(arb, state)), list(map(arb, state))
            ahead[i] += step
            behind[i] -= step
            ends = [advanced_in_many_digits(flow, end, duration) for end in (ahead, behind)]
            columns.append([float((p - m) / (2 * step)) for p, m in zip(*ends, strict=True)])
    return np.array(columns).T


@pytest.mark.parametrize("place", range(2))
@pytest.mark.parametrize("name", FLOWS)
def test_the_derivative_is_that_of_thirty_digits(name: str, place: int) -> None:
    flow, start = FLOWS[name], STATES[name][place]
    expected = derivative_in_many_digits(flow, start, 0.5)
    off = np.linalg.norm(flow.derivative(start, 0.5) - expected)
    # some tens of steps, whose errors the derivative itself carries on
    assert off <= 100.0 * flow.tolerance * np.linalg.norm(expected) ** 2


def test_volumes_change_at_the_constant_divergence() -> None:
    """Liouville's formula, where the divergence is constant: det = exp(divergence t)."""
    flow, duration = Duffing(), 4.0
    derivative = flow.derivative(STATES["duffing"][0], duration)
    # an entry's error counts as often as its cofactor, below |J|^2, is large
    allowed = 100.0 * flow.tolerance * float(np.linalg.norm(derivative)) ** 3
    assert np.linalg.det(derivative) == pytest.approx(np.exp(-0.3 * duration), abs=allowed)


# --- one return -----------------------------------------------------------------------------------

RETURNS = {
    "duffing": (Stroboscope(3), [0.5, 0.2]),
    "lorenz": (Hyperplane(np.array([0.0, 0.0, 1.0]), 27.0), [13.0, 18.0]),
    "rossler": (Hyperplane(np.array([1.0, 0.0, 0.0])), [-8.0, 0.03]),
}


@cache
def crossing_in_many_digits(name: str) -> tuple[float, Array]:
    """Newton's method on the section's value, at thirty digits."""
    section, reduced = RETURNS[name]
    flow = FLOWS[name]
    start = section.lift(np.array(reduced))
    hit = PoincareMap(flow, section, time_limit=50.0).crossing(np.array(reduced))
    with ctx.workprec(BITS):
        place = {"duffing": 2, "lorenz": 2, "rossler": 0}[name]
        target = {"duffing": 2 * arb.pi(), "lorenz": 27, "rossler": 0}[name]
        rate = float(flow.velocity(hit.state)[place])
        beside = advanced_in_many_digits(flow, start.tolist(), hit.time)
        # the hit is off by 1e-10 or less: the next term of Newton's method is below 1e-19
        time = hit.time - (beside[place] - target) / rate
        state = advanced_in_many_digits(flow, start.tolist(), time)
        return float(time), np.array([float(x) for x in state])


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("name", RETURNS)
def test_a_return_is_as_accurate_as_the_flow_says(name: str, tolerance: float) -> None:
    section, reduced = RETURNS[name]
    flow = FLOWS[name].replace(tolerance=tolerance)
    hit = PoincareMap(flow, section, time_limit=50.0).crossing(np.array(reduced))
    time, state = crossing_in_many_digits(name)
    allowed = flow.accuracy * np.linalg.norm(state)
    assert np.linalg.norm(hit.state - state) <= allowed
    # the time is off by what the value is, over its rate
    rate = abs(section.gradient(state) @ flow.velocity(state))
    assert abs(hit.time - time) <= allowed / rate
