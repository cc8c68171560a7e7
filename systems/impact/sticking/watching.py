"""Borders of a branch of orbits that stick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.events import Condition, Event
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import NoSolution
from dynkit.systems.impact.orbits.flights import LEAST, MOST, smallest_minimum
from dynkit.systems.impact.orbits.watching import SAME
from dynkit.systems.impact.state import TWO_PI
from dynkit.systems.impact.sticking.passage import Passage

if TYPE_CHECKING:
    from dynkit.systems.impact.sticking.problem import StickingProblem


_ROUNDING = 64.0 * 2.0**-52


class Watched(NamedTuple):
    """One number that is watched: `what` of passage number `passage`; flights also have a side."""

    what: str
    passage: int
    number: int = 0
    side: int = 0


KINDS = {
    "impact": BifurcationKind.GR,
    "flight": BifurcationKind.GR,
    "lift": BifurcationKind.CB,
    "chatter": BifurcationKind.CB,
    "hold": BifurcationKind.CB,
    "release": BifurcationKind.CB,
}
"""Velocities before impacts, smallest gaps of flights; accelerations of the gap after impacts that
do not rebound; contact forces where chatter ends, the smallest of each contact, and how fast they
fall at releases."""

ENDS = ("lift", "chatter", "release")
"""Beyond these there is no such orbit."""


def items(passages: list[Passage]) -> list[Watched]:
    """All that is watched, in order."""
    found = []
    for k, passage in enumerate(passages):
        impacts, stops = range(len(passage.word.sides)), range(len(passage.scene.holdings))
        found += [Watched("impact", k, i) for i in impacts]
        found += [Watched("flight", k, i, side) for i in impacts for side in stops]
        if passage.r == 0.0:
            found += [Watched("lift", k, i) for i in impacts[:-1]]
        found += [Watched(what, k) for what in ("chatter", "hold", "release")]
    return found


def watched(passages: list[Passage]) -> list[Event]:
    """What the kinds of `KINDS` are; a flight from or to an impact that pulls tells nothing."""
    return [
        Event(KINDS[w.what], w.passage, _value(passages[w.passage], w), ends=w.what in ENDS)
        for w in items(passages)
    ]


def _value(passage: Passage, w: Watched) -> float:
    if w.what == "impact":
        return -passage.rates[w.number]
    if w.what == "flight":
        pulled = passage.rates[w.number] > 0.0
        pulled = pulled or (w.number > 0 and passage.rates[w.number - 1] > 0.0)
        return math.nan if pulled else _seen(*lowest_gap(passage, w.number, w.side))
    if w.what == "lift":
        after = passage.states[w.number + 1]
        return float(passage.scene.gap(after, passage.word.sides[w.number], 2))
    if w.what == "release":
        return -float(passage.scene.holdings[passage.word.start].force(passage.start, 1))
    if w.what == "chatter":
        return passage.pressing
    return _seen(*lowest_force(passage))


def _seen(value: float, _: float, rounding: float) -> float:
    """A minimum that is more than rounding; where a flight all but vanishes, none is."""
    return value if abs(value) > rounding else math.inf


def gap_curve(passage: Passage, flight: int, side: int, times: Array, orders: int) -> Array:
    """Gap of a flight and its derivatives (orders, k) at times (k,) after its start."""
    states = passage.scene.fly(passage.states[flight], times)
    return np.stack([passage.scene.gap(states, side, order) for order in range(orders)])


def force_curve(passage: Passage, times: Array, orders: int) -> Array:
    """Contact force and its derivatives (orders, k) at times (k,) after contact begins."""
    holding = passage.scene.holdings[passage.word.sides[-1]]
    states = holding.after(passage.caught, times)
    return np.stack([holding.force(states, order) for order in range(orders)])


def lowest_gap(passage: Passage, flight: int, side: int) -> tuple[float, float, float]:
    """Smallest minimum inside a flight, its time after the start, and what is rounding.

    Infinite where there is none.
    """
    ladder = passage.scene.system._gaps[side]
    return _lowest(
        partial(gap_curve, passage, flight, side),
        float(passage.durations[flight]),
        ladder.rows,
        passage.states[flight],
    )


def lowest_force(passage: Passage) -> tuple[float, float, float]:
    """The same of the force during contact."""
    ladder = passage.scene.holdings[passage.word.sides[-1]].contact.force
    return _lowest(partial(force_curve, passage), passage.lasts, ladder.rows, passage.caught)


def _lowest(
    curve: partial[Array], lasts: float, rows: Array, state: Array
) -> tuple[float, float, float]:
    if lasts <= 0.0:
        return math.inf, math.nan, 0.0
    sizes = [float((abs(rows[k : k + 2]) * abs(state[:, : rows.shape[1]])).sum()) for k in (0, 4)]
    count = 4.0 * lasts * math.sqrt(sizes[1] / sizes[0]) if sizes[0] > 0.0 else 0.0
    times = np.linspace(0.0, lasts, int(min(max(count, LEAST), MOST)) + 1)
    rounding = _ROUNDING * sizes[0]
    return *smallest_minimum(curve, times, curve(times, 3), rounding), rounding


def is_motion(passages: list[Passage]) -> bool:
    """Whether simulation from each release finds the same impacts, contact and next release."""
    return all(_is_motion(passage) for passage in passages)


def _is_motion(passage: Passage) -> bool:
    if not passage.complete or any(rate >= 0.0 for rate in passage.rates):
        return False
    system, word = passage.scene.system, passage.word
    start = passage.scene.holdings[word.start].release(passage.places, float(passage.phases[0]))
    n = len(word.sides)
    # Where the chatter is cut may change by a bounce.
    run = system._run(start, n + passage.run.impacts + 3, store=True)
    if run.impacts < n or not len(run.contacts) or run.before[0] < n:
        return False
    times = np.append(run.time[:n], run.contacts[0, 1])
    expected = (passage.phases[1:] - passage.phases[0]) / passage.w
    if tuple(run.sides[1 : n + 1].tolist()) != word.sides:
        return False
    return bool((abs(times - expected) <= SAME * TWO_PI / passage.w).all())


@final
class Border(Condition):
    """A velocity, a force or its rate is zero; a gap or a force that touches has its minimum there.

    The phase of the latter is an unknown of its own.
    """

    def __init__(self, problem: StickingProblem, w: Watched) -> None:
        self.problem, self.w = problem, w
        self.unknowns = 1 if w.what in ("flight", "hold") else 0

    def residual(self, x: Array, own: Array, p: Array) -> Array:
        passage, w = self.problem.passages(x, p)[self.w.passage], self.w
        length, speed = self.problem.sizes
        turn = passage.w
        if w.what == "flight":
            begins = passage.phases[w.number]
            since = (own - begins) / turn
            return gap_curve(passage, w.number, w.side, since, 2)[:, 0] / [length, speed]
        force = float(passage.scene.system._structure.mass.max()) * length * turn**2
        if w.what == "hold":
            since = (own - passage.contact_phase) / turn
            return force_curve(passage, since, 2)[:, 0] / [force, force * turn]
        units = {"impact": speed, "lift": length * turn**2, "chatter": force}
        return np.array([_value(passage, w) / units.get(w.what, force * turn)])


def condition_of(
    problem: StickingProblem, event: int, x: Array, p: Array
) -> tuple[Condition, Array]:
    """What holds where an event of `watched` is zero, and a guess of its own unknowns."""
    passages = problem.passages(x, p)
    w = items(passages)[event]
    passage = passages[w.passage]
    own = np.empty(0)
    if w.what == "chatter" and passage.r > 0.0:
        raise NoSolution("the force where an endless chatter ends is not smooth there")
    if w.what == "flight":
        _, since, _ = lowest_gap(passage, w.number, w.side)
        own = np.array([passage.phases[w.number] + passage.w * since])
    if w.what == "hold":
        own = np.array([passage.contact_phase + passage.w * lowest_force(passage)[1]])
    return Border(problem, w), own


def touched(passages: list[Passage], event: int, own: Array) -> Mapping[str, float]:
    """Phase in [0, 2 pi), time from the first release and side of what happens at a border."""
    w = items(passages)[event]
    passage = passages[w.passage]
    side = passage.word.sides[-1]
    if w.what in ("impact", "lift"):
        at, side = float(passage.phases[w.number + 1]), passage.word.sides[w.number]
    elif w.what == "release":
        at, side = float(passage.phases[0]), passage.word.start
    elif w.what == "chatter":
        at = passage.contact_phase
    else:
        at = float(own[0])
        side = w.side if w.what == "flight" else side
    since = (at - float(passages[0].phases[0])) / passage.w
    return {"phase": at % TWO_PI, "time": since, "side": float(side)}
