"""What orbits and branches do not need anew is not made anew: counted."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import pytest

from dynkit import continue_curve, continue_orbit
from dynkit.core.no_motion import NoMotion
from dynkit.orbits.newton import NoConvergence
from dynkit.systems import BouncingBall, DryFriction, HardStop, ImpactChain, SoftStop
from dynkit.systems.impact.orbits import machine
from dynkit.systems.impact.orbits.itineraries import finding
from dynkit.systems.structure.lagrangian import share_derivation

Counted = Callable[[Any, str], list[Any]]


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    """A function that returns a list which grows with each call of another function."""

    def count(owner: Any, name: str) -> list[Any]:
        calls, plain = [], getattr(owner, name)

        def call(*given: Any, **options: Any) -> Any:
            calls.append(given)
            return plain(*given, **options)

        monkeypatch.setattr(owner, name, call)
        return calls

    return count


RUBBED = ImpactChain(
    masses=1,
    damping=0.1,
    frequency=1.3,
    harmonic_forces=[0.6],
    elements=[
        HardStop(0, offset=-0.2, restitution=0.6, name="table"),
        SoftStop(0, side="below", offset=0.2, stiffness=5.0, damping=0.3),
        DryFriction(0, force=0.05),
    ],
)


def test_a_search_makes_one_machine_and_looks_into_new_guesses_alone(counted: Counted) -> None:
    machines, grown = counted(machine, "numbers_of"), counted(finding, "_grows")
    found = RUBBED.find_orbits(impacts=2, periods=2)
    assert len(found)
    # what is tried beside the returns: motions from orbits of the stop alone, and without impacts
    assert len(grown) <= found.cost.counts["returns"] + 10
    assert len(machines) <= 10


@pytest.mark.parametrize("kind", [NoMotion, NoConvergence])
def test_guesses_without_a_linearization_are_not_tried(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise kind("no linearization")

    monkeypatch.setattr(finding, "_grows", refused)
    found = RUBBED.find_orbits(impacts=1, periods=1)
    assert len(found) == found.cost.counts["returns"] == 0


def test_an_oscillator_that_keeps_its_machine_shares_its_structure_and_travels_without() -> None:
    one, other = (ImpactChain(masses=3, frequency=0.9, springs=1.5) for _ in range(2))
    assert machine.machine_of(one) is machine.machine_of(one)
    assert share_derivation(one, other)
    assert "_kept" not in vars(pickle.loads(pickle.dumps(one)))


def test_a_parameter_that_changes_itself_alone_has_one_derivative(counted: Counted) -> None:
    ball = BouncingBall(amplitude=1.5, frequency=1.0, restitution=0.5)
    branch = continue_orbit(ball.periodic_orbit(), "amplitude", bounds=(1.0, 2.5))
    doubling = next(b for b in branch.bifurcations if b.kind == "PD")
    changes = counted(machine, "change_of")
    curve = continue_curve(
        doubling, ("amplitude", "restitution"), bounds=((1.0, 2.5), (0.3, 0.7)), points=20
    )
    assert len(curve) > 5
    assert len(changes) <= 2  # one for each of the parameters


def test_what_progresses_is_found_once_for_stops_that_act_along_the_same() -> None:
    ball = BouncingBall(amplitude=1.5, frequency=1.0, restitution=0.5)
    shift = ball._progression
    assert ball.replace(amplitude=1.2, restitution=0.4)._progression is shift
    chain = ImpactChain(masses=2, springs=(0.0, 1.0), frequency=0.9, contact=0)
    across = chain._progression
    assert chain.replace(offset=0.1)._progression is across
    assert chain.replace(contact=1)._progression is not across
    assert chain.replace(side="below")._progression is not across
