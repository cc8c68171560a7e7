"""Motions of one mode between impacts, as sums of the periodic responses to all impulses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, final
from weakref import WeakKeyDictionary

import numpy as np
from scipy.linalg import expm

from dynkit.core.differences import STEP
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.validation import Array
from dynkit.systems.impact.modes.free_motion import FreeMotion, free_motion
from dynkit.systems.impact.modes.mode import Transitions
from dynkit.systems.impact.modes.structure import Contact
from dynkit.systems.impact.orbits.flights import Curve
from dynkit.systems.impact.orbits.itineraries.itinerary import Course
from dynkit.systems.impact.orbits.itineraries.motion import (
    LATE,
    ROUNDING,
    SAME,
    ItinerarySolution,
    Lap,
)
from dynkit.systems.impact.orbits.itineraries.one_mode.terms import Terms
from dynkit.systems.impact.orbits.machine import Machine, Numbers
from dynkit.systems.impact.simulation.state import TWO_PI

if TYPE_CHECKING:
    from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import Assembled


@final
class Windows:
    """The gaps of all stops in their common free motion, and the effects of impulses.

    Attributes
    ----------
    motion : FreeMotion
    rows : (e, 4, 2 slots)
        Their products with a state are the gap of a stop and its first three derivatives.
    kicks : (e, 2, slots)
        Change of the state by an impulse that changes the rate of the gap by one.
    pushes : (e, 2, slots, 2)
        Kicks, and their rates of change.
    turns : (e,)
        Change of the second derivative of the gap by such an impulse.
    vectors : (e, 4, 2N)
        Kick, its rate of change, and rows of the gap and of its rate, of the modes.
    bounds : (e, 4, 2, slots)
        Weights of abs(state) that bound the gap and its derivatives of order 1, 2 and 6, at all
        later times.
    """

    def __init__(self, contacts: tuple[Contact, ...], signs: tuple[int, ...]) -> None:
        self.motion: FreeMotion = free_motion(contacts[0])
        mode = self.motion.mode
        own = [sign * mode.row(c.row) for c, sign in zip(contacts, signs, strict=True)]
        rows = [[mode.pairs.derivative_rows(row, k).ravel() for k in range(4)] for row in own]
        self.rows = np.array(rows)
        pairs = zip(contacts, signs, strict=True)
        self.kicks = np.array([sign * mode.placed(c.kick[:2]) for c, sign in pairs])
        self.bounds = np.array(
            [[mode.pairs.bound(row, order) for order in (0, 1, 2, 6)] for row in own]
        )
        pushed, count = mode.rate(self.kicks), len(contacts)
        self.turns = (self.rows[:, 2] * self.kicks.reshape(count, -1)).sum(axis=1)
        self.pushes = np.stack([self.kicks, pushed], axis=-1)
        seen = self.rows[:, :2].reshape(count, 2, 2, -1)
        all_four = np.concatenate([self.kicks[:, None], pushed[:, None], seen], axis=1)
        self.vectors = all_four[..., mode.layout.modes].reshape(count, 4, -1)
        self._returns: list[tuple[float, tuple[Transitions, Array, Array]]] = []

    def repeated(self, period: float) -> tuple[Transitions, Array, Array]:
        """Transitions over a period, states (e, 2, slots) just after impulses, and a derivative.

        There is one unit impulse per period. The derivative is that of the states by the period.
        Results for the last two periods are kept.

        Raises
        ------
        NoSolution
            When a free motion has this period (resonance without damping).
        """
        for known, found in self._returns:
            if known == period:
                return found
        found = self.motion.mode.repeated(period, self.kicks)
        self._returns = [(period, found), *self._returns[:1]]
        return found


_windows: WeakKeyDictionary[Contact, dict[Any, Windows]] = WeakKeyDictionary()


def windows_of(oscillator: Any) -> Windows:
    """Return the gaps of all stops of an oscillator; they are kept with its structure."""
    contacts = oscillator._contacts
    signs = tuple(stop.sign for stop in oscillator._stops)
    known = _windows.setdefault(contacts[0], {})
    key = (tuple(c.row.tobytes() for c in contacts), signs)
    if key not in known:
        known[key] = Windows(contacts, signs)
    return known[key]


class Scene(NamedTuple):
    """Gaps in free motion and the steady response, at some parameters.

    `oscillator` has the same structure, but may have other numbers of its table. `system` is a
    function that returns the oscillator at these parameters.
    """

    oscillator: Any
    windows: Windows
    terms: Terms
    measures: Array
    system: Callable[[], Any]


@final
class ResponseSolution(ItinerarySolution):
    """Impacts of one mode: all states follow from phases and impulses, as periodic responses.

    The impacts need not be in order: the next impact is the one with the next phase.

    Parameters
    ----------
    scene : Scene
    course : Course
    lap : Lap
    """

    blind = False

    def __init__(self, scene: Scene, course: Course, lap: Lap) -> None:
        self.windows, self.terms, self.system = scene.windows, scene.terms, scene.system
        self.mode = scene.windows.motion.mode
        super().__init__(scene.oscillator, scene.measures, course, lap, scene.terms.frequency)
        self.turn = TWO_PI * round(float(lap.phases[-1] - lap.phases[0]) / TWO_PI)
        self.transition, self.kicked, self._moved = self.windows.repeated(self.period)

    @property
    def period(self) -> float:
        return float(self.turn / self.clock)

    @cached_property
    def restitutions(self) -> Array:
        """Coefficients of restitution (n,) of the impacts."""
        return np.asarray(self.terms.restitutions[self.sides])

    @cached_property
    def turning(self) -> Any:
        """exp(i phase), (n,), at the impacts."""
        return np.exp(1j * self.event_phases)

    # --- responses --------------------------------------------------------------------------------

    @cached_property
    def assembled(self) -> Assembled:
        """Responses to all impulses, residual and Jacobian of the equations."""
        return self._assembled(self.kicked)

    def _assembled(self, kicked: Array) -> Assembled:
        """See `assembled`, with states (e, 2, slots) just after impulses."""
        from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import (
            Assembled,
            assemble,
        )

        mode, out = self.mode, Assembled.of(len(self.sides), kicked.shape[1:])
        own = self.windows.rows, kicked, self._moved, self.sides, self.terms.numbers
        at = self.event_phases, self.impulses, self.clock, self.turn
        assemble(mode.propagators.ladder, mode.work, *own, *at, out)
        return out

    def _disturbed(self, multiplier: complex) -> Any:
        """Responses (3, n, n) if impulses are multiplied from one period to the next."""
        states = self.transition.periodic(self.windows.kicks, multiplier)
        units = (1.0, 1j) if np.iscomplexobj(states) else (1.0,)
        parts = [np.ascontiguousarray((states / unit).real) for unit in units]
        seen = [self._assembled(part).responses[:3] for part in parts]
        out: Any = sum(unit * part for unit, part in zip(units, seen, strict=True))
        return out * multiplier**self.assembled.turns

    @property
    def gaps(self) -> Array:
        """Gaps (3, n) at the impacts, and two derivatives in time just after them."""
        return self.assembled.gaps

    # --- equations --------------------------------------------------------------------------------

    @property
    def left(self) -> Array:
        """Residual (m,) of the equations."""
        return self.assembled.left

    def jacobian(self, multiplier: complex) -> Any:
        """Jacobian D(multiplier), (m, m), of the equations."""
        if multiplier == 1.0:
            return self.assembled.jacobian
        n, back = len(self.sides), self._disturbed(multiplier) - self.assembled.responses[:3]
        out = self.assembled.jacobian.astype(np.result_type(back, multiplier))
        # The multiplier applies to impulses of other periods only.
        rows = out.reshape(2, n, 2 * n)
        rows[..., :n] -= self.impulses * back[1:] / self.clock
        rows[..., n:] += back[:2]
        return out

    @property
    def rounding(self) -> Array:
        """Rounding errors (m,) of the residual."""
        return np.concatenate([self._rounding(0), self._rounding(1)])

    def _rounding(self, order: int) -> Array:
        """Rounding errors (n,) of `gaps`, of one order of derivative."""
        steady = self.clock**order * abs(self.terms.drives[self.sides])
        if order == 0:
            steady = steady + abs(self.assembled.steady[0]).max()
        rows = abs(self.windows.rows[self.sides, order])
        free = (self.state_rounding * rows).sum(axis=1)
        return np.asarray(free + ROUNDING * self.turned * steady)

    @cached_property
    def state_rounding(self) -> Array:
        """Rounding errors (n, 2 slots) of the free states.

        Rounding errors of their components grow in the periodic response. Those of times add to
        them: of the period T, by (1 - E)^-1 E times the rate of each part of the state, where E is
        the transition matrix over T; and of the times since the other impacts.
        """
        n, slots = len(self.sides), self.kicked.shape[-1]
        grown = self.transition.amplification(slots)
        rates = abs(self.mode.rate(self.assembled.spread))
        rates *= abs(self.impulses)[:, None, None]
        others = rates * (1.0 - np.eye(n))[..., None, None]
        late = LATE * self.period * (grown * rates + others).sum(axis=1)
        own = ROUNDING * self.turned * abs(self.states * np.maximum(1.0, grown))
        return np.asarray((own + late).reshape(n, -1))

    @property
    def turned(self) -> float:
        """Factor by which rounding errors of phases exceed the relative rounding error."""
        return float(1.0 + abs(self.event_phases).max())

    def change(self, change: tuple[Array, Numbers]) -> Array | None:
        """Derivative (m,) of the residual by a change of all numbers; None if not available."""
        oscillator, r = self.oscillator, self.restitutions
        whole, by = change
        if by.clock_alone and not self.terms.shape.any():
            return np.asarray(by.frequency * self.assembled.by_frequency)
        if by.matrices.any():
            if oscillator.degrees_of_freedom > self.LARGEST:
                return None
            return _change(self, whole)
        terms = self.terms.change(oscillator, by)
        gaps, rates = terms._replace(frequency=self.clock).gaps(self.sides, self.turning, 2)
        rates = rates - terms.restitutions[self.sides] / (1.0 + r) ** 2 * self.impulses
        by_clock = by.frequency * self.assembled.by_frequency
        return np.asarray(np.concatenate([gaps, rates]) + by_clock)

    # --- states -----------------------------------------------------------------------------------

    @cached_property
    def states(self) -> Array:
        """Free states (n, 2, slots) just after each impact."""
        n = len(self.sides)
        flat = self.assembled.spread.reshape(n, n, -1)
        return np.asarray(np.einsum("j,ijs->is", self.impulses, flat).reshape(n, 2, -1))

    @property
    def lasts(self) -> Array:
        """Times (n,) from each impact to the next one in time."""
        return self.assembled.lasts

    def ends(self, i: int) -> tuple[int, int]:
        return i, int(self.assembled.following[i])

    @property
    def whole(self) -> Array:
        return self._states(self.states, self.turning)

    @property
    def before(self) -> Array:
        """Positions and velocities (n, 2N), or more, just before the events."""
        pushed = self.windows.kicks[self.sides] * self.impulses[:, None, None]
        return self._states(self.states - pushed, self.turning)

    def passed(self, since: Array) -> Array:
        times = (self.event_phases - self.event_phases[0]) / self.clock
        order = np.argsort(times, kind="stable")
        which = order[np.searchsorted(times[order], since, side="right") - 1]
        states = self.mode.after(self.states, which, since - times[which])
        return self._states(states, np.exp(1j * (self.event_phases[0] + self.clock * since)))

    def _states(self, states: Array, turn: Any) -> Array:
        """Positions and velocities (k, 2N) of free states (k, 2, slots) at exp(i phase), (k,)."""
        t, mode, turn = self.terms, self.mode, turn[:, None]
        q, free = states[..., mode.layout.modes], mode.structure.free  # type: ignore[union-attr]
        position = free.positions(q) + (t.shape * turn).imag + t.still
        velocity = free.velocities(q) + t.frequency * (t.shape * turn).real
        return np.concatenate([position, velocity], axis=1)

    # --- gaps in flight ---------------------------------------------------------------------------

    def _curve(self, i: int, element: int, guard: int) -> Curve:  # noqa: ARG002
        from dynkit.systems.impact.orbits.itineraries.one_mode.response_kernels import follow_gap

        start, phase = self.states[i : i + 1], float(self.event_phases[i])
        drive, clock = float(abs(self.terms.drives[element])), float(self.clock)

        def values(since: Array, orders: int) -> Array:
            kept = self.mode.propagators.ladder, self.mode.work, self.windows.rows
            numbers, out = self.terms.numbers, np.empty((orders, len(since)))
            follow_gap(*kept, element, numbers, start, phase, self.clock, since, out)
            return out

        size, _, bend, _ = (self.windows.bounds[element] * abs(start)).sum(axis=(1, 2)).tolist()
        return Curve(values, float(self.lasts[i]), (size + drive, bend + drive * clock**2))

    def is_open(self, i: int, element: int) -> bool | None:
        """Whether a gap is positive in the flight after impact number `i`; None if not certain.

        The proof: on each cell the error of the quintic Hermite polynomial is at most h^6/46080
        sup |f^(6)|, or 2 sup |f| + 2/5 h sup |f'| + h^2/20 sup |f''|, for each term of the gap. The
        polynomial's Bernstein coefficients must exceed this error. The coefficient at an impact is
        left out: there the gap vanishes in first order of time, and the polynomial's error in third
        order.
        """
        from dynkit.systems.impact.orbits.flight_kernels import least_coefficient

        curve, bounds = self.curve(i, element), self.windows.bounds[element]
        times, values = curve.nodes
        if min(curve.smallest[0], float(values[0, 1:-1].min())) < -curve.rounding:
            return False
        h = float(times[1])
        cap = 2.0 * bounds[0] + 0.4 * h * bounds[1] + 0.05 * h * h * bounds[2]
        error = float((np.minimum(bounds[3] * h**6 / 46080.0, cap) * abs(self.states[i])).sum())
        error += float(abs(self.terms.drives[element])) * (self.clock * h) ** 6 / 46080.0
        # the gap itself is zero at impacts with this stop
        first, last = (self.sides[k] == element for k in self.ends(i))
        proved = least_coefficient(values, h, first, last) > 1.1 * (error + curve.rounding)
        return True if proved else None

    @property
    def admissible(self) -> bool:
        """Whether all impulses are compressive, and no impact is missing.

        This is proved by bounds of the gaps. Where a gap nearly closes and the proof fails,
        simulation from just after each impact decides.
        """
        if not (self.impulses > 0.0).all():
            return False
        stops = range(len(self.terms.rests))
        gaps = [self.is_open(i, k) for i in range(self.events) for k in stops]
        if False in gaps or None not in gaps:
            return False not in gaps
        system, states = self.system(), self.section_states
        # the order of simultaneous impacts is decided by rounding
        some = [i for i in range(self.events) if not self._is_at_once(i)]
        return all(self._comes_next(i, system, states[i]) for i in some)

    def _is_at_once(self, i: int) -> bool:
        """Whether impact `i` and the next one in time are simultaneous."""
        least = self.least_apart(i, float(self.measures[0])) * self.period
        return bool(self.lasts[i] <= least)

    def _comes_next(self, i: int, system: Any, state: Array) -> bool:
        """Whether simulation from the state just after impact `i` finds the next one."""
        try:
            run = system._run(system.impact_state(state), 1, store=True)
        except NoMotion:  # at a grazing impact another gap is zero, or negative by rounding
            return False
        ends = [self.ends(i)[1]]
        while self._is_at_once(ends[-1]) and len(ends) < self.events:
            ends.append(self.ends(ends[-1])[1])
        if not run.impacts or len(run.contacts) or run.sides[1] not in self.sides[ends]:
            return False
        return bool(abs(run.time[0] - self.lasts[i]) <= SAME * self.period)

    def size_of(self, i: int, element: int, guard: int) -> float:  # noqa: ARG002
        row = self.oscillator._stops[element].row(self.oscillator.degrees_of_freedom)
        return float(abs(row).sum() * self.measures[0])

    def acceleration(self, i: int) -> tuple[float, float]:
        return float(self.gaps[2, i]), float(self._rounding(2)[i])


def _change(s: ResponseSolution, change: Array) -> Array:
    """Derivative (2n,) of the equations by a change of all numbers, including the structure's."""
    m = Machine(s.system(), change)
    flow, kicks = m.flow(m.free), [m.kick(m.free, side) for side in range(len(m.elements))]
    order = np.argsort(s.assembled.since[:, 0])
    lasts = s.lasts[order] * s.clock / m.frequency
    d = 2 * m.size
    first = s.event_phases[0]
    # tangent map from just before the first impact; the last column starts with the phase, 1
    moved = np.eye(d + 3, d + 1, dtype=complex)
    moved[d:, d] = np.sin(first), np.cos(first), 1.0
    before = []
    for i, flight in zip(order.tolist(), lasts, strict=True):
        before.append(moved.copy())
        moved[:, d] += s.impulses[i] * kicks[s.sides[i]]
        moved = expm(flow * flight) @ moved
    start = np.append(np.linalg.solve(np.eye(d) - moved[:d, :d], moved[:d, d]), 1.0)
    gaps, rates = np.empty((2, len(order)))
    for i, block in zip(order.tolist(), before, strict=True):
        z, side = block @ start, s.sides[i]
        gaps[i] = (m.gap(side) @ z).imag / STEP
        left = m.rate(side) @ z + s.impulses[i] / (1.0 + m.restitution(side))
        rates[i] = left.imag / STEP
    return np.concatenate([gaps, rates])
