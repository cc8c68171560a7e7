"""The galaxy of Henon and Heiles."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class HenonHeiles(SymbolicFlow):
    """A star in a galaxy: x'' = -x - 2 k x y, y'' = -y - k (x^2 - y^2).

    The state is x, y and their rates u, v. The energy (u^2 + v^2 + x^2 + y^2)/2 + k (x^2 y - y^3/3)
    is conserved; with k = 1, motions of energies below 1/6 stay in a triangle. Periodic orbits form
    families; they are isolated in a `PoincareMap` at one energy, ``level=("energy", 0.1)``.

    Parameters
    ----------
    k : float
        Strength of the cubic terms.

    Raises
    ------
    ValueError
        When k is not finite.

    References
    ----------
    M. Henon, C. Heiles, The applicability of the third integral of motion: some numerical
    experiments, Astronomical Journal 69 (1964) 73-79.

    Examples
    --------
    >>> HenonHeiles().advance([0.1, 0.2, 0.3, 0.0], 1.0).round(6)
    array([ 0.275959,  0.106957,  0.018541, -0.187764])
    """

    integrals = ("energy",)
    k: float = 1.0

    def velocity(self, x: Any, y: Any, u: Any, v: Any) -> tuple[Any, ...]:
        return u, v, -x - 2 * self.k * x * y, -y - self.k * (x**2 - y**2)

    def energy(self, x: Any, y: Any, u: Any, v: Any) -> Any:
        """Return the energy."""
        return (u**2 + v**2 + x**2 + y**2) / 2 + self.k * (x**2 * y - y**3 / 3)
