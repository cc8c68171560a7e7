"""Modes of structures whose energies are not quadratic, followed by Taylor's method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import numpy as np
from scipy.linalg import block_diag

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property
from dynkit.core.validation import Array
from dynkit.systems.impact.elements.element import Element, Regime, Watch
from dynkit.systems.impact.elements.stops import HardStop
from dynkit.systems.impact.modes.constrained import (
    along_others,
    along_stops,
    check_unique,
    depends,
    pushes,
)
from dynkit.systems.impact.modes.steady_response import Layout
from dynkit.systems.impact.modes.taylor.chart import Chart
from dynkit.systems.impact.modes.taylor.charts import Charts
from dynkit.systems.impact.modes.taylor.scene import Scene
from dynkit.systems.impact.modes.taylor.signs import ROUNDING

FREQUENCY = 1
"""Index of the frequency among the numbers on which a flight depends."""

_NODES = 16
"""Number of nodes of Gauss-Legendre quadrature on each step of Taylor's method."""


@final
class TaylorMode:
    """One set of regimes of a structure whose energies are not quadratic.

    States are (..., 2, N + J + 1). The first row holds N positions, the positions of J sliders, and
    the sine of the phase; the second row holds N velocities, J zeros, and the cosine.

    Attributes
    ----------
    scene : Scene
    regimes : tuple of Regime
    held, sticking : tuples of int
        Numbers of the elements that hold, and that stick.
    guards : tuple of (int, Watch)
        Guards that end the mode: number of the element, and guard. Those that count only at a start
        or just after an event come last, after those of sliders.
    events : int
        Number of guards that end a flight.
    slips : tuple of (int, int, float)
        Slipping friction at contacts: its number, the number of the stop, and the friction force
        divided by the contact force, both along the rows of their elements.
    layout : Layout
    bodies, size : int
        Number of coordinates, N, and with those of sliders, N + J.
    """

    def __init__(
        self,
        scene: Scene,
        regimes: Sequence[Regime],
        grips: tuple[tuple[int, ...], tuple[int, ...]],
        guards: Sequence[tuple[int, Watch]],
        slips: Sequence[tuple[int, int, float]] = (),
    ) -> None:
        self.slips = tuple(slips)
        self.scene, self.regimes, self.guards = scene, tuple(regimes), tuple(guards)
        self.held, self.sticking = grips
        self.events = sum(not watch.at_once for _, watch in guards)
        n = self.bodies = scene.size
        p = self.size = n + len(scene.sliders)
        self.layout = Layout(np.arange(p), p, -1, p + 1, p + 1)
        ending = self.guards[: self.events]
        self._charts = Charts(scene, self.regimes, grips, ending, self.slips, self._watched)
        self._last: tuple[bytes, Any] = b"", None
        self._slides = [self.regimes[k].stretch for k in scene.sliders]

    @property
    def forced(self) -> TaylorMode:
        """The object that converts coordinates to positions and velocities: this mode itself."""
        return self

    # --- states -----------------------------------------------------------------------------------

    def coordinates(self, x: Array, v: Array, *_: Any) -> Array:
        """Positions and velocities (..., 2, N + J)."""
        return np.stack([x, v], axis=-2)

    def positions(self, q: Array, *_: Any) -> Array:
        """Positions (..., N + J) of coordinates (..., 2, N + J)."""
        return np.array(q[..., 0, :])

    def velocities(self, q: Array, *_: Any) -> Array:
        """Velocities (..., N + J) of coordinates (..., 2, N + J)."""
        return np.array(q[..., 1, :])

    def states(self, q: Array, sine: Any, cosine: Any) -> Array:
        """States (..., 2, N + J + 1) of coordinates (..., 2, N + J) and the phase."""
        turn = np.stack([np.asarray(sine), np.asarray(cosine)], axis=-1)
        return np.concatenate([q, turn[..., None]], axis=-1)

    def state(self, x: Array, v: Array, sine: Any, cosine: Any) -> Array:
        """States (..., 2, N + J + 1) of positions (..., N + J), velocities (..., N), and phase."""
        out = np.zeros((*x.shape[:-1], 2, x.shape[-1] + 1))
        out[..., 0, :-1], out[..., 1, : self.bodies] = x, v
        out[..., 0, -1], out[..., 1, -1] = sine, cosine
        return out

    def parts(self, states: Array) -> tuple[Array, Array, Array]:
        """Coordinates (..., 2, N + J), sine and cosine (...) of states."""
        return states[..., :-1], states[..., 0, -1], states[..., 1, -1]

    def motion(self, states: Array) -> tuple[Array, Array]:
        """Positions and velocities (..., N) of states."""
        n = self.bodies
        return np.array(states[..., 0, :n]), np.array(states[..., 1, :n])

    def sliders(self, states: Array) -> Array:
        """Positions (..., J) of sliders."""
        return np.array(states[..., 0, self.bodies : -1])

    def stretch(self, k: int, state: Array) -> float:
        """Stretch of the spring to a slider at a state (2, N + J + 1), times the element's sign."""
        scene, place = self.scene, self.scene.sliders.index(k) + self.bodies
        x = state[0, : self.bodies]
        y = float(scene.curves[k](x) if k in scene.curves else scene.rows[k] @ x)
        return scene.elements[k].sign * (y - float(state[0, place]))

    def seen_from(self, one: TaylorMode, stop: Element | None = None) -> Array:  # noqa: ARG002
        """Affine change of basis from another mode: the identity, since all states are alike."""
        size = 2 * self.layout.slots
        return np.eye(size, size + 1)

    def energies(self, q: Array, sine: Array, cosine: Array, *_: Any) -> Array:
        """Kinetic plus potential energy (n,) of coordinates (n, 2, N)."""
        found = self.powers(self.states(q, sine, cosine))
        return np.asarray(found[:, 0])

    def powers(self, states: Array) -> Array:
        """Energy, dissipated power, and power due to phase-dependent energies, (n, 3)."""
        w, motion = self.scene.excitation.frequency, self.scene.motion
        out = np.empty((len(states), 3))
        for i, (x, v, phase) in enumerate(self._given(states)):
            out[i] = motion.energies(w, x, v, phase)
        return out

    def momenta(self, states: Array, changes: Array) -> Array:
        """Changes of momentum (n, N) by changes of velocity, at states (n, 2, N + J + 1)."""
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
        """Accelerations (N,), forces of the elements (elements,), and all other forces (N,).

        They belong to one state, (2, N + J + 1). Forces of elements are positive towards their
        sides.
        """
        scene = self.scene
        ((x, v, phase),) = self._given(state[None])
        sine, cosine = state[:, -1].tolist()
        mass, force = scene.motion.inertia(scene.excitation.frequency, x, v, phase)
        given = force + scene.forces(sine, cosine)
        found = np.zeros(len(scene.elements))
        for k, regime in enumerate(self.regimes):
            if regime.acts:
                gap, rate = scene.gap(k, x, v, sine, cosine)
                gap = self.stretch(k, state) if k in scene.sliders else gap
                found[k] = regime.push - regime.stiffness * gap - regime.damping * rate
        rows = scene.rows_at(x)
        total = given + (scene.signs * found) @ rows if len(found) else given
        a: Array = np.asarray(np.linalg.solve(mass, total), dtype=float)
        both = [*self.held, *self.sticking]
        if both:
            response = np.linalg.solve(mass, self.pushes(rows))
            rows = rows[both]
            swings = np.array([scene.prescribed(k, sine, cosine)[2] for k in both])
            moved = swings - scene.bends(x, v)[both]
            along = np.linalg.solve(rows @ response, moved - rows @ a)
            a = a + response @ along
            found[both] = scene.signs[both] * along
            for k, stop, traction in self.slips:
                found[k] += scene.signs[k] * scene.signs[stop] * traction * found[stop]
        return a, found, given

    def pushes(self, rows: Array) -> Array:
        """Forces (N, h) by unit forces along holding and sticking elements; all rows are given."""
        both = [*self.held, *self.sticking]
        slips = [(both.index(stop), rows[k], t) for k, stop, t in self.slips]
        return np.asarray(pushes(rows[both], slips))

    @property
    def _rubs(self) -> set[int]:
        """Numbers of friction that sticks, may come to a halt, or acts at a closed stop."""
        leans = {k for k, stop in self.scene.normal.items() if stop in self.held}
        return {*self.sticking, *(k for k, watch in self.guards if watch.halts), *leans}

    def check(self, state: Array) -> None:
        """Check that contact forces are unique at a state (2, N + J + 1).

        Raises
        ------
        ContactParadox
            When they are not unique because of friction.
        CannotFollow
            When friction acts along coordinates that other elements hold, and an element acts along
            a function.
        """
        if not (self.slips or self.scene.curves):
            return
        ((x, _, phase),) = self._given(state[None])
        mass, rows = self.scene.inertia(x, phase)
        for k in self._rubs if self.scene.curves else ():
            others = [j for j in (*self.held, *self.sticking) if j != k]
            if others and depends(mass, rows[[*others, k]]):
                refusal = along_stops if k in self.scene.normal else along_others
                raise refusal(self.scene.elements[k])
        if self.slips:
            push, rows = self.pushes(rows), rows[[*self.held, *self.sticking]]
            inertia: Array = np.asarray(np.linalg.solve(mass, rows.T).T, dtype=float)
            check_unique(inertia, rows, push, self.scene.elements[self.slips[0][0]])

    def gap_at(self, k: int, state: Array) -> tuple[float, float]:
        """Gap of an element and its rate, at a state (2, N + J + 1)."""
        gap, rate = self.scene.gap(k, *self.motion(state), *state[:, -1].tolist())
        return float(gap), float(rate)

    def rate(self, states: Array) -> Array:
        """Rates of change of states (k, 2, N + J + 1), with the velocities of the sliders."""
        out, scene, n = np.zeros_like(states), self.scene, self.bodies
        w = scene.excitation.frequency
        for i, state in enumerate(states):
            v = state[1, :n]
            out[i, 0, :n], out[i, 1, :n] = v, self.balance(state)[0]
            for j, k in enumerate(scene.sliders):
                still = self.regimes[k].anchored
                surface = scene.prescribed(k, *state[:, -1].tolist())[1]
                out[i, 0, n + j] = surface if still else scene.rows_at(state[0, :n])[k] @ v
            out[i, :, -1] = w * state[1, -1], -w * state[0, -1]
        return out

    def watched(self, number: int, state: Array) -> tuple[float, float]:
        """Value of a guard at a state, and the rounding error of this value.

        The rounding error is relative to the sum of the absolute terms of the guard.
        """
        k, watch = self.guards[number]
        scene, value, size = self.scene, watch.level, abs(watch.level)
        if watch.gap or watch.rate or watch.stretch:
            (x, v), (sine, cosine) = self.motion(state), state[:, -1].tolist()
            element, row = scene.elements[k], abs(scene.rows_at(x)[k])
            gap, rate = scene.gap(k, x, v, sine, cosine)
        if watch.gap:
            value += watch.gap * gap
            size += abs(watch.gap) * float(row @ abs(x) + abs(element.offset) + element.amplitude)
        if watch.rate:
            value += watch.rate * rate
            moving = abs(element.drift) + scene.excitation.frequency * element.amplitude
            size += abs(watch.rate) * float(row @ abs(v) + moving)
        if watch.stretch:
            value += watch.stretch * self.stretch(k, state)
            size += abs(watch.stretch) * float(row @ abs(x) + abs(state[0, self.bodies : -1]).max())
        if watch.force:
            _, pushes, given = self._balance(state)
            value += watch.force * float(pushes[k])
            if watch.normal:
                value += watch.normal * float(pushes[scene.normal[k]])
            size += (abs(watch.force) + abs(watch.normal)) * float(
                abs(given).sum() + abs(pushes).sum()
            )
        return float(value), ROUNDING * size

    def _watched(self, numbers: Sequence[int], *motion: Any) -> list[tuple[float, float]]:
        """As `watched`, for several guards, from positions, velocities, sine and cosine."""
        state = self.state(*motion)
        return [self.watched(number, state) for number in numbers]

    def _balance(self, state: Array) -> tuple[Array, Array, Array]:
        """As `balance`, kept until the next state, since several guards need it at one state."""
        found: tuple[Array, Array, Array]
        key = state.tobytes()
        last, found = self._last
        if key != last:
            found = self.balance(state)
            self._last = key, found
        return found

    def rate_row(self, k: int, state: Array) -> Array:
        """Derivative (2 N + J + 1,) of the rate of an element's gap, see `flow` for the order."""
        scene, element, (x, v) = self.scene, self.scene.elements[k], self.motion(state)
        sine, cosine = state[:, -1].tolist()
        turned = element.swing_rate(scene.excitation.frequency, cosine, -sine)
        bend = scene.curves[k].bend(x, v) if k in scene.curves else np.zeros(len(x))
        still = np.zeros(len(scene.sliders))
        parts = bend, scene.rows_at(x)[k], still, [-turned]
        return np.asarray(element.sign * np.concatenate(parts))

    def gradient(self, number: int, state: Array) -> Array:
        """Derivative (2 N + J + 1,) of a guard, see `flow` for the order."""
        k, watch = self.guards[number]
        if watch.force:
            return np.asarray(self.gradients(state, rates=False)[number])
        scene, element, n = self.scene, self.scene.elements[k], self.bodies
        turned = element.swing(state[1, -1], -state[0, -1])
        row = watch.rate * self.rate_row(k, state)
        row[:n] += element.sign * (watch.gap + watch.stretch) * scene.rows_at(state[0, :n])[k]
        row[-1] -= element.sign * watch.gap * turned
        if watch.stretch:
            row[2 * n + scene.sliders.index(k)] -= element.sign * watch.stretch
        return np.asarray(row)

    # --- impulses ---------------------------------------------------------------------------------

    def kick(self, k: int, x: Array, phase: float = 0.0) -> Array:
        """Velocity changes (N,) of an impulse that changes the rate of the gap of a stop by one.

        Held and sticking rows do not change their rates.
        """
        found = self._constant_kicks.get(k)
        if found is None:
            found = self.kick_in(self.scene, k, x, phase)
            if self.constant_kicks:
                self._constant_kicks[k] = found
        return found

    def kick_by_place(
        self, k: int, x: Array, phase: float, pulls: Sequence[tuple[int, float]] = ()
    ) -> Array:
        """Derivatives (N, N + 1) of a kick with respect to positions and phase."""
        here = np.append(x, phase)
        moved = here + 1j * STEP * np.eye(len(here))
        found = [self.kick_in(self.scene, k, each[:-1], each[-1], pulls) for each in moved]
        return np.array(found).imag.T / STEP

    @property
    def constant_kicks(self) -> bool:
        """Whether impulses of stops have the same effect in all states."""
        return self.scene.motion.equations.constant_mass and not self.scene.curves

    @cached_property
    def _constant_kicks(self) -> dict[int, Array]:
        return {}

    def kick_in(
        self, scene: Scene, k: int, x: Array, phase: Any, pulls: Sequence[tuple[int, Any]] = ()
    ) -> Array:
        """The kick in a scene with other numbers; complex arguments give complex-step derivatives.

        `pulls` lists friction at the impact: its number, and its force against its side, divided by
        the contact force.
        """
        response, own = self._pushed(scene, k, x, phase)
        response = scene.elements[k].sign * response
        for j, pull in pulls:
            along = scene.elements[j].sign * self._pushed(scene, j, x, phase)[0]
            response = response - pull * along
        return np.asarray(response / own)

    def _pushed(self, scene: Scene, k: int, x: Array, phase: Any) -> tuple[Array, Any]:
        """Velocity changes (N,) by a unit impulse along an element, and change of its own rate."""
        both, mass, all_rows = [*self.held, *self.sticking], *scene.inertia(x, phase)
        row = all_rows[k]
        response = np.linalg.solve(mass, row)
        if both:
            rows = all_rows[both]
            inner = np.linalg.solve(mass, rows.T)
            response = response - inner @ np.linalg.solve(rows @ inner, rows @ response)
        return response, row @ response

    def response(self, k: int, x: Array, phase: Any) -> Array:
        """Velocity changes (N,) by a unit impulse along an element."""
        return np.asarray(self._pushed(self.scene, k, x, phase)[0])

    def takes(self, k: int, x: Array, phase: Any) -> Any:
        """Largest change of the slip velocity of friction by an impact, per change of gap rate."""
        scene = self.scene
        own, over = (self._pushed(scene, j, x, phase)[1] for j in (k, scene.normal[k]))
        return max(regime.traction for regime in scene.elements[k].regimes) * own / over

    # --- charts -----------------------------------------------------------------------------------

    def chart(self, first: int, state: Array) -> Chart:
        """Chart for the motion from a state after an event of element `first`, see `Charts.of`."""
        sides = [
            slides if slides else self.stretch(k, state)
            for k, slides in zip(self.scene.sliders, self._slides, strict=True)
        ]
        return self._charts.of(first, tuple(-1 if side < 0.0 else 1 for side in sides))

    # --- the motion -------------------------------------------------------------------------------

    def after(self, starts: Array, which: Any, durations: Array) -> Array:
        """States (m, 2, N + J + 1) after durations (m,), each from its start (k, 2, N + J + 1)."""
        out = np.empty((len(durations), *starts.shape[1:]))
        for i in np.unique(which).tolist():
            (here,) = np.nonzero(np.asarray(which) == i)
            out[here] = self.path(starts[i], float(durations[here].max())).states(durations[here])
        return out

    def series(self, k: int, state: Array) -> Array:
        """Taylor coefficients (2, order + 1) of a gap and its rate at a state.

        The element is a hard stop, or acts along a function of the coordinates. If it has a slider,
        the stretch of the spring to the slider replaces the gap.
        """
        chart, turn = self.chart(k, state), state[:, -1].tolist()
        z = chart.coordinates(*state[:, :-1], *turn)
        found, rate = chart.coefficients(z, *turn), len(z) // 2 + chart.speeds[k]
        if k not in chart.springs:
            return np.asarray(found[[chart.places[k], rate]])
        stretch = chart.stretched(k, found[chart.springs[k]])
        return np.stack([stretch, found[rate]])

    def path(self, start: Array, longest: float) -> Path:
        """The motion from a start (2, N + J + 1) over a duration."""
        chart = self.chart(self._near(start), start)
        sine, cosine = start[:, -1].tolist()
        z = self.settled(chart, chart.coordinates(start[0, :-1], start[1, :-1], sine, cosine))
        begins, found = chart.path(z, sine, cosine, longest)
        return Path(self, start, chart, np.append(begins[:-1], longest), found, float(begins[-1]))

    def flow(self, start: Array, duration: float, left: int | None = None) -> tuple[Array, Array]:
        """State (2, N + J + 1) after a duration, and its derivative by the state at the start.

        The derivative is (2 N + J + 1, 2 N + J + 1), in the order positions, velocities, sliders,
        phase. With `left`, the element of the event at the start, gaps are coordinates.
        """
        chart = self._plain if left is None else self.chart(left, start)
        (x, v), (sine, cosine) = start[:, :-1], start[:, -1].tolist()
        n, angle = self.bodies, self.scene.excitation.frequency * duration
        p = len(x)
        z = self.settled(chart, chart.coordinates(x, v, sine, cosine))
        end, flow = chart.transition(z, sine, cosine, duration)
        s, c = np.sin(angle), np.cos(angle)
        turn = sine * c + cosine * s, cosine * c - sine * s
        still = np.concatenate(chart.shifts(0.0, 0.0))
        turned = [np.concatenate(chart.shifts(c, -s)) - still for s, c in ((sine, cosine), turn)]
        to, back = block_diag(chart.to_x, chart.to_v), block_diag(chart.back_x, chart.back_v)
        whole = np.eye(n + p + 1)
        whole[:-1, :-1] = back @ flow[:, :-1] @ to
        by_phase = flow[:, -1] - flow[:, :-1] @ turned[0] + turned[1]
        whole[:-1, -1] = back @ by_phase
        order = np.append(self._order, n + p)
        return self.state(*chart.motion(end, *turn), *turn), whole[np.ix_(order, order)]

    @property
    def _order(self) -> Any:
        """Indices (2 N + J,) that move sliders from between positions and velocities to the end."""
        n, p = self.bodies, self.size
        return np.concatenate([np.arange(n), np.arange(p, p + n), np.arange(n, p)])

    @property
    def numbers(self) -> Array:
        """All numbers on which flights depend, in the order of `changed`."""
        return self._plain._pars

    @property
    def _plain(self) -> Chart:
        return self._charts.plain

    def gradients(self, state: Array, change: Array | None = None, *, rates: bool) -> Array:
        """Derivatives of the accelerations (N,), or of the guards that end a flight.

        They are taken by positions, velocities, sliders and phase, (..., 2 N + J + 1), or by a
        change of the numbers, (...,). Guards of sliders come last, and are not valid here.
        """
        chart, (sine, cosine) = self._plain, state[:, -1].tolist()
        z = chart.coordinates(state[0, :-1], state[1, :-1], sine, cosine)
        found = chart.gradients(z, sine, cosine, change, rates=rates)
        found = np.asarray(found[self.size :] if rates else found)
        if change is not None:
            return found
        p = len(chart.to_x)
        found = np.concatenate([found[:, :p] @ chart.to_x, found[:, p:]], axis=1)
        return np.asarray(found[:, np.append(self._order, found.shape[1] - 1)])

    def changed(self, start: Array, duration: float, change: Array) -> Array:
        """Derivative of positions, velocities, sliders after a duration by a change of numbers."""
        chart, (x, v), (sine, cosine) = self._plain, start[:, :-1], start[:, -1].tolist()
        z = chart.coordinates(x, v, sine, cosine)
        found = chart.changed(z, sine, cosine, duration, change)
        p = len(chart.to_x)
        return np.asarray(np.concatenate([chart.back_x @ found[:p], found[p:]])[self._order])

    def settled(self, chart: Chart, z: Array) -> Array:
        """Set coordinates (M,) that are exactly zero in this mode, in place.

        They are gaps and their rates where elements hold, slip velocities where elements stick, and
        the remaining stretch of springs whose sliders slide.
        """
        half = len(z) // 2
        for k in self.held:
            if k in chart.places:
                z[chart.places[k]] = z[half + chart.speeds[k]] = 0.0
        for k in self.sticking:
            if k in chart.speeds:
                z[half + chart.speeds[k]] = 0.0
        for k, slides in zip(self.scene.sliders, self._slides, strict=True):
            if slides:
                z[chart.springs[k]] = 0.0
        return z

    def _near(self, state: Array) -> int:
        """Number of the stop with the smallest gap at a state, for the choice of coordinates."""
        stops = [k for k, e in enumerate(self.scene.elements) if isinstance(e, HardStop)]
        if len(stops) < 2:
            return 0
        return min(stops, key=lambda k: abs(self.gap_at(k, state)[0]))

    def quadrature(self, start: Array, duration: float) -> tuple[Array, Array]:
        """Weights (m,) of Gauss-Legendre quadrature over a duration, and states there."""
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
    start : (2, N + J + 1)
    chart : Chart
    ends : (k + 1,)
        Durations at which steps begin and end.
    coefficients : (k, 2 N + J, order + 1)
    reach : float
        Duration up to which the last polynomial is valid.
    """

    mode: TaylorMode
    start: Array
    chart: Chart
    ends: Array
    coefficients: Array
    reach: float

    def states(self, durations: Array) -> Array:
        """States (m, 2, N + J + 1) at durations (m,)."""
        sine, cosine = self.start[:, -1].tolist()
        angle = self.mode.scene.excitation.frequency * durations
        s, c = np.sin(angle), np.cos(angle)
        sines, cosines = sine * c + cosine * s, cosine * c - sine * s
        step = np.searchsorted(self.ends[1:-1], durations, side="right")
        z = np.empty((len(durations), self.coefficients.shape[1]))
        for k in np.unique(step).tolist():
            here = step == k
            z[here] = horner(self.coefficients[k], durations[here] - self.ends[k])
        out = self.mode.state(*self.chart.motion(z, sines, cosines), sines, cosines)
        out[durations == 0.0] = self.start
        return out


def horner(coefficients: Array, times: Array) -> Array:
    """Values (m, d) of polynomials (d, order + 1) at times (m,)."""
    out = np.zeros((len(times), len(coefficients)))
    for column in coefficients.T[::-1]:
        out = out * times[:, None] + column
    return out
