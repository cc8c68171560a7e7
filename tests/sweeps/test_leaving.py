"""Sweeps that follow leave orbits that have become unstable, and no others."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit.data.store
from dynkit import MapAttractor, Sweep, sweep
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane
from dynkit.systems import Henon, ImpactChain, IntegratedFlow, Logistic, PlayOscillator
from tests.example_systems import Cubic, Ricker
from tests.sweeps.cases import CHAIN, FREQUENCIES, SHORT, assert_same_bits

BRIEF: dict[str, Any] = {"transient": 200, "keep": 40, "progress": False}


PLAY = PlayOscillator(
    play=1.0, spring=1.0, damping=0.1, force=1.0, amplitude=0.0, frequency=1.3, restitution=0.6
)


def case(seed: int) -> tuple[Map, str, Array, Array, float]:
    """A family, its parameter, values, the fixed point at the first, and where it bifurcates."""
    random = np.random.default_rng(seed)
    system: Map
    kind = seed % 4
    if kind == 0:
        system, name, fixed, critical = Ricker(1.5), "growth", [1.0], 2.0
    elif kind == 1:
        system, name, fixed, critical = Logistic(rate=2.5), "rate", [0.6], 3.0
    elif kind == 2:
        b = float(random.uniform(-0.3, 0.5))
        critical, name = 0.75 * (1.0 - b) ** 2, "a"
        a = 0.8 * critical
        x = (b - 1.0 + np.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
        system, fixed = Henon(a=a, b=b), [x, b * x]
    else:
        b = float(random.uniform(-0.3, 0.5))
        critical, name = 1.0 - b, "a"
        system, fixed = Cubic(0.8 * critical, b), [0.0, 0.0]
    first = system.parameters[name]
    span = critical - first
    count = int(random.integers(6, 12))
    return system, name, first + np.linspace(0.0, 1.4 * span, count), np.array(fixed), critical


@pytest.mark.parametrize("seed", range(20))
def test_beyond_a_bifurcation_no_label_is_that_of_the_unstable_orbit(seed: int) -> None:
    system, name, values, start, critical = case(seed)
    up_and_down = np.concatenate([values, values[::-1]])
    found = sweep(system, name, up_and_down, start=start, **BRIEF)
    beyond = up_and_down > critical + 1e-9
    for value, label, after in zip(up_and_down, found.labels, beyond, strict=True):
        assert label.stable is not False, (value, label)
        if not after:
            assert str(label) == "P(1)" or abs(value - critical) < 1e-9
    doubles = not isinstance(system, Cubic)
    names = {str(label) for label, after in zip(found.labels, beyond, strict=True) if after}
    assert names <= ({"P(2)", "P(4)"} if doubles else {"P(1)"})
    if not doubles:
        assert (abs(found.observable("state[0]")[beyond]) > 1e-3).all()
    stays = isinstance(system, (Ricker, Cubic))  # the fixed point does not move
    assert found.displaced.sum() == (1 if stays else 0)
    assert beyond[found.displaced].all()


def test_the_ricker_map_doubles_and_becomes_chaotic() -> None:
    found = sweep(Ricker(1.5), "growth", np.linspace(1.5, 3.2, 18), start=[0.3], progress=False)
    names = [str(label) for label in found.labels]
    assert names[:5] == ["P(1)"] * 5  # to 1.9
    assert names[6:11] == ["P(2)"] * 5  # to 2.5; P(4) from 2.526 (R. May, Science 186, 1974)
    assert names[11] == "P(4)"
    assert "chaotic" in names


def test_an_orbit_of_period_two_is_left_where_it_doubles() -> None:
    rate = 1.0 + np.sqrt(6.0)  # where P(2) of the logistic map becomes unstable
    below, above = rate - 0.02, rate + 0.05
    root = np.sqrt((below - 3.0) * (below + 1.0))
    found = sweep(
        Logistic(rate=below),
        "rate",
        [below, above],
        start=[(below + 1.0 + root) / (2.0 * below)],
        progress=False,
    )
    assert [str(label) for label in found.labels] == ["P(2)", "P(4)"]


def symmetric_state(frequency: float) -> Any:
    system = PLAY.replace(frequency=frequency)
    orbits = system.periodic_orbits(impacts=2, periods=1)
    (orbit,) = [o for o in orbits if o.admissible and abs(o.states[:, 0].sum()) < 1e-9][:1]
    return system.impact_state(orbit.states[0])


def test_a_symmetric_motion_of_an_oscillator_is_left_where_it_is_unstable() -> None:
    start = symmetric_state(1.3)
    still = PLAY.attractor(transient=100, impacts=20, start=start).states[:, 0]
    assert abs(still[:-1] + still[1:]).max() < 1e-9
    found = sweep(PLAY, "frequency", [1.3, 1.25, 1.5], start=start, **BRIEF)
    broken = abs(found.observable("relative_velocity")[:, :2].sum(axis=1)) > 1e-3
    # multipliers of the symmetric orbit: 1.06, 1.06, 0.71
    assert broken.tolist() == [True, True, False]
    assert found.displaced.tolist() == [True, False, False]
    assert all(label.stable for label in found.labels)


def test_a_label_says_that_an_orbit_is_unstable() -> None:
    start = np.array([1.0 - 1.0 / 3.2])
    fixed = MapAttractor(Logistic(rate=3.2), start, transient=0, iterations=100)
    assert str(fixed.label) == "P(1) unstable"
    assert fixed.label.multiplier == pytest.approx(1.2, rel=1e-12)  # |2 - rate|
    assert "P(1) unstable" in repr(fixed)
    symmetric = PLAY.attractor(transient=10, start=symmetric_state(1.3))
    assert str(symmetric.label) == "P(2,1) unstable"
    assert str(PLAY.attractor(transient=2000).label) == "P(2,1)"


def test_multipliers_of_labels_are_those_of_the_orbits() -> None:
    for frequency in (0.87, 0.5):
        attractor = CHAIN.replace(frequency=frequency, masses=10).attractor()
        expected = abs(attractor.periodic_orbit().multipliers[0])
        label = attractor.label
        assert abs(label.multiplier - expected) <= label.multiplier_error
        assert label.stable


def test_a_sticking_orbit_has_a_multiplier() -> None:
    label = CHAIN.replace(frequency=0.408, masses=10).attractor().label
    assert str(label) == "P(inf,2)"
    assert label.multiplier == pytest.approx(0.864601, abs=1e-6)  # `ImpactOscillator` docstring
    assert label.stable


def test_stable_motions_are_not_touched() -> None:
    found = sweep(CHAIN, "frequency", FREQUENCIES, **SHORT)
    assert not found.displaced.any()
    start = None
    for row, frequency in zip(found.observable("relative_velocity"), FREQUENCIES, strict=True):
        attractor = CHAIN.replace(frequency=float(frequency)).attractor(
            transient=30, impacts=20, start=start
        )
        start = attractor.final
        assert row.tobytes() == attractor.record.relative_velocity.tobytes()


def ricker(store: Path | None, values: Array) -> Sweep:
    return sweep(Ricker(1.5), "growth", values, start=[1.0], store=store, **BRIEF)


@pytest.mark.parametrize("finished", [1, 3, 4])
def test_a_sweep_that_left_an_orbit_resumes_with_the_same_bits(
    tmp_path: Path, finished: int
) -> None:
    values = np.linspace(1.8, 2.4, 6)
    whole = ricker(tmp_path / "whole.h5", values)
    archive = dynkit.data.store.read(tmp_path / "whole.h5")
    arrays = {
        name: rows if name.startswith("given/") else rows[:finished]
        for name, rows in archive.arrays.items()
    }
    dynkit.data.store.write(
        tmp_path / "part.h5", dynkit.data.store.Archive(archive.entries, arrays)
    )
    resumed = ricker(tmp_path / "part.h5", values)
    assert np.flatnonzero(resumed.displaced).tolist() == np.flatnonzero(whole.displaced).tolist()
    for name in whole.observables:
        assert whole.observable(name).tobytes() == resumed.observable(name).tobytes()
    assert_same_bits(whole, ricker(None, values))


def test_attractors_of_displaced_values_are_the_ones_that_were_swept(tmp_path: Path) -> None:
    values = np.linspace(1.8, 2.4, 6)
    ricker(tmp_path / "x.h5", values)
    found = Sweep.load(tmp_path / "x.h5", Ricker(2.0))
    (place,) = np.flatnonzero(found.displaced).tolist()
    assert (
        found.attractor(place).states.ravel().tobytes()
        == found.observable("state[0]")[place].tobytes()
    )
    assert found.to_xarray()["displaced"].values.tolist() == found.displaced.tolist()


@dataclass(frozen=True, kw_only=True)
class Circles(IntegratedFlow):
    """A plane flow, r' = growth r (r - 1) (2 - r), phase' = 1: r = 1 repels for positive growth.

    Its multiplier is exp(2 pi growth).
    """

    growth: float
    dimension = 2

    def velocity(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        rate = self._rate(float(np.hypot(x, y)))
        return np.array([rate * x - y, rate * y + x])

    def velocity_jacobian(self, state: Array) -> Array:
        x, y = both = finite_array("state", state, (2,))
        r = float(np.hypot(x, y))
        slope = self.growth * (3.0 - 2.0 * r)
        return np.array([[self._rate(r), -1.0], [1.0, self._rate(r)]]) + np.outer(
            both, [slope * x / r, slope * y / r]
        )

    def _rate(self, r: float) -> float:
        return self.growth * (r - 1.0) * (2.0 - r)


def test_a_cycle_of_a_flow_is_left_where_it_becomes_unstable() -> None:
    section = PoincareMap(
        Circles(growth=-0.1), Hyperplane(np.array([0.0, 1.0]), 0.0, 1), time_limit=20.0
    )
    short: dict[str, Any] = {"transient": 15, "keep": 6, "progress": False}
    found = sweep(section, "growth", [-0.1, 0.1], start=[1.0], **short)
    last = abs(found.observable("state[0]")[:, -1])
    assert last[0] == pytest.approx(1.0, abs=1e-9)
    assert last[1] == pytest.approx(2.0, abs=0.1)
    assert found.displaced.tolist() == [False, True]
    still = MapAttractor(section.replace(growth=0.1), np.array([1.0]), 0, 6).label
    assert str(still) == "P(1) unstable"
    assert still.multiplier == pytest.approx(np.exp(0.2 * np.pi), rel=1e-6)


@pytest.mark.parametrize("step", [-5e-4, 3e-4])
def test_a_motion_in_a_narrow_basin_is_followed_bit_for_bit_while_it_is_stable(step: float) -> None:
    """Two stable orbits P(2,3) coexist at 0.8; an eighth of the phases leads to this one."""
    chain = ImpactChain(frequency=0.8)
    rest = chain.state()
    starts = np.tile([*rest.position, *rest.velocity, 0.0], (2, 1))
    starts[1, -1] = np.pi / 3.0
    wide, narrow = (
        chain.attractor(transient=300, impacts=40, start=chain.state_from(start))
        for start in starts
    )
    assert str(wide.label) == str(narrow.label) == "P(2,3)"
    speeds = [sorted(motion.observable("relative_velocity")[-2:]) for motion in (wide, narrow)]
    assert abs(np.subtract(speeds[0], speeds[1])).max() > 1e-3
    frequencies: Array = np.asarray(0.8 + step * np.arange(20), dtype=np.float64)
    found = sweep(
        chain, "frequency", frequencies, start=narrow.final, transient=60, keep=20, progress=False
    )
    assert not found.displaced.any()
    last = narrow.final
    for place, frequency in enumerate(frequencies.tolist()):
        alone = chain.replace(frequency=frequency).attractor(transient=60, impacts=20, start=last)
        last = alone.final
        assert str(alone.label) == "P(2,3)"
        assert alone.label.stable
        for name in found.observables:
            assert found.observable(name)[place].tobytes() == alone.observable(name).tobytes()
