"""Random chains, and how far a record is from the same motion to 50 digits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mpmath
import numpy as np
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.records.record import ImpactRecord
from tests.reference.impact_chain import History, Impact, ReferenceChain


@dataclass(frozen=True)
class Case:
    """A chain and where it starts."""

    chain: ImpactChain
    position: Array
    velocity: Array

    def simulate(self, impacts: int) -> ImpactRecord:
        start = self.chain.state(self.position, self.velocity)
        return self.chain.simulate(impacts=impacts, start=start)


def random_case(seed: int, damping: float, restitution: float) -> Case:
    """A chain of 1 to 10 masses, unequal in half of the cases, that starts off the table."""
    random = np.random.default_rng(seed)
    n = int(random.choice([1, 2, 3] if damping > 2.0 else [1, 2, 3, 5, 10]))
    unequal = float(random.choice([0.0, 0.7]))
    amplitude = float(random.choice([0.1, 0.5, 1.0]))
    offset = float(random.choice([0.0, -0.3, 0.2]))
    position, velocity = 0.5 * random.normal(size=(2, n))
    position[-1] = offset + amplitude + 0.3 * abs(random.normal()) + 1e-3
    chain = ImpactChain(
        masses=tuple(np.exp(unequal * random.normal(size=n)).tolist()),
        springs=tuple(np.exp(unequal * random.normal(size=n)).tolist()),
        damping=damping,
        restitution=restitution,
        amplitude=amplitude,
        offset=offset,
        frequency=math.exp(random.uniform(math.log(0.15), math.log(6.0))),
    )
    return Case(chain, position, velocity)


def reference_of(chain: ImpactChain, *, stick_below: float = 1e-23) -> ReferenceChain:
    """The same chain to 50 digits; its dashpots must go with its springs."""
    assert isinstance(chain.damping, float)
    return ReferenceChain(
        chain.masses,
        chain.springs,
        damping=chain.damping,
        restitution=chain.restitution,
        amplitude=chain.amplitude,
        offset=chain.offset,
        frequency=chain.frequency,
        stick_below=stick_below,
    )


def state_error(state: Array, impact: Impact) -> float:
    """Largest error of section coordinates (2N,)."""
    exact = [*impact.position[:-1], *impact.velocity[:-1], impact.relative_velocity]
    with mp.workdps(60):
        parts = [float(mpf(x) - y) for x, y in zip(state[:-1].tolist(), exact, strict=True)]
        turn = mpf(float(state[-1])) - impact.phase
        parts.append(float(turn - 2 * mp.pi * mpmath.nint(turn / (2 * mp.pi))))
    return float(np.abs(parts).max())


def time_error(time: float, impact: Impact) -> float:
    with mp.workdps(60):
        return abs(float(mpf(float(time)) - impact.time))


def errors_before_contact(case: Case, impacts: int) -> tuple[ImpactRecord, Array]:
    """A record, and the errors (n, 2), of time and states, of its impacts before any contact.

    Within a chatter both have the same impacts up to where the record cuts it.
    """
    record = case.simulate(impacts)
    count = len(record)
    if len(record.sticking):
        count = int(np.searchsorted(record.time, record.sticking[0, 0], side="right"))
    history = History()
    if count:
        history = reference_of(case.chain).simulate(
            count, case.position.tolist(), case.velocity.tolist()
        )
    rows = [
        (time_error(record.time[i], history.impacts[i]), state_error(record.states[i], impact))
        for i, impact in enumerate(history.impacts)
    ]
    assert len(rows) == count
    return record, np.array(rows).reshape(-1, 2)
