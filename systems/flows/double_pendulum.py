"""The double pendulum."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class DoublePendulum(SymbolicFlow):
    """Two point masses on massless rods; the second hangs from the first.

    The state is both angles from the downward vertical, a and b, and their rates u and v. The unit
    of length is the first rod, the unit of mass the first mass, and the unit of time the square
    root of the first rod's length over gravity. The energy is conserved.

    Parameters
    ----------
    mass, length : float
        The second mass, and the length of its rod.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    T. Shinbrot, C. Grebogi, J. Wisdom, J. A. Yorke, Chaos in a double pendulum, American Journal of
    Physics 60 (1992) 491-499.

    Examples
    --------
    >>> DoublePendulum().advance([0.1, 0.1, 0.0, 0.0], 1.0).round(6)
    array([ 0.0576  ,  0.092728, -0.071214, -0.027172])
    """

    mass: float = 1.0
    length: float = 1.0

    def velocity(self, a: Any, b: Any, u: Any, v: Any) -> tuple[Any, ...]:
        from sympy import cos, sin

        m, r = self.mass, self.length
        whole, apart = 1 + m, a - b
        inertia = 1 + m * sin(apart) ** 2
        pull = m * sin(b) * cos(apart) - whole * sin(a)
        push = m * sin(apart) * (u**2 * cos(apart) + r * v**2)
        swing = whole * (sin(a) * cos(apart) - sin(b))
        turn = sin(apart) * (whole * u**2 + m * r * v**2 * cos(apart))
        return u, v, (pull - push) / inertia, (swing + turn) / (r * inertia)
