"""The default start is a state of every oscillator."""

from typing import Any

import numpy as np
import pytest

from dynkit import basins, parameter_map, sweep
from dynkit.systems import HardStop, ImpactChain, ImpactOscillator, MatrixOscillator
from tests.effort import is_thorough

EYE = np.eye(2)
BRIEF = {"transient": 20, "keep": 20, "progress": False}


def undecided(**options: object) -> MatrixOscillator:
    """Two equal modes: which of them is the first, and which has a node, rounding decides."""
    return MatrixOscillator(M=EYE, C=0.1 * EYE, K=EYE, frequency=0.9, **options)  # type: ignore[arg-type]


def test_a_plane_of_an_oscillator_with_a_node_at_the_contact_mass_has_motions() -> None:
    values = {"frequency": [0.8, 0.9], "amplitude": [0.1, 0.2]}
    found = parameter_map(undecided(), values, **BRIEF)  # type: ignore[arg-type]
    assert not np.isin(found.names, ["no motion", "refused"]).any()


def test_a_sweep_of_an_oscillator_with_a_node_at_the_contact_mass_begins() -> None:
    found = sweep(undecided(), "frequency", [0.8, 0.9], **BRIEF)  # type: ignore[arg-type]
    assert found.counts.tolist() == [20, 20]


def test_basins_say_why_no_start_is_a_state() -> None:
    with pytest.raises(ValueError, match=r"got none \(position\[1\] must not be below the table"):
        basins(undecided(), [[0.0, -5.0, 0.0, 0.0, 0.0]], **BRIEF)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", range(0, 400, 1 if is_thorough() else 16))
def test_the_default_start_is_at_rest_between_the_stops(number: int) -> None:
    random = np.random.default_rng(number)
    oscillator = _drawn(random)
    phase = float(random.choice([0.0, 0.5 * np.pi, np.pi, random.uniform(0.0, 6.0)]))
    state = oscillator.state(phase=phase)
    table = oscillator.amplitude * np.sin(phase) + oscillator.offset
    sign = 1.0 if oscillator.side == "above" else -1.0
    gap = sign * (state.position[oscillator.contact] - table)
    assert -1e-12 <= gap <= oscillator.play + 1e-12
    assert abs(state.velocity).max() <= 1e-12
    assert abs(state.position).max() < 1e9


def _drawn(random: np.random.Generator) -> MatrixOscillator:
    n = int(random.integers(1, 5))
    # diagonal, equal or coupled: modes with and without nodes
    stiffness = np.diag(random.choice([1.0, 2.0, 5.0], n))
    if random.random() < 0.4:
        coupling = random.integers(-1, 2, (n, n)).astype(float)
        stiffness = coupling @ coupling.T + np.eye(n)
    return MatrixOscillator(
        M=np.eye(n),
        C=0.1 * np.eye(n),
        K=stiffness,
        frequency=float(random.uniform(0.3, 3.0)),
        amplitude=float(random.choice([0.0, 0.1, 3.0])),
        offset=float(random.choice([0.0, 0.5, -0.5, 20.0, -20.0])),
        side=str(random.choice(["above", "below"])),
        contact=int(random.integers(0, n)),
        play=float(random.choice([np.inf, 0.01, 1.0, 5.0])),
    )


@pytest.mark.parametrize("clearance", [1e-3, 1e-5, 1e-6, 1e-7, 1e-9])
def test_a_start_lies_between_stops_however_near_they_are(clearance: float) -> None:
    stops = [HardStop(2), HardStop(2, offset=clearance, side="below")]
    for elements in (stops, stops[::-1]):
        place = ImpactChain(masses=3, frequency=0.9, elements=elements).state().position[2]
        assert 0.0 < place < clearance


class Tube(ImpactOscillator):
    """A tube in the hole of a baffle, a tenth as wide as the shape of the first mode is long."""

    degrees_of_freedom = 2

    def kinetic(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: Any) -> Any:
        return (x[0] ** 2 + 1.3 * x[1] ** 2) / 2

    def away(self, x: Any) -> Any:
        return x[0] ** 2 + x[1] ** 2


def test_the_default_start_is_within_a_narrow_hole() -> None:
    hole = HardStop("away", side="below", offset=0.01)
    state = Tube(frequency=1.1, harmonic_forces=[0.3, 0.2j], elements=[hole]).state()
    assert 0.0 < state.position @ state.position < 0.01
    assert not state.velocity.any()
