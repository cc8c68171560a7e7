"""Jenkins elements, springs in series with sliders, and Iwan's models of joints."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, final

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    check_fields,
    finite_scalar,
    non_negative,
    positive,
    positive_integer,
)
from dynkit.systems.impact.elements.element import JUMP, SWITCH, Element, Regime, Watch


@final
@dataclass(frozen=True)
class Jenkins(Element):
    """A spring in series with a slider on a surface with dry friction: a model of hysteresis.

    With y = J x and the slider at s, the force on the structure along J is -stiffness (y - s).
    While its absolute value is less than ``force``, the slider sticks to the surface. Otherwise it
    slides and follows y at the distance force / stiffness, until y' - velocity changes its sign.
    The position s is part of the state: `ImpactState.sliders`. Any number of these elements may act
    along one row, or along one function y of the coordinates, whose gradient is J.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, name
        As for every `Element`: the position and motion of the surface. By default the slider starts
        in the middle of the surface, or as near to the middle as its spring allows.
    stiffness : float
        Stiffness of the spring, positive.
    force : float
        Friction force of the slider, positive.
    velocity : float
        Constant velocity of the surface (a belt), added to its harmonic motion.

    References
    ----------
    G. M. Jenkin, Analysis of the stress-strain relationships in reactor grade graphite, British
    Journal of Applied Physics 13 (1962) 30-32.

    Examples
    --------
    A block on a joint that slips in each period:

    >>> from dynkit.systems import ImpactChain, Jenkins
    >>> block = ImpactChain(masses=1, frequency=0.8, harmonic_forces=[0.5], elements=[
    ...     Jenkins(0, stiffness=2.0, force=0.3, name="joint"),
    ... ])
    >>> block.attractor().label.counts
    {'joint.sticks': 2}
    """

    _: KW_ONLY
    stiffness: float
    force: float
    velocity: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, stiffness=positive, force=positive, velocity=finite_scalar)

    @property
    def drift(self) -> float:
        return self.velocity

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """Sticking, sliding forward, sliding backward."""
        k, force = self.stiffness, self.force
        yields = tuple(
            Watch(to=to, stretch=sign * k, level=force) for to, sign in ((1, -1.0), (2, 1.0))
        )
        forward, backward = (
            tuple(Watch(to=0, rate=sign, event=event) for event in (JUMP, SWITCH))
            for sign in (1.0, -1.0)
        )
        return (
            Regime(yields, stiffness=k, anchored=True),
            Regime(forward, push=-force, stretch=force / k),
            Regime(backward, push=force, stretch=-force / k),
        )


def iwan(
    coordinate: Any,
    *,
    stiffness: float,
    force: float,
    elements: int = 10,
    exponent: float = 0.0,
    macroslip: float = 0.0,
    ratio: float = 1.0,
    name: str = "",
    **motion: Any,
) -> list[Jenkins]:
    """Return Iwan's model of a joint: a list of parallel `Jenkins` elements, for ``elements``.

    Springs that start to slide at the stretch p have the density p^exponent, up to p_max. At the
    stretch p_max the whole joint slips; additional springs slide there. Each element represents the
    springs in an interval of p. Its stiffness and its slip force are the sums over these springs,
    so the stiffness and the slip force of the joint are exact for any number of elements.

    Parameters
    ----------
    coordinate
        As for every element.
    stiffness : float
        K_T, stiffness of the joint without slip: the sum over all elements. Positive.
    force : float
        F_S, force at which the whole joint slips: the sum over all elements. Positive.
    elements : int
        Number of elements in the list.
    exponent : float
        chi, above -1. With chi = 0, a uniform density, this is Iwan's model of 1966. Joints have
        -1 < chi <= 0: in microslip the dissipated energy in a cycle is proportional to the power
        chi + 3 of the amplitude.
    macroslip : float
        beta, not negative: stiffness of the element that slides only at p_max, divided by the total
        stiffness of all others.
    ratio : float
        Ratio of the widths of successive intervals, positive. Values above 1 resolve microslip at
        small amplitudes.
    name : str
        Prefix: the elements are named ``name0``, ``name1`` and so on.
    **motion
        Further arguments of each `Jenkins`, such as ``velocity``.

    Returns
    -------
    list of Jenkins
        In the order of the stretch at which they slide.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    W. D. Iwan, A distributed-element model for hysteresis and its steady-state dynamic response,
    Journal of Applied Mechanics 33 (1966) 893-900; On a class of models for the yielding behavior
    of continuous and composite systems, 34 (1967) 612-617.
    D. J. Segalman, A four-parameter Iwan model for lap-type joints, Journal of Applied Mechanics 72
    (2005) 752-760.

    Examples
    --------
    >>> from dynkit.systems import iwan
    >>> joint = iwan(0, stiffness=3.0, force=1.5, elements=3)
    >>> [round(each.force / each.stiffness, 6) for each in joint]
    [0.166667, 0.5, 0.833333]
    """
    total, slip = positive("stiffness", stiffness), positive("force", force)
    count = positive_integer("elements", elements)
    beta, q = non_negative("macroslip", macroslip), positive("ratio", ratio)
    chi = finite_scalar("exponent", exponent)
    if chi <= -1.0:
        raise ValueError(f"exponent must be above -1; got {chi}")
    if beta and count < 2:
        raise ValueError(f"elements must be 2 at least with macroslip; got {count}")
    spread = count - 1 if beta else count
    widths = q ** np.arange(spread)
    edges = np.append(0.0, np.cumsum(widths) / widths.sum())
    most = slip * (1.0 + beta) / (total * (beta + (chi + 1.0) / (chi + 2.0)))
    springs = total / (1.0 + beta) * np.diff(edges ** (chi + 1.0))
    scale = total / (1.0 + beta) * (chi + 1.0) / (chi + 2.0) * most
    forces = scale * np.diff(edges ** (chi + 2.0))
    if beta:
        springs = np.append(springs, total * beta / (1.0 + beta))
        forces = np.append(forces, springs[-1] * most)
    return [
        Jenkins(coordinate, stiffness=k, force=f, name=f"{name}{i}" if name else "", **motion)
        for i, (k, f) in enumerate(zip(springs.tolist(), forces.tolist(), strict=True))
    ]
