from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit.data.store
from dynkit import Map, Sweep, basins, parameter_map, sweep
from dynkit.analysis import BifurcationDiagram
from dynkit.core.no_motion import Diverged, Refused
from dynkit.core.validation import Array
from dynkit.labels.label import OrbitKind
from dynkit.systems import HardStop, Henon, Logistic, MatrixOscillator
from tests.scaling.cases import STARTS, VALUES
from tests.sweeps.cases import (
    CHAIN,
    FREQUENCIES,
    START,
    Counted,
    assert_same_bits,
    sweep_rates,
)

SWEEP: dict[str, Any] = {"system": CHAIN, "parameter": "frequency", "values": FREQUENCIES}
PLANE: dict[str, Any] = {"system": Henon(), "values": VALUES, "start": [0.0, 0.0]}
BASINS: dict[str, Any] = {"system": Henon(), "starts": STARTS}
MADE: dict[Callable[..., object], dict[str, Any]] = {
    sweep: SWEEP,
    parameter_map: PLANE,
    basins: BASINS,
}
EACH: list[tuple[dict[str, Any], str]] = [
    ({"keep": 0}, "keep must be a positive integer; got 0"),
    ({"keep": "100"}, "keep must be a positive integer; got '100'"),
    ({"transient": -1}, "transient must be zero or a positive integer; got -1"),
    ({"transient": 7.0}, r"transient must be zero or a positive integer; got 7\.0"),
    ({"system": "chain"}, "system must be a Map; got 'chain'"),
]
REFUSED: list[tuple[Callable[..., object], dict[str, Any], str]] = [
    *((make, changed, message) for make in MADE for changed, message in EACH),
    (sweep, {"values": []}, "values must hold at least one number; got none"),
    (sweep, {"values": [0.5, np.nan]}, r"values\[1\] must be a finite number; got nan"),
    (sweep, {"values": [np.inf]}, r"values\[0\] must be a finite number; got inf"),
    (sweep, {"values": [[0.5]]}, r"values must have 1 dimension; got shape \(1, 1\)"),
    (sweep, {"values": 0.5}, r"values must have 1 dimension; got shape \(\)"),
    (sweep, {"values": ["0.5"]}, "values must be an array of real numbers"),
    (sweep, {"values": [0.5, 0.0]}, r"frequency must be positive; got 0\.0 in values\[1\]"),
    (sweep, {"parameter": "speed"}, r"parameter must be one of: frequency, .*; got 'speed'"),
    (sweep, {"parameter": "masses"}, r"parameter must be one of: .*; got 'masses'"),
    (sweep, {"observables": ["speed"]}, "observables must be among .*, time, .*; got 'speed'"),
    (sweep, {"observables": "energy"}, "observables must be a sequence of names; got 'energy'"),
    (sweep, {"observables": []}, r"observables must be a sequence of names; got \[\]"),
    (sweep, {"start": [1.0, 2.0]}, r"start must be an ImpactState; got \[1\.0, 2\.0\]"),
    (sweep, {"start": CHAIN.replace(masses=4).state()}, "start must have 3 masses; got 4"),
    (parameter_map, {"values": {"a": [1.0]}}, "values must hold the values of two parameters by"),
    (parameter_map, {"values": [1.0, 2.0]}, "values must hold the values of two parameters by"),
    (
        parameter_map,
        {"values": {"a": [1.0], "c": [1.0]}},
        "values must be of parameters among a, b; got 'c'",
    ),
    (
        parameter_map,
        {"values": {"a": [1.0], "b": []}},
        r"values\['b'\] must hold at least one number; got",
    ),
    (
        parameter_map,
        {"values": {"a": [1.0], "b": [np.nan]}},
        r"values\['b'\]\[0\] must be a finite number",
    ),
    (
        parameter_map,
        {"system": CHAIN, "values": {"frequency": [0.5, 0.0], "damping": [0.1]}, "start": None},
        r"must be positive; got 0\.0 in values\['frequency'\]\[1",
    ),
    (parameter_map, {"start": None}, r"start must be a state of the map, \(2,\); got None"),
    (parameter_map, {"start": [1.0]}, r"start must have shape \(2,\); got shape \(1,\)"),
    (parameter_map, {"exponents": -1}, "exponents must be zero or a positive integer; got -1"),
    (
        parameter_map,
        {"observables": ["energy"]},
        r"observables must be among state\[0\], state\[1\]; got",
    ),
    (basins, {"starts": [0.0, 0.0]}, r"starts must have shape \(k, 2\) or \(k1, k2, 2\)"),
    (basins, {"starts": np.zeros((0, 2))}, r"starts must have shape .* and hold one or more"),
    (basins, {"starts": [[0.0]]}, r"starts must have shape \(1, 2\); got shape \(1, 1\)"),
    (basins, {"starts": [[0.0, np.nan]]}, r"starts\[0, 1\] must be a finite number; got nan"),
]


