"""A ball on a vibrating table, as Holmes's map for high bounces."""

from dataclasses import dataclass
from typing import Any, ClassVar

from dynkit.core.validation import in_interval, non_negative
from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class HighBounce(SymbolicMap):
    """A ball that bounces high above a vibrating table: phi' = phi + v, v' = r v - gamma cos(phi').

    r is the restitution. The state holds the table's phase phi at an impact and the ball's velocity
    v just after it. The unit of velocity is such that v is the phase that passes until the next
    impact. For a table at -A sin(w t), gravity g and velocity V,

        phi = w t,    v = 2 w V / g,    gamma = 2 w^2 (1 + r) A / g.

    For a table at +A sin(w t), phi = w t + pi. The table's displacement is neglected relative to
    the height of the bounces. So the error of the next impact's phase is at most 2 gamma / ((1 + r)
    v), to leading order, and a negative v has no meaning. `BouncingBall` has the exact motion.

    The determinant is r everywhere; with r = 1 this is the standard map, with K = gamma. The fixed
    points are v = 2 pi n, cos phi = -2 pi n (1 - r) / gamma. For every n >= 0 a pair of them is
    born at gamma = 2 pi n (1 - r). The one with sin phi < 0 is stable up to gamma = 2 sqrt((pi n (1
    - r))^2 + (1 + r)^2), where it doubles its period.

    Parameters
    ----------
    restitution : float
        Coefficient of restitution r, in [0, 1].
    gamma : float
        Strength of the table's vibration; not negative.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    P. J. Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table, Journal of
    Sound and Vibration 84 (1982) 173-189. J. Guckenheimer and P. Holmes, Nonlinear Oscillations,
    Dynamical Systems, and Bifurcations of Vector Fields, Springer 1983, section 2.4.

    Examples
    --------
    >>> import numpy as np
    >>> ball = HighBounce(restitution=0.8, gamma=2.0)
    >>> phase = np.arccos(-2 * np.pi * 0.2 / 2.0)  # of the bounce that takes one table period
    >>> state = np.array([2 * np.pi - phase, 2 * np.pi])
    >>> bool(abs(ball.difference(ball(state), state)).max() < 1e-14)
    True
    """

    angles: ClassVar = ("phase",)

    restitution: float
    gamma: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "restitution", in_interval("restitution", self.restitution, 0, 1))
        object.__setattr__(self, "gamma", non_negative("gamma", self.gamma))

    def next_state(self, phase: Any, velocity: Any) -> tuple[Any, ...]:
        from sympy import Mod, cos, pi

        arrival = Mod(phase + velocity, 2 * pi)
        return arrival, self.restitution * velocity - self.gamma * cos(arrival)
