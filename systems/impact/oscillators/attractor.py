"""Attractors of impact oscillators."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property, copied
from dynkit.core.no_motion import NoCrossing, NoDerivative, TangentCrossing
from dynkit.core.reprs import Facts
from dynkit.core.validation import Array, finite_array
from dynkit.data.dataset import Dataset
from dynkit.data.result import SavedWithSystem
from dynkit.dynamics.attractor import Attractor
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.labels.labelling import (
    UNKNOWN,
    Window,
    attraction,
    label_orbit,
    settled_label,
    with_multiplier,
)
from dynkit.orbits.harmonics import harmonics_needed
from dynkit.plotting.points import PHASE, RELATIVE_VELOCITY, displacement, draw_points
from dynkit.systems.impact.records.drawing import shown_until
from dynkit.systems.impact.records.event_counts import event_counts
from dynkit.systems.impact.records.record import ImpactRecord, batch_size, twin_errors
from dynkit.systems.impact.records.viewing import PERIODS, series_of
from dynkit.systems.impact.simulation.runs import course_from
from dynkit.systems.impact.simulation.state import ImpactState
from dynkit.systems.impact.simulation.trajectory import Ending, Trajectory
from dynkit.systems.impact.variational.tangents import growth, returned, settles
from dynkit.viewer.series import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.problem import PeriodicOrbit
    from dynkit.systems.impact.impact_map import ImpactMap
    from dynkit.systems.impact.records.second_moments import SecondMoments

TWO_PI = 2.0 * math.pi

# Number of samples with which harmonics are first computed: at least this number in total, and this
# number for each period of the table.
_SAMPLES, _A_PERIOD = 512, 64

MOST_NUMBERS = 1 << 27
"""Largest size of a record that is extended to a late time, in doubles: a gigabyte."""
# Releases are a period apart if their distance in time differs from a period by less than this part
# of it. A motion whose label was decided at the end of the budget is within a hundredth of its
# orbit.
_RETURN = 1e-2

# Number of disturbed runs for the error, relative size of the disturbances, and factor on their
# largest distance, as for `ImpactRecord.error`; factor on the distance of the motion to its orbit.
_TWINS, _NOISE, _SAFETY, _SETTLING = 3, 2.0**-49, 4.0, 2.0

_GOES_ON = Ending.NO_FURTHER_CONTACT, Ending.CONTACT_FOR_EVER, Ending.REPEATS, Ending.SEARCH_LIMIT
"""Endings of motions that continue without impacts."""


@final
class ImpactAttractor(Attractor, SavedWithSystem):
    """The motion of an impact oscillator after a transient, made by `ImpactOscillator.attractor`.

    Attributes
    ----------
    record : ImpactRecord
        The kept impacts; times count from the last skipped impact.
    final : ImpactState
        The state after the last impact.
    """

    _stored: ClassVar = ("_transient", "record", "_before")
    _stored_if_known: ClassVar = ("error",)
    _given: ClassVar = "_system"
    _system: ImpactMap
    _transient: int
    record: ImpactRecord
    _before: Trajectory | None

    def __init__(
        self,
        system: ImpactMap,
        transient: int,
        record: ImpactRecord,
        before: Trajectory | None,
    ) -> None:
        self._system = system
        self._transient = transient
        self._before = before
        self.record = self._longest = record

    def _restored(self) -> Self:
        skipped = self._before.impacts if self._before else 0
        if not 0 <= skipped <= self._transient:
            raise ValueError(f"{skipped} impacts before a transient of {self._transient}")
        self._longest = self.record
        return self

    @property
    def system(self) -> ImpactMap:
        return self._system

    @property
    def transient(self) -> int:
        return self._transient

    @property
    def final(self) -> ImpactState:
        """The state after the last impact."""
        return self.record.final

    @property
    def duration(self) -> float:
        """Time of the last impact."""
        return float(self.record.time[-1]) if len(self.record) else 0.0

    @property
    def ending(self) -> Ending:
        """Why the simulation ended; if by itself, fewer impacts are kept than were asked for."""
        return self.record.ending

    @property
    def _kept(self) -> int:
        return len(self.record)

    def _facts(self) -> Facts:
        contacts = len(self.record.sticking)
        return {**super()._facts(), "contacts": contacts, "ending": self.ending.value}

    def observable(self, name: str) -> Array:
        """Return one of the system's `observables` at the kept impacts, (n,)."""
        return self.record.observable(name)

    @cached_property
    def states(self) -> Array:
        """Section coordinates of the kept impacts, (n, 2N): see `ImpactOscillator`."""
        states = self.record.states
        states.setflags(write=False)
        return states

    @property
    def cost(self) -> Cost:
        counts, seconds = self.record._run.counts, self.record._run.seconds
        if self._before is not None:
            seconds += self._before.seconds
            counts = {name: n + counts[name] for name, n in self._before.counts.items()}
        return Cost(seconds, counts)

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the kept states, including errors from the transient."""
        if self._before is None:
            return float(self.record.error.max(initial=0.0))
        count = self._before.impacts + len(self.record)
        before, kept = self._before, self.record._run
        longest = max(before.longest, kept.longest)
        if max(before.ambiguous, kept.ambiguous) >= 0:
            return math.inf
        whole = replace(before, cells=before.cells + kept.cells, longest=longest)
        parts = twin_errors(self._system, whole, self._anew(whole, count), count)
        return max((float(part.max()) for part in parts), default=0.0)

    def _anew(self, whole: Trajectory, count: int) -> Iterator[ImpactRecord]:
        """All impacts from the start of the transient on, simulated again, in batches."""
        course = course_from(self._system, whole.start)
        size = batch_size(self._system)
        for low in range(0, count, size):
            log = course.advance(min(size, count - low), store=True)
            yield ImpactRecord(self._system, whole.holding(log))

    @cached_property
    def label(self) -> OrbitLabel:
        orbit = _ImpactOrbit(self.record)
        return orbit.named(label_orbit(orbit, kept=max(len(self.record), 1)))

    def label_within(self, budget: int) -> OrbitLabel:
        """Return the label decided from at most `budget` impacts besides the kept ones."""
        orbit, kept = _ImpactOrbit(self.record), max(len(self.record), 1)
        return orbit.named(label_orbit(orbit, kept=kept, budget=budget))

    @property
    def _stays(self) -> bool:
        return settles(self._system, self.record._run)

    def settled_label(self, budget: int = 100_000) -> OrbitLabel:
        """Return the label of the motion after it has settled, even if a chaotic transient is long.

        At most `budget` impacts are examined besides the kept ones: see
        `dynkit.labels.labelling.settled_label`.

        Examples
        --------
        >>> from dynkit.systems import ImpactChain
        >>> print(ImpactChain(frequency=0.35).attractor().settled_label().kind.value)
        periodic
        """
        orbit, kept = _ImpactOrbit(self.record), max(len(self.record), 1)
        return orbit.named(settled_label(orbit, kept=kept, budget=budget))

    def periodic_orbit(self) -> PeriodicOrbit:
        """Return the periodic orbit of this attractor, refined by Newton's method.

        Returns
        -------
        ImpactOrbit
            Or a `MapOrbit` if an element is not supported by the equations of itineraries: see
            `ImpactOscillator.periodic_orbit`.

        Raises
        ------
        ValueError
            When the attractor is neither P(n,m) nor P(inf,m), nor a cycle of an undriven machine,
            nor P(0,1), a motion of a driven machine without further impacts.
        NoConvergence
            When the motion is still too far from the orbit, or when the orbit belongs to a family,
            for example because a slider of a `Jenkins` element never slips.
        NotImplementedError
            When a mass rests on a preloaded stop; `dynkit.periodic_orbit` finds orbits of the map.
        """
        from dynkit.systems.impact.orbits.finding import orbit_of_motion, sticking_orbit_of
        from dynkit.systems.impact.orbits.itineraries.finding import orbit_near

        if self._system._own and not self._system._excitation.turns:
            return orbit_near(self._system, self.final, 1)
        n, m = self.label.iterates, self.label.periods
        rest = max(self.label.simulated - len(self.record), 0)  # impacts until it settled
        if self.label.kind is OrbitKind.NO_IMPACTS:
            last = self._system.simulate(impacts=rest + 1, start=self.final)
            if last.ending in _GOES_ON and self._system._excitation.turns:
                return orbit_near(self._system, last.final, 1)
        if n is m is None:
            raise ValueError(f"attractor must be P(n,m) or P(inf,m); its label is '{self.label}'")
        if n is None:
            assert m is not None
            return sticking_orbit_of(self._system, self.final, m)
        record = self._system.attractor(transient=rest, impacts=n, start=self.final).record
        if m is None or not self._system._table_alone:
            return orbit_near(self._system, record.final, m or 1)
        return orbit_of_motion(record, n, m)

    def dataset(self) -> Dataset:
        """Return the kept impacts and contacts as a dataset: see `ImpactRecord.dataset`."""
        return self.record.dataset()

    def second_moments(self, batches: int | Sequence[int] = 32) -> SecondMoments:
        """Time averages over the kept impacts: see `ImpactRecord.second_moments`."""
        return self.record.second_moments(batches)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the section: relative velocity after the kept impacts against phase.

        Without a hard stop, draw velocity against position of the last coordinate at the section.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on; by default a new figure of column width.

        Returns
        -------
        Axes
        """
        if self._system._strobed:
            own = np.stack([self.record.position[:, -1], self.record.velocity[:, -1]], axis=1)
            n = self._system.degrees_of_freedom
            return draw_points(ax, own, (displacement(n - 1), f"velocity $v_{{{n}}}$"))
        points = np.stack([self.record.phase, self.record.relative_velocity], axis=1)
        return draw_points(ax, points, (PHASE, RELATIVE_VELOCITY))

    def time_series(self, times: Array) -> Array:
        """Positions and velocities, (k, 2N), at times since the last skipped impact."""
        asked = finite_array("times", times, (None,))
        record = self.record_until(float(asked.max(initial=0.0)))
        return np.concatenate(record.sample(asked), axis=1)

    def _series(self) -> Series:
        turn = TWO_PI / self._system.frequency
        end = self.label.period or PERIODS * turn
        record = self.record_until(end)
        if record.ending is not Ending.COUNT_REACHED:
            end = min(end, shown_until(turn, record._run))
        impacts = np.empty(0) if self._system._strobed else record.time
        return series_of(self._system, record.sample, record.start.phase, end, impacts)

    def record_until(self, latest: float) -> ImpactRecord:
        """Return the record of the kept impacts, extended to reach a given time.

        Raises
        ------
        ValueError
            When the extended record would exceed a gigabyte.
        """
        record, count = self._longest, len(self._longest)
        most = MOST_NUMBERS // (2 * self._system.degrees_of_freedom + 4)
        while record.ending is Ending.COUNT_REACHED and record.time[-1] < latest:
            ended = float(record.time[-1])
            if 2 * count > most or latest * len(record) > most * ended > 0.0:
                raise ValueError(
                    f"times must not exceed {most / count * ended:.3g}, or {most} impacts after "
                    f"the transient; got {latest}"
                )
            count *= 2
            record = self._system.simulate(impacts=count, start=record.start)
            self._longest = record  # later calls start from the longest record
        return record


