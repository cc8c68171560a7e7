"""Orbit labels: P(n,m), P(inf,m), quasi-periodic, chaotic or unsettled; many as columns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, final

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property


class OrbitKind(Enum):
    """The kind of an orbit; the value is its name in messages."""

    PERIODIC = "periodic"
    STICKING = "periodic with sticking"
    CHAOTIC = "chaotic"
    UNSETTLED = "unsettled"
    NO_IMPACTS = "no impacts"
    QUASI_PERIODIC = "quasi-periodic"
    NO_MOTION = "no motion"


@final
@dataclass(frozen=True)
class OrbitLabel:
    """The label of an orbit, and the measurements behind it.

    Parameters
    ----------
    kind : OrbitKind
    iterates : int or None
        n of P(n,m): iterates of the map, such as impacts, in one period. None for P(inf,m) and
        for motions that are not periodic.
    periods : int or None
        m of P(n,m): periods of the forcing in one period. None for a map without forcing.
    tolerance : float
        Largest recurrence of a periodic motion, relative to the largest state of the window.
    recurrence : float
        Measured recurrence, in the same units. For a periodic orbit, the largest distance between
        states a period apart; it may exceed the tolerance when the motion settles geometrically.
        For a quasi-periodic motion, the largest distance of a state from a smooth closed curve
        through its neighbours, relative to the size of the curve. For a motion without further
        impacts, zero if further impacts are excluded, otherwise infinity. NaN where there is no
        motion. For all other motions,
        the smallest distance of the last state to an earlier one, or infinity without earlier ones.
    simulated : int
        Number of examined states, including those for the growth of disturbances.
    transient_chaos : int
        Number of states, at least, before the end of the transient chaos; see `settled_label`.
    chance : float
        For chaos, the p-value of zero mean growth of disturbances; see `label_orbit`.
    multiplier, multiplier_error : float
        Largest modulus of the multipliers over the last period, and an estimate of its distance to
        that of the orbit itself. Both are NaN where the motion is not periodic or has no
        derivative. See `stable`.
    rotation_number, rotation_error : float
        The turns of a quasi-periodic motion from a state to the next one on the same closed curve,
        in (0, 1/2). The second number is an estimate of the distance to the exact one. Both are NaN
        for other kinds. The curve has no orientation, so w and 1 - w are the same. Whole turns
        between states are not visible in the states. The states are iterates of the map: impacts,
        or releases where the motion sticks.
    curves : int
        For a quasi-periodic motion, the number of closed curves that the states visit in turn. A
        Neimark-Sacker bifurcation of an orbit of n iterates gives n curves. Zero for other kinds.
        The rotation number belongs to that many iterates, which return to the same curve. Where
        they take m periods of the forcing on average, the turns per period are the rotation number
        divided by m.
    seconds : float
        Wall-clock time of the decision, without that of the kept states.
    count_harmonics, count_events, measure_period : callable, optional
        Functions that `harmonics`, `counts` and `period` call once.

    Examples
    --------
    >>> str(OrbitLabel(OrbitKind.PERIODIC, 5, 2, 1e-6, 3e-14, 100))
    'P(5,2)'
    >>> str(OrbitLabel(OrbitKind.PERIODIC, 4, None, 1e-6, 0.0, 100))
    'P(4)'
    >>> str(OrbitLabel(OrbitKind.PERIODIC, 39, 15, 1e-6, 3e-14, 30000, transient_chaos=20000))
    'P(39,15) after transient chaos'
    >>> label = OrbitLabel(
    ...     OrbitKind.PERIODIC, 1, None, 1e-6, 0.0, 100, multiplier=1.5, multiplier_error=1e-12
    ... )
    >>> str(label), label.stable
    ('P(1) unstable', False)
    >>> turning = {"rotation_number": 0.1647841535218, "rotation_error": 1e-13, "curves": 1}
    >>> str(OrbitLabel(OrbitKind.QUASI_PERIODIC, None, None, 1e-6, 3e-9, 20000, **turning))
    'quasi-periodic, rotation number 0.164784'
    """

    _stored: ClassVar = (
        *("kind", "iterates", "periods", "tolerance", "recurrence", "simulated", "transient_chaos"),
        *("chance", "multiplier", "multiplier_error", "seconds"),
        *("rotation_number", "rotation_error", "curves"),
    )
    kind: OrbitKind
    iterates: int | None
    periods: int | None
    tolerance: float
    recurrence: float
    simulated: int
    transient_chaos: int = 0
    chance: float = np.inf
    multiplier: float = field(default=np.nan, repr=False, compare=False)
    multiplier_error: float = field(default=np.nan, repr=False, compare=False)
    seconds: float = field(default=0.0, repr=False, compare=False)
    rotation_number: float = field(default=np.nan, repr=False, compare=False)
    rotation_error: float = field(default=np.nan, repr=False, compare=False)
    curves: int = 0
    count_harmonics: Callable[[], int] | None = field(default=None, repr=False, compare=False)
    count_events: Callable[[], dict[str, float] | None] | None = field(
        default=None, repr=False, compare=False
    )
    measure_period: Callable[[], tuple[float, float]] | None = field(
        default=None, repr=False, compare=False
    )

    @property
    def error(self) -> float:
        """Measure of the label's uncertainty; its meaning depends on the kind.

        For P(n,m) and P(inf,m) it is the `recurrence`, the relative distance of states a period
        apart; a drift slower than the window may be smaller than this. For a quasi-periodic motion
        it is also the `recurrence`, the relative distance of the states from closed curves; the
        rotation number has the `rotation_error`. For chaos it is the `chance`, a p-value. For a
        motion without further impacts it is zero where these are excluded, by a proof or because
        the motion cannot go on, and infinite where the search for one was given up. It is infinite
        for an unsettled motion, and NaN where there is no motion.
        """
        if self.kind is OrbitKind.CHAOTIC:
            return self.chance
        return np.inf if self.kind is OrbitKind.UNSETTLED else self.recurrence

    @property
    def stable(self) -> bool | None:
        """Whether the periodic orbit is stable; None where that is not certain.

        A simulation may remain on an unstable orbit when it starts there to rounding, or when the
        motion has the symmetry of its system: it recurs without being an attractor. The answer is
        certain when the `multiplier` differs from 1 by more than its error.
        """
        if self.multiplier + self.multiplier_error < 1.0:
            return True
        return False if self.multiplier - self.multiplier_error > 1.0 else None

    @property
    def cost(self) -> Cost:
        """Seconds of the decision, and number of examined states."""
        return Cost(self.seconds, {"states": self.simulated})

    @cached_property
    def harmonics(self) -> int | None:
        """Number of harmonics of 1/m of the forcing that hold 99 % of the power, strongest first.

        It describes the contact coordinate of an impact oscillator on P(n,m) or P(inf,m); the power
        is the coordinate's variance. It is computed when first read, from samples of one period.
        None for motions that are not periodic, and for maps.
        """
        return None if self.count_harmonics is None else self.count_harmonics()

    @cached_property
    def counts(self) -> dict[str, float] | None:
        """Number of events in one period, by element and kind.

        For an impact oscillator on P(n,m) or P(inf,m), the names are like those of its parameters.
        Hard stops have ``table.impacts`` (infinite where they accumulate) and ``table.contacts``,
        soft stops ``presses``, and friction ``sticks``. Contacts, presses and sticks count
        beginnings, so an element that always sticks counts zero. Computed when first read. None for
        motions that are not periodic, and for maps.
        """
        return None if self.count_events is None else self.count_events()

    @property
    def period(self) -> float | None:
        """Duration of one period of the motion, in units of time.

        For an impact oscillator on P(n,m) or P(inf,m) it is m periods of the forcing. For a machine
        without forcing, on P(n), it is measured when it is first read. None for motions that are
        not periodic, and for maps.
        """
        return None if self._measured is None else self._measured[0]

    @property
    def period_error(self) -> float | None:
        """Estimate of the distance of the `period` to that of the orbit itself."""
        return None if self._measured is None else self._measured[1]

    @cached_property
    def _measured(self) -> tuple[float, float] | None:
        return None if self.measure_period is None else self.measure_period()

    @property
    def name(self) -> str:
        """The label without the rotation number: neighbouring quasi-periodic motions share it."""
        name = str(self.kind.value)
        if self.kind is OrbitKind.STICKING:
            name = f"P(inf,{self.periods})"
        if self.kind is OrbitKind.PERIODIC:
            numbers = (self.iterates, self.periods)
            name = f"P({','.join(str(n) for n in numbers if n is not None)})"
        if self.stable is False:
            name += " unstable"
        return f"{name} after transient chaos" if self.transient_chaos else name

    def __repr__(self) -> str:
        return f"<OrbitLabel {self}: error {self.error:.1e}, {self.simulated} states>"

    def __str__(self) -> str:
        if self.kind is not OrbitKind.QUASI_PERIODIC:
            return self.name
        digits = next((k for k in range(6, 1, -1) if self.rotation_error <= 10.0**-k), 1)
        on = f" on {self.curves} curves" if self.curves > 1 else ""
        return f"{self.name}, rotation number {self.rotation_number:.{digits}f}{on}"


# --- labels of many motions as columns of numbers, which a store keeps ----------------------------

_NUMBERS = "iterates", "periods", "simulated", "curves"
_SIZES = (
    *("tolerance", "recurrence", "chance"),
    *("multiplier", "multiplier_error", "rotation_number", "rotation_error"),
)

COLUMNS: dict[str, tuple[str, tuple[int | None, ...]]]
COLUMNS = {"kind": ("i", ()), "numbers": ("i", (len(_NUMBERS),)), "sizes": ("f", (len(_SIZES),))}
"""Columns that `empty_columns` returns: kind of the numbers, and shape of a row."""

KINDS = tuple(OrbitKind)
"""The kind of orbit for each number in the column of kinds, where there is a motion."""


def empty_columns(count: int, kind: int) -> dict[str, Any]:
    """Return the columns of `count` motions, all with the same number of kind, for `put_label`."""
    return {
        "kind": np.full(count, kind, dtype=np.int64),
        "numbers": np.zeros((count, len(_NUMBERS)), dtype=np.int64),  # 0 for no iterates or periods
        "sizes": np.full((count, len(_SIZES)), np.nan),
    }


def put_label(columns: Mapping[str, Any], place: int, label: OrbitLabel) -> None:
    """Write a label into row `place` of the columns, in place."""
    columns["kind"][place] = KINDS.index(label.kind)
    columns["numbers"][place] = [getattr(label, name) or 0 for name in _NUMBERS]
    columns["sizes"][place] = [getattr(label, name) for name in _SIZES]


def label_in(columns: Mapping[str, Any], place: int, kind: OrbitKind) -> OrbitLabel:
    """Return the label of this kind in row `place` of the columns, with its stability."""
    n, m, simulated, curves = columns["numbers"][place].tolist()
    sizes = dict(zip(_SIZES, columns["sizes"][place].tolist(), strict=True))
    return OrbitLabel(kind, n or None, m or None, simulated=simulated, curves=curves, **sizes)
