"""The first crossing of a section by an integrated motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from dynkit.core.kept import cached_property
from dynkit.core.no_motion import CannotFollow, NoCrossing
from dynkit.core.validation import Array, positive
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.systems.flows.integration import Step, Velocity

if TYPE_CHECKING:
    from dynkit.dynamics.section import PoincareSection

# Number of cells of a step. A cell is divided until the section's value is a cubic there: until
# value and rate at this part of the cell follow from those at its ends. The part is no simple
# fraction, so that a periodic value is not seen at equal phases only.
_CELLS, _PART = 2, 0.5 * (5.0**0.5 - 1.0)
# Shortest cell, as a part of its step: a wrong gradient would divide cells without end.
_FINEST = 2.0**-12
# Largest deviation from the cubic, relative to the value's changes; and that of an interpolation,
# in units of the error of a step.
_CUBIC, _INTERPOLATED = 2.0**-10, 64.0
# A state is on the section if its value, over the reach, is at most this: a rounding error, which
# `dynkit.testing.lift_lands_on_the_section` allows as well.
ON_SECTION = 1e-13
# A motion that turns back within this distance of the section, in units of the reach, grazes it.
_GRAZING = 1e-10
# Largest number of iterations: Newton's method needs a few; bisection, where Newton's method does
# not converge, about as many as a number has bits.
_ITERATIONS = 60


@dataclass(eq=False)
class Look:
    """The section as seen from the motion; its value counts positive beyond it.

    The coordinates have had some `sizes`, (d,), until then: what is zero at the section has the
    rounding of the way there. Most looks need only the value.
    """

    search: Search
    time: float
    state: Array
    value: float
    sizes: Array
    turns: bool = False

    @cached_property
    def _gradient(self) -> Array:
        return self.search.section.gradient(self.state)

    @cached_property
    def rate(self) -> float:
        """Rate of the value."""
        rate = float(self._gradient @ self.search.velocity(self.state))
        return self.search.section.direction * rate

    @cached_property
    def reach(self) -> float:
        """How large the value may become with coordinates of these sizes."""
        size = self.search.least + math.sqrt(self.sizes @ self.sizes)
        return math.sqrt(self._gradient @ self._gradient) * size

    @property
    def rounding(self) -> float:
        """Rounding error of the value's terms."""
        return 2.0**-53 * float(abs(self._gradient) @ self.sizes)

    @property
    def near(self) -> bool:
        """Whether a motion that turns back here grazes the section."""
        return abs(self.value) <= _GRAZING * self.reach

    @property
    def behind(self) -> bool:
        """Whether the state is before the section by more than rounding."""
        return self.value < 0.0 and self.value < -ON_SECTION * self.reach

    def turns_before(self, after: Look) -> bool:
        """Whether an extremum between this look and a later one may show a crossing or grazing."""
        if self.rate * after.rate >= 0.0:
            return False
        if self.value >= 0.0 and after.value >= 0.0:
            return self.rate < 0.0
        if self.value < 0.0 and after.value < 0.0:
            return self.rate > 0.0 or not (self.behind or after.behind)
        return True


def checked_search(
    flow: Flow, state: Array, section: PoincareSection, time_limit: float
) -> tuple[Array, float]:
    """Return the start and the time limit of a search after a check of all arguments.

    Raises
    ------
    ValueError
        When the state, the dimension of the section or the time limit does not fit the flow.
    """
    start = flow._checked(state)
    if section.dimension != flow.dimension:
        raise ValueError(
            f"section must have the flow's dimension {flow.dimension}; got {section.dimension}"
        )
    return start, positive("time_limit", time_limit)


_Cubic: TypeAlias = tuple[float, float, float, float]


def _cubic(before: Look, after: Look, length: float) -> _Cubic:
    """Return the coefficients of the cubic through two looks, in parts of the time between them."""
    first, last, rise = length * before.rate, length * after.rate, after.value - before.value
    return before.value, first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise


