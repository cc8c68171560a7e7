"""A ball on a vibrating table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from dynkit.core.validation import check_fields, positive
from dynkit.systems.impact.oscillators.one_mass import OneMass

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class BouncingBall(OneMass):
    """A ball that falls onto a table at amplitude sin(phase): x'' = -gravity in flight.

    The motion is exact; `HighBounce` is its limit for high bounces. The section coordinates are
    (u, phase): the velocity relative to the table just after an impact, and the phase of the table.
    The default start is at rest, at height one.

    The motion depends on two numbers: the restitution r, and the ratio Gamma = amplitude
    frequency^2 / gravity of the table's largest acceleration to gravity. A ball that rests on the
    table leaves it where sin(phase) = 1 / Gamma. Bounces that last n table periods each have

        cos(phase) = b / Gamma,   u = 2 pi n gravity r / ((1 + r) frequency),
        b = pi n (1 - r) / (1 + r).

    They appear at Gamma = b. Those with sin(phase) > 0 are stable up to Gamma =
    sqrt(b^2 + (2 (1 + r^2) / (1 + r)^2)^2), where their period doubles. A periodic orbit P(n,m)
    from `periodic_orbit` has n bounces in m table periods. Branches of such orbits continue beyond
    grazing, where they are marked as inadmissible.

    Parameters
    ----------
    gravity : float
        Acceleration of the fall, positive; one if times are in units of sqrt(length / gravity).
    amplitude : float
        Amplitude of the table; not negative.
    frequency, restitution, chatter_tolerance : float
        As for `ImpactOscillator`.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    P. J. Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table, Journal of
    Sound and Vibration 84 (1982) 173-189. J. M. Luck, A. Mehta, Bouncing ball with a finite
    restitution: chattering, locking, and chaos, Physical Review E 48 (1993) 3988-3997.

    Examples
    --------
    >>> ball = BouncingBall(amplitude=0.1, frequency=3.0, restitution=0.5)
    >>> ball.attractor().ending.value
    'the mass stays on the stop for ever'
    >>> print(ball.replace(amplitude=0.16).attractor().label)
    P(inf,1)
    """

    gravity: float = 1.0
    play: float = field(init=False, repr=False, default=math.inf)

    structure_independent: ClassVar[frozenset[str]] = OneMass.structure_independent | {"gravity"}

    def __post_init__(self) -> None:
        check_fields(self, gravity=positive)
        self._set("constant_forces", (-self.gravity,))
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return 0 * x[0]
