from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynkit.data.store
from dynkit import sweep
from dynkit.core.no_motion import Diverged
from dynkit.systems import Logistic
from tests.sweeps.cases import (
    CHAIN,
    FREQUENCIES,
    SHORT,
    START,
    sweep_rates,
)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"values": []}, "values must hold at least one number; got none"),
        ({"values": [0.5, np.nan]}, r"values\[1\] must be a finite number; got nan"),
        ({"values": [np.inf]}, r"values\[0\] must be a finite number; got inf"),
        ({"values": [[0.5]]}, r"values must have shape \(any,\); got shape \(1, 1\)"),
        ({"values": 0.5}, r"values must have shape \(any,\); got shape \(\)"),
        ({"values": ["0.5"]}, "values must be an array of real numbers"),
        ({"values": [0.5, 0.0]}, r"frequency must be positive; got 0\.0 in values\[1\]"),
        ({"parameter": "speed"}, r"parameter must be one of: frequency, .*; got 'speed'"),
        ({"parameter": "masses"}, r"parameter must be one of: .*; got 'masses'"),
        ({"transient": -1}, "transient must be zero or a positive integer; got -1"),
        ({"transient": 7.0}, r"transient must be zero or a positive integer; got 7\.0"),
        ({"keep": 0}, "keep must be a positive integer; got 0"),
        ({"keep": "100"}, "keep must be a positive integer; got '100'"),
        (
            {"observables": ["speed"]},
            "observables must be among .*, time; got 'speed'",
        ),
        ({"observables": "energy"}, "observables must be a sequence of names; got 'energy'"),
        ({"observables": []}, r"observables must be a sequence of names; got \[\]"),
        ({"start": [1.0, 2.0]}, r"start must be an ImpactState; got \[1\.0, 2\.0\]"),
        ({"start": CHAIN.replace(masses=4).state()}, "start must have 3 masses; got 4"),
        ({"system": "chain"}, "system must be a Map; got 'chain'"),
    ],
)
def test_bad_input_is_refused_by_name_and_nothing_is_written(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    usual: dict[str, Any] = {"system": CHAIN, "parameter": "frequency", "values": FREQUENCIES}
    with pytest.raises(ValueError, match=message):
        sweep(**{**usual, **SHORT, **changed}, store=tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_map_needs_a_start() -> None:
    with pytest.raises(ValueError, match=r"start must be a state of the map, \(1,\); got None"):
        sweep_rates(start=None)


def test_a_motion_that_is_refused_on_the_way_keeps_what_was_finished(tmp_path: Path) -> None:
    store = tmp_path / "x.h5"
    with pytest.raises(Diverged, match=r"runs away: state\[0\] is -inf .*\nat rate 4\.5$"):
        sweep(Logistic(3.0), "rate", [3.2, 4.5], start=START, store=store, progress=False)
    assert len(dynkit.data.store.read(store).arrays["done"]) == 1


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
