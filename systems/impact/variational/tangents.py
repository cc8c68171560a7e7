"""Tangent map of impact motions, in modal coordinates.

Disturbances are those of the free state: a flight multiplies each pair of modal coordinates by its
own 2x2 matrix, and the saltation matrix of an impact is the identity plus a matrix of rank 2. The
Lyapunov exponents equal those of the section coordinates, since the change of coordinates is
bounded on average. The volume changes by exactly r^2 exp(-trace(M^-1 C) t) in each step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynkit.core.no_motion import NoCrossing
from dynkit.core.stretching import Stretching
from dynkit.core.validation import Array, non_negative_integer
from dynkit.systems.impact.elements.element import EventKind
from dynkit.systems.impact.elements.laws import ImpactLaw, rebound
from dynkit.systems.impact.modes.free_motion import FreeMotion, free_motion
from dynkit.systems.impact.simulation.runs import trajectory_of
from dynkit.systems.impact.simulation.state import ImpactState, section_of
from dynkit.systems.impact.simulation.trajectory import Trajectory, grouped, in_steps
from dynkit.systems.impact.variational.saltation import closing, release, saltation

if TYPE_CHECKING:
    from dynkit.systems.impact.simulation.driven_structure import DrivenStructure

_IMPACTS, _NUMBERS = 1024, 4_000_000
"""Largest number of impacts, and of entries of their matrices, that are processed together."""

_PRODUCTS_OF_A_CALL = 1 << 24
"""Multiplications in one call of the kernel, about ten milliseconds, but at least one step."""

SPREAD = math.log(1e5)
"""Logarithm of the largest ratio of the decays of two modes within one part of a flight. Longer
flights are cut into parts, so that the smallest stretching keeps ten digits in each part."""

_RECURRENCE = 1e-6
"""Largest recurrence error: of the last state, relative to it, and of its time, in periods."""

_REPETITIONS, _SQUARINGS = 3, 10
"""Least number of periods in the motion; largest number of squarings of the derivative over one."""

_ROUNDING = 1e-12
"""Relative error of the derivative for each impact, in its norm: far more than rounding."""

_ROOM = 100.0
"""Multipliers must be below 1 - 1/_ROOM in modulus. All later changes from period to period then
sum up to at most _ROOM times the last one."""


class Steps(NamedTuple):
    """Arguments of `tangent_kernels.stretch`; `first` has the first step to each impact."""

    blocks: Array
    which: Any
    dense: Array
    vectors: Array
    jumps: Array
    lost: Any
    first: Any

    def part(self, now: slice) -> tuple[Any, ...]:
        """Arguments of the kernel for some of the steps."""
        matrices = self.blocks[now], self.which[now], self.dense
        return *matrices, self.vectors, self.jumps[now], self.lost[now]


def stretching(
    oscillator: DrivenStructure, start: ImpactState, n: int, frame: Array | None, accuracy: float
) -> Stretching:
    """Stretching of disturbances by the next n impacts: see `Map.stretching`.

    Each column of the frame is a disturbance of the free state. A grazing impact, u = 0, leaves
    disturbances unchanged, since no derivative exists there.
    """
    count = non_negative_integer("n", n)
    logs, times = np.empty((count, oscillator.dimension)), np.empty(count)
    rows = np.eye(oscillator.dimension) if frame is None else np.array(frame.T, order="C")
    most = _at_once(oscillator.dimension)
    for begin in range(0, count, most):
        now = slice(begin, min(begin + most, count))
        run = trajectory_of(oscillator, start, now.stop - begin, store=True)
        if run.impacts < now.stop - begin:
            raise NoCrossing(f"there is no next impact: {run.ending.value}")
        logs[now] = _stretched(steps_of(oscillator, run), rows)
        times[now], start = np.diff(run.time, prepend=0.0), run.final
    errors = np.full(logs.shape, accuracy)
    return Stretching(logs, errors, times, section_of(oscillator, start), rows.T, start)


def growth(oscillator: DrivenStructure, run: Trajectory) -> Array:
    """Logarithms (n,) of the growth of one disturbance over the flight to each impact of a run.

    The disturbance converges to the direction of fastest growth.
    """
    d, n = oscillator.dimension, run.impacts
    # A fixed direction without symmetry is unlikely to lie in an invariant subspace.
    frame = np.sqrt(np.arange(2.0, 2.0 + d))[None]
    frame, logs, size = frame / np.linalg.norm(frame), np.empty(n), _at_once(d)
    for begin in range(0, n, size):
        now = slice(begin, min(begin + size, n))
        logs[now] = _stretched(steps_of(oscillator, run, now), frame)[:, 0]
    return logs


def returned(oscillator: DrivenStructure, run: Trajectory, impacts: Sequence[int]) -> Array:
    """Derivatives (k, 2N, 2N) of free states, from each of some impacts to the next of these.

    `impacts` are the numbers (k + 1,) of these impacts in the run, ascending and not negative.
    """
    from dynkit.systems.impact.variational.tangent_kernels import stretch

    d = oscillator.dimension
    steps = steps_of(oscillator, run, slice(impacts[0] + 1, impacts[-1] + 1))
    first = [*steps.first.tolist(), len(steps.which)]
    ends = [first[k - impacts[0]] for k in impacts]
    frames, none = np.zeros((len(impacts) - 1, d, d)) + np.eye(d), np.empty((0, d))
    for frame, begin, end in zip(frames, ends, ends[1:], strict=False):
        more: Any = frame, np.empty(d), none
        stretch(*steps.part(slice(begin, end)), *more)
    return frames.transpose(0, 2, 1)


def settles(oscillator: DrivenStructure, run: Trajectory) -> bool:
    """Whether the impacts of a run recur, and norms prove that their orbit is stable.

    False where this is not proved. A proof needs a single hard stop whose restitution is a positive
    number, and a run without contacts. Let A be the derivative over the last period, and B that
    over the period before. The derivative of the orbit itself differs from A by no more than a
    geometric series of the difference of A and B, as for `OrbitLabel.multiplier`. If the norm of
    its 2^k-th power is below 1, all multipliers are inside the unit circle.
    """
    plain = oscillator._motion is None and oscillator._automaton.beside is None
    if not plain or len(run.switches.time) or not oscillator.restitution > 0.0:
        return False
    n, last = _period_of(run, 2.0 * math.pi / oscillator.frequency), run.impacts - 1
    if n == 0 or not (run.log.speed[-2 * n :] > 0.0).all():
        return False
    before, power = returned(oscillator, run, [last - 2 * n, last - n, last])
    size, limit = float(np.linalg.norm(power)), 1.0 - 1.0 / _ROOM
    error = _ROOM * float(np.linalg.norm(power - before)) + _ROUNDING * n * size
    for _ in range(_SQUARINGS + 1):
        if size + error < limit or not size + error < 1e50:
            break
        power, error = power @ power, error * (2.0 * size + error)
        size, limit = float(np.linalg.norm(power)), limit * limit
    return size + error < limit


def _period_of(run: Trajectory, turn: float) -> int:
    """Least number of impacts in whole forcing periods until the last state recurs, or 0."""
    log, most = run.log, run.impacts // _REPETITIONS
    turns = (log.time[-1:] - log.time[-1 - most : -1][::-1]) / turn
    whole = np.rint(turns)
    near = (whole > 0.0) & (abs(turns - whole) <= _RECURRENCE)
    final = np.append(log.states[-1:], log.speed[-1:])
    for n in (np.flatnonzero(near) + 1).tolist():
        apart = np.linalg.norm(final - np.append(log.states[-1 - n], log.speed[-1 - n]))
        if apart <= _RECURRENCE * np.linalg.norm(final):
            return int(n)
    return 0


def _at_once(d: int) -> int:
    """Number of impacts whose matrices (d, d) are processed together."""
    return max(1, min(_IMPACTS, _NUMBERS // d**2))


def _stretched(steps: Steps, frame: Array) -> Array:
    """Logarithms (n, k) of the stretching to each impact; the frame is modified in place.

    Calls of the kernel have a bounded duration.
    """
    from dynkit.systems.impact.variational.tangent_kernels import stretch

    (k, d), count = frame.shape, len(steps.which)
    logs, size = np.empty((count, k)), max(_PRODUCTS_OF_A_CALL // (k * d * (k + d)), 1)
    for begin in range(0, count, size):
        now = slice(begin, begin + size)
        more: Any = frame, np.empty(d), logs[now]
        stretch(*steps.part(now), *more)
    return np.asarray(np.add.reduceat(logs, steps.first, axis=0))


def steps_of(oscillator: DrivenStructure, run: Trajectory, now: slice | None = None) -> Steps:
    """The steps of a run to some impacts, by default all: contact, flight, impact.

    The machine has one hard stop, or a table with play, and no other element. Long flights and
    contacts are cut into parts, see `SPREAD`.
    """
    now = now or slice(0, run.impacts)
    motion, flights, some, before, held, jumps, lost = _between(oscillator, run, now)
    if not len(held) and flights.max(initial=0.0) * motion.spread <= SPREAD:
        each = np.arange(len(flights))
        dense = np.empty((0, oscillator.dimension, oscillator.dimension))
        flown = _flights(motion, flights, np.full(len(each), -1), dense)
        return Steps(*flown, motion.vectors, jumps, lost, each)
    parts, stuck_parts = (
        np.maximum(np.ceil(part * (motion.spread / SPREAD)), 1.0).astype(np.intp)
        for part in (flights, held)
    )
    contact_steps = np.zeros(len(flights), dtype=np.intp)
    contact_steps[before] = stuck_parts - 1
    # The order is: parts of a contact except the last, parts of the flight, the impact.
    first = np.concatenate([[0], np.cumsum(contact_steps + parts)])
    total = int(first[-1])
    durations = np.repeat(flights / parts, parts + contact_steps)
    which = np.full(total, -1)
    jump = np.zeros((total, 3))
    gone = np.zeros(total, dtype=np.intp)
    jump[first[1:] - 1], gone[first[1:] - 1] = jumps, lost
    dense = _contact_matrices(oscillator, run, held / stuck_parts, some)
    for k, (i, many) in enumerate(zip(before.tolist(), stuck_parts.tolist(), strict=True)):
        place = int(first[i])
        which[place : place + many] = k
        gone[place : place + many] = 2
        durations[place : place + many - 1] = 0.0
    flown = _flights(motion, durations, which, dense)
    return Steps(*flown, motion.vectors, jump, gone, first[:-1])


def _between(oscillator: DrivenStructure, run: Trajectory, now: slice) -> Any:
    """The free motion, flights to some impacts, contacts before them, jumps, lost directions.

    Contacts are given by their slice, the numbers of the flights after them, and their durations.
    """
    flights, held = run.durations
    before = run.before[: len(held)]
    some = slice(*np.searchsorted(before, (now.start, now.stop))) if len(held) else slice(0)
    before = before[some] - now.start
    return (
        *(free_motion(oscillator._contact), flights[now], some, before, held[some]),
        *_jumps(oscillator, run, now),
    )


def _flights(
    motion: FreeMotion, durations: Array, which: Any, dense: Array
) -> tuple[Array, Any, Array]:
    """Kernel arguments of flights (n,); matrix ``dense[which]`` precedes those with which >= 0."""
    slots = motion.mode.layout.modes
    flown = motion.mode.transitions(durations)
    if len(flown.linked):
        blocks = np.tile(np.eye(2)[..., None], (len(durations), 1, 1, len(slots)))
        matrices = flown.matrices(slots)
        after = which >= 0
        matrices[after] = matrices[after] @ dense[which[after]]
        dense, which = matrices, np.arange(len(durations))
    else:
        blocks = np.ascontiguousarray(flown.own[..., motion.mode.layout.own])
    return blocks.reshape(len(durations), 4, -1), which, np.ascontiguousarray(dense)


def _jumps(oscillator: DrivenStructure, run: Trajectory, now: slice) -> tuple[Array, Any]:
    """Bend, kick and push (n, 3) of some impacts, and the number (n,) of directions they lose."""
    rates, bends = before_impacts(oscillator, run, now)
    rates = np.minimum(rates, 0.0)
    r, slope = rebound(oscillator.restitution, rates)
    jumps, hit = np.empty((len(rates), 3)), rates < 0.0
    jumps[:, :2], jumps[:, 2] = saltation(slope, rates, bends), -(1.0 + r) * hit
    lost = hit & ((r == 0.0) | (slope == 0.0))
    return jumps, lost.astype(np.intp)


def before_impacts(
    oscillator: DrivenStructure, run: Trajectory, now: slice = slice(None)
) -> tuple[Array, Array]:
    """Rates and accelerations (n,) of the gap just before some impacts of a trajectory."""
    log, numbers = run.log, np.arange(run.impacts)[now]
    rates, bends = np.empty((2, run.impacts))
    automaton = oscillator._automaton
    for number, where in grouped(log.guard[now]):
        here = numbers[where]
        guard = automaton.guards[number]
        mode, stop = automaton.modes[guard.mode], oscillator._stops[guard.element]
        law = isinstance(stop.restitution, ImpactLaw)
        r = 0.0 if law else stop.restitution
        if r > 0.0:
            rates[here] = -log.speed[here] / r
        rows = np.zeros((2, 2, mode.layout.slots))
        rows[..., : guard.sum.rows.shape[1]] = guard.sum.rows[2:6].reshape(2, 2, -1)
        if r > 0.0 and guard.mode == 0:  # the state after determines that before
            kick = automaton.tables.kick[number, :2, : mode.layout.slots]
            turn = float((rows[1] * kick).sum())
            for own in (here[now] for now in in_steps(len(here))):
                bends[own] = np.einsum("ij,kij->k", rows[1], log.states[own])
            bends[here] += (1.0 + r) * rates[here] * turn
        else:
            parts = run.segments
            last = np.flatnonzero(parts.kind == EventKind.IMPACT)[here + 1] - 1
            lasts, which = log.time[here] - parts.begin[last], np.arange(len(here))
            ends = mode.after(parts.of(mode, last), which, lasts)
            before, bends[here] = np.einsum("mij,kij->mk", rows, ends)
            if law:
                rates[here] = -stop.restitution.approach(-before, log.speed[here])
            elif r == 0.0:
                rates[here] = before
    return rates[now], bends[now]


def _contact_matrices(
    oscillator: DrivenStructure, run: Trajectory, durations: Array, some: slice
) -> Array:
    """Derivatives (k, 2N, 2N) over contacts of given durations (k,), with begin and release."""
    d = oscillator.dimension
    out = np.zeros((len(durations), d, d))
    if not len(durations) or d == 2:
        return out
    before, automaton = run.before[some], oscillator._automaton
    speeds, states = run.speeds[before], run.free_states[before]
    for number, here in grouped(run.switches.guard[run._held][some]):
        guard = automaton.guards[number]
        mode = automaton.modes[guard.target]
        moved = mode.transitions(durations[here]).matrices(mode.layout.modes)
        down = closing(oscillator, guard, states[here], speeds[here])
        out[here] = release(oscillator, automaton.guards[guard.partner]) @ moved @ down
    return out
