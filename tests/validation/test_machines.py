"""Random machines have the events that they have in 60 digits.

Here some of them; `python -m tests.validation` takes all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from dynkit.systems import HardStop
from tests.reference.random_machines import random_machine
from tests.validation.machines import compared, compared_machine, different
from tests.validation.quantities import MACHINES

SAMPLE = range(0, 10_000, MACHINES)


def test_no_event_is_another_one() -> None:
    assert different(MACHINES) == {}


def test_most_are_compared_to_the_end() -> None:
    found = [compared_machine(number) for number in SAMPLE]
    assert len(found) >= 20
    assert sum(not each.ended for each in found) >= 0.9 * len(found)
    assert sum(each.events for each in found) > 300


@pytest.mark.parametrize("number", [2, 4, 9, 17])
def test_a_stop_that_is_elsewhere_by_little_is_noticed(number: int) -> None:
    system, start = random_machine(number)
    assert not compared(system, start).wrong
    moved: list[Any] = []
    for element in system.elements:
        by = 1e-10 if isinstance(element, HardStop) else 0.0
        moved.append(replace(element, offset=element.offset + by))
    found = compared(system, start, truth=system.replace(elements=moved))
    exceeded = any(true > claimed for true, claimed in (*found.states, *found.times))
    assert found.wrong or exceeded


@pytest.mark.parametrize("number", [1522, 1643, 5801, 5828, 10085, 8100536, 8100896])
def test_machines_that_were_wrong_are_right(number: int) -> None:
    found = compared_machine(number)
    assert not found.wrong
    assert not found.ended
    assert all(true <= claimed for true, claimed in (*found.states, *found.times))
