"""The map of Henon."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class Henon(SymbolicMap):
    """The map of Henon: x' = 1 - a x^2 + y, y' = b x.

    Its determinant is -b everywhere. Two fixed points are born at a = -(1 - b)^2 / 4, and one of
    them doubles its period at a = 3 (1 - b)^2 / 4.

    Parameters
    ----------
    a, b : float
        By default the values of Henon's strange attractor.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    M. Henon, A two-dimensional mapping with a strange attractor, Commun. Math. Phys. 50 (1976)
    69-77, equation 4.

    Examples
    --------
    >>> Henon()([0.5, 0.25])
    array([0.9 , 0.15])
    >>> from dynkit import MapAttractor
    >>> print(MapAttractor(Henon(), [0.0, 0.0], transient=100, iterations=1000).label)
    chaotic
    """

    a: float = 1.4
    b: float = 0.3

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        return 1 - self.a * x**2 + y, self.b * x
