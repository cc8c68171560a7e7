"""Lorenz's equations."""

from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, check_fields, finite_array, finite_scalar
from dynkit.systems.flows.integrated import IntegratedFlow


@dataclass(frozen=True, kw_only=True)
class Lorenz(IntegratedFlow):
    """Lorenz's equations: x' = sigma (y - x), y' = rho x - y - x z, z' = x y - beta z.

    Volumes shrink at the rate sigma + 1 + beta everywhere, and (-x, -y, z) moves as (x, y, z) does.
    For rho > 1 there are two fixed points besides the origin, at x = y = +-sqrt(beta (rho - 1)), z
    = rho - 1. They lose stability at rho = sigma (sigma + beta + 3)/(sigma - beta - 1), which is
    24.74 for the default parameters.

    Parameters
    ----------
    sigma, rho, beta : float
        By default Lorenz's own.
    tolerance : float
        As for `IntegratedFlow`.

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

    dimension = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, sigma=finite_scalar, rho=finite_scalar, beta=finite_scalar)

    def velocity(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,)).tolist()
        return np.array([self.sigma * (y - x), x * (self.rho - z) - y, x * y - self.beta * z])

    def velocity_jacobian(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,)).tolist()
        return np.array(
            [[-self.sigma, self.sigma, 0.0], [self.rho - z, -1.0, -x], [y, x, -self.beta]]
        )

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        x, y, z = finite_array("state", state, (3,))
        rows = {"sigma": [y - x, 0.0, 0.0], "rho": [0.0, x, 0.0], "beta": [0.0, 0.0, -z]}
        if name not in rows:
            self.value_of(name)  # refuses it
        return np.array(rows[name])
