"""Datasets: named arrays with dimensions, the source of all export formats of a result."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit._version import __version__
from dynkit.core.cost import Cost
from dynkit.core.reprs import system_repr
from dynkit.core.validation import of_type
from dynkit.data.atomic_files import checked_path, whole

if TYPE_CHECKING:
    import xarray

Variables = Mapping[str, tuple[str | tuple[str, ...], Any]]
"""Arrays by name, each with the names of its dimensions."""

ENDINGS = (".csv", ".npz", ".h5")
"""Endings of the files that `Dataset.export` writes."""


@final
@dataclass(frozen=True, eq=False)
class Dataset:
    """Named arrays with dimensions, and attributes that describe their origin.

    Parameters
    ----------
    coordinates, variables : mapping of str to (dimensions, array)
        Arrays by name, each with the name, or the names, of its dimensions.
    attributes : mapping of str to str or float

    Raises
    ------
    ValueError
        When an array has another number of dimensions than names, or arrays differ in the size of
        a shared dimension.

    Examples
    --------
    >>> data = Dataset({"time": ("time", [0.0, 1.0])}, {"x": ("time", [2.0, 3.0])}, {"title": "x"})
    >>> print(data.as_csv())
    time,x
    0.0,2.0
    1.0,3.0
    """

    coordinates: Variables
    variables: Variables
    attributes: Mapping[str, str | float]

    def __post_init__(self) -> None:
        of_type("attributes", self.attributes, Mapping, "numbers and texts by name")
        sizes: dict[str, int] = {}
        for group in ("coordinates", "variables"):
            made = {}
            of_type(group, getattr(self, group), Mapping, "dimensions and values by name")
            for name, (dimensions, values) in getattr(self, group).items():
                names = (dimensions,) if isinstance(dimensions, str) else tuple(dimensions)
                array = np.asarray(values)
                if array.dtype.hasobject:
                    raise ValueError(f"{name} must hold numbers or texts; got objects")
                if array.ndim != len(names):
                    raise ValueError(
                        f"{name} must have the dimensions {', '.join(names)}; got shape "
                        f"{array.shape}"
                    )
                for dimension, size in zip(names, array.shape, strict=True):
                    if sizes.setdefault(dimension, size) != size:
                        raise ValueError(
                            f"{name} must have length {sizes[dimension]} along {dimension}; got "
                            f"{size}"
                        )
                made[name] = names, array
            object.__setattr__(self, group, made)

    def arrays(self) -> dict[str, Any]:
        """Return all arrays by name."""
        return {name: array for name, (_, array) in {**self.coordinates, **self.variables}.items()}

    def to_xarray(self) -> xarray.Dataset:
        """Return an `xarray.Dataset` that can be written to netCDF.

        A complex array becomes two arrays, of its real and its imaginary parts, because netCDF has
        no complex numbers. Arrays with an empty trailing dimension are left out.

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
        parts = [_real(group) for group in (self.variables, self.coordinates)]
        found = xr.Dataset(parts[0], parts[1], self.attributes)
        if "error" in found:
            found["error"].attrs["long_name"] = self.attributes["error_meaning"]
        return found

    def columns(self) -> dict[str, Any]:
        """Return the data as a table: columns of equal length, by name.

        There is a row for each element of the first variable that is not NaN. A variable with
        additional dimensions becomes several columns, ``name[0]``, ``name[1]`` ... A variable whose
        first dimension is none of those of the first variable is left out.
        """
        everything = _real({**self.coordinates, **self.variables})
        over, first = next(iter(_real(self.variables).values()))
        places = np.indices(first.shape).reshape(len(over), -1)
        if first.dtype.kind == "f":
            places = places[:, ~np.isnan(first.ravel())]
        index = dict(zip(over, places, strict=True))
        table: dict[str, Any] = {}
        for dimension in over[1:]:
            if dimension not in everything:
                table[dimension] = index[dimension]
        for name, (dimensions, array) in everything.items():
            if not dimensions or dimensions[0] not in index:
                continue
            rest = [d for d in dimensions if d not in index]
            moved = np.moveaxis(array, [dimensions.index(d) for d in rest], range(len(rest)))
            at = tuple(index[d] for d in dimensions if d in index)
            for place in np.ndindex(moved.shape[: len(rest)]):
                suffix = f"[{','.join(map(str, place))}]" if place else ""
                table[f"{name}{suffix}"] = moved[place][at]
        names = [name for name in self.coordinates if name in table]
        return {name: table[name] for name in [*names, *(n for n in table if n not in names)]}

    def to_pandas(self) -> Any:
        """Return the table of `columns` as a `pandas.DataFrame`.

        Raises
        ------
        ImportError
            When pandas is not installed.
        """
        import pandas as pd

        return pd.DataFrame(self.columns())

    def as_csv(self) -> str:
        """Return the table of `columns` as CSV; floats read back bit for bit."""
        columns = {name: column.tolist() for name, column in self.columns().items()}
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
        return text.getvalue()

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the data to a file: .csv, .npz or .h5. After a failure the old file remains.

        A .csv file holds the table of `columns`, the other formats all arrays and the attributes.
        The .csv file has no attributes, because most readers would take comment lines for the names
        of columns.

        Raises
        ------
        ValueError
            When the file has another ending, or cannot be written.
        """
        given = checked_path("path", path)
        ending = Path(given).suffix
        if ending not in ENDINGS:
            raise ValueError(f"path must end in {', '.join(ENDINGS)}; got {given!r}")
        with whole("path", path) as stream:
            stream.write(self.as_bytes(ending))

    def as_bytes(self, ending: str) -> bytes | memoryview:
        """Return the content that `export` writes to a file with this ending."""
        if ending == ".csv":
            return self.as_csv().encode()
        # in memory: HDF5 locks and seeks in files, and its errors do not mention a full disk
        buffer = io.BytesIO()
        if ending == ".npz":
            everything: dict[str, Any] = {**self.attributes, **self.arrays()}
            np.savez_compressed(buffer, **everything)
            return buffer.getbuffer()
        import h5py

        with h5py.File(buffer, "w") as file:
            for name, array in self.arrays().items():
                file[name] = array.astype(h5py.string_dtype()) if array.dtype.kind == "U" else array
            file.attrs.update(self.attributes)
        return buffer.getbuffer()


def _real(variables: Variables) -> dict[str, tuple[tuple[str, ...], Any]]:
    """Return real arrays: complex ones in two parts, those with empty dimensions left out."""
    found: dict[str, tuple[tuple[str, ...], Any]] = {}
    for name, (names, array) in variables.items():
        dimensions = tuple(names)
        if 0 in array.shape[1:]:  # netCDF cannot hold such an array
            continue
        if np.iscomplexobj(array):
            found[f"{name}_real"] = dimensions, array.real.copy()
            found[f"{name}_imaginary"] = dimensions, array.imag.copy()
        else:
            found[name] = dimensions, array.copy()  # a user may write to it
    return found


def known_error(result: object, dimensions: str | tuple[str, ...]) -> Variables:
    """Return the error of a result as a variable, if it has been computed before."""
    found = vars(result).get("error")
    return {} if found is None else {"error": (dimensions, found)}


def described(
    title: str,
    *,
    cost: Cost,
    error: str,
    system: Any = None,
    swept: tuple[str, ...] = (),
    **facts: Any,
) -> dict[str, str | float]:
    """Return attributes of a dataset, which describe its origin.

    Parameters
    ----------
    title : str
    cost : Cost
        It becomes the attributes ``cost_seconds`` and ``cost_...`` for each count, all floats.
    error : str
        Meaning of the variable ``error``.
    system : Map, optional
        Its repr becomes ``system``, its parameters ``parameter_...``, without those swept.
    swept : tuple of str
        Names of the swept parameters.
    facts : str or float
        Further attributes.
    """
    attributes: dict[str, str | float] = {"title": title, "dynkit_version": __version__}
    if system is not None:
        fixed = {name: v for name, v in system.parameters.items() if name not in swept}
        attributes["system"] = system_repr(system, without=swept)
        attributes |= {f"parameter_{name}": v for name, v in fixed.items()}
    attributes |= {"error_meaning": error, "cost_seconds": cost.seconds}
    attributes |= {f"cost_{name.replace(' ', '_')}": float(n) for name, n in cost.counts.items()}
    return attributes | facts
