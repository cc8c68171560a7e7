"""The driven Duffing oscillator."""

from dataclasses import dataclass
from typing import Any

from dynkit.core.validation import check_fields, positive
from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class Duffing(SymbolicFlow):
    """Duffing's oscillator: x'' + damping x' + stiffness x + cubic x^3 = force cos(phase).

    The state holds x, its rate v and the phase of the force, phase' = frequency. The phase grows
    without bound; states whose phases differ by 2 pi have the same motion. The map from one period
    of the force to the next is ``PoincareMap(duffing, Stroboscope(3), time_limit)``, with a time
    limit above the period 2 pi / frequency. Its states are x and v. Other sections need the phase
    declared as an angle: ``Hyperplane([0.0, 1.0, 0.0], direction=-1, angles=[2])`` is crossed at
    the maxima of x.

    Volumes change at the rate -damping everywhere. Without damping and force the energy v^2/2 +
    stiffness x^2/2 + cubic x^4/4 is conserved.

    Parameters
    ----------
    damping, stiffness, cubic, force : float
        By default the values of chaotic motion in two wells.
    frequency : float
        Angular frequency of the force; positive.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    J. Guckenheimer and P. Holmes, Nonlinear Oscillations, Dynamical Systems, and Bifurcations of
    Vector Fields, Springer 1983, section 2.2. D. W. Jordan and P. Smith, Nonlinear Ordinary
    Differential Equations, 4th ed., Oxford 2007, chapter 13: damping 0.3, frequency 1.2.

    Examples
    --------
    >>> from dynkit import MapAttractor, PoincareMap, Stroboscope
    >>> duffing = Duffing(force=0.28)
    >>> stroboscopic = PoincareMap(duffing, Stroboscope(3), time_limit=10.0)
    >>> print(MapAttractor(stroboscopic, [1.0, 0.0], transient=60, iterations=20).label)
    P(2)
    """

    damping: float = 0.3
    stiffness: float = -1.0
    cubic: float = 1.0
    force: float = 0.5
    frequency: float = 1.2

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, frequency=positive)

    def velocity(self, x: Any, v: Any, phase: Any) -> tuple[Any, ...]:
        from sympy import cos

        spring = self.stiffness * x + self.cubic * x**3
        return v, self.force * cos(phase) - self.damping * v - spring, self.frequency
