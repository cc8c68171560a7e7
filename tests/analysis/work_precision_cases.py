"""Small jobs with exact impacts, for the tests of error against run time."""

from __future__ import annotations

from functools import cache
from typing import Any

from dynkit.analysis import ExactImpacts
from dynkit.systems import ImpactChain
from tests.reference.impact_chain import ReferenceChain


def exact_of(impacts: int, masses: int = 2, **arguments: Any) -> ExactImpacts:
    """Impacts of a chain thrown down, to 50 digits; without chatter."""
    position, velocity = [0.5] * masses, [0.0] * (masses - 1) + [-0.3]
    found = ReferenceChain(masses, **arguments).simulate(impacts + 1, position, velocity).impacts
    kept = found[:impacts]
    return ExactImpacts(
        system=ImpactChain(masses=masses, **arguments),
        position=position,
        velocity=velocity,
        until=float((found[-2].time + found[-1].time) / 2),
        times=[str(p.time) for p in kept],
        positions=[list(map(str, p.position)) for p in kept],
        velocities=[list(map(str, p.velocity)) for p in kept],
    )


@cache
def bounces() -> ExactImpacts:
    """Five impacts of two masses, far from each other."""
    return exact_of(5, frequency=0.87)


@cache
def sticking() -> ExactImpacts:
    """Two masses that chatter, stick, are let go, and hit the table again."""
    chain = ReferenceChain(2, frequency=0.408, restitution=0.3)
    position, velocity = [0.4, 0.8], [0.0, 0.0]
    found = chain.simulate(75, position, velocity)
    begin, release = found.contacts[0]
    before = [p for p in found.impacts if p.time < begin - 0.2]
    after = [p for p in found.impacts if p.time > release][:2]
    kept = before + after
    following = next(p.time for p in found.impacts if p.time > after[-1].time)
    last = found.impacts[len(before)].time
    return ExactImpacts(
        system=ImpactChain(masses=2, frequency=0.408, restitution=0.3),
        position=position,
        velocity=velocity,
        until=float((after[-1].time + following) / 2),
        times=[str(p.time) for p in kept],
        positions=[list(map(str, p.position)) for p in kept],
        velocities=[list(map(str, p.velocity)) for p in kept],
        releases=[str(release)],
        chatters=[(float((before[-1].time + last) / 2), float(release))],
    )
