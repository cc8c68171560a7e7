"""Results: their export formats and their stores."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, final

import numpy as np

from dynkit._version import __version__
from dynkit.core.parameters import Family
from dynkit.core.reprs import Facts, Tabled, table
from dynkit.core.smooth_map import checked_map
from dynkit.data import atomic_files as files, store
from dynkit.data.codec import decoded, encoded
from dynkit.data.dataset import Dataset

if TYPE_CHECKING:
    import xarray


class Result(Tabled, ABC):
    """A result with named arrays and dimensions, and their export formats."""

    @abstractmethod
    def dataset(self) -> Dataset:
        """Return the arrays with names, dimensions and attributes."""

    @final
    def to_xarray(self) -> xarray.Dataset:
        """Return the `dataset` as an `xarray.Dataset`.

        Raises
        ------
        ImportError
            When xarray is not installed.
        """
        return self.dataset().to_xarray()

    @final
    def to_pandas(self) -> Any:
        """Return the table of the `dataset` as a `pandas.DataFrame`; see `Dataset.columns`.

        Raises
        ------
        ImportError
            When pandas is not installed.
        """
        return self.dataset().to_pandas()

    @final
    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the `dataset` to a file: .csv, .npz or .h5.

        Raises
        ------
        ValueError
            When the file has another ending, or cannot be written.
        """
        self.dataset().export(path)


class Saved(Result):
    """A result with a store: `load` reads exactly what `save` wrote.

    `_stored` names the attributes and cached properties that determine all others.
    """

    _stored: ClassVar[tuple[str, ...]]

    @classmethod
    def _of(cls, **known: Any) -> Self:
        """Return the result with these attributes, without the objects it was computed from."""
        made = object.__new__(cls)
        vars(made).update(known)
        return made

    def _facts(self) -> Facts:
        """Return the stored attributes that are known, by name."""
        known = vars(self)
        names = [name for name in self._stored if name in known and not name.startswith("_")]
        return {name.replace("_", " "): known[name] for name in names}

    def _tables(self) -> Iterable[str]:
        """Return the variables over the first dimension, once all stored attributes are known."""
        if any(name not in vars(self) for name in self._stored):
            return ()
        data = self.dataset()
        over = next(iter(data.variables.values()))[0][0]
        arrays = {**data.coordinates, **data.variables}
        columns = {name: array for name, (names, array) in arrays.items() if names == (over,)}
        if len(columns) < 2:
            return ()
        heads = [name.replace("_", " ") for name in columns]
        return [table(f"by {over}", zip(*columns.values(), strict=True), heads)]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a store (HDF5). After a failure the old file remains.

        Raises
        ------
        ValueError
            When the file cannot be written.
        """
        write_result(path, self, {})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a result from a store, exact, but without the objects it was computed from.

        Raises
        ------
        ValueError
            When the file is missing, damaged, or not a store of such a result.
        """
        return read_result(path, cls)[0]


class SavedWithSystem(Result):
    """A result with a store that is read with the system of the result.

    The store holds the values of the system's parameters, and texts that identify the rest of the
    system. `_stored` names the attributes that determine all others: see `dynkit.data.codec`.
    """

    _stored: ClassVar[tuple[str, ...]]
    _given: ClassVar[str | None] = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a store (HDF5). After a failure the old file remains.

        Raises
        ------
        ValueError
            When the file cannot be written, or a field of the system cannot be stored.
        """
        me: Any = self
        write_result(path, self, store.entries_of(me.system))

    @classmethod
    def load(cls, path: str | os.PathLike[str], system: Any) -> Self:
        """Read a result from a store, bit for bit as it was saved.

        Properties that are computed when first read are computed again, from the same bits.

        Parameters
        ----------
        path : path
        system : Map or Flow
            The system of the result, at any values of its parameters: the result has those of the
            store.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of such a result, or was made with
            another system.

        Examples
        --------
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from dynkit import MapOrbit, periodic_orbit
        >>> from dynkit.systems import Logistic
        >>> with TemporaryDirectory() as folder:
        ...     periodic_orbit(Logistic(rate=3.2), [0.5], period=2).save(Path(folder, "x.h5"))
        ...     MapOrbit.load(Path(folder, "x.h5"), Logistic(rate=1.0))
        <P(2) of Logistic(rate=3.2): stable>
        """
        checked_map(system, Family, "a Map or a Flow")
        return read_result(path, cls, partial(store.at_parameters, system))[0]


_Read = TypeVar("_Read")


def write_result(path: str | os.PathLike[str], result: Result, entries: Mapping[str, str]) -> None:
    """Write a result and further entries to a store; ValueError where it cannot be written."""
    store.save(path, archive_of(result, entries))


def archive_of(result: object, entries: Mapping[str, str]) -> store.Archive:
    """Return a result and further entries as the content of a store."""
    arrays = dict[str, Any]()
    tree = json.dumps(encoded("", result, arrays))
    arrays["json"] = np.frombuffer(tree.encode(), dtype=np.uint8)
    kind = {"kind": type(result).__name__, "dynkit": __version__}
    return store.Archive({**kind, **entries}, arrays)


def read_result(
    path: str | os.PathLike[str],
    kind: type[_Read],
    lacking: Callable[[Path, store.Archive], Any] | None = None,
) -> tuple[_Read, Path, store.Archive]:
    """Return the result of a store, its file and its archive.

    `lacking` returns the object that the result needs and the store does not hold: see `_given` of
    `dynkit.data.codec`.

    Raises
    ------
    ValueError
        When the store holds a result of another kind, or is incomplete.
    """
    file = files.place("store", path)
    archive = store.read(file)
    name, held = kind.__name__, archive.entries.get("kind")
    if held != name:
        an = "an" if name[0] in "AEIOU" else "a"
        raise ValueError(f"store must hold {an} {name}; got {file}, which holds: {held}")
    given = lacking(file, archive) if lacking else None
    with store.understood(file, kind.__name__):
        tree = json.loads(archive.arrays["json"].tobytes())
        found: _Read = decoded(kind, "", tree, archive.arrays, given)
    return found, file, archive
