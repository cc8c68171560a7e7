"""The methods of dynkit and SciPy, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from dynkit.analysis.work_precision.methods import ImpactMethod

NAMES = ("dynkit", "RK45", "DOP853", "Radau", "LSODA")
"""The method of dynkit, then SciPy's integrators."""


def impact_methods(names: Sequence[str] | None = None) -> list[ImpactMethod]:
    """Return the methods for `WorkPrecision` that require only dynkit and SciPy.

    ``dynkit`` is closed-form motion with certified roots; ``RK45``, ``DOP853``, ``Radau`` and
    ``LSODA`` are SciPy's ``solve_ivp`` with a terminal event.

    Parameters
    ----------
    names : sequence of str, optional
        Names of methods; by default all.

    Raises
    ------
    ValueError
        When a name is unknown.

    Examples
    --------
    >>> [method.name for method in impact_methods(["dynkit", "RK45"])]
    ['dynkit', 'RK45']
    """
    from dynkit.analysis.work_precision.exact_maps import ExactMaps
    from dynkit.analysis.work_precision.solve_ivp import SolveIVP, Solver

    for name in names or ():
        if name not in NAMES:
            raise ValueError(f"methods must hold names among {', '.join(NAMES)}; got {name!r}")
    known = [ExactMaps(), *map(SolveIVP, get_args(Solver))]
    return [each for each in known if names is None or each.name in names]
