"""Duffing's oscillator, driven."""

import math
from dataclasses import dataclass

import numpy as np

from dynkit.core.validation import Array, check_fields, finite_array, finite_scalar, positive
from dynkit.systems.flows.integrated import IntegratedFlow


@dataclass(frozen=True, kw_only=True)
class Duffing(IntegratedFlow):
    """Duffing's oscillator: x'' + damping x' + stiffness x + cubic x^3 = force cos(phase).

    The state holds x, its rate v and the phase of the force, phase' = frequency. The phase grows
    without bound; states a whole turn apart move alike. The map from one period of the force to the
    next is ``PoincareMap(duffing, Stroboscope(3), time_limit)``, with a time limit above the period
    2 pi / frequency. Its states are x and v. On other sections say that the phase is an angle:
    ``Hyperplane([0.0, 1.0, 0.0], direction=-1, angles=[2])`` is crossed at the maxima of x.

    Volumes change at the rate -damping everywhere. Without damping and force the energy v^2/2 +
    stiffness x^2/2 + cubic x^4/4 is kept.

    Parameters
    ----------
    damping, stiffness, cubic, force : float
        By default the two-well oscillator in chaos.
    frequency : float
        Angular frequency of the force; positive.
    tolerance : float
        As for `IntegratedFlow`.

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
