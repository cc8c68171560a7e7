"""Rossler's equations."""

from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, check_fields, finite_array, finite_scalar
from dynkit.systems.flows.integrated import IntegratedFlow


@dataclass(frozen=True, kw_only=True)
class Rossler(IntegratedFlow):
    """Rossler's equations: x' = -y - z, y' = x + a y, z' = b + z (x - c).

    For c^2 > 4 a b there are two fixed points: x = (c +- sqrt(c^2 - 4 a b))/2, y = -x/a, z = x/a.

    Parameters
    ----------
    a, b, c : float
        By default those of Rossler's chaotic attractor.
    tolerance : float
        As for `IntegratedFlow`.

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

    dimension = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, a=finite_scalar, b=finite_scalar, c=finite_scalar)

    def velocity(self, state: Array) -> Array:
        x, y, z = finite_array("state", state, (3,)).tolist()
        return np.array([-y - z, x + self.a * y, self.b + z * (x - self.c)])

    def velocity_jacobian(self, state: Array) -> Array:
        x, _, z = finite_array("state", state, (3,)).tolist()
        return np.array([[0.0, -1.0, -1.0], [1.0, self.a, 0.0], [z, 0.0, x - self.c]])

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        _, y, z = finite_array("state", state, (3,))
        rows = {"a": [0.0, y, 0.0], "b": [0.0, 0.0, 1.0], "c": [0.0, 0.0, -z]}
        if name not in rows:
            self.value_of(name)  # refuses it
        return np.array(rows[name])
