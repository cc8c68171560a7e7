"""Rossler's folded towel."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class FoldedTowel(SymbolicMap):
    """Rossler's folded towel, a map with two directions of stretching (hyperchaos).

    x' = 3.8 x (1 - x) - 0.05 (y + 0.35) (1 - 2 z),
    y' = 0.1 ((y + 0.35) (1 - 2 z) - 1) (1 - 1.9 x),
    z' = 3.78 z (1 - z) + 0.2 y.

    Parameters
    ----------
    a, b, c : float
        The numbers 3.8, 0.05 and 0.35.
    d, e, f : float
        The numbers 0.1, 1.9 and 3.78.
    g : float
        The number 0.2.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    O. E. Rossler, An equation for hyperchaos, Phys. Lett. A 71 (1979) 155-157.

    Examples
    --------
    >>> FoldedTowel()([0.0, 0.15, 0.0])
    array([-0.025, -0.05 ,  0.03 ])
    """

    a: float = 3.8
    b: float = 0.05
    c: float = 0.35
    d: float = 0.1
    e: float = 1.9
    f: float = 3.78
    g: float = 0.2

    def next_state(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        fold = (y + self.c) * (1 - 2 * z)
        return (
            self.a * x * (1 - x) - self.b * fold,
            self.d * (fold - 1) * (1 - self.e * x),
            self.f * z * (1 - z) + self.g * y,
        )
