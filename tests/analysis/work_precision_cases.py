"""Small jobs with exact impacts, for the tests of error against run time."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from dynkit.analysis import ExactImpacts, ImpactMethod
from dynkit.analysis.work_precision.measurement import Comparison, compare
from dynkit.systems import ImpactChain, MatrixOscillator
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


def grazing(depth: float) -> ExactImpacts:
    """One undamped mass that swings from 1 to the table at rest, which is this deep in its way."""
    offset = -1.0 + depth
    hit = depth > 0.0
    at, speed = (math.acos(offset), math.sqrt(depth * (2.0 - depth))) if hit else (0.0, 0.0)
    system = ImpactChain(masses=1, damping=0.0, amplitude=0.0, offset=offset, frequency=1.07)
    return ExactImpacts(
        system=system,
        position=[1.0],
        velocity=[0.0],
        until=4.0,
        times=[at] if hit else [],
        positions=[[offset]] if hit else np.zeros((0, 1)),
        velocities=[[0.85 * speed]] if hit else np.zeros((0, 1)),
    )


def mirrored() -> tuple[ExactImpacts, ExactImpacts]:
    """Impacts above a table, and their mirror image below it."""
    above = exact_of(3, frequency=0.87)
    system = above.system.replace(side="below")
    below = ExactImpacts(
        system=system,
        position=-above.position,
        velocity=-above.velocity,
        phase=math.pi,
        until=above.until,
        times=above.times,
        positions=-above.positions,
        velocities=-above.velocities,
    )
    return above, below


def forced() -> ExactImpacts:
    """Impacts of two masses on which forces act, as dynkit has them."""
    system = MatrixOscillator(
        M=[[1, 0], [0, 2]], C=[[0.1, 0], [0, 0.3]], K=[[2, -1], [-1, 2]], frequency=1.1,
        harmonic_forces=[0.2 + 0.1j, 0.3], constant_forces=[0.0, -0.5], amplitude=0.05, contact=0,
    )  # fmt: skip
    record = system.simulate(impacts=6, start=system.state([0.6, 0.2]))
    return ExactImpacts(
        system=system,
        position=[0.6, 0.2],
        velocity=[0.0, 0.0],
        until=float(record.time[4:].mean()),
        times=record.time[:5],
        positions=record.position[:5],
        velocities=record.velocity[:5],
    )


def outcome(method: ImpactMethod, exact: ExactImpacts, tolerance: float) -> Comparison:
    return compare(method.prepare(exact, tolerance)(method.budget), exact)


def errors(method: ImpactMethod, exact: ExactImpacts, tolerances: list[float]) -> np.ndarray:
    outcomes = [outcome(method, exact, tolerance) for tolerance in tolerances]
    assert all(each.right for each in outcomes)
    return np.array([each.error for each in outcomes])


def order_of(tolerances: list[float], found: np.ndarray) -> float:
    return float(np.polyfit(np.log(tolerances), np.log(found), 1)[0])
