"""Stroboscopic sections and impact sections of motions."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from dynkit.analysis.motions import Motion, checked_index
from dynkit.core.angles import in_turn
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array, finite_array, finite_scalar, positive_integer, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.plotting.figures import ink, print_style
from dynkit.plotting.points import PHASE, RELATIVE_VELOCITY, draw_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
class StroboscopicSection(Saved):
    """States of a driven motion once in every period of the forcing, at one phase.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (p, d) array_like
        An attractor is sampled exactly; an array contains the states of the section.
    phase : float
        Phase of the table, modulo 2 pi.
    periods : int, optional
        Number of states of an attractor; by default those up to its last kept impact.

    Attributes
    ----------
    phase : float
        In [0, 2 pi).
    times : (p,) array
        Times of the states since the last skipped state; empty for an array.
    states : (p, d) array
    cost : Cost
        Seconds and states.

    Raises
    ------
    ValueError
        When a number is not finite, the system is not driven, or the motion too short.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> section = StroboscopicSection(ImpactChain(frequency=0.87).attractor(), periods=9)
    >>> len(np.unique(section.states[:, 9].round(6)))  # P(1,3): three points
    3
    """

    def __init__(self, source: object, *, phase: float = 0.0, periods: int | None = None) -> None:
        began = time.perf_counter()
        self.phase = float(in_turn(finite_scalar("phase", phase)))
        motion = self._motion = Motion.of(source)
        self._default = 0, 1
        if motion is not None:
            self.times = read_only(_strobe_times(motion, self.phase, periods))
            self.states = read_only(motion.attractor.time_series(self.times))
            d = self.states.shape[1]
            self._names = tuple(map(motion.name_of, range(d)))
            if motion.has_masses:
                self._default = motion.contact, motion.contact + d // 2
        else:
            if periods is not None:
                raise ValueError(f"periods must be left out with an array; got {periods!r}")
            self.times, self.states = read_only(np.empty(0)), _given(source)
            self._names = tuple(f"coordinate {k}" for k in range(self.states.shape[1]))
        self.cost = Cost(time.perf_counter() - began, {"states": len(self.states)})

    _stored: ClassVar = ("phase", "times", "states", "cost", "error", "_names", "_default")
    phase: float
    times: Array
    states: Array
    cost: Cost
    _names: tuple[str, ...]
    _default: tuple[int, int]

    def dataset(self) -> Dataset:
        """Return the states as a dataset; there are no times for an array."""
        times = {"time": ("state", self.times)} if len(self.times) else {}
        return Dataset(
            times,
            {"coordinate": (("state", "coordinate"), self.states)},
            described(
                f"Stroboscopic section at phase {self.phase:.6g}",
                cost=self.cost,
                error="estimate of the largest error of the states",
                state_error=self.error,
            ),
        )

    def __repr__(self) -> str:
        return f"<StroboscopicSection: {len(self.states)} states at phase {self.phase:.6g}>"

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the states; zero for an array."""
        return 0.0 if self._motion is None else self._motion.error_until(self.times)

    def plot(self, ax: Axes | None = None, *, coordinates: tuple[int, int] | None = None) -> Axes:
        """Draw one coordinate of the states against another.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        coordinates : (int, int), optional
            Horizontal and vertical coordinate, as for `TimeSeries`; by default position and
            velocity of the contact coordinate, for an array the first two.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        chosen = _chosen(coordinates, self._default, self.states.shape[1])
        return draw_points(ax, self.states[:, chosen], [self._names[k] for k in chosen])


@final
class ImpactSection(Saved):
    """States of a motion just after its impacts.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (n, d) array_like
        For an attractor of impacts the states are those kept. The last two columns of an array are
        relative velocity and phase.

    Attributes
    ----------
    states : (n, d) array
        Section coordinates: relative velocity and phase come last.
    cost : Cost
        Seconds and number of states, without the cost of the attractor.

    Raises
    ------
    ValueError
        When a number is not finite, or the motion has no impacts.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, figures 8, 10 and 12.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> section = ImpactSection(ImpactChain(frequency=0.87).attractor())
    >>> len(np.unique(section.relative_velocity.round(6)))  # P(1,3): one point
    1
    """

    def __init__(self, source: object) -> None:
        began = time.perf_counter()
        motion = self._motion = Motion.of(source)
        self._table = None
        if motion is not None:
            system = motion.system
            if not motion.has_masses or not system._stops:
                raise ValueError(f"source must be a motion with impacts; got {system!r}")
            self.states = motion.attractor.states
            if motion.table is not None and not system._several:
                w, stop = system.frequency, motion.table
                rates = float(stop.swing_rate(w, 1.0, 0.0)), float(stop.swing_rate(w, 0.0, 1.0))
                self._table = stop.coordinate % system.degrees_of_freedom, *rates, stop.sign
        else:
            self.states = _given(source)
        if not len(self.states):
            raise ValueError("source must hold an impact or more; got 0")
        self.cost = Cost(time.perf_counter() - began, {"states": len(self.states)})

    _stored: ClassVar = ("states", "cost", "error", "_table")
    states: Array
    cost: Cost
    _table: tuple[int, float, float, float] | None

    def dataset(self) -> Dataset:
        """Return the impacts as a dataset over ``impact``."""
        return Dataset(
            {},
            {
                "phase": ("impact", self.phase),
                "relative_velocity": ("impact", self.relative_velocity),
                "coordinate": (("impact", "coordinate"), self.states[:, :-2]),
            },
            described(
                "Impacts in the section of the table",
                cost=self.cost,
                error="estimate of the largest error of the states",
                state_error=self.error,
            ),
        )

    @property
    def relative_velocity(self) -> Array:
        """Relative velocities just after the impacts, (n,)."""
        return self.states[:, -2]

    @property
    def phase(self) -> Array:
        """Phases of the forcing at the impacts, (n,), below 2 pi."""
        return in_turn(self.states[:, -1])  # with 4 pi times the number of the stop

    def __repr__(self) -> str:
        return f"<ImpactSection: {len(self.states)} impacts>"

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the states; zero for an array."""
        return 0.0 if self._motion is None else self._motion.attractor.error

    @print_style()
    def plot_velocity(self, ax: Axes | None = None) -> Axes:
        """Draw the velocity of the contact coordinate after impacts against the phase.

        The dashed curve is the velocity of the table. Points lie above it by the relative velocity,
        or below it for a stop from above, such as the second stop of a play.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When the source is an array, for which the motion of the table is not known, or a motion
            with more than one stop, or with a stop that acts on more than one coordinate.
        """
        if self._table is None:
            got = "an array" if self._motion is None else repr(self._motion.system)
            raise ValueError(
                f"source must be an attractor to draw velocities, with one stop; got {got}"
            )
        contact, by_sine, by_cosine, sign = self._table
        name = f"velocity $v_{{{contact + 1}}}$ after impact"

        def table(phase: Array) -> Array:
            return np.asarray(by_sine * np.sin(phase) + by_cosine * np.cos(phase))

        velocity = table(self.phase) + sign * self.relative_velocity
        axes = draw_points(ax, np.stack([self.phase, velocity], axis=1), (PHASE, name))
        turn = np.linspace(0.0, math.tau, 257)
        axes.plot(turn, table(turn), "--", color=ink(), linewidth=0.6, zorder=1)
        return axes

    def plot(self, ax: Axes | None = None, *, coordinates: tuple[int, int] | None = None) -> Axes:
        """Draw one section coordinate against another: relative velocity against phase.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        coordinates : (int, int), optional
            Columns of the states, horizontal and vertical; by default phase and relative velocity.

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            When there is no such coordinate.
        """
        d = self.states.shape[1]
        chosen = _chosen(coordinates, (d - 1, d - 2), d)
        names = [*(f"section coordinate {k}" for k in range(d - 2)), RELATIVE_VELOCITY, PHASE]
        return draw_points(ax, self.states[:, chosen], [names[k] for k in chosen])


