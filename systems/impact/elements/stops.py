"""Hard stops with impacts, and soft stops with a spring and a dashpot."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import final

from dynkit.core.kept import cached_property
from dynkit.core.validation import check_fields, non_negative
from dynkit.systems.impact.elements.element import IMPACT, RELEASED, REST, Element, Regime, Watch
from dynkit.systems.impact.elements.laws import Restitution, checked_restitution


@final
@dataclass(frozen=True)
class HardStop(Element):
    """A rigid stop: an impact changes the rate g' of its gap from -u to restitution * u.

    For a pair (i, j) of coordinates, two masses hit each other where x_j - x_i reaches the offset.
    For the name of a method, ``HardStop("height")``, y is the smooth function of the coordinates
    that the method returns.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, side, name
        As for every `Element`; its gap is never negative.
    restitution : float or ImpactLaw
        Coefficient of restitution in [0, 1], or a law by which it depends on u, such as
        `ViscoelasticSpheres`, `PlasticBelow`, or one's own.

    Examples
    --------
    The distance of two masses is at most 0.2 less than their distance at rest:

    >>> from dynkit.systems import HardStop, ImpactChain
    >>> pair = ImpactChain(masses=2, frequency=1.5, harmonic_forces=[0.0, 0.8], elements=[
    ...     HardStop((0, 1), offset=-0.2, restitution=0.5),
    ... ])
    >>> print(pair.attractor().label)
    P(1,1)
    """

    _: KW_ONLY
    restitution: Restitution = 0.85

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, restitution=checked_restitution)

    @property
    def regimes(self) -> tuple[Regime, ...]:
        return _OPEN, _CLOSED, _OPEN


_OPEN = Regime((Watch(to=1, gap=1.0, event=IMPACT),))
_CLOSED = Regime((Watch(to=0, force=1.0, order=RELEASED),), holds=True)


@final
@dataclass(frozen=True)
class SoftStop(Element):
    """A stop with a spring and a dashpot: its force is max(0, p - k g - c g') for a gap g < 0.

    It never pulls: the mass lifts off when the force becomes zero, even if g < 0.

    Parameters
    ----------
    coordinate, offset, amplitude, phase, side, name
        As for every `Element`. Along a function of the coordinates, the force on these is the force
        of the stop times the function's gradient.
    stiffness, damping : float
        k and c, not negative.
    preload : float
        p, not negative: the spring is already compressed when a mass meets it, so the force jumps
        to p. A mass that begins at rest at g = 0 stays there as long as this needs a force between
        0 and p. A mass that arrives with a velocity may cross g = 0 more and more often, without
        end; the simulation then stops, and `record.ending` names this reason. At least one of k, c
        and p must be positive. With p alone the force is constant.

    Examples
    --------
    The first of two masses hits a cushion, the second one a vibrating table:

    >>> from dynkit.systems import HardStop, ImpactChain, SoftStop
    >>> machine = ImpactChain(masses=2, frequency=0.9, elements=[
    ...     HardStop(1, amplitude=0.1, restitution=0.85),
    ...     SoftStop(0, offset=0.02, stiffness=50.0, damping=0.2),
    ... ])
    >>> machine.simulate(impacts=50).events
    <Events: 50 impacts, 0 contacts, 0 releases, 283 other switches>
    """

    _: KW_ONLY
    stiffness: float
    damping: float = 0.0
    preload: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, stiffness=non_negative, damping=non_negative, preload=non_negative)
        if self.stiffness == self.damping == self.preload == 0.0:
            raise ValueError("stiffness must be positive where damping and preload are 0; got 0.0")

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """Outside, pressing, lifted; with a preload: pressing after a lift, and at rest."""
        k, c, p = self.stiffness, self.damping, self.preload
        # When pressing begins, the next guard is the gap, which is zero; with a dashpot and without
        # a preload it is the force, which is not zero.
        touched = Watch(to=1, gap=1.0, order=0 if c and not p else 1)
        left = Watch(to=0, gap=-1.0 if c else -(k or 1.0), order=1)
        rests = Watch(to=4 if c else 2, gap=1.0, event=REST)
        # Where the force is 0 or p, the gap, its rate and its acceleration are zero.
        bounds = Watch(to=0, force=1.0, order=RELEASED), Watch(to=1, force=-1.0, level=p, order=3)
        first, last = Regime((touched, rests) if p else (touched,)), Regime(bounds, holds=True)
        resting = (last,) if p else ()
        if c == 0.0:
            return first, Regime((left,), push=p, stiffness=k), *resting
        lifted = Watch(to=2, gap=-k, rate=-c, level=p, order=1)
        pressed = Watch(to=3 if p else 1, gap=k, rate=c, level=-p, order=1)
        guards = [(left, lifted), (lifted, left)] if p else [(lifted,)]
        pressing = [Regime(own, push=p, stiffness=k, damping=c) for own in guards]
        return first, pressing[0], Regime((pressed, left)), *pressing[1:], *resting
