"""Random machines with elements of any kind: what holds for each of them."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

from hypothesis import assume, given, settings, strategies as st

from dynkit.core.no_motion import CannotFollow
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, Element, Jenkins
from tests.reference.random_machines import random_machine

NUMBERS = st.integers(0, 9_999)
FEW = settings(max_examples=12, deadline=None)


def of(number: int) -> tuple[Any, Any, Any]:
    """A machine with elements, a start, and the record from there, whose energies balance."""
    system, start = random_machine(number)
    assume(bool(system.elements))
    try:
        record = system.simulate(impacts=8, start=start)
    except CannotFollow:  # friction along what other friction holds
        assume(False)
    assume(len(record) and record.error[-1] < 1e-6)
    balance = record.energy_balance()
    size = 1.0 + sum(abs(work) for work in balance.work.values())
    assert balance.error < 1e-12 * size
    assert all(heat > -1e-12 * size for heat in balance.dissipated.values())
    return system, start, record


def agree(one: Any, other: Any, sign: float = 1.0) -> None:
    """Assert that motions are the same within their errors, or mirrored."""
    assert len(one) == len(other)
    within = one.error + other.error
    for name in ("position", "velocity", "sliders"):
        apart = abs(getattr(one, name) - sign * getattr(other, name)).max(axis=1, initial=0.0)
        # a stop's place and speed follow from the phase
        assert (apart <= 8.0 * within).all()


@FEW
@given(NUMBERS, st.randoms(use_true_random=False))
def test_energies_balance_and_the_order_of_elements_does_not_matter(
    number: int, random: Any
) -> None:
    system, start, record = of(number)
    order = list(range(len(system.elements)))
    random.shuffle(order)
    other = system.replace(elements=[system.elements[k] for k in order])
    sliding = [k for k, element in enumerate(system.elements) if element.slider]
    sliders = start.sliders[[sliding.index(k) for k in order if k in sliding]]
    begin = other.state(start.position, start.velocity, phase=start.phase, sliders=sliders)
    found = other.simulate(impacts=8, start=begin)
    back = [[k for k in order if k in sliding].index(k) for k in sliding]
    agree(record, _Sorted(found, found.sliders[:, back]))


class _Sorted:
    """A record with sliders in another order."""

    def __init__(self, record: Any, sliders: Array) -> None:
        self.position, self.velocity, self.error = record.position, record.velocity, record.error
        self.sliders = sliders

    def __len__(self) -> int:
        return len(self.position)


@FEW
@given(NUMBERS)
def test_energies_balance_and_a_mirrored_machine_moves_as_its_mirror(number: int) -> None:
    system, start, record = of(number)
    other = system.replace(
        elements=[mirrored(element) for element in system.elements],
        harmonic_forces=tuple(-force for force in system.harmonic_forces),
        constant_forces=tuple(-force for force in system.constant_forces),
    )
    begin = other.state(-start.position, -start.velocity, phase=start.phase, sliders=-start.sliders)
    agree(record, other.simulate(impacts=8, start=begin), sign=-1.0)


def mirrored(element: Element) -> Element:
    """The element on the other side of zero."""
    other = replace(element, side="below" if element.side == "above" else "above")
    other = replace(other, offset=-element.offset, phase=element.phase + pi)
    if isinstance(other, DryFriction | Jenkins):
        return replace(other, velocity=-other.velocity)
    return other
