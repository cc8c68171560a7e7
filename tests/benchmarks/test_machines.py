"""Error against run time of machines: the reference, and the order of time stepping."""

from __future__ import annotations

import importlib.util
import sys

import pytest

from dynkit.analysis.work_precision.methods import Unsuited
from tests.benchmarks.machines import JOBS, STEPS, by_dynkit, by_moreau, by_scipy, exact
from tests.benchmarks.peers.siconos_machines import by_siconos


@pytest.mark.parametrize("name", JOBS)
def test_dynkit_is_right_and_time_stepping_of_the_first_order(name: str) -> None:
    job = JOBS[name]
    end = exact(job)
    assert abs(by_dynkit(job, 0.0)() - end).max() < 1e-12
    steppers = [by_moreau]
    if importlib.util.find_spec("siconos") is not None:
        steppers.append(by_siconos)
    for stepper in steppers:
        errors = [float(abs(stepper(job, step)() - end).max()) for step in STEPS[:2]]
        # the constant varies with where events lie in their steps
        assert errors[1] < 0.3 * errors[0] < 0.03


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("siconos", "siconos.kernel"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(Unsuited, match="Siconos is not installed"):
        by_siconos(JOBS["friction"], 0.1)


def test_events_of_an_integrator_find_the_same_motion() -> None:
    job = JOBS["two stops"]
    assert abs(by_scipy(job, 1e-10)() - exact(job)).max() < 1e-6
    with pytest.raises(Unsuited, match="stick is no root"):
        by_scipy(JOBS["friction"], 1e-6)
