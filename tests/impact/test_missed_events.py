"""Events that heyoka does not report are found, or the motion ends with an error."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynkit.core.no_motion import CannotFollow
from dynkit.core.validation import Array
from dynkit.systems import (
    DryFriction,
    HardStop,
    ImpactDuffing,
    Jenkins,
    MatrixOscillator,
    SoftStop,
    TodaChain,
)
from dynkit.systems.impact.modes.taylor import chart as taylor_chart
from dynkit.systems.impact.modes.taylor.mode import TaylorMode, horner
from dynkit.systems.impact.simulation.taylor.position import ABOVE, Position
from dynkit.systems.impact.simulation.taylor.runs import TaylorCourse
from tests.impact.disguised import disguised

WALL = HardStop(0, side="below", offset=0.9, restitution=0.7)
TABLE = HardStop(0, offset=-0.2, amplitude=0.5, restitution=0.8)
FAST = HardStop((0, 1), offset=-0.4, restitution=0.6)

SYSTEMS = {
    "one stop": ImpactDuffing(frequency=1.0, elements=[TABLE]),
    "two walls": ImpactDuffing(frequency=1.0, elements=[TABLE, WALL]),
    "toda": TodaChain(masses=2, frequency=1.0, elements=[TABLE, FAST]),
    "friction": ImpactDuffing(
        frequency=1.0, elements=[TABLE, WALL, DryFriction(0, force=0.05, velocity=0.3)]
    ),
}


BEYOND = 1e-9
"""Time after an event at which a motion continues as if the event had not been reported."""


class Dropping:
    """An integrator that does not report some of its events."""

    def __init__(self, made: Any, events: tuple[int, ...], drops: list[int]) -> None:
        self.__dict__.update(made=made, events=events, drops=drops)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["made"], name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.made, name, value)

    def __copy__(self) -> Dropping:
        return Dropping(copy.copy(self.made), self.events, self.drops)

    def propagate_until(self, end: float, **limits: Any) -> Any:
        found = self.made.propagate_until(end, **limits)
        if -1 - int(found[0]) not in self.events or self.made.time < 0.02 or not self.drops[0]:
            return found
        if self.drops[1]:
            self.drops[1] -= 1
            return found
        self.drops[0] -= 1
        self.made.step(max_delta_t=0.0, write_tc=True)
        self.made.state[:] = horner(self.made.tc, np.array([BEYOND]))[0]
        self.made.time += BEYOND
        return self.made.propagate_until(end, **limits)


def dropping(patch: pytest.MonkeyPatch, most: int, after: int | None = None) -> list[int]:
    """Let all new integrators together drop this many impacts; return the number that is left.

    With `after`, they drop events of any kind, after as many that they report.
    """
    drops, build = [most, after or 0], taylor_chart._integrator

    def built(plan: Any) -> Any:
        events = plan.impacts if after is None else tuple(range(len(plan.guards)))
        return taylor_chart._Compiled(Dropping(build(plan).integrator, events, drops))

    patch.setattr(taylor_chart, "_integrator", built)
    return drops


def fresh(name: str) -> Any:
    """The system with charts of its own."""
    system = SYSTEMS[name]
    return system.replace(chatter_tolerance=system.chatter_tolerance * (1.0 + 1e-9))


@pytest.mark.parametrize("most", [1, 3])
@pytest.mark.parametrize("name", SYSTEMS)
def test_impacts_that_are_not_reported_are_found(
    name: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = SYSTEMS[name].simulate(impacts=10)
    drops = dropping(monkeypatch, most)
    record = fresh(name).simulate(impacts=10)
    assert drops[0] == 0
    assert (record.element == exact.element).all()
    assert record.time == pytest.approx(exact.time, abs=1e-9)


@pytest.mark.parametrize("name", ["one stop", "two walls"])
def test_an_impact_that_is_never_reported_is_named(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropping(monkeypatch, 1 << 20)
    with pytest.raises(CannotFollow, match="an event is missed"):
        fresh(name).simulate(impacts=10)


DRIVEN: dict[str, Any] = {
    "M": np.eye(2),
    "C": [[0.1, -0.05], [-0.05, 0.1]],
    "K": [[2.0, -1.0], [-1.0, 1.5]],
    "frequency": 1.0,
    "harmonic_forces": [0.8, 0.3],
}
SOFT = SoftStop(0, offset=-0.2, stiffness=5.0)
STIFF = SoftStop(1, offset=-0.2, stiffness=8.0)
FRICTION = DryFriction(0, force=0.2, name="rub")
CHANGES: dict[str, tuple[int, list[Any]]] = {
    "friction": (3, [FRICTION]),
    "belt": (3, [DryFriction(0, force=0.3, static=0.5, velocity=0.3)]),
    "friction between masses": (5, [DryFriction((0, 1), force=0.2, static=0.25)]),
    "two frictions": (3, [FRICTION, DryFriction(1, force=0.1, velocity=0.2)]),
    "friction and stop": (3, [HardStop(1, offset=-0.2, restitution=0.6), FRICTION]),
    "slider": (3, [Jenkins(0, stiffness=2.0, force=0.3)]),
    "soft stop": (2, [SOFT]),
    "soft stop with a dashpot": (3, [replace(SOFT, damping=0.8)]),
    "preloaded soft stop": (2, [replace(SOFT, damping=0.8, preload=0.2)]),
    "slider and soft stop": (3, [Jenkins((0, 1), stiffness=2.0, force=0.2), STIFF]),
}
"""Elements, and the number of an event after which a guard is negative at the end of a flight."""

PRESSED = DRIVEN | {"constant_forces": [0.0, -0.6]}
STOP = HardStop(1, offset=-0.1, restitution=0.0, name="stop")
FORCES: dict[str, tuple[int, list[Any]]] = {
    "sticking": (1, [FRICTION]),
    "sticking on a belt": (1, [DryFriction(0, force=0.3, static=0.5, velocity=0.3)]),
    "masses that stick together": (2, [DryFriction((0, 1), force=0.2, static=0.25)]),
    "contact force": (4, [STOP, DryFriction(0, coefficient=0.4, normal="stop")]),
}
"""The same for guards that contain forces, with constant forces."""


@pytest.mark.parametrize("name", [*CHANGES, *FORCES])
def test_changes_of_regimes_that_are_not_reported_are_found(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    after, elements = (CHANGES | FORCES)[name]
    machine = MatrixOscillator(**(DRIVEN if name in CHANGES else PRESSED), elements=elements)
    start = [0.3, 0.6], [0.2, 0.1]
    exact = machine.simulate(impacts=8, start=machine.state(*start))
    drops = dropping(monkeypatch, 1, after)
    other = disguised(machine.replace(chatter_tolerance=1.0001e-16))
    record = other.simulate(impacts=8, start=other.state(*start))
    assert drops[0] == 0
    assert len(record.events) == len(exact.events)
    assert record.position == pytest.approx(exact.position, abs=1e-9)


@pytest.mark.parametrize("name", FORCES)
def test_forces_are_computed_once_at_each_state(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = disguised(MatrixOscillator(**PRESSED, elements=FORCES[name][1]))
    states: list[tuple[int, bytes]] = []
    balance = TaylorMode.balance

    def counted(mode: TaylorMode, state: Array) -> Any:
        states.append((id(mode), state.tobytes()))
        return balance(mode, state)

    monkeypatch.setattr(TaylorMode, "balance", counted)
    machine.simulate(impacts=20, start=machine.state([0.3, 0.6], [0.2, 0.1]))
    assert len(states) == len(set(states)) > 20


def without_short_steps(patch: pytest.MonkeyPatch) -> None:
    """Begin flights as if no root could be hidden by a guard that is zero at the start."""
    patch.setattr(Position, "_above", lambda *_: ABOVE)
    patch.setattr(TaylorCourse, "_early", lambda *_: [])


SPRINGS = [[1.5, -0.75, 0.0], [-0.75, 1.5, -0.75], [0.0, -0.75, 0.75]]
RELEASED = MatrixOscillator(
    M=np.diag([1.75, 1.5, 1.25]),
    C=np.zeros((3, 3)),
    K=SPRINGS,
    frequency=0.9,
    constant_forces=[-0.75, -0.75, -0.375],
    elements=[HardStop(1, offset=-0.375, restitution=0.0)],
)
TWO_STOPS = MatrixOscillator(
    M=np.diag([1.0, 2.0]),
    C=np.zeros((2, 2)),
    K=[[2.0, -1.0], [-1.0, 2.0]],
    frequency=1.0,
    constant_forces=[-1.0, -1.0],
    elements=[HardStop(0, restitution=0.75), HardStop(1, restitution=0.75)],
)


@pytest.mark.parametrize("place", [0.27, 0.3, 0.33, 0.36, 0.39])
def test_impacts_soon_after_a_release_are_not_missed(
    place: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_short_steps(monkeypatch)
    records = [
        machine.simulate(impacts=6, start=machine.state([place, -0.375, 0.0], [0.0, 0.0, 0.0]))
        for machine in (RELEASED, disguised(RELEASED))
    ]
    assert records[1].time == pytest.approx(records[0].time, abs=1e-10)


@pytest.mark.parametrize("speeds", [(0.5, 0.05), (0.3, 0.01), (0.5, 0.25)])
def test_impacts_soon_after_a_start_on_two_stops_are_not_missed(
    speeds: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    without_short_steps(monkeypatch)
    records = [
        machine.simulate(impacts=6, start=machine.state([0.0, 0.0], speeds))
        for machine in (TWO_STOPS, disguised(TWO_STOPS))
    ]
    assert (records[1].element == records[0].element).all()
    assert records[1].time == pytest.approx(records[0].time, abs=1e-13)


def test_a_lifting_that_is_never_reported_is_named_within_long_flights(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    far, soft = HardStop(0, offset=-50.0), SoftStop(0, offset=-0.2, stiffness=5.0, preload=5.0)
    machine = MatrixOscillator(M=[[1.0]], C=[[0.3]], K=[[1.0]], frequency=1.0, elements=[far, soft])
    dropping(monkeypatch, 100, 1)
    other = disguised(machine)
    with pytest.raises(CannotFollow, match="an event is missed"):
        other.simulate(impacts=1, start=other.state([0.3], [-0.5]))


@pytest.mark.parametrize("preload", [0.0, 0.3])
@pytest.mark.parametrize("damping", [0.0, 1.4])
@pytest.mark.parametrize("row", [-1.2, -0.7])
def test_a_hard_stop_at_the_place_of_a_soft_one_turns_its_gap_at_once(
    row: float, damping: float, preload: float
) -> None:
    soft = SoftStop(0, stiffness=0.4, damping=damping, preload=preload)
    both = HardStop((row,), side="below", restitution=0.8), soft
    given: dict[str, Any] = {"M": [[1.0]], "C": [[0.1]], "K": [[1.0]], "harmonic_forces": [0.8]}
    machine = MatrixOscillator(**given, frequency=1.2, elements=both)
    other = disguised(machine)
    exact, found = (
        each.simulate(impacts=8, start=each.state([0.5], [-0.6])) for each in (machine, other)
    )
    assert found.time == pytest.approx(exact.time, abs=1e-10)


@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_a_dip_that_begins_and_ends_within_one_step_is_an_impact(depth: float) -> None:
    """Without forces x = cos t, which reaches -(1 - depth) at pi - 2 asin(sqrt(depth/2))."""
    place = 1.0 - depth
    free = ImpactDuffing(frequency=0.01, damping=0.0, cubic=1e-300, amplitude=0.0, offset=-place)
    record = free.simulate(impacts=1, start=free.state([1.0], [0.0]))
    low = 1.0 - place
    exact = math.pi - 2.0 * math.asin(math.sqrt(low / 2.0))
    assert record.time == pytest.approx([exact], abs=1e-14 / math.sqrt(low))
