"""Flows of hand-written functions for the tests; a store finds their classes here."""

import math
from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, check_fields, finite_array, finite_scalar, positive
from dynkit.systems import IntegratedFlow


@dataclass(frozen=True, kw_only=True)
class Duffing(IntegratedFlow):
    """The equations of `dynkit.systems.Duffing`."""

    damping: float = 0.3
    stiffness: float = -1.0
    cubic: float = 1.0
    force: float = 0.5
    frequency: float = 1.2

    dimension = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, damping=finite_scalar, stiffness=finite_scalar, cubic=finite_scalar)
        check_fields(self, force=finite_scalar, frequency=positive)

    def velocity(self, state: Array) -> Array:
        x, v, phase = finite_array("state", state, (3,)).tolist()
        spring = (self.stiffness + self.cubic * x * x) * x
        drive = self.force * math.cos(phase)
        return np.array([v, drive - self.damping * v - spring, self.frequency])

    def velocity_jacobian(self, state: Array) -> Array:
        x, _, phase = finite_array("state", state, (3,)).tolist()
        return np.array(
            [
                [0.0, 1.0, 0.0],
                [
                    -self.stiffness - 3.0 * self.cubic * x * x,
                    -self.damping,
                    -self.force * math.sin(phase),
                ],
                [0.0, 0.0, 0.0],
            ]
        )

    def velocity_parameter_derivative(self, state: Array, name: str) -> Array:
        x, v, phase = finite_array("state", state, (3,))
        if name == "frequency":
            return np.array([0.0, 0.0, 1.0])
        rates = {"damping": -v, "stiffness": -x, "cubic": -(x**3), "force": math.cos(phase)}
        if name not in rates:
            self.value_of(name)  # refuses it
        return np.array([0.0, rates[name], 0.0])


@dataclass(frozen=True, kw_only=True)
class Lorenz(IntegratedFlow):
    """The equations of `dynkit.systems.Lorenz`."""

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


@dataclass(frozen=True, kw_only=True)
class Rossler(IntegratedFlow):
    """The equations of `dynkit.systems.Rossler`."""

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
