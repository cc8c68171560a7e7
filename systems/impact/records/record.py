"""Records of impact motions: what happened at each impact, and the motion between."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, largest, system_repr
from dynkit.core.validation import Array, finite_array, one_of, positive_integer
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.result import Result
from dynkit.systems.impact.simulation.runs import MOST_CELLS, Course
from dynkit.systems.impact.simulation.sampling import events_of, longest_sample, sample_run
from dynkit.systems.impact.simulation.state import SHEET, ImpactState, phases, put_on
from dynkit.systems.impact.simulation.trajectory import Ending, Events, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.energy_balance import EnergyBalance
    from dynkit.systems.impact.records.second_moments import SecondMoments


# Twin runs for the error, the size of their disturbances in units of 2^-52, and the factor on the
# distance they reach.
_TWINS, _DISTURBANCE, _SAFETY = 3, 8.0, 4.0

# A twin's search for an event may take so many cells, and so many for every cell of the whole run.
_LEAST_CELLS, _CELLS_OF_TWINS = 10_000, 64

# Numbers of a batch of states, of which some thirty arrays exist at once: 60 MB. Seconds after
# which a bar appears.
_NUMBERS, _QUIET = 1 << 18, 2.0


def twin_errors(
    system: ImpactMap, whole: Trajectory, batches: Iterable[ImpactRecord], count: int
) -> Iterator[Array]:
    """Errors of impacts, in the batches in which their records come; see `ImpactRecord.error`.

    A bar on standard error shows how far it is, where that takes long.
    """
    noise = _DISTURBANCE * 2.0**-52
    # Where a twin rests within rounding of the table it need not be decided when it leaves.
    most_cells = min(MOST_CELLS, _LEAST_CELLS + _CELLS_OF_TWINS * whole.cells)
    twins = [
        Course(
            system,
            whole.start,
            noise=noise,
            seed=seed,
            most_cells=most_cells,
            longest=whole.longest,
        )
        for seed in range(1, _TWINS + 1)
    ]
    with ExitStack() as stack:
        bar: Any = None
        if count > batch_size(system):
            from tqdm import tqdm

            bar = stack.enter_context(
                tqdm(total=count, desc="error", unit="impact", file=sys.stderr, delay=_QUIET)
            )
        for batch in batches:
            worst = 2.0**-52 * abs(batch.states).max(axis=1, initial=0.0)
            for twin in twins:
                _compare(batch, twin, worst)
            yield _SAFETY * worst
            if bar is not None:
                bar.update(len(batch))


def _compare(batch: ImpactRecord, twin: Course, worst: Array) -> None:
    """Take a twin on by as many impacts; the largest distances, (n,), are modified in place."""
    # One that has ended has no further impacts.
    more = len(batch) if twin.ending is Ending.COUNT_REACHED else 0
    other = ImpactRecord(batch.system, batch._run.holding(twin.advance(more, store=True)))
    system, k = batch.system, len(other)
    gap = abs(system.difference(other.states, batch.states[:k])).max(axis=1, initial=0.0)
    # Phases that are turns apart may look alike; what rounding of the times hides does not.
    late = abs(other.time - batch.time[:k]) - 2.0**-51 * batch.time[:k]
    angle = system.frequency * late
    gap = np.where(angle > math.pi, np.maximum(gap, angle), gap)
    worst[:k] = np.maximum(worst[:k], gap)
    worst[k:] = np.inf


def batch_size(system: ImpactMap) -> int:
    """Impacts of a batch."""
    return max(_NUMBERS // (2 * system.degrees_of_freedom + 4), 1)


@final
class ImpactRecord(Result):
    """The impacts of one simulation, and the motion between them.

    All quantities are dimensionless. Arrays are worked out when asked for, from some 2N + 8 stored
    numbers per impact.
    """

    def __init__(self, system: ImpactMap, run: Trajectory) -> None:
        self.system = system
        self._run = run
        for array in (run.log.time, run.log.speed, run.log.states):
            array.setflags(write=False)

    @property
    def start(self) -> ImpactState:
        """Where it began."""
        return self._run.start

    @property
    def final(self) -> ImpactState:
        """The state after the last event; simulating on from it goes on bit for bit."""
        return self._run.final

    @property
    def ending(self) -> Ending:
        """Why it ended."""
        return self._run.ending

    def __len__(self) -> int:
        return self._run.impacts

    def __repr__(self) -> str:
        events = f"{len(self)} impacts, {len(self.sticking)} contacts"
        if self.system._strobed:
            events = f"{len(self)} periods"
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
        """Rate (n,) of the gap just after the impacts; negative on the far side of a play.

        NaN without a hard stop.
        """
        return self._run.relative_velocity

    @property
    def phase(self) -> Array:
        """Phase of the table at the impacts, (n,), in [0, 2 pi)."""
        return phases(*self._run.coordinates[1:])

    @cached_property
    def position(self) -> Array:
        """Positions (n, N) at the impacts."""
        return self._motion[0]

    @cached_property
    def velocity(self) -> Array:
        """Velocities (n, N) just after the impacts."""
        return self._motion[1]

    @cached_property
    def _motion(self) -> tuple[Array, Array]:
        """Positions and velocities (n, N), on the stops that are touched.

        Their coordinates may be differences of numbers that are much larger.
        """
        run, forced = self._run, self.system._free.forced
        q, sine, cosine = run.coordinates
        x, v = forced.positions(q, sine, cosine), forced.velocities(q, sine, cosine)
        for number in np.unique(run.log.guard).tolist() if self.system._stops else ():
            (here,) = np.nonzero(run.log.guard == number)
            element, closed = run.guards[number, 1], run.closed(number)
            some, turn = (x[here], v[here]), (sine[here], cosine[here])
            put_on(self.system, element, closed, some, *turn, run.log.speed[here])
            x[here], v[here] = some
        return x, v

    @cached_property
    def energy(self) -> Array:
        """Kinetic plus elastic energy (n,) of the structure just after the impacts."""
        system, energy, size = self.system, np.empty(len(self)), batch_size(self.system)
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
        """Section coordinates (n, 2N - 1) without the phase, or all where that does not change."""
        if self.system._strobed:
            return np.concatenate([self.position, self.velocity], axis=1)
        others = np.array([contact.others for contact in self.system._contacts])
        if not self.system._several:
            kept: Any = np.s_[:, others[0]]
        else:
            kept = np.arange(len(self))[:, None], others[self._run.element]
        parts = [self.position[kept], self.velocity[kept], self.relative_velocity[:, None]]
        return np.concatenate(parts, axis=1)

    @cached_property
    def events(self) -> Events:
        """Impacts, contacts and releases in their order.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> ImpactChain(frequency=0.408).simulate(impacts=300).events
        <Events: 300 impacts, 4 contacts, 4 releases>
        """
        return events_of(self.system, self._run)

    @property
    def sticking(self) -> Array:
        """Begin and end (k, 2) of the contact intervals; infinite for contact for ever."""
        return self._run.contacts

    @property
    def ambiguous(self) -> int | None:
        """Number of the first impact whose outcome is a choice of law, None where there is none.

        It pushed against a stop that was in contact, or happened together with another one whose
        gap it changes: what Newton's law with complementarity (Moreau) makes of it depends on the
        order, and others give other outcomes. From it on `error` is infinite.
        """
        return None if self._run.ambiguous < 0 else self._run.ambiguous

    @property
    def element(self) -> Any:
        """With which stop each impact was, (n,): see `ImpactState`; -1 where there is none."""
        return np.full(len(self), -1) if self.system._strobed else self._run.element

    @property
    def chatter_error(self) -> float:
        """Sum of what replacing the rests of chatters by contact changed, to leading order.

        Of each it is the largest change of a position or velocity as contact begins, which goes
        with the cube of the velocity of the last bounce; it counts the others, as the contact mass
        is on the table then. The true change is at most twice as large,
        and hardly larger where that velocity is small. What the motion then makes of it, and the
        times of the release and of impacts, is part of `error`.
        """
        return self._run.chatter_error

    @property
    def cost(self) -> Cost:
        """Seconds; impacts, cells of the search, contacts, touches (impacts at a double root)."""
        run = self._run
        counts = {
            "impacts": run.impacts,
            "cells": run.cells,
            "contacts": len(run.before),
            "touches": run.touches,
        }
        return Cost(run.seconds, counts)

    @cached_property
    def error(self) -> Array:
        """Estimate of the largest error of the section coordinates of each impact, (n,).

        The run is repeated three times with pseudo-random disturbances at the start and after every
        impact, and of what cut chatters leave out. They are 8 * 2^-52 of every number, and a
        quarter of a last digit of what it becomes in the flight: many times what rounding does. The
        estimate is four times the largest distance reached so far, or the rounding of the largest
        coordinate.
        On a stable motion it stays near 1e-14; in chaos it grows to the
        size of the attractor, and says when single states have become meaningless.
        Where a twin has fewer impacts, or cannot be told to leave the table or not, it is infinite.
        The times are off by this over the frequency, besides their own rounding: what may be turns
        of the table counts with all its turns.

        References
        ----------
        J. Vignes, Mathematics and Computers in Simulation 35 (1993) 233-261 (stochastic
        arithmetic).
        """
        worst, done = np.empty(len(self)), 0
        for part in twin_errors(self.system, self._run, self._batches(), len(self)):
            worst[done : done + len(part)] = part
            done += len(part)
        if self.ambiguous is not None:
            worst[self.ambiguous :] = np.inf
        return np.maximum.accumulate(worst, out=worst)

    def _batches(self) -> Iterator[ImpactRecord]:
        """The record in successive parts, whose arrays need not exist at once."""
        size = batch_size(self.system)
        for low in range(0, len(self), size):
            yield ImpactRecord(self.system, self._run.part(low, low + size))

    def _until(self, last: int) -> ImpactRecord:
        """The record up to an impact; its ending, final state and cost stay those of the whole."""
        return ImpactRecord(self.system, self._run.part(0, last + 1))

    def sample(self, times: object) -> tuple[Array, Array]:
        """Positions and velocities at given times, exact between impacts and while stuck.

        At the time of an impact the state just after it is given. In the rest of a chatter that was
        replaced by contact the contact mass follows the bounces to leading order: its place is then
        off by a thousand times the `chatter_tolerance` at most.

        Parameters
        ----------
        times : (k,) array_like
            Times from the start, in any order, not beyond the last impact, or last event where no
            impact was found. When the simulation ended by itself, up to millions of periods.

        Returns
        -------
        position, velocity : (k, N) arrays

        Raises
        ------
        ValueError
            When a time is not finite, negative, or beyond what was simulated.
        """
        asked = finite_array("times", times, (None,))
        last = longest_sample(self.system, self._run)
        if self.ending is Ending.COUNT_REACHED:
            last = float(self.time[-1]) if len(self) else 0.0
        elif self.ending in (Ending.SEARCH_LIMIT, Ending.JAMMED, Ending.COLLAPSED):
            last = self._run.duration
        for i in np.flatnonzero((asked < 0.0) | (asked > last))[:1].tolist():
            raise ValueError(f"times[{i}] must lie in [0, {last}]; got {float(asked[i])}")
        return sample_run(self.system, self._run, asked)

    def plot(self, ax: Axes | None = None, element: str | None = None) -> Axes:
        """Draw what an element acts along against time, its stops dashed, its impacts as dots.

        Shaded while what acts along it is in contact, or presses; hatched while friction sticks.
        From the start to the last impact, but no more than 1000 periods of the forcing; two periods
        more, and 12 at least, where the simulation ended by itself.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; by default a new figure of column width.
        element : str, optional
            Its name, or ``"elements[k]"``; by default the first hard stop, or the first element.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When no element has this name.
        """
        from dynkit.systems.impact.records.drawing import draw, shade, shown_until
        from dynkit.systems.impact.records.event_counts import element_names

        system, names = self.system, element_names(self.system)
        chosen = names[0] if element is None else one_of("element", element, names)
        along = system._elements[names.index(chosen)]
        end = shown_until(2.0 * math.pi / system.frequency, self.time, self.ending)
        hit = [stop.coordinate == along.coordinate for stop in system._elements]
        impacts = np.empty(0)
        if not system._strobed:
            impacts = self.time[np.array(hit)[self.element] & (self.time <= end)]
        axes = draw(ax, system, self.sample, self.start.phase, end, impacts, along)
        shade(axes, self._run, along, end)
        return axes

    def dataset(self) -> Dataset:
        """Return the impacts and contacts as a dataset; its time counts from the start.

        Dimensions are ``impact``, ``mass`` (the coordinates, from 1) and ``contact``. The `error`,
        which simulates, is in it when it was asked for before.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> found = ImpactChain(masses=2, frequency=0.9).simulate(impacts=5).to_xarray()
        >>> found.position.dims, found.attrs["parameter_restitution"]
        (('impact', 'mass'), 0.85)
        """
        n, each = self.system.degrees_of_freedom, "impact"
        begins, ends = self.sticking.T
        return Dataset(
            {"time": (each, self.time), "mass": ("mass", np.arange(1, n + 1))},
            {
                "relative_velocity": (each, self.relative_velocity),
                "element": (each, self.element),
                "phase": (each, self.phase),
                "energy": (each, self.energy),
                "position": ((each, "mass"), self.position),
                "velocity": ((each, "mass"), self.velocity),
                "contact_begin": ("contact", begins),
                "contact_end": ("contact", ends),
                **known_error(self, each),
            },
            described(
                "Impacts of a motion",
                cost=self.cost,
                error="estimate of the largest error of the section coordinates up to each impact",
                system=self.system,
                ending=self.ending.value,
                chatter_error=self.chatter_error,
            ),
        )

    def as_attractor(self) -> Any:
        """Return the recorded impacts as an `ImpactAttractor` whose transient is zero.

        So measures of attractors take records. Whether the motion has settled, its `label` says.
        """
        return self.system._attractor_of(self)

    def energy_balance(self) -> EnergyBalance:
        """Work done on the structure and energy dissipated, by forces, dashpots and each element.

        From the start to the last impact. It closes but for rounding: a check of the motion.

        Raises
        ------
        ValueError
            When there is no impact, no time passes, or modes are so fast that it would take more
            than some millions of nodes of quadrature.

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

    def second_moments(self, batches: int = 32) -> SecondMoments:
        """Time averages of positions and of their products, in closed form.

        From the start to the last impact: over flights, chatter and contact.

        Parameters
        ----------
        batches : int
            Into how many batches of successive impacts to divide them; as many as impacts when
            these are fewer.

        Raises
        ------
        ValueError
            When there is no impact, or no time passes.
        """
        from dynkit.systems.impact.records.second_moments import second_moments

        count = min(positive_integer("batches", batches), len(self))
        if not (count and self.time[-1] > 0.0):
            raise ValueError(f"record must hold an impact after its start; got {self!r}")
        return second_moments(self.system, self._run, count)
