"""Results as xarray datasets, which netCDF files can hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit._version import __version__
from dynkit.core.reprs import told

if TYPE_CHECKING:
    import xarray

    from dynkit.core.cost import Cost

Variables = Mapping[str, tuple[str | tuple[str, ...], Any]]
"""Arrays by name, each with the names of its dimensions."""


def dataset(
    title: str,
    coordinates: Variables,
    variables: Variables,
    *,
    cost: Cost,
    error: str,
    system: Any = None,
    facts: Mapping[str, str | float] | None = None,
) -> xarray.Dataset:
    """Return arrays as a dataset whose attributes say where they come from.

    Parameters
    ----------
    title : str
    coordinates, variables : mapping of str to (dimensions, array)
        Complex arrays become two, of the real and of the imaginary parts: netCDF has none. Those
        that hold nothing at each place are left out.
    cost : Cost
        As the attributes ``cost_seconds`` and so on, all of them floats.
    error : str
        What ``error`` means.
    system : Map, optional
        Its line as ``system``, its parameters as ``parameter_...``, but for the coordinates.
    facts : mapping of str to str or float, optional
        More attributes.

    Raises
    ------
    ImportError
        When xarray is not installed.
    """
    try:
        import xarray as xr
    except ImportError as missing:
        raise ImportError(
            "to_xarray needs xarray, which is not installed: pip install xarray"
        ) from missing
    attributes: dict[str, str | float] = {"title": title, "dynkit_version": __version__}
    if system is not None:
        fixed = {name: v for name, v in system.parameters.items() if name not in coordinates}
        attributes["system"] = told(system, without=coordinates)
        attributes |= {f"parameter_{name}": v for name, v in fixed.items()}
    attributes |= {"error_meaning": error, "cost_seconds": cost.seconds}
    attributes |= {f"cost_{name.replace(' ', '_')}": float(n) for name, n in cost.counts.items()}
    attributes |= facts or {}
    found = xr.Dataset(dict(_real(variables)), dict(_real(coordinates)), attributes)
    if "error" in found:
        found["error"].attrs["long_name"] = error
    return found


def _real(variables: Variables) -> Iterable[tuple[str, tuple[str | tuple[str, ...], Any]]]:
    for name, (dimensions, values) in variables.items():
        array = np.asarray(values)
        if 0 in array.shape[1:]:  # nothing of each, which netCDF does not hold either
            continue
        if np.iscomplexobj(array):
            yield f"{name}_real", (dimensions, array.real.copy())
            yield f"{name}_imaginary", (dimensions, array.imag.copy())
        else:
            yield name, (dimensions, array.copy())  # a user may write to it


def known_error(result: object, dimensions: str) -> Variables:
    """Return the error of a result, where it was worked out before, as a variable."""
    found = vars(result).get("error")
    return {} if found is None else {"error": (dimensions, found)}
