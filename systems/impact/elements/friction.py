"""Dry friction with a given friction force, or with the contact force of a hard stop."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, final

from dynkit.core.kept import cached_property
from dynkit.core.validation import check_fields, finite_scalar, non_negative
from dynkit.systems.impact.elements.element import HALT, JUMP, Element, Regime, Watch

TURNED = (0, 2, 1, 3)
"""Regimes of friction when the sign of its row is reversed: forward and backward swap."""

OFF, FORWARD, BACKWARD, STICKS, LANDED = range(5)
"""Regimes of friction at a contact: stop open, slipping forward, slipping backward, sticking, and
undecided as the contact begins."""


@final
@dataclass(frozen=True)
class DryFriction(Element):
    """Coulomb friction against a surface, or between two coordinates.

    The slip velocity is w = y' - velocity. While the contact slips, the force is -force sign(w) -
    slope w. It sticks, w = 0, as long as this requires at most the static force. An impact that
    changes w makes it slip, since friction forces are finite and transmit no impulse.

    With a coefficient in place of a force, friction acts at the contact with a hard stop. The force
    is the coefficient times the contact force, and zero while the stop is open. Friction and stop
    may act along functions of the coordinates. Their forces then act along the gradients of these
    functions; if the functions are lengths, the coefficient is Coulomb's. At an impact on the stop,
    friction has an impulse: the coefficient times the impulse of the impact, or as much as makes w
    zero if that is less (Coulomb's law for impulses).

    Parameters
    ----------
    coordinate, amplitude, phase, name
        As for every `Element`; they define the motion of the surface. Along a function of the
        coordinates, the force on these is the friction force times the function's gradient.
    force : float
        Kinetic friction force, not negative. Either this or `coefficient` is given.
    static : float, optional
        Largest force while it sticks, at least `force`; with a coefficient, the static coefficient.
        The default is `force` or `coefficient`, also after a change of these.
    velocity : float
        Constant velocity of the surface (a belt), added to its harmonic motion.
    slope : float
        Derivative of the force with respect to the slip velocity. It may be negative as long as
        dashpots of the structure keep the damping positive.
    coefficient : float
        Kinetic coefficient of friction, not negative.
    normal : str
        Name of the hard stop whose contact force is the normal force: the stop's `name`, or
        ``elements[k]`` by its number. The stop's restitution must be a number.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    Examples
    --------
    A block on a belt, held by a spring, sticks and slips:

    >>> from dynkit.systems import DryFriction, ImpactChain
    >>> block = ImpactChain(masses=1, damping=0.0, frequency=1.0, elements=[
    ...     DryFriction(0, force=0.5, static=0.8, velocity=0.2),
    ... ])
    >>> block.simulate(impacts=20).events
    <Events: 0 impacts, 0 contacts, 0 releases, 39 other switches>

    A block that bounces on a table, y >= 0, as it slides along x: each impact slows it down.

    >>> import numpy as np
    >>> from dynkit.systems import HardStop, MatrixOscillator
    >>> sliding = MatrixOscillator(
    ...     M=np.eye(2), C=np.zeros((2, 2)), K=np.zeros((2, 2)), frequency=1.0,
    ...     constant_forces=[0.0, -1.0], elements=[
    ...         HardStop(1, restitution=0.5, name="table"),
    ...         DryFriction(0, coefficient=0.25, normal="table"),
    ... ])
    >>> start = sliding.state(position=[0.0, 0.5], velocity=[2.0, 0.0])
    >>> sliding.simulate(impacts=3, start=start).velocity[:, 0]
    array([1.625  , 1.4375 , 1.34375])
    """

    _: KW_ONLY
    force: float | None = None
    static: float | None = None
    velocity: float = 0.0
    slope: float = 0.0
    coefficient: float | None = None
    normal: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.force is None) is (self.coefficient is None):
            found = "neither" if self.force is None else "both"
            raise ValueError(f"either force or coefficient must be given; got {found}")
        kinetic = "force" if self.coefficient is None else "coefficient"
        check_fields(self, **{kinetic: non_negative})
        given: Any = self.normal
        if not isinstance(given, str) or bool(given) is (self.coefficient is None):
            need = "be given with a coefficient only"
            if self.coefficient is not None:
                need = "be the name of the hard stop that the coefficient belongs to"
            raise ValueError(f"normal must {need}; got {given!r}")
        self._set("normal", str(given))
        check_fields(self, velocity=finite_scalar, slope=finite_scalar)
        if self.static is not None:
            check_fields(self, static=finite_scalar)
        if self.most < self.kinetic:
            raise ValueError(
                f"static must not be less than the {kinetic} {self.kinetic}; got {self.static}"
            )

    @property
    def kinetic(self) -> float:
        """Kinetic friction force, or kinetic coefficient."""
        return (self.force if self.coefficient is None else self.coefficient) or 0.0

    @property
    def most(self) -> float:
        """Largest force while friction sticks, or static coefficient."""
        return self.kinetic if self.static is None else self.static

    @property
    def leans_on(self) -> str:
        return self.normal

    @property
    def drift(self) -> float:
        return self.velocity

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """Undecided at a start, or off; slipping forward, backward; sticking; contact begun."""
        order = 2 if self.most == self.kinetic else 1
        forward, backward = (Watch(to=to, rate=r, event=JUMP) for to, r in ((1, -1.0), (2, 1.0)))
        halts = [Watch(to=3, rate=sign, event=HALT) for sign in (1.0, -1.0)]
        yields = Watch(to=2, force=-1.0, order=order)
        slips = (halts[0], backward), (halts[1], forward)
        leans = self.coefficient is not None
        push, traction = (0.0, self.kinetic) if leans else (self.kinetic, 0.0)
        yields = replace(yields, normal=self.most) if leans else replace(yields, level=self.most)
        still = Watch(to=STICKS, level=-1.0, order=1, event=JUMP)  # if it does not slip
        landed = Regime((forward, backward, still))
        return (
            Regime(() if leans else (halts[0], forward, backward)),
            Regime(slips[0], push=-push, damping=self.slope, traction=-traction),
            Regime(slips[1], push=push, damping=self.slope, traction=traction),
            Regime((yields, replace(yields, to=1, force=1.0)), sticks=True),
            *((landed,) if leans else ()),
        )
