"""The logistic map, and the logistic map with a delay."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.maps import SymbolicMap


@dataclass(frozen=True)
class Logistic(SymbolicMap):
    """The logistic map: x' = rate x (1 - x).

    For rates in [0, 4] it maps [0, 1] into itself. Its fixed point 1 - 1/rate doubles its period at
    rate 3, and the cycle of period 2 at 1 + sqrt 6. A cycle of period 3 is born at 1 + sqrt 8.

    Parameters
    ----------
    rate : float

    Raises
    ------
    ValueError
        When the rate is not finite.

    References
    ----------
    R. M. May, Simple mathematical models with very complicated dynamics, Nature 261 (1976) 459-467.

    Examples
    --------
    >>> Logistic(rate=2.0)([0.25])
    array([0.375])
    >>> from dynkit import MapAttractor
    >>> print(MapAttractor(Logistic(rate=3.5), [0.4], transient=500, iterations=100).label)
    P(4)
    """

    rate: float = 4.0

    def next_state(self, x: Any) -> tuple[Any, ...]:
        return (self.rate * x * (1 - x),)


@dataclass(frozen=True)
class DelayedLogistic(SymbolicMap):
    """The logistic map with a delay: x' = rate x (s - y), y' = x.

    The multipliers of its fixed point s - 1/rate are the roots of mu^2 - mu + rate s - 1. At rate s
    = 2 an invariant circle is born (NS); there the rotation is by pi/3 in each iterate.

    Parameters
    ----------
    rate, s : float

    Raises
    ------
    ValueError
        When a parameter is not finite.

    References
    ----------
    D. G. Aronson, M. A. Chory, G. R. Hall, R. P. McGehee, Bifurcations from an invariant circle for
    two-parameter families of maps of the plane: a computer-assisted study, Commun. Math. Phys. 83
    (1982) 303-354.

    Examples
    --------
    >>> from dynkit import MapAttractor
    >>> print(MapAttractor(DelayedLogistic(2.05), [0.5, 0.5], 1000, 1000).label)
    quasi-periodic, rotation number 0.161772
    """

    rate: float
    s: float = 1.0

    def next_state(self, x: Any, y: Any) -> tuple[Any, ...]:
        return self.rate * x * (self.s - y), x