@dataclass(frozen=True)
class Search:
    """The search for the first crossing of a section by the motion with a given velocity.

    Its `steps` go from a start, (d,), on for a duration. Their errors are at most `accuracy` times
    the size of the state, which counts as at least `least`.
    """

    velocity: Velocity
    section: PoincareSection
    steps: Callable[[Array, float], Iterable[Step]]
    least: float = 0.0
    accuracy: float = 0.0

    def first(self, start: Array, time_limit: float) -> Crossing:
        """Return the first crossing after the start, (d,).

        A crossing needs a state before the section by more than rounding, and a later state on or
        beyond it. A start on the section is no crossing, and rounding near the section is none.

        Raises
        ------
        NoCrossing
            When there is none within the time limit, or until the motion cannot be followed.
        """
        last = self._look(0.0, start, abs(start))
        armed, away, grazes = last.behind, not last.near, False
        try:
            for step in self.steps(start, time_limit):
                for here in self._looks(step, last):
                    if armed and last.value < 0.0 <= here.value:
                        hit = self._landed(step, last, here)
                        if hit is not None:
                            return hit
                    grazes = grazes or (away and here.turns and here.near)
                    armed, away = armed or here.behind, away or not here.near
                    last = here
        except CannotFollow as end:
            raise NoCrossing(
                f"no crossing within {time_limit}: the motion cannot be followed {end}"
            ) from end
        # armed is false e.g. after ever faster jumps, whose heights become smaller than rounding
        why = "" if armed else ": the motion was never clearly before the section"
        if grazes:
            why = ": the motion grazes the section and turns back"
        raise NoCrossing(f"no crossing within {time_limit}{why}")

    def _look(self, time: float, state: Array, sizes: Array) -> Look:
        """Look at a motion whose coordinates have had some sizes, (d,), before."""
        value = self.section.direction * self.section.value(state)
        return Look(self, time, state, value, np.maximum(sizes, abs(state)))

    def _looks(self, step: Step, begin: Look) -> Iterator[Look]:
        """Yield looks at a step that show each crossing, and at extrema that may show one."""
        if step.avoids(self.section, begin.value):
            yield self._look(step.time, step.state, begin.sizes)
            return
        cell, before = (step.time - begin.time) / _CELLS, begin
        times = [begin.time + i * cell for i in range(1, _CELLS)]
        states = [*step.paths(times), step.state]
        for time, state in zip([*times, step.time], states, strict=True):
            for here in self._divided(step, before, time, state):
                yield here
                before = here

    def _divided(self, step: Step, before: Look, time: float, state: Array) -> Iterator[Look]:
        """Yield looks after an earlier one until a time, at which the motion has a state, (d,)."""
        length = time - before.time
        middle = before.time + _PART * length
        inner = self._look(middle, step.path(middle), before.sizes)
        after = self._look(time, state, inner.sizes)
        cubic = _cubic(before, after, length)
        long = length > _FINEST * (step.time - step.begin)
        if long and not self._follows(cubic, inner, length, after.reach):
            for look in (inner, after):
                for here in self._divided(step, before, look.time, look.state):
                    yield here
                    before = here
            return
        looks, (_, first, second, third) = [inner, after], cubic
        bend = -second / (3.0 * third) if third else 0.0
        if 0.0 < bend < 1.0 and first * (first + bend * second) < 0.0:
            # here, between two extrema, the rate has the other sign
            bend = before.time + bend * length
            looks.append(self._look(bend, step.path(bend), before.sizes))
        for here in sorted(looks, key=lambda look: look.time):
            if before.turns_before(here):
                yield self._extremum(step, before, here)
            yield here
            before = here

    def _follows(self, cubic: _Cubic, look: Look, length: float, reach: float) -> bool:
        """Whether a look shows the value and the rate of a cubic in a cell of some length."""
        value, first, second, third = cubic
        value += _PART * (first + _PART * (second + _PART * third))
        rate = first + _PART * (2.0 * second + _PART * 3.0 * third)
        last, own = first + 2.0 * second + 3.0 * third, length * look.rate
        off, size = max(abs(look.value - value), abs(own - rate)), abs(first) + abs(last) + abs(own)
        error = max(ON_SECTION, _INTERPOLATED * self.accuracy) * reach
        return not off > max(_CUBIC * size, error)

    def _extremum(self, step: Step, before: Look, after: Look) -> Look:
        from scipy.optimize import brentq

        # known rates at the ends: computed again, rounding might change their signs
        rates = {before.time: before.rate, after.time: after.rate}
        time = brentq(
            lambda t: rates[t] if t in rates else self._look(t, step.path(t), before.sizes).rate,
            before.time,
            after.time,
            xtol=1e-9 * (after.time - before.time),
        )
        look = self._look(time, step.path(time), before.sizes)
        look.turns = True
        return look

    def _landed(self, step: Step, before: Look, after: Look) -> Crossing | None:
        """Return the crossing between two looks, refined by integration, not by interpolation.

        None if the interpolation reaches the section and the integrated motion does not. Then the
        motion is tangent to the section up to the error of integration.
        """
        # times since the begin of the step have a finer resolution than times since the start
        low, high = before.time - step.begin, after.time - step.begin
        middle = 0.5 * (low + high)
        guess = self._root(lambda t: step.path(step.begin + t), middle, low, high, before.sizes)
        hit = self._root(step.cut_short, guess.time, low, high, before.sizes)
        if hit.behind:
            return None
        time, state = step.begin + hit.time, hit.state
        late = hit.value / hit.rate if hit.rate > 0.0 else math.inf
        if abs(late) <= 2.0**-48 * high:
            # times are too coarse to end on the section
            time, state = time - late, state - late * self.velocity(state)
        return Crossing(time, state)

    def _root(
        self,
        state_at: Callable[[float], Array],
        time: float,
        low: float,
        high: float,
        sizes: Array,
    ) -> Look:
        """Return the look whose value is nearest to zero: Newton's method, kept in a bracket."""
        best = self._look(time, state_at(time), sizes)
        here = best
        for _ in range(_ITERATIONS):
            if abs(here.value) < abs(best.value):
                best = here
            if abs(best.value) <= best.rounding:
                break
            low, high = (here.time, high) if here.value < 0.0 else (low, here.time)
            time = here.time - here.value / here.rate if here.rate > 0.0 else low
            if not low < time < high:
                time = 0.5 * (low + high)
            if time in (low, high):
                break
            here = self._look(time, state_at(time), sizes)
        return best