class _ImpactOrbit:
    """The motion of an impact oscillator in the form that `label_orbit` requires."""

    def __init__(self, record: ImpactRecord) -> None:
        self.system = record.system
        self.accuracy = record.system.accuracy
        self.record: ImpactRecord = record
        self.ahead: ImpactRecord | None = None
        self.fresh = True
        self.clock = 0.0

    def more(self, count: int) -> Window:
        if not self.fresh:
            self.clock += float(self.record.time[-1])
            self.record = self._next(count)
        self.fresh = False
        record = self.record
        period, states = TWO_PI / self.system.frequency, record._without_phase
        if self.system._progression.shift.size:
            states = self.system.without_shift(record.states)[:, : states.shape[1]]
        releases = release_times = release_error = None
        after = _after_releases(record)
        if len(after):
            releases = states[after]
            release_times = (self.clock + record.time[after]) / period

            def release_error(n: int, size: float) -> float:
                return float(record._until(int(after[n]))._error_in(size)[-1])

        times = None if self.system._cycled else (self.clock + record.time) / period
        if self.system._several:
            states = np.column_stack([states, record.element])

        def attracts(n: int, periods: int | None) -> tuple[float, bool]:
            found = self._derivatives(None if len(after) else n, periods)
            return UNKNOWN if found is None else attraction(*found, self.accuracy)

        given_up = record.ending is Ending.SEARCH_LIMIT
        of_releases = releases, release_times, release_error
        return Window(states, times, *of_releases, given_up, attraction=attracts)

    def _next(self, count: int) -> ImpactRecord:
        """The record of the next impacts; it is kept, since `growth` may need it before `more`."""
        known, start = self.ahead, self.record.final
        if known is None or (len(known), known.start) != (count, start):
            self.ahead = known = self.system.simulate(impacts=count, start=start)
        return known

    def difference(self, a: Array, b: Array) -> Array:
        return np.asarray(a - b)

    def growth(self, steps: int) -> Array:
        if not self.system._mapped:
            ahead = self._next(steps)
            whole = len(ahead) == steps
            return growth(self.system, ahead._run) if whole else np.full(steps, -np.inf)
        try:
            return self.system.stretching(self.record.states[-1], steps).logs[:, 0]
        except NoCrossing:
            return np.full(steps, -np.inf)
        except (NoDerivative, TangentCrossing):
            return np.full(steps, np.nan)

    def named(self, label: OrbitLabel) -> OrbitLabel:
        """Return the label with its multiplier, and functions for period, counts and harmonics."""
        if label.kind not in (OrbitKind.PERIODIC, OrbitKind.STICKING):
            return label
        label = self._with_multiplier(label)
        if label.kind is OrbitKind.UNSETTLED:
            return label
        here = self.system, self.record.final, label
        return copied(
            label,
            measure_period=partial(period_of, *here),
            count_harmonics=partial(_harmonics, *here),
            count_events=partial(_counts, *here),
        )

    def _with_multiplier(self, label: OrbitLabel) -> OrbitLabel:
        found = self._derivatives(label.iterates, label.periods)
        return label if found is None else with_multiplier(label, *found, self.accuracy)

    def _derivatives(self, n: int | None, m: int | None) -> tuple[Array, Array] | None:
        """Derivatives over the last period of n impacts or m periods, and the one before it.

        None where the motion has no derivative or does not return, or the record no two periods.
        """
        impacts = self._a_period_apart(n, m)
        if impacts is None:
            return None
        moves = self.system._progression.shift.size > 0
        if self.system._mapped or moves:
            states, found = self.record.states[impacts[0] : impacts[2]], list[Array]()
            here = states[0]
            try:
                while len(found) < len(states):
                    here, factors, _ = self.system._followed(here, len(states) - len(found))
                    found += [factor for (factor,), *_ in factors]
            except (NoCrossing, NoDerivative, TangentCrossing):
                return None
            if moves:
                begin = [self.system._progression_at(state).across for state in states]
                end = [*begin[1:], begin[0]]
                found = [b.T @ f @ a for a, f, b in zip(begin, found, end, strict=True)]
            before, last = np.split(np.array(found), [impacts[1] - impacts[0]])
        else:
            before, last = returned(self.system, self.record._run, impacts)[:, None]
        return last, before

    def _a_period_apart(self, n: int | None, m: int | None) -> list[int] | None:
        """Indices of three impacts of the record, one period apart; None if there are none."""
        record = self.record
        if n is not None:
            k = len(record) - 1
            return [k - 2 * n, k - n, k]
        after = _after_releases(record)
        if not len(after):
            return None
        period = TWO_PI / self.system.frequency * (m or 1)
        ago = (record.time[after[-1]] - record.time[after]) / period
        near = [int(np.argmin(abs(ago - periods))) for periods in (2.0, 1.0, 0.0)]
        # The number of releases in a period is unknown: the nearest release may be another one.
        there = np.max(abs(ago[near] - [2.0, 1.0, 0.0])) < _RETURN
        return after[near].tolist() if there else None


