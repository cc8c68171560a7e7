"""Chua's circuit with a cubic nonlinearity."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class Chua(SymbolicFlow):
    """Chua's circuit: x' = alpha (y - a x^3 - c x), y' = x - y + z, z' = -beta y.

    The cubic replaces the piecewise linear characteristic of Chua's diode. The equations are
    symmetric under (x, y, z) -> (-x, -y, -z). For c < 0 < a there are three fixed points: the
    origin and x = -z = +-sqrt(-c/a), y = 0.

    Parameters
    ----------
    alpha, beta, a, c : float
        By default the values of the double scroll.

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    A. I. Khibnik, D. Roose, L. O. Chua, On periodic orbits and homoclinic bifurcations in Chua's
    circuit with a smooth nonlinearity, Int. J. Bifurcation and Chaos 3 (1993) 363-384. L. O. Chua,
    M. Komuro, T. Matsumoto, The double scroll family, IEEE Trans. Circuits Syst. 33 (1986)
    1072-1118.

    Examples
    --------
    >>> from dynkit import equilibrium
    >>> equilibrium(Chua(), [1.5, 0.1, -1.5]).state.round(6)
    array([ 1.632993,  0.      , -1.632993])
    """

    alpha: float = 10.0
    beta: float = 14.0
    a: float = 1.0 / 16.0
    c: float = -1.0 / 6.0

    def velocity(self, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
        return self.alpha * (y - self.a * x**3 - self.c * x), x - y + z, -self.beta * y
