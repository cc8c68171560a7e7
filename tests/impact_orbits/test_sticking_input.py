"""What is asked of orbits that stick and is refused, in one line."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dynkit.systems.impact.ball import BouncingBall
from dynkit.systems.impact.chain import ImpactChain
from dynkit.systems.impact.oscillator import ImpactOscillator
from tests.impact_orbits.sticking_cases import orbit_of

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


def test_a_system_that_nothing_drives_is_refused() -> None:
    quiet = ImpactChain(masses=2, frequency=0.87, amplitude=0.0, constant_forces=(0.0, -1.0))
    message = "system must be driven: amplitude and harmonic_forces are zero"
    assert refusal(quiet) == message
    with pytest.raises(ValueError, match=message):
        quiet.periodic_orbits(sticking=True)


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


def test_an_attractor_that_is_chaotic_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^attractor must be P\(n,m\) or P\(inf,m\); it is chao"):
        ImpactChain(frequency=1.346).attractor().periodic_orbit()


@pytest.mark.parametrize("name", ["nonsense", "", "masses", "contact"])
def test_an_unknown_parameter_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=rf"^parameter must be one of: .*; got '{name}'$"):
        orbit_of("chain of 3, 0.3").problem("frequency", name)


@pytest.mark.parametrize("name", ["x", "energy", ""])
def test_an_unknown_observable_is_refused(name: str) -> None:
    message = rf"^name must be relative_velocity, phase or time; got '{name}'$"
    with pytest.raises(ValueError, match=message):
        orbit_of("chain of 3, 0.3").observable(name)


@pytest.mark.parametrize("times", [math.nan, [math.nan], [math.inf], 1.0, [[1.0]], "now"])
def test_times_that_are_no_times_are_refused(times: object) -> None:
    with pytest.raises(ValueError, match=r"^times.* must") as refused:
        orbit_of("chain of 3, 0.3").sample(times)
    assert "\n" not in str(refused.value)


def test_no_times_give_no_samples() -> None:
    position, velocity = orbit_of("chain of 3, 0.3").sample([])
    assert position.shape == velocity.shape == (0, 3)
