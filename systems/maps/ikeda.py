"""The map of Ikeda."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class Ikeda(SymbolicMap):
    """The map of Ikeda: z' = a + u z exp(i t), t = k - p / (1 + x^2 + y^2), z = x + i y.

    It describes the light in a ring cavity with a nonlinear absorber, from one round trip to the
    next. The amplitude that enters is a, and u is the fraction of the amplitude kept in a round
    trip. The phase changes by k without the absorber; p is the strength of the absorber's part. The
    determinant is u^2 everywhere.

    Parameters
    ----------
    u, a, k, p : float
        By default the values of the strange attractor.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    K. Ikeda, Multiple-valued stationary state and its instability of the transmitted light by a
    ring cavity system, Optics Communications 30 (1979) 257-261. S. M. Hammel, C. K. R. T. Jones, J.
    V. Moloney, Global dynamical behavior of the optical field in a ring cavity, J. Opt. Soc. Am. B
    2 (1985) 552-564, equation 1.2.

    Examples
    --------
    >>> Ikeda()([0.0, 0.0])
    array([1., 0.])
    >>> from dynkit import MapAttractor
    >>> print(MapAttractor(Ikeda(u=0.4), [0.0, 0.0], transient=500, iterations=100).label)
    P(1)
    """

    u: float = 0.9
    a: float = 1.0
    k: float = 0.4
    p: float = 6.0

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        from sympy import cos, sin

        t = self.k - self.p / (1 + x**2 + y**2)
        return (
            self.a + self.u * (x * cos(t) - y * sin(t)),
            self.u * (x * sin(t) + y * cos(t)),
        )
