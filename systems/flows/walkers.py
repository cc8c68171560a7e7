"""Passive walkers: two legs on a slope, without motors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dynkit.core.validation import positive
from dynkit.systems.symbolic.flows import SymbolicHybridFlow


@dataclass(frozen=True)
class SimplestWalker(SymbolicHybridFlow):
    """A walker on a slope: a mass at the hip and two massless legs with light feet.

    The state is the angle of the stance leg, from the normal of the slope, the angle of the swing
    leg, from the stance leg, and their rates. The unit of length is a leg, the unit of time
    sqrt(length / gravity). When the swing foot strikes the ground, the legs exchange their roles.
    The contact of the foot with the ground when the legs pass each other is ignored.
    ``ResetMap(walker, time_limit=10.0)`` is the map from step to step.

    Parameters
    ----------
    slope : float
        Angle of the slope, in radians.

    Raises
    ------
    ValueError
        When the slope is not finite.

    References
    ----------
    M. Garcia, A. Chatterjee, A. Ruina, M. Coleman, The simplest walking model: stability,
    complexity, and scaling, Journal of Biomechanical Engineering 120 (1998) 281-288, equations 1 to
    4. Gaits of one step are stable for slopes from 0 to 0.0151 there (section 5.1).

    Examples
    --------
    >>> from dynkit import ResetMap, periodic_orbit
    >>> steps = ResetMap(SimplestWalker(slope=0.009), time_limit=10.0)
    >>> gait = periodic_orbit(steps, [0.2, 0.4, -0.2, -0.016])
    >>> gait.states.round(6), gait.stable
    (array([[ 0.200311,  0.400622, -0.199832, -0.015823]]), True)
    """

    slope: float = 0.009

    def velocity(self, stance: Any, swing: Any, u: Any, v: Any) -> tuple[Any, ...]:
        from sympy import cos, sin

        fall = sin(stance - self.slope)
        return u, v, fall, fall + (u**2 - cos(stance - self.slope)) * sin(swing)

    def guard(self, stance: Any, swing: Any, u: Any, v: Any) -> Any:  # noqa: ARG002
        """Return a number that falls to zero where the swing foot strikes the ground."""
        return 2 * stance - swing

    def armed(self, stance: Any, swing: Any, u: Any, v: Any) -> Any:  # noqa: ARG002
        """Return a number that is positive after the legs have passed each other."""
        return -stance

    def reset(self, stance: Any, swing: Any, u: Any, v: Any) -> tuple[Any, ...]:  # noqa: ARG002
        """Return the state after the exchange of the legs."""
        from sympy import cos

        kept = cos(2 * stance)
        return -stance, -2 * stance, kept * u, kept * (1 - kept) * u


@dataclass(frozen=True)
class CompassGait(SymbolicHybridFlow):
    """A walker on a slope: a mass at the hip and two legs with a mass each.

    The state is the angles of the swing leg and of the stance leg, both from the vertical, and
    their rates. When the swing foot strikes the ground, the legs exchange their roles. The contact
    of the foot with the ground when the legs pass each other is ignored. ``ResetMap(walker,
    time_limit=10.0)`` is the map from step to step. Units are SI.

    Parameters
    ----------
    slope : float
        Angle of the slope, in radians.
    hip_mass, leg_mass : float
        Positive.
    foot_to_mass, mass_to_hip : float
        Distances of the mass of a leg from its foot and from the hip, positive.
    gravity : float
        Positive.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    A. Goswami, B. Thuilot, B. Espiau, Compass-like biped robot, part I: stability and bifurcation
    of passive gaits, INRIA report 2996 (1996), equations 2.9, A.8 to A.10, A.18 and A.19. With the
    default masses and lengths, gaits of one step are stable there up to a slope of 4.37 degrees.
    Period doublings then lead to chaos (section 4.2). Here the first doubling is at 4.391 degrees.
    The report does not print the gravity.

    Examples
    --------
    >>> import numpy as np
    >>> from dynkit import ResetMap, periodic_orbit
    >>> steps = ResetMap(CompassGait(slope=np.radians(3.0)), time_limit=10.0)
    >>> gait = periodic_orbit(steps, [-0.323, 0.219, -0.377, -1.092])
    >>> gait.states.round(4), gait.stable
    (array([[-0.3234,  0.2187, -0.3774, -1.0924]]), True)
    """

    slope: float = math.radians(3.0)
    hip_mass: float = 10.0
    leg_mass: float = 5.0
    foot_to_mass: float = 0.5
    mass_to_hip: float = 0.5
    gravity: float = 9.81

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("hip_mass", "leg_mass", "foot_to_mass", "mass_to_hip", "gravity"):
            positive(name, getattr(self, name))

    def velocity(self, swing: Any, stance: Any, u: Any, v: Any) -> tuple[Any, ...]:
        from sympy import cos, sin

        m, a, b, g = self.leg_mass, self.foot_to_mass, self.mass_to_hip, self.gravity
        length, hip = a + b, self.hip_mass
        coupling, own = -m * length * b * cos(stance - swing), m * b**2
        whole = (hip + m) * length**2 + m * a**2
        bend = m * length * b * sin(stance - swing)
        first = -bend * v**2 - m * b * g * sin(swing)
        second = bend * u**2 + (hip * length + m * a + m * length) * g * sin(stance)
        size = own * whole - coupling**2
        return (
            u,
            v,
            (whole * first - coupling * second) / size,
            (own * second - coupling * first) / size,
        )

    def guard(self, swing: Any, stance: Any, u: Any, v: Any) -> Any:  # noqa: ARG002
        """Return a number that falls to zero where the swing foot strikes the ground."""
        return swing + stance + 2 * self.slope

    def armed(self, swing: Any, stance: Any, u: Any, v: Any) -> Any:  # noqa: ARG002
        """Return a number that is positive after the legs have passed each other."""
        return swing - stance

    def reset(self, swing: Any, stance: Any, u: Any, v: Any) -> tuple[Any, ...]:
        """Return the state after the exchange of the legs.

        Two angular momenta are conserved: that of the walker about the foot that strikes, and that
        of the leg that leaves the ground about the hip.
        """
        from sympy import cos

        m, a, b, hip = self.leg_mass, self.foot_to_mass, self.mass_to_hip, self.hip_mass
        length, c = a + b, cos(swing - stance)
        about_foot = -m * a * b * u + (-m * a * b + (hip * length**2 + 2 * m * a * length) * c) * v
        about_hip = -m * a * b * v
        # derivative of the momenta by the rates after the exchange
        p, q = m * b * (b - length * c), m * length * (length - b * c) + m * a**2 + hip * length**2
        r, s = m * b**2, -m * b * length * c
        size = p * s - q * r
        return (
            stance,
            swing,
            (s * about_foot - q * about_hip) / size,
            (p * about_hip - r * about_foot) / size,
        )