def _after_releases(record: ImpactRecord) -> Any:
    """Index of the next impact after each release; the release determines this impact."""
    if not len(record.sticking):
        return np.empty(0, dtype=np.intp)
    ends = record.sticking[np.isfinite(record.sticking[:, 1]), 1]
    after = np.searchsorted(record.time, np.sort(ends))
    return after[after < len(record)]


def period_of(system: ImpactMap, start: ImpactState, label: OrbitLabel) -> tuple[float, float]:
    """The period of a periodic motion, and an estimate of its error, from a state on its section.

    For an undriven machine two periods are simulated. The error is the sum of two estimates. The
    effect of rounding is estimated from disturbed runs. The distance of the motion to its orbit is
    the change from the first to the second period, summed over all later periods.
    """
    if label.periods is not None:
        length = label.periods * TWO_PI / system.frequency
        return length, 2.0**-52 * length
    n = label.iterates or 1

    def twice(noise: float, seed: int) -> tuple[float, float]:
        course = course_from(system, start, noise=noise, seed=seed)
        times = course.advance(2 * n, store=True).time
        return float(times[n - 1]), float(times[2 * n - 1] - times[n - 1])

    own = twice(0.0, 1)
    apart = abs(np.subtract([twice(_NOISE, seed) for seed in range(1, _TWINS + 1)], own)).max()
    change, left = abs(own[1] - own[0]), 1.0 - label.multiplier
    if label.stable:
        change *= _SETTLING / min(left, 1.0)
    return own[0], _SAFETY * float(apart) + change + 2.0**-51 * own[0]


def _counts(system: ImpactMap, start: ImpactState, label: OrbitLabel) -> Any:
    """Counts of events in one period of a periodic motion, from a state on it."""
    return event_counts(system, start, period_of(system, start, label)[0])


def _harmonics(system: ImpactMap, start: ImpactState, label: OrbitLabel) -> int:
    """Number of harmonics needed for the contact coordinate of a periodic motion.

    If the machine progresses, its mean velocity is subtracted first.
    """
    motion = ImpactAttractor(system, 0, system.simulate(impacts=1, start=start), None)
    samples = max(_SAMPLES, 2 ** math.ceil(math.log2(_A_PERIOD * (label.periods or 1))))
    coordinate = system.contact % system.degrees_of_freedom
    period, speed = period_of(system, start, label)[0], 0.0
    if system._progression.shift.size:
        begin, end = motion.time_series(np.array([0.0, period]))[:, coordinate]
        speed = float(end - begin) / period
    return harmonics_needed(
        lambda times: motion.time_series(times)[:, coordinate] - speed * times, period, samples
    )
