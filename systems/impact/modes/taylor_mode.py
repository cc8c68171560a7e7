"""Modes of structures whose energies are not quadratic, followed by Taylor's method."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, final

import numpy as np

from dynkit.core.differences import STEP
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Regime, Watch
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.steady_response import Layout
from dynkit.systems.impact.modes.structure import pivots_of
from dynkit.systems.impact.modes.taylor_chart import Chart
from dynkit.systems.impact.modes.taylor_equations import Plan, numbers_of
from dynkit.systems.impact.modes.taylor_scene import Scene

FREQUENCY = 1
"""Place of the frequency among the numbers of a flight."""

_INDEPENDENT = 1e-9
"""Relative size from which on a row depends on no others."""

_NODES = 16
"""Nodes of Gauss-Legendre quadrature on each step of Taylor's method."""


@final
class TaylorMode:
    """One set of regimes of a structure whose energies are not quadratic.

    States (..., 2, N + 1) hold positions and velocities and, last, sine and cosine of the phase.

    Attributes
    ----------
    scene : Scene
    regimes : tuple of Regime
    held, sticking : tuples of int
        Numbers of the elements that hold, and that stick.
    guards : tuple of (int, Watch)
        Guards that end the mode: element, and what is watched. Those that act at once come last.
    events : int
        Number of guards that end a flight.
    layout : Layout
    bodies : int
    """

    def __init__(
        self,
        scene: Scene,
        regimes: Sequence[Regime],
        grips: tuple[tuple[int, ...], tuple[int, ...]],
        guards: Sequence[tuple[int, Watch]],
    ) -> None:
        self.scene, self.regimes, self.guards = scene, tuple(regimes), tuple(guards)
        self.held, self.sticking = grips
        self.events = sum(not watch.at_once for _, watch in guards)
        n = self.bodies = scene.size
        self.layout = Layout(np.arange(n), n, -1, n + 1, n + 1)
        self._charts: dict[tuple[int, ...], Chart] = {}

    @property
    def forced(self) -> TaylorMode:
        """What gives positions and velocities: itself."""
        return self

    # --- states -----------------------------------------------------------------------------------

    def coordinates(self, x: Array, v: Array, *_: Any) -> Array:
        """Positions and velocities (..., 2, N)."""
        return np.stack([x, v], axis=-2)

    def positions(self, q: Array, *_: Any) -> Array:
        """Positions (..., N) of coordinates (..., 2, N)."""
        return np.array(q[..., 0, :])

    def velocities(self, q: Array, *_: Any) -> Array:
        """Velocities (..., N) of coordinates (..., 2, N)."""
        return np.array(q[..., 1, :])

    def states(self, q: Array, sine: Any, cosine: Any) -> Array:
        """States (..., 2, N + 1) of coordinates (..., 2, N) and the phase."""
        turn = np.stack([np.asarray(sine), np.asarray(cosine)], axis=-1)
        return np.concatenate([q, turn[..., None]], axis=-1)

    def parts(self, states: Array) -> tuple[Array, Array, Array]:
        """Coordinates (..., 2, N), sine and cosine (...) of states."""
        return states[..., :-1], states[..., 0, -1], states[..., 1, -1]

    def motion(self, states: Array) -> tuple[Array, Array]:
        """Positions and velocities (..., N) of states."""
        return np.array(states[..., 0, :-1]), np.array(states[..., 1, :-1])

    def sliders(self, states: Array) -> Array:
        """Places of sliders, of which there are none: (..., 0)."""
        return np.empty((*states.shape[:-2], 0))

    def seen_from(self, one: TaylorMode, stop: Element | None = None) -> Array:  # noqa: ARG002
        """Change of the state from another mode: none, (2 N + 2, 2 N + 3)."""
        size = 2 * self.layout.slots
        return np.eye(size, size + 1)

    def energies(self, q: Array, sine: Array, cosine: Array, *_: Any) -> Array:
        """Kinetic plus potential energy (n,) of coordinates (n, 2, N)."""
        found = self.powers(self.states(q, sine, cosine))
        return np.asarray(found[:, 0])

    def powers(self, states: Array) -> Array:
        """Energy, power lost, and power gained as energies depend on the phase, (n, 3)."""
        w, motion = self.scene.excitation.frequency, self.scene.motion
        out = np.empty((len(states), 3))
        for i, (x, v, phase) in enumerate(self._given(states)):
            out[i] = motion.energies(w, x, v, phase)
        return out

    def momenta(self, states: Array, changes: Array) -> Array:
        """Changes of momentum (n, N) by changes of velocity, at states (n, 2, N + 1)."""
        w, motion = self.scene.excitation.frequency, self.scene.motion
        pairs = zip(self._given(states), changes, strict=True)
        found = [motion.inertia(w, *given)[0] @ change for given, change in pairs]
        return np.array(found).reshape(changes.shape)

    def _given(self, states: Array) -> Any:
        x, v = self.motion(states)
        phases = np.arctan2(states[:, 0, -1], states[:, 1, -1]).tolist()
        return zip(x, v, phases, strict=True)

    # --- forces and accelerations -----------------------------------------------------------------

    def balance(self, state: Array) -> tuple[Array, Array, Array]:
        """Accelerations (N,), forces (elements,) towards their sides, and forces without them (N,).

        Of one state, (2, N + 1).
        """
        scene = self.scene
        ((x, v, phase),) = self._given(state[None])
        sine, cosine = state[:, -1].tolist()
        mass, force = scene.motion.inertia(scene.excitation.frequency, x, v, phase)
        given = force + scene.forces(sine, cosine)
        pushes = np.zeros(len(scene.elements))
        for k, regime in enumerate(self.regimes):
            if regime.acts:
                gap, rate = self.gap(k, x, v, sine, cosine)
                pushes[k] = regime.push - regime.stiffness * gap - regime.damping * rate
        signs = np.array([element.sign for element in scene.elements])
        total = given + (signs * pushes) @ scene.rows if len(pushes) else given
        a: Array = np.asarray(np.linalg.solve(mass, total), dtype=float)
        both = [*self.held, *self.sticking]
        if both:
            rows = scene.rows_at(x)[both]
            response = np.linalg.solve(mass, rows.T)
            swings = np.array([scene.prescribed(k, sine, cosine)[2] for k in both])
            moved = swings - scene.bends(x, v)[both]
            along = np.linalg.solve(rows @ response, moved - rows @ a)
            a = a + response @ along
            pushes[both] = signs[both] * along
        return a, pushes, given

    def gap(self, k: int, x: Array, v: Array, sine: Any, cosine: Any) -> tuple[Any, Any]:
        """Gap of an element and its rate, at positions and velocities (..., N)."""
        scene = self.scene
        place, speed, _ = scene.prescribed(k, sine, cosine)
        sign = scene.elements[k].sign
        if k in scene.curves:
            along = scene.curves[k](x), (v * scene.curves[k].gradient(x)).sum(axis=-1)
            return sign * (along[0] - place), sign * (along[1] - speed)
        return sign * (x @ scene.rows[k] - place), sign * (v @ scene.rows[k] - speed)

    def rate(self, states: Array) -> Array:
        """Rates of change of states (k, 2, N + 1)."""
        out, w = np.empty_like(states), self.scene.excitation.frequency
        for i, state in enumerate(states):
            out[i, 0, :-1], out[i, 1, :-1] = state[1, :-1], self.balance(state)[0]
            out[i, :, -1] = w * state[1, -1], -w * state[0, -1]
        return out

    def watched(self, number: int, state: Array) -> tuple[float, float]:
        """Value of a guard at a state (2, N + 1), and what rounding leaves of it where it is zero.

        Rounding is relative to the terms of which it is the sum.
        """
        k, watch = self.guards[number]
        scene, (x, v), (sine, cosine) = self.scene, self.motion(state), state[:, -1].tolist()
        gap, rate = self.gap(k, x, v, sine, cosine)
        element, w = scene.elements[k], scene.excitation.frequency
        row = abs(scene.rows_at(x)[k])
        value = watch.level + watch.gap * gap + watch.rate * rate
        size = abs(watch.level)
        size += abs(watch.gap) * float(row @ abs(x) + abs(element.offset) + element.amplitude)
        size += abs(watch.rate) * float(row @ abs(v) + abs(element.drift) + w * element.amplitude)
        if watch.force:
            _, pushes, given = self.balance(state)
            value += watch.force * float(pushes[k])
            size += abs(watch.force) * float(abs(given).sum() + abs(pushes).sum())
        return float(value), ROUNDING * size

    # --- impulses ---------------------------------------------------------------------------------

    def kick(self, k: int, x: Array, phase: float = 0.0) -> Array:
        """Velocity changes (N,) of an impulse that changes the rate of the gap of a stop by one.

        What is held or sticks does not move.
        """
        found = self._constant_kicks.get(k)
        if found is None:
            found = self.kick_in(self.scene, k, x, phase)
            if self.constant_kicks:
                self._constant_kicks[k] = found
        return found

    def kick_by_place(self, k: int, x: Array, phase: float) -> Array:
        """Derivatives (N, N + 1) of a kick by positions and phase."""
        here = np.append(x, phase)
        moved = here + 1j * STEP * np.eye(len(here))
        found = [self.kick_in(self.scene, k, each[:-1], each[-1]) for each in moved]
        return np.array(found).imag.T / STEP

    @property
    def constant_kicks(self) -> bool:
        """Whether impulses of stops have the same effect in all states."""
        return self.scene.motion.equations.constant_mass and not self.scene.curves

    @cached_property
    def _constant_kicks(self) -> dict[int, Array]:
        return {}

    def kick_in(self, scene: Scene, k: int, x: Array, phase: Any) -> Array:
        """The kick in a scene that differs in its numbers, also with imaginary changes."""
        both, mass, all_rows = [*self.held, *self.sticking], *scene.inertia(x, phase)
        row = all_rows[k]
        response = np.linalg.solve(mass, row)
        if both:
            rows = all_rows[both]
            inner = np.linalg.solve(mass, rows.T)
            response = response - inner @ np.linalg.solve(rows @ inner, rows @ response)
        return np.asarray(scene.elements[k].sign * response / (row @ response))

    def pushed(self, row: Array) -> Array:
        """Velocity changes (N,) of an impulse that changes the rate of a row (N,) by one."""
        w, motion, zero = self.scene.excitation.frequency, self.scene.motion, np.zeros(self.bodies)
        response = np.linalg.solve(motion.inertia(w, zero, zero, 0.0)[0], row)
        return np.asarray(response / float(row @ response))

    # --- charts -----------------------------------------------------------------------------------

    def chart(self, first: int = -1) -> Chart:
        """Coordinates among them the gap of one element, and those of others as far as they may."""
        elements, hard = self.scene.elements, list[int]()
        stops = [k for k, e in enumerate(elements) if isinstance(e, HardStop) and not e.curved]
        held = [k for k in self.held if not elements[k].curved]
        for k in dict.fromkeys([*held, *([first] if first in stops else []), *stops]):
            if self._apart([*hard, k]):
                hard.append(k)
        key = tuple(sorted(hard))
        if key not in self._charts:
            self._charts[key] = self._chart(key)
        return self._charts[key]

    def _apart(self, numbers: Sequence[int]) -> bool:
        return independent(self.scene.rows[list(numbers)])

    def _chart(self, hard: tuple[int, ...], *, rubs: bool = True) -> Chart:
        scene, n = self.scene, self.bodies
        slips: list[int] = []
        for k, element in enumerate(scene.elements if rubs else ()):
            rubs_there = any(regime.sticks for regime in element.regimes)
            if rubs_there and self._apart([*hard, *slips, k]):
                slips.append(k)
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
        own, groups = self._numbers(back)
        flat, kinds = numbers_of(groups)
        plan = Plan(
            scene.motion.equations,
            kinds,
            tuple(places[0]),
            tuple(places[1][len(hard) :]),
            self.held,
            self.sticking,
            tuple(k for k, _ in self.guards[: self.events]),
            len(scene.elements),
            tuple((k, function.form) for k, function in scene.curves.items()),
        )
        head = [0.0, scene.excitation.frequency]
        of_curves = [function.numbers for function in scene.curves.values()]
        pars = np.concatenate([head, scene.motion.numbers, *of_curves, flat])
        return Chart(plan, pars, own, (to[0], to[1]), (back[0], back[1]), scene.curves)

    def _numbers(self, back: Sequence[Array]) -> tuple[Array, list[Array]]:
        """Numbers (elements, 8) of the elements, and all numbers of a plan."""
        scene, n = self.scene, self.bodies
        harmonic, constant = scene.excitation.harmonic, scene.excitation.constant
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
                for element, regime in zip(scene.elements, self.regimes, strict=True)
            ]
        ).reshape(-1, 8)
        watches = [[w.gap, w.rate, w.force, w.level] for _, w in self.guards[: self.events]]
        groups = [
            np.stack([harmonic.real, harmonic.imag, constant]),
            scene.rows,
            own,
            *back,
        ]
        held = any(k in scene.curves for k in self.held)
        if scene.motion.equations.constant_mass and not held:
            zero = np.zeros(n)
            mass, _ = scene.motion.inertia(scene.excitation.frequency, zero, zero, 0.0)
            groups += _through(mass, scene.rows[[*self.held, *self.sticking]])
        return own, [*groups, np.array(watches).reshape(-1, 4)]

    # --- the motion -------------------------------------------------------------------------------

    def after(self, starts: Array, which: Any, durations: Array) -> Array:
        """States (m, 2, N + 1) at durations (m,) from some of the starts (k, 2, N + 1)."""
        out = np.empty((len(durations), *starts.shape[1:]))
        for i in np.unique(which).tolist():
            (here,) = np.nonzero(np.asarray(which) == i)
            out[here] = self.path(starts[i], float(durations[here].max())).states(durations[here])
        return out

    def gap_series(self, k: int, state: Array) -> Array:
        """Taylor coefficients (order + 1,) of the gap of a hard stop at a state (2, N + 1)."""
        chart, turn = self.chart(k), state[:, -1].tolist()
        z = chart.coordinates(*state[:, :-1], *turn)
        return np.asarray(chart.coefficients(z, *turn)[chart.places[k]])

    def path(self, start: Array, longest: float) -> Path:
        """The motion from a start (2, N + 1) over a duration."""
        chart = self.chart(self._near(start))
        sine, cosine = start[:, -1].tolist()
        z = self.settled(chart, chart.coordinates(start[0, :-1], start[1, :-1], sine, cosine))
        begins, found = chart.path(z, sine, cosine, longest)
        return Path(self, start, chart, np.append(begins[:-1], longest), found, float(begins[-1]))

    def flow(self, start: Array, duration: float, left: int | None = None) -> tuple[Array, Array]:
        """State (2, N + 1) after a duration, and its derivative (2 N + 1, 2 N + 1).

        Of positions, velocities and phase, by those at the start. Where an element is given that
        was left, gaps are coordinates.
        """
        chart = self._plain if left is None else self.chart(left)
        (x, v), (sine, cosine) = self.motion(start), start[:, -1].tolist()
        n, angle = self.bodies, self.scene.excitation.frequency * duration
        z = self.settled(chart, chart.coordinates(x, v, sine, cosine))
        end, flow = chart.transition(z, sine, cosine, duration)
        s, c = np.sin(angle), np.cos(angle)
        turn = sine * c + cosine * s, cosine * c - sine * s
        still = np.concatenate(chart.shifts(0.0, 0.0))
        turned = [np.concatenate(chart.shifts(c, -s)) - still for s, c in ((sine, cosine), turn)]
        to, back = np.zeros((2, 2 * n, 2 * n))
        for out, parts in ((to, (chart.to_x, chart.to_v)), (back, (chart.back_x, chart.back_v))):
            out[:n, :n], out[n:, n:] = parts
        whole = np.eye(2 * n + 1)
        whole[: 2 * n, : 2 * n] = back @ flow[:, :-1] @ to
        by_phase = flow[:, -1] - flow[:, :-1] @ turned[0] + turned[1]
        whole[: 2 * n, -1] = back @ by_phase
        return self.states(np.stack(chart.motion(end, *turn)), *turn), whole

    @property
    def numbers(self) -> Array:
        """All numbers on which flights depend, in the order of `changed`."""
        return self._plain._pars

    @property
    def _plain(self) -> Chart:
        """Positions and velocities themselves as coordinates."""
        if (-1,) not in self._charts:
            self._charts[-1,] = self._chart((), rubs=False)
        return self._charts[-1,]

    def gradients(self, state: Array, change: Array | None = None, *, rates: bool) -> Array:
        """Derivatives of accelerations (N,), or of what guards that end a flight watch, (events,).

        By positions, velocities and phase, (..., 2 N + 1), or by a change of the numbers, (...,).
        """
        (x, v), (sine, cosine) = self.motion(state), state[:, -1].tolist()
        z = np.concatenate([x, v])
        found = self._plain.gradients(z, sine, cosine, change, rates=rates)
        return np.asarray(found[self.bodies :] if rates else found)

    def changed(self, start: Array, duration: float, change: Array) -> Array:
        """Change of positions and velocities (2 N,) after a duration by one of the numbers."""
        (x, v), (sine, cosine) = self.motion(start), start[:, -1].tolist()
        z = np.concatenate([x, v])
        return np.asarray(self._plain.changed(z, sine, cosine, duration, change))

    def settled(self, chart: Chart, z: Array) -> Array:
        """Set gaps and slips of what holds and sticks to zero in coordinates (2 N,), in place."""
        half = len(z) // 2
        for k in self.held:
            if k in chart.places:
                z[chart.places[k]] = z[half + chart.speeds[k]] = 0.0
        for k in self.sticking:
            if k in chart.speeds:
                z[half + chart.speeds[k]] = 0.0
        return z

    def _near(self, state: Array) -> int:
        """The stop that is nearest at a state, for the choice of coordinates."""
        (x, v), (sine, cosine) = self.motion(state), state[:, -1].tolist()
        stops = [k for k, e in enumerate(self.scene.elements) if isinstance(e, HardStop)]
        if len(stops) < 2:
            return 0
        gaps = [abs(self.gap(k, x, v, sine, cosine)[0]) for k in stops]
        return stops[int(np.argmin(gaps))]

    def quadrature(self, start: Array, duration: float) -> tuple[Array, Array]:
        """Weights (m,) of Gauss-Legendre quadrature over a duration, and states (m, 2, N + 1)."""
        path = self.path(start, duration)
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * np.diff(path.ends)[:, None]
        times = path.ends[:-1, None] + half * (nodes + 1.0)
        return (half * weights).ravel(), path.states(times.ravel())


