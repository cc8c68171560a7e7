"""Dry friction: slipping and sticking."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import final

from dynkit.core.validation import finite_scalar, non_negative
from dynkit.systems.impact.elements.element import HALT, JUMP, Element, Regime, Watch

TURNED = (0, 2, 1, 3)
"""Regimes, seen from the other side."""


@final
@dataclass(frozen=True)
class DryFriction(Element):
    """Coulomb friction against a surface, or between two coordinates.

    The slip velocity is w = y' - velocity. While the contact slips, the force is -force sign(w) -
    slope w. It sticks, w = 0, as long as this requires at most the static force. An impact that
    changes w makes it slip, since friction forces are finite and transmit no impulse.

    Parameters
    ----------
    coordinate, amplitude, phase, name
        As for every `Element`: the motion of the surface.
    force : float
        Kinetic friction force, not negative.
    static : float, optional
        Largest force while it sticks, at least `force`. By default it equals `force`, also where
        that is changed.
    velocity : float
        Constant velocity of the surface (a belt), added to its harmonic motion.
    slope : float
        Slope of the force over the slip velocity. It may be negative as long as dashpots of the
        structure keep the damping positive.

    Examples
    --------
    A block on a belt, held by a spring: it sticks and slips.

    >>> from dynkit.systems import DryFriction, ImpactChain
    >>> block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[
    ...     DryFriction(0, force=0.5, static=0.8, velocity=0.2),
    ... ])
    >>> block.simulate(impacts=20).events
    <Events: 0 impacts, 0 contacts, 0 releases, 39 other switches>
    """

    _: KW_ONLY
    force: float
    static: float | None = None
    velocity: float = 0.0
    slope: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("force", non_negative("force", self.force))
        for name in ("velocity", "slope"):
            self._set(name, finite_scalar(name, getattr(self, name)))
        if self.static is not None:
            self._set("static", finite_scalar("static", self.static))
        if self.most < self.force:
            raise ValueError(
                f"static must not be less than the force {self.force}; got {self.static}"
            )

    @property
    def most(self) -> float:
        """The force with which it sticks at most."""
        return self.force if self.static is None else self.static

    @property
    def drift(self) -> float:
        return self.velocity

    @property
    def regimes(self) -> tuple[Regime, ...]:
        """Not known at a start, slipping forward, backward; sticking."""
        order = 2 if self.most == self.force else 1
        forward, backward = (Watch(to=to, rate=r, event=JUMP) for to, r in ((1, -1.0), (2, 1.0)))
        halts = [Watch(to=3, rate=sign, event=HALT) for sign in (1.0, -1.0)]
        yields = Watch(to=2, force=-1.0, level=self.most, order=order)
        return (
            Regime((halts[0], forward, backward)),
            Regime((halts[0], backward), push=-self.force, damping=self.slope),
            Regime((halts[1], forward), push=self.force, damping=self.slope),
            Regime((yields, replace(yields, to=1, force=1.0)), sticks=True),
        )
