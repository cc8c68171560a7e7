"""Motions of machines against the same in 60 digits."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.validation import Array
from tests.validation.machines import Comparison, compared


def moves_as_in_many_digits(
    machine: Any, position: Array, velocity: Array, *, impacts: int, most: float
) -> Comparison:
    """Assert that events are the same, and states and times within errors; states within `most`."""
    start = machine.state(position, velocity)
    found = compared(machine, start, impacts=impacts)
    assert not found.wrong
    assert found.states
    assert all(actual <= claimed for actual, claimed in (*found.states, *found.times))
    assert max(actual for actual, _ in found.states) < most
    record = machine.simulate(impacts=len(found.states), start=start)
    x, v = record.sample(record.time)
    assert abs(np.concatenate([x - record.position, v - record.velocity])).max() < most
    return found
