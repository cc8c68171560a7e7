"""Labels count what happens in a period by element."""

import math

import pytest

import dynkit
from dynkit.systems import (
    DryFriction,
    HardStop,
    Henon,
    ImpactChain,
    MatrixOscillator,
    PlayOscillator,
    SoftStop,
)


@pytest.mark.parametrize("frequency", [0.3, 0.87, 0.9])
def test_impacts_of_one_stop_are_those_of_the_label(frequency: float) -> None:
    label = ImpactChain(frequency=frequency).attractor().label
    assert label.iterates is not None
    assert label.counts == {"table.impacts": label.iterates, "table.contacts": 0}


def test_impacts_that_accumulate_are_infinite() -> None:
    label = ImpactChain(frequency=0.408).attractor().label
    assert str(label) == "P(inf,2)"
    assert label.counts == {"table.impacts": math.inf, "table.contacts": 1}


def test_stops_are_counted_each_and_add_up() -> None:
    pair = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5)
    label = pair.attractor().label
    found = label.counts or {}
    assert found["table.impacts"] + found["far_stop.impacts"] == label.iterates
    rough = [
        DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt"),
        HardStop((0, 1), offset=-0.2, restitution=0.5),
        SoftStop(1, offset=-0.3, stiffness=50.0, damping=0.2, name="pad"),
        HardStop(2, amplitude=0.1, restitution=0.85),
    ]
    label = ImpactChain(masses=3, frequency=0.9, elements=rough).attractor().label
    assert str(label) == "P(1,1)"
    assert label.counts == {
        "elements[1].impacts": 0,
        "elements[1].contacts": 0,
        "elements[3].impacts": 1,
        "elements[3].contacts": 0,
        "belt.sticks": 1,
        "pad.presses": 0,
    }


def test_contact_and_sticking_without_an_impact_that_is_left_out() -> None:
    # r = 0: each impact is followed by contact, in which friction rests, and by sticking.
    machine = MatrixOscillator(
        M=[[1.0]],
        C=[[0.1]],
        K=[[1.0]],
        frequency=0.3,
        harmonic_forces=[1.0],
        elements=[
            HardStop(0, offset=-0.1, restitution=0.0, name="wall"),
            DryFriction(0, force=0.1, static=0.15, name="ground"),
        ],
    )
    counts = machine.attractor().label.counts or {}
    assert counts["wall.impacts"] == counts["wall.contacts"] == 1
    assert counts["ground.sticks"] >= 1


def test_what_presses_without_stops_that_are_hit() -> None:
    bilinear = ImpactChain(
        masses=1,
        frequency=0.8,
        damping=0.05,
        harmonic_forces=[1.0],
        elements=[SoftStop(0, stiffness=3.0)],
    )
    assert bilinear.attractor().label.counts == {"elements[0].presses": 1}


def test_labels_of_planes_count_too_and_those_of_maps_do_not() -> None:
    plane = dynkit.parameter_map(
        ImpactChain(masses=1, frequency=2.7),
        {"frequency": [2.7, 2.8], "restitution": [0.8]},
        transient=300,
        keep=60,
        progress=False,
    )
    label = plane.label(0, 0)
    assert label.counts == {"table.impacts": label.iterates, "table.contacts": 0}
    assert Henon(a=0.3).attractor(start=[0.1, 0.1], transient=1000).label.counts is None
    assert ImpactChain(frequency=1.346).attractor().label.counts is None  # chaotic


def test_a_pad_that_is_a_dashpot_alone_is_pressed() -> None:
    pad = SoftStop(0, offset=-0.5, damping=0.4, stiffness=0.0, name="pad")
    block = ImpactChain(masses=1, frequency=1.0, harmonic_forces=[1.0], elements=[pad])
    assert block.attractor().label.counts == {"pad.presses": 1}
