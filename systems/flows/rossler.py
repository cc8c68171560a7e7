"""Rossler's equations."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class Rossler(SymbolicFlow):
    """Rossler's equations: x' = -y - z, y' = x + a y, z' = b + z (x - c).

    For c^2 > 4 a b there are two fixed points: x = (c +- sqrt(c^2 - 4 a b))/2, y = -x/a, z = x/a.

    Parameters
    ----------
    a, b, c : float
        By default the values of Rossler's chaotic attractor.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    O. E. Rossler, An equation for continuous chaos, Phys. Lett. A 57 (1976) 397-398.

    Examples
    --------
    >>> from dynkit import Hyperplane, PoincareMap
    >>> plane = Hyperplane([1.0, 0.0, 0.0])  # x = 0, crossed where y < 0
    >>> returns = PoincareMap(Rossler(), plane, time_limit=50.0)
    >>> returns([-8.38094174, 0.02959006]).round(6)
    array([-8.380942,  0.02959 ])
    """

    a: float = 0.2
    b: float = 0.2
    c: float = 5.7

    def velocity(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        return -y - z, x + self.a * y, self.b + z * (x - self.c)
