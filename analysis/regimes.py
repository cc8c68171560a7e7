"""Changes of regime within a run: transient chaos that ends, a motion that moves elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array

_PARTS = 64
"""Parts of a run whose means are compared: the memory of a motion should be shorter than one."""

_LEVEL = 1e-3
"""Chance of a false alarm when parts are independent. It is larger for a motion that remembers for
longer than a part, up to five times as measured: the claimed chance is 0.5 %."""

_CRITICAL = {1e-5: 262.8, 1e-4: 184.9, 1e-3: 120.9, 1e-2: 68.6}
"""What the statistic exceeds with some chances when nothing changes: in 4,000,000 draws of 64
independent normal numbers. Shao and Zhang's table 1 has 68.6 for 1e-2."""

_SHORTEST = 200
"""Values for which a regime lasts at least. A laminar phase of intermittent chaos looks like a
regime, but ends and returns: with 10 masses at frequency 1.346 it lasts for up to 150 impacts."""

_MOST = 50
"""Columns that are tested together at most: a chance of 2e-5 for each is 0.1 % for 50."""

_ROUNDING = 1e-12
"""Smallest sum of squares, relative to its parts, that rounding does not hide."""

_TOLERANCE, _NEAR = 1e-6, 1e-2
"""Recurrence that counts as periodic, and that counts as on its way to it, relative to the column's
size: those of `label_orbit`."""

_REPETITIONS, _LEAST = 3, 100
"""Periods, and values, for which a column repeats itself before its motion counts as periodic: no
chaos stays within the tolerance of itself for so long."""


@final
@dataclass(frozen=True)
class RegimeChange:
    """Where a run changes its regime.

    Parameters
    ----------
    at : int
        The state of the run, about, with which the last regime begins.
    states : int
        How many states the run has.
    periodic : bool
        Whether the motion repeats itself from there on, and not before.
    """

    at: int
    states: int
    periodic: bool

    def __str__(self) -> str:
        what = "becomes periodic" if self.periodic else "changes its regime"
        return f"the motion {what} after about {self.at} of {self.states} states"


def regime_change(series: Array) -> RegimeChange | None:
    """Return where a run changes its regime; None where it does not, or nothing shows it.

    A run becomes periodic where one of its columns repeats itself to 1e-6 at the end, for three
    periods and a hundred values at least; from where it repeats itself to 1e-2. Otherwise the means
    of each column over 64 parts are tested for a change, in runs of 400 values and more, with at
    least 200 values on each side. The test normalises the difference of the means before and after
    a part by partial sums on both sides; what neighbouring parts have in common besides the change
    counts as memory of the motion.

    The chance of a false alarm is at most 0.5 % for all columns together; of more than 50 columns
    50 sums with fixed pseudo-random signs are tested. It is 0.1 % where parts are independent. The
    largest measured one is 0.47 % +- 0.05 %, of 500 iterates of the intermittent logistic map at
    3.8282. A run that is chaotic throughout shows nothing of the kind: a transient longer than the
    run looks like sustained chaos.

    Parameters
    ----------
    series : (n, k) array
        Observables of the run, logarithms of stretching among them, in the order of time; what is
        not finite is left out.

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
    columns = series[:, np.isfinite(series).all(axis=0)]
    if len(series) < 2 * _LEAST or not columns.shape[1]:
        return None
    columns = columns[:, np.ptp(columns, axis=0) > _TOLERANCE * abs(columns).max(axis=0)]
    begins = [_periodic_from(column) for column in columns.T]
    if 0 in begins:  # the motion is periodic throughout
        return None
    found = [at for at in begins if at is not None]
    if found:
        return RegimeChange(min(found), len(series), periodic=True)
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


def _periodic_from(column: Array) -> int | None:
    """From which value on a column (n,) repeats itself to its end; None where it does not."""
    near = _TOLERANCE * float(abs(column).max())
    longest = len(column) // _REPETITIONS
    for period in (np.flatnonzero(abs(column[-2::-1][:longest] - column[-1]) <= near) + 1).tolist():
        least = max(_REPETITIONS * period, _LEAST)
        if least > len(column):
            return None
        tail = column[-least:]
        if (abs(tail[period:] - tail[:-period]) <= near).all():
            near *= _NEAR / _TOLERANCE
            apart = np.flatnonzero(abs(column[period:] - column[:-period]) > near)
            return int(apart[-1]) + 1 if len(apart) else 0
    return None


def _statistic(means: Array, allowed: NDArray[np.bool_]) -> tuple[Array, NDArray[np.intp]]:
    """Shao and Zhang's G of columns (b, k), and the part (k,) with which the new regime begins.

    A new regime begins with one of the parts that are allowed, (b,), never with the first. Where
    neighbouring parts have a correlation r > 0 besides the change, the parts count as (1 - r) /
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
    """Sums of squares of the first k sums (b, k) less the line from zero to the last of them."""
    t = np.arange(1.0, len(sums) + 1.0)[:, None]
    slopes = sums / t
    crossed = slopes * np.cumsum(t * sums, axis=0)
    lines = slopes**2 * np.cumsum(t**2, axis=0)
    return np.asarray(np.cumsum(sums**2, axis=0) - 2.0 * crossed + lines)
