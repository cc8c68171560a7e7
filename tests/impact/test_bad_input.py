"""Arguments that are refused, by name, limit and value; and extreme ones that are not."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynkit.core.no_motion import NoCrossing
from dynkit.sweeps import sweep
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.trajectory import Ending

NAN, INF = math.nan, math.inf

Chain = Callable[..., Any]


def make(**arguments: Any) -> ImpactChain:
    return ImpactChain(**{"frequency": 0.87, **arguments})


def start(**arguments: Any) -> Any:
    return make(masses=3).state(**arguments)


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: make(restitution=1.2), "restitution must lie in [0, 1]; got 1.2"),
    (lambda: make(restitution=-0.1), "restitution must lie in [0, 1]; got -0.1"),
    (lambda: make(restitution=NAN), "restitution must be a finite number; got nan"),
    (lambda: make(restitution=True), "restitution must be a finite number; got True"),
    (lambda: make(frequency=0), "frequency must be positive; got 0"),
    (lambda: make(frequency=-1.0), "frequency must be positive; got -1.0"),
    (lambda: make(frequency=INF), "frequency must be a finite number; got inf"),
    (lambda: make(frequency="a"), "frequency must be a finite number; got 'a'"),
    (lambda: make(frequency=None), "frequency must be a finite number; got None"),
    (lambda: make(amplitude=-0.1), "amplitude must not be negative; got -0.1"),
    (lambda: make(amplitude=NAN), "amplitude must be a finite number; got nan"),
    (lambda: make(offset=-INF), "offset must be a finite number; got -inf"),
    (lambda: make(chatter_tolerance=-1e-9), "chatter_tolerance must not be negative; got -1e-09"),
    (lambda: make(damping=-0.1), "damping must not be negative; got -0.1"),
    (lambda: make(damping=NAN), "damping must be a finite number; got nan"),
    (
        lambda: make(masses=2, damping=[0.1, -0.2]),
        "damping[1] must not be negative; got -0.2",
    ),
    (lambda: make(masses=2, damping=[0.1]), "damping must have shape (2,); got shape (1,)"),
    (lambda: make(masses=0), "masses must be a positive integer; got 0"),
    (lambda: make(masses=-3), "masses must be a positive integer; got -3"),
    (lambda: make(masses=2.5), "masses must be a positive integer; got 2.5"),
    (lambda: make(masses=True), "masses must be a positive integer; got True"),
    (lambda: make(masses=NAN), "masses must be a positive integer; got nan"),
    (lambda: make(masses=[1, 0]), "masses[1] must be positive; got 0.0"),
    (lambda: make(masses=[1, NAN]), "masses[1] must be a finite number; got nan"),
    (lambda: make(masses=[]), "masses must hold at least one number; got none"),
    (lambda: make(masses=2, springs=[1, 1, 1]), "springs must have shape (2,); got shape (3,)"),
    (lambda: make(springs=-1.0), "springs must not be negative; got -1.0"),
    (lambda: make(masses=2, springs=[1, -1]), "springs[1] must not be negative; got -1.0"),
    (lambda: make(springs="stiff"), "springs must be"),
    (lambda: make().replace(stiffness=1.0), "parameter must be one of: "),
    (lambda: make().replace(frequency=-2.0), "frequency must be positive; got -2.0"),
    (
        lambda: start(position=[0.0, 0.0, -0.1]),
        "position[2] must not be below the table at 0.0; got -0.1",
    ),
    (
        lambda: start(position=[0.0, 0.0, 0.0]),
        "velocity[2] must not be below the velocity 0.087",
    ),
    (lambda: start(position=[0, NAN, 1]), "position[1] must be a finite number; got nan"),
    (lambda: start(position=[0, 1]), "position must have shape (3,); got shape (2,)"),
    (lambda: start(velocity=[0, 0, INF]), "velocity[2] must be a finite number; got inf"),
    (lambda: start(velocity=0.0), "velocity must have shape (3,); got shape ()"),
    (lambda: start(velocity=["a", "b", "c"]), "velocity must be an array of real numbers"),
    (lambda: start(phase=NAN), "phase must be a finite number; got nan"),
    (lambda: start(position=[1.7e308] * 3), "positions and velocities must not overflow; got"),
    (
        lambda: make(offset=0.5).state(make().modal_matrix[:, 0]),
        "position[9] must not be below the table at 0.5; got",
    ),
    (lambda: make().simulate(impacts=0), "impacts must be a positive integer; got 0"),
    (lambda: make().simulate(impacts=-3), "impacts must be a positive integer; got -3"),
    (lambda: make().simulate(impacts=2.5), "impacts must be a positive integer; got 2.5"),  # type: ignore[arg-type]
    (lambda: make().simulate(impacts=1, start=7), "start must be an ImpactState; got 7"),  # type: ignore[arg-type]
    (lambda: make().attractor(transient=-1), "transient must be zero or a positive integer; got"),
    (lambda: make().attractor(impacts=0), "impacts must be a positive integer; got 0"),
    (lambda: make(damping=1e150).simulate(impacts=1), "damping rates must not exceed 1e+60; got"),
    (lambda: make(frequency=1e200).simulate(impacts=1), "must not exceed 1e+60; got 1e+200"),
    (lambda: make(masses=2)(np.array([0.0, 0.0, -0.1, 0.0])), "state[2] must not be negative"),
    (lambda: make(masses=2)(np.array([0.0, NAN, 0.1, 0.0])), "state[1] must be a finite number"),
    (lambda: make(masses=2)(np.zeros(3)), "state must have shape (4,); got shape (3,)"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_refusals_name_argument_limit_and_value(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


def test_a_refused_start_leaves_the_chain_as_it_was() -> None:
    chain = make(masses=3)
    before = chain.simulate(impacts=20).states.tobytes()
    with pytest.raises(ValueError, match="start must have 3 masses"):
        chain.simulate(impacts=20, start=make(masses=4).state())
    assert chain.simulate(impacts=20).states.tobytes() == before


@pytest.mark.parametrize("derived", [False, True])
def test_a_map_without_a_next_impact_says_why(*, derived: bool) -> None:
    chain = make(masses=1, offset=-3.0, amplitude=0.0)
    state = np.array([0.0, 1.0])
    with pytest.raises(NoCrossing, match="there is no next impact: no mass"):
        chain.jacobian(state) if derived else chain(state)


def ordered(record: ImpactRecord) -> bool:
    """Whether all numbers are finite, no time falls and no relative velocity is negative."""
    finite = bool(np.isfinite(record.states).all() and np.isfinite(record.time).all())
    return finite and bool(
        (np.diff(record.time) >= 0.0).all() and (record.relative_velocity >= 0).all()
    )


EXTREME: dict[str, dict[str, Any]] = {
    "restitution 1e-12": {"restitution": 1e-12},
    "restitution 1 - 1e-12": {"restitution": 1 - 1e-12},
    "damping 1e8": {"damping": 1e8},
    "damping 1e20": {"damping": 1e20},
    "one mass, damping 1e8": {"masses": 1, "damping": 1e8},
    "a hundred masses": {"masses": 100},
    "frequency 1e-6": {"frequency": 1e-6},
    "frequency 1e-100": {"frequency": 1e-100},
    "frequency 1e6": {"frequency": 1e6},
    "frequency 1e12": {"frequency": 1e12},
    "amplitude 1e-300": {"amplitude": 1e-300},
    "amplitude 0": {"amplitude": 0.0},
    "offset -1e6": {"offset": -1e6},
    "masses from 1e-12 to 1e12": {"masses": (1e-12, 1.0, 1e12)},
    "chatter tolerance 1": {"chatter_tolerance": 1.0, "frequency": 0.408},
    "chatter tolerance 1e-300": {"chatter_tolerance": 1e-300, "frequency": 0.408},
}


@pytest.mark.parametrize("arguments", EXTREME.values(), ids=EXTREME)
def test_extremes_end_with_finite_numbers_and_a_name(arguments: dict[str, Any]) -> None:
    record = make(**arguments).simulate(impacts=300)
    assert ordered(record)
    assert len(record) == 300 or record.ending is not Ending.COUNT_REACHED


def test_a_table_far_away_is_never_reached() -> None:
    assert make(offset=-1e6).simulate(impacts=5).ending is Ending.NO_FURTHER_CONTACT


def test_a_table_that_pushes_hard_is_hit_to_relative_rounding() -> None:
    chain = make(offset=1e6, amplitude=1e5)
    position = np.linspace(0.1, 1.0, 10) * 1e6
    position[-1] += 1.0
    record = chain.simulate(impacts=30, start=chain.state(position))
    table = chain.amplitude * np.sin(record.phase) + chain.offset
    assert record.position[:, -1] == pytest.approx(table, rel=1e-14)


@pytest.mark.parametrize("phase", [1e3, -1e3, 1e15, 1e300])
def test_a_phase_is_taken_modulo_two_pi(phase: float) -> None:
    state = make().state(phase=phase)
    assert 0.0 <= state.phase < 2.0 * math.pi
    assert math.sin(state.phase) == pytest.approx(math.sin(phase), abs=1e-15)


@dataclass(frozen=True, kw_only=True)
class Facing(ImpactChain):
    """A chain whose stop has its place from the class."""

    gap: float = 0.1

    def __post_init__(self) -> None:
        stop = HardStop(-1, offset=-self.gap, amplitude=0.1, restitution=0.8, name="table")
        object.__setattr__(self, "elements", (stop,))
        super().__post_init__()


def test_values_that_the_class_computes_are_not_ignored() -> None:
    chain = Facing(masses=2, frequency=0.9)
    message = r"table\.offset must be -0\.1, which Facing computes; got -0\.3"
    with pytest.raises(ValueError, match=message):
        chain.replace(**{"table.offset": -0.3})
    with pytest.raises(ValueError, match="which Facing computes"):
        sweep(chain, "table.offset", [-0.1, -0.3])
    assert chain.replace(gap=0.3).value_of("table.offset") == -0.3


@dataclass(frozen=True, kw_only=True)
class Shaken(ImpactChain):
    """A chain whose forces the class computes."""

    force: float = 0.1

    def __post_init__(self) -> None:
        object.__setattr__(self, "harmonic_forces", np.array([0.0, self.force]))
        super().__post_init__()


def test_forces_that_the_class_computes_are_not_ignored() -> None:
    chain = Shaken(masses=2, frequency=0.9)
    for given in ([0.0, 0.3], np.array([0.3, 0.0])):
        with pytest.raises(ValueError, match=r"harmonic_forces must be .*, which Shaken computes"):
            chain.replace(harmonic_forces=given)
    same = chain.replace(harmonic_forces=np.array([0.0, 0.1]))
    assert same.replace(force=0.3).harmonic_forces[1] == 0.3
    plain = ImpactChain(masses=2, frequency=0.9, harmonic_forces=[0.0, 0.1])
    assert plain.replace(harmonic_forces=[0.0, 0.3]).harmonic_forces[1] == 0.3
