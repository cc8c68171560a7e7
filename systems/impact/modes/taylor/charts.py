"""The charts of one mode of Taylor's method, built when they are first used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np

from dynkit.core.kept import cached_property, kept
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import IMPACT, Regime, Watch
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import pushes
from dynkit.systems.impact.modes.structure import independent, pivots_of
from dynkit.systems.impact.modes.taylor.chart import Chart
from dynkit.systems.impact.modes.taylor.equations import Plan, numbers_of
from dynkit.systems.impact.modes.taylor.scene import Scene
from dynkit.systems.symbolic.taylor import digits_of

_NEVER = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
"""Coefficients of a guard that is always 1, in place of one that a regime does not have."""


@final
class Charts:
    """The charts of a mode, from its regimes, its held elements, and its guards that end a flight.

    A slider gets two guards in each of its regimes, one of which may never be zero. Its regimes
    then differ only in their numbers, and share their compiled code.
    """

    def __init__(
        self,
        scene: Scene,
        regimes: Sequence[Regime],
        grips: tuple[tuple[int, ...], tuple[int, ...]],
        guards: Sequence[tuple[int, Watch]],
        slips: Sequence[tuple[int, int, float]],
        watched: Callable[..., list[tuple[float, float]]],
    ) -> None:
        self._scene, self._regimes, self._slips, self._watched = scene, regimes, slips, watched
        self._held, self._sticking = grips
        self._guards: list[tuple[int, Watch | None]] = []
        self._events: list[int] = []
        for i, (k, watch) in enumerate(guards):
            if k not in scene.sliders:
                self._add(k, watch, i)
        for k in scene.sliders:
            own = [(i, watch) for i, (j, watch) in enumerate(guards) if j == k]
            for i, watch in own:
                self._add(k, watch, i)
            for _ in range(len(own), 2):
                self._add(k, None, -1)

    def _add(self, element: int, watch: Watch | None, number: int) -> None:
        self._guards.append((element, watch))
        self._events.append(number)

    def of(self, first: int, sides: tuple[int, ...]) -> Chart:
        """Chart with the gaps of held stops, of element `first` and of other stops as coordinates.

        Gaps are coordinates as far as they are independent. `sides` are the sides on which the
        sliders are nearer to yielding.
        """
        elements, rows = self._scene.elements, self._scene.rows
        stops = [k for k, e in enumerate(elements) if isinstance(e, HardStop) and not e.curved]
        held = [k for k in self._held if not elements[k].curved]
        order = list(dict.fromkeys([*held, *([first] if first in stops else []), *stops]))
        return self._made(tuple(sorted(order[i] for i in independent(rows[order]))), sides)

    @cached_property
    def plain(self) -> Chart:
        """Chart with positions and velocities themselves as coordinates."""
        slides = (self._regimes[k].stretch for k in self._scene.sliders)
        return self._made((), tuple(-1 if stretch < 0.0 else 1 for stretch in slides), False)

    @kept
    def _made(self, hard: tuple[int, ...], sides: tuple[int, ...], rubs: bool = True) -> Chart:
        """Chart with gaps of some stops as coordinates, and with slip velocities of friction."""
        scene, n = self._scene, self._scene.size
        slips = [k for k in scene.rubs if k not in scene.dragged] if rubs else []
        signs = np.array([element.sign for element in scene.elements], dtype=float)
        to, places = [], []
        for chosen in (hard, (*hard, *slips)):
            rows = scene.rows[list(chosen)]
            at = pivots_of(rows) if len(chosen) else []
            matrix = np.eye(n)
            matrix[at] = signs[list(chosen), None] * rows
            to.append(matrix)
            places.append(list(zip(chosen, at, strict=True)))
        back = [np.asarray(np.linalg.inv(part), dtype=float) for part in to]
        reach = [scene.elements[k].reach for k in scene.sliders]
        joints = np.array([sides, reach], dtype=float).reshape(2, -1).T
        flat, kinds = numbers_of(self._numbers(back, joints))
        plan = Plan(
            scene.motion.equations,
            kinds,
            tuple(places[0]),
            tuple(places[1][len(hard) :]),
            self._held,
            self._sticking,
            tuple(k for k, _ in self._guards),
            len(scene.elements),
            tuple((k, function.form) for k, function in scene.curves.items()),
            scene.sliders,
            slips=tuple((k, stop) for k, stop, _ in self._slips),
            normals=tuple(scene.normal.items()),
            dragged=scene.dragged if rubs else (),
            digits=digits_of(scene.largest),
            impacts=tuple(i for i, (_, w) in enumerate(self._guards) if w and w.event == IMPACT),
        )
        head = [0.0, scene.excitation.frequency]
        of_curves = [function.numbers for function in scene.curves.values()]
        pars = np.concatenate([head, scene.motion.numbers, *of_curves, flat])
        whole = self._with_sliders(to[0], back[0])
        ways = (whole[0], to[1]), (whole[1], back[1])
        return Chart(plan, scene, pars, *ways, joints, tuple(self._events), self._watched)

    def _with_sliders(self, to: Array, back: Array) -> tuple[Array, Array]:
        """Matrices (N + J, N + J) from positions, with those of sliders, to stretches, and back."""
        scene, n = self._scene, self._scene.size
        signs = np.array([scene.elements[k].sign for k in scene.sliders], dtype=float)
        rows = scene.rows[list(scene.sliders)]
        there, here = np.diag(np.concatenate([np.ones(n), -signs])), np.eye(n + len(signs))
        there[:n, :n], there[n:, :n] = to, signs[:, None] * rows
        here[:n, :n], here[n:, :n], here[n:, n:] = back, rows @ back, np.diag(-signs)
        return there, here

    def _numbers(self, back: Sequence[Array], joints: Array) -> list[tuple[Array, Any]]:
        """All numbers of a plan, with masks; those of each element are eight: see `_Builder`."""
        scene, n = self._scene, self._scene.size
        harmonic, constant = scene.excitation.harmonic[:n], scene.excitation.constant[:n]
        own = np.array(
            [
                [
                    element.sign,
                    complex(element.phasor).real,
                    complex(element.phasor).imag,
                    element.offset,
                    element.drift,
                    regime.push,
                    regime.stiffness,
                    regime.damping,
                ]
                for element, regime in zip(scene.elements, self._regimes, strict=True)
            ]
        ).reshape(-1, 8)
        varies = np.zeros(own.shape, dtype=bool)
        varies[list(scene.sliders), 5:7] = True
        follows = [float(self._regimes[k].anchored) for k in scene.sliders]
        groups: list[tuple[Array, Any]] = [
            (np.stack([harmonic.real, harmonic.imag, constant]), False),
            (scene.rows, False),
            (own, varies),
            (np.column_stack([follows, joints]), True),
            *((part, False) for part in back),
        ]
        acting = (*self._held, *self._sticking, *(k for k, *_ in self._slips))
        held = any(k in scene.curves for k in acting)
        if scene.motion.equations.constant_mass and not held:
            zero = np.zeros(n)
            mass, _ = scene.motion.inertia(scene.excitation.frequency, zero, zero, 0.0)
            both = [*self._held, *self._sticking]
            slips = [(both.index(stop), scene.rows[k], t) for k, stop, t in self._slips]
            groups += [(part, False) for part in _through(mass, scene.rows[both], slips)]
        else:
            groups.append((np.array([t for *_, t in self._slips]), True))
        yields = dict(zip(scene.sliders, joints.tolist(), strict=True))
        watches = [_coefficients(watch, yields.get(k)) for k, watch in self._guards]
        slides = np.array([k in scene.sliders for k, _ in self._guards], dtype=bool)
        vary = np.outer(slides, (False, True, False, True, True, False))
        return [*groups, (np.array(watches).reshape(-1, 6), vary)]


def _coefficients(watch: Watch | None, joint: Sequence[float] | None) -> tuple[float, ...]:
    """Coefficients of a guard: gap, rate, force, level, remaining stretch, normal force."""
    if watch is None:
        return _NEVER
    if joint is None or not watch.stretch:
        return watch.gap, watch.rate, watch.force, watch.level, 0.0, watch.normal
    along, reach = watch.stretch * joint[0], joint[1]
    level = 0.0 if along < 0.0 else watch.level + along * reach
    return watch.gap, watch.rate, watch.force, level, -along, 0.0


def _through(mass: Array, rows: Array, slips: Sequence[tuple[int, Array, float]]) -> list[Array]:
    """Response to forces (N,) and prescribed accelerations (h,), for a constant mass matrix.

    Returns the matrices of accelerations by both, (N, N) and (N, h), and of forces along the rows
    by both, (h, N) and (h, h). Slipping friction at contacts is included: see `pushes`.
    """
    inverse: Array = np.asarray(np.linalg.inv(mass), dtype=float)
    if np.count_nonzero(mass) == len(mass):
        inverse = np.diag(1.0 / np.diag(mass))
    if not len(rows):
        return [inverse]
    along, response = rows @ inverse, inverse @ pushes(rows, slips)
    stiff = np.linalg.inv(rows @ response)
    given = response @ stiff
    through = inverse - given @ along
    size = abs(inverse) + abs(given) @ abs(along)
    through[abs(through) < 2.0**-48 * size] = 0.0
    return [through, given, -stiff @ along, stiff]
