"""What sweeps and maps of two parameters have in common: their arguments, and single motions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from dynkit.core.validation import Array, finite_array, non_negative_integer, positive_integer
from dynkit.data.store import identity_of, kind_of
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.engine.collecting import Columns


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """The simulations at values of some parameters; picklable, and small: it has no values.

    A subclass must define `KIND`, the kind of its stores, and `columns`, the kinds and shapes of
    its rows. It is called with the task of a chunk.

    Parameters
    ----------
    system : Map or None
        At any values of the parameters; None for a result that was loaded without its system.
    kind : str
        Full name of the system's class.
    names, begin : tuple of str, tuple of float
        The parameters, and their first values.
    transient, keep : int
    observables : tuple of str
    start : array
        The start, packed at the first values; empty for the default start of the system.
    follow : bool
        Whether each value starts from the last state of the value before it.
    """

    KIND: ClassVar[str]
    system: Map | None
    kind: str
    names: tuple[str, ...]
    begin: tuple[float, ...]
    transient: int
    keep: int
    observables: tuple[str, ...]
    start: Array
    follow: bool = False
    # in a worker alone: the system at the values simulated last, and those with their last state
    _known: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls,
        system: Map,
        values: Mapping[str, Array],
        *,
        transient: int,
        keep: int,
        observables: Sequence[str] | None,
        start: object,
        **own: Any,
    ) -> Self:
        """Return the plan of a system at some values, (k,) each, of its parameters.

        Raises
        ------
        ValueError
            When an argument is refused, or the system has no default start and none is given.
        """
        begin = {name: float(axis[0]) for name, axis in values.items()}
        first = system.replace(**begin)
        if start is None and first.default_start is None:
            raise ValueError(f"start must be a state of the map, ({system.dimension},); got None")
        return cls(
            system=first,
            kind=kind_of(system),
            names=tuple(begin),
            begin=tuple(begin.values()),
            transient=non_negative_integer("transient", transient),
            keep=positive_integer("keep", keep),
            observables=_known_names(system.observables, observables),
            start=np.empty(0) if start is None else first.pack_state(start),
            **own,
        )

    @classmethod
    def stored(
        cls, entries: Mapping[str, str], values: Mapping[str, Array], start: Array, **own: Any
    ) -> Self:
        """Return the plan of the entries of a store, without its system."""
        return cls(
            system=None,
            kind=entries["system"],
            names=tuple(values),
            begin=tuple(float(axis[0]) for axis in values.values()),
            transient=int(entries["transient"]),
            keep=int(entries["keep"]),
            observables=tuple(json.loads(entries["observables"])),
            start=start,
            **own,
        )

    @property
    def columns(self) -> Columns:
        """Kinds of numbers and shapes of the rows, by name."""
        raise NotImplementedError

    def system_at(self, *values: float) -> Map:
        """Return the system at values of the parameters."""
        # a system at other values may know what does not depend on the parameters
        known: Map | None = self._known.get("system", self.system)
        if known is None:
            raise ValueError(
                f"system must be given to load a {self.KIND} that is to simulate; got None"
            )
        return known.replace(**dict(zip(self.names, values, strict=True)))

    def entries(self, **own: str) -> dict[str, str]:
        """Return the texts of a store that identify the simulations."""
        return {
            "kind": self.KIND,
            "system": self.kind,
            **own,
            "start": "given" if len(self.start) else "the system's own",
            **identity_of(self.system_at(*self.begin)),
            "transient": str(self.transient),
            "keep": str(self.keep),
            "observables": json.dumps(self.observables),
        }

    def motion(self, system: Map, start: Any) -> Attractor:
        """Simulate a system from a start."""
        return system.attractor(start=start, transient=self.transient, keep=self.keep)


def swept_values(name: str, values: object) -> Array:
    """Return values of a parameter as a new read-only array, (k,).

    Raises
    ------
    ValueError
        When they are not finite numbers, or there is none.
    """
    array = finite_array(name, values, (None,)).copy()
    if not len(array):
        raise ValueError(f"{name} must hold at least one number; got none")
    array.setflags(write=False)
    return array


def _known_names(known: Sequence[str], asked: object) -> tuple[str, ...]:
    """Return the names of the observables to keep, by default the first."""
    if asked is None:
        return (known[0],)
    if isinstance(asked, str) or not isinstance(asked, Sequence) or not len(asked):
        raise ValueError(f"observables must be a sequence of names; got {asked!r}")
    for name in asked:
        if name not in known:
            raise ValueError(f"observables must be among {', '.join(known)}; got {name!r}")
    return tuple(dict.fromkeys(asked))
