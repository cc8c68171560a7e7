"""Impact oscillators: linear structures of which one coordinate hits a table or a stop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynkit.core.validation import (
    boolean,
    non_negative_integer,
    positive_integer,
    within_memory,
)
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import (
    ImpactState,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.search import OrbitSearch
    from dynkit.systems.impact.orbits.orbit import ImpactOrbit

TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, kw_only=True)
class ImpactOscillator(ImpactMap):
    """The map from just after one impact with a table to just after the next.

    A subclass owes its energies, as every `LagrangianStructure` does. Its motion is
    M x'' + C x' + K x = g + Im(F exp(i phase)), phase' = frequency. One coordinate x_c is free to
    hit the table at x_T = amplitude sin(phase) + offset and stays on one side of it: gap
    x_c - x_T >= 0 above it, x_T - x_c >= 0 below. An impact turns the rate u- of the gap into
    -restitution u- by an impulse on this coordinate. `elements` are other stops, and more of them.

    As a `Map` its states are the 2N section coordinates: the positions but for x_c, the velocities
    but for v_c, the relative velocity u (the rate of the gap) just after the impact, and the phase.

    Parameters
    ----------
    frequency : float
        Angular frequency of the table and of the forces, positive.
    restitution : float
        Coefficient of restitution in [0, 1].
    amplitude : float
        Amplitude of the table, not negative. A stop at rest has amplitude 0.
    offset : float
        Middle of the table's motion.
    contact : int
        Which coordinate hits the table; the last one by default.
    side : {"above", "below"}
        On which side of the table it stays.
    play : float
        Positive distance to a second stop, which faces the first and moves with it. By default
        infinite: there is none. Relative velocities after impacts with it count negative.
    harmonic_forces : (N,) array_like of complex, optional
        F, amplitudes of forces on the coordinates. A real F_j is the force F_j sin(phase).
    constant_forces : (N,) array_like of float, optional
        g, forces on the coordinates, such as weights.
    chatter_tolerance : float
        Chatter is replaced by contact when that changes no position or velocity by more than this;
        0 for never. That holds to leading order, and the place of the contact mass in the bounces
        left out changes by no more than a thousand times this. The changes made, as contact begins,
        are summed up in the record's ``chatter_error``.
    elements : sequence of Element, optional
        What acts in place of the table: any number of `HardStop`, `SoftStop`, `DryFriction` and
        `Jenkins`, each on a coordinate, between two, or along any row. Then restitution, amplitude,
        offset, contact, side and play are not given, and the numbers of elements are parameters,
        such as ``"elements[1].stiffness"``. The section leaves out the coordinate with the largest
        part in the row, of a pair (i, j) the second one. With several hard stops its last one is
        the phase plus 4 pi times the number of the stop that is hit. Without a hard stop the map
        is that over a period of the forcing, from phase 0: its states are positions and velocities,
        and what is said of impacts is then said of these moments. Sliders of `Jenkins` elements
        are coordinates after the velocities.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, equations 8 to 12 and
    15.
    """

    @property
    def observables(self) -> Sequence[str]:
        """What a sweep can keep of every impact: names of arrays of the record.

        With several stops ``element`` is one of them; without any the coordinates, ``state[0]``.
        """
        if self._strobed:
            return super().observables
        own = "relative_velocity", "phase", "energy", "time"
        return (*own, "element") if self._several else own

    # --- simulation -------------------------------------------------------------------------------

    def simulate(self, *, impacts: int, start: ImpactState | None = None) -> ImpactRecord:
        """Simulate until so many impacts have happened, or none can happen any more.

        Parameters
        ----------
        impacts : int
            How many impacts to record.
        start : ImpactState, optional
            From `state` or from another record's ``final``; by default ``state()``. From an
            oscillator with other parameters it keeps its phase, and a mass on the table stays on it
            with the same relative velocity.

        Returns
        -------
        ImpactRecord

        Raises
        ------
        ValueError
            When impacts is no positive integer, or the start is not one of this structure's or
            below the table.
        """
        count = self._recorded("impacts", impacts)
        return ImpactRecord(self, self._run(self._entered(start), count, store=True))

    def attractor(
        self,
        *,
        start: ImpactState | None = None,
        transient: int = 700,
        keep: int | None = None,
        impacts: int | None = None,
    ) -> ImpactAttractor:
        """Return what is left of the motion after a number of impacts.

        Parameters
        ----------
        start : ImpactState, optional
            As in `simulate`.
        transient : int
            How many impacts to skip.
        keep, impacts : int, optional
            How many impacts to keep, 100 by default: one number with two names.

        Raises
        ------
        ValueError
            When a number is no count, or two are given for the impacts to keep.
        """
        if keep is not None and impacts is not None:
            raise ValueError(f"keep must not be given beside impacts; got {keep!r}")
        skipped = non_negative_integer("transient", transient)
        if impacts is None:
            count = self._recorded("keep", 100 if keep is None else keep)
        else:
            count = self._recorded("impacts", impacts)
        state = self._entered(start)
        before = self._run(state, skipped, store=False) if skipped else None
        kept = self._run(before.final if before else state, count, store=True)
        return ImpactAttractor(self, skipped, ImpactRecord(self, kept), before)

    def _attractor_of(self, record: ImpactRecord) -> ImpactAttractor:
        return ImpactAttractor(self, 0, record, None)

    def periodic_orbit(
        self,
        *,
        impacts: int | None = None,
        periods: int = 1,
        phases: object = None,
        sides: object = None,
        sticking: bool = False,
    ) -> ImpactOrbit:
        """Return a periodic orbit P(n,m), or P(inf,m) that sticks, stable or not.

        Parameters
        ----------
        impacts, periods : int
            n and m, one by default; with phases n is their number.
        phases : (n,) array_like, optional
            Guess of the phases of the forcing at the impacts, ascending, within 2 pi m; n is their
            number. Without it the first of `periodic_orbits` is returned.
        sides : (n,) array_like of int, optional
            With the phases, and not without: 0 for the table, the default, and 1 for the far stop
            of a play.
        sticking : bool
            P(inf,m), found as `periodic_orbits` says; without impacts, phases and sides.

        Raises
        ------
        ValueError
            When there is none, or nothing drives the system.
        NoConvergence
            When Newton's method finds none from the guess.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> orbit = ImpactChain(frequency=0.408).periodic_orbit(sticking=True, periods=2)
        >>> orbit.label, orbit.stable, round(float(abs(orbit.multipliers[0])), 6)
        ('P(inf,2)', True, 0.864601)
        """
        from dynkit.systems.impact.orbits.finding import orbit_at

        if boolean("sticking", sticking):
            for name, given in (("impacts", impacts), ("phases", phases), ("sides", sides)):
                if given is not None:
                    raise ValueError(f"{name} must not be given with sticking; got {given!r}")
            orbits = self.periodic_orbits(periods=periods, sticking=True)
            label = f"P(inf,{periods})"
        elif phases is None and sides is not None:
            raise ValueError(f"sides must not be given without phases; got {sides!r}")
        elif phases is not None:
            return orbit_at(self, periods, phases, sides, impacts)
        else:
            impacts = 1 if impacts is None else impacts
            orbits = self.periodic_orbits(impacts=impacts, periods=periods)
            label = f"P({impacts},{periods})"
        if not orbits:
            raise ValueError(f"no orbit {label} was found for {self!r}")
        return orbits[0]

    def periodic_orbits(
        self, *, impacts: int | None = None, periods: int = 1, sticking: bool = False
    ) -> list[ImpactOrbit]:
        """Return the periodic orbits P(n,m), or P(inf,m), that are found, stable or not.

        For n = 1 all there are, from their closed form; for more impacts what Newton's method finds
        from 200 guesses, always the same. Admissible ones come first, then larger impulses.

        Those that stick are sought from releases of some motions, always the same: of structures at
        rest on the table, of random ones there, and of the motion from the default start.

        Raises
        ------
        ValueError
            When nothing drives the system.
        """
        from dynkit.systems.impact.orbits.finding import find_orbits

        if boolean("sticking", sticking) and impacts is not None:
            raise ValueError(f"impacts must not be given with sticking; got {impacts!r}")
        return find_orbits(self, 1 if impacts is None else impacts, periods, sticking=sticking)

    def find_orbits(self, *, impacts: int = 3, periods: int = 4) -> OrbitSearch[ImpactOrbit]:
        """Return the periodic orbits up to P(n,m) that a search finds, stable or not.

        All P(1,m) there are, from their closed form. Of two and three impacts what Newton's method
        finds from 200 random guesses for each P(n,m). Of two and more what it finds near motions:
        3000 impacts from the default start, and 300 from each of 20 random starts, are simulated,
        in parts of 300; of each part, and for each P(n,m), the two closest returns after n impacts
        and m periods are tried that are not returns to an orbit already found. An orbit that no
        motion comes near to, as an unstable one in many dimensions may be, is missed. Inadmissible
        orbits of two and more impacts are found only by chance.

        Parameters
        ----------
        impacts, periods : int
            The largest n and m.

        Returns
        -------
        OrbitSearch
            The orbits by rising n and m, admissible ones first, then larger impulses; always the
            same. Nothing is `resolved`; `region` is where the simulated impacts were; `cost` has
            the numbers of guesses, starts, impacts and returns.

        Raises
        ------
        ValueError
            When nothing drives the system, or a number is no positive integer.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> search = ImpactChain(masses=1, restitution=0.8, frequency=2.8).find_orbits(periods=3)
        >>> [orbit.label for orbit in search if orbit.admissible]
        ['P(1,1)', 'P(2,2)', 'P(3,3)', 'P(3,3)']
        """
        from dynkit.systems.impact.orbits.searching import search

        return search(self, impacts, periods)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the machine: a sketch of its masses, springs and dashpots, stops and friction.

        Coordinates are drawn as masses side by side, the positive direction to the right. Entries
        of the stiffness and the damping matrix between two of them are springs and dashpots, sums
        of rows those to a wall: masses that the mass matrix couples are drawn as if it did not.
        Lengths are not to scale. Arrows are stops and surfaces that move.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure, wider with more masses.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            With more than 20 masses.
        """
        from dynkit.systems.impact.records.sketch import sketch

        return sketch(ax, self)

    def _recorded(self, name: str, impacts: object) -> int:
        """How many impacts to record: so many that their states fit into memory."""
        count = positive_integer(name, impacts)
        return within_memory(name, count, 8.0 * count * (2 * self._free.layout.slots + 3))
