"""What a method of simulating impacts owes, and what it gives."""

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
    """What a method found: its impacts, the releases, and the work that it took.

    Parameters
    ----------
    times : (k,) array_like
    positions, velocities : (k, N) array_like
        At the impacts, and just after them.
    releases : (m,) array_like
        Times at which a mass that stuck to the table leaves it.
    work : mapping of str to int
        By name, such as ``{"evaluations": 1200}``; the first is what the budget counts.

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
"""Simulates once, with at most so much work; this is what is timed."""


class GaveUp(Exception):
    """The method broke down; the message says how."""


@final
class OverBudget(GaveUp):
    """The budget of work was exceeded, which is counted in this unit."""

    def __init__(self, unit: str) -> None:
        super().__init__(f"gave up: more {unit} than allowed")
        self.unit = unit


class Unsuited(Exception):
    """The method is not installed, or not made for this system; the message says which."""


class ImpactMethod(ABC):
    """One way of simulating impacts, at tolerances of its own.

    A subclass owes

    1. `name`, for tables and legends;
    2. `tolerances`, from the coarsest to the finest, whatever they mean to it: a relative
       tolerance, a step; a single 0 when it has none;
    3. `prepare`, which does what need not be timed (compilation, modes, matrices), and returns a
       function that simulates: all impacts up to ``exact.until``, and some beyond if it likes;
    4. `budget`, the most work that the function may do for one start or for several of a job,
       counted in the first entry of ``FoundImpacts.work``.

    Examples
    --------
    >>> class Late(ImpactMethod):
    ...     '''Right but for the time, which is late by the tolerance.'''
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
        """Return a function that simulates the start of ``exact``; it sees nothing but that.

        Raises
        ------
        Unsuited
            When it is not installed or not made for such a system.
        """
