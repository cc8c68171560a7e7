"""The logistic map."""

from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, finite_array, finite_scalar
from dynkit.dynamics.map import Map


@dataclass(frozen=True)
class Logistic(Map):
    """The logistic map: x' = rate x (1 - x).

    For rates in [0, 4] it maps [0, 1] into itself. Its fixed point 1 - 1/rate doubles its period at
    rate 3, the cycle of period 2 at 1 + sqrt 6; a cycle of period 3 is born at 1 + sqrt 8.

    Parameters
    ----------
    rate : float

    Raises
    ------
    ValueError
        When the rate is not finite.

    References
    ----------
    R. M. May, Simple mathematical models with very complicated dynamics, Nature 261 (1976) 459-467.

    Examples
    --------
    >>> Logistic(rate=2.0)([0.25])
    array([0.375])
    >>> from dynkit import MapAttractor
    >>> print(MapAttractor(Logistic(rate=3.5), [0.4], transient=500, iterations=100).label)
    P(4)
    """

    rate: float = 4.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", finite_scalar("rate", self.rate))

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        x = finite_array("state", state, (1,))
        return self.rate * x * (1.0 - x)

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[self.rate * (1.0 - 2.0 * x)]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        x = finite_array("state", state, (1,))
        self.value_of(name)
        return x * (1.0 - x)
