"""Error against run time of flows: the reference, and every method of it."""

from __future__ import annotations

import importlib.util
from itertools import pairwise

import numpy as np
import pytest

from tests.benchmarks.flows import JOBS, METHODS, exact, measurements


@pytest.mark.parametrize("name", JOBS)
def test_rates_are_those_of_the_flow(name: str) -> None:
    job = JOBS[name]
    assert job.rates(list(job.start)) == pytest.approx(job.flow.velocity(np.array(job.start)))


def test_errors_fall_with_the_tolerance_and_what_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # once each: seconds are for the page
    monkeypatch.setattr("tests.benchmarks.flows.measured", lambda run: (run(), 0.0))
    name = "Henon-Heiles, 100 units"  # where no rounding is amplified
    found = list(measurements([name]))
    for method, (_, tolerances) in METHODS.items():
        own = [one for one in found if one.method == method]
        if method.startswith("diffrax") and importlib.util.find_spec("diffrax") is None:
            assert [one.remark for one in own] == ["diffrax is not installed"]
            continue
        assert [one.tolerance for one in own] == list(tolerances)
        assert own[-1].error < 1e-4
        assert all(a.error > b.error for a, b in pairwise(own))


def test_dynkit_ends_within_its_own_estimate_on_every_job() -> None:
    for job in JOBS.values():
        start = np.array(job.start)
        off = float(np.linalg.norm(job.flow.advance(start, job.duration) - exact(job)))
        assert off <= job.flow.advance_error(start, job.duration)
