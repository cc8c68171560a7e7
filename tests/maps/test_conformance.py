"""The textbook maps keep the contracts of maps and attractors."""

import numpy as np
import pytest

from dynkit import Map, MapAttractor
from dynkit.systems import FoldedTowel, Henon, HighBounce, Ikeda, Logistic, StandardMap
from dynkit.testing import AttractorCheck, MapCheck, attractor_checks, check_name, map_checks

CHAOTIC: dict[str, Map] = {
    "logistic": Logistic(4.0),
    "henon": Henon(),
    "high bounce": HighBounce(restitution=0.5, gamma=10.0),
    "ikeda": Ikeda(),
    "towel": FoldedTowel(),
    "kicked rotor": StandardMap(k=5.0),
}
PERIODIC: dict[str, Map] = {
    "logistic, period 4": Logistic(3.5),
    "henon, period 2": Henon(0.385),
    "high bounce, period 1": HighBounce(restitution=0.8, gamma=2.0),
    "dead ball": HighBounce(restitution=0.0, gamma=2.0),
    "ikeda, period 1": Ikeda(u=0.4),
    "standard map": StandardMap(k=0.9),
    "area preserving": HighBounce(restitution=1.0, gamma=0.9),
}
MAPS = CHAOTIC | PERIODIC
START = np.array([0.3, 0.2, 0.1])


@pytest.mark.parametrize("check", map_checks, ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_it_is_a_map(name: str, check: MapCheck) -> None:
    check(MAPS[name], MAPS[name].iterate(START[: MAPS[name].dimension], 5))


@pytest.mark.parametrize("check", attractor_checks, ids=check_name)
@pytest.mark.parametrize("name", MAPS)
def test_its_attractor_is_an_attractor(name: str, check: AttractorCheck) -> None:
    system = MAPS[name]
    start = START[: system.dimension]
    check(lambda transient, count: MapAttractor(system, start, transient, count))


@pytest.mark.parametrize("name", CHAOTIC)
def test_in_chaos_the_error_is_as_large_as_the_attractor(name: str) -> None:
    system = CHAOTIC[name]
    attractor = MapAttractor(system, START[: system.dimension], 200, 200)
    assert attractor.error > 0.1 * np.ptp(attractor.states, axis=0).max()


@pytest.mark.parametrize("name", ["logistic, period 4", "henon, period 2", "high bounce, period 1"])
def test_on_a_stable_cycle_the_error_is_rounding(name: str) -> None:
    system = PERIODIC[name]
    attractor = MapAttractor(system, START[: system.dimension], 1000, 200)
    # disturbances of four roundings per iterate and either sign, and multipliers below 0.98
    assert attractor.error < 100.0 * 2.0**-52 * np.abs(attractor.states).max()
