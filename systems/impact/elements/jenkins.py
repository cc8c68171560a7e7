"""Springs in series with sliders: elements of Jenkin, and Iwan's models made of them."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, final

import numpy as np

from dynkit.core.validation import finite_scalar, non_negative, positive, positive_integer
from dynkit.systems.impact.elements.element import JUMP, SWITCH, Element, Regime, Watch


@final
@dataclass(frozen=True)
class Jenkins(Element):
    """A spring in series with a slider, which dry friction holds on a surface: hysteresis.

    With y = J x and the place s of the slider the force is -stiffness (y - s). The slider sticks to
    the surface while that is less than ``force`` in absolute value; else it slides, and follows y
    at the distance force / stiffness, until y' - velocity changes its sign. The place s is a number
    of the state: `ImpactState.sliders`. Any number of them may act along one row.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, name
        As for every `Element`; where the surface is, and moves. Where nothing else is said the
        slider starts in the middle of the surface, as far as its spring lets it.
    stiffness : float
        Of the spring, positive.
    force : float
        With which it slides; positive.
    velocity : float
        Of the surface, a belt, besides its motion.

    References
    ----------
    G. M. Jenkin, Analysis of the stress-strain relationships in reactor grade graphite, British
    Journal of Applied Physics 13 (1962) 30-32.

    Examples
    --------
    A block on a joint that slips a little in each period:

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
        for name, check in (
            ("stiffness", positive),
            ("force", positive),
            ("velocity", finite_scalar),
        ):
            self._set(name, check(name, getattr(self, name)))

    @property
    def drift(self) -> float:
        return self.velocity

    @property
    def regimes(self) -> tuple[Regime, ...]:
        """It sticks; it slides forward, backward."""
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
    """Return Iwan's model of a joint: `Jenkins` elements in parallel, to be put among ``elements``.

    Springs whose sliders slide at the stretch p have the density p^exponent for p up to the stretch
    p_max at which the joint slips as a whole, and there some more that slide at once. Each element
    stands for the springs of an interval of p: it has the sum of their stiffnesses and of their
    slip forces, so that those of the joint are exact for any number of elements.

    Parameters
    ----------
    coordinate
        As for every element.
    stiffness : float
        K_T of the joint where nothing slips, positive: the sum of all.
    force : float
        F_S with which it slips as a whole, positive: the sum of all.
    elements : int
        How many.
    exponent : float
        chi, above -1. With 0, a uniform density, Iwan's model of 1966; joints have -1 < chi <= 0:
        in microslip the energy dissipated in a cycle goes with the power chi + 3 of the amplitude.
    macroslip : float
        beta, not negative: the stiffness of what slides at p_max only, one of the elements, over
        that of all others.
    ratio : float
        Positive: each interval is so many times as wide as the one before. Above 1 it resolves
        microslip of small amplitudes.
    name : str
        Its elements are ``name0``, ``name1`` and so on.
    **motion
        Further arguments of each `Jenkins`, such as ``velocity``.

    Returns
    -------
    list of Jenkins
        By rising stretch at which they slide.

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
