"""One mass with play between two stops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from dynkit.core.validation import check_fields, finite_scalar, non_negative, positive
from dynkit.systems.impact.oscillators.one_mass import OneMass
from dynkit.systems.impact.simulation.state import ImpactState

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class PlayOscillator(OneMass):
    """x'' + damping x' + spring x = force sin(phase), between stops at amplitude sin(phase) +- s/2.

    Here s is the play, and the mass is the unit of mass. Both stops belong to one housing, which
    may move. Without spring, dashpot and force it is a free mass in a vibrating housing: an impact
    damper, or a rattling gear. Spring and dashpot are tied to the ground. If they are tied to the
    housing, use amplitude 0 and the force amplitude frequency^2: the positions are then relative
    to the housing.

    The section coordinates are (u, phase): the velocity relative to the stop just after an impact,
    positive at the lower stop and negative at the upper one, and the phase. An orbit P(n,m) has n
    impacts in m periods, counted at both stops. The system is symmetric: if x(t) is a motion, then
    -x(t - pi / frequency), half a period later, is a motion as well; (u, phase) becomes (-u, phase
    + pi).

    Parameters
    ----------
    play : float
        Distance that the mass can move between the stops, positive.
    spring, damping : float
        Spring and dashpot constant, not negative.
    force : float
        Amplitude of the force on the mass; negative when it opposes the motion of the housing.
    amplitude : float
        Amplitude of the housing; not negative.
    frequency, restitution, chatter_tolerance : float
        As for `ImpactOscillator`.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    S. W. Shaw, The dynamics of a harmonically excited system having rigid amplitude constraints,
    Journal of Applied Mechanics 52 (1985) 453-464. M. S. Heiman, P. J. Sherman, A. K. Bajaj, On the
    dynamics and bifurcations of an inclined impact pair, Journal of Sound and Vibration 114 (1987)
    535-547 (the free mass).

    Examples
    --------
    >>> pair = PlayOscillator(play=1.0, amplitude=0.2, frequency=1.0, restitution=0.5)
    >>> attractor = pair.attractor()
    >>> print(attractor.label)
    P(2,1)
    >>> attractor.states[:2, 0].round(6)
    array([-0.274039,  0.274039])
    """

    play: float = 1.0
    spring: float = 0.0
    damping: float = 0.0
    force: float = 0.0

    structure_independent: ClassVar[frozenset[str]] = OneMass.structure_independent | {"force"}

    def __post_init__(self) -> None:
        check_fields(self, play=positive, spring=non_negative, damping=non_negative)
        check_fields(self, force=finite_scalar)
        self._set("offset", -0.5 * self.play)
        self._set("harmonic_forces", (complex(self.force),))
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self.spring * x[0] ** 2 / 2

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self.damping * v[0] ** 2 / 2

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
            By default the mass rests on the lower stop and moves with it.
        phase : float
            Phase of the housing, taken modulo 2 pi.
        sliders : (0,) array_like
            Empty: there are no sliders.
        """
        if position is None:
            angle = finite_scalar("phase", phase)
            position = [self.amplitude * math.sin(angle) + self.offset]
            if velocity is None:
                velocity = [self.amplitude * self.frequency * math.cos(angle)]
        return super().state(position, velocity, phase, sliders)
