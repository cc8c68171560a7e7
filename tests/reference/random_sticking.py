"""Random orbits that stick, and their releases to 25 digits, kept in `random_sticking.npz`.

python -m tests.reference.random_sticking

The release of an orbit that dynkit finds is followed over one period to 50 digits. How far it then
is from itself, through the inverse of (1 - monodromy), is how far the release is from the exact
one; the square of that, 1e-26 or less, is left out.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
from mpmath import mp, mpf

from dynkit.systems.impact.matrices import MatrixOscillator
from dynkit.systems.impact.sticking.orbit import StickingOrbit
from tests.impact_orbits.sticking_cases import Releases, exact_of, releases_of
from tests.reference.random_cases import Kept, at_most, few, grid, network

FILE: Final = Path(__file__).with_name("random_sticking.npz")
CASES: Final = 2600
SECONDS: Final = 3
BEFORE: Final = 1e-12
"""Phase, more than rounding: the reference starts where there is still contact."""

CUT: Final = "1e-9"
"""Part of the fastest approach below which 50 digits stick: wrong by about its square."""


def random_sticking(number: int) -> MatrixOscillator:
    """The oscillator of this number: 1 to 3 masses, slow tables, much of it lost in impacts."""
    random = Random(10_000 + number)
    n = random.choice((1, 2, 2, 3))
    links = [(i, i - 1 if i else n) for i in range(n)]
    springs = [grid(random.uniform(0.5, 2.0)) for _ in links]
    size = grid(math.pow(10.0, random.uniform(-2.0, 0.0)))
    even = random.random() < 0.5
    dashpots = [size * (k if even else grid(random.random())) for k in springs]
    forced = random.random() < 0.3
    forces = [complex(*(few(random.uniform(-0.1, 0.1)) for _ in range(2))) for _ in range(n)]
    return MatrixOscillator(
        M=[[grid(random.uniform(0.5, 2.0)) if i == j else 0.0 for j in range(n)] for i in range(n)],
        C=network(links, dashpots, n),
        K=network(links, springs, n),
        frequency=few(random.uniform(0.1, 0.7)),
        restitution=random.choice(
            (0.0, few(random.uniform(0.0, 0.7)), few(random.uniform(0.0, 0.5)))
        ),
        amplitude=0.1,
        offset=few(random.uniform(-0.05, 0.1)),
        contact=random.randrange(n),
        side=random.choice(("above", "below")),
        harmonic_forces=forces if forced else (),
    )


def sticking_orbit(number: int) -> StickingOrbit | None:
    """The orbit that the default start settles on, if it is one that sticks."""
    from dynkit.continuation.newton import NoConvergence

    try:
        found = random_sticking(number).attractor(transient=500, impacts=200).periodic_orbit()
    except (ValueError, NoConvergence):
        return None
    return found if isinstance(found, StickingOrbit) else None


def exact_release(orbit: StickingOrbit) -> list[Any]:
    """Places and phase, not wrapped, of the orbit's first release."""
    releases, places, phase = releases_of(orbit)
    r = orbit.system.restitution
    chatter = 3 if r == 0.0 else math.ceil(21.0 / -math.log(r)) + 3
    impacts = len(orbit.observable("time")) + chatter * len(orbit.phases)
    x, v = releases.whole(earlier(releases, places, phase), phase - BEFORE)
    oscillator = exact_of(orbit.system, CUT)
    history = oscillator.simulate(
        x.tolist(), v.tolist(), phase - BEFORE, impacts, relative_velocity=0
    )
    with mp.workdps(60):
        frequency = mpf(orbit.system.frequency)
        turn = 2 * mp.pi * orbit.periods
        ends = [contact.release for contact in history.contacts]
        time = min(ends, key=lambda t: abs(t * frequency - turn))
        found = oscillator.state_at(history, time)
        end = [part[i] for part in found for i in releases.others]
        back = np.array([float(a - mpf(b)) for a, b in zip(end, places.tolist(), strict=True)])
        late = float(mpf(phase - BEFORE) + time * frequency - turn - mpf(phase))
        matrix, phases = _around(orbit, places, phase)
        off = np.linalg.solve(np.eye(len(back)) - matrix, back) if len(back) else back
        # the phase follows the places of the release before
        turned = late + float(phases @ off)
        exact = [mpf(a) + mpf(b) for a, b in zip(places.tolist(), off.tolist(), strict=True)]
        return [*exact, mpf(phase) + mpf(turned)]


def earlier(releases: Releases, places: Any, phase: float) -> Any:
    """The places that become these in contact, a little later: the square of that is left out."""
    s, others = releases.system, releases.others
    x, v = releases.whole(places, phase)
    force = -(s.damping_matrix @ v + s.stiffness @ x)
    if len(s.harmonic_forces):
        force += (np.asarray(s.harmonic_forces) * np.exp(1j * phase)).imag
    rates = np.concatenate([v[others], (force / np.diag(s.mass))[others]])
    return places - BEFORE / s.frequency * rates


def _around(orbit: StickingOrbit, places: Any, phase: float) -> tuple[Any, Any]:
    """Derivatives of places and phase at the next release but by those at this one."""
    from tests.impact_orbits.sticking_cases import simulated

    releases, _, _ = releases_of(orbit)
    step = 1e-5
    columns, phases = [], []
    for k in range(len(places)):
        ends = []
        for sign in (1.0, -1.0):
            there = places.copy()
            there[k] += sign * step
            ends.append(simulated(releases, there, releases.phase(there, phase), orbit.periods))
        columns.append((ends[0][0] - ends[1][0]) / (2.0 * step))
        phases.append((ends[0][1] - ends[1][1]) / (2.0 * step))
    d = len(places)
    return np.array(columns).T.reshape(d, d), np.array(phases)


def kept(numbers: Iterator[int]) -> Kept:
    """Of the cases that settle on an orbit that sticks, and are decided in time."""
    rows = []
    for number in numbers:
        orbit = sticking_orbit(number)
        if orbit is None:
            continue
        try:
            with at_most(SECONDS):
                rows.append((number, orbit.periods, 0, exact_release(orbit)))
        except (ArithmeticError, AssertionError, TimeoutError) as failure:
            sys.stderr.write(f"{number}: {failure!r}\n")
    return Kept.of(rows)


if __name__ == "__main__":
    kept(iter(range(CASES))).save(FILE)
