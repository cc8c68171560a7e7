"""Sums of damped oscillators and their certified first root, for direct use."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import Enum
from typing import Any, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import span
from dynkit.core.validation import (
    Array,
    finite_array,
    finite_scalar,
    non_negative,
    positive,
    positive_integer,
    read_only,
)
from dynkit.exponential.modes import Pairs
from dynkit.exponential.propagators import Propagators, cells_of_a_call, ladder, workspace


class RootKind(Enum):
    """Outcome of a search for a first root; the value says it in words."""

    ROOT = "a change of sign"
    TOUCH = "a minimum within the rounding band of zero"
    NEVER = "no root at any later time"
    LIMIT = "no root within the limit of the search"


@final
@dataclass(frozen=True)
class Root:
    """The first root of a sum.

    Attributes
    ----------
    kind : RootKind
    time : float
        The root; infinite when there is none.
    error : float
        Bound of the error of `time`: one unit in its last place plus the shift of the root when f
        changes by the band. The shift is about band / slope at a crossing, and of the order of
        sqrt(band / curvature) at a minimum. Infinite at the limit; zero when there is no root,
        which is proved up to minima within the band.
    rate : float
        Derivative at the root; 0 at a minimum, NaN when there is no root.
    band : float
        Half width of the rounding band: a minimum closer to zero than this may be reported as
        `TOUCH` or passed. Everything else is certain.
    searched : float
        Time up to which there is certainly no other root.
    cost : Cost
        Seconds, and number of examined cells.
    """

    kind: RootKind
    time: float
    error: float
    rate: float
    band: float
    searched: float
    cost: Cost

    def __repr__(self) -> str:
        at = "" if self.time == math.inf else f" at {self.time!r}, error {self.error:.1e}"
        return f"<Root: {self.kind.value}{at}>"


@final
@dataclass(frozen=True, eq=False, init=False)
class ExponentialSum:
    """The sum of damped oscillators, f(s) = offset + sum_k y_k(s), s >= 0.

    Each term satisfies y'' + 2 decay y' + frequency^2 y = 0 with its value and rate at s = 0, for
    any damping: below, at and above the critical one.

    Parameters
    ----------
    value, rate : (n,) array_like
        Value and derivative of each term at s = 0.
    frequency, decay : (n,) array_like
        Undamped angular frequency, positive, and half the damping coefficient, not negative.
    offset : float
        The constant term.

    Raises
    ------
    ValueError
        When an argument is refused; the message names argument, limit and value.

    Examples
    --------
    A cosine: the first root is pi/2.

    >>> abs(ExponentialSum([1.0], [0.0], [1.0], [0.0]).first_root().time - np.pi / 2) < 1e-15
    True

    With the offset one it touches zero at pi:

    >>> root = ExponentialSum([1.0], [0.0], [1.0], [0.0], offset=1.0).first_root()
    >>> root.kind.name, root.rate
    ('TOUCH', 0.0)
    """

    value: Array
    rate: Array
    frequency: Array
    decay: Array
    offset: float

    def __repr__(self) -> str:
        frequencies = f"frequencies {span(self.frequency)}"
        return f"<ExponentialSum: {len(self.value)} terms, {frequencies}, offset {self.offset:.6g}>"

    def __init__(
        self, value: object, rate: object, frequency: object, decay: object, offset: float = 0.0
    ) -> None:
        arrays = {"value": finite_array("value", value, (None,))}
        shape = arrays["value"].shape
        for name, given in (("rate", rate), ("frequency", frequency), ("decay", decay)):
            arrays[name] = finite_array(name, given, shape)
        for k in range(shape[0]):
            positive(f"frequency[{k}]", arrays["frequency"][k])
            non_negative(f"decay[{k}]", arrays["decay"][k])
        for name, array in arrays.items():
            object.__setattr__(self, name, read_only(array.copy()))
        object.__setattr__(self, "offset", finite_scalar("offset", offset))

    @cached_property
    def _prepared(self) -> tuple[Any, Array]:
        """The ladder for the kernels, and the state (2, slots) at s = 0."""
        zeros = np.zeros_like(self.frequency)
        pairs, mixing = Pairs.oscillators(self.frequency, zeros, self.decay, zeros)
        y: Array = np.stack([self.value, self.rate])
        row: Array = np.stack([zeros + 1.0, zeros])
        if mixing is not None:
            solved = np.linalg.solve(np.moveaxis(mixing, 2, 0), y.T[..., None])
            y = np.asarray(solved[..., 0].T, dtype=np.float64)
            row = np.stack([mixing[0, 0], mixing[0, 1]])
        propagators = Propagators.of(pairs)
        state = np.zeros((2, propagators.step.shape[2]))
        state[:, : pairs.count] = y
        return ladder(row, self.offset, propagators, -1), state

    @property
    def band(self) -> float:
        """Half width of the rounding band: (8 + slots) 2^-52 times the sum of the amplitudes."""
        return band(*self._prepared)

    def first_root(
        self, *, rising_from: float | None = None, limit: int = 1_000_000, touches: bool = True
    ) -> Root:
        """Return the first s > 0 at which f falls to zero; no earlier root is missed.

        Parameters
        ----------
        rising_from : float, optional
            For f(0) = 0, the slope f'(0) > 0; it replaces the sum of the rates, whose rounding may
            exceed a small slope. Otherwise f(0) must be positive.
        limit : int
            Largest number of cells to examine.
        touches : bool
            Whether a minimum within the rounding band counts as a root.

        Raises
        ------
        ValueError
            When f(0) is not positive and no slope is given, or the slope is not positive.
        """
        from dynkit.exponential.evaluation_kernels import FOUND, START
        from dynkit.exponential.polynomial_kernels import PAUSED
        from dynkit.exponential.search_kernels import FOREVER, search

        began = time.perf_counter()
        sums, state = self._prepared
        order, slope = 0, 0.0
        if rising_from is not None:
            order, slope = 1, positive("rising_from", rising_from)
        elif not self.value.sum() + self.offset > 0.0:
            raise ValueError(f"f(0) must be positive; got {float(self.value.sum() + self.offset)}")
        most, slots = positive_integer("limit", limit), state.shape[1]
        work = workspace(slots)
        work.states[START] = state
        outcome = PAUSED
        while outcome == PAUSED:
            outcome, n, e, rate, cells = search(
                sums,
                order,
                slope,
                8.0 + slots,
                touches,
                most,
                cells_of_a_call(slots),
                FOREVER,
                work,
            )
        kind = tuple(RootKind)[outcome]
        searched = n * sums.smallest + e
        found = kind in (RootKind.ROOT, RootKind.TOUCH)
        error = math.inf if kind is RootKind.LIMIT else 0.0
        if found:
            curvature = float((sums.rows[4:6] * work.states[FOUND, :, : sums.rows.shape[1]]).sum())
            error = math.ulp(searched) + _displaced(self.band, rate, curvature)
        return Root(
            kind,
            searched if found else np.inf,
            error,
            rate if found else np.nan,
            self.band,
            np.inf if kind is RootKind.NEVER else searched,
            Cost(time.perf_counter() - began, {"cells": cells}),
        )


def _displaced(band: float, rate: float, curvature: float) -> float:
    """Return how far a root moves, or appears beside a minimum, when f changes by the band."""
    bent = 2.0 * band * abs(curvature)
    down = abs(rate) + math.sqrt(max(rate * rate - bent, 0.0))
    by_slope = 2.0 * band / down if down else math.inf
    return min(by_slope, 2.0 * math.sqrt(band / abs(curvature)) if curvature else math.inf)


def band(sums: Any, state: Array) -> float:
    """Return the half width of the rounding band that kernels use, at a state (2, slots)."""
    from dynkit.exponential.evaluation_kernels import BOUND

    rows, seen = sums.rows[BOUND : BOUND + 2], sums.rows.shape[1]
    reach = float((rows * abs(state[:, :seen])).sum())
    return float((8.0 + state.shape[1]) * 2.0**-52 * (reach + abs(sums.offset)))
