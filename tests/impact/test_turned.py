"""Sweeps over frequency: modes at another frequency, and the kernel of a table alone."""

from typing import Any

import numpy as np
import pytest

from dynkit.systems import HardStop, ImpactChain, PlayOscillator
from dynkit.systems.impact.simulation.automaton import Automaton
from dynkit.systems.impact.simulation.runs import trajectory_of

FREQUENCIES = (0.35, 0.352, 0.87, 3.0, 40.0, 0.01)

WEIGHTS = (0.0, -0.02, 0.01)

SYSTEMS: dict[str, Any] = {
    "table": ImpactChain(masses=10, frequency=0.9),
    "undamped": ImpactChain(masses=3, frequency=0.9, damping=0.0),
    "weights": ImpactChain(masses=3, frequency=0.9, constant_forces=WEIGHTS),
    "forces": ImpactChain(masses=3, frequency=0.9, harmonic_forces=(0.1, 0.2j, 0.0)),
    "fixed stop": ImpactChain(
        masses=3, frequency=0.9, amplitude=0.0, harmonic_forces=(0.1, 0.2j, 0.0)
    ),
    "play": PlayOscillator(frequency=0.9),
}


def numbers(tables: Any) -> list[tuple[str, bytes]]:
    """Shape and every bit of the tables of the kernels."""
    flat = [*tables.ladders, *tables[1:]]
    return [(str(np.shape(part)), np.asarray(part).tobytes()) for part in flat]


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_turned_automaton_has_the_bits_of_a_new_one(name: str) -> None:
    system = SYSTEMS[name]
    system.simulate(impacts=30)  # enters more modes than the first
    for frequency in FREQUENCIES:
        turned = system.replace(frequency=frequency)._automaton.shared
        new = Automaton(
            turned._structure,
            turned._excitation,
            turned._elements,
            turned._tolerance,
            turned.parts,
        )
        assert turned._excitation.frequency == frequency
        assert numbers(turned.tables) == numbers(new.tables)
        for number in range(len(turned._elements)):
            for own in (turned, new):
                own.enter(number)
        assert len(turned.modes) == len(new.modes) > 1
        assert numbers(turned.tables) == numbers(new.tables)
        assert np.array_equal(turned.table, new.table)


@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
@pytest.mark.parametrize("noise", [0.0, 1e-15])
def test_the_kernel_of_a_table_alone_has_the_bits_of_that_of_all_elements(
    frequency: float, noise: float
) -> None:
    chain = ImpactChain(frequency=frequency)
    assert chain._automaton.beside is None
    start = chain.default_start
    runs = [trajectory_of(chain, start, 400, store=True, noise=noise)]
    chain._automaton.shared.beside = 0
    try:
        chain._automaton.__dict__.pop("beside", None)
        runs.append(trajectory_of(chain, start, 400, store=True, noise=noise))
    finally:
        chain._automaton.shared.beside = None
    small, whole = runs
    for one, other in (
        *zip(vars(small.log).values(), vars(whole.log).values(), strict=True),
        *zip(vars(small.switches).values(), vars(whole.switches).values(), strict=True),
    ):
        assert one.tobytes() == other.tobytes()
    assert small.cells == whole.cells
    assert small.ending is whole.ending
    assert len(small.switches.time) > 0 or frequency != 0.408


@pytest.mark.plain
def test_a_replaced_oscillator_takes_only_what_is_the_same() -> None:
    one = ImpactChain(masses=3, frequency=0.9)
    _ = one.simulate(impacts=3)
    changes: list[dict[str, Any]] = [
        {"frequency": 0.8}, {"restitution": 0.5}, {"amplitude": 0.2}, {"side": "below"},
        {"play": 3.0}, {"springs": 2.0}, {"damping": (0.1, 0.2, 0.3)}, {"masses": 2},
        {"harmonic_forces": (0.0, 0.1, 0.0)}, {"elements": [HardStop(1)]},
    ]  # fmt: skip
    for change in changes:
        new = one.replace(**change)
        given = {"masses": 3, "frequency": 0.9, **change}
        made = ImpactChain(**given)
        assert new == made
        assert new._stops == made._stops
        assert new._structure is made._structure
        assert [c.row.tolist() for c in new._contacts] == [c.row.tolist() for c in made._contacts]
        assert new._soft == made._soft
        assert ("_stops" in vars(one.replace(**change))) == (
            change.keys() <= {"frequency", "harmonic_forces"}
        )
