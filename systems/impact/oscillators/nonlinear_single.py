"""One coordinate with a nonlinear restoring force, driven against stops."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

from dynkit.core.validation import check_fields, finite_scalar, non_negative, positive
from dynkit.systems.impact.elements.element import Element
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class _Driven(ImpactOscillator):
    """One coordinate of mass one, with a dashpot and the force ``force sin(phase)``."""

    damping: float = 0.1
    force: float = 0.0
    harmonic_forces: tuple[complex, ...] = field(init=False, repr=False, default=())

    degrees_of_freedom = 1

    structure_independent: ClassVar[frozenset[str]] = ImpactOscillator.structure_independent | {
        "force"
    }

    def __post_init__(self) -> None:
        check_fields(self, damping=non_negative, force=finite_scalar)
        self._set("harmonic_forces", (complex(self.force),) if self.force else ())
        super().__post_init__()

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return v[0] ** 2 / 2

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self.damping * v[0] ** 2 / 2


@final
@dataclass(frozen=True, kw_only=True)
class ImpactDuffing(_Driven):
    """x'' + damping x' + linear x + cubic x^3 = force sin(phase), above a table or a stop.

    A negative linear coefficient gives two wells. If cubic is zero, the motion is exact; otherwise
    the oscillator needs heyoka: ``pip install 'dynkit[flows]'``.

    Parameters
    ----------
    linear, cubic, damping, force : float
        The damping is not negative.
    frequency, amplitude, offset, restitution, play, elements and others
        As for `ImpactOscillator`. By default a table of amplitude 0.1 is at 0. A stop at rest has
        amplitude 0, and its position as offset.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    J. Guckenheimer, P. Holmes, Nonlinear Oscillations, Dynamical Systems, and Bifurcations of
    Vector Fields, Springer 1983, section 2.2 (the equation of Duffing, without a stop).

    Examples
    --------
    >>> oscillator = ImpactDuffing(frequency=1.2, force=0.4, amplitude=0.0, offset=-0.5)
    >>> print(oscillator.attractor().label)
    P(1,1)
    """

    linear: float = 1.0
    cubic: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self, linear=finite_scalar, cubic=finite_scalar)
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        parts = ((self.linear / 2, 2), (self.cubic / 4, 4))
        return sum(number * x[0] ** power for number, power in parts if number)


@final
@dataclass(frozen=True, kw_only=True)
class ImpactPendulum(_Driven):
    """x'' + damping x' + sin x = force sin(phase), between stops at the angles -stop and stop.

    The energy is x'^2 / 2 + 1 - cos x. The pendulum needs heyoka: ``pip install 'dynkit[flows]'``.

    Parameters
    ----------
    stop : float
        Angle of both stops, positive.
    damping, force : float
        The damping is not negative.
    frequency, restitution, chatter_tolerance
        As for `ImpactOscillator`.

    Raises
    ------
    ValueError
        Naming the argument, the limit and the value.

    References
    ----------
    S. W. Shaw, R. H. Rand, The transition to chaos in a simple mechanical system, International
    Journal of Non-Linear Mechanics 24 (1989) 41-56 (an inverted pendulum between stops).

    Examples
    --------
    >>> pendulum = ImpactPendulum(frequency=0.8, force=0.5, stop=1.0)
    >>> pendulum.simulate(impacts=100)
    <ImpactRecord: 100 impacts, 0 contacts; the number of impacts was reached>
    """

    stop: float = 1.0
    amplitude: float = field(init=False, repr=False, default=0.0)
    offset: float = field(init=False, repr=False, default=0.0)
    contact: int = field(init=False, repr=False, default=0)
    side: str = field(init=False, repr=False, default="above")
    play: float = field(init=False, repr=False, default=math.inf)
    constant_forces: tuple[float, ...] = field(init=False, repr=False, default=())
    elements: tuple[Element, ...] = field(init=False, repr=False, default=())

    structure_independent: ClassVar[frozenset[str]] = _Driven.structure_independent | {"stop"}

    def __post_init__(self) -> None:
        check_fields(self, stop=positive)
        self._set("offset", -self.stop)
        self._set("play", 2.0 * self.stop)
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        from sympy import cos

        return 1 - cos(x[0])
