"""The contract of a method that simulates impacts, and its results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, final

from dynkit.analysis.work_precision.exact import ExactImpacts
from dynkit.core.validation import finite_array


@final
@dataclass(frozen=True, eq=False)
class FoundImpacts:
    """Impacts and releases found by a method, and its work.

    Parameters
    ----------
    times : (k,) array_like
    positions, velocities : (k, N) array_like
        Positions at the impacts, and velocities just after them.
    releases : (m,) array_like
        Times at which a sticking mass leaves the table.
    work : mapping of str to int
        Counts by name, such as ``{"evaluations": 1200}``; the budget limits the first.

    Raises
    ------
    ValueError
        When lengths differ, or a number is not finite.
    """

    times: Any
    positions: Any
    velocities: Any
    releases: Any = ()
    work: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = finite_array("times", self.times, (None,))
        object.__setattr__(self, "times", times)
        for name in ("positions", "velocities"):
            array = finite_array(name, getattr(self, name), (len(times), None))
            object.__setattr__(self, name, array)
        object.__setattr__(self, "releases", finite_array("releases", self.releases, (None,)))

    def __repr__(self) -> str:
        parts = [f"{len(self.times)} impacts", f"{len(self.releases)} releases"]
        parts += [f"{count} {name.replace('_', ' ')}" for name, count in self.work.items()]
        return f"<FoundImpacts: {', '.join(parts)}>"


Simulation: TypeAlias = Callable[[int], FoundImpacts]
"""Function of a budget of work that simulates once; its run time is measured."""


class GaveUp(Exception):
    """The method failed; the message says why."""


@final
class OverBudget(GaveUp):
    """The budget of work, in the given unit, was exceeded."""

    def __init__(self, unit: str) -> None:
        super().__init__(f"gave up: more {unit} than allowed")
        self.unit = unit


class Unsuited(Exception):
    """The method is not installed, or not suitable for the system; the message says which."""


class ImpactMethod(ABC):
    """A method that simulates impacts, at several tolerances.

    A subclass must implement:

    1. `name`, for tables and legends;
    2. `tolerances`, from the coarsest to the finest, with a meaning that the method defines (a
       relative tolerance, a step); a single 0 when it has none;
    3. `prepare`, which does the work that is not timed (compilation, modes, matrices), and returns
       a function that simulates all impacts up to ``exact.until``, and possibly later ones;
    4. `budget`, the most work that the function may do for all starts of a job, in units of the
       first entry of ``FoundImpacts.work``.

    Examples
    --------
    >>> class Late(ImpactMethod):
    ...     '''Exact impacts, late by the tolerance.'''
    ...
    ...     name, tolerances = "late", (1e-3, 1e-6)
    ...
    ...     def prepare(self, exact, tolerance):
    ...         return lambda budget: FoundImpacts(
    ...             exact.times + tolerance * exact.period, exact.positions, exact.velocities
    ...         )
    """

    name: str
    tolerances: Sequence[float]
    budget: int = 1_000_000

    @abstractmethod
    def prepare(self, exact: ExactImpacts, tolerance: float) -> Simulation:
        """Return a function that simulates the start of ``exact``.

        The method must use only the system, the start and the end time of ``exact``.

        Raises
        ------
        Unsuited
            When the method is not installed or not suitable for such a system.
        """
