"""Where orbits that stick come to an end (CB), to 30 digits."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from dynkit import Bifurcation, NoConvergence
from dynkit.orbits.solving import solve
from dynkit.systems.impact.orbits.borders import Border, VanishingAcceleration
from dynkit.systems.impact.orbits.itineraries.borders import (
    ChatterEnd,
    FlatRelease,
    TouchingGuard,
)
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.impact_orbits.exact_orbits import Ball, size
from tests.impact_orbits.exact_sticking import BITS, StickingMap, jacobian, parts_of, root

HALVINGS = 12
"""Of the interval in which a chatter that only just completes is looked for."""

WIDTH = 4.0
"""The size of its half, in errors that are claimed."""


def watched(found: Bifurcation) -> Border:
    """What is zero there."""
    problem, p = found.problem, np.array([found.value])
    border: Border = problem.border(found.event, found.unknowns, p)  # type: ignore[attr-defined]
    return border


def border(found: Bifurcation) -> Ball:
    """The exact value of the parameter.

    Raises
    ------
    ArithmeticError
        When there is no such border nearby.
    """
    orbit = found.orbit
    assert isinstance(orbit, ImpactOrbit)
    assert orbit.sticks
    w = watched(found)
    with ctx.workprec(BITS):
        if isinstance(w, ChatterEnd) and orbit.system.restitution > 0.0:
            return _of_chatter(found, orbit)
        parts = parts_of(orbit.problem(), orbit.unknowns)
        y = [arb(x) for places, phases in parts for x in [*places.tolist(), float(phases[0])]]
        own = [arb(x) for x in found.own.tolist()]
        y = [*y, *own, arb(found.value)]
        return root(partial(_left, orbit, found.parameter, w), y)[0][-1]


def _left(orbit: ImpactOrbit, name: str, w: Border, y: list[Ball]) -> list[Ball]:
    """What is left of the equations of places and phases at the releases, and at a border.

    With phases of the releases, at which the force is zero, as unknowns: at a border it need not
    cross zero.
    """
    there = StickingMap(orbit, **{name: y[-1]})
    width, count = len(orbit.states[0]) - 1, len(there.passages)
    begins = [y[k * width : (k + 1) * width] for k in range(count)]
    turn = 2 * arb.pi() * orbit.periods
    accelerates = isinstance(w, VanishingAcceleration)
    part = w.part if accelerates else orbit.problem().course.node_before(w.part)
    out: list[Ball] = []
    for k, (*places, phase) in enumerate(begins):
        *next_places, next_phase = begins[(k + 1) % count]
        next_phase = next_phase + turn if k == count - 1 else next_phase
        contact = there.contacts[there.passages[k].start]
        begun = contact.state(places, phase)
        held = there.held(k, places, phase)
        frequency = held.contact.frequency
        ended = held.contact.after(held.state, (next_phase - held.phase) / frequency)
        out += [a - b for a, b in zip(held.contact.places(ended), next_places, strict=True)]
        out.append(contact.force(begun))
        if k != part:
            continue
        if isinstance(w, FlatRelease):
            out.append(contact.force(begun, 1))
        elif isinstance(w, ChatterEnd):
            out.append(held.contact.force(held.state))
        elif isinstance(w, VanishingAcceleration):
            number = w.number - sum(len(q.sides) for q in there.passages[:k])
            out.append(there.bend(held.after[number], there.passages[k].sides[number]))
        elif isinstance(w, TouchingGuard):
            lowest = held.contact.after(held.state, (y[-2] - held.phase) / frequency)
            out += [held.contact.force(lowest, order) for order in range(2)]
    return out


def _of_chatter(found: Bifurcation, orbit: ImpactOrbit) -> Ball:
    """Where a chatter only just completes, between values at which it does and does not.

    The interval is halved until it is a five hundredth of the error that is claimed.
    """
    reach, name = WIDTH * found.error, found.parameter
    for sign in (1.0, -1.0):
        # two places where it does tell how the orbit moves
        try:
            far, inside = (found.value + sign * k * reach for k in (2.0, 1.0))
            begun = _near(found, far)
            inverse = _inverse(orbit, name, arb(far), begun)
            before = _settled(orbit, name, arb(far), begun, inverse)
            places = _settled(orbit, name, arb(inside), _near(found, inside), inverse)
        except (ArithmeticError, NoConvergence):
            continue
        slope = [(a - b) / (inside - far) for a, b in zip(places, before, strict=True)]
        value, outside = arb(inside), arb(found.value - sign * reach)
        for _ in range(HALVINGS):
            middle = (value + outside) / 2
            there = [a + b * (middle - value) for a, b in zip(places, slope, strict=True)]
            try:
                places = _settled(orbit, name, middle, there, inverse)
            except ArithmeticError:
                outside = middle
            else:
                value = middle
        return ((value + outside) / 2).mid()
    raise ArithmeticError("the chatter completes on neither side")


def _near(found: Bifurcation, value: float) -> list[Ball]:
    """Places at the first release of the orbit that dynkit finds at a value nearby."""
    guess = found.unknowns + found.tangent[:-1] * ((value - found.value) / found.tangent[-1])
    x, _ = solve(found.problem, guess, np.array([value]))
    return [arb(z) for z in parts_of(found.problem, x)[0][0].tolist()]  # type: ignore[arg-type]


def _returned(there: StickingMap, places: list[Ball]) -> list[Ball]:
    return [b - a for a, b in zip(places, there.around(places)[-1], strict=True)]


def _inverse(orbit: ImpactOrbit, name: str, value: Ball, places: list[Ball]) -> Any:
    if not places:
        return None
    there = StickingMap(orbit, **{name: value})
    return jacobian(partial(_returned, there), places).inv().mid()


def _settled(
    orbit: ImpactOrbit, name: str, value: Ball, places: list[Ball], inverse: Any
) -> list[Ball]:
    """Places at the first release of the orbit at another value, whose chatter completes."""
    there = StickingMap(orbit, **{name: value})
    for _ in range(30):
        left = _returned(there, places)
        if not places:
            return places
        step = (inverse * arb_mat([[x] for x in left])).entries()
        places = [(a - b).mid() for a, b in zip(places, step, strict=True)]
        if size(step) < 1e-24:
            return places
    raise ArithmeticError("there is no orbit near")
