"""Attractors: where a motion stays once its transient has died out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, Tabled, told
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, one_of
from dynkit.dynamics.section import PoincareSection
from dynkit.labels.label import OrbitLabel


class _Ending(Enum):
    COUNT_REACHED = "the number of states was reached"


class Attractor(Tabled, ABC):
    """What is left of a motion after its transient.

    A subclass owes:

    1. `system`, what moves: a `Map`, of which the states are iterates.
    2. `transient`, the number of states that were skipped, and `states`, (n, d), the states that
       were kept, one after the other, read-only. A longer transient gives, bit for bit, the later
       part of the same motion.
    3. `label`, an `OrbitLabel`: decided when it is first asked for, and once.
    4. ``time_series(times)``, the states at given times, first column to last as the subclass
       says; they may lie beyond the states that were kept, and the same times give the same bits.
    5. `cost`, a `Cost`: what the states cost; and `error`, a float >= 0 that estimates how wrong
       the states may be, in a sense that the subclass says.

    and may offer, where the map's starts are more than its states, or its motions can end:

    6. `final`, the start from which the motion goes on, and `ending`, a member of an enumeration
       whose value says in words why the simulation ended.
    7. ``observable(name)``, (n,): one of the map's `observables` at the states kept.
    8. ``label_within(budget)``, the label as far as so many states tell.

    Instances are immutable: what is worked out when asked for depends on nothing else.
    `dynkit.testing.check_attractor` runs any subclass through this contract.
    """

    @property
    @abstractmethod
    def system(self) -> SmoothMap:
        """What moves."""

    @property
    @abstractmethod
    def transient(self) -> int:
        """How many states were skipped."""

    @property
    @abstractmethod
    def states(self) -> Array:
        """The states that were kept, (n, d), read-only."""

    @property
    @abstractmethod
    def label(self) -> OrbitLabel:
        """What kind of motion it is."""

    @property
    @abstractmethod
    def cost(self) -> Cost:
        """What the states cost."""

    @property
    @abstractmethod
    def error(self) -> float:
        """How wrong the states may be."""

    @abstractmethod
    def time_series(self, times: Array) -> Array:
        """Return the motion, (k, ...), at the given times, (k,)."""

    @property
    def final(self) -> Any:
        """The state after the last one kept, from which the motion goes on."""
        return np.asarray(self.states[-1])

    @property
    def ending(self) -> Enum:
        """Why the simulation ended: its value says it in words."""
        return _Ending.COUNT_REACHED

    def observable(self, name: str) -> Array:
        """Return one of the map's `observables` at the states kept, (n,).

        Raises
        ------
        ValueError
            When there is none of this name.
        """
        names = list(self.system.observables)
        return self.states[:, names.index(one_of("name", name, names))]

    def label_within(self, budget: int) -> OrbitLabel:  # noqa: ARG002
        """Return the label as far as so many states tell; the kept ones are always looked at."""
        return self.label

    @property
    def _kept(self) -> int:
        """How many states were kept."""
        return len(self.states)

    @property
    def _known_label(self) -> OrbitLabel | None:
        """The label, if it was decided before."""
        found = getattr(self, "__dict__", {})
        label: OrbitLabel | None = found.get("label", found.get("_label"))
        return label

    def __repr__(self) -> str:
        label = self._known_label
        name = "" if label is None else f"{label}, "
        kind, system = type(self).__name__, told(self.system, 6)
        return f"<{kind} of {system}: {name}{self._kept} states after {self.transient}>"

    def _caption(self) -> str:
        return type(self).__name__

    def _facts(self) -> Facts:
        return {
            "system": told(self.system, 6),
            "label": self._known_label or "not decided yet",
            "states kept": self._kept,
            "states skipped": self.transient,
            "cost": self.cost,
        }

    def section(self, section: PoincareSection) -> Array:
        """Return the kept states, (k, d), that the section lies just behind.

        A map jumps: these are the states beyond the section, or on it, whose predecessor is before
        it, as seen in the section's direction.
        """
        values = [section.direction * section.value(state) for state in self.states]
        side = np.array(values) >= 0.0
        return self.states[1:][side[1:] & ~side[:-1]]
