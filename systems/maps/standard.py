"""The standard map."""

from dataclasses import dataclass
from typing import Any, ClassVar

from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class StandardMap(SymbolicMap):
    """Chirikov's standard map: p' = p + k sin theta, theta' = theta + p' modulo 2 pi.

    It describes a rotor that is kicked once per unit of time, and conserves areas. The angle is
    theta; the momentum p is not wrapped. The fixed point theta = pi, p = 0 loses stability at
    k = 4; the last rotational invariant circle breaks at k = 0.971635.

    Parameters
    ----------
    k : float
        Strength of the kick.

    Raises
    ------
    ValueError
        When k is not finite.

    References
    ----------
    B. V. Chirikov, A universal instability of many-dimensional oscillator systems, Physics Reports
    52 (1979) 263-379, equation 5.1. J. M. Greene, A method for determining a stochastic transition,
    J. Math. Phys. 20 (1979) 1183-1201 (the last circle).

    Examples
    --------
    >>> import numpy as np
    >>> StandardMap(k=0.5)([np.pi / 2, 1.0]).round(6)
    array([3.070796, 1.5     ])
    >>> StandardMap(k=0.5).jacobian([np.pi, 0.0])  # its determinant is 1
    array([[ 0.5,  1. ],
           [-0.5,  1. ]])
    """

    angles: ClassVar = ("theta",)

    k: float = 1.0

    def next_state(self, theta: Any, p: Any) -> tuple[Any, ...]:
        from sympy import Mod, pi, sin

        kicked = p + self.k * sin(theta)
        return Mod(theta + kicked, 2 * pi), kicked
