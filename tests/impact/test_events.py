"""All events of a record in their order: impacts, contacts, releases."""

import pickle

import numpy as np
import pytest

from dynkit.systems import BouncingBall, ImpactChain, ImpactOscillator, PlayOscillator
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.records.record import ImpactRecord

SYSTEMS: dict[str, ImpactOscillator] = {
    "chatter": ImpactChain(masses=3, frequency=0.408),
    "plastic": ImpactChain(masses=2, frequency=0.5, restitution=0.0),
    "two stops": PlayOscillator(
        frequency=1.3, restitution=0.0, play=0.5, amplitude=0.3, spring=0.2
    ),
    "one mass": ImpactChain(masses=1, frequency=0.35, restitution=0.3),
    "no contact": ImpactChain(masses=2, frequency=0.87),
    "lies for ever": BouncingBall(amplitude=0.0, frequency=1.0, restitution=0.5),
}


@pytest.fixture(params=SYSTEMS, scope="module")
def record(request: pytest.FixtureRequest) -> ImpactRecord:
    return SYSTEMS[request.param].simulate(impacts=200)


def test_they_are_those_of_the_record(record: ImpactRecord) -> None:
    events = record.events
    impact, contact = events.kind == EventKind.IMPACT, events.kind == EventKind.CONTACT
    released = events.kind == EventKind.RELEASE
    assert (np.diff(events.time) >= 0.0).all()
    assert (events.time[impact] == record.time).all()
    assert (events.time[contact] == record.sticking[:, 0]).all()
    ended = record.sticking[np.isfinite(record.sticking[:, 1]), 1]
    assert (events.time[released] == ended).all()
    assert len(events) == len(record) + len(record.sticking) + len(ended)
    size = max(1.0, abs(record.position).max())
    assert abs(events.position[impact] - record.position).max() < 1e-14 * size
    assert abs(events.velocity[impact] - record.velocity).max() < 1e-14 * size
    assert (np.signbit(record.relative_velocity) == (events.element[impact] == 1)).all()


def test_the_mode_tells_what_is_held(record: ImpactRecord) -> None:
    events, system = record.events, record.system
    held = events.mode > 0
    assert (held == (events.kind == EventKind.CONTACT)).all()
    offsets = np.array([stop.offset for stop in system._stops])
    phase = record.start.phase + system.frequency * events.time[held]
    table = system.amplitude * np.sin(phase) + offsets[events.element[held]]
    assert abs(events.position[held, system.contact] - table).max(initial=0.0) < 1e-12


def test_they_are_the_same_after_the_record_was_pickled(record: ImpactRecord) -> None:
    # the modes are numbered by the motion, and another process enters none of them
    other = pickle.loads(pickle.dumps(record)).events
    for name in ("time", "kind", "element", "mode", "position", "velocity"):
        assert (getattr(other, name) == getattr(record.events, name)).all()
    assert repr(other) == repr(record.events)
