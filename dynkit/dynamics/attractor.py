"""Attractors: the motion after its transient, and that of a plain map."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.overriding import Extensible
from dynkit.core.reprs import Facts, system_repr
from dynkit.core.smooth_map import SmoothMap, checked_map, product_with_error
from dynkit.core.validation import (
    Array,
    finite_array,
    non_negative_integer,
    of_type,
    one_of,
    positive_integer,
    read_only,
    within_memory,
)
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.result import Result, SavedWithSystem
from dynkit.dynamics.section import PoincareSection
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.labels.labelling import Window, label_orbit, settled_label, with_multiplier
from dynkit.viewer.page import Page, page_of_section
from dynkit.viewer.series import Series, series_of_states
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.map_orbit import MapOrbit

# Largest distance, relative to the size of the states, from a motion that still settles to the
# periodic orbit that Newton's method finds from it.
_NEARBY = 0.1
# Number of disturbed runs for the error, and the least relative size of their disturbances.
_TWINS, _ROUNDINGS = 3, 4.0 * 2.0**-52

# A recurrence is no sign of a period if it exceeds _EXACT errors of an iterate, and the derivative
# varies over it by more than _VARIATION, relative to its norm or to one: it may be the distance of
# a small nonlinear motion.
_EXACT, _VARIATION = 32.0, 0.1

# Largest number of floats in the states of a time series: a gigabyte.
_MOST_NUMBERS = 1 << 27


class _Ending(Enum):
    COUNT_REACHED = "the number of states was reached"


class Attractor(Viewed, Extensible, Result, ABC):
    """The states of a motion after its transient.

    A subclass must implement:

    1. `system`, the `Map` whose iterates the states are.
    2. `transient`, the number of skipped states, and `states`, (n, d), the kept states in their
       order, read-only. A longer transient gives the later part of the same motion, bit for bit, or
       to rounding as `Map.following`.
    3. `label`, an `OrbitLabel`: computed once, when it is first read.
    4. ``time_series(times)``, the motion at given times, in columns that the subclass documents.
       The times may lie beyond the kept states, and the same times give the same bits.
    5. `cost`, the `Cost` of the states; and `error`, a float >= 0: an estimate of the error of the
       states, in a norm that the subclass documents.

    A subclass may implement, where a start is more than a state or motions can end:

    6. `final`, the start from which the motion continues, `duration`, and `ending`, a member of an
       enumeration whose value says in words why the simulation ended.
    7. ``observable(name)``, (n,): one of the map's `observables` at the kept states.
    8. ``label_within(budget)``, the label from at most this number of states.
    9. `dataset`, when its states are more than their observables.

    Instances are immutable: properties that are computed when first read depend on nothing else.
    `dynkit.testing.check_attractor` tests a subclass against this contract.
    """

    @property
    @abstractmethod
    def system(self) -> SmoothMap:
        """The map whose iterates the states are."""

    @property
    @abstractmethod
    def transient(self) -> int:
        """Number of skipped states."""

    @property
    @abstractmethod
    def states(self) -> Array:
        """The kept states, (n, d), read-only."""

    @property
    @abstractmethod
    def label(self) -> OrbitLabel:
        """Label of the motion."""

    @property
    @abstractmethod
    def cost(self) -> Cost:
        """Cost of the states."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of the error of the states."""

    @abstractmethod
    def time_series(self, times: Array) -> Array:
        """Return the motion, (k, ...), at the given times, (k,)."""

    @property
    def final(self) -> Any:
        """The start from which the motion continues: by default the last kept state."""
        return np.asarray(self.states[-1])

    @property
    def duration(self) -> float:
        """Time at which the motion that continues begins: by default the number of states."""
        return float(self._kept)

    @property
    def ending(self) -> Enum:
        """Why the simulation ended; the value of the member says it in words."""
        return _Ending.COUNT_REACHED

    def observable(self, name: str) -> Array:
        """Return one of the map's `observables` at the kept states, (n,).

        Raises
        ------
        ValueError
            When the map has no observable of this name.
        """
        names = list(self.system.observables)
        return self.states[:, names.index(one_of("name", name, names))]

    def dataset(self) -> Dataset:
        """Return the observables at the kept states as a dataset over ``state``.

        It contains the label and the `error` if they have been computed before, because both
        simulate.
        """
        label = self._known_label
        facts: dict[str, Any] = {} if label is None else {"label": str(label)}
        return Dataset(
            {},
            {
                **{name: ("state", self.observable(name)) for name in self.system.observables},
                **known_error(self, ()),
            },
            described(
                "States of a motion after its transient",
                cost=self.cost,
                error="estimate of the error of the states",
                system=self.system,
                transient=float(self.transient),
                ending=str(self.ending.value),
                **facts,
            ),
        )

    def label_within(self, budget: int) -> OrbitLabel:  # noqa: ARG002
        """Return the label from at most this number of states besides the kept ones."""
        return self.label

    @property
    def _stays(self) -> bool:
        """Whether a fast test proves that the motion is on a stable orbit; False by default."""
        return False

    def _series(self) -> Series:
        """Return the time series for pages in the browser: one period of a periodic motion."""
        n = self.label.iterates
        if n is None or n > len(self.states):
            return series_of_states(self.system, self.states)
        return series_of_states(self.system, self.states[-n:], periodic=True)

    def _page(self, motions: int) -> Page:
        title = f"Attractor, {self.label}"
        return page_of_section(title, self, lambda _: self._series(), motions)

    @property
    def _kept(self) -> int:
        """Number of kept states."""
        return len(self.states)

    @property
    def _known_label(self) -> OrbitLabel | None:
        """The label, if it was computed before."""
        label: OrbitLabel | None = getattr(self, "__dict__", {}).get("label")
        return label

    def __repr__(self) -> str:
        label = self._known_label
        name = "" if label is None else f"{label}, "
        kind, system = type(self).__name__, system_repr(self.system, 6)
        return f"<{kind} of {system}: {name}{self._kept} states after {self.transient}>"

    def _caption(self) -> str:
        return type(self).__name__

    def _facts(self) -> Facts:
        return {
            "system": system_repr(self.system, 6),
            "label": self._known_label or "not decided yet",
            "states kept": self._kept,
            "states skipped": self.transient,
            "cost": self.cost,
        }

    def section(self, section: PoincareSection) -> Array:
        """Return the kept states, (k, d), just after the motion passed the section.

        A map jumps over the section: these are the states on or beyond it, in the section's
        direction, whose predecessor lies before it.
        """
        of_type("section", section, PoincareSection, "a PoincareSection")
        values = [section.direction * section.value(state) for state in self.states]
        side = np.array(values) >= 0.0
        return self.states[1:][side[1:] & ~side[:-1]]


