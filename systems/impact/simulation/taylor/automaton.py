"""The automaton of an oscillator whose energies are not quadratic: its modes and their guards."""

from __future__ import annotations

from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import IMPACT
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import carries, depends
from dynkit.systems.impact.modes.structure import Structure
from dynkit.systems.impact.modes.taylor.mode import TaylorMode
from dynkit.systems.impact.modes.taylor.scene import Scene
from dynkit.systems.impact.simulation.joined_modes import Guard, JoinedModes, cycled_by
from dynkit.systems.impact.simulation.regimes import Parts
from dynkit.systems.impact.simulation.scraping import Rub, rubbing


@final
class TaylorAutomaton(JoinedModes):
    """The modes of an oscillator whose energies are not quadratic.

    Attributes
    ----------
    table : (guards, 4)
        For each guard: its mode, its element, the next mode, and the kind of the event.
    """

    def __init__(self, structure: Structure, scene: Scene, parts: Parts) -> None:
        self._structure, self._scene = structure, scene
        self._elements = scene.elements
        self.parts = parts
        self._forget()
        hit = any(isinstance(element, HardStop) for element in scene.elements)
        idle = not (hit or scene.excitation.turns)
        self._cycled = cycled_by(scene.elements) if idle else None
        self._number((0,) * len(scene.elements))

    @property
    def table(self) -> NDArray[np.intp]:
        """Mode, element, next mode and kind of the event of each guard, (guards, 4)."""
        return self.parts.table(self.regimes, self.guards)

    def enter(self, number: int) -> int:
        """Number of the mode that a guard leads to; it is built if no motion has entered it."""
        guard = self.guards[number]
        if guard.target < 0:
            target = self._number(self.parts.after(self.regimes[guard.mode], guard))
            guard.partner, guard.target = self.guard(target, guard.element), target
        return guard.target

    def _build(self, regimes: tuple[int, ...]) -> None:
        now, number = self.parts.now(regimes), len(self.modes)
        grips, riding = self.parts.grips(regimes), self.parts.riding(regimes)
        watched = self.parts.watches(regimes, riding)
        watched.sort(key=lambda pair: (pair[1].at_once, pair[0] in self.parts.sliders))
        mode = TaylorMode(self._scene, now, grips, watched, self.parts.tractions(regimes))
        self.modes.append(mode)
        self.regimes.append(regimes)
        for k, watch in watched:
            guard = Guard(number, k, watch, None)
            if watch.event == IMPACT:
                guard.rubbed = self.parts.rubbed(regimes, k)
            if watch.event == IMPACT and mode.constant_kicks:
                rubs = partial(self._rubs, guard, np.zeros(mode.bodies), 0.0)
                self._decide(guard, riding[k], rubs)
            self.guards.append(guard)

    def turns(self, guard: Guard, x: Array, phase: float) -> tuple[float, float]:
        """Effect on the bounces at a stop of friction along its row: see `Parts.turns`."""
        if not any(guard.rubbed):
            return 0.0, 0.0
        response = self.modes[guard.mode].response(guard.element, x, phase)
        return self.parts.turns(guard.rubbed, self._scene.rows_at(x) @ response)

    def outcome(self, guard: Guard, x: Array, phase: float) -> tuple[int, bool]:
        """The element that an impact at positions (N,) and a phase opens or moves; -1 for none.

        Then whether it pushes against a closed stop, or friction leaves its outcome open.
        """
        inertia = self._scene.inertia(x, phase)
        opens, ambiguous = self.parts.pushed(self.regimes[guard.mode], guard.element, inertia)
        return opens, ambiguous or self._rubs(guard, x, phase)[1]

    def scrapes(self, guard: Guard, x: Array, phase: float) -> tuple[Rub, ...]:
        """Friction at an impact at positions (N,) and a phase."""
        if self.modes[guard.mode].constant_kicks:
            known: tuple[Rub, ...] = guard.scrapes
            return known
        return self._rubs(guard, x, phase)[0]

    def _rubs(self, guard: Guard, x: Array, phase: float) -> tuple[tuple[Rub, ...], bool]:
        """Friction at an impact at positions (N,), and whether mass coupling leaves it open."""
        mode, now = self.modes[guard.mode], self.regimes[guard.mode]
        mass, rows = self._scene.inertia(x, phase)
        found, open_ = rubbing(mass, rows, self._elements, self.parts, now, guard.element)
        return tuple(Rub(k, float(mode.takes(k, x, phase))) for k in found), open_

    def jams(self, guard: Guard, x: Array, phase: float) -> bool:
        """Whether a stop is hit along a row that others hold; used where rows or masses vary."""
        mode = self.modes[guard.mode]
        held = [*mode.held, *mode.sticking]
        if not held:
            return False
        mass, rows = self._scene.inertia(x, phase)
        return depends(mass, rows[[*held, guard.element]])

    def coupled(self, guard: Guard, other: int, x: Array, phase: float) -> bool:
        """Whether an impact at positions (N,) changes the rate of another stop's gap."""
        mass, rows = self._scene.inertia(x, phase)
        return carries(mass, rows[other], self.modes[guard.mode].kick(guard.element, x, phase))
