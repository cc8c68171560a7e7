"""Random orbits that stick, exact to 25 digits, kept in `random_sticking.npz`.

python -m tests.reference.random_sticking

Releases and multipliers of the orbits that dynkit finds, by Newton's method on the map between
releases; and that these are motions of the oscillator is seen by following each for a period to 50
digits, with nothing that dynkit knows of their impacts.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
from flint import ctx
from mpmath import mp, mpf

from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from tests.impact_orbits.exact_sticking import BITS, ExactSticking
from tests.impact_orbits.sticking_cases import Releases, exact_of, releases_of
from tests.reference.random_cases import Kept, at_most, few, grid, network

FILE: Final = Path(__file__).with_name("random_sticking.npz")
CASES: Final = 2600
SECONDS: Final = 3
BEFORE: Final = 1e-12
"""Phase, more than rounding: the motion is followed from where there is still contact."""

CUT: Final = "1e-9"
"""Part of the fastest approach below which 50 digits stick: wrong by about its square."""

SAME: Final = 1e-9
"""A motion that comes back so near to where it began is the orbit."""


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


def sticking_orbit(number: int) -> ImpactOrbit | None:
    """The orbit that the default start settles on, if it is one that sticks."""
    from dynkit.orbits.newton import NoConvergence

    try:
        found = random_sticking(number).attractor(transient=500, impacts=200).periodic_orbit()
    except (ValueError, NoConvergence):
        return None
    return found if isinstance(found, ImpactOrbit) and found.sticks else None


def exact(orbit: ImpactOrbit) -> list[Any]:
    """Places and phase, not wrapped, of each release; parts of the multipliers that are not zero.

    Raises
    ------
    ArithmeticError
        When there is no such orbit, or it is no motion.
    """
    found = ExactSticking(orbit)
    if not comes_back(orbit):
        raise ArithmeticError("the motion from the release does not come back")
    with ctx.workprec(BITS):
        numbers = [x for release in found.releases for x in release]
        numbers += [part for z in found.multipliers for part in (z.real, z.imag)]
        return [mpf(x.mid().str(60, radius=False)) for x in numbers]


def comes_back(orbit: ImpactOrbit) -> bool:
    """Whether the motion from the first release is released there a period later."""
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
        off = [float(a - mpf(b)) for a, b in zip(end, places.tolist(), strict=True)]
        late = float(time * frequency - turn)
        return max(map(abs, [*off, late])) < SAME


def earlier(releases: Releases, places: Any, phase: float) -> Any:
    """The places that become these in contact, a little later: the square of that is left out."""
    s, others = releases.system, releases.others
    x, v = releases.whole(places, phase)
    force = -(s.damping_matrix @ v + s.stiffness @ x)
    if len(s.harmonic_forces):
        force += (np.asarray(s.harmonic_forces) * np.exp(1j * phase)).imag
    rates = np.concatenate([v[others], (force / np.diag(s.mass))[others]])
    return places - BEFORE / s.frequency * rates


def kept(numbers: Iterator[int]) -> Kept:
    """Of the cases that settle on an orbit that sticks, and are decided in time."""
    rows = []
    for number in numbers:
        orbit = sticking_orbit(number)
        if orbit is None:
            continue
        try:
            with at_most(SECONDS):
                rows.append((number, orbit.periods, 0, exact(orbit)))
        except (ArithmeticError, AssertionError, TimeoutError) as failure:
            sys.stderr.write(f"{number}: {failure!r}\n")
    return Kept.of(rows)


if __name__ == "__main__":
    kept(iter(range(CASES))).save(FILE)
