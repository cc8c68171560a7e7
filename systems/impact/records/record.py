"""Records of simulations: the impacts, and the motion between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.progress import late_bar
from dynkit.core.reprs import Facts, largest, system_repr
from dynkit.core.validation import (
    Array,
    ascending,
    finite_array,
    finite_scalar,
    in_interval,
    one_of,
    positive_integer,
)
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.result import SavedWithSystem
from dynkit.systems.impact.modes.bases import energy_of
from dynkit.systems.impact.modes.steady_response import DISTURBANCE
from dynkit.systems.impact.simulation.runs import MOST_CELLS, course_from
from dynkit.systems.impact.simulation.sampling import (
    events_of,
    longest_sample,
    sample_run,
    sample_sliders,
)
from dynkit.systems.impact.simulation.state import SHEET, ImpactState, phases, put_on
from dynkit.systems.impact.simulation.trajectory import Ending, Events, Trajectory, grouped
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.energy_balance import EnergyBalance
    from dynkit.systems.impact.records.second_moments import SecondMoments
    from dynkit.viewer.page import Page


OF_IMPACTS = "relative_velocity", "phase", "energy", "time"
"""Observables of records of impacts, besides those of elements."""

# Number of disturbed runs ("twins") for the error estimate, which is their largest distance from
# the run times `_margin` of the system.
_TWINS = 3

# Limit of a twin's search for an event, in cells: a constant, plus a factor on the cells of the
# whole run.
_LEAST_CELLS, _CELLS_OF_TWINS = 10_000, 64

_KNOWN_FOR_EVER = (
    Ending.NO_FURTHER_CONTACT,
    Ending.CONTACT_FOR_EVER,
    Ending.DIED_OUT,
    Ending.CYCLE_ENDED,
)
"""Endings after which the motion is known for all times."""

# Doubles in a batch of states: about thirty such arrays exist at once, 60 MB in total.
_NUMBERS = 1 << 18


def twin_errors(
    system: ImpactMap,
    whole: Trajectory,
    batches: Iterable[ImpactRecord],
    count: int,
    unit: float = 1.0,
) -> Iterator[Array]:
    """Errors of impacts, one array for each batch; see `ImpactRecord.error`.

    Errors of positions and velocities are divided by `unit`; the error of the phase is an angle.

    A long computation shows a progress bar on standard error.
    """
    noise = DISTURBANCE * 2.0**-52
    # A twin that rests on the table to rounding may need a long search until it leaves.
    most_cells = min(MOST_CELLS, _LEAST_CELLS + _CELLS_OF_TWINS * whole.cells)
    twins = [
        course_from(
            system,
            whole.start,
            noise=noise,
            seed=seed,
            most_cells=most_cells,
            longest=whole.longest,
        )
        for seed in range(1, _TWINS + 1)
    ]
    units = np.full(system.dimension, unit)
    if not system._strobed:
        units[-1] = 1.0
    with ExitStack() as stack:
        bar: Any = None
        if count > batch_size(system):
            bar = stack.enter_context(late_bar("error", "impact", count))
        for batch in batches:
            states = batch.states
            worst = 2.0**-52 * abs(states / units).max(axis=1, initial=0.0)
            for twin in twins:
                _compare(batch, states, twin, units, worst)
            yield system._margin * worst
            if bar is not None:
                bar.update(len(batch))


def _compare(batch: ImpactRecord, states: Array, twin: Any, units: Array, worst: Array) -> None:
    """Advance a twin by the batch's impacts; update the largest distances (n,) in place."""
    # A twin that has ended has no further impacts.
    more = len(batch) if twin.ending is Ending.COUNT_REACHED else 0
    system, log = batch.system, twin.advance(more, store=True)
    other, k = ImpactRecord(system, batch._run.holding(log)), len(log.time)
    gap = abs(system.difference(other.states, states[:k]) / units).max(axis=1, initial=0.0)
    # Phases that differ by whole turns compare as equal; times do not.
    late = abs(other.time - batch.time[:k]) - 2.0**-51 * batch.time[:k]
    if not system._cycled:
        angle = system.frequency * late
        gap = np.where(angle > math.pi, np.maximum(gap, angle), gap)
    worst[:k] = np.maximum(worst[:k], gap)
    worst[k:] = np.inf