@final
class MapAttractor(Attractor, SavedWithSystem):
    """The attractor that the iterates of a start reach.

    Time counts iterates, from zero at the first kept state.

    Parameters
    ----------
    system : Map
    start : (d,) array
    transient : int
        Iterates to skip; zero or more.
    iterations : int
        States to keep.

    Raises
    ------
    ValueError
        When the start is not finite or not of that shape, or transient or iterations is no count.
    NoMotion
        When the motion diverges (`Diverged`), or has no next state.

    Examples
    --------
    >>> from dynkit import Map
    >>> class Newton(Map):  # for the square root of 2
    ...     dimension = 1
    ...
    ...     def __call__(self, state):
    ...         return (state + 2.0 / state) / 2.0
    >>> attractor = MapAttractor(Newton(), [1.0], transient=20, iterations=30)
    >>> attractor.states[0]
    array([1.41421356])
    >>> print(attractor.label)
    P(1)
    >>> attractor.error < 1e-14
    True
    """

    _stored: ClassVar = ("_start", "_transient", "_states", "_cost")
    _stored_if_known: ClassVar = ("error",)
    _given: ClassVar = "_system"
    _system: SmoothMap
    _start: Array
    _transient: int
    _states: Array
    _cost: Cost

    def __init__(self, system: SmoothMap, start: Array, transient: int, iterations: int) -> None:
        began = time.perf_counter()
        self._system = checked_map(system)
        self._start = read_only(finite_array("start", start, (system.dimension,)).copy())
        self._transient = non_negative_integer("transient", transient)
        kept = positive_integer("iterations", iterations)
        count = self._transient + kept
        within_memory("transient + iterations", count, 8.0 * count * system.dimension)
        states = np.empty((count, system.dimension))
        states[0] = self._start
        system.iterate_into(states)
        self._states = read_only(states[self._transient :])
        self._cost = Cost(time.perf_counter() - began, {"iterates": count - 1})

    def _restored(self) -> Self:
        d = self._system.dimension
        if self._start.shape != (d,) or self._states.shape != (max(len(self._states), 1), d):
            raise ValueError(f"states of {d} numbers are {self._start.shape}, {self._states.shape}")
        non_negative_integer("transient", self._transient)
        return self

    @property
    def _last(self) -> int:
        """Number of the last state among the iterates."""
        return self._transient + len(self._states) - 1

    @property
    def system(self) -> SmoothMap:
        return self._system

    @property
    def start(self) -> Array:
        """The start of the motion, (d,)."""
        return self._start

    @property
    def transient(self) -> int:
        return self._transient

    @property
    def states(self) -> Array:
        return self._states

    @cached_property
    def label(self) -> OrbitLabel:
        return self._labelled(label_orbit)

    def label_within(self, budget: int) -> OrbitLabel:
        """Return the label from at most this number of states besides the kept ones."""
        return self._labelled(label_orbit, budget=budget)

    def settled_label(self, budget: int = 100_000) -> OrbitLabel:
        """Return the label of the orbit that the motion settles on, also after transient chaos.

        See `dynkit.labels.labelling.settled_label`. The budget is the largest number of states that
        are examined besides the kept ones.
        """
        return self._labelled(settled_label, budget=budget)

    def _labelled(self, decide: Callable[..., OrbitLabel], **budget: int) -> OrbitLabel:
        orbit = _MapOrbit(self._system, self._states)
        return orbit.judged(decide(orbit, kept=len(self._states), **budget))

    @property
    def cost(self) -> Cost:
        return self._cost

    @cached_property
    def error(self) -> float:
        """Estimate of the largest distance of a kept state from the exact one.

        Three more runs are disturbed at the start and after every iterate, with random signs in all
        coordinates. The disturbance relative to the size of the state is the map's `accuracy`, at
        least four roundings, and no less than its `call_errors` at the first kept state. The
        estimate is the largest distance between these runs and the kept states, at least one
        rounding of the largest state. It is near the accuracy on a stable periodic orbit. In chaos
        it is as large as the attractor: single states cannot be computed, only their distribution.
        It is infinite when a disturbed run diverges or has no next state.
        """
        worst = 2.0**-52 * float(np.linalg.norm(self._states, axis=1).max())
        known = self._states[:1] if len(self._states) > 1 else self._start[None]
        try:
            # flows may have larger coordinates than the section, and errors that are absolute
            least = float(self._system.call_errors(known).max()) if self._last else 0.0
        except NoMotion:
            return np.inf
        return max(worst, *(self._parted(seed, least) for seed in range(_TWINS)))

    def error_until(self, latest: int) -> float:
        """Return the `error` of the states up to this iterate, also beyond the kept ones."""
        if latest < len(self._states):
            return self.error
        return MapAttractor(self._system, self._start, self._transient, latest + 1).error

    def _parted(self, seed: int, least: float) -> float:
        """Return the largest distance between the kept states and a run with disturbed iterates."""
        signs = np.random.default_rng(seed)
        noise = max(self._system.accuracy, _ROUNDINGS)
        twin = self._start.copy()
        largest = 0.0
        for i in range(self._last + 1):
            try:
                twin = self._system.image(twin) if i else twin
            except NoMotion:
                return np.inf
            size = max(noise * abs(twin).max(), least)
            twin += size * signs.choice((-1.0, 1.0), size=twin.size)
            if i >= self._transient:
                gap = self._system.difference(twin, self._states[i - self._transient])
                largest = max(largest, float(np.linalg.norm(gap)))
        return largest

    def periodic_orbit(self) -> MapOrbit:
        """Return the periodic orbit that the motion settles on, to rounding, by Newton's method.

        The guess is the last period of the states that the `label` examined.

        Raises
        ------
        ValueError
            When the label is not that of a periodic orbit, but quasi-periodic, chaotic or
            unsettled.
        NoConvergence
            When Newton's method does not converge, or converges to a distant orbit.

        Examples
        --------
        >>> from dynkit.systems import Logistic
        >>> attractor = MapAttractor(Logistic(rate=3.2), [0.3], transient=50, iterations=20)
        >>> orbit = attractor.periodic_orbit()
        >>> orbit.label, orbit.residual < 1e-15
        ('P(2)', True)
        """
        from dynkit.orbits.newton import NoConvergence
        from dynkit.orbits.periodic_orbit import periodic_orbit

        n = self.label.iterates
        if self.label.kind is not OrbitKind.PERIODIC or n is None:
            raise ValueError(f"attractor must be periodic; got one that is {self.label}")
        rest = max(self.label.simulated - len(self._states), 0)
        guess = self._system.iterate(self._states[-1], max(rest, n))[-n:]
        orbit = periodic_orbit(self._system, guess)
        gap = abs(self._system.difference(np.resize(orbit.states, guess.shape), guess))
        if (gap > _NEARBY * abs(guess).max()).any():
            raise NoConvergence(
                f"Newton's method left the attractor {self.label} for an orbit {orbit.label} that "
                f"is {float(gap.max()):.1e} away"
            )
        return orbit

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the second coordinate of the states against the first.

        For a one-dimensional map, draw the next state against each state.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.

        Returns
        -------
        Axes
        """
        from dynkit.plotting.points import axis_title, draw_points

        first, second = map(axis_title, ("state[0]", "state[1]"))
        if self._system.dimension > 1:
            return draw_points(ax, self._states[:, :2], (first, second))
        beyond = self._system.image(self._states[-1])
        points = np.column_stack([self._states, np.append(self._states[1:], beyond)])
        return draw_points(ax, points, (first, f"next {first}"))

    def time_series(self, times: Array) -> Array:
        """Return the states, (k, d), at the given times: iterates after the first state kept.

        Parameters
        ----------
        times : (k,) array
            Integers, zero or more, in any order; the motion is iterated up to the latest.

        Raises
        ------
        ValueError
            When a time is negative or not an integer, or when the states up to it would take more
            than a gigabyte.
        """
        asked = finite_array("times", times, (None,))
        for i in np.flatnonzero((asked < 0.0) | (asked != np.rint(asked)))[:1].tolist():
            raise ValueError(
                f"times[{i}] must be zero or a positive integer; got {float(asked[i])!r}"
            )
        most = _MOST_NUMBERS // self._system.dimension
        latest = int(asked.max(initial=0.0))
        if latest > most:
            raise ValueError(f"times must not exceed {most}; got {latest}")
        beyond = latest - (len(self._states) - 1)
        states = self._states
        if beyond > 0:
            later = self._system.iterate(states[-1], beyond)[1:]
            states = np.concatenate([states, later])
        return states[asked.astype(np.intp)]


class _MapOrbit:
    """The motion of a map as an `OrbitSource` for `label_orbit`."""

    def __init__(self, system: SmoothMap, kept: Array) -> None:
        self.system, self.kept = system, kept
        self.accuracy, self.difference = system.accuracy, system.difference
        self.window: Array | None = None

    def more(self, count: int) -> Window:
        if self.window is None:
            self.window = self.kept
        else:
            self.window = self.system.iterate(self.window[-1], count)[1:]
        return Window(self.window, resolves=self._resolves)

    def judged(self, label: OrbitLabel) -> OrbitLabel:
        """Return the label with the multiplier of the last period, if the motion is periodic."""
        if label.iterates is None or self.window is None:
            return label
        n, system = label.iterates, self.system
        try:
            found = self._derivatives(self.window[-1 - 2 * n : -1])
        except NoMotion:  # the orbit touches the section: no derivative
            return label
        factors = np.array([product for product, _ in found])
        # errors of exact derivatives follow from the accuracy
        more = np.array([error for _, error in found[n:]]) if system._by_differences else None
        return with_multiplier(label, factors[n:], factors[:n], system.accuracy, more)

    def _derivatives(self, states: Array) -> list[tuple[Array, float]]:
        return [product_with_error(*self.system.jacobian_factors(state)) for state in states]

    def _resolves(self, n: int) -> bool:
        """Whether the derivative is nearly the same in the last period and the farthest one."""
        assert self.window is not None
        count = (len(self.window) - 1) // n
        periods = self.window[-1 - count * n : -1].reshape(count, n, -1)
        apart = np.linalg.norm(self.difference(periods, periods[-1]), axis=2).max(axis=1)
        if apart.max() <= _EXACT * self.accuracy * abs(periods[-1]).max():
            return True
        try:
            there, last = map(self._derivatives, (periods[np.argmax(apart)], periods[-1]))
        except NoMotion:  # the orbit touches the section: no derivative
            return True
        return all(
            np.linalg.norm(a - b) <= _VARIATION * max(1.0, float(np.linalg.norm(b))) + off + error
            for (a, off), (b, error) in zip(there, last, strict=True)
        )

    def growth(self, steps: int) -> Array:
        state = (self.kept if self.window is None else self.window)[-1]
        return self.system._growth(state, steps)
