"""Orbit labels: P(n,m), P(inf,m), quasi-periodic, chaotic or unsettled."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import ClassVar, final

import numpy as np

from dynkit.core.cost import Cost


class OrbitKind(Enum):
    """What kind of motion an orbit is; the value is what the user reads."""

    PERIODIC = "periodic"
    STICKING = "periodic with sticking"
    CHAOTIC = "chaotic"
    UNSETTLED = "unsettled"
    AT_REST = "at rest"
    QUASI_PERIODIC = "quasi-periodic"


@final
@dataclass(frozen=True)
class OrbitLabel:
    """The label of an orbit, and what it was decided from.

    Parameters
    ----------
    kind : OrbitKind
    iterates : int or None
        n of P(n,m): iterates of the map, such as impacts, in one period. None for P(inf,m) and
        whatever is not periodic.
    periods : int or None
        m of P(n,m): periods of the forcing in one period. None for a map that has none.
    tolerance : float
        Recurrence that counts as periodic, relative to the largest state of the window.
    recurrence : float
        Recurrence that was found, in the same units. For a periodic orbit the largest distance
        between states a period apart; it may exceed the tolerance when the orbit was seen to settle
        geometrically. For a quasi-periodic motion the largest distance of a state from a smooth
        closed curve through the states beside it, relative to the size of the curve. Otherwise the
        smallest distance of the last state to an earlier one, or infinity when there was none to
        compare.
    simulated : int
        States that were looked at, those for the growth of disturbances included.
    transient_chaos : int
        States that had passed, at least, when chaos was last seen before; see `settled_label`.
    chance : float
        Of chaos the chance that disturbances grow as much, block by block, in a motion in which
        they do not grow on average; see `label_orbit`.
    multiplier, multiplier_error : float
        Largest modulus of the multipliers over the last period, and an estimate of its distance to
        that of the orbit itself; NaN where the motion is not periodic or has no derivative. See
        `stable`.
    rotation_number, rotation_error : float
        Of a quasi-periodic motion the turns on a closed curve from a state to the next one on it,
        in (0, 1/2), and an estimate of the distance to the exact number; NaN for other kinds. The
        curve has no orientation, so that w and 1 - w are the same. Whole turns do not show in the
        states: a flow, or a forced motion, may make some more between them. The states are iterates
        of the map; impacts, or of a motion that sticks, releases.
    curves : int
        Of a quasi-periodic motion how many closed curves the states visit in turn, as after a
        Neimark-Sacker bifurcation of an orbit of that many iterates; zero for other kinds. The
        rotation number is that of as many iterates, which lead back to the curve. Where these last
        for m periods of the forcing on average, it is the rotation number divided by m in turns a
        period.
    seconds : float
        Wall-clock time of the decision; the states that were kept before are not in it.
    count_harmonics, count_events, measure_period : callable, optional
        What `harmonics`, `counts` and `period` ask, once.

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
        """How wrong the label may be, in the sense of its kind.

        Of P(n,m) and P(inf,m) the `recurrence`: how far the states are, relative, from repeating
        themselves, which whatever is slower than the window can hide behind. Of a quasi-periodic
        motion the `recurrence`, too: how far the states are, relative, from closed curves; how
        wrong its rotation number may be is the `rotation_error`. Of chaos the `chance`.
        Of a motion at rest zero: that no impact comes any more, or none that doubles can hold, is
        proved. An unsettled one claims nothing: infinite.
        """
        if self.kind in (OrbitKind.PERIODIC, OrbitKind.STICKING, OrbitKind.QUASI_PERIODIC):
            return self.recurrence
        if self.kind is OrbitKind.CHAOTIC:
            return self.chance
        return 0.0 if self.kind is OrbitKind.AT_REST else np.inf

    @property
    def stable(self) -> bool | None:
        """Whether the periodic orbit attracts; None where that is not certain.

        A state that lies on an unstable orbit to rounding stays there for as long as anybody
        simulates, as may a motion that is as symmetric as its system: it recurs, and is no
        attractor. Certain is what the `multiplier` says by more than its error.
        """
        if self.multiplier + self.multiplier_error < 1.0:
            return True
        return False if self.multiplier - self.multiplier_error > 1.0 else None

    @property
    def cost(self) -> Cost:
        """Seconds of the decision, and states that were looked at."""
        return Cost(self.seconds, {"states": self.simulated})

    @cached_property
    def harmonics(self) -> int | None:
        """How many harmonics of 1/m of the forcing hold 99 % of the power, strongest first.

        Of the contact coordinate of an impact oscillator, on P(n,m) or P(inf,m): the power is its
        mean square about its mean. Counted when first asked for, from samples of one period. None
        for what is not periodic, and for maps.
        """
        return None if self.count_harmonics is None else self.count_harmonics()

    @cached_property
    def counts(self) -> dict[str, float] | None:
        """What happens in one period, by the elements of a machine.

        Of an impact oscillator on P(n,m) or P(inf,m), under names like those of its parameters:
        ``table.impacts``, infinite where they accumulate, and ``table.contacts`` of hard stops,
        ``presses`` of soft ones and ``sticks`` of friction: how often each begins, so
        that what always sticks counts zero. Counted when first asked for. None for what is not
        periodic, and maps.
        """
        return None if self.count_events is None else self.count_events()

    @property
    def period(self) -> float | None:
        """How long a period of the motion lasts, in units of time.

        Of an impact oscillator on P(n,m) or P(inf,m), m periods of the forcing; of a machine that
        nothing drives, on P(n), what is measured when first asked for. None for what is not
        periodic, and maps.
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
        """The label without a rotation number, so that neighbouring motions of a kind share it."""
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
