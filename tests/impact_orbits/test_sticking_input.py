"""What is asked of orbits that stick and is refused, in one line."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

CHAIN = ImpactChain(masses=2, frequency=0.408, restitution=0.3)


def refusal(system: ImpactOscillator, **arguments: Any) -> str:
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        system.periodic_orbit(sticking=True, **arguments)
    message = str(refused.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("name", "given"),
    [("impacts", 1), ("impacts", 3), ("phases", [1.0]), ("phases", []), ("sides", [0])],
)
def test_what_names_impacts_is_refused_with_sticking(name: str, given: object) -> None:
    expected = f"{name} must not be given with sticking; got {given!r}"
    assert refusal(CHAIN, **{name: given}) == expected


def test_impacts_are_refused_where_all_orbits_are_asked_for() -> None:
    message = "^impacts must not be given with sticking; got 2$"
    arguments: dict[str, Any] = {"sticking": True, "impacts": 2}
    with pytest.raises(ValueError, match=message):
        CHAIN.periodic_orbits(**arguments)


@pytest.mark.parametrize("periods", [0, -1, 1.5, "2", None, True, math.nan])
def test_periods_that_are_no_number_of_periods_are_refused(periods: Any) -> None:
    message = refusal(CHAIN, periods=periods)
    assert message.startswith("periods must be")
    assert repr(periods) in message


def test_without_loss_at_impacts_nothing_sticks() -> None:
    elastic = CHAIN.replace(restitution=1.0)
    assert elastic.periodic_orbits(sticking=True) == []
    assert "P(inf,1)" in refusal(elastic)


def test_where_no_mass_comes_near_the_table_nothing_sticks() -> None:
    distant = ImpactChain(masses=2, frequency=3.0, offset=-50.0)
    assert distant.periodic_orbits(sticking=True) == []
    assert refusal(distant).startswith("no orbit P(inf,1) was found for ImpactChain(")


def test_a_ball_that_stays_on_its_table_for_ever_has_no_orbit() -> None:
    resting = BouncingBall(amplitude=0.5, frequency=1.0, restitution=0.2)
    assert resting.periodic_orbits(sticking=True) == []
    assert refusal(resting).startswith("no orbit P(inf,1) was found for BouncingBall(")
