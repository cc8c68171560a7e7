"""Lyapunov exponents: growth rates of disturbances in all directions."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np
from numpy.typing import NDArray

from dynkit.analysis.averages import LEAST, TimeAverages, weighted
from dynkit.analysis.batches import in_values
from dynkit.analysis.motions import attractor_of, going_on_for
from dynkit.analysis.regimes import RegimeChange
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.smooth_map import SmoothMap, checked_map, generic_direction
from dynkit.core.stretching import Stretching
from dynkit.core.validation import (
    Array,
    finite_array,
    of_type,
    positive,
    positive_integer,
    read_only,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.flow import Flow
from dynkit.dynamics.hybrid_flow import smooth
from dynkit.plotting.figures import ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MATCHES = 32
"""Number of rows that agree before the states themselves are compared."""

_AROUND = 16
"""Number of iterates whose largest coordinates are the sizes of disturbances."""

_ROUNDINGS = 8.0 * 2.0**-52
"""Least error of an iterate, relative to a coordinate: a call has several roundings."""


def distinct_iterates(system: SmoothMap, state: Array, logs: Array) -> int:
    """Return the number of logarithms (n, d) before a motion with growing disturbances repeats.

    In exact arithmetic a motion whose disturbances grow does not return to its own states. Rounding
    makes it return, soonest in one dimension and where the map is flat. Later iterates then add no
    information to an average. All n count if the motion does not repeat itself bit by bit, or if it
    has fewer than 128 different states, because it is then on an unstable periodic orbit.

    Parameters
    ----------
    system : SmoothMap
    state : (d,) array
        The state after the last iterate.
    logs : (n, d) array
    """
    count = len(logs)
    periods = np.arange(1, (count - _MATCHES) // 2 + 1)
    for row in range(count - 1, count - 1 - _MATCHES, -1):
        periods = periods[(logs[row - periods] == logs[row]).all(axis=1)]
    for period in periods[:1].tolist():
        if logs[-period:, 0].sum() > 0.0 and (system.iterate(state, period)[-1] == state).all():
            others = np.flatnonzero((logs[period:] != logs[:-period]).any(axis=1))
            first = period + (int(others[-1]) + 1 if len(others) else 0)
            return first if first >= LEAST else count
    return count


def rounding_of(system: SmoothMap, found: Stretching, iterates: int) -> Array:
    """Return errors (d,) of average logarithms of a stable motion, from rounding of its states.

    A disturbance of one state changes the logarithms of all later iterates. The error of every
    iterate is such a disturbance: the map's `accuracy` of each coordinate, at least eight
    roundings. The changes are computed to first order from a run that starts at a state disturbed
    in a generic direction. The errors are infinite if this run ends.

    Parameters
    ----------
    system : SmoothMap
    found : Stretching
        Stretching of the motion; the runs start at its end.
    iterates : int
        Number of iterates in which the disturbance decays.
    """
    state, part = found.state, np.sqrt(max(system.accuracy, _ROUNDINGS))
    try:
        sizes = abs(system.iterate(state, _AROUND)).max(axis=0)
        moved = state + part * sizes * np.sqrt(len(state)) * generic_direction(len(state))
        near, far = (
            system.stretching(start, iterates, np.array(found.frame)).logs
            for start in (state, moved)
        )
    except NoMotion:
        return np.full(found.logs.shape[1], np.inf)
    with np.errstate(invalid="ignore"):
        changes = np.nan_to_num(abs(far - near), posinf=0.0).sum(axis=0)
    return np.asarray(part * changes)


_SETTLING = 4
"""A run begins with iterations / _SETTLING additional iterates, in which the frame is aligned."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""Ratio of the interval with which the motion of a flow goes on, if it is regular or disturbances
grow by less than the square of the number of iterates. If the iterates were at few phases before,
they are not with this ratio: no number is farther from simple fractions."""

_CONSTANT = 1e-3
"""Largest relative error of an average whose logarithms are constant, or as good as constant."""

_POINTS = 400
"""Number of points of a drawn curve of convergence."""


@final
class LyapunovSpectrum(Saved):
    """All Lyapunov exponents of a motion, from exact derivatives, with errors.

    A frame of all directions is propagated along the motion and made orthonormal after every
    iterate (QR); the exponents are the averages of the logarithms of its stretching. The first
    iterates, a quarter of `iterations`, are left out. Results are computed when first read.

    The errors are standard errors, which cover about 68 %, and not bounds. Twice an error is the
    half-width of a 95 % interval (Student's t), plus the average error of a single logarithm. The
    interval comes from the slow waves in the logarithms. Periodic and quasi-periodic motions are
    recognised by the much faster convergence of weighted averages; their error is the largest
    distance between these averages over parts of the motion, plus the effect of rounding of the
    states of a map. Of motions that still settle on an orbit they cover what is left. Where
    disturbances may grow as a power of time, as in conservative oscillators, they cover zero. Where
    rounding makes chaos repeat itself, only different states count. The errors are valid when the
    motion is `resolved`, for its attractor. Where the run changes its regime, for example when
    transient chaos ends, the errors cover the exponents before and after; see `change`. A transient
    longer than the run looks like sustained chaos: `settled_label` of the attractor examines more
    states.

    An exponent is minus infinity, with the error zero, where the length of a direction has become
    exactly zero: disturbances along it are forgotten in finite time. In an impact oscillator a
    sticking contact removes two directions, because the position and the velocity of the sticking
    mass are those of the table. Friction that sticks removes one, and so do a slider that slides
    and an impact with restitution zero. A single such event in the run suffices, however rare they
    are. In a run without such an event the last exponents are finite. The other exponents, and the
    dimension, are the same averages in both cases.

    An exponent is NaN (not resolved) where a direction shrinks to less than a thousand errors of
    the derivatives. For a Poincare map this happens only within one part of a return; see
    `Map.jacobian_factors`.

    Parameters
    ----------
    attractor : Attractor or ImpactRecord
        Attractor of a map, a Poincare map or an impact oscillator; the motion continues from its
        last state. A Poincare map lacks the zero exponent of its flow.
    iterations : int
        Number of iterates in the averages; at least 128.

    Raises
    ------
    ValueError
        When an argument is refused; when results are read, also when the motion ends.

    References
    ----------
    See `Map.stretching`; for the errors `TimeAverages`; and P. Frederickson, J. L. Kaplan, E. D.
    Yorke, J. A. Yorke, The Liapunov dimension of strange attractors, J. Differential Equations 49
    (1983) 185-207.

    Examples
    --------
    >>> from dynkit import MapAttractor
    >>> from dynkit.systems import Logistic
    >>> attractor = MapAttractor(Logistic(rate=4.0), [0.3], transient=10, iterations=1)
    >>> spectrum = LyapunovSpectrum(attractor, iterations=2000)
    >>> bool(abs(spectrum.exponents[0] - np.log(2.0)) < 3.0 * spectrum.error[0])
    True
    """

    _stored: ClassVar = ("_name", "_is_flow", "_length", "_run")
    _name: str
    _is_flow: bool
    _length: int

    def __init__(self, attractor: Attractor, iterations: int = 10_000) -> None:
        source = attractor_of(attractor)
        start, system = np.asarray(source.states[-1]), source.system
        self._take(system, partial(system.stretching, start), iterations)

    @classmethod
    def of_map(cls, system: SmoothMap, start: object, *, iterations: int = 10_000) -> Self:
        """Return the exponents of the motion of a map from a start, (d,).

        The transient of the motion should be shorter than a quarter of the iterations.

        Raises
        ------
        ValueError
            As the class itself; and when the start is not finite or not of that shape.

        Examples
        --------
        >>> from dynkit.systems import Henon
        >>> spectrum = LyapunovSpectrum.of_map(Henon(), [0.1, 0.1], iterations=2000)
        >>> bool(abs(spectrum.exponents.sum() - np.log(0.3)) < 1e-12)
        True
        """
        checked_map(system)
        state = finite_array("start", start, (system.dimension,)).copy()
        made = cls.__new__(cls)
        made._take(system, partial(system.stretching, state), iterations)
        return made

    @classmethod
    def of_flow(
        cls, flow: Flow, start: object, *, interval: float, iterations: int = 10_000
    ) -> Self:
        """Return the exponents per unit of time of the motion of a flow from a start, (d,).

        An autonomous flow has a zero exponent unless the motion ends in a fixed point.

        Parameters
        ----------
        flow : Flow
        start : (d,) array
        interval : float
            Duration of an iterate; see `Flow.stretching`. Near a simple fraction of the period of a
            periodic motion the iterates are at few phases for a long time. Therefore a motion
            without chaos goes on for a half of the iterations with an interval that is shorter by
            the golden ratio; the errors include the change of the averages.
        iterations : int
            Number of intervals in the averages; at least 128.

        Raises
        ------
        ValueError
            As the class itself; and when the start is not finite or not of that shape.
        """
        of_type("flow", flow, Flow, "a Flow")
        smooth("flow", flow)
        state = finite_array("start", start, (flow.dimension,)).copy()
        duration = positive("interval", interval)
        made = cls.__new__(cls)
        made._take(flow, partial(flow.stretching, state, duration), iterations)
        return made

    def _take(
        self, system: SmoothMap | Flow, stretching: Callable[[int], Stretching], iterations: int
    ) -> None:
        self._name, self._is_flow = type(system).__name__, isinstance(system, Flow)
        self._system, self._length = system, 1
        self._stretching = stretching
        self._iterations = positive_integer("iterations", iterations)
        if self._iterations < LEAST:
            raise ValueError(f"iterations must be at least {LEAST}; got {iterations}")

    @cached_property
    def _run(self) -> tuple[Array, Array, Array | None, Cost]:
        """Logarithms (n, d), their errors (n, d), and times (n,) of the iterates; and the cost.

        For a stream each row is the mean over a batch of iterates.
        """
        began = time.perf_counter()
        total = self._iterations + self._iterations // _SETTLING
        with going_on_for(total):
            found = self._stretching(total)
        logs, errors = found.logs[-self._iterations :], found.errors[-self._iterations :]
        times = None if found.times is None else found.times[-self._iterations :]
        if isinstance(self._system, SmoothMap):
            count = distinct_iterates(self._system, found.state, logs)
            logs, errors = logs[:count], errors[:count]
            times = None if times is None else times[:count]
            if logs[:, 0].sum() <= 0.0 and _averages_of(logs, None).regular:
                errors = errors + rounding_of(self._system, found, self._iterations // _SETTLING)
        elif times is not None:
            logs, errors = logs / times[:, None], errors / times[:, None]
            grown = float((logs[:, 0] * times).sum())
            if grown <= 2.0 * np.log(len(logs)) or _averages_of(logs, None).regular:
                total += 2 * (self._iterations // _SETTLING)
                errors = errors + abs(self._at_other_phases(found) - weighted(logs))
        cost = Cost(time.perf_counter() - began, {"iterates": total})
        return logs, errors, times, cost

    def _at_other_phases(self, found: Stretching) -> Array:
        """Return the averages (d,) of the motion of a flow that goes on with another interval.

        They are infinite where this motion ends.
        """
        assert isinstance(self._system, Flow)
        assert found.times is not None
        count, interval = self._iterations // _SETTLING, float(_GOLDEN * found.times[-1])
        try:
            logs = self._system.stretching(found.state, interval, 2 * count).logs
        except NoMotion:
            return np.full(found.logs.shape[1], np.inf)
        return weighted(logs[count:]) / interval

    @cached_property
    def _averages(self) -> tuple[TimeAverages, NDArray[np.intp]]:
        """Averages of the finite logarithms and of the times, last; and the descending order."""
        logs, _, times, _ = self._run
        averages = _averages_of(logs, times)
        values, _ = averages.estimate(lambda mean: mean[:-1])
        return averages, np.argsort(-values, kind="stable")

    def _estimate(self, function: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
        """Return a function of the finite exponents, descending, and the time, and its errors."""
        averages, order = self._averages
        return averages.estimate(lambda mean: function(mean[order], mean[-1:]))

    def _completed(self, finite: Array, others: tuple[float, float]) -> Array:
        """Return all exponents, or errors, (d,): finite ones, then hidden and lost directions."""
        logs = self._run[0]
        lost = int(np.isneginf(logs).any(axis=0).sum())
        hidden = logs.shape[1] - len(finite) - lost
        return read_only(np.concatenate([finite, np.repeat(others, (hidden, lost))]))

    def _exponents_of(
        self, function: Callable[[Array, Array], Array], accuracy: Array
    ) -> tuple[Array, Array]:
        values, errors = self._estimate(function)
        return (
            self._completed(values, (np.nan, -np.inf)),
            self._completed(errors + accuracy, (np.nan, 0.0)),
        )

    @cached_property
    def _accuracy(self) -> Array:
        """Average errors of the logarithms of the finite exponents, in descending order."""
        logs, errors, _, _ = self._run
        _, order = self._averages
        return np.asarray(errors[:, np.isfinite(logs).all(axis=0)].mean(axis=0)[order])

    @cached_property
    def _left(self) -> Array:
        """Later changes of the finite exponents, in descending order, while a motion settles.

        Near a periodic orbit the deviation of the logarithms is proportional to the distance from
        the orbit. It decreases by a factor exp(rate) in an iterate, where the rate is the exponent
        nearest to zero, for a flow without the exponent of the flow's direction. The change per
        iterate in the last quarter is summed over all later iterates. Near a bifurcation, where the
        distance is a power of time, this sum is at least a half of the later change. Therefore
        three times the sum is taken, but at most the change by which the rate changes by twice its
        value. The result is zero for motions whose averages over quarters do not approach a limit.
        """
        logs, _, times, _ = self._run
        values, errors = self._estimate(lambda exponents, _: exponents)
        finite = logs[:, np.isfinite(logs).all(axis=0)][:, self._averages[1]]
        quarters = np.array([weighted(part) for part in np.array_split(finite, 4)])
        steps = np.diff(quarters, axis=0)
        ratios = steps[1:] / np.where(steps[:-1] == 0.0, np.inf, steps[:-1])
        duration = float(times.mean()) if self._is_flow and times is not None else 1.0
        nearest = np.argsort(abs(values))[int(self._is_flow) :]
        if not len(nearest) or (values + 2.0 * errors)[nearest].max() >= 0.0:
            return np.zeros(len(values))
        settles = ((ratios > 0.0) & (ratios < 1.0)).all(axis=0)
        slopes = np.where(settles, steps[-1], 0.0) / (len(logs) // 4 * self._length)
        rate, slope = -quarters[-1, nearest[0]], abs(slopes[nearest[0]])
        most = 2.0 * rate / slope if slope else np.inf
        return np.asarray(slopes * min(3.0 / (rate * duration), most))

    @cached_property
    def _powers(self) -> Array:
        """Sizes of the finite exponents, in descending order, that may be zero; otherwise 0.

        Where disturbances grow as the time t, as in conservative oscillators, they grow by no more
        than a factor n in n iterates, and smoothly: the scatter of their logarithms is then far
        smaller than the average. Where logarithms are constant to a thousandth, growth is
        exponential.
        """
        logs, _, times, _ = self._run
        values, errors = self._estimate(lambda exponents, _: exponents)
        count = len(logs) * self._length
        grown = count * abs(values)
        if self._is_flow and times is not None:
            grown *= float(times.mean())
        powers = (grown <= np.log(count)) & (errors > _CONSTANT * abs(values))
        return np.where(powers, abs(values), 0.0)

    @property
    def _others(self) -> Array:
        """Errors of the finite exponents, in descending order, besides those of averages."""
        return np.asarray(self._accuracy + abs(self._left) + self._powers)

    @cached_property
    def _exponents(self) -> tuple[Array, Array]:
        return self._exponents_of(lambda exponents, _: exponents, self._others)

    @property
    def exponents(self) -> Array:
        """Exponents (d,) per iterate, or per unit of time for a flow; the largest first."""
        return self._exponents[0]

    @property
    def error(self) -> Array:
        """One standard error (d,) of each exponent: it covers about 68 %, and is not a bound."""
        return self._exponents[1]

    @cached_property
    def _per_time(self) -> tuple[Array, Array]:
        if self._run[2] is None:
            raise ValueError(f"system must have return times; got {self._name}")
        if self._is_flow:
            return self._exponents
        (duration,), _ = self._estimate(lambda _, duration: duration)
        return self._exponents_of(
            lambda exponents, duration: exponents / duration,
            self._others / float(duration),
        )

    @property
    def per_time(self) -> Array:
        """Exponents (d,) per unit of time.

        Raises
        ------
        ValueError
            When the system is a map without return times.
        """
        return self._per_time[0]

    @property
    def per_time_error(self) -> Array:
        """One standard error (d,) of each exponent per unit of time; not a bound."""
        return self._per_time[1]

    @cached_property
    def _sum(self) -> tuple[float, float]:
        if np.isneginf(self.exponents).any():  # also if another exponent is NaN
            return -np.inf, 0.0
        if np.isnan(self.exponents).any():
            return np.nan, np.nan
        value, error = self._estimate(lambda exponents, _: exponents.sum(keepdims=True))
        return float(value[0]), float(error[0] + self._accuracy.sum() + abs(self._left.sum()))

    @property
    def sum(self) -> float:
        """The sum of all exponents: the average growth of the logarithm of a volume.

        It is minus infinity when an exponent is, because the volume becomes zero.
        """
        return self._sum[0]

    @property
    def sum_error(self) -> float:
        """One standard error of the sum; small where volumes shrink at a constant rate."""
        return self._sum[1]

    @cached_property
    def _dimension(self) -> tuple[float, float]:
        values, errors = self._exponents_of(lambda exponents, _: exponents, self._accuracy)
        count = int(np.isfinite(values).sum())
        # exponents that are zero within their errors count as zero, as for tori and limit cycles,
        # unless the errors cover two regimes
        zero = (abs(values) <= 2.0 * errors)[:count] & (self.change is None)

        def dimension(exponents: Array, _: Array, zero: Any = zero) -> Array:
            known = np.where(zero, 0.0, exponents)
            return np.array([kaplan_yorke(np.append(known, values[count:]))])

        (value,), (error,) = self._estimate(dimension)
        if not self._averages[0].regular:  # an exponent may be small and not zero
            (other,), (error,) = self._estimate(partial(dimension, zero=False))
            error += abs(other - value)
        return float(value), float(error)

    @property
    def dimension(self) -> float:
        """Kaplan and Yorke's dimension; for a Poincare map, of the attractor in the section.

        Exponents that are zero within twice their error count as zero, unless the run changes its
        regime.
        """
        return self._dimension[0]

    @property
    def dimension_error(self) -> float:
        """One standard error of the `dimension`; not a bound.

        Where an exponent of chaos may be zero, it includes the difference to the dimension of the
        exponents as they are.
        """
        return self._dimension[1]

    @property
    def resolved(self) -> bool:
        """Whether the run is long enough for its errors.

        It is False when the slowest waves of the logarithms are much larger than the others. Then
        the correlation time exceeds about a tenth of the run, or the motion has not settled. The
        errors are then too small. Where it is True, three errors are exceeded in 6 % of runs of
        twenty correlation times, and in 1 % of those of sixty. Of states that a run never visits,
        as of rare bursts of chaos, it knows nothing.
        """
        return self._averages[0].resolved

    @property
    def change(self) -> RegimeChange | None:
        """The change of regime within the averaged iterates; None where none is detected.

        Logarithms and return times are tested: see `dynkit.analysis.regimes.regime_change`.
        """
        return in_values(self._averages[0].change, self._length)

    def dataset(self) -> Dataset:
        """Return the exponents as a dataset over ``exponent``, numbered from 1."""
        each = "exponent"
        found = {"value": (each, self.exponents), "error": (each, self.error)}
        if self._run[2] is not None:
            found["per_time"] = each, self.per_time
            found["per_time_error"] = each, self.per_time_error
        return Dataset(
            {each: (each, np.arange(1, len(self.exponents) + 1))},
            found,
            described(
                f"Lyapunov exponents of {self._name}",
                cost=self.cost,
                error="one standard error, which covers about 68 %",
                sum=self.sum,
                sum_error=self.sum_error,
                dimension=self.dimension,
                dimension_error=self.dimension_error,
            ),
        )

    @property
    def cost(self) -> Cost:
        """Seconds, and number of iterates."""
        return self._run[3]

    def __repr__(self) -> str:
        name = self._name
        if "_run" not in vars(self):
            return f"<LyapunovSpectrum of {name}: {self._iterations} iterates, not computed yet>"
        values, errors = self._exponents
        shown = ", ".join(f"{v:.4g}" for v in values[:3]) + (", ..." if len(values) > 3 else "")
        short = "" if self.resolved else "; too short for its errors"
        if self.change is not None:
            short = f"; {self.change}"
        return (
            f"<LyapunovSpectrum of {name}: {shown}; largest +- {errors[0]:.1g}, "
            f"dimension {self.dimension:.4g}{short}>"
        )

    @print_style()
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the averages against the number of iterates, and the error of the largest exponent.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        """
        axes = shown_axes(ax)
        logs = self._run[0]
        logs = logs[:, np.isfinite(logs).all(axis=0)]
        counts = np.unique(np.geomspace(1, len(logs), _POINTS).astype(np.intp))
        means = np.cumsum(logs, axis=0)[counts - 1] / counts[:, None]
        axes.plot(self._length * counts, means, color=ink(), linewidth=0.5)
        if np.isfinite(self.exponents[0]):
            low, high = self.exponents[0] + self.error[0] * np.array([-1.0, 1.0])
            axes.axhspan(float(low), float(high), color=ink(0.8), zorder=0)
        if self.change is not None:
            axes.axvline(self.change.at, color=ink(), linestyle="dotted")
            axes.set_title(str(self.change), fontsize="small")
        axes.set_xscale("log")
        axes.set(xlabel="iterates $n$", ylabel=r"Lyapunov exponents $\lambda_i$")
        return axes


def _averages_of(logs: Array, times: Array | None) -> TimeAverages:
    """Return averages of the finite logarithms (n, k) and, last, of the times (n,), or of ones."""
    last = np.ones(len(logs)) if times is None else times
    finite = logs[:, np.isfinite(logs).all(axis=0)]
    return TimeAverages(np.column_stack([finite, last]), growths=finite.shape[1])


def kaplan_yorke(exponents: Array) -> float:
    """Return Kaplan and Yorke's dimension for exponents (d,) in descending order.

    It is j + (lambda_1 + ... + lambda_j) / |lambda_{j+1}| for the largest j whose sum is not
    negative; d where no sum is negative, and NaN where it depends on an exponent that is NaN.

    Examples
    --------
    >>> kaplan_yorke(np.array([0.5, 0.0, -2.0]))
    2.25
    >>> kaplan_yorke(np.array([-0.1, -np.inf])), kaplan_yorke(np.array([0.1, -np.inf]))
    (0.0, 1.0)
    """
    total = 0.0
    exponent: float
    for j, exponent in enumerate(exponents.tolist()):
        if np.isnan(exponent):
            return np.nan
        if total + exponent < 0.0:
            return j - total / exponent
        total += exponent
    return float(len(exponents))
