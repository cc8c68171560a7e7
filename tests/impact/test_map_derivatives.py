"""Derivatives of the impact map where they are limits: low bounces, and friction that sticks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, MatrixOscillator

TABLE = HardStop(2, amplitude=0.1, restitution=0.7, name="table")
BELT = DryFriction(0, force=1.4, amplitude=0.05, phase=0.3, velocity=0.02)
JOINT = DryFriction((0, 1), force=1.2, amplitude=0.03, phase=-0.7)
SKEW = DryFriction((0.8, -0.5, 0.1), force=1.5, amplitude=0.05, phase=0.3)
COUPLED = np.array([[1.0, 0.3, 0.0], [0.3, 1.2, 0.2], [0.0, 0.2, 0.9]])


def test_derivatives_tend_to_a_limit_at_low_bounces() -> None:
    stop = HardStop((-0.3, 0.6, 1.1), offset=0.137, restitution=1.0, amplitude=0.1)
    chain = ImpactChain(
        masses=3, frequency=0.7, damping=0.1, constant_forces=(0.1, 0.0, -1.0), elements=[stop]
    )

    def jacobian(u: float) -> Array:
        return chain.jacobian(np.array([0.3, -0.2, 0.11, 0.4, u, 0.7]))

    limit = 2.0 * jacobian(1e-5) - jacobian(2e-5)  # of a derivative that is linear in small u
    for u in (1e-9, 1e-13, 1e-15, 3e-16, 1e-20):
        assert abs(jacobian(u) - limit).max() < 1e-7, u


def stuck_states(system: Any) -> list[Array]:
    """States after impacts, with velocities at which all friction sticks to its moving surface."""
    friction = system.elements[1:]
    record = system.replace(elements=[TABLE]).simulate(impacts=40)
    rows = np.array([element.row(3) for element in friction])
    found = []
    for i in range(20, 40):
        turned = np.exp(1j * record.phase[i])
        rates = [e.drift + system.frequency * (e.phasor * turned).real for e in friction]
        v, state = record.velocity[i], record.states[i].copy()
        state[2:4] += np.linalg.lstsq(rows[:, :2], rates - rows @ v)[0]
        run = system._run(system.impact_state(state), 1, store=True)
        lasts = np.flatnonzero(run.segments.begin == 0.0)[-1]
        regimes = run.regimes[run.segments.mode[lasts]]
        if len(system._automaton.parts.grips(regimes)[1]) == len(friction):
            found.append(state)
    return found[:4]


@pytest.mark.parametrize("friction", [[BELT], [JOINT], [SKEW], [BELT, JOINT], [SKEW, BELT]])
@pytest.mark.parametrize("coupled", [False, True])
def test_neighbours_of_what_sticks_slip_for_a_moment(
    friction: list[DryFriction], coupled: bool
) -> None:
    chain = ImpactChain(
        masses=3,
        damping=0.1,
        frequency=0.9,
        harmonic_forces=(0.0, 0.0, 0.3),
        elements=[TABLE, *friction],
    )
    system: Any = chain
    if coupled:
        system = MatrixOscillator(
            M=COUPLED,
            C=chain.damping_matrix,
            K=chain.stiffness,
            frequency=0.9,
            harmonic_forces=(0.0, 0.0, 0.3),
            elements=[TABLE, *friction],
        )
    states = stuck_states(system)
    assert states
    for state in states:
        found, step = system.jacobian(state), 1e-6
        for k, column in enumerate(found.T):
            moved = step * np.eye(len(state))[k]
            after, before = system(state + moved), system(state - moved)
            change = system.difference(after, before) / (2.0 * step)
            assert abs(change - column).max() < 1e-5 * max(1.0, abs(found).max()), k
