"""Each public name of a class for users is final, or what overrides it is met by its results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numba
import numpy as np
import pytest
import sympy

import dynkit
from dynkit import (
    Attractor,
    Family,
    Flow,
    HybridFlow,
    Hyperplane,
    Map,
    PoincareMap,
    PoincareSection,
    Problem,
    ProblemSolution,
    ResetMap,
    basins,
    continue_orbit,
    equilibrium,
    periodic_orbit,
    sweep,
)
from dynkit.analysis import LyapunovSpectrum, Running, RunningSpectrum, measure
from dynkit.core.overriding import Extensible, open_members
from dynkit.core.validation import Array
from dynkit.dynamics.flow import Crossing
from dynkit.systems import (
    BouncingBall,
    CompiledMap,
    Element,
    HardStop,
    Henon,
    ImpactChain,
    ImpactLaw,
    ImpactOscillator,
    ImpactRod,
    IntegratedFlow,
    LagrangianStructure,
    MatrixOscillator,
    PlayOscillator,
    SingleImpactOscillator,
    SymbolicFlow,
    SymbolicHybridFlow,
    SymbolicMap,
)
from tests.example_systems import Spring
from tests.testing.test_attractors import Wrapped


class Met(Exception):
    """What an override raises: results that use it end with it."""


def overriding(kind: Any, name: str) -> Any:
    """A subclass whose own method or property of this name raises `Met`."""

    def raising(self: Any, *_: Any, **__: Any) -> Any:
        raise Met(name)

    known = next(vars(base)[name] for base in kind.__mro__ if name in vars(base))
    if not callable(known):  # a property, or a constant in the place of one
        return type(kind)("Own", (kind,), {name: property(raising)})
    return type(kind)("Own", (kind,), {name: wraps(known)(raising)})


# --- maps -----------------------------------------------------------------------------------------


class PlainHenon(Map):
    a: float = 0.3
    dimension = 2

    def __call__(self, state: Array) -> Array:
        x, y = state
        return np.array([1.0 - self.a * x * x + y, 0.3 * x])


class CompiledHenon(CompiledMap):
    a: float = 0.3

    @staticmethod
    @numba.njit
    def next_state(x: float, y: float, a: float) -> tuple[float, float]:
        return 1.0 - a * x * x + y, 0.3 * x


def use_map(kind: Any, folder: Path) -> None:
    """A motion, orbits, a branch, sweeps, basins and exponents."""
    system, start = kind(a=0.3), [0.6, 0.1]
    run: dict[str, Any] = {"transient": 50, "keep": 20, "progress": False}
    sweep(system, "a", [0.2, 0.3, 0.5], start=start, store=folder / "own.h5", **run)
    if system.default_start is None:
        with pytest.raises(ValueError, match="start"):
            sweep(system, "a", [0.3], **run)
    list(system.stream(start=start, transient=5, keep=20, block=10))
    orbit = periodic_orbit(system, start)
    assert orbit.multipliers_error.max() < 1e-6 > orbit.error
    assert orbit.duration == 1.0
    orbit.observable("state[0]")
    branch = continue_orbit(orbit, "a", bounds=(0.2, 0.5))
    assert len(branch.bifurcations) == 1
    found = basins(system, np.array([[start, [0.5, 0.0]]]), **run)
    found.plot()
    plt.close("all")
    assert LyapunovSpectrum(system.attractor(start=start), iterations=128).exponents.max() < 0.0
    repr(orbit)
    unstable = periodic_orbit(kind(a=0.5), start).states[0]
    sweep(system, "a", [0.5], start=unstable, **(run | {"transient": 2}))


# --- flows and sections ---------------------------------------------------------------------------


class HenonHeiles(IntegratedFlow):
    strength: float = 1.0
    dimension = 4
    integrals = ("energy",)

    def velocity(self, state: Array) -> Array:
        x, y, u, v = state
        return np.array(
            [u, v, -x - 2.0 * self.strength * x * y, -y - self.strength * (x * x - y * y)]
        )

    def energy(self, state: Array) -> float:
        x, y, u, v = state
        curved = self.strength * (x * x * y - y**3 / 3.0)
        return float(0.5 * (x * x + y * y + u * u + v * v) + curved)


class PlainHenonHeiles(Flow):
    """The same by its own `advance`."""

    strength: float = 1.0
    dimension = 4
    integrals = ("energy",)

    velocity = HenonHeiles.velocity
    energy = HenonHeiles.energy

    @property
    def _same(self) -> Any:
        kind: Any = HenonHeiles  # a dataclass without its decorator
        return kind(strength=self.strength)

    def advance(self, state: Array, duration: float) -> Array:
        return np.asarray(self._same.advance(state, duration))

    def next_crossing(self, state: Array, section: PoincareSection, time_limit: float) -> Crossing:
        found: Crossing = self._same.next_crossing(state, section, time_limit)
        return found


class SymbolicHenonHeiles(SymbolicFlow):
    strength: float = 1.0

    def velocity(self, x: Any, y: Any, u: Any, v: Any) -> tuple[Any, ...]:
        return u, v, -x - 2 * self.strength * x * y, -y - self.strength * (x * x - y * y)


def use_flow(kind: Any, folder: Path) -> None:
    """Returns, with and without a level, an equilibrium and its branch, exponents."""
    flow, axis = kind(strength=1.0), Hyperplane(np.eye(4)[1])
    for level in (None, ("energy", 0.1))[: 1 + bool(kind.integrals)]:
        returns = PoincareMap(flow, axis, time_limit=50.0, level=level)
        start = np.array([0.1, 0.1, 0.4])
        assert np.isfinite(returns.jacobian(start)).all()
        returns.parameter_derivative(start, "strength")
        assert returns.accuracy < 1e-6
        assert returns.replace(strength=0.9).parameters["strength"] == 0.9
    rest = equilibrium(flow, [0.01, 0.99, 0.0, 0.0])
    continue_orbit(rest, "strength", bounds=(0.9, 1.1)).save(folder / "branch.h5")
    found = LyapunovSpectrum.of_flow(flow, [0.1, 0.1, 0.3, 0.1], interval=0.1, iterations=128)
    assert np.isfinite(found.exponents).all()


class Wheel(HybridFlow, IntegratedFlow):
    """A rimless wheel, which rolls down a slope."""

    slope: float = 0.08
    dimension = 2

    def velocity(self, state: Array) -> Array:
        return np.array([state[1], np.sin(state[0])])

    def guard(self, state: Array) -> float:
        return float(self.slope + math.pi / 12 - state[0])

    def reset(self, state: Array) -> Array:
        return np.array([state[0] - math.pi / 6, math.cos(math.pi / 6) * state[1]])


class SymbolicWheel(SymbolicHybridFlow):
    slope: float = 0.08

    def velocity(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        return rate, sympy.sin(angle)

    def guard(self, angle: Any, rate: Any) -> Any:
        return self.slope + sympy.pi / 12 - angle

    def reset(self, angle: Any, rate: Any) -> tuple[Any, ...]:
        return angle - sympy.pi / 6, sympy.cos(sympy.pi / 6) * rate

    def armed(self, angle: Any, rate: Any) -> Any:
        return rate


def use_hybrid_flow(kind: Any, _: Path) -> None:
    steps = ResetMap(kind(slope=0.08), time_limit=50.0)
    orbit = periodic_orbit(steps, [-0.18, 0.5])
    assert abs(orbit.multipliers).max() < 1.0
    steps.parameter_derivative(orbit.states[0], "slope")


class Axis(PoincareSection):
    """The half-line y = 0 in the plane, by the logarithm of x."""

    dimension = 2
    direction = 1

    def value(self, state: Array) -> float:
        return float(state[1])

    def gradient(self, state: Array) -> Array:
        return np.array([0.0, 1.0])

    def reduce(self, state: Array) -> Array:
        return np.log(np.abs(state[:1]))

    def lift(self, reduced: Array) -> Array:
        return np.array([math.exp(reduced[0]), 0.0])

    def reduce_derivative(self, state: Array) -> Array:
        return np.array([[1.0 / state[0], 0.0]])

    def lift_derivative(self, reduced: Array) -> Array:
        return np.array([[math.exp(reduced[0])], [0.0]])


class Cycle(SymbolicFlow):
    rate: float = 0.1

    def velocity(self, x: Any, y: Any) -> tuple[Any, ...]:
        pull = self.rate * (1 - x**2 - y**2)
        return pull * x - y, pull * y + x


def use_section(kind: Any, _: Path) -> None:
    orbit = periodic_orbit(PoincareMap(Cycle(), kind(), time_limit=50.0), [0.1])
    assert orbit.multipliers[0] == pytest.approx(math.exp(-0.4 * math.pi), rel=1e-9)


# --- oscillators ----------------------------------------------------------------------------------


GIVEN: dict[type, dict[str, Any]] = {
    MatrixOscillator: {"M": [[1.0]], "C": [[0.1]], "K": [[1.0]]},
    ImpactChain: {"masses": 2},
    SingleImpactOscillator: {"force": 1.0},
    PlayOscillator: {"force": 1.0},
    BouncingBall: {"frequency": 3.0, "restitution": 0.8, "amplitude": 0.2},
    ImpactRod: {"masses": 10},
}


def use_oscillator(kind: Any, folder: Path) -> None:
    """Sweeps, also from an unstable orbit, basins, a branch, a sketch."""
    given = next((own for base, own in GIVEN.items() if issubclass(kind, base)), {})
    system = kind(**{"frequency": 0.9} | given)
    assert system.stiffness.shape == system.damping_matrix.shape == system.mass.shape
    run: dict[str, Any] = {"transient": 20, "keep": 5, "progress": False}
    at = [system.frequency, 1.001 * system.frequency]
    sweep(system, "frequency", at, store=folder / "own.h5", **run)
    position, velocity = system.default_start.position, system.default_start.velocity
    rest = [*position, *velocity, 0.0]
    basins(system, np.array([[rest, rest]]), **run).plot()
    plt.close("all")
    if not issubclass(kind, BouncingBall):
        return
    orbit = system.periodic_orbit(impacts=1)
    unstable = next(o for o in system.periodic_orbits(impacts=1) if o.admissible and not o.stable)
    start = system.impact_state(unstable.states[0])
    sweep(system, "frequency", [3.0], start=start, **(run | {"transient": 1}))
    continue_orbit(orbit, "frequency", bounds=(2.9, 3.1))
    system.plot()
    plt.close("all")


class Beam(LagrangianStructure):
    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + (x[1] - x[0]) ** 2) / 2


def use_structure(kind: Any, _: Path) -> None:
    assert len(kind().modes.frequencies) == 2


def use_element(kind: Any, _: Path) -> None:
    elements = [HardStop(1, amplitude=0.1), kind(0)]
    ImpactChain(masses=2, frequency=0.9, elements=elements).simulate(impacts=3)


class Constant(ImpactLaw):
    def expression(self, velocity: Any) -> Any:
        return 0.5 + 0 * velocity


def use_law(kind: Any, _: Path) -> None:
    ImpactChain(masses=2, frequency=0.9, restitution=kind()).simulate(impacts=3)


# --- attractors and measures ----------------------------------------------------------------------


def use_attractor(kind: Any, folder: Path) -> None:
    class Watched(Henon):
        def attractor(self, *, start: Any = None, transient: int = 700, keep: int = 100) -> Any:
            return kind(transient, keep)

    run: dict[str, Any] = {"transient": 50, "keep": 20, "progress": False}
    sweep(Watched(), "a", [1.4], start=[0.1, 0.1], **run)
    basins(Watched(), np.array([[0.1, 0.1], [0.0, 0.0]]), **run)
    own = kind(50, 20)
    own.export(folder / "own.csv")
    assert len(own.section(Hyperplane(np.array([1.0, 0.0])))) > 0
    RunningSpectrum(interval=1.0, coordinate=0).add(own)
    assert own.error >= 0.0


class Largest(Running):
    def accumulate(self, block: Any) -> None:
        pass

    def result(self) -> float:
        return 1.0


def use_measure(kind: Any, _: Path) -> None:
    stream = Henon().stream(start=[0.1, 0.1], transient=10, keep=20)
    assert measure(stream, {"own": kind()}, progress=False)["own"] == 1.0


# --- all classes ----------------------------------------------------------------------------------

CASES: dict[type, tuple[Any, Callable[[Any, Path], None]]] = {
    Map: (PlainHenon, use_map),
    CompiledMap: (CompiledHenon, use_map),
    SymbolicMap: (Henon, use_map),
    Flow: (PlainHenonHeiles, use_flow),
    IntegratedFlow: (HenonHeiles, use_flow),
    SymbolicFlow: (SymbolicHenonHeiles, use_flow),
    HybridFlow: (Wheel, use_hybrid_flow),
    SymbolicHybridFlow: (SymbolicWheel, use_hybrid_flow),
    PoincareSection: (Axis, use_section),
    ImpactOscillator: (BouncingBall, use_oscillator),
    **{kind: (kind, use_oscillator) for kind in GIVEN},
    LagrangianStructure: (Beam, use_structure),
    Element: (Spring, use_element),
    ImpactLaw: (Constant, use_law),
    Attractor: (Wrapped, use_attractor),
    Running: (Largest, use_measure),
}
"""For each class that users subclass, one that can be used, and results that use it."""


def _member(kind: type, name: str) -> object:
    return next((vars(base)[name] for base in kind.__mro__ if name in vars(base)), None)


def _own_members(kind: type) -> list[str]:
    """Names of what may be overridden, but for what a base class of `CASES` has, too."""
    bases = [base for base in CASES if issubclass(kind, base) and base is not kind]
    names = open_members(kind)
    return [n for n in names if all(_member(kind, n) is not _member(base, n) for base in bases)]


EQUATIONS = Problem, ProblemSolution, Family
"""A family has no results of its own; `dynkit.testing.check_problem` is the test of the others."""


def _open_classes() -> Iterator[type]:
    """All public classes that may be subclassed, but for `EQUATIONS` alone."""
    for package in (dynkit, dynkit.systems, dynkit.analysis):
        for kind in (getattr(package, name) for name in package.__all__):
            if isinstance(kind, type) and issubclass(kind, Extensible):
                known = issubclass(kind, EQUATIONS) and not issubclass(kind, (Map, Flow))
                if "__final__" not in vars(kind) and not known:
                    yield kind


@pytest.mark.parametrize("kind", list(_open_classes()), ids=lambda kind: kind.__name__)
def test_each_public_member_is_final_or_tested_here(kind: Any) -> None:
    """A first integral has a name of its own; another one changes its gradient."""
    bases = [base for base in CASES if issubclass(kind, base)]
    tested = set().union(*map(open_members, bases)) | set(getattr(kind, "integrals", ()))
    assert set(open_members(kind)) <= tested


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (kind, name)
        for kind in CASES
        for name in _own_members(kind)
        # code that raises does not compile; `TestOverriddenCalls` has other next states
        if (kind, name) != (CompiledMap, "next_state")
    ],
    ids=lambda each: each if isinstance(each, str) else each.__name__,
)
def test_what_overrides_a_member_is_used(kind: type, name: str, tmp_path: Path) -> None:
    own, use = CASES[kind]
    with pytest.raises(Met, match=name):
        use(overriding(own, name), tmp_path)


@pytest.mark.parametrize("kind", CASES)
def test_results_without_an_override_end_normally(kind: type, tmp_path: Path) -> None:
    own, use = CASES[kind]
    use(own, tmp_path)
