"""Chains with nonlinear springs, whose last mass is free to hit a vibrating table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from dynkit.core.validation import check_fields, finite_scalar
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.structure.chain import extensions

if TYPE_CHECKING:
    import sympy


@final
@dataclass(frozen=True, kw_only=True)
class TodaChain(ImpactChain):
    """An `ImpactChain` with Toda's springs, of energy k (exp(e) - 1 - e) at an extension e.

    A spring gets stiffer as it is stretched. Small oscillations are those of the `ImpactChain`. The
    chain needs heyoka: ``pip install 'dynkit[flows]'``.

    Parameters
    ----------
    masses, springs, damping, frequency and others
        As for `ImpactChain`.

    References
    ----------
    M. Toda, Vibration of a chain with nonlinear interaction, Journal of the Physical Society of
    Japan 22 (1967) 431-436. K. Geist, W. Lauterborn, The nonlinear dynamics of the damped and
    driven Toda chain, Physica D 31 (1988) 103-116.

    Examples
    --------
    >>> chain = TodaChain(masses=3, frequency=0.9)
    >>> chain.engine
    'Taylor'
    >>> print(chain.attractor().label)
    P(1,1)
    """

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        from sympy import Add, Float, exp

        pairs = zip(self._springs, extensions(x), strict=True)
        return Add(*(Float(k) * (exp(e) - 1 - e) for k, e in pairs))


@final
@dataclass(frozen=True, kw_only=True)
class FPUTChain(ImpactChain):
    """An `ImpactChain` with springs of energy k (e^2/2 + quadratic e^3/3 + cubic e^4/4).

    At an extension e the force is k (e + quadratic e^2 + cubic e^3). If both coefficients are zero,
    the chain is the `ImpactChain`; otherwise it needs heyoka: ``pip install 'dynkit[flows]'``.

    Parameters
    ----------
    quadratic, cubic : float
        Coefficients alpha and beta of the forces.
    masses, springs, damping, frequency and others
        As for `ImpactChain`.

    References
    ----------
    E. Fermi, J. Pasta, S. Ulam, M. Tsingou, Studies of nonlinear problems, Los Alamos report
    LA-1940 (1955).

    Examples
    --------
    >>> chain = FPUTChain(masses=3, cubic=0.5, frequency=0.9)
    >>> chain.engine, chain.replace(cubic=0.0).engine
    ('Taylor', 'exponential sums')
    """

    quadratic: float = 0.0
    cubic: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self, quadratic=finite_scalar, cubic=finite_scalar)
        super().__post_init__()

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        from sympy import Add, Float, Rational

        alpha, beta = Float(self.quadratic), Float(self.cubic)
        parts = [(2, Rational(1, 2)), (3, alpha / 3), (4, beta / 4)]
        springs = zip(self._springs, extensions(x), strict=True)
        terms = [(Float(k) * factor, e**power) for k, e in springs for power, factor in parts]
        return Add(*(number * term for number, term in terms if number))
