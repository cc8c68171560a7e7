"""The map of Henon."""

from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, finite_array, finite_scalar
from dynkit.dynamics.map import Map


@dataclass(frozen=True)
class Henon(Map):
    """The map of Henon: x' = 1 - a x^2 + y, y' = b x.

    Its determinant is -b everywhere. Two fixed points are born at a = -(1 - b)^2 / 4, and one of
    them doubles its period at a = 3 (1 - b)^2 / 4.

    Parameters
    ----------
    a, b : float
        By default those of Henon's strange attractor.

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

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", finite_scalar("a", self.a))
        object.__setattr__(self, "b", finite_scalar("b", self.b))

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        return np.array([1.0 - self.a * x * x + y, self.b * x])

    def jacobian(self, state: Array) -> Array:
        x, _ = finite_array("state", state, (2,))
        return np.array([[-2.0 * self.a * x, 1.0], [self.b, 0.0]])

    def parameter_derivative(self, state: Array, name: str) -> Array:
        x, _ = finite_array("state", state, (2,))
        self.value_of(name)
        return np.array([-x * x, 0.0] if name == "a" else [0.0, x])
