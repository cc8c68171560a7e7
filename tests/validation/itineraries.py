"""Periodic orbits of random machines with elements against 60 digits.

An orbit is found from the attractor of a random machine. Its motion in many digits, from one of its
states, misses this state by F - y after a period: the state is off by (1 - F')^-1 (F - y), and by
the square of this, which is nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx

from dynkit import NoConvergence, periodic_orbit
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from tests.reference.machine_parts import Joint, Table
from tests.reference.machines import BITS, Machine
from tests.reference.random_machines import random_machine

MACHINES, MOST = 400, 6
TRANSIENT, KEPT = 4000, 40

SLIDING = (14, 22, 23, 28, 33, 54, 60, 62, 79, 94, 101, 115, 119)
"""Some of those with sliders, whose orbits are those of the map, that are found soonest."""

SETTLED = (34, 35, 48, 65, 77, 95, 105, 107, 112, 116, 121, 126, 144, 149, 155, 184, 188, 207, 214)
"""Machines that settle on an orbit, of which nothing holds or sticks where the section is."""


class Found(NamedTuple):
    """An orbit, its attractor, and the map's derivatives at its states."""

    orbit: Any
    attractor: Any
    derivatives: list[Array]

    def product(self, i: int) -> Array:
        """The derivative of a period from state number i on."""
        out = np.eye(len(self.derivatives[0]))
        for step in self.derivatives[i:] + self.derivatives[:i]:
            out = step @ out
        return out


@cache
def found(number: int) -> Found | None:
    """The orbit that a random machine settles on; None where there is none that is stable."""
    system, start = random_machine(number)
    if system._cycled:
        return None
    try:
        attractor = system.attractor(start=start, transient=TRANSIENT, impacts=KEPT)
        label = attractor.label
        if label.kind.value != "periodic" or not label.periods or "inf" in str(label):
            return None
        orbit: Any = attractor.periodic_orbit()
        if system._sliders:
            count = attractor.label.iterates or 1
            orbit = periodic_orbit(system, attractor.states[-count:])
        derivatives = [system.jacobian(state) for state in orbit.states]
    except (NotImplementedError, NoMotion, NoConvergence, ValueError):
        # friction that is refused, a motion that ends, an orbit that is not isolated or a chatter
        return None
    if isinstance(orbit, ImpactOrbit) and orbit.sticks:
        return None
    if not (isinstance(orbit, ImpactOrbit) or system._sliders):  # of impact laws
        return None
    return Found(orbit, attractor, derivatives)


def states_of_machines(
    every: int, numbers: Sequence[int] = range(MACHINES), *, sliding: bool = False
) -> Iterator[tuple[float, float]]:
    """Largest error of a section coordinate of an orbit, with or without sliders."""
    for number in numbers[::every]:
        if bool(random_machine(number)[0]._sliders) is sliding:
            yield from error_of(number)


def error_of(number: int) -> Iterator[tuple[float, float]]:
    """Actual and claimed error of the orbit of a machine, if it has one."""
    case = found(number)
    if case is None:
        return
    orbit = case.orbit
    rounding = 2.0**-53 * float(abs(orbit.states).max())
    for i in range(len(orbit.states[:MOST])):
        missed = missed_by(orbit, i, case.attractor.label.periods)
        if missed is not None:
            off = np.linalg.solve(np.eye(len(missed)) - case.product(i), missed)
            yield float(abs(off).max()), orbit.error + rounding


def missed_by(orbit: Any, i: int, periods: int) -> Array | None:
    """F - y for one of the states, in many digits; None where something holds or sticks there."""
    system, y = orbit.system, orbit.states[i]
    with ctx.workprec(BITS):
        machine = Machine(system)
        state = system.impact_state(y)
        sine, cosine = arb(float(y[-1])).sin_cos() if not system._strobed else (arb(0), arb(1))
        z = machine.start(state.position, state.velocity, state.sliders, 0.0, 1.0)
        z[machine.width - 3, 0], z[machine.width - 2, 0] = sine.mid(), cosine.mid()
        stop = None if system._strobed else state.element
        if stop is not None:
            _put_on(machine, z, system._others[stop], stop, arb(abs(float(y[-2]))))
        before = _coordinates(machine, z, system, stop)
        period = 2.0 * np.pi * periods / system.frequency
        events, ended = machine.motion(z, period + 1e-6, periods=stop is None)
        held = any(
            part.fixes(now) and not (isinstance(part, Table) and k == stop)
            for k, (part, now) in enumerate(zip(machine.parts, events[0].regimes, strict=True))
        )
        if ended or held or events[0].regimes[stop or 0 : (stop or -1) + 1] == (1,):
            return None
        ends = [e for e in events[1:] if (e.marked if stop is None else stop in e.hit)]
        end = min(ends, key=lambda e: abs(float(e.time) - period))
        after = _coordinates(machine, end.state, system, stop)
        return np.array([float(b - a) for a, b in zip(before, after, strict=True)])


def _put_on(machine: Machine, z: Any, kept: Any, stop: int, u: Any) -> None:
    """Put the coordinate that the section leaves out where the stop is; modified in place."""
    n, part = machine.size, machine.parts[stop]
    (left_out,) = set(range(n)) - set(np.asarray(kept).tolist())
    z[left_out, 0] = (z[left_out, 0] - part.gap_at(z) / part.gap[0, left_out]).mid()
    place = n + left_out
    z[place, 0] = (z[place, 0] + (u - part.rate_at(z)) / part.rate[0, place]).mid()


def _coordinates(machine: Machine, z: Any, system: Any, stop: int | None) -> list[Any]:
    """Section coordinates; their last one is exact in differences of phases below a turn."""
    n = machine.size
    sliders = [part.slider(z) for part in machine.parts if isinstance(part, Joint)]
    if stop is None:
        return [*(z[k, 0] for k in range(2 * n)), *sliders]
    kept = np.asarray(system._others[stop]).tolist()
    u = machine.parts[stop].rate_at(z)
    angle = arb.atan2(z[machine.width - 3, 0], z[machine.width - 2, 0]).mid()
    far = -1 if stop == 1 and system._faces else 1
    return [*(z[k, 0] for k in kept), *(z[n + k, 0] for k in kept), *sliders, far * u, angle]