def _given(source: object) -> Array:
    states = finite_array("source", source, (None, None)).copy()
    if not len(states) or states.shape[1] < 2:
        raise ValueError(f"source must have shape (1, 2) or more; got shape {states.shape}")
    return read_only(states)


def _strobe_times(motion: Motion, phase: float, periods: int | None) -> Array:
    """Return the times (p,) at which the forcing has the phase."""
    w, record = motion.forcing_frequency, motion.record_until(0.0)
    if record is None:
        raise ValueError(f"source must be a motion in time; got {motion.system!r}")
    first = float(in_turn(phase - record.start.phase)) / w
    period = math.tau / w
    if periods is None:
        end = float(record.time[-1]) if len(record) else 0.0
        count = math.floor((end - first) / period) + 1
        if count < 1:
            raise ValueError("periods must be given: the kept impacts end before the first")
    else:
        count = positive_integer("periods", periods)
    return np.asarray(first + period * np.arange(count, dtype=np.float64))


def _chosen(
    coordinates: tuple[int, int] | None, default: tuple[int, int], dimension: int
) -> list[int]:
    try:
        first, second = default if coordinates is None else coordinates
    except (TypeError, ValueError):
        message = f"coordinates must be two numbers of coordinates; got {coordinates!r}"
        raise ValueError(message) from None
    both = {"coordinates[0]": first, "coordinates[1]": second}
    return [checked_index(name, value, dimension) for name, value in both.items()]
