"""The planar circular restricted three-body problem."""

from dataclasses import dataclass
from typing import Any

from dynkit.systems.symbolic.flows import SymbolicFlow


@dataclass(frozen=True)
class RestrictedThreeBody(SymbolicFlow):
    """A massless body in the plane of two bodies on circular orbits, in their rotating frame.

    The bodies of masses 1 - mu and mu rest at x = -mu and x = 1 - mu. Units are their distance,
    their total mass, and their angular velocity. The state is x, y and their rates u, v:
    x'' - 2 y' = dW/dx, y'' + 2 x' = dW/dy, W = (x^2 + y^2)/2 + (1 - mu)/r1 + mu/r2. Jacobi's
    integral 2 W - u^2 - v^2 is conserved. There are three equilibria on the axis y = 0, the
    collinear points L1 to L3, and two that form equilateral triangles with the bodies.

    Parameters
    ----------
    mu : float
        Share of the second body in the total mass; by default that of the Moon.

    Raises
    ------
    ValueError
        When mu is not finite.

    References
    ----------
    V. Szebehely, Theory of Orbits: The Restricted Problem of Three Bodies, Academic Press 1967. His
    integral is larger by the constant mu (1 - mu).

    Examples
    --------
    >>> from dynkit import equilibrium
    >>> first = equilibrium(RestrictedThreeBody(), [0.8, 0.0, 0.0, 0.0])
    >>> first.state.round(9)[:1], round(first.system.jacobi(first.state), 9)
    (array([0.83691513]), 3.188341118)
    >>> (orbit,) = first.lyapunov_orbits("jacobi")
    >>> orbit.stable
    False
    """

    integrals = ("jacobi",)
    mu: float = 0.01215058560962404

    def velocity(self, x: Any, y: Any, u: Any, v: Any) -> tuple[Any, ...]:
        first, second = self._distances(x, y)
        pulls = (1 - self.mu) / first**3, self.mu / second**3
        along = x - pulls[0] * (x + self.mu) - pulls[1] * (x - 1 + self.mu)
        return u, v, along + 2 * v, y - (pulls[0] + pulls[1]) * y - 2 * u

    def jacobi(self, x: Any, y: Any, u: Any, v: Any) -> Any:
        """Return Jacobi's integral."""
        first, second = self._distances(x, y)
        potential = 2 * (1 - self.mu) / first + 2 * self.mu / second
        return x**2 + y**2 + potential - u**2 - v**2

    def _distances(self, x: Any, y: Any) -> tuple[Any, Any]:
        from sympy import sqrt

        return sqrt((x + self.mu) ** 2 + y**2), sqrt((x - 1 + self.mu) ** 2 + y**2)
