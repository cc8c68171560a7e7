"""Each kind of bifurcation is described in one place, and completely."""

from __future__ import annotations

import numpy as np
import pytest

from dynkit.continuation.bifurcations.kinds import KINDS, Kind
from dynkit.continuation.continuing import continue_orbit
from dynkit.continuation.test_functions import TESTS
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.spectrum import Spectrum
from tests.continuation.starts import logistic


def test_every_kind_has_a_row() -> None:
    assert list(KINDS) == list(BifurcationKind)


def test_test_functions_have_defining_systems_and_events_leave_them_to_the_problem() -> None:
    with_system = {kind for kind, row in KINDS.items() if row.defining_system is not None}
    assert with_system == {test.kind for test in TESTS}


@pytest.mark.parametrize("row", KINDS.values(), ids=KINDS)
def test_the_critical_multiplier_is_that_of_the_defining_system(row: Kind) -> None:
    orbit = logistic(2.5)
    if row.critical and row.defining_system is not None:
        problem = orbit.problem("rate")
        given = problem, orbit.unknowns, np.zeros(1), problem.values, np.ones(1)
        condition = row.defining_system(*given)
        assert condition.multiplier(np.zeros(1)) == row.critical[Spectrum.MULTIPLIERS]


def test_a_kind_equals_its_text() -> None:
    branch = continue_orbit(logistic(2.5), "rate", bounds=(2.4, 3.2))
    (doubling,) = branch.bifurcations
    assert doubling.kind is BifurcationKind.PD
    assert doubling.kind == "PD"
    assert f"{doubling.kind}" == "PD"
