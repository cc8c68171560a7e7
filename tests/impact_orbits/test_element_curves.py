"""Curves of bifurcations in two parameters, of machines with elements: closed forms, branches."""

from functools import cache
from typing import Any

import numpy as np

from dynkit import continue_curve, continue_orbit
from dynkit.continuation.curves import BifurcationCurve
from dynkit.core.validation import Array
from dynkit.systems import DryFriction, HardStop, ImpactChain, SoftStop

FORCED: Any = {"masses": 1, "harmonic_forces": [1.0]}
STOPS = ImpactChain(
    frequency=0.7,
    damping=0.1,
    elements=[
        HardStop(0, offset=-5.0, restitution=0.5, name="near"),
        HardStop(0, side="below", offset=6.0, restitution=0.5, name="far"),
    ],
    **FORCED,
)
PAD = ImpactChain(
    frequency=0.7,
    damping=0.1,
    elements=[SoftStop(0, offset=-1.5, stiffness=3.0, damping=0.2, name="pad")],
    **FORCED,
)
RUB = ImpactChain(
    frequency=0.8, damping=0.0, elements=[DryFriction(0, force=0.75, name="rub")], **FORCED
)


def is_within(curve: BifurcationCurve, wanted: Array, slope: Array) -> bool:
    """Whether the first parameter is as wanted of the second one, within the curve's error."""
    first, second = np.ptp(curve.parameters, axis=0)
    allowed = curve.error * (first + abs(slope) * second)
    return bool((abs(curve.parameters[:, 0] - wanted) <= allowed).all())


def amplitude(frequency: Array) -> Array:
    """Of the harmonic response."""
    return np.asarray(1.0 / abs(1.0 - frequency**2 + 0.1j * frequency))


def of_response(name: str, start: Any, *, kind: str) -> BifurcationCurve:
    branch = continue_orbit(start, name, bounds=(-3.0, -1.0))
    (grazing, *_) = (b for b in branch.bifurcations if b.kind == kind)
    return continue_curve(
        grazing, (name, "frequency"), bounds=((-3.0, -1.0), (0.5, 0.9)), step=0.05, largest_step=0.2
    )


def test_a_response_touches_a_hard_stop_where_its_amplitude_is_the_gap() -> None:
    start = STOPS.replace(**{"near.offset": -2.9})
    orbit = start.periodic_orbit(start=start.state([0.0], [0.0]))
    curve = of_response("near.offset", orbit, kind="GR")
    w = curve.parameters[:, 1]
    slope = (amplitude(w + 1e-6) - amplitude(w - 1e-6)) / 2e-6
    assert len(curve) > 5
    assert is_within(curve, -amplitude(w), slope)
    assert curve.error.max() < 1e-9


@cache
def pressed() -> Any:
    return PAD.attractor().periodic_orbit()


def test_a_response_touches_a_soft_stop_where_its_amplitude_is_the_gap() -> None:
    curve = of_response("pad.offset", pressed(), kind="GR")
    w = curve.parameters[:, 1]
    slope = (amplitude(w + 1e-6) - amplitude(w - 1e-6)) / 2e-6
    assert len(curve) > 5
    assert is_within(curve, -amplitude(w), slope)
    assert curve.error.max() < 1e-9


def test_a_curve_of_period_doublings_at_a_soft_stop_is_closed_and_meets_branches() -> None:
    curve = of_response("pad.offset", pressed(), kind="PD")
    assert curve.closed
    assert curve.admissible.all()
    k = int(np.argmin(abs(curve.parameters[:, 1] - 0.72)))
    offset, frequency = curve.parameters[k].tolist()
    there = PAD.replace(frequency=frequency).attractor(transient=2000).periodic_orbit()
    branch = continue_orbit(there, "pad.offset", bounds=(-3.0, -1.0))
    apart = [abs(b.value - offset) for b in branch.bifurcations if b.kind == "PD"]
    assert min(apart) < 1e-9


def test_stick_begins_where_den_hartog_says() -> None:
    # at a turn the mass sticks where b^2 k x0 = f, b = w / w_n: x0 = F/k sqrt(V^2 - (G f/F)^2)
    orbit = RUB.attractor(transient=400).periodic_orbit()
    branch = continue_orbit(orbit, "rub.force", bounds=(0.75, 0.83))
    (border, *_) = (b for b in branch.bifurcations if "crossing-sliding" in b.touching)
    curve = continue_curve(
        border,
        ("rub.force", "frequency"),
        bounds=((0.75, 0.83), (0.77, 0.85)),
        step=0.1,
        largest_step=0.3,
    )

    def limit(b: Array) -> Array:
        v, g = 1.0 / (1.0 - b * b), np.tan(0.5 * np.pi / b) / b
        return np.asarray(b * b * v / np.sqrt(1.0 + b**4 * g * g))

    w = curve.parameters[:, 1]
    assert len(curve) > 5
    assert is_within(curve, limit(w), (limit(w + 1e-6) - limit(w - 1e-6)) / 2e-6)
    assert curve.error.max() < 1e-9


def test_a_curve_of_grazing_just_at_an_impact_on_another_stop() -> None:
    stops = [
        HardStop(1, offset=-0.002, restitution=0.478, name="first"),
        HardStop(0, offset=-0.107, restitution=0.512, name="second"),
    ]
    machine = ImpactChain(
        masses=2, damping=0.144, frequency=0.5542, harmonic_forces=[0.0, 0.753], elements=stops
    )
    orbit = machine.attractor(transient=400, impacts=60).periodic_orbit()
    branch = continue_orbit(orbit, "frequency", bounds=(0.55, 0.56), points=30)
    (touch,) = branch.bifurcations
    bounds = ((0.44336, 0.66504), (0.4096, 0.6144))
    curve = continue_curve(touch, ("frequency", "second.restitution"), bounds=bounds, points=4)
    (again,) = (
        found
        for found in continue_orbit(
            curve.orbit(0), "frequency", bounds=tuple(curve.parameters[0, 0] + [-2e-3, 2e-3])
        ).bifurcations
        if found.kind == "GR"
    )
    assert abs(again.value - curve.parameters[0, 0]) < 1e-10
