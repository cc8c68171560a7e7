"""Motions of machines against the same in 60 digits."""

from __future__ import annotations

from typing import Any

from dynkit.core.validation import Array
from tests.validation.machines import Comparison, compared


def moves_as_in_many_digits(
    machine: Any, position: Array, velocity: Array, *, impacts: int, most: float
) -> Comparison:
    """Assert that events are the same, and states and times within errors; states within `most`."""
    found = compared(machine, machine.state(position, velocity), impacts=impacts)
    assert not found.wrong
    assert found.states
    assert all(actual <= claimed for actual, claimed in (*found.states, *found.times))
    assert max(actual for actual, _ in found.states) < most
    return found