def batch_size(system: ImpactMap) -> int:
    """Number of impacts in a batch."""
    return max(_NUMBERS // (2 * system.degrees_of_freedom + 4), 1)


@final
class ImpactRecord(Viewed, SavedWithSystem):
    """The impacts of one simulation, and the motion between them.

    All quantities are dimensionless. The record stores about 2N + 8 numbers per impact; arrays are
    computed from them on first access.
    """

    _stored: ClassVar = ("_run",)
    _stored_if_known: ClassVar = ("error",)
    _given: ClassVar = "system"
    _run: Trajectory

    def __init__(self, system: ImpactMap, run: Trajectory) -> None:
        self.system = system
        self._run = run
        for array in (run.log.time, run.log.speed, run.log.states):
            array.setflags(write=False)

    def _restored(self) -> Self:
        if len(self._run.log.time) != len(self):
            raise ValueError(f"{len(self._run.log.time)} of {len(self)} impacts are stored")
        if "error" in vars(self) and self.error.shape != (len(self),):
            raise ValueError(f"error is {self.error.shape} for {len(self)} impacts")
        return self

    @property
    def start(self) -> ImpactState:
        """State at the start of the simulation."""
        return self._run.start

    @property
    def final(self) -> ImpactState:
        """State after the last event; a simulation from it continues this one bit for bit."""
        return self._run.final

    @property
    def ending(self) -> Ending:
        """Why the simulation ended."""
        return self._run.ending

    def __len__(self) -> int:
        return self._run.impacts

    def __repr__(self) -> str:
        events = f"{len(self)} impacts, {len(self.sticking)} contacts"
        if self.system._strobed:
            events = f"{len(self)} {'crossings' if self.system._cycled else 'periods'}"
        return f"<ImpactRecord: {events}; {self.ending.value}>"

    def _facts(self) -> Facts:
        return {
            "system": system_repr(self.system, 6),
            "contacts": len(self.sticking),
            "ending": self.ending.value,
            "times of impacts": self.time,
            "chatter error": largest(self.chatter_error),
            "cost": self.cost,
        }

    @property
    def time(self) -> Array:
        """Times (n,) of the impacts, from the start."""
        return self._run.time

    @property
    def relative_velocity(self) -> Array:
        """Rate (n,) of the gap just after the impacts.

        It is negative at the far stop of a play, and NaN without a hard stop.
        """
        return self._run.relative_velocity

    @property
    def phase(self) -> Array:
        """Phase of the table at the impacts, (n,), in [0, 2 pi)."""
        return phases(*self._run.coordinates[1:])

    @cached_property
    def position(self) -> Array:
        """Positions (n, N) at the impacts."""
        return self._motion[0][:, : self.system.degrees_of_freedom]

    @property
    def sliders(self) -> Array:
        """Positions (n, J) of the sliders of `Jenkins` elements at the impacts."""
        return self._motion[0][:, self.system.degrees_of_freedom :]

    @cached_property
    def velocity(self) -> Array:
        """Velocities (n, N) just after the impacts."""
        return self._motion[1][:, : self.system.degrees_of_freedom]

    @cached_property
    def _motion(self) -> tuple[Array, Array]:
        """Positions and velocities (n, N + J) at the impacts, exactly on the stops that are hit.

        Those of the contact mass from modal coordinates would lose digits if the latter are much
        larger.
        """
        run, forced = self._run, self.system._free.forced
        q, sine, cosine = run.coordinates
        x, v = forced.positions(q, sine, cosine), forced.velocities(q, sine, cosine)
        for number, here in grouped(run.log.guard) if self.system._stops else ():
            element, closed = run.guards[number, 1], run.closed(number)
            some, turn = (x[here], v[here]), (sine[here], cosine[here])
            put_on(self.system, element, closed, some, *turn, run.log.speed[here])
            x[here], v[here] = some
        return x, v

    @cached_property
    def energy(self) -> Array:
        """Kinetic plus elastic energy (n,) of the structure just after the impacts."""
        system, energy, size = self.system, np.empty(len(self)), batch_size(self.system)
        if system._sliders:
            return energy_of(self.position, self.velocity, system.mass, system.stiffness)
        for low in range(0, len(self), size):
            now = slice(low, low + size)
            q, sine, cosine = (part[now] for part in self._run.coordinates)
            forced = system._free.forced
            energy[now] = forced.energies(q, sine, cosine, system.mass, system.stiffness)
        return energy

    @property
    def states(self) -> Array:
        """Section coordinates (n, 2N) just after the impacts."""
        if self.system._strobed:
            return self._without_phase
        phase = self.phase
        if self.system._several:
            phase = phase + SHEET * self._run.element
        return np.concatenate([self._without_phase, phase[:, None]], axis=1)

    @property
    def _without_phase(self) -> Array:
        """Section coordinates (n, 2N - 1) without the phase; all 2N if the phase is constant."""
        if self.system._strobed:
            positions, velocities = self.system._crossed.kept
            own = self.position[:, positions], self.velocity[:, velocities], self.sliders
            return np.concatenate(own, axis=1)
        others = self.system._others
        if self.system._motion is None and self.system._automaton.beside is None:
            # With one stop, the coordinate that is put on it is not a section coordinate.
            forced, q = self.system._free.forced, self._run.coordinates
            x, v = forced.positions(*q), forced.velocities(*q)
            return np.concatenate(
                [x[:, others[0]], v[:, others[0]], self.relative_velocity[:, None]], axis=1
            )
        if not self.system._several:
            kept: Any = np.s_[:, others[0]]
        else:
            kept = np.arange(len(self))[:, None], np.array(others)[self._run.element]
        parts = [self.position[kept], self.velocity[kept], self.sliders]
        parts.append(self.relative_velocity[:, None])
        return np.concatenate(parts, axis=1)

    @cached_property
    def events(self) -> Events:
        """All events in the order of time: impacts, contacts, releases, other switches.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> ImpactChain(frequency=0.408).simulate(impacts=300).events
        <Events: 300 impacts, 4 contacts, 4 releases>
        """
        return events_of(self.system, self._run)

    @property
    def sticking(self) -> Array:
        """Begin and end (k, 2) of the intervals of contact; infinite if contact does not end."""
        return self._run.contacts

    @property
    def ambiguous(self) -> int | None:
        """Index of the first impact whose outcome is not unique; None if all outcomes are unique.

        Such an impact pushes against a closed stop, or coincides with an impact at another stop
        whose gap it changes. The motion then follows Newton's law with complementarity (Moreau);
        another law or order gives another motion. From this impact on, `error` is infinite.
        """
        return None if self._run.ambiguous < 0 else self._run.ambiguous

    @property
    def element(self) -> Any:
        """Number (n,) of the stop that each impact hit, as in `ImpactState`; -1 without stops."""
        return np.full(len(self), -1) if self.system._strobed else self._run.element

    @property
    def chatter_error(self) -> float:
        """Sum of the changes of the state when contact replaces the last bounces of chatters.

        For each chatter it is the largest change of a position or velocity of the other coordinates
        when contact begins, to leading order. It is proportional to the cube of the velocity of the
        first omitted bounce. The actual change is at most twice as large. Its effect on the later
        motion and on the times of events is part of `error`.
        """
        return self._run.chatter_error

    @property
    def cost(self) -> Cost:
        """Seconds; counts of impacts, search cells, contacts, touches (impacts at double roots)."""
        return Cost(self._run.seconds, self._run.counts)

    @cached_property
    def error(self) -> Array:
        """Estimate of the largest error of the section coordinates of each impact, (n,).

        The simulation is repeated three times with pseudo-random disturbances of the start, of the
        state after every impact, and of the bounces omitted from a chatter. Each number is
        disturbed by 8 * 2^-52 of itself, and by a quarter of the last digit of its largest value
        along the flight. This is many times the rounding error.

        The estimate is four times the largest distance reached so far by a disturbed run, and at
        least the rounding error of the largest coordinate. It is eight times that distance for a
        linear structure with several hard stops, or with another kind of element: the events of
        elements add errors, and by chance all three runs may stay near. On a stable motion the
        estimate stays near 1e-14. In chaos it grows to the size of the attractor; from there on,
        single states have no meaning. It is infinite where a disturbed run has fewer impacts, for
        example because rounding decides whether it leaves the table. The error of a time is this
        error over the frequency, plus the rounding error of the time. If times differ by whole
        periods of the table, these periods count as well.

        References
        ----------
        J. Vignes, Mathematics and Computers in Simulation 35 (1993) 233-261 (stochastic
        arithmetic).
        """
        return self._error_in(1.0)

    def _error_in(self, unit: float) -> Array:
        """Errors (n,) as `error`, with positions and velocities divided by `unit`."""
        worst, done = np.empty(len(self)), 0
        for part in twin_errors(self.system, self._run, self._batches(), len(self), unit):
            worst[done : done + len(part)] = part
            done += len(part)
        if self.ambiguous is not None:
            worst[self.ambiguous :] = np.inf
        return np.maximum.accumulate(worst, out=worst)

    def _batches(self) -> Iterator[ImpactRecord]:
        """Successive parts of the record, so that its arrays need not all exist at once."""
        size = batch_size(self.system)
        for low in range(0, len(self), size):
            yield ImpactRecord(self.system, self._run.part(low, low + size))

    def _until(self, last: int) -> ImpactRecord:
        """The record up to an impact, with the ending, final state and cost of the whole record."""
        return ImpactRecord(self.system, self._run.part(0, last + 1))

    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities at given times, exact in flight and in contact.

        At the time of an impact the result is the state just after the impact. During the omitted
        bounces of a chatter the contact mass follows these bounces to leading order; the error of
        its position is then at most a thousand times the `chatter_tolerance`.

        Parameters
        ----------
        times : (k,) array_like
            Times from the start, in any order, up to the last impact, or to the last event if no
            further impact was found. After a simulation that ended by itself, up to millions of
            periods; for nonlinear springs, up to 1000 periods after the last event.

        Returns
        -------
        position, velocity : (k, N) arrays

        Raises
        ------
        ValueError
            When a time is not finite, negative, or beyond the simulated time.
        """
        return sample_run(self.system, self._run, self._within(times))

    def sample_sliders(self, times: object) -> Array:
        """Positions of the sliders of `Jenkins` elements at given times, (k, J), as in `sample`.

        Examples
        --------
        The force of a joint, for a hysteresis loop:

        >>> from dynkit.systems import ImpactChain, Jenkins
        >>> joint = Jenkins(0, stiffness=2.0, force=0.3)
        >>> record = ImpactChain(masses=1, frequency=0.8, elements=[joint]).simulate(impacts=3)
        >>> times = [0.0, 5.0, 10.0]
        >>> stretch = record.sample(times)[0] @ joint.row(1) - record.sample_sliders(times)[:, 0]
        >>> bool((abs(joint.stiffness * stretch) <= joint.force + 1e-12).all())
        True
        """
        return sample_sliders(self.system, self._run, self._within(times))

    def observable(self, name: str, times: object = None) -> Array:
        """Return one of the system's `observables` at the impacts, (n,), or of an element at times.

        Observables of elements are named like their parameters. Stops have ``"table.gap"``,
        ``"table.relative_velocity"`` (the rate of the gap) and ``"table.contact_force"``, which is
        never negative; hard stops also ``"table.impulse"``, the impulse of each impact. Friction
        has ``"belt.slip_velocity"`` and ``"belt.friction_force"``, the force on the structure along
        its row. `Jenkins` elements have ``"joint.stretch"``, the stretch of the spring, and
        ``"joint.spring_force"``, its force on the structure. The values are exact for the computed
        states; the error of a force is that of the states times the stiffness on which it acts.
        During the omitted bounces of a chatter the values are those of contact.

        Parameters
        ----------
        name : str
        times : (k,) array_like, optional
            Times as in `sample`, for an observable of an element other than an impulse. By default
            the values are those just after each impact; without a hard stop, those at the beginning
            of each period.

        Returns
        -------
        (n,) or (k,) array

        Raises
        ------
        ValueError
            When there is no observable of this name, or a time is beyond the simulated time.

        Examples
        --------
        A mass of two falls onto a floor and comes to rest there, under a weight of three:

        >>> from dynkit.systems import HardStop, MatrixOscillator
        >>> block = MatrixOscillator(
        ...     M=[[2.0]], C=[[0.0]], K=[[0.0]], frequency=1.0, constant_forces=[-3.0],
        ...     elements=[HardStop(0, restitution=0.5, name="floor")],
        ... )
        >>> record = block.simulate(impacts=100, start=block.state([0.75], [0.0]))
        >>> record.observable("floor.contact_force", [0.5, 9.0]).round(12)
        array([0., 3.])
        >>> record.observable("floor.impulse")[:2].round(12)  # it hits at 1.5, leaves at 0.75
        array([4.5 , 2.25])
        """
        from dynkit.systems.impact.records.observables import along_at, along_impacts

        if times is not None:
            return along_at(self.system, self._run, name, self._within(times))
        given: Any = name
        if self.system._strobed or not (isinstance(given, str) and given in OF_IMPACTS):
            known = one_of("name", given, self.system.observables)
            if "." in known:
                return along_impacts(self.system, self._run, known)
            if self.system._strobed:
                return self.states[:, self.system.observables.index(known)]
        return np.asarray(getattr(self, name), dtype=np.float64)

    def _within(self, times: object) -> Array:
        """Times (k,), checked to lie within the simulated time."""
        asked = finite_array("times", times, (None,))
        last = longest_sample(self.system, self._run)
        if self.ending is Ending.COUNT_REACHED:
            last = float(self.time[-1]) if len(self) else 0.0
        elif self.ending not in _KNOWN_FOR_EVER:
            last = self._run.searched
        for i in np.flatnonzero((asked < 0.0) | (asked > last))[:1].tolist():
            raise ValueError(f"times[{i}] must lie in [0, {last}]; got {float(asked[i])}")
        return asked

    def plot(
        self,
        ax: Axes | None = None,
        element: str | None = None,
        *,
        begin: float = 0.0,
        end: float | None = None,
    ) -> Axes:
        """Draw the coordinate of an element against time; stops are dashed, impacts are dots.

        Intervals are shaded while a stop on this coordinate is in contact or presses, and hatched
        while friction sticks. By default the figure ends at the last impact, after at most 1000
        periods of the forcing. If the simulation ended by itself, the figure ends two periods after
        the last impact, and after at least 12 periods.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on; by default a new figure of column width.
        element : str, optional
            Name of the element, or ``"elements[k]"``; by default the first hard stop, else the
            first element.
        begin, end : float, optional
            Limits of the time interval that is drawn.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When no element has this name, or the record does not cover the interval.
        """
        from dynkit.systems.impact.records.drawing import draw, shade, shown_until
        from dynkit.systems.impact.records.event_counts import element_names

        system, names = self.system, element_names(self.system)
        chosen = names[0] if element is None else one_of("element", element, names)
        along = system._elements[names.index(chosen)]
        last = shown_until(2.0 * math.pi / system.frequency, self._run)
        end = last if end is None else finite_scalar("end", end)
        begin = in_interval("begin", begin, 0.0, end)
        hit = [stop.coordinate == along.coordinate for stop in system._elements]
        impacts = np.empty(0)
        if not system._strobed:
            shown = (begin <= self.time) & (self.time <= end)
            impacts = self.time[np.array(hit)[self.element] & shown]
        axes = draw(ax, system, self.sample, self.start.phase, end, impacts, along, begin)
        shade(axes, self._run, along, begin, end)
        return axes

    def animate(
        self,
        *,
        begin: float | None = None,
        end: float | None = None,
        frames: int = 200,
        element: str | None = None,
    ) -> FuncAnimation:
        """Animate the machine: its sketch in motion, above the time series of an element.

        Displacements and gaps have the same scale. A stop that is hit is drawn bold for some
        frames; a slider that sticks is grey.

        Parameters
        ----------
        begin, end : float, optional
            Interval of time; by default the six periods of the forcing before the last impact.
        frames : int
            Number of frames, at equal time steps; 25 frames are shown in a second.
        element : str, optional
            As in `plot`.

        Returns
        -------
        matplotlib.animation.FuncAnimation
            Its ``save`` writes GIF and MP4 files. A notebook shows it with controls.

        Raises
        ------
        ValueError
            With more than 20 masses, no element of this name, or an interval beyond the record.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> record = ImpactChain(masses=3, frequency=0.9).simulate(impacts=30)
        >>> film = record.animate(frames=3)  # film.save("chain.gif") writes it
        >>> "<input" in film.to_jshtml()
        True
        """
        from dynkit.systems.impact.records.animation import animate

        return animate(self, begin, end, frames, element)

    def dataset(self) -> Dataset:
        """Return the impacts and contacts as a dataset, with times from the start.

        Without a hard stop, the dataset holds the states once a period of the forcing, or once a
        cycle of an undriven machine, without ``relative_velocity`` and ``element``.

        Its dimensions are ``impact``, ``mass`` (the coordinates, from 1) and ``contact``, and with
        `Jenkins` elements ``slider``. It holds the `error`, which requires further simulations,
        only if that was computed before.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> found = ImpactChain(masses=2, frequency=0.9).simulate(impacts=5).to_xarray()
        >>> found.position.dims, found.attrs["parameter_restitution"]
        (('impact', 'mass'), 0.85)
        """
        n, each = self.system.degrees_of_freedom, "impact"
        begins, ends = self.sticking.T
        title, hit = "States of a motion, once a period", dict[str, Any]()
        if not self.system._strobed:
            title = "Impacts of a motion"
            hit["relative_velocity"] = each, self.relative_velocity
            hit["element"] = each, self.element
        return Dataset(
            {"time": (each, self.time), "mass": ("mass", np.arange(1, n + 1))},
            {
                **hit,
                "phase": (each, self.phase),
                "energy": (each, self.energy),
                "position": ((each, "mass"), self.position),
                "velocity": ((each, "mass"), self.velocity),
                **({"sliders": ((each, "slider"), self.sliders)} if self.system._sliders else {}),
                "contact_begin": ("contact", begins),
                "contact_end": ("contact", ends),
                **known_error(self, each),
            },
            described(
                title,
                cost=self.cost,
                error="estimate of the largest error of the section coordinates up to each impact",
                system=self.system,
                ending=self.ending.value,
                chatter_error=self.chatter_error,
            ),
        )

    def as_attractor(self) -> Any:
        """Return the recorded impacts as an `ImpactAttractor` with a transient of zero impacts.

        Measures of attractors can then be applied to a record. Its `label` says whether the motion
        has settled.
        """
        return self.system._attractor_of(self)

    def _page(self, motions: int) -> Page:
        from dynkit.systems.impact.records.viewing import page_of_record

        return page_of_record(self, motions)

    def energy_balance(self) -> EnergyBalance:
        """Return the work done on the structure and the energy dissipated, by each source.

        The sources are forces, dashpots and each element; the time is from the start to the last
        impact. The balance closes to rounding, which checks the motion independently.

        Raises
        ------
        ValueError
            When the record has no impact after its start, or when the modes are so fast that the
            integrals need more than about 30 million nodes of quadrature.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> balance = ImpactChain(masses=3, frequency=0.9).simulate(impacts=100).energy_balance()
        >>> sorted(balance.dissipated), balance.error < 1e-12
        (['damping', 'table'], True)
        """
        from dynkit.systems.impact.records.energy_balance import energy_balance

        if not (len(self) and self.time[-1] > 0.0):
            raise ValueError(f"record must hold an impact after its start; got {self!r}")
        return energy_balance(self.system, self._run)

    def second_moments(self, batches: int | Sequence[int] = 32) -> SecondMoments:
        """Return time averages of positions and of their products, in closed form.

        The averages run from the start to the last impact, over flights, chatter and contact.

        Parameters
        ----------
        batches : int or (b + 1,) sequence of int
            Number of batches of successive impacts, at most the number of impacts. Or the edges of
            the batches: numbers of impacts, ascending from 0 to the number in the record.

        Raises
        ------
        ValueError
            When the record has no impact after its start, or the edges are not such numbers.
        """
        from dynkit.systems.impact.records.second_moments import second_moments

        if not (len(self) and self.time[-1] > 0.0):
            raise ValueError(f"record must hold an impact after its start; got {self!r}")
        if np.ndim(batches):
            edges = ascending("batches", batches).astype(np.intp)
            if not (edges == batches).all() or [*edges[:1], *edges[-1:]] != [0, len(self)]:
                raise ValueError(f"batches must lead from 0 to {len(self)}; got {batches!r}")
        else:
            count = min(positive_integer("batches", batches), len(self))
            edges = (np.arange(count + 1) * len(self)) // count
        return second_moments(self.system, self._run, edges)
