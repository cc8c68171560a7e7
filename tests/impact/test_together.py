"""Kinds of elements beside one another: their map, its derivative, energies and orbits."""

import numpy as np
import pytest

from dynkit import periodic_orbit
from dynkit.core.differences import numerical_derivative
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactChain,
    Jenkins,
    PlasticBelow,
    SoftStop,
    ViscoelasticSpheres,
)

MACHINES = {
    "friction and sliders that nothing drives": ImpactChain(
        masses=2,
        damping=0.03,
        frequency=1.0,
        elements=[
            DryFriction(0, force=0.4, static=0.8, velocity=0.1, name="belt"),
            Jenkins((0, 1), stiffness=0.5, force=0.1, name="joint"),
            Jenkins(1, stiffness=0.3, force=0.05),
        ],
    ),
    "laws of two stops, and a preload": ImpactChain(
        masses=3,
        frequency=0.9,
        elements=[
            HardStop(2, amplitude=0.1, restitution=ViscoelasticSpheres(0.2), name="table"),
            HardStop((0, 1), offset=-0.05, restitution=PlasticBelow(0.01, rebound=0.5)),
            SoftStop(1, offset=0.02, stiffness=5.0, damping=0.2, preload=0.05, name="pad"),
        ],
    ),
    "a law, friction and a slider": ImpactChain(
        masses=2,
        frequency=0.8,
        harmonic_forces=[0.0, 0.3],
        elements=[
            HardStop(1, restitution=PlasticBelow(0.05, rebound=0.6), name="rock"),
            DryFriction(0, force=0.02, static=0.03, name="guide"),
            Jenkins((0, 1), stiffness=0.4, force=0.1, name="joint"),
        ],
    ),
}


@pytest.mark.parametrize("name", MACHINES)
def test_the_map_leads_from_each_state_of_a_record_to_the_next(name: str) -> None:
    machine = MACHINES[name]
    record = machine.simulate(impacts=60)
    states, within = record.states, record.error
    for k in range(40, 50):
        apart = abs(machine.difference(machine(states[k]), states[k + 1])).max()
        assert apart <= within[k + 1]


@pytest.mark.parametrize("name", MACHINES)
def test_derivatives_are_those_of_differences(name: str) -> None:
    # at states where a slider is about to slide they are one-sided: none of these is such
    machine = MACHINES[name]
    for state in machine.simulate(impacts=60).states[50:53]:
        expected, error = numerical_derivative(machine, state)
        assert (abs(machine.jacobian(state) - expected) <= 1e-9 + error).all()


@pytest.mark.parametrize("name", MACHINES)
def test_energy_balances_close(name: str) -> None:
    balance = MACHINES[name].simulate(impacts=60).energy_balance()
    assert balance.error < 1e-12 * (1.0 + sum(abs(work) for work in balance.work.values()))
    assert all(heat > -1e-12 for heat in balance.dissipated.values())


def test_an_orbit_with_a_preload_is_that_of_the_map() -> None:
    pad = SoftStop(0, stiffness=3.0, damping=0.2, preload=0.3, name="pad")
    machine = ImpactChain(
        masses=1, frequency=0.8, damping=0.1, harmonic_forces=[1.0], elements=[pad]
    )
    attractor = machine.attractor()
    own, of_map = attractor.periodic_orbit(), periodic_orbit(machine, attractor.states[-1:])
    assert abs(own.states - of_map.states).max() <= own.error + of_map.error
    assert np.sort_complex(own.multipliers) == pytest.approx(
        np.sort_complex(of_map.multipliers), abs=1e-9
    )


@pytest.mark.parametrize("transient", [1, 2])
def test_the_error_of_an_attractor_counts_modes_that_its_transient_did_not_enter(
    transient: int,
) -> None:
    machine = ImpactChain(
        masses=3,
        frequency=0.9,
        harmonic_forces=[0.4, 0.0, 0.0],
        elements=[
            HardStop(2, amplitude=0.1, restitution=0.4),
            DryFriction(0, force=0.1),
            Jenkins((0, 1), stiffness=2.0, force=0.2),
        ],
    )
    attractor = machine.attractor(transient=transient, keep=60)
    whole = machine.simulate(impacts=transient + 60)
    assert attractor.error == pytest.approx(whole.error.max(), rel=1.0)
