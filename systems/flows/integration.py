"""Steps of an integrator: SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from dynkit.validation import Array

if TYPE_CHECKING:
    from scipy.integrate import DOP853

Velocity: TypeAlias = Callable[[Array], Array]

# Hours of work, at some hundred microseconds a step; judged by the pace, every so many steps.
_MOST_STEPS, _PACE = 10**8, 10_000


class CannotFollow(ArithmeticError):
    """The motion cannot be followed any further: it runs away, or would take for ever."""

    def __init__(self, time: float, reason: object) -> None:
        super().__init__(f"beyond time {time:.6g}: {reason}")


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
        When the velocity refuses a state, no step is short enough, or more than 10^8 steps would be
        needed.
    """
    from scipy.integrate import DOP853

    time = 0.0
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            solver = DOP853(
                lambda _, y: velocity(y),
                0.0,
                start,
                duration,
                rtol=tolerance,
                atol=tolerance,
                first_step=first_step,
            )
        count = 0
        while solver.status == "running":
            time = float(solver.t)
            if count and count % _PACE == 0 and count * duration > _MOST_STEPS * time:
                raise CannotFollow(time, f"{duration} would take more than {_MOST_STEPS} steps")
            count += 1
            with np.errstate(over="ignore", invalid="ignore"):
                failure = solver.step()
            if failure is not None:
                raise CannotFollow(time, failure)
            yield solver
    except ValueError as refusal:
        raise CannotFollow(time, refusal) from refusal


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
