"""Maps and flows of expressions, each beside a peer that is written by hand."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import heyoka as hy
import numba
import numpy as np

from dynkit import MapAttractor, PoincareMap, Stroboscope, continue_orbit
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.systems import Duffing, Henon, Lorenz, TodaChain
from tests.benchmarks.report import Line, in_turns
from tests.flows import integrated_flows

ITERATES, TIME, IMPACTS = 1_000_000, 1000, 2000
START = np.array([1.0, 2.0, 20.0])


@numba.njit(error_model="numpy")
def henon_by_hand(states: Any) -> None:
    x, y = states[0]
    for i in range(1, len(states)):
        x, y = 1.0 - 1.4 * x * x + y, 0.3 * x
        states[i, 0], states[i, 1] = x, y


@numba.njit(error_model="numpy")
def exponents_by_hand(logs: Any) -> None:
    x = y = b = 0.0
    a = 1.0
    for i in range(len(logs)):
        slope = -2.8 * x
        x, y = 1.0 - 1.4 * x * x + y, 0.3 * x
        # the frame's second direction is across the first: the determinant is -0.3
        a, b = slope * a + b, 0.3 * a
        length = np.sqrt(a * a + b * b)
        a, b = a / length, b / length
        logs[i, 0], logs[i, 1] = np.log(length), np.log(0.3 / length)


def lorenz_by_heyoka() -> Callable[[], None]:
    x, y, z = hy.make_vars("x", "y", "z")
    sigma, rho, beta = (hy.par[i] for i in range(3))
    system = [(x, sigma * (y - x)), (y, x * (rho - z) - y), (z, x * y - beta * z)]
    equations = hy.var_ode_sys(system, hy.var_args.vars)
    integrator = hy.taylor_adaptive(equations, START.tolist(), pars=[10.0, 28.0, 8.0 / 3.0])

    def follow() -> None:
        integrator.state[:3] = START
        for _ in range(2 * TIME):
            integrator.time = 0.0
            integrator.state[3:] = np.eye(3).ravel()
            integrator.propagate_until(0.5)
            frame, _ = np.linalg.qr(integrator.state[3:].reshape(3, 3))
            integrator.state[3:] = frame.ravel()

    return follow


def toda_by_heyoka(impacts: int) -> Callable[[], None]:
    """Toda's chain of ten masses above a table: heyoka's event loop, with a callback in Python."""
    n, w, amplitude, damping = 10, 0.9, 0.1, 0.1
    x, v = ([hy.expression(f"{letter}{i}") for i in range(n)] for letter in "xv")
    stretch = [x[0], *(b - a for a, b in pairwise(x))]
    rate = [v[0], *(b - a for a, b in pairwise(v))]
    pull = [hy.exp(e) - 1.0 + damping * d for e, d in zip(stretch, rate, strict=True)]
    force = [b - a for a, b in zip(pull, [*pull[1:], hy.expression(0.0)], strict=True)]
    hits: list[tuple[float, Array]] = []

    def bounce(integrator: Any, _: int) -> bool:
        speed = amplitude * w * math.cos(w * integrator.time)
        integrator.state[-1] = speed - 0.85 * (integrator.state[-1] - speed)
        hits.append((integrator.time, integrator.state.copy()))
        return len(hits) < impacts

    down = hy.event_direction.negative
    gap = x[-1] - amplitude * hy.sin(w * hy.time)
    integrator = hy.taylor_adaptive(
        list(zip((*x, *v), (*v, *force), strict=True)),
        [0.0] * (2 * n),
        t_events=[hy.t_event(gap, direction=down, callback=bounce)],
    )
    start = TodaChain(frequency=w).default_start

    def follow() -> None:
        hits.clear()
        integrator.time = 0.0
        integrator.state[:] = np.concatenate([start.position, start.velocity])
        integrator.propagate_until(1e9)

    return follow


def branch(flow: Any) -> Callable[[], object]:
    strobed = PoincareMap(flow, Stroboscope(3), time_limit=10.0)
    orbit = MapAttractor(strobed, np.array([1.2, 0.1]), 200, 20).periodic_orbit()
    return partial(continue_orbit, orbit, "force", bounds=(0.1, 0.3))


def symbols() -> Iterator[Line]:
    """The lines of this file."""
    henon, states, logs = Henon(), np.zeros((ITERATES + 1, 2)), np.empty((ITERATES, 2))
    start: Array = np.zeros(2)
    henon_by_hand(states[:3])
    exponents_by_hand(logs[:3])
    henon.stretching(start, 3)
    lorenz = Lorenz()
    lorenz.stretching(START, 1.0, 3)
    strobed = branch(Duffing(force=0.2))
    toda = TodaChain(frequency=0.9)
    jobs: list[tuple[str, Callable[[], object], str, Callable[[], object], float | None]] = [
        (
            "a million iterates of Henon's map", lambda: henon.iterate_into(states),
            "a loop of Numba", lambda: henon_by_hand(states), None,
        ),
        (
            "their frames, lengths and errors", lambda: henon.stretching(start, ITERATES),
            "a loop that turns one direction", lambda: exponents_by_hand(logs), None,
        ),
        (
            "frames of Lorenz over 1000 units of time",
            lambda: lorenz.stretching(START, 1.0, TIME),
            "heyoka's variational run and NumPy's QR", lorenz_by_heyoka(), 1.3,
        ),
        (
            "exponents of Lorenz over 1000 units of time, with errors",
            lambda: (
                LyapunovSpectrum.of_flow(
                    lorenz, START, interval=1.0, iterations=TIME * 4 // 5
                ).exponents
            ),
            "the same", lorenz_by_heyoka(), 1.3,
        ),
        (
            "a branch of 47 orbits of Duffing's oscillator", strobed,
            "`IntegratedFlow`", branch(integrated_flows.Duffing(force=0.2)), None,
        ),
        (
            f"{IMPACTS} impacts of Toda's chain of ten", lambda: toda.simulate(impacts=IMPACTS),
            "heyoka's event loop in Python", toda_by_heyoka(IMPACTS), 1.0 / 0.9,
        ),
    ]  # fmt: skip
    for name, ours, beside, peer, most in jobs:
        mine, other = in_turns(ours, peer, runs=2 if "Duffing" in name else 5)
        yield Line(name, mine, beside, other, most)
        if "million" in name:
            yield Line(name, mine, "limit, 5e7 a second", ITERATES / 5e7, 1)
        elif "lengths" in name:
            yield Line("exponents of Henon's map, a million iterates", mine, "limit", 0.1, 1)
        elif "Duffing" in name:
            yield Line("point of that branch", mine / 47, "limit, 100 a second", 0.01, 1)
    for name, code in (
        ("a map", "from dynkit.systems import Ikeda as S; S().stretching([0.1, 0.1], 10)"),
        ("a flow", "from dynkit.systems import Chua as S; S().stretching([1.0, 0.1, 0.2], 1.0, 3)"),
        ("a structure", "from dynkit.systems import TodaChain as S; S(frequency=0.9).attractor()"),
    ):
        (whole,) = in_turns(partial(subprocess.run, [sys.executable, "-c", code], check=True))
        yield Line(f"process that uses a class of {name} for the first time", whole, "limit", 3, 1)
