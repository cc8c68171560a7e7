"""A pendulum whose pivot moves up and down."""

from dataclasses import dataclass
from typing import Any

from dynkit.core.validation import check_fields, positive
from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class ParametricPendulum(SymbolicFlow):
    """A pendulum whose pivot moves vertically; the pivot's height is amplitude cos(phase).

    x'' + damping x' + (1 - amplitude frequency^2 cos(phase)) sin x = 0. The unit of length is the
    pendulum's length; the unit of time is the period of its small free oscillations over 2 pi. The
    state holds the angle x, zero where the pendulum hangs, its rate v, and the phase, phase' =
    frequency. The map from one period of the pivot to the next is
    ``PoincareMap(pendulum, Stroboscope(3), time_limit)``, with a time limit above the period.

    Near frequency 2 the hanging pendulum becomes unstable and swings once in two periods of the
    pivot. The upright position is stable if amplitude times frequency is larger than about the
    square root of 2. Without damping both stability borders are those of Mathieu's equation.

    Parameters
    ----------
    damping, amplitude : float
    frequency : float
        Angular frequency of the pivot; positive.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    A. Stephenson, On induced stability, Philosophical Magazine 15 (1908) 233-236. E. I. Butikov,
    An improved criterion for Kapitza's pendulum stability, Journal of Physics A 44 (2011) 295202.

    Examples
    --------
    >>> from dynkit import PoincareMap, Stroboscope, periodic_orbit
    >>> pendulum = ParametricPendulum(amplitude=0.2, frequency=8.0)
    >>> stroboscopic = PoincareMap(pendulum, Stroboscope(3), time_limit=1.0)
    >>> periodic_orbit(stroboscopic, [3.1, 0.1]).stable  # upside down
    True
    """

    damping: float = 0.1
    amplitude: float = 0.2
    frequency: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, frequency=positive)

    def velocity(self, x: Any, v: Any, phase: Any) -> tuple[Any, ...]:
        from sympy import cos, sin

        weight = 1 - self.amplitude * self.frequency**2 * cos(phase)
        return v, -self.damping * v - weight * sin(x), self.frequency
