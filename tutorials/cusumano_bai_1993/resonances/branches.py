"""The two resonances of figure 6 as branches of orbits that stick."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynkit import continue_orbit
from dynkit.systems import ImpactAttractor, ImpactChain, ImpactOrbit
from tutorials.cusumano_bai_1993.arrays import Array

if TYPE_CHECKING:
    from dynkit import Bifurcation, Branch, OrbitLabel, Sweep

# Branches are sought so far on both sides of the paper's peaks, relative.
_REACH = 0.06
# Impacts that are simulated before a motion is on its orbit; and of a period, at most.
_SETTLED, _MOST = 2000, 500
# How far beyond the ends the chain is looked at, and after how many impacts; how many are kept.
_BEYOND = (1e-5, 1e-4, 1e-3)
_LONG, _KEPT = 20_000, 200


class Measures(NamedTuple):
    """What one orbit does in a period.

    Parameters
    ----------
    energy : float
        The largest energy just after an impact.
    flight : float
        From the release to the first impact.
    chatter : float
        From there until the chatter is complete.
    contact : float
        From there to the next release.
    """

    energy: float
    flight: float
    chatter: float
    contact: float


class Beside(NamedTuple):
    """The motion beyond an end of a branch."""

    frequency: float
    label: OrbitLabel
    energy: float
    contacts: int


def measures(orbit: ImpactOrbit) -> Measures:
    """Return what an orbit that sticks once in its period does, simulated from its release.

    At the end of a branch its chatter may not complete in simulation, and has no contact then. At a
    release the force is zero but for rounding: the contact may go on there for a moment.
    """
    system = orbit.system
    record = system.simulate(impacts=_MOST, start=system.impact_state(orbit.states[0]))
    begins = ends = orbit.period
    contacts = record.sticking[record.sticking[:, 0] >= record.time[0]]
    if len(contacts) and contacts[0, 0] < orbit.period:
        begins, ends = contacts[0].tolist()
    before = int(np.searchsorted(record.time, begins))
    energy, first = float(record.energy[:before].max()), float(record.time[0])
    return Measures(energy, first, begins - first, ends - begins)


def energy_error(orbit: ImpactOrbit) -> float:
    """Return what the error of an orbit makes of the energy just after its impacts, at most.

    To first order, from the energies and their derivatives by positions and velocities.
    """
    system = orbit.system
    record = system.simulate(impacts=_MOST, start=system.impact_state(orbit.states[0]))
    slopes = abs(record.position @ system.stiffness).sum(axis=1) + abs(record.velocity).sum(axis=1)
    return float(slopes.max()) * orbit.error


@dataclass(frozen=True)
class Ridge:
    """A resonance: a branch of orbits that stick, in frequency.

    Parameters
    ----------
    peak : float
        The frequency that the paper gives.
    branch : Branch
        Its frequency only rises or falls, between two borders.
    """

    peak: float
    branch: Branch

    @cached_property
    def orbits(self) -> list[ImpactOrbit]:
        """Those of the branch between those at its ends, from the lowest frequency on."""
        order = np.argsort(self.branch.parameter).tolist()
        low, high = (border.orbit for border in self.ends)
        inner = [self.branch.orbit(place) for place in order]
        return [orbit for orbit in (low, *inner, high) if orbit.sticks]

    @cached_property
    def measures(self) -> list[Measures]:
        """Those of the orbits."""
        return [measures(orbit) for orbit in self.orbits]

    @property
    def frequencies(self) -> Array:
        """Of the table, on the orbits."""
        return np.array([orbit.system.frequency for orbit in self.orbits])

    @property
    def periods(self) -> int:
        """Table periods in a period of the orbits."""
        return self.orbits[0].periods

    @property
    def sticks(self) -> int:
        """Sticking events in a period of the orbit with the largest energy."""
        orbit = self.orbits[int(self.energies.argmax())]
        return len(orbit.phases)

    @property
    def energies(self) -> Array:
        """The largest energies just after impact."""
        return np.array([each.energy for each in self.measures])

    @property
    def contacts(self) -> Array:
        """Shares of the period in contact after a chatter that is complete."""
        lasts = np.array([each.contact for each in self.measures])
        return lasts * self.frequencies / (2.0 * np.pi * self.periods)

    @cached_property
    def top(self) -> tuple[float, float]:
        """Frequency of the largest energy, and its error.

        Of a cubic spline through the points, and how far the top of that through every other point
        is from it.
        """
        fine, coarse = (self._top(step) for step in (1, 2))
        return fine, abs(fine - coarse)

    def _top(self, step: int) -> float:
        from scipy.interpolate import CubicSpline

        kept = sorted({*range(0, len(self.orbits), step), len(self.orbits) - 1})
        x = self.frequencies[kept]
        grid = np.linspace(x[0], x[-1], 20_001)
        return float(grid[CubicSpline(x, self.energies[kept])(grid).argmax()])

    @cached_property
    def error(self) -> float:
        """Of the largest energy on the orbit that has it."""
        return energy_error(self.orbits[int(self.energies.argmax())])

    def energy_at(self, frequency: float) -> float:
        """Return the largest energy after impact on the branch, from the spline."""
        from scipy.interpolate import CubicSpline

        return float(CubicSpline(self.frequencies, self.energies)(frequency))

    @property
    def highest(self) -> Measures:
        """At the point with the largest energy."""
        return self.measures[int(self.energies.argmax())]

    @cached_property
    def ends(self) -> list[Bifurcation]:
        """The two borders, the lower frequency first."""
        return sorted(
            (found for found in self.branch.bifurcations if found.kind == "CB"),
            key=lambda border: border.value,
        )

    @property
    def moduli(self) -> Array:
        """The largest modulus of a multiplier at each point of the branch."""
        return np.asarray(abs(self.branch.multipliers[:, 0]))

    @cached_property
    def beside(self) -> list[Beside]:
        """The settled motions beyond both ends, started on the orbit at the end."""
        found = []
        for orbit, sign in ((self.orbits[0], -1.0), (self.orbits[-1], 1.0)):
            for distance in _BEYOND:
                frequency = orbit.system.frequency + sign * distance
                chain = orbit.system.replace(frequency=frequency)
                start = chain.impact_state(orbit.states[0])
                motion = chain.attractor(transient=_LONG, impacts=_KEPT, start=start)
                energy = float(motion.record.energy.max())
                contacts = len(motion.record.sticking)
                found.append(Beside(frequency, motion.label, energy, contacts))
        return found


def contacts_of(sweep: Sweep, place: int) -> Array:
    """Return begin and end (k, 2) of the contacts of a sweep's motion."""
    attractor = sweep.attractor(place)
    assert isinstance(attractor, ImpactAttractor)
    return attractor.record.sticking


def settled_energy(sweep: Sweep, place: int) -> float:
    """Return the largest energy after impacts of a sweep's motion after very many impacts."""
    attractor = sweep.attractor(place)
    assert isinstance(attractor, ImpactAttractor)
    later = attractor.system.attractor(transient=_LONG, impacts=_KEPT, start=attractor.final)
    return float(later.record.energy.max())


def ridge(chain: ImpactChain, peak: float) -> Ridge:
    """Return the branch of the orbit that the chain settles on at one of the paper's peaks."""
    motion = chain.replace(frequency=peak).attractor(transient=_SETTLED)
    bounds = (1.0 - _REACH) * peak, (1.0 + _REACH) * peak
    branch = continue_orbit(motion.periodic_orbit(), "frequency", bounds=bounds)
    return Ridge(peak, branch)
