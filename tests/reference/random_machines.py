"""Random machines: 1 to 6 masses with up to 5 elements of any kind."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.no_motion import Refused
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    MatrixOscillator,
    PlasticBelow,
    SoftStop,
    ViscoelasticSpheres,
    iwan,
)

MACHINES = 10_000


def random_machine(number: int) -> tuple[Any, Any]:
    """The machine of this number, and a state to start from."""
    for attempt in range(20):
        random = np.random.default_rng([number, attempt])
        system = _system(random)
        try:
            return system, _start(system, random)
        except Refused:  # its stops leave no room
            continue
    raise RuntimeError(f"machine {number} has no room")


def _system(random: np.random.Generator) -> Any:
    n = int(random.integers(1, 7))
    elements = [e for _ in range(int(random.integers(0, 6))) for e in _element(random, n)][:5]
    given: dict[str, Any] = {"frequency": random.uniform(0.3, 1.8)}
    if random.random() < 0.85:
        given["harmonic_forces"] = 0.6 * (random.normal(size=n) + 1j * random.normal(size=n))
    if random.random() < 0.7:
        given["constant_forces"] = 0.4 * random.normal(size=n)
    if elements:
        given["elements"] = [elements[k] for k in random.permutation(len(elements))]
    else:
        given["restitution"] = random.uniform(0.0, 0.9)
    if random.random() < 0.5:
        masses = tuple(random.uniform(0.5, 2.0, n).tolist())
        return ImpactChain(masses=masses, damping=float(random.choice([0.0, 0.05, 0.2])), **given)
    matrices = [np.asarray(_semidefinite(random, n)) for _ in range(3)]
    return MatrixOscillator(
        M=np.diag(random.uniform(0.5, 1.5, n)) + 0.3 * matrices[0],
        C=random.choice([0.0, 0.1, 0.5]) * matrices[1],
        K=np.diag(random.uniform(0.2, 2.0, n)) + matrices[2],
        **given,
    )


def _semidefinite(random: np.random.Generator, n: int) -> Any:
    factor = random.normal(size=(n, n)) / n**0.5
    return factor @ factor.T


def _row(random: np.random.Generator, n: int) -> Any:
    kind = random.random()
    if n > 1 and kind < 0.3:
        return tuple(random.permutation(n)[:2].tolist())
    if kind < 0.5:
        return tuple(random.normal(size=n).tolist())
    return int(random.integers(n))


def _element(random: np.random.Generator, n: int) -> list[Any]:
    motion: dict[str, Any] = {"side": str(random.choice(["above", "below"]))}
    if random.random() < 0.6:
        motion["offset"] = 0.3 * random.normal()
    if random.random() < 0.5:
        motion["amplitude"] = random.uniform(0.02, 0.4)
        motion["phase"] = random.choice([0.0, random.uniform(-3.0, 3.0)])
    along, kind = _row(random, n), random.random()
    if kind < 0.35:
        return [HardStop(along, restitution=_restitution(random), **motion)]
    if kind < 0.6:
        damping = random.choice([0.0, 10.0 ** random.uniform(-2.0, 0.5)])
        return [
            SoftStop(
                along,
                stiffness=10.0 ** random.uniform(-0.5, 1.7),
                damping=damping,
                preload=random.choice([0.0, 0.0, random.uniform(0.0, 0.5)]),
                **motion,
            )
        ]
    force = random.uniform(0.02, 0.5)
    belt = random.choice([0.0, random.uniform(-0.4, 0.4)])
    if kind < 0.8:
        return [
            DryFriction(
                along,
                force=force,
                static=random.choice([1.0, 1.5]) * force,
                velocity=belt,
                slope=random.choice([0.0, random.uniform(0.0, 0.2)]),
                **motion,
            )
        ]
    stiffness = random.uniform(0.3, 5.0)
    if kind < 0.93:
        return [Jenkins(along, stiffness=stiffness, force=force, velocity=belt, **motion)]
    count = int(random.integers(2, 4))
    return iwan(along, stiffness=stiffness, force=force, elements=count, velocity=belt, **motion)


def _restitution(random: np.random.Generator) -> Any:
    kind = random.random()
    if kind < 0.1:
        return PlasticBelow(random.uniform(0.01, 0.1), rebound=random.uniform(0.3, 0.9))
    if kind < 0.2:
        return ViscoelasticSpheres(random.uniform(0.05, 0.4))
    return float(random.choice([0.0, 1.0, *random.uniform(0.2, 0.9, 6)]))


def _start(system: Any, random: np.random.Generator) -> Any:
    """Near the default start, if the stops allow that."""
    n, phase = system.degrees_of_freedom, random.choice([0.0, random.uniform(0.0, 6.0)])
    plain = system.state(phase=phase)
    moved = plain.position + 0.5 * random.normal(size=n)
    velocity = random.normal(size=n)
    for position in (moved, plain.position):
        try:
            return system.state(position, velocity, phase=phase)
        except Refused:
            continue
    return plain
