"""Attractors: the motion after its transient."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any

import numpy as np

from dynkit.core.cost import Cost
from dynkit.core.overriding import Extensible
from dynkit.core.reprs import Facts, system_repr
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, of_type, one_of
from dynkit.data.dataset import Dataset, described, known_error
from dynkit.data.result import Result
from dynkit.dynamics.section import PoincareSection
from dynkit.labels.label import OrbitLabel
from dynkit.viewer.page import Page
from dynkit.viewer.section import page_of_section
from dynkit.viewer.series import Series, series_of_states
from dynkit.viewer.viewing import Viewed


class _Ending(Enum):
    COUNT_REACHED = "the number of states was reached"


class Attractor(Viewed, Extensible, Result, ABC):
    """The states of a motion after its transient.

    A subclass must implement:

    1. `system`, the `Map` whose iterates the states are.
    2. `transient`, the number of skipped states, and `states`, (n, d), the kept states in their
       order, read-only. A longer transient gives the later part of the same motion, bit for bit, or
       to rounding as `Map.following`.
    3. `label`, an `OrbitLabel`: computed once, when it is first read.
    4. ``time_series(times)``, the motion at given times, in columns that the subclass documents.
       The times may lie beyond the kept states, and the same times give the same bits.
    5. `cost`, the `Cost` of the states; and `error`, a float >= 0: an estimate of the error of the
       states, in a norm that the subclass documents.

    A subclass may implement, where a start is more than a state or motions can end:

    6. `final`, the start from which the motion continues, `duration`, and `ending`, a member of an
       enumeration whose value says in words why the simulation ended.
    7. ``observable(name)``, (n,): one of the map's `observables` at the kept states.
    8. ``label_within(budget)``, the label from at most this number of states.
    9. `dataset`, when its states are more than their observables.

    Instances are immutable: properties that are computed when first read depend on nothing else.
    `dynkit.testing.check_attractor` tests a subclass against this contract.
    """

    @property
    @abstractmethod
    def system(self) -> SmoothMap:
        """The map whose iterates the states are."""

    @property
    @abstractmethod
    def transient(self) -> int:
        """Number of skipped states."""

    @property
    @abstractmethod
    def states(self) -> Array:
        """The kept states, (n, d), read-only."""

    @property
    @abstractmethod
    def label(self) -> OrbitLabel:
        """Label of the motion."""

    @property
    @abstractmethod
    def cost(self) -> Cost:
        """Cost of the states."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Estimate of the error of the states."""

    @abstractmethod
    def time_series(self, times: Array) -> Array:
        """Return the motion, (k, ...), at the given times, (k,)."""

    @property
    def final(self) -> Any:
        """The start from which the motion continues: by default the last kept state."""
        return np.asarray(self.states[-1])

    @property
    def duration(self) -> float:
        """Time at which the motion that continues begins: by default the number of states."""
        return float(self._kept)

    @property
    def ending(self) -> Enum:
        """Why the simulation ended; the value of the member says it in words."""
        return _Ending.COUNT_REACHED

    def observable(self, name: str) -> Array:
        """Return one of the map's `observables` at the kept states, (n,).

        Raises
        ------
        ValueError
            When the map has no observable of this name.
        """
        names = list(self.system.observables)
        return self.states[:, names.index(one_of("name", name, names))]

    def dataset(self) -> Dataset:
        """Return the observables at the kept states as a dataset over ``state``.

        It contains the label and the `error` if they have been computed before, because both
        simulate.
        """
        label = self._known_label
        facts: dict[str, Any] = {} if label is None else {"label": str(label)}
        return Dataset(
            {},
            {
                **{name: ("state", self.observable(name)) for name in self.system.observables},
                **known_error(self, ()),
            },
            described(
                "States of a motion after its transient",
                cost=self.cost,
                error="estimate of the error of the states",
                system=self.system,
                transient=float(self.transient),
                ending=str(self.ending.value),
                **facts,
            ),
        )

    def label_within(self, budget: int) -> OrbitLabel:  # noqa: ARG002
        """Return the label from at most this number of states besides the kept ones."""
        return self.label

    @property
    def _stays(self) -> bool:
        """Whether a fast test proves that the motion is on a stable orbit; False by default."""
        return False

    def _series(self) -> Series:
        """Return the time series for pages in the browser: one period of a periodic motion."""
        n = self.label.iterates
        if n is None or n > len(self.states):
            return series_of_states(self.system, self.states)
        return series_of_states(self.system, self.states[-n:], periodic=True)

    def _page(self, motions: int) -> Page:
        title = f"Attractor, {self.label}"
        names = self.system.observables
        return page_of_section(title, self, names, lambda _: self._series(), motions)

    @property
    def _kept(self) -> int:
        """Number of kept states."""
        return len(self.states)

    @property
    def _known_label(self) -> OrbitLabel | None:
        """The label, if it was computed before."""
        label: OrbitLabel | None = getattr(self, "__dict__", {}).get("label")
        return label

    def __repr__(self) -> str:
        label = self._known_label
        name = "" if label is None else f"{label}, "
        kind, system = type(self).__name__, system_repr(self.system, 6)
        return f"<{kind} of {system}: {name}{self._kept} states after {self.transient}>"

    def _caption(self) -> str:
        return type(self).__name__

    def _facts(self) -> Facts:
        return {
            "system": system_repr(self.system, 6),
            "label": self._known_label or "not decided yet",
            "states kept": self._kept,
            "states skipped": self.transient,
            "cost": self.cost,
        }

    def section(self, section: PoincareSection) -> Array:
        """Return the kept states, (k, d), just after the motion passed the section.

        A map jumps over the section: these are the states on or beyond it, in the section's
        direction, whose predecessor lies before it.
        """
        of_type("section", section, PoincareSection, "a PoincareSection")
        values = [section.direction * section.value(state) for state in self.states]
        side = np.array(values) >= 0.0
        return self.states[1:][side[1:] & ~side[:-1]]
