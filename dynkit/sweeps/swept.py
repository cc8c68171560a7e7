"""Base class of results at points of the engine, with their stores."""

from __future__ import annotations

import math
import os
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

from dynkit.core.smooth_map import checked_map
from dynkit.core.validation import Array
from dynkit.data import atomic_files as files, store
from dynkit.data.result import Result
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import Rows, read_rows, refuse_misfits, refuse_other, save_rows

NO_SYSTEM = "The result was loaded without its system: the page has no time series."
"""Note of a page without motions."""


class Swept(Result):
    """A result at points of the engine.

    A subclass must implement:

    1. `_kind`, the class of its plan, and `_words`, the names of the result and of its points in
       messages;
    2. `_plan_in`, the plan of a store, without a system, and the values of each parameter;
    3. `_of`, the result of a plan, values and rows;
    4. `_axes`, the values of each parameter.
    """

    _kind: ClassVar[Any]
    _words: ClassVar[tuple[str, str]]
    _plan: Any
    _rows: Rows

    @classmethod
    @abstractmethod
    def _of(cls, plan: Any, values: Sequence[Array], rows: Rows) -> Self:
        """Return the result from the rows of all points."""

    @classmethod
    @abstractmethod
    def _plan_in(cls, archive: store.Archive) -> tuple[Any, Sequence[Array]]: ...

    @property
    @abstractmethod
    def _axes(self) -> Sequence[Array]: ...

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
        file, kind = files.place("store", path), cls._kind.KIND
        archive, found = read_rows(file, kind)
        with store.understood(file, kind):
            plan, values = cls._plan_in(archive)
            count = math.prod(map(len, values))
            refuse_misfits(found, count, plan.columns, chained=plan.follow)
        if system is not None:
            known = checked_map(system, Map).parameters
            for name in plan.names:
                if name not in known:
                    raise ValueError(
                        f"store {file} was made with parameter {name}; got a system without it"
                    )
            plan = replace(plan, system=system, kind=store.kind_of(system))
            refuse_other(file, plan.points(*values), archive)
        if not found.done.all():
            what, each = cls._words
            raise ValueError(
                f"store must hold a finished {what}; got {found.done.sum()} of {found.count} "
                f"{each} in {file}"
            )
        return cls._of(plan, values, found.rows())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a store, as ``store=`` does; `load` reads it.

        Raises
        ------
        ValueError
            When the file cannot be written, or the result was loaded without its system.
        """
        save_rows(path, self._plan.points(*self._axes), self._rows)
