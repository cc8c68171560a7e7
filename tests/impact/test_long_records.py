"""What is asked of long records costs memory for a batch, or is refused in one line."""

from __future__ import annotations

import re
import sys
import tracemalloc
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given

from dynkit import basins, parameter_map
from dynkit.analysis import PowerSpectrum, TimeSeries
from dynkit.core import progress
from dynkit.dynamics.attractor import MapAttractor
from dynkit.systems import Henon, ImpactChain
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor
from dynkit.systems.impact.records import record as records
from tests.core.test_progress import Terminal
from tests.effort import share
from tests.impact.any_oscillator import Begin, begins


def chain(**arguments: Any) -> ImpactChain:
    return ImpactChain(**{"masses": 2, "frequency": 0.87, **arguments})


@share(0.1)
@given(begin=begins(largest=3))
def test_errors_do_not_depend_on_the_batches(begin: Begin) -> None:
    whole = begin.simulate(60)
    with patch.object(records, "_NUMBERS", 1):
        pieces = begin.simulate(60)
        assert pieces.error.tobytes() == whole.error.tobytes()
        assert pieces.energy.tobytes() == whole.energy.tobytes()


@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
def test_the_error_of_an_attractor_is_that_of_the_whole_run(frequency: float) -> None:
    attractor = chain(frequency=frequency).attractor(transient=200, impacts=50)
    whole = chain(frequency=frequency).simulate(impacts=250)
    with patch.object(records, "_NUMBERS", 300):
        assert attractor.error == whole.error.max()


def test_the_error_of_a_long_record_takes_the_memory_of_a_batch() -> None:
    record = chain(masses=1).simulate(impacts=120_000)
    tracemalloc.start()
    try:
        error = record.error
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The result, and less than thirty arrays of a batch at once.
    assert peak < error.nbytes + 30 * 8 * records._NUMBERS
    assert peak - error.nbytes < 200e6


def test_the_error_of_a_long_record_shows_how_far_it_is() -> None:
    record, shown = chain().simulate(impacts=100), Terminal()
    with (
        patch.object(records, "_NUMBERS", 300),
        patch.multiple(progress, _QUIET=1e-9, _OFTEN=0.0),
        patch.object(sys, "stderr", shown),
    ):
        assert record.error.shape == (100,)
    assert re.search(r"error: +\d+%.* [1-9]\d*/100 ", shown.getvalue())


def test_the_error_of_a_short_record_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert chain().simulate(impacts=100).error.shape == (100,)
    assert capsys.readouterr().err == ""


def test_a_time_beyond_a_gigabyte_of_impacts_is_refused_before_it_is_simulated() -> None:
    attractor = chain().attractor(impacts=100)
    refusal = r"times must not exceed .*, or 16777216 impacts after the transient; got 1000000000.0"
    with (
        patch.object(type(attractor.system), "simulate", side_effect=AssertionError),
        pytest.raises(ValueError, match=refusal),
    ):
        TimeSeries(attractor, [0.0, 1e9])
    assert isinstance(attractor, ImpactAttractor)


def test_an_iterate_beyond_a_gigabyte_of_states_is_refused() -> None:
    attractor = MapAttractor(Henon(), np.array([0.1, 0.1]), 10, 10)
    with pytest.raises(ValueError, match="times must not exceed 67108864; got 1000000000"):
        TimeSeries(attractor, [0.0, 1e9])


def test_more_samples_than_a_gigabyte_are_refused() -> None:
    with pytest.raises(ValueError, match="samples must not exceed 8388608; got 10000000000000"):
        PowerSpectrum(chain().attractor(), samples=10**13)


def test_a_map_of_too_many_pairs_is_refused_before_any_is_looked_at() -> None:
    values = {"frequency": np.linspace(0.7, 1.1, 3_200_000), "restitution": np.full(3_200_000, 0.5)}
    refusal = "values must not make more than 10000000 pairs; got 3200000 of frequency and 3200000"
    with (
        patch.object(ImpactChain, "replace", side_effect=AssertionError),
        pytest.raises(ValueError, match=refusal),
    ):
        parameter_map(chain(), values, progress=False)


def test_basins_of_too_many_starts_are_refused_before_any_is_looked_at() -> None:
    starts = np.broadcast_to(np.zeros(2), (3_200_000, 3_200_000, 2))
    refusal = "starts must not be more than 10000000; got 10240000000000"
    with pytest.raises(ValueError, match=refusal):
        basins(Henon(), starts, progress=False)


def test_what_lies_before_a_late_time_is_not_simulated_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    attractor = ImpactChain(masses=2, frequency=0.9).attractor(impacts=10)
    late = 40.0 * float(attractor.record.time[-1])
    times = np.linspace(0.0, late, 50)
    together = attractor.time_series(times)
    monkeypatch.setattr(ImpactChain, "simulate", lambda *_, **__: pytest.fail("simulated again"))
    assert attractor.time_series(times[:30]).tobytes() == together[:30].tobytes()
