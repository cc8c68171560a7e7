"""Returns to Poincare sections, and flows over a time, against Taylor series in 80 bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from dynkit import Hyperplane, PoincareMap, Stroboscope, systems
from dynkit.core.no_motion import NoCrossing
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Flow
from dynkit.systems import IntegratedFlow, SymbolicFlow
from tests.flows.integrated_flows import Duffing, Lorenz, Rossler

CASES = 1500
ORDER, LONGEST = 30, 0.02
"""Of the series, and of their steps: what is left out is below 1e-20."""


class Case(NamedTuple):
    """A return, or with a duration a time, from a start in a box around the attractor."""

    flow: IntegratedFlow
    start: Array
    duration: float


SECTIONS: dict[type[IntegratedFlow], Any] = {
    Duffing: Stroboscope(3),
    Lorenz: Hyperplane(np.array([0.0, 0.0, 1.0]), offset=27.0),
    Rossler: Hyperplane(np.array([1.0, 0.0, 0.0])),
}
BOXES: dict[type[IntegratedFlow], Any] = {
    Duffing: ([-1.5, -1.0, 0.0], [1.5, 1.0, 6.0]),
    Lorenz: ([-15.0, -15.0, 10.0], [15.0, 15.0, 40.0]),
    Rossler: ([-8.0, -8.0, 0.0], [8.0, 8.0, 1.0]),
}

SYMBOLIC: dict[type[IntegratedFlow], SymbolicFlow] = {
    Duffing: systems.Duffing(),
    Lorenz: systems.Lorenz(),
    Rossler: systems.Rossler(),
}


def drawn(number: int) -> Case:
    """A flow with a tolerance, a start and a time."""
    random = np.random.default_rng(number)
    kind: Any = (Duffing, Lorenz, Rossler)[number % 3]
    flow = kind(tolerance=float(10.0 ** random.uniform(-13.0, -5.0)))
    longest = 1.0 if kind is Lorenz else 4.0
    return Case(flow, random.uniform(*BOXES[kind]), float(random.uniform(0.1, longest)))


def states_of_times(every: int) -> Iterator[tuple[float, float]]:
    """Error of `advance`, and `advance_error`."""
    cases = [drawn(number) for number in range(0, CASES, every)]
    for case, exact in zip(cases, exact_states(cases), strict=True):
        found = case.flow.advance(case.start, case.duration)
        off = float(np.linalg.norm((found - exact).astype(float)))
        yield off, case.flow.advance_error(case.start, case.duration)


def states_of_times_of_symbols(every: int) -> Iterator[tuple[float, float]]:
    """Error of `SymbolicFlow.advance`, and `advance_error`."""
    cases = [drawn(number) for number in range(0, CASES, every)]
    for (flow, start, duration), exact in zip(cases, exact_states(cases), strict=True):
        twin = SYMBOLIC[type(flow)]
        off = float(np.linalg.norm((twin.advance(start, duration) - exact).astype(float)))
        yield off, twin.advance_error(start, duration)


def states_of_returns(every: int) -> Iterator[tuple[float, float]]:
    """Error of one call of a Poincare map, and its accuracy times the size of the state."""
    return _returns(every, lambda flow: flow)


def states_of_returns_of_symbols(every: int) -> Iterator[tuple[float, float]]:
    """The same of a flow of expressions."""
    return _returns(every, lambda flow: SYMBOLIC[type(flow)])


def _returns(every: int, flow_of: Callable[[Any], Flow]) -> Iterator[tuple[float, float]]:
    hits, cases = [], []
    for number in range(0, CASES, every):
        one, state, _ = drawn(number)
        flow, section = flow_of(one), SECTIONS[type(one)]
        start = section.lift(section.reduce(state))
        try:
            hit = PoincareMap(flow, section, time_limit=50.0).crossing(section.reduce(state))
        except NoCrossing:
            continue
        hits.append(hit)
        cases.append(Case(one, start, hit.time))
    for hit, case, exact in zip(hits, cases, exact_states(cases), strict=True):
        section = SECTIONS[type(case.flow)]
        flow = flow_of(case.flow)
        velocity, gradient = flow.velocity(hit.state), section.gradient(hit.state)
        along = gradient @ (exact - hit.state).astype(float) / (gradient @ velocity)
        off = (exact - hit.state).astype(float) - along * velocity
        yield float(np.linalg.norm(off)), flow.accuracy * float(np.linalg.norm(hit.state))


def exact_states(cases: list[Case]) -> list[Any]:
    """States a duration after the starts, all cases of a kind of flow at a time."""
    found: list[Any] = [None] * len(cases)
    for kind, series in SERIES.items():
        own = [i for i, case in enumerate(cases) if type(case.flow) is kind]
        if not own:
            continue
        state = np.array([cases[i].start for i in own], dtype=np.longdouble).T
        names = cases[own[0]].flow.parameters
        p = {
            name: np.array([cases[i].flow.value_of(name) for i in own], dtype=np.longdouble)
            for name in names
        }
        durations = np.array([cases[i].duration for i in own], dtype=np.longdouble)
        steps = int(np.ceil(float(durations.max()) / LONGEST))
        h = durations / steps
        for _ in range(steps):
            terms = series(state, p)
            state = terms[-1]
            for term in terms[-2::-1]:
                state = state * h + term
        for i, end in zip(own, state.T, strict=True):
            found[i] = end
    return found


def _product(u: Any, v: Any, k: int) -> Any:
    """Coefficient k of a product of series (k + 1, cases)."""
    return (u[: k + 1] * v[k::-1]).sum(axis=0)


def _series(state: Any, p: Any, rates: Any) -> Any:
    """Coefficients (ORDER + 1, 3, cases); rates gives coefficient k of the velocity."""
    terms = np.zeros((ORDER + 1, *state.shape), dtype=np.longdouble)
    terms[0] = state
    for k in range(ORDER):
        terms[k + 1] = np.array(rates(terms, p, k)) / np.longdouble(k + 1)
    return terms


def _lorenz(state: Any, p: Any) -> Any:
    def rates(s: Any, p: Any, k: int) -> list[Any]:
        x, y, z = s[:, 0], s[:, 1], s[:, 2]
        return [
            p["sigma"] * (y[k] - x[k]),
            p["rho"] * x[k] - _product(x, z, k) - y[k],
            _product(x, y, k) - p["beta"] * z[k],
        ]

    return _series(state, p, rates)


def _rossler(state: Any, p: Any) -> Any:
    def rates(s: Any, p: Any, k: int) -> list[Any]:
        x, y, z = s[:, 0], s[:, 1], s[:, 2]
        constant = p["b"] if k == 0 else 0.0
        return [
            -y[k] - z[k],
            x[k] + p["a"] * y[k],
            constant + _product(z, x, k) - p["c"] * z[k],
        ]

    return _series(state, p, rates)


def _duffing(state: Any, p: Any) -> Any:
    squares = np.zeros((ORDER + 1, state.shape[1]), dtype=np.longdouble)

    def rates(s: Any, p: Any, k: int) -> list[Any]:
        x, v = s[:, 0], s[:, 1]
        squares[k] = _product(x, x, k)
        # the k-th derivative of the cosine, over k!
        turned = np.cos(s[0, 2] + np.longdouble(k) * _QUARTER)
        drive = p["force"] * turned * p["frequency"] ** k / _FACTORIALS[k]
        spring = p["stiffness"] * x[k] + p["cubic"] * _product(squares, x, k)
        turning = p["frequency"] if k == 0 else np.zeros_like(x[k])
        return [v[k], drive - p["damping"] * v[k] - spring, turning]

    return _series(state, p, rates)


_QUARTER = 2 * np.arctan(np.longdouble(1))
_FACTORIALS = np.cumprod(np.maximum(np.arange(ORDER + 1), 1).astype(np.longdouble))

SERIES: dict[type[IntegratedFlow], Any] = {Duffing: _duffing, Lorenz: _lorenz, Rossler: _rossler}
