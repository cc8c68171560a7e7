"""The methods of dynkit and SciPy, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final, get_args

import numpy as np

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.analysis.work_precision.methods import FoundImpacts, ImpactMethod, Simulation, Unsuited


@final
class ExactMaps(ImpactMethod):
    """``system.simulate`` of dynkit; it has no tolerance.

    The first run simulates one impact more than there are exact ones. Each further run simulates
    twice as many as the run before, until the end is reached. The measured time includes the
    computation of positions and velocities from modal coordinates.
    """

    name = "dynkit"
    tolerances = (0.0,)

    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        for name in ("state", "simulate"):
            if not hasattr(exact.system, name):
                raise Unsuited(f"not made for it: it has no {name}")
        if tolerance:
            raise ValueError(f"tolerance must be 0, as there is none; got {tolerance}")
        system, count = exact.system, len(exact.times) + 1
        start = system.state(exact.position, exact.velocity, exact.phase)
        system.simulate(impacts=1, start=start)

        def simulate(_: int) -> FoundImpacts:
            asked = count
            records, begins = [system.simulate(impacts=asked, start=start)], [0.0]
            while len(records[-1]) == asked and _end(records[-1], begins[-1]) <= exact.until:
                asked *= 2
                begins.append(_end(records[-1], begins[-1]))
                records.append(system.simulate(impacts=asked, start=records[-1].final))
            parts = list(zip(records, begins, strict=True))
            released = np.concatenate([record.sticking[:, 1] + begin for record, begin in parts])
            return FoundImpacts(
                np.concatenate([record.time + begin for record, begin in parts]),
                np.concatenate([record.position for record in records]),
                np.concatenate([record.velocity for record in records]),
                released[np.isfinite(released)],
                {"cells": sum(record.cost.counts["cells"] for record in records)},
            )

        return simulate


def _end(record: object, begin: float) -> float:
    return begin + float(record.time[-1])  # type: ignore[attr-defined]


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
    from dynkit.analysis.work_precision.solve_ivp import SolveIVP, Solver

    for name in names or ():
        if name not in NAMES:
            raise ValueError(f"methods must hold names among {', '.join(NAMES)}; got {name!r}")
    known = [ExactMaps(), *map(SolveIVP, get_args(Solver))]
    return [each for each in known if names is None or each.name in names]
