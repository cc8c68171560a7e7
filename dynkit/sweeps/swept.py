"""Base class of results at points of the engine, with their stores."""

from __future__ import annotations

import os
from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Self

from dynkit.core.smooth_map import checked_map
from dynkit.data import atomic_files as files, store
from dynkit.data.result import Result
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import Rows, read_rows, refuse_misfits, refuse_other, save_rows


class Swept(Result):
    """A result at points of the engine.

    A subclass must implement:

    1. `_kind`, the kind of its store, and `_words`, the names of the result and of its points in
       messages;
    2. `_points_in`, the points of a store, without a system;
    3. `_of`, the result of points and rows.

    The points are a dataclass with the fields `system` and `kind`, and the `names` of parameters.
    """

    _kind: ClassVar[str]
    _words: ClassVar[tuple[str, str]]
    _points: Any
    _rows: Rows

    @classmethod
    @abstractmethod
    def _of(cls, points: Any, rows: Rows) -> Self:
        """Return the result from the rows of all points."""

    @classmethod
    @abstractmethod
    def _points_in(cls, archive: store.Archive) -> Any: ...

    @classmethod
    def load(cls, path: str | os.PathLike[str], system: Map | None = None) -> Self:
        """Read the result of a finished run from a store, without writing or simulating.

        Parameters
        ----------
        path : path
        system : Map, optional
            The system that was simulated, at any values of the parameters; methods that simulate
            again, such as `attractor`, need it.

        Raises
        ------
        ValueError
            When the file is missing, damaged or not a store of such a result, when the run is not
            finished, or was made with another system.
        """
        file = files.place("store", path)
        archive, found = read_rows(file, cls._kind)
        with store.understood(file, cls._kind):
            points = cls._points_in(archive)
            refuse_misfits(points, found)
        if system is not None:
            known = checked_map(system, Map).parameters
            for name in points.names:
                if name not in known:
                    raise ValueError(
                        f"store {file} was made with parameter {name}; got a system without it"
                    )
            points = replace(points, system=system, kind=store.kind_of(system))
            refuse_other(file, points, archive)
        if not found.done.all():
            what, each = cls._words
            raise ValueError(
                f"store must hold a finished {what}; got {found.done.sum()} of {found.count} "
                f"{each} in {file}"
            )
        return cls._of(points, found.rows())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a store, as ``store=`` does; `load` reads it.

        Raises
        ------
        ValueError
            When the file cannot be written, or the result was loaded without its system.
        """
        save_rows(path, self._points, self._rows)
