"""Van der Pol's oscillator."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class VanDerPol(SymbolicFlow):
    """Van der Pol's oscillator: x'' - mu (1 - x^2) x' + x = 0; its state is x and its rate v.

    For every mu > 0 all motions except the equilibrium tend to one limit cycle. Its period is 2 pi
    (1 + mu^2/16 + ...) for small mu, and about (3 - 2 ln 2) mu for large mu, where the flow is
    stiff.

    Parameters
    ----------
    mu : float

    Raises
    ------
    ValueError
        When mu is not finite.

    References
    ----------
    B. van der Pol, On "relaxation-oscillations", Philosophical Magazine 2 (1926) 978-992.

    Examples
    --------
    >>> from dynkit import Hyperplane, PoincareMap, periodic_orbit
    >>> maxima = PoincareMap(VanDerPol(mu=1.0), Hyperplane([0.0, 1.0], direction=-1), 20.0)
    >>> cycle = periodic_orbit(maxima, [[2.0]])
    >>> round(float(cycle.states[0, 0]), 9), round(cycle.duration, 9)
    (2.008619861, 6.663286859)
    """

    mu: float = 1.0

    def velocity(self, x: Any, v: Any) -> tuple[Any, ...]:
        return v, self.mu * (1 - x**2) * v - x
