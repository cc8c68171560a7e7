"""Lorenz's equations."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class Lorenz(SymbolicFlow):
    """Lorenz's equations: x' = sigma (y - x), y' = rho x - y - x z, z' = x y - beta z.

    Volumes shrink at the rate sigma + 1 + beta everywhere. The equations are symmetric under (x, y,
    z) -> (-x, -y, z). For rho > 1 there are two fixed points besides the origin, at x = y =
    +-sqrt(beta (rho - 1)), z = rho - 1. They lose stability at rho = sigma (sigma + beta +
    3)/(sigma - beta - 1), which is 24.74 for the default parameters.

    Parameters
    ----------
    sigma, rho, beta : float
        By default the values of Lorenz.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    E. N. Lorenz, Deterministic nonperiodic flow, J. Atmos. Sci. 20 (1963) 130-141, equations 25 to
    27. C. Sparrow, The Lorenz Equations, Springer 1982.

    Examples
    --------
    >>> from dynkit import Hyperplane, PoincareMap
    >>> lorenz = Lorenz()
    >>> plane = Hyperplane([0.0, 0.0, 1.0], offset=lorenz.rho - 1.0, direction=-1)
    >>> returns = PoincareMap(lorenz, plane, time_limit=10.0)
    >>> returns([2.0, 2.0]).round(6)
    array([ 3.571732, -0.040406])
    """

    sigma: float = 10.0
    rho: float = 28.0
    beta: float = 8.0 / 3.0

    def velocity(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        return self.sigma * (y - x), x * (self.rho - z) - y, x * y - self.beta * z
