"""Impact oscillators: structures that hit a table, stops, or themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast, final

from dynkit.core.kept import kept
from dynkit.core.validation import (
    Array,
    boolean,
    non_negative_integer,
    positive_integer,
    within_memory,
)
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Arrivals
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.orbits.sensitivity import change_by, map_derivative_by
from dynkit.systems.impact.oscillators.attractor import ImpactAttractor
from dynkit.systems.impact.records.record import OF_IMPACTS, ImpactRecord
from dynkit.systems.impact.simulation.state import ImpactState

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.search import OrbitSearch
    from dynkit.systems.impact.orbits.orbit import ImpactOrbit


@dataclass(frozen=True, kw_only=True)
class ImpactOscillator(ImpactMap):
    """A structure that hits a vibrating table; as a `Map`, from one impact to the next.

    A subclass must implement its energies, as every `LagrangianStructure`. If they are quadratic,
    the equation of motion is M x'' + C x' + K x = g + Im(F exp(i phase)), with phase' = frequency,
    and motions are exact to rounding. For energies of any other smooth form, motions are computed
    by Taylor's method; `engine` is the method used. Energies may have further arguments, by name:
    ``kinetic(self, x, v, phase)``, ``potential(self, x, phase)`` and ``dissipation(self, x, v,
    phase)``. The damping force is then minus the derivative of the dissipation by v, and the
    matrices and modes are those of small oscillations about x = 0. One coordinate x_c can hit the
    table at x_T = amplitude sin(phase) + offset. The gap is never negative: it is x_c - x_T above
    the table, x_T - x_c below it. An impact is an impulse on this coordinate that changes the rate
    of the gap from u- < 0 to -restitution u-. Other stops, several stops and friction are given as
    `elements`.

    The states of the map are the 2N section coordinates just after an impact. These are all
    positions except x_c, all velocities except v_c, the relative velocity u (the rate of the gap),
    and the phase.

    Parameters
    ----------
    frequency : float
        Angular frequency of the table and of the forces, positive.
    restitution : float or ImpactLaw
        Coefficient of restitution in [0, 1]. It may be a law, a function of the approach velocity.
    amplitude : float
        Amplitude of the table, not negative. A stop at rest has amplitude 0.
    offset : float
        Middle of the table's motion.
    contact : int
        Index of the coordinate that hits the table; the last one by default.
    side : {"above", "below"}
        Side of the table on which this coordinate moves.
    play : float
        Positive distance to a second stop, which faces the table and moves with it. Infinite by
        default: there is no second stop. Relative velocities after impacts with it are negative.
    harmonic_forces : (N,) array_like of complex, optional
        F, amplitudes of forces on the coordinates. A real F_j is the force F_j sin(phase).
    constant_forces : (N,) array_like of float, optional
        g, forces on the coordinates, such as weights.
    chatter_tolerance : float
        Contact replaces the last bounces of a chatter if this changes no position or velocity by
        more than the tolerance, to leading order; with 0 none are replaced. During the
        omitted bounces the error of the position of the contact mass is at most a thousand times
        the tolerance. The record's ``chatter_error`` is the sum of these changes.
    elements : sequence of Element, optional
        Any number of elements such as `HardStop`, `SoftStop`, `DryFriction` and `Jenkins`, in place
        of the table. Each acts on a coordinate, between two coordinates, or along any row of
        coordinates. The arguments restitution, amplitude, offset, contact, side and play must then
        not be given. The constants of elements are parameters, such as ``"elements[1].stiffness"``.
        The section omits the coordinate with the largest entry in the stop's row; of a pair (i, j)
        it omits x_j. With several hard stops, the last section coordinate is the phase plus 4 pi
        times the number of the stop. Positions of the sliders of `Jenkins` elements come after the
        velocities. Without a hard stop, the map takes the state from one period of the forcing to
        the next, at phase 0. Its states are positions and velocities, and every count of impacts is
        a count of periods. If there is no forcing either, the section is where the slip of the
        first friction element comes to a halt. Without friction it is where the gap of the first
        soft stop without preload closes. The 2N - 1 section coordinates omit the velocity, or the
        position, that is fixed there, and every count of impacts is a count of returns.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, equations 8 to 12 and
    15.
    """

    @final
    def parameter_derivative(self, state: Array, name: str) -> Array:
        found, start = None, self.impact_state(state)
        if self._motion is None and (change := self._changes_by(name)) is not None:
            found = map_derivative_by(self, start, change)
        return super().parameter_derivative(state, name) if found is None else found

    @kept
    def _changes_by(self, name: str) -> Array | None:
        """Derivatives of the oscillator's constants by a parameter; None if not available."""
        return change_by(self, name)

    @property
    @final
    def observables(self) -> Sequence[str]:
        """Names of the record's arrays that a sweep can keep at each impact.

        With several hard stops they include ``element``. Without a hard stop they are the
        coordinates, ``state[0]`` and so on. Observables of elements, such as ``table.impulse``, are
        described at `ImpactRecord.observable`.
        """
        from dynkit.systems.impact.records.observables import names_along

        own = super().observables if self._strobed else OF_IMPACTS
        return (*own, *(["element"] if self._several else []), *names_along(self))

    @property
    @final
    def _section_axes(self) -> tuple[str, str] | None:
        return None if self._strobed else ("phase", "relative_velocity")

    # --- simulation -------------------------------------------------------------------------------

    @final
    def simulate(self, *, impacts: int, start: ImpactState | None = None) -> ImpactRecord:
        """Simulate a number of impacts; end earlier if no further impact is possible.

        Parameters
        ----------
        impacts : int
            Number of impacts to record.
        start : ImpactState, optional
            A `state`, or the ``final`` state of another record; by default ``state()``. A state of
            an oscillator with other parameters keeps its phase; a mass on the table stays there
            and keeps its relative velocity.

        Returns
        -------
        ImpactRecord

        Raises
        ------
        ValueError
            When impacts is not a positive integer, or the start is beyond the table or belongs to
            another structure.
        """
        count = self._recorded("impacts", impacts)
        return ImpactRecord(self, self._run(self._entered(start), count, store=True))

    @final
    def attractor(
        self,
        *,
        start: ImpactState | None = None,
        transient: int = 700,
        keep: int | None = None,
        impacts: int | None = None,
    ) -> ImpactAttractor:
        """Simulate, skip a transient, and return the motion after it.

        Parameters
        ----------
        start : ImpactState, optional
            As in `simulate`.
        transient : int
            Number of impacts to skip.
        keep, impacts : int, optional
            Number of impacts to keep, 100 by default. Both names mean the same; give one of them.

        Raises
        ------
        ValueError
            When a number is not a count, or both keep and impacts are given.
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

    @final
    def following(self, final: ImpactState, keep: int) -> ImpactAttractor:
        return self.attractor(start=final, transient=0, keep=keep)

    @final
    def arrivals(
        self, starts: Array, orbits: Sequence[Attractor], transient: int, near: float
    ) -> Arrivals | None:
        from dynkit.systems.impact.records.ensemble import Ensemble

        if not Ensemble.serves(self):
            return None
        records = [cast("ImpactAttractor", orbit).record for orbit in orbits]
        return Ensemble(self, records).arrivals(starts, transient, near)

    @property
    def _solutions(self) -> tuple[type, ...]:
        from dynkit.systems.impact.orbits.itineraries.equations import ItineraryEquations
        from dynkit.systems.impact.orbits.orbit import ImpactOrbit

        return (*super()._solutions, ImpactOrbit, ItineraryEquations)

    def _attractor_of(self, record: ImpactRecord) -> ImpactAttractor:
        return ImpactAttractor(self, 0, record, None)

    @final
    def periodic_orbit(
        self,
        *,
        impacts: int | None = None,
        periods: int = 1,
        phases: object = None,
        sides: object = None,
        sticking: bool = False,
        start: ImpactState | None = None,
    ) -> ImpactOrbit:
        """Return a periodic orbit, stable or unstable: P(n,m), or P(inf,m), which sticks.

        Parameters
        ----------
        impacts, periods : int
            n and m, one by default. When phases are given, n is their number.
        phases : (n,) array_like, optional
            Guess of the phases of the forcing at the impacts, ascending, within 2 pi m. Without a
            guess, the first of `periodic_orbits` is returned.
        sides : (n,) array_like of int, optional
            Number of the stop that each impact hits: 0 for the table (default), 1 for the far stop
            of a play. Only together with phases.
        sticking : bool
            Return an orbit P(inf,m), found as `periodic_orbits` describes. Not together with
            impacts, phases or sides.
        start : ImpactState, optional
            State near the orbit, for a machine with elements: its orbits are found from a motion.
            The motion from this state must stay near the orbit for three periods of the orbit. By
            default the state after 700 impacts from four times the first start of `find_orbits`, so
            that the orbit is the same in all units.

        Raises
        ------
        ValueError
            When no such orbit is found, or the system is undriven.
        NoConvergence
            When Newton's method does not converge from the guess.
        NotImplementedError
            When energies are not quadratic and the motion sticks to a stop with an impact law.
            ``dynkit.periodic_orbit`` finds the orbits of the map.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> orbit = ImpactChain(frequency=0.408).periodic_orbit(sticking=True, periods=2)
        >>> orbit.label, orbit.stable, round(float(abs(orbit.multipliers[0])), 6)
        ('P(inf,2)', True, 0.864601)
        """
        from dynkit.systems.impact.orbits.finding import orbit_at
        from dynkit.systems.impact.orbits.itineraries.finding import orbit_from

        others = impacts is phases is sides is None and not boolean("sticking", sticking)
        if others and not self._table_alone:
            return orbit_from(self, periods, start)
        if start is not None:
            raise ValueError(f"start must be given with elements, and periods alone; got {start!r}")
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

    @final
    def periodic_orbits(
        self, *, impacts: int | None = None, periods: int = 1, sticking: bool = False
    ) -> list[ImpactOrbit]:
        """Return the periodic orbits P(n,m), or P(inf,m), that a search finds, stable or unstable.

        For n = 1 the search is complete: the orbits have a closed form. For n > 1 Newton's method
        starts from 200 random guesses, which are the same in every call. Admissible orbits come
        first, then those with larger impulses.

        Sticking orbits are searched from releases of simulated motions. These motions start from
        rest on the table, from random states on the table, and from the shape of the first mode;
        they are the same in every call.

        If energies are not quadratic, or if there are other elements than a table that acts on one
        coordinate, there is no closed form. Then the search is that of `find_orbits`, and sticking
        orbits are searched from those of its motions that stick.

        Raises
        ------
        ValueError
            When the system is undriven.
        """
        from dynkit.systems.impact.orbits.finding import find_orbits

        if boolean("sticking", sticking) and impacts is not None:
            raise ValueError(f"impacts must not be given with sticking; got {impacts!r}")
        impacts = 1 if impacts is None else impacts
        if not (self._table_alone or sticking):
            found = self.find_orbits(impacts=impacts, periods=periods)
            wanted = f"P({impacts},{periods})"
            return [orbit for orbit in found if orbit.label == wanted]
        return find_orbits(self, impacts, periods, sticking=sticking)

    @final
    def find_orbits(self, *, impacts: int = 3, periods: int = 4) -> OrbitSearch[ImpactOrbit]:
        """Return the periodic orbits up to P(n,m) that a search finds, stable or unstable.

        All P(1,m) are found, from their closed form. For n = 2 and 3 Newton's method starts from
        200 random guesses for each P(n,m). For n >= 2 it also starts from close returns of
        simulated motions: 3000 impacts from a first start and 300 from each of 20 random starts, in
        parts of 300. The first start is the shape of the first mode, scaled to a length that
        follows from forces and elements, so that the search is the same in all units. In each part,
        and for each P(n,m), it tries the two closest returns after n impacts and m periods that do
        not belong to an orbit already found. An orbit that no simulated motion approaches is
        missed; this can happen to unstable orbits in many dimensions. Inadmissible orbits with n >=
        2 are found only by chance.

        With other elements than a table that acts on one coordinate, and for energies that are not
        quadratic, Newton's method starts from close returns for all n. These are returns of 1000
        impacts from the first start, and of 200 from each of 10 random starts, in parts of 200. If
        energies are quadratic, it also starts from the P(1,m) of each hard stop without the other
        elements, which have a closed form. Motions that stick to a hard stop are not used. Without
        a hard stop, an orbit of m periods is P(m,m), and returns are those after m periods.

        Parameters
        ----------
        impacts, periods : int
            Largest n and m.

        Returns
        -------
        OrbitSearch
            The orbits in the order of n and m, admissible ones first, then those with larger
            impulses. They are the same in every call. `resolved` is 0, `region` spans the simulated
            impacts, and `cost` has the numbers of guesses, starts, impacts and returns.

        Raises
        ------
        ValueError
            When the system is undriven, or a number is not a positive integer.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> search = ImpactChain(masses=1, restitution=0.8, frequency=2.8).find_orbits(periods=3)
        >>> [orbit.label for orbit in search if orbit.admissible]
        ['P(1,1)', 'P(2,2)', 'P(3,3)', 'P(3,3)']
        """
        from dynkit.systems.impact.orbits.searching import search

        n, m = positive_integer("impacts", impacts), positive_integer("periods", periods)
        return search(self, n, m)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw a sketch of the machine: masses, springs, dashpots, stops and friction.

        Coordinates are drawn as masses side by side; the positive direction is to the right. An
        entry of the stiffness or damping matrix between two coordinates is drawn as a spring or a
        dashpot between them. A row with a nonzero sum is drawn as one to the wall. Coupling by the
        mass matrix is not drawn. Lengths are not to scale. Arrows mark stops and surfaces that
        move.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on; by default a new figure, wider with more masses.

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
        """Number of impacts to record; ValueError if their states do not fit into memory."""
        count = positive_integer(name, impacts)
        return within_memory(name, count, 8.0 * count * (2 * self._free.layout.slots + 3))
