"""Changes of regime within a run, such as the end of transient chaos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

_PARTS = 64
"""Number of parts of a run whose means are compared; correlations should be shorter than a part."""

_LEVEL = 1e-3
"""Probability of a false alarm for independent parts. It is larger for correlations longer than a
part, by up to a factor of five as measured: the stated probability is 0.5 %."""

_CRITICAL = {1e-5: 262.8, 1e-4: 184.9, 1e-3: 120.9, 1e-2: 68.6}
"""Critical values of the statistic without a change, by probability: from 4,000,000 draws of 64
independent normal numbers. Shao and Zhang's table 1 has 68.6 for 1e-2."""

_SHORTEST = 200
"""Least number of values in a regime. A laminar phase of intermittent chaos looks like a regime,
but ends and returns: with 10 masses at frequency 1.346 it lasts for up to 150 impacts."""

_MOST = 50
"""Largest number of columns that are tested together: a probability of 2e-5 for each column is
0.1 % for 50."""

_ROUNDING = 1e-12
"""Smallest sum of squares above rounding, relative to its terms."""

_TOLERANCE, _NEAR = 1e-6, 1e-2
"""Largest recurrence of a periodic column, and of one that settles, relative to the column's size,
as for `label_orbit`."""

_REPETITIONS, _LEAST, _LONGER = 3, 100, 5
"""Least number of periods, and of values, in which a column recurs before it counts as periodic,
and least ratio of this number to those for which it was constant, or recurred, shortly before. For
constant columns this is a time that is the same ratio shorter than the recurrence, at least
`_SHORTEST` values; for others these values. Two earlier times in which the column was constant
count wherever they are. Chaos does not stay within the tolerance for so long, unless the column is
constant or periodic between rare events."""


@final
@dataclass(frozen=True)
class RegimeChange:
    """A change of regime within a run.

    Parameters
    ----------
    at : int
        Approximate index of the state with which the last regime begins.
    states : int
        Number of states of the run.
    periodic : bool
        Whether the motion is periodic from this state on, and not before.
    """

    at: int
    states: int
    periodic: bool

    def __str__(self) -> str:
        what = "becomes periodic" if self.periodic else "changes its regime"
        return f"the motion {what} after about {self.at} of {self.states} states"


def regime_change(series: Array, *, growths: int = 0) -> RegimeChange | None:
    """Return the change of regime of a run; None where no change is detected.

    A run becomes periodic where a column recurs to 1e-6 at its end, for at least three periods, a
    hundred values and five times as long as it was constant twice before, or once in a time before
    that is a fifth as long (and 200 values at least), or recurred in the 200 values before; the
    change is where the column begins to recur to 1e-2. Columns that recur to 1e-6 throughout are
    left out. Otherwise, in runs of 400 values and more, the means of each column over 64 parts are
    tested for a change with at least 200 values on each side. The test normalises the difference of
    the means before and after a part by partial sums on both sides; the remaining correlation of
    neighbouring parts is accounted for.

    The probability of a false alarm is at most 0.5 % for all columns together; instead of more than
    50 columns, 50 sums with fixed pseudo-random signs are tested. It is 0.1 % for independent
    parts. The largest measured one is 0.47 % +- 0.05 %, for 500 iterates of the intermittent
    logistic map at 3.8282. Columns that are constant but for rare events, one in 200 to 500 values,
    are taken for periodic more often, in up to 6 % of runs. A transient longer than the run looks
    like sustained chaos: no change is detected.

    Parameters
    ----------
    series : (n, k) array
        Observables of the run, such as logarithms of stretching, in the order of time; columns with
        values that are not finite are left out.
    growths : int
        Number of first columns that are logarithms of stretching. Where one of them is periodic
        with a positive mean, disturbances grow: the motion passes an unstable periodic orbit, such
        as in a laminar phase, and has not become periodic.

    References
    ----------
    X. Shao, X. Zhang, Testing for change points in time series, J. American Statistical Association
    105 (2010) 1228-1240, equation 4.

    Examples
    --------
    >>> waves = np.sin(np.arange(4000) * np.pi / 8.0)
    >>> noise = np.random.default_rng(0).normal(size=4000)
    >>> print(regime_change(np.where(np.arange(4000) < 1000, noise, waves)[:, None]))
    the motion becomes periodic after about 1000 of 4000 states
    >>> regime_change(noise[:, None]) is None
    True
    """
    used = np.asarray(np.isfinite(series).all(axis=0))
    if len(series) < 2 * _LEAST or not used.any():
        return None
    used[used] = np.ptp(series[:, used], axis=0) > _TOLERANCE * abs(series[:, used]).max(axis=0)
    columns, grows = series[:, used], used[:growths].sum()
    found = [_periodic_from(column) for column in columns.T]
    columns = columns[:, [each is None or each[0] >= 0 for each in found]]
    begins = [at for at, _ in filter(None, found) if at >= 0]
    if 0 in begins:  # the motion is periodic throughout
        return None
    if begins and not any(growth > 0.0 for _, growth in filter(None, found[:grows])):
        return RegimeChange(min(begins), len(series), periodic=True)
    if len(series) < 2 * _SHORTEST or not columns.shape[1]:
        return None
    edges = np.arange(_PARTS) * len(series) // _PARTS
    lengths = np.diff(np.append(edges, len(series)))
    means = np.add.reduceat(columns, edges, axis=0) / lengths[:, None]
    if means.shape[1] > _MOST:
        signs = np.random.default_rng(0).choice((-1.0, 1.0), (means.shape[1], _MOST))
        means = (means / columns.std(axis=0)) @ signs
    last = len(series) - _SHORTEST
    statistics, places = _statistic(means, (edges >= _SHORTEST) & (edges <= last))
    worst = int(np.argmax(statistics))
    chances = np.log(list(_CRITICAL))
    if statistics[worst] <= np.interp(
        np.log(_LEVEL / means.shape[1]), chances, list(_CRITICAL.values())
    ):
        return None
    return RegimeChange(int(edges[places[worst]]), len(series), periodic=False)


