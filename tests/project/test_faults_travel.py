"""A fault in a user's class is never turned into a result: it reaches the user as it was raised."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import (
    Diverged,
    Hyperplane,
    MapAttractor,
    NoMotion,
    PoincareMap,
    Refused,
    Sweep,
    basins,
    continue_orbit,
    explore,
    parameter_map,
    periodic_orbit,
    sweep,
)
from dynkit.analysis import LyapunovSpectrum
from dynkit.core.validation import Array, finite_array
from dynkit.systems import ImpactChain, IntegratedFlow, Logistic
from tests.scaling.cases import processes

FAULTS = (
    ValueError,
    ZeroDivisionError,
    OverflowError,
    IndexError,
    KeyError,
    TypeError,
    AttributeError,
    RuntimeError,
    np.linalg.LinAlgError,
)
BRIEF: dict[str, Any] = {"transient": 20, "keep": 30, "progress": False}


@dataclass(frozen=True)
class Faulty(Logistic):
    """A map with a fault in one of its methods, from a rate on."""

    fault: type[Exception] | None = None
    where: str = ""
    beyond: float = 0.0

    def _perhaps(self, where: str) -> None:
        if where == self.where and self.rate > self.beyond and self.fault is not None:
            raise self.fault(f"a fault in {where}")

    def __call__(self, state: Array) -> Array:
        self._perhaps("__call__")
        return super().__call__(state)

    def jacobian(self, state: Array) -> Array:
        self._perhaps("jacobian")
        return super().jacobian(state)

    def difference(self, a: Array, b: Array) -> Array:
        self._perhaps("difference")
        return super().difference(a, b)

    def parameter_derivative(self, state: Array, name: str) -> Array:
        self._perhaps("parameter_derivative")
        return super().parameter_derivative(state, name)


def _from_a_sound_orbit(system: Faulty) -> Any:
    sound = Faulty(2.9, system.fault, system.where, beyond=3.1)
    orbit = periodic_orbit(sound, [0.6])
    return continue_orbit(orbit, "rate", bounds=(2.8, 3.3))


def _explored(system: Faulty) -> Any:
    return explore(system, "rate", (2.8, 3.3), iterates=2, values=2, box=[(0.1, 1.0)])


def _swept(system: Faulty, **options: Any) -> Any:
    return sweep(system, "rate", [2.9, 3.2], start=[0.3], **BRIEF, **options)


def _mapped(system: Faulty, **options: Any) -> Any:
    values = {"rate": [2.9, 3.7], "beyond": [0.0]}
    return parameter_map(system, values, start=[0.3], exponents=20, **BRIEF, **options)


def _basins(system: Faulty, **options: Any) -> Any:
    return basins(system, [[0.2], [0.3]], **BRIEF, **options)


def _labelled(system: Faulty) -> Any:
    return MapAttractor(system.replace(rate=3.9), [0.3], 20, 100).label  # type: ignore[arg-type]


# The tool, and the methods of the map that it uses.
USES: list[tuple[Callable[[Faulty], Any], tuple[str, ...]]] = [
    (_swept, ("__call__",)),
    (lambda system: _swept(system, follow=False), ("__call__",)),
    (_mapped, ("__call__", "jacobian", "difference")),
    (_basins, ("__call__", "difference")),
    (_labelled, ("__call__", "jacobian", "difference")),
    (lambda system: periodic_orbit(system, [0.6]), ("__call__", "jacobian", "difference")),
    (_from_a_sound_orbit, ("__call__", "jacobian", "difference", "parameter_derivative")),
    (_explored, ("__call__", "jacobian", "difference", "parameter_derivative")),
    (
        lambda system: LyapunovSpectrum.of_map(system, [0.3], iterations=200).exponents,
        ("__call__", "jacobian"),
    ),
    (lambda system: MapAttractor(system, [0.3], 5, 5).error, ("__call__",)),  # type: ignore[arg-type]
]
CASES = [(use, where) for use, places in USES for where in places]


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(("use", "where"), CASES)
def test_a_fault_of_a_map_reaches_the_user(
    use: Callable[[Faulty], Any], where: str, fault: type[Exception]
) -> None:
    with pytest.raises(fault, match=f"a fault in {where}") as told:
        use(Faulty(2.9, fault, where))
    assert type(told.value) is fault
    # the line that raised it is in the traceback
    assert traceback.extract_tb(told.value.__traceback__)[-1].name == "_perhaps"


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("use", [lambda s, **o: _swept(s, follow=False, **o), _mapped, _basins])
def test_a_fault_in_a_thread_reaches_the_user(
    use: Callable[..., Any], fault: type[Exception]
) -> None:
    with ThreadPoolExecutor(1) as executor:
        _assert_it_reaches(use, fault, executor)


def test_a_fault_in_another_process_reaches_the_user() -> None:
    with processes(1) as executor:
        for use in (lambda s, **o: _swept(s, follow=False, **o), _mapped, _basins):
            for fault in FAULTS:
                _assert_it_reaches(use, fault, executor)


def _assert_it_reaches(use: Callable[..., Any], fault: type[Exception], executor: Executor) -> None:
    with pytest.raises(fault, match="a fault in __call__") as told:
        use(Faulty(2.9, fault, "__call__"), executor=executor)
    assert type(told.value) is fault
    assert any("in _perhaps" in note for note in told.value.__notes__)


# --- flows ----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class FaultyFlow(IntegratedFlow):
    """A rotation with a fault in its velocity, or its jacobian."""

    rate: float = 1.0
    fault: type[Exception] = ValueError
    where: str = "velocity"
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        if self.where == "velocity" and x < 0.5:
            raise self.fault("a fault in velocity")
        return np.array([-self.rate * y, self.rate * x])

    def velocity_jacobian(self, state: Array) -> Array:
        x, _ = finite_array("state", state, (2,))
        if self.where == "velocity_jacobian" and x < 0.5:
            raise self.fault("a fault in velocity_jacobian")
        return np.array([[0.0, -self.rate], [self.rate, 0.0]])


def _section_map(flow: FaultyFlow) -> PoincareMap:
    return PoincareMap(flow, Hyperplane(np.array([0.0, 1.0])), time_limit=20.0)


FLOW_USES: list[tuple[Callable[[FaultyFlow], Any], str]] = [
    (lambda flow: flow.advance(np.array([1.0, 0.0]), 3.0), "velocity"),
    (lambda flow: flow.derivative(np.array([1.0, 0.0]), 3.0), "velocity_jacobian"),
    (lambda flow: _section_map(flow)(np.array([1.0])), "velocity"),
    (lambda flow: basins(_section_map(flow), [[1.0]], **BRIEF), "velocity"),
    (lambda flow: sweep(_section_map(flow), "rate", [1.0], start=[1.0], **BRIEF), "velocity"),
    (lambda flow: periodic_orbit(_section_map(flow), [1.0]), "velocity"),
    (lambda flow: periodic_orbit(_section_map(flow), [1.1]).multipliers, "velocity_jacobian"),
]


@pytest.mark.parametrize("fault", [ValueError, ZeroDivisionError, IndexError, TypeError])
@pytest.mark.parametrize(("use", "where"), FLOW_USES)
def test_a_fault_of_a_flow_reaches_the_user(
    use: Callable[[FaultyFlow], Any], where: str, fault: type[Exception]
) -> None:
    with pytest.raises(fault, match=f"a fault in {where}") as told:
        use(FaultyFlow(fault=fault, where=where))
    assert type(told.value) is fault


# --- impact oscillators ---------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class FaultyChain(ImpactChain):
    """A chain with a fault in what it simulates with."""

    fault: type[Exception] = ValueError

    def _run(self, *arguments: Any, **options: Any) -> Any:
        raise self.fault("a fault in the run")


@pytest.mark.parametrize("fault", [ValueError, ZeroDivisionError, IndexError, TypeError])
@pytest.mark.parametrize(
    "use",
    [
        lambda chain: parameter_map(chain, {"frequency": [0.9], "amplitude": [0.1]}, **BRIEF),
        lambda chain: sweep(chain, "frequency", [0.9], **BRIEF),
        lambda chain: basins(chain, [[0.5, 0.5, 0.0, 0.0, 0.0]], **BRIEF),
        lambda chain: chain.periodic_orbit(sticking=True),
    ],
)
def test_a_fault_of_an_impact_oscillator_reaches_the_user(
    use: Callable[[FaultyChain], Any], fault: type[Exception]
) -> None:
    with pytest.raises(fault, match="a fault in the run") as told:
        use(FaultyChain(masses=2, frequency=0.9, fault=fault))
    assert type(told.value) is fault


# --- what is no fault -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Within(Logistic):
    """A logistic map that is not defined beyond one, and whose rate and limit are below four."""

    limit: float = 0.0

    def __post_init__(self) -> None:
        if self.rate + self.limit > 4.0:
            raise ValueError(f"rate + limit must be at most 4; got {self.rate + self.limit}")

    def __call__(self, state: Array) -> Array:
        if finite_array("state", state, (1,))[0] > 1.0:
            raise Refused(f"state[0] must be at most 1; got {state[0]}")
        return super().__call__(state)


def test_a_refused_pair_of_a_plane_says_why() -> None:
    plane = {"rate": [3.2, 3.4], "limit": [0.0, 0.7]}
    found = parameter_map(Within(3.2), plane, start=[0.3], **BRIEF)
    assert found.names.tolist() == [["P(2)", "P(2)"], ["P(2)", "refused"]]
    assert found.endings[1, 1] == "refused: rate + limit must be at most 4; got 4.1"
    with pytest.raises(Refused, match=r"rate \+ limit must be at most 4; got 4\.1"):
        found.attractor(1, 1)


def test_a_refused_value_of_a_plane_is_an_argument() -> None:
    chain = ImpactChain(masses=2, frequency=0.9)
    with pytest.raises(ValueError, match=r"restitution must lie in \[0, 1\]; got 1\.2"):
        parameter_map(chain, {"restitution": [0.8, 1.2], "frequency": [0.9]}, **BRIEF)


def test_what_becomes_of_starts_is_told_apart() -> None:
    found = basins(Within(3.2), [[0.3], [1.5], [-0.2]], **BRIEF)
    assert [found.outcome(i) for i in range(3)] == ["P(2)", "cannot be followed", "runs away"]


def test_a_motion_that_runs_away_says_how_far_it_came() -> None:
    with pytest.raises(Diverged, match=r"^the motion runs away: state\[0\] is -inf after 10 iter"):
        Logistic(4.0).iterate([1.5], 20)  # type: ignore[arg-type]


def test_every_kind_of_no_motion_is_sent_as_it_is() -> None:
    import pickle

    from dynkit.systems.impact.modes.constrained import ContactParadox

    kinds = NoMotion.__subclasses__()
    assert ContactParadox in kinds
    assert len(kinds) == 8
    for kind in kinds:
        sent = pickle.loads(pickle.dumps(kind("why")))
        assert (type(sent), str(sent)) == (kind, "why")


@dataclass(frozen=True)
class Unidentified(Logistic):
    """Its constructor has a fault where a sweep of it is loaded."""

    fault: type[Exception] | None = None

    def __post_init__(self) -> None:
        if self.fault is not None:
            raise self.fault("a fault in the constructor")


@pytest.mark.parametrize("fault", [RuntimeError, ZeroDivisionError, IndexError, TypeError])
def test_a_fault_of_a_constructor_is_none_of_the_store(
    fault: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "x.h5"
    sound = Unidentified(2.9)
    for follow in (True, False):
        store.unlink(missing_ok=True)
        sweep(sound, "rate", [2.9], start=[0.3], store=store, follow=follow, **BRIEF)

        def faulty(*_: Any) -> None:
            raise fault("a fault in the constructor")

        with monkeypatch.context() as patched:
            patched.setattr(Unidentified, "__post_init__", faulty)
            with pytest.raises(fault, match="a fault in the constructor"):
                Sweep.load(store, sound)


def test_an_orbit_beyond_the_bounds_of_an_exploration_is_left_and_said() -> None:
    seeds = [periodic_orbit(Logistic(rate), [0.6]) for rate in (2.0, 2.9)]
    network = explore(Logistic(2.9), "rate", (2.85, 2.95), seeds=seeds)
    assert len(network) == 1
    (left,) = network.unexplored
    assert left.why == "continuing P(1) at 2 fails: rate must lie in [2.85, 2.95]; got 2.0"
    assert "; left unexplored: 1 orbits to start from; searched: " in network.message
