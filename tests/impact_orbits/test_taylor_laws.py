"""Orbits that stick to a stop with an impact law, beside springs that are not linear."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.systems import TodaChain, ViscoelasticSpheres
from tests.impact.own_laws import Constant, Hardening
from tests.impact.taylor_cases import Bead, Disguised
from tests.impact_orbits.contracts import check_parameters
from tests.impact_orbits.test_law_orbits import sticking


def orbit_of(system: Any) -> Any:
    return system.attractor(transient=300).periodic_orbit()


@pytest.mark.parametrize("law", [Hardening(0.3, 1.0), ViscoelasticSpheres(1.2)])
def test_linear_chains_have_the_orbits_of_the_exact_engine(law: Any) -> None:
    given: dict[str, Any] = {"masses": 2, "frequency": 0.408, "damping": 0.1}
    one, two = orbit_of(sticking(law)), orbit_of(Disguised(**given, restitution=law))
    assert (two.label, two.sticks, two.admissible) == (one.label, True, True)
    away = abs(one.system.difference(one.states, two.states)).max()
    assert away <= one.error + two.error + one.chatter_error + two.chatter_error
    assert np.sort(abs(two.multipliers)) == pytest.approx(np.sort(abs(one.multipliers)), abs=1e-7)


@pytest.mark.parametrize(
    "system",
    [
        TodaChain(masses=2, frequency=0.2),
        Bead(frequency=0.7, offset=0.1, amplitude=0.4),
    ],
)
def test_a_law_that_is_a_number_sticks_as_the_number(system: Any) -> None:
    law, number = (orbit_of(system.replace(restitution=r)) for r in (Constant(0.3), 0.3))
    assert law.sticks
    assert abs(law.states - number.states).max() <= law.error + number.error
    assert abs(law.multipliers - number.multipliers).max() < 1e-10
    by = [
        orbit.problem(name).parameter_derivative(orbit.unknowns, np.array([0.3]))
        for orbit, name in ((law, "restitution.value"), (number, "restitution"))
    ]
    assert by[0] == pytest.approx(by[1], rel=1e-8, abs=1e-8 * abs(by[1]).max())


@pytest.mark.parametrize(
    ("system", "names"),
    [
        (
            TodaChain(masses=2, frequency=0.2, restitution=Hardening(0.3, 1.0)),
            ["restitution.scale"],
        ),
        (
            Bead(frequency=0.7, offset=0.1, amplitude=0.4, restitution=Hardening(0.2, 1.0)),
            ["restitution.scale", "frequency"],
        ),
    ],
)
def test_equations_keep_the_contracts(system: Any, names: list[str]) -> None:
    orbit = orbit_of(system)
    assert orbit.sticks
    check_parameters(orbit, names)
