"""One mass on a spring that a harmonic force drives against a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

from dynkit.core.validation import check_fields, finite_scalar, non_negative
from dynkit.systems.impact.oscillators.one_mass import OneMass
from dynkit.systems.impact.simulation.state import ImpactState

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class SingleImpactOscillator(OneMass):
    """x'' + 2 damping_ratio x' + x = force cos(phase) for x < stop; x' becomes -r x' at the stop.

    All quantities are dimensionless: the mass is the unit of mass, and the natural frequency is
    one. With mass m, spring k, dashpot c, force P cos(Omega t) and a unit of length L:

        frequency = Omega sqrt(m / k),   damping_ratio = c / (2 sqrt(k m)),   force = P / (k L).

    The section coordinates are (u, phase): the velocity away from the stop just after an impact,
    and the phase of the force.

    Parameters
    ----------
    damping_ratio : float
        Ratio to critical damping; not negative.
    force : float
        Amplitude of the force; not negative.
    stop : float
        Position of the stop. At 0 the spring is slack; for negative positions it is always loaded.
    frequency, restitution, chatter_tolerance : float
        As for `ImpactOscillator`.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    S. W. Shaw, P. J. Holmes, A periodically forced piecewise linear oscillator, Journal of Sound
    and Vibration 90 (1983) 129-155 (the limit of hard impacts). A. B. Nordmark, Non-periodic motion
    caused by grazing incidence in an impact oscillator, Journal of Sound and Vibration 145 (1991)
    279-297.

    Examples
    --------
    >>> oscillator = SingleImpactOscillator(frequency=4.0, restitution=0.8)
    >>> print(oscillator.attractor().label)
    P(1,2)
    >>> distant = oscillator.replace(stop=0.1)
    >>> round(distant.grazing_force, 6)
    1.500533
    >>> distant.attractor().ending.value
    'no mass can reach a stop any more'
    """

    damping_ratio: float = 0.05
    force: float = 1.0
    stop: float = 0.0
    amplitude: float = field(init=False, repr=False, default=0.0)
    side: str = field(init=False, repr=False, default="below")
    play: float = field(init=False, repr=False, default=math.inf)

    structure_independent: ClassVar[frozenset[str]] = OneMass.structure_independent | {
        "force",
        "stop",
    }

    def __post_init__(self) -> None:
        check_fields(self, damping_ratio=non_negative, force=non_negative, stop=finite_scalar)
        self._set("offset", self.stop)
        self._set("harmonic_forces", (1j * self.force,))
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return x[0] ** 2 / 2

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self.damping_ratio * v[0] ** 2

    def state(
        self,
        position: object = None,
        velocity: object = None,
        phase: float = 0.0,
        sliders: object = None,
    ) -> ImpactState:
        """Return a state to start from, as `ImpactOscillator.state`, with another default.

        Parameters
        ----------
        position, velocity : (1,) array_like
            By default the mass is at rest, at a distance of one from the stop.
        phase : float
            Phase of the force, taken modulo 2 pi.
        sliders : (0,) array_like
            Empty: there are no sliders.
        """
        place = [self.stop - 1.0] if position is None else position
        return super().state(place, velocity, phase, sliders)

    @property
    @final
    def grazing_force(self) -> float:
        """Force amplitude at which the steady response without stop just reaches the stop.

        For smaller amplitudes this response has no impacts. The result is zero for stops at or
        below zero.
        """
        w = self.frequency
        return max(self.stop, 0.0) * math.hypot((1.0 - w) * (1.0 + w), 2.0 * self.damping_ratio * w)
