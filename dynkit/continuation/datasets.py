"""Branches and curves of bifurcations as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.data.xarrays import dataset

if TYPE_CHECKING:
    import xarray

    from dynkit.continuation.branch import Branch
    from dynkit.continuation.curves import BifurcationCurve
    from dynkit.data.xarrays import Variables

_ERROR = (
    "to first order a bound on the distance from the exact curve, "
    "in ranges of parameters and typical sizes of unknowns"
)


def branch_dataset(branch: Branch) -> xarray.Dataset:
    """Return a branch as `Branch.to_xarray` says."""
    each, found = "point", branch.bifurcations
    drawn: Variables = {}
    if branch._problem is not None:
        name = branch.system.observables[0]
        drawn = {name: ((each, "state"), branch.observable(name))}
    return dataset(
        f"Branch of {branch.label}",
        {branch.name: (each, branch.parameter)},
        {
            **drawn,
            "multiplier": ((each, "multiplier"), branch.multipliers),
            "unknowns": ((each, "unknown"), branch.unknowns),
            "stable": (each, branch.stable),
            "admissible": (each, branch.admissible),
            "residual": (each, branch.residuals),
            **_errors(branch),
            "bifurcation_kind": ("bifurcation", np.array([b.kind for b in found], dtype="U2")),
            "bifurcation_value": ("bifurcation", np.array([b.value for b in found])),
            "bifurcation_admissible": (
                "bifurcation",
                np.array([b.admissible for b in found], dtype=bool),
            ),
            "bifurcation_error": ("bifurcation", np.array([b.error for b in found])),
            "bifurcation_place": ("bifurcation", np.array([b.place for b in found])),
        },
        cost=branch.cost,
        error=_ERROR,
        system=branch._system,
        facts=_ends(branch),
    )


def curve_dataset(curve: BifurcationCurve) -> xarray.Dataset:
    """Return a curve as `BifurcationCurve.to_xarray` says."""
    each, problem = "point", curve._problem
    columns = zip(curve.names, curve.parameters.T, strict=True)
    return dataset(
        f"Curve of {curve.kind} of {curve.label}",
        {name: (each, column) for name, column in columns},
        {
            "unknowns": ((each, "unknown"), curve.unknowns),
            "own": ((each, "condition"), curve.own),
            "admissible": (each, curve.admissible),
            "residual": (each, curve.residuals),
            **_errors(curve),
        },
        cost=curve.cost,
        error=_ERROR,
        system=None if problem is None else curve.orbit(0).system,
        facts=_ends(curve),
    )


def _errors(found: Branch | BifurcationCurve) -> Variables:
    if found._problem is None and found._error is None:
        return {}
    return {"error": ("point", found.error)}


def _ends(found: Branch | BifurcationCurve) -> dict[str, str | float]:
    return {"begins_where": str(found.endings[0]), "ends_where": str(found.endings[1])}
