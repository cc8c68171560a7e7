"""The brusselator."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class Brusselator(SymbolicFlow):
    """A chemical oscillator: x' = a - (b + 1) x + x^2 y, y' = b x - x^2 y.

    Its fixed point x = a, y = b/a has a Hopf bifurcation at b = 1 + a^2, where the frequency is a.

    Parameters
    ----------
    a, b : float
        Concentrations that are held constant.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    I. Prigogine, R. Lefever, Symmetry breaking instabilities in dissipative systems II, J. Chem.
    Phys. 48 (1968) 1695-1700.

    Examples
    --------
    >>> from dynkit import continue_orbit, equilibrium
    >>> branch = continue_orbit(equilibrium(Brusselator(b=1.0), [1.0, 1.0]), "b", bounds=(1.0, 3.0))
    >>> [(found.kind.value, round(found.value, 9)) for found in branch.bifurcations]
    [('HB', 2.0)]
    """

    a: float = 1.0
    b: float = 3.0

    def velocity(self, x: Any, y: Any) -> tuple[Any, ...]:
        return self.a - (self.b + 1) * x + x**2 * y, self.b * x - x**2 * y