def _periodic_from(column: Array) -> tuple[int, float] | None:
    """Return the index from which a column (n,) is periodic to its end; None if it is not.

    The index is -1 where it is so throughout, to the smaller tolerance. The second number is the
    mean of the last period, less the tolerance.
    """
    near = _TOLERANCE * float(abs(column).max())
    longest = len(column) // _REPETITIONS
    for period in (np.flatnonzero(abs(column[-2::-1][:longest] - column[-1]) <= near) + 1).tolist():
        least = max(_REPETITIONS * period, _LEAST)
        if least > len(column):
            return None
        tails = column[-min(least, period + _LEAST) :], column[-least:]  # few numbers first
        if all((abs(tail[period:] - tail[:-period]) <= near).all() for tail in tails):
            apart = abs(column[period:] - column[:-period])
            ends = np.flatnonzero(apart > near)
            if len(ends):
                steps = np.flatnonzero(abs(np.diff(column[: ends[-1] + 1])) > near)
                steps = np.append(steps, ends[-1])
                lasting = len(apart) - 1 - ends[-1]
                runs = np.diff(steps, prepend=-1) - 1
                shortly = runs[steps >= ends[-1] - max(lasting // _LONGER, _SHORTEST)].max()
                # one earlier rest may be another regime, two are part of the motion
                constant = max(shortly, np.sort(runs)[-2:-1].max(initial=0))
                recurs = (np.diff(ends, prepend=-1) - 1)[ends >= ends[-1] - _SHORTEST].max()
                if lasting < _LONGER * max(constant, recurs):
                    return None
            growth = float(column[-period:].mean()) - near
            far = np.flatnonzero(apart > near * _NEAR / _TOLERANCE)
            return (int(far[-1]) + 1 if len(far) else min(len(ends), 1) - 1), growth
    return None


def _statistic(means: Array, allowed: NDArray[np.bool_]) -> tuple[Array, NDArray[np.intp]]:
    """Return Shao and Zhang's G of columns (b, k), and the part (k,) where the new regime begins.

    A new regime begins with one of the allowed parts, (b,), and not with the first. If neighbouring
    parts have a correlation r > 0 in addition to the change, they are equivalent to (1 - r) /
    (1 + r) times as many independent ones (M. S. Bartlett, J. Royal Statistical Society 98 (1935)
    536-543), and G is multiplied by this ratio.
    """
    b = len(means)
    deviations = means - means.mean(axis=0)
    sums = np.cumsum(deviations, axis=0)[:-1]
    scale = (_bridges(sums) + _bridges(sums[::-1])[::-1]) / b
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(sums**2 / np.maximum(scale, _ROUNDING * sums**2))
    ratios[~allowed[1:]] = 0.0
    places = ratios.argmax(axis=0) + 1
    steps = np.take_along_axis(sums, places[None] - 1, axis=0)
    before = np.arange(b)[:, None] < places
    rest = deviations - np.where(before, steps / places, steps / (places - b))
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.nan_to_num((rest[1:] * rest[:-1]).sum(axis=0) / (rest**2).sum(axis=0))
    alike = np.maximum(alike, 0.0)
    return ratios.max(axis=0) * (1.0 - alike) / (1.0 + alike), places


def _bridges(sums: Array) -> Array:
    """Return the sum of squares of the first t partial sums about the line from 0 to the last one.

    The result has one row for each t = 1, 2, ...
    """
    t = np.arange(1.0, len(sums) + 1.0)[:, None]
    slopes = sums / t
    crossed = slopes * np.cumsum(t * sums, axis=0)
    lines = slopes**2 * np.cumsum(t**2, axis=0)
    return np.asarray(np.cumsum(sums**2, axis=0) - 2.0 * crossed + lines)