@pytest.mark.parametrize(("make", "changed", "message"), REFUSED)
def test_bad_input_is_refused_by_name_and_nothing_is_written(
    tmp_path: Path, make: Callable[..., object], changed: dict[str, Any], message: str
) -> None:
    options: dict[str, Any] = {"transient": 30, "keep": 20, "progress": False}
    with pytest.raises(ValueError, match=message):
        make(**{**MADE[make], **options, **changed}, store=tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_map_needs_a_start() -> None:
    with pytest.raises(ValueError, match=r"start must be a state of the map, \(1,\); got None"):
        sweep_rates(start=None)


@dataclass(frozen=True)
class Shrinking(Map):
    """The logistic map on states below a bound."""

    bound: float = 1.0

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        if state[0] > self.bound:
            raise Refused(f"state[0] must not exceed {self.bound}; got {state[0]}")
        return 3.2 * state * (1.0 - state)


def test_a_motion_that_is_refused_on_the_way_keeps_what_was_finished(tmp_path: Path) -> None:
    store, values = tmp_path / "x.h5", [1.0, 0.6]
    with pytest.raises(Refused, match=r"^state\[0\] must not exceed 0\.6; got .*\nat bound 0\.6$"):
        sweep(Shrinking(), "bound", values, start=START, store=store, progress=False)
    assert len(dynkit.data.store.read(store).arrays["done"]) == 1


@pytest.mark.parametrize("follow", [True, False])
def test_a_sweep_goes_on_after_a_motion_that_runs_away(tmp_path: Path, follow: bool) -> None:
    store, values = tmp_path / "x.h5", [4.5, 3.2, 5.0, 4.5, 3.5]
    options: dict[str, Any] = {"start": START, "follow": follow, "progress": False}
    found = sweep(Logistic(3.0), "rate", values, store=store, **options)
    assert [label.name for label in found.labels] == [
        *("no motion", "P(2)", "no motion", "no motion", "P(4)")
    ]
    assert found.endings[0].startswith("no motion: the motion runs away: state[0] is -inf")
    assert found.counts.tolist() == [0, 100, 0, 0, 100]
    assert np.isnan(found.observable("state[0]")).sum(axis=1).tolist() == [100, 0, 100, 100, 0]
    assert np.isnan(found.error).tolist() == [True, False, True, True, False]
    # after a value without a motion a following sweep starts as at its first value
    alone = Logistic(3.5).attractor(start=START)
    assert found.observable("state[0]")[4].tolist() == alone.states[:, 0].tolist()
    with pytest.raises(Diverged, match="runs away"):
        found.attractor(2)
    loaded = Sweep.load(store, Logistic())
    assert loaded.endings == found.endings
    assert loaded.label(3).name == "no motion"
    assert loaded.attractor(4).label == found.label(4)
    assert BifurcationDiagram.of(found).intervals[0].label == "no motion"


def test_a_sweep_resumes_after_a_value_without_a_motion_with_the_same_bits(tmp_path: Path) -> None:
    store, values = tmp_path / "x.h5", [3.5, 3.5, 4.5, 3.5, 3.2]
    options: dict[str, Any] = {"start": START, "transient": 20, "keep": 10, "progress": False}
    whole = sweep(Counted(3.0), "rate", values, **options)
    assert whole.endings[2].startswith("no motion")
    for calls, done in ((30, 1), (31, 2), (30, 3)):
        Counted.trap = (Counted.calls + calls, KeyboardInterrupt)
        with pytest.raises(KeyboardInterrupt):
            sweep(Counted(3.0), "rate", values, store=store, **options)
        assert len(dynkit.data.store.read(store).arrays["done"]) == done
    assert_same_bits(sweep(Counted(3.0), "rate", values, store=store, **options), whole)


def test_a_motion_whose_kept_states_exist_but_later_ones_run_away_has_no_label() -> None:
    options: dict[str, Any] = {"transient": 0, "keep": 20, "follow": False, "progress": False}
    found = sweep(Logistic(3.0), "rate", [3.2, 4.001], start=START, **options)
    assert found.counts.tolist() == [20, 20]
    assert [label.name for label in found.labels] == ["P(2)", "no motion"]
    assert np.isnan(found.labels[1].error)


@dataclass(frozen=True)
class Cubic(Map):
    """The origin is fixed; where it is unstable, motions beside it run away."""

    rate: float = 2.0

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        return self.rate * state + state**3


def test_an_unstable_orbit_from_which_motions_run_away_is_a_motion() -> None:
    found = sweep(Cubic(), "rate", [2.0, 0.5], start=[0.0], progress=False)
    assert [label.name for label in found.labels] == ["P(1) unstable", "P(1)"]
    assert not found.displaced.any()


def test_the_value_of_the_swept_parameter_has_no_effect() -> None:
    stops = [HardStop(0, offset=0.1, name="low"), HardStop(0, side="below", name="high")]
    plain: dict[str, Any] = {"M": [[1.0]], "C": [[0.1]], "K": [[1.0]], "harmonic_forces": [0.5]}
    machine = MatrixOscillator(**plain, frequency=0.8, elements=stops)
    options: dict[str, Any] = {"transient": 20, "keep": 10, "progress": False}
    found = sweep(machine, "high.offset", [0.4, 0.5], **options)
    assert found.counts.tolist() == [10, 10]
    plane = parameter_map(machine, {"high.offset": [0.4], "frequency": [0.8, 0.9]}, **options)
    assert "refused" not in plane.names


def test_pairs_without_a_motion_are_found_by_their_kind() -> None:
    found = parameter_map(Henon(), {"a": [1.2, 3.0], "b": [0.3]}, start=[0.0, 0.0], progress=False)
    assert found.where(OrbitKind.NO_MOTION).tolist() == [[False], [True]]


@pytest.mark.parametrize("place", [-1, 40])
def test_a_place_beyond_the_values_is_refused(place: int) -> None:
    with pytest.raises(ValueError, match=rf"place must lie in \[0, 39\]; got {place}"):
        sweep_rates().label(place)


def test_an_observable_that_was_not_kept_is_refused() -> None:
    with pytest.raises(ValueError, match=r"name must be one of: state\[0\]; got 'energy'"):
        sweep_rates().observable("energy")


def test_what_was_found_cannot_be_changed() -> None:
    found = sweep_rates()
    with pytest.raises(ValueError, match="read-only"):
        found.observable("state[0]")[0, 0] = 1.0
