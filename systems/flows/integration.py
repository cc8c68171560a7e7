"""Steps of an integrator: SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias, final

import numpy as np

from dynkit.core.no_motion import CannotFollow
from dynkit.core.validation import Array

if TYPE_CHECKING:
    from scipy.integrate import DOP853

    from dynkit.dynamics.section import PoincareSection

Velocity: TypeAlias = Callable[[Array], Array]

# Hours of work, at some hundred microseconds a step; judged by the pace, every so many steps.
_MOST_STEPS, _PACE = 10**8, 10_000


def steps(
    velocity: Velocity,
    start: Array,
    duration: float,
    tolerance: float,
    first_step: float | None = None,
) -> Iterator[DOP853[np.float64]]:
    """Yield the integrator after every step, until the duration is over.

    Parameters
    ----------
    velocity : callable, (n,) array to (n,) array
    start : (n,) array
    duration : float
    tolerance : float
        A step's error is held below this times (1 + |y_i|), root mean square over the y_i.
    first_step : float, optional

    Raises
    ------
    CannotFollow
        When the velocity is not finite at the start, no step is short enough for the tolerance, as
        where the motion runs away, or more than 10^8 steps would be needed.
    """
    from scipy.integrate import DOP853

    def rate(_: float, y: Array) -> Array:
        # a trial step that overflows is rejected, as its error is not a number
        return velocity(y) if np.isfinite(y).all() else np.full_like(y, np.nan)

    with _silent():
        solver = DOP853(
            rate, 0.0, start, duration, rtol=tolerance, atol=tolerance, first_step=first_step
        )
    if not np.isfinite(solver.f).all():
        raise CannotFollow(f"beyond time 0: the velocity there is {solver.f.tolist()}")
    count = 0
    while solver.status == "running":
        time = float(solver.t)
        if count and count % _PACE == 0 and count * duration > _MOST_STEPS * time:
            raise CannotFollow(
                f"beyond time {time:.6g}: {duration} would take more than {_MOST_STEPS} steps"
            )
        count += 1
        with _silent():
            failure = solver.step()
        if failure is not None:
            raise CannotFollow(f"beyond time {time:.6g}: {failure}")
        yield solver


def integrate(
    velocity: Velocity,
    start: Array,
    duration: float,
    tolerance: float,
    first_step: float | None = None,
) -> Array:
    """Return the state, (n,), a duration >= 0 after the start; arguments as for `steps`."""
    state = start.copy()
    if duration > 0.0:
        for solver in steps(velocity, start, duration, tolerance, first_step):
            state = np.array(solver.y)
    return state


@final
class IntegratedStep:
    """A step of DOP853: its interpolation, and the motion to any time in it, integrated again."""

    def __init__(
        self, solver: DOP853[np.float64], velocity: Velocity, start: Array, tolerance: float
    ) -> None:
        self.begin, self.time, self.state = float(solver.t_old), float(solver.t), solver.y.copy()
        self._start, self._velocity, self._tolerance = start, velocity, tolerance
        self._path = solver.dense_output()

    def path(self, time: float) -> Array:
        return np.asarray(self._path(time))

    def cut_short(self, duration: float) -> Array:
        # a step cut short is at least as accurate as the step
        return integrate(
            self._velocity, self._start, duration, self._tolerance, first_step=duration
        )

    def avoids(self, section: PoincareSection, value: float) -> bool:  # noqa: ARG002
        return False


def integrated_steps(
    velocity: Velocity, tolerance: float, start: Array, duration: float
) -> Iterator[IntegratedStep]:
    """Yield every step until the duration is over; arguments as for `steps`."""
    for solver in steps(velocity, start, duration, tolerance):
        step = IntegratedStep(solver, velocity, start, tolerance)
        yield step
        start = step.state


def _silent() -> np.errstate:
    """What overflows in a trial step is no fault."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")
