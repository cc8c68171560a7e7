"""The first crossing of a section by an integrated motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.no_motion import CannotFollow, NoCrossing
from dynkit.core.validation import Array, positive
from dynkit.dynamics.flow import Crossing, Flow
from dynkit.systems.flows.integration import Step, Velocity

if TYPE_CHECKING:
    from dynkit.dynamics.section import PoincareSection

# A step is looked at in so many cells: the section's value has one extremum at most in each.
_CELLS = 4
# On the section, to rounding: `dynkit.testing.lift_lands_on_the_section` allows as much.
ON_SECTION = 1e-13
# A motion that turns back within this distance of the section, in units of the reach, grazes it.
_GRAZING = 1e-10
# Newton's method needs a handful; bisection, where that does not converge, as many as bits.
_ITERATIONS = 60


@dataclass(slots=True)
class Look:
    """The section as seen from the motion; its value counts positive beyond it.

    The coordinates have had some `sizes`, (d,), until then: what is zero at the section has the
    rounding of the way there. The value's `reach` is how large it may become with them, and
    `rounding` is that of its terms.
    """

    time: float
    state: Array
    value: float
    rate: float
    sizes: Array
    reach: float
    rounding: float
    turns: bool = False

    @property
    def near(self) -> bool:
        """Whether a motion that turns back here grazes the section."""
        return abs(self.value) <= _GRAZING * self.reach

    @property
    def behind(self) -> bool:
        """Whether the section is clearly still to come."""
        return self.value < 0.0 and self.value < -ON_SECTION * self.reach

    def turns_before(self, after: Look) -> bool:
        """Whether the value has an extremum until another look that may tell more than the two."""
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
    """Return the start and the time limit of a search, once all arguments fit the flow.

    Raises
    ------
    ValueError
        When the state, the dimension of the section or the time limit does not.
    """
    start = flow._checked(state)
    if section.dimension != flow.dimension:
        raise ValueError(
            f"section must have the flow's dimension {flow.dimension}; got {section.dimension}"
        )
    return start, positive("time_limit", time_limit)


@dataclass(frozen=True)
class Search:
    """The search for the first crossing of a section by the motion that a velocity makes.

    Its `steps` go from a start, (d,), on for a duration. They are as exact as for states of at
    least some size.
    """

    velocity: Velocity
    section: PoincareSection
    steps: Callable[[Array, float], Iterable[Step]]
    least: float = 0.0

    def first(self, start: Array, time_limit: float) -> Crossing:
        """Return the first crossing after the start, (d,).

        What counts is a motion that was clearly behind the section and then is not: neither a start
        on the section nor rounding beside it is a crossing.

        Raises
        ------
        NoCrossing
            When there is none within the time limit, or as far as the motion can be followed.
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
        # such as after jumps that come ever faster, whose height is lost in rounding in the end
        why = "" if armed else ": the motion was never clearly before the section"
        if grazes:
            why = ": the motion grazes the section and turns back"
        raise NoCrossing(f"no crossing within {time_limit}{why}")

    def _look(self, time: float, state: Array, sizes: Array) -> Look:
        """Look at a motion whose coordinates have had some sizes, (d,), before."""
        sign, gradient = self.section.direction, self.section.gradient(state)
        own = np.maximum(sizes, abs(state))
        value, rate = self.section.value(state), float(gradient @ self.velocity(state))
        reach = float(np.linalg.norm(gradient)) * (self.least + float(np.linalg.norm(own)))
        rounding = 2.0**-53 * float(abs(gradient) @ own)
        return Look(time, state, sign * value, sign * rate, own, reach, rounding)

    def _looks(self, step: Step, begin: Look) -> Iterator[Look]:
        """Looks at the ends of a step's cells, and at the extremum in each where it may matter."""
        if step.avoids(self.section, begin.value):
            yield self._look(step.time, step.state, begin.sizes)
            return
        cell = (step.time - begin.time) / _CELLS
        times = [begin.time + i * cell for i in range(1, _CELLS)]
        before = begin
        states = [*step.paths(times), step.state]
        for time, state in zip([*times, step.time], states, strict=True):
            after = self._look(time, state, before.sizes)
            if before.turns_before(after):
                yield self._extremum(step, before, after)
            yield after
            before = after

    def _extremum(self, step: Step, before: Look, after: Look) -> Look:
        from scipy.optimize import brentq

        # by table at the ends, where rounding might change a sign
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
        """Return the crossing between two looks, on the motion itself and not on its interpolation.

        None when the interpolation reaches the section and the motion does not: the two are as near
        to a tangency as the integration's error.
        """
        # times since the step began: they resolve more than times since the start
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