@final
class Path(NamedTuple):
    """A motion in one mode, as the polynomials of the steps of Taylor's method.

    Attributes
    ----------
    mode : TaylorMode
    start : (2, N + 1)
    chart : Chart
    ends : (k + 1,)
        Durations at which steps begin and end.
    coefficients : (k, 2 N, order + 1)
    reach : float
        Duration up to which the last polynomial holds.
    """

    mode: TaylorMode
    start: Array
    chart: Chart
    ends: Array
    coefficients: Array
    reach: float

    def states(self, durations: Array) -> Array:
        """States (m, 2, N + 1) at durations (m,)."""
        sine, cosine = self.start[:, -1].tolist()
        angle = self.mode.scene.excitation.frequency * durations
        s, c = np.sin(angle), np.cos(angle)
        sines, cosines = sine * c + cosine * s, cosine * c - sine * s
        step = np.searchsorted(self.ends[1:-1], durations, side="right")
        z = np.empty((len(durations), self.coefficients.shape[1]))
        for k in np.unique(step).tolist():
            here = step == k
            z[here] = horner(self.coefficients[k], durations[here] - self.ends[k])
        x, v = self.chart.motion(z, sines, cosines)
        out = self.mode.states(np.stack([x, v], axis=1), sines, cosines)
        out[durations == 0.0] = self.start
        return out


