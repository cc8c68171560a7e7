"""Errors of Floquet multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.multipliers import MARGIN, PROBES, disturbed_eigenvalues

_ROUNDING = 2.0**-52
# The smallest positive number: a smaller multiplier or change underflows to zero.
_SMALLEST = 2.0**-1074


def multiplier_errors(problem: Problem, x: Array, p: Array, found: Any, moved: Array) -> Array:
    """Return the error of each multiplier found, (d,); infinite where it is not known.

    It is four times the largest change in a few trials: unknowns and parameters are disturbed by
    their errors, `moved` (m + k,), with random signs, and the factors of the product, whose
    eigenvalues the multipliers are, by their errors.
    """
    worst, random, m = np.zeros(len(found)), np.random.default_rng(0), len(x)
    if not (len(found) and np.isfinite(found).all() and np.isfinite(moved).all()):
        return np.full(len(found), np.inf)
    for _ in range(PROBES):
        step = moved * random.choice([-1.0, 1.0], len(moved))
        try:
            there = _disturbed(problem, x + step[:m], p + step[m:], random)
        except (NoMotion, np.linalg.LinAlgError):
            return np.full(len(found), np.inf)
        if not np.isfinite(there).all():
            return np.full(len(found), np.inf)
        worst = np.maximum(worst, _changes(found, there))
    return np.asarray(MARGIN * (worst + _ROUNDING * abs(found)))


def _disturbed(problem: Problem, x: Array, p: Array, random: np.random.Generator) -> Any:
    known = problem.factors(x, p)
    if known is None:
        return problem.spectrum(x, p)
    return disturbed_eigenvalues(*known, random)


def _changes(found: Any, there: Any) -> Array:
    """Return the change (d,) of each multiplier; the last, without partners, are exact zeros.

    `there` are the multipliers of a trial, matched with those `found` by the least sum of changes.
    """
    from scipy.optimize import linear_sum_assignment

    apart = abs(np.subtract.outer(found[: len(there)], there))
    out = np.zeros(len(found))
    rows, columns = linear_sum_assignment(apart)
    out[rows] = np.maximum(apart[rows, columns], _SMALLEST)
    return out
