"""The methods that come with dynkit, by name."""

from __future__ import annotations

from collections.abc import Sequence

from dynkit.analysis.work_precision.methods import ImpactMethod
from dynkit.analysis.work_precision.names import NAMES


def impact_methods(names: Sequence[str] | None = None) -> list[ImpactMethod]:
    """Return the methods for `WorkPrecision`: dynkit's own, and its peers.

    ``dynkit`` is closed-form motion with certified roots, ``paper`` the same with Newton's method
    from a sampled bracket, ``RK45``, ``DOP853``, ``Radau`` and ``LSODA`` are SciPy's ``solve_ivp``
    with a terminal event, ``Moreau`` steps through impacts, ``heyoka`` and ``Siconos`` are
    libraries that may be installed or not.

    Parameters
    ----------
    names : sequence of str, optional
        Some of them; by default all.

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
    from dynkit.analysis.work_precision.heyoka import Heyoka
    from dynkit.analysis.work_precision.moreau import MoreauTimeStepping
    from dynkit.analysis.work_precision.paper import PaperAlgorithm
    from dynkit.analysis.work_precision.siconos import Siconos
    from dynkit.analysis.work_precision.solve_ivp import SolveIVP

    known: list[ImpactMethod] = [
        ExactMaps(),
        PaperAlgorithm(),
        SolveIVP("RK45"),
        SolveIVP("DOP853"),
        SolveIVP("Radau"),
        SolveIVP("LSODA"),
        MoreauTimeStepping(),
        Heyoka(),
        Siconos(),
    ]
    by_name = dict(zip(NAMES, known, strict=True))
    for name in names or ():
        if name not in by_name:
            raise ValueError(f"methods must hold names among {', '.join(NAMES)}; got {name!r}")
    return [by_name[name] for name in NAMES if names is None or name in names]