ROUNDING = 2.0**-44
"""Relative rounding of what is a sum of terms."""


def horner(coefficients: Array, times: Array) -> Array:
    """Values (m, d) of polynomials (d, order + 1) at times (m,)."""
    out = np.zeros((len(times), len(coefficients)))
    for column in coefficients.T[::-1]:
        out = out * times[:, None] + column
    return out


def independent(rows: Array) -> bool:
    """Whether rows (k, N) are linearly independent."""
    if len(rows) > rows.shape[1]:
        return False
    lengths = np.linalg.norm(rows, axis=1)
    return bool(np.linalg.svd(rows / lengths[:, None], compute_uv=False)[-1] > _INDEPENDENT)


def _through(mass: Array, rows: Array) -> list[Array]:
    """How forces (N,) and prescribed accelerations (h,) act, where the mass matrix is constant.

    Accelerations by both, (N, N) and (N, h), and forces along the rows by both.
    """
    inverse: Array = np.asarray(np.linalg.inv(mass), dtype=float)
    if np.count_nonzero(mass) == len(mass):
        inverse = np.diag(1.0 / np.diag(mass))
    if not len(rows):
        return [inverse]
    response = inverse @ rows.T
    stiff = np.linalg.inv(rows @ response)
    given = response @ stiff
    through = inverse - given @ response.T
    size = abs(inverse) + abs(given) @ abs(response.T)
    through[abs(through) < 2.0**-48 * size] = 0.0
    return [through, given, -given.T, stiff]
