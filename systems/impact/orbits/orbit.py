"""Periodic orbits of impact oscillators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.angles import in_turn
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, system_repr
from dynkit.core.validation import Array, finite_array, one_of, read_only
from dynkit.orbits.equations import KeptSolution
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems.impact.orbits.itineraries.motion import ItinerarySolution
from dynkit.systems.impact.orbits.problem import ImpactProblem
from dynkit.systems.impact.records.viewing import series_of
from dynkit.viewer.series import Series

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.record import ImpactRecord

NONE = np.empty(0)
"""Values of the free parameters where there are none."""


PROGRESSION = "progression"
"""Name of the observable that orbits of progressing machines have in addition."""


def progression_of(solution: ItinerarySolution) -> Array:
    """Change (N,) of the positions in a period."""
    return read_only(solution.progress[: solution.oscillator.degrees_of_freedom])


def observables_of(solution: ItinerarySolution) -> dict[str, Array]:
    """Observables of a motion with impacts, by name: see `ImpactOrbit.observable`."""
    phases, speeds = solution.impact_phases, np.asarray(solution.relative_velocity)
    time = np.asarray((phases - solution.phases[0]) / solution.frequency)
    return {"relative_velocity": speeds, "phase": in_turn(phases), "time": time}


@final
class ImpactOrbit(KeptSolution, PeriodicOrbit):
    """A periodic orbit P(n,m), n impacts in m periods of the forcing, or P(inf,m) with sticking.

    Orbits come from `ImpactOscillator.periodic_orbit`, from an attractor or from a branch. The
    states of P(n,m) are those just after its impacts. The states of P(inf,m) are those at its
    releases, where relative velocity and contact force are zero. Without impacts the states are
    positions and velocities at the beginning of each period of the forcing. For the cycle of an
    undriven machine they are those just after its events, with phases counted from the first one.

    The unknowns of P(n,m) are phases and impulses, (2n,), if all motions have a restoring force
    and all elements are hard stops. Otherwise they are the phases of the events, the impulses of
    the impacts among them, and positions, velocities and positions of sliders just before the first
    event. The unknowns of P(inf,m) are the phases of releases and of the impacts before the
    chatters, the impulses of these impacts, and positions and velocities just before each release.
    An orbit is admissible when simulation from each of its states finds the next one.
    """

    _problem: ImpactProblem
    _each = "impact"

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        if not self.admissible:
            kind = f"inadmissible, {kind}"
        largest = abs(self.multipliers[0])
        return (
            f"<{self.label} of {system_repr(self.system, 6)}: {kind}, "
            f"multipliers up to {largest:.4g}>"
        )

    def _facts(self) -> Facts:
        return {**super()._facts(), "period": self.period, "states": len(self.states)}

    @property
    def _solution(self) -> ItinerarySolution:
        found: ItinerarySolution = self._problem.at(self._x, NONE)
        return found

    @property
    def system(self) -> ImpactMap:
        return self._problem.oscillator

    @property
    def sticks(self) -> bool:
        """Whether it chatters, sticks and is released: P(inf,m)."""
        return self._problem.sticks

    @property
    def impacts(self) -> Any:
        """The number n of impacts, an int; infinite for P(inf,m)."""
        return np.inf if self.sticks else len(self._solution.impulses)

    @property
    def label(self) -> str:
        """``P(n,m)`` or ``P(inf,m)``; ``P(n)``, with n returns to the section, without forcing.

        Without a hard stop n is the number of periods, as in the label of an attractor.
        """
        if not self._problem.driven:
            return f"P({self._problem.section_returns})"
        count = self.periods if self.system._strobed else self.impacts
        return f"P({count},{self.periods})"

    @cached_property
    def counts(self) -> Mapping[str, float]:
        """Numbers of events in a period, by element, as in `OrbitLabel.counts`."""
        return self._problem.counts(self._x)

    @property
    def periods(self) -> int:
        """The number m of periods of the forcing."""
        return self._problem.periods

    @property
    def period(self) -> float:
        """Period in units of time."""
        return float(self._solution.period)

    @property
    def progression(self) -> Array:
        """Change (N,) of the positions in a period; zero unless the machine progresses.

        A shift of the positions of such a machine deforms no spring and changes no gap; friction or
        dashpots resist it. The states repeat except for the shift, and the first state is zero
        along it. The multiplier one of the shift is left out of `multipliers`. The `error` holds
        for the progression as well.

        References
        ----------
        E. Pavlovskaia, M. Wiercigroch, C. Grebogi, Modeling of an impact system with a drift,
        Physical Review E 64 (2001) 056224.
        Y. Liu, M. Wiercigroch, E. Pavlovskaia, H. Yu, Modelling of a vibro-impact capsule system,
        International Journal of Mechanical Sciences 66 (2013) 2-11.
        """
        return progression_of(self._solution)

    # --- its states -------------------------------------------------------------------------------

    @property
    def phases(self) -> Array:
        """Phases (k,) of the forcing at the states, ascending, not wrapped."""
        return self._solution.phases

    @cached_property
    def states(self) -> Array:
        """Section coordinates (k, 2N + J) with J sliders: see `ImpactOscillator`."""
        states = self._solution.section_states
        states.setflags(write=False)
        return states

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of a section coordinate of the states.

        For P(n,m) with hard stops only it is a bound to first order. Twice the rounding error and
        the last residual of the equations are multiplied by the inverse Jacobian; the rounding
        error of the states is added. For all other orbits the rounding error of each flight and
        each guard is bounded. These bounds are multiplied by the inverse Jacobian and treated as
        independent errors: the estimate is twice the root of the sum of their squares, plus the
        contribution of the residual. The error of omitted bounces is included. The estimate is
        infinite where the Jacobian is singular.

        References
        ----------
        N. J. Higham, T. Mary, A new approach to probabilistic rounding error analysis, SIAM Journal
        on Scientific Computing 41 (2019) A2815-A2835.
        """
        return self._problem.state_error(self._x, NONE)

    @cached_property
    def multipliers(self) -> Any:
        """Floquet multipliers, (2N + J,) complex with J sliders, the largest modulus first.

        Each direction along which the machine progresses reduces their number by one: see
        `progression`.

        They are those of the impact map, which equal those of the flow over the whole period. For
        P(inf,m) two are zero, since gap and rate are zero in contact, whatever they were before.
        The others are those of the map from a release to the same one a period later, with errors
        relative to the largest. Each slider that slips adds one zero multiplier: its position no
        longer depends on its position before.
        """
        found = self._problem.multipliers(self._x, NONE)
        found.setflags(write=False)
        return found

    @cached_property
    def admissible(self) -> bool:
        """Whether simulation from each of its states finds the next one."""
        return self._problem.admissible(self._x, NONE)

    # --- its impacts and contacts -----------------------------------------------------------------

    @property
    def impulses(self) -> Array:
        """Changes (n,) of the relative velocity by the impacts; negative for tensile impulses.

        For P(inf,m) these are the impacts before the chatters, as in `time` and
        `relative_velocity`; their number is constant along a branch. `bounces` has all impacts.
        """
        return self._solution.impulses

    @property
    def time(self) -> Array:
        """Times (n,) of the impacts since the first state."""
        return observables_of(self._solution)["time"]

    @property
    def relative_velocity(self) -> Array:
        """Rate (n,) of the gap just after the impacts; negative at the far stop of a play."""
        return self._solution.relative_velocity

    @cached_property
    def bounces(self) -> Array:
        """Time from the first state, phase in [0, 2 pi), relative velocity after each impact.

        An (l, 3) array with the bounces of a chatter that are not omitted.
        """
        phases, speeds = self._solution.bounces
        time = (phases - self.phases[0]) / self._solution.frequency
        impacts = np.stack([time, in_turn(phases), speeds], axis=1)
        impacts.setflags(write=False)
        return impacts

    @cached_property
    def contacts(self) -> Array:
        """Begin and end (k, 2) of the contacts, as times since the first release.

        Contact begins after the last bounce that is not omitted. For P(n,m) there is none, (0, 2).
        """
        since = self._solution.contact_phases - self.phases[0]
        times = np.asarray(since / self._solution.frequency)
        times.setflags(write=False)
        return times

    @property
    def chatter_error(self) -> float:
        """Largest change of a position or velocity by the omission of bounces."""
        return self._solution.chatter_error

    @property
    def observables(self) -> Sequence[str]:
        """Names of what `observable` returns; diagrams draw the first by default."""
        return tuple(self._observables)

    def observable(self, name: str) -> Array:
        """Return ``relative_velocity``, ``phase`` or ``time`` at the impacts, (n,).

        Without impacts the names are ``state[0]`` and so on, the coordinates at the states. A
        machine that progresses has ``progression``, (N,), too: see `progression`.
        """
        return self._observables[one_of("name", name, self._observables)]

    @property
    def _observables(self) -> Mapping[str, Array]:
        if not len(self._solution.impulses):
            found = self.system.coordinates(self.states)
        else:
            found = observables_of(self._solution)
        if self.system._progression.shift.size:
            return {**found, PROGRESSION: self.progression}
        return found

    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities at given times since the first state.

        Parameters
        ----------
        times : (j,) array_like
            Any finite times; the motion is periodic, except for its `progression`.

        Returns
        -------
        position, velocity : (j, N) arrays
        """
        asked = finite_array("times", times, (None,))
        x, v = self._solution.sample(asked % self.period)
        if self.progression.any():
            x = x + np.outer(asked // self.period, self.progression)
        return x, v

    @property
    def _drawn(self) -> tuple[Any, ...]:
        """What figures show: system, motion, first phase, duration, and times of the impacts."""
        impacts = np.append(self.bounces[:, 0], [] if self.sticks else [self.period])
        return self.system, self.sample, float(self.phases[0]), self.period, impacts

    def _series(self) -> Series:
        return series_of(*self._drawn)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw one period of the contact coordinate, the stops dashed, the impacts as dots.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure of column width.

        Returns
        -------
        Axes
        """
        from dynkit.systems.impact.records.drawing import draw

        return draw(ax, *self._drawn)

    def animate(self, *, frames: int = 100, element: str | None = None) -> FuncAnimation:
        """Animate the machine over one period: its sketch in motion, above a time series.

        The motion is simulated from the first state. See `ImpactRecord.animate`.

        Parameters
        ----------
        frames : int
            Number of frames, at equal times; 25 of them are shown in a second.
        element : str, optional
            Name of the element of the time series; by default the first hard stop, else the first
            element.

        Returns
        -------
        matplotlib.animation.FuncAnimation
            Its ``save`` writes GIF and MP4 files. A notebook shows it with controls.

        Raises
        ------
        ValueError
            When the orbit is not admissible, or as in `ImpactRecord.animate`.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> orbit = ImpactChain(masses=3, frequency=0.8).periodic_orbit()
        >>> film = orbit.animate(frames=3)  # film.save("orbit.gif", writer="pillow") writes it
        >>> "<input" in film.to_jshtml()
        True
        """
        if not self.admissible:
            raise ValueError(f"orbit must be admissible, a motion of the machine; got {self!r}")
        if self._problem.driven:
            start = self.system.impact_state(self.states[0])
        else:
            (position,), (velocity,) = self.sample([0.0])
            start = self.system.state(position, velocity)
        motion = self.system.attractor(start=start, transient=0, impacts=1)
        record: ImpactRecord = motion.record_until(self.period)
        return record.animate(begin=0.0, end=self.period, frames=frames, element=element)
