"""Bars of long computations: on a terminal, after a while, and gone at the end."""

import io
import sys

import pytest

from dynkit import basins, continue_orbit, find_orbits, periodic_orbit
from dynkit.core import progress
from dynkit.systems import Henon, ImpactChain, SingleImpactOscillator, SoftStop
from dynkit.systems.impact.orbits import searching
from dynkit.systems.impact.orbits.itineraries.motions import Effort


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stderr", "quiet", "shown"),
    [(Terminal(), 1e-9, True), (Terminal(), 1e9, False), (io.StringIO(), 1e-9, False)],
)
def test_branches_and_searches_show_how_far_they_are(
    stderr: io.StringIO, quiet: float, shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "_QUIET", quiet)
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(progress, "_OFTEN", 0.0)
    monkeypatch.setattr(searching, "FEW", Effort(parts=1, impacts=20, starts=2))
    orbit = periodic_orbit(Henon(a=0.2), [0.8, 0.2])
    continue_orbit(orbit, "a", bounds=(0.1, 0.3))
    find_orbits(Henon(), 1, [(-2.0, 2.0), (-1.0, 1.0)], calls=300)
    SingleImpactOscillator(frequency=2.2).find_orbits(impacts=1, periods=2)
    pressed = SoftStop(0, stiffness=5.0, offset=0.5, side="below")
    ImpactChain(masses=1, frequency=1.2, harmonic_forces=[1.0], elements=[pressed]).find_orbits(
        impacts=1, periods=1
    )
    lines = stderr.getvalue().split("\r")
    for found, bars in (("a 0.1", 1), ("a 0.3", 1), ("search", 3), ("search: 1 step", 2)):
        count = sum(found in line for line in lines)
        assert count >= bars if shown else not count
    assert not lines[-1].strip()


@pytest.mark.parametrize("asked", [True, False])
def test_the_comparison_of_chaotic_starts_shows_how_far_it_is(
    asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    stderr = Terminal()
    monkeypatch.setattr(progress, "_QUIET", 1e-9)
    monkeypatch.setattr(progress, "_OFTEN", 0.0)
    monkeypatch.setattr(sys, "stderr", stderr)
    basins(Henon(), [(0.0, 0.0), (0.1, 0.1)], transient=100, progress=asked)
    assert ("comparison" in stderr.getvalue()) == asked
