"""Systems and results travel between processes."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dynkit import MapAttractor, PoincareMap, Stroboscope, continue_orbit, periodic_orbit
from dynkit.dynamics.map import Map
from dynkit.systems import (
    BouncingBall,
    Duffing,
    Henon,
    HighBounce,
    ImpactChain,
    Logistic,
    Lorenz,
    MatrixOscillator,
    PlayOscillator,
    Rossler,
    SingleImpactOscillator,
)
from tests.data.machines import entered
from tests.scaling.cases import attracted, bits, explored, mapped, swept

TWO = np.diag([1.0, 2.0])
MAPS: dict[str, tuple[Map, list[float] | None]] = {
    "chain": (ImpactChain(masses=2, frequency=0.9), None),
    "matrices": (MatrixOscillator(M=TWO, C=0.1 * TWO, K=TWO, frequency=0.9), None),
    "one mass": (SingleImpactOscillator(frequency=0.8), None),
    "ball": (BouncingBall(frequency=5.0), None),
    "two stops": (PlayOscillator(frequency=1.0, play=1.0), None),
    "Henon": (Henon(), [0.1, 0.1]),
    "high bounce": (HighBounce(restitution=0.5, gamma=2.0), [0.1, 0.1]),
    "logistic": (Logistic(rate=3.2), [0.3]),
    "Duffing": (PoincareMap(Duffing(), Stroboscope(3), 10.0), [0.1, 0.1]),
}


def returned(given: Any) -> Any:
    return pickle.loads(pickle.dumps(given))


def moved(system: Any, start: list[float] | None) -> bytes:
    if start is None:
        states = system.attractor(transient=3, impacts=3).states
    else:
        states = system.iterate(np.array(start), 3)
    return bytes(np.asarray(states).tobytes())


@pytest.mark.parametrize("name", MAPS)
def test_a_system_moves_alike_after_its_journey_also_when_it_was_used(name: str) -> None:
    system, start = MAPS[name]
    before = moved(system, start)
    again = returned(system)
    assert type(again) is type(system)
    assert moved(again, start) == before


@pytest.mark.parametrize("flow", [Lorenz(), Rossler(), Duffing()], ids=repr)
def test_a_flow_moves_alike_after_its_journey(flow: Any) -> None:
    state = np.array([0.1, 0.2, 0.3])
    assert returned(flow).advance(state, 0.5).tobytes() == flow.advance(state, 0.5).tobytes()


CHAIN = ImpactChain(masses=2, frequency=0.9)


def impact_results() -> list[Any]:
    attractor = CHAIN.attractor(transient=100, impacts=30)
    orbit = CHAIN.periodic_orbit(periods=3)
    branch = continue_orbit(orbit, "frequency", bounds=(0.88, 0.92), points=5)
    _ = attractor.label, attractor.error, orbit.multipliers
    return [attractor, attractor.record, attractor.final, attractor.label, orbit, branch]


def map_results() -> list[Any]:
    attractor = MapAttractor(Logistic(rate=3.2), np.array([0.3]), 50, 20)
    _ = attractor.label, attractor.error
    orbit = periodic_orbit(Logistic(rate=3.2), [0.5], period=2)
    return [attractor, attractor.label, orbit, *explored(values=1, iterates=2).bifurcations]


@pytest.mark.parametrize("make", [impact_results, map_results])
def test_results_come_back_as_they_were(make: Callable[[], list[Any]]) -> None:
    for result in make():
        again = returned(result)
        assert repr(again) == repr(result)
        for name in ("states", "unknowns", "multipliers", "parameter"):
            if hasattr(result, name):
                found = np.asarray(getattr(again, name)).tobytes()
                assert found == np.asarray(getattr(result, name)).tobytes(), name


def test_a_record_comes_back_from_a_machine_that_entered_other_modes_before() -> None:
    system = entered()
    record = system.simulate(impacts=60, start=system.attractor(impacts=5).final)
    times = np.linspace(0.0, record.time[-1], 200)
    forces = [r.observable("belt.friction_force", times) for r in (record, returned(record))]
    assert forces[0].tobytes() == forces[1].tobytes()


@pytest.mark.parametrize("make", [swept, mapped, attracted, explored])
def test_what_was_made_of_many_points_comes_back_as_it_was(make: Callable[[], Any]) -> None:
    found = make()
    assert bits(returned(found)) == bits(found)
