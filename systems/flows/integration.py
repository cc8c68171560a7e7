"""Steps of SciPy's integrators: DOP853, or Radau for stiff flows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, final

import numpy as np

from dynkit.core.no_motion import CannotFollow
from dynkit.core.validation import Array
from dynkit.dynamics.section import Hyperplane, Stroboscope

if TYPE_CHECKING:
    from scipy.integrate import DOP853, Radau

    from dynkit.dynamics.section import PoincareSection

Velocity: TypeAlias = Callable[[Array], Array]
Jacobian: TypeAlias = Callable[[Array], Array]
Solver: TypeAlias = "DOP853[np.float64] | Radau"

METHODS = ("DOP853", "Radau")
"""An explicit method of order 8, and an implicit one of order 5 for stiff flows."""

# Largest number of steps: hours of work, at some hundred microseconds a step. After every `_PACE`
# steps the total is estimated from the time reached.
_MOST_STEPS, _PACE = 10**8, 10_000


def steps(
    velocity: Velocity,
    start: Array,
    duration: float,
    tolerance: float,
    first_step: float | None = None,
    *,
    method: str = "DOP853",
    jacobian: Jacobian | None = None,
) -> Iterator[Solver]:
    """Yield the integrator after every step, until the duration is over.

    Parameters
    ----------
    velocity : callable, (n,) array to (n,) array
    start : (n,) array
    duration : float
    tolerance : float
        The error of a step stays below this times (1 + |y_i|), as root mean square over the y_i.
    first_step : float, optional
    method : str
        One of `METHODS`.
    jacobian : callable, (n,) array to (n, n) array, optional
        Jacobian of the velocity, for Radau; by differences if it is not given.

    Raises
    ------
    CannotFollow
        When the velocity is not finite at the start, when no step is short enough for the tolerance
        (for example because the motion diverges), or when more than 10^8 steps would be needed.
    """
    from scipy.integrate import DOP853, Radau

    def rate(_: float, y: Array) -> Array:
        # a trial step that overflows gets an error of NaN and is rejected; the sum is a fast test
        finite = math.isfinite(sum(y.tolist())) or np.isfinite(y).all()
        return velocity(y) if finite else np.full_like(y, np.nan)

    with _silent():
        given: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "first_step": first_step}
        solver: Solver
        if method == "DOP853":
            solver = DOP853(rate, 0.0, start, duration, **given)
        else:
            slopes = None if jacobian is None else lambda _, y: jacobian(y)
            solver = Radau(rate, 0.0, start, duration, jac=slopes, **given)
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
    **how: Any,
) -> Array:
    """Return the state, (n,), a duration >= 0 after the start; arguments as for `steps`."""
    state = start.copy()
    if duration > 0.0:
        for solver in steps(velocity, start, duration, tolerance, first_step, **how):
            state = np.array(solver.y)
    return state


class Step(Protocol):
    """A step of an integrator, with the motion within it."""

    begin: float
    time: float
    state: Array

    def path(self, time: float) -> Array:
        """Return the state, (d,), at a time within the step, by interpolation."""

    def paths(self, times: Sequence[float]) -> Sequence[Array]:
        """Return the states at several times."""
        return [self.path(time) for time in times]

    def cut_short(self, duration: float) -> Array:
        """Return the state, (d,), a duration after the step's begin, without interpolation."""

    def reach(self, row: Array) -> float:
        """Return a bound on how far the product of a row, (d,), and the state changes."""

    def avoids(self, section: PoincareSection, value: float) -> bool:
        """Whether the step certainly does not reach a section that has `value` at its begin.

        The distance is that from a plane or a phase at the begin of the step.
        """
        if isinstance(section, Hyperplane):
            row, distance = section.gradient(self.state), abs(value)
        elif isinstance(section, Stroboscope):
            row, distance = np.eye(len(self.state))[-1], math.asin(min(abs(value), 1.0))
        else:
            return False
        return self.reach(row) < 0.99 * distance


@final
class IntegratedStep(Step):
    """A step with its interpolation; `cut_short` integrates again to any time in the step."""

    def __init__(
        self, solver: Solver, velocity: Velocity, start: Array, tolerance: float, **how: Any
    ) -> None:
        self.begin, self.time, self.state = float(solver.t_old), float(solver.t), solver.y.copy()
        self._start, self._velocity, self._tolerance = start, velocity, tolerance
        self._path, self._how = solver.dense_output(), how

    def path(self, time: float) -> Array:
        return np.asarray(self._path(time))

    def paths(self, times: Sequence[float]) -> Sequence[Array]:
        return list(self._path(np.array(times)).T)

    def cut_short(self, duration: float) -> Array:
        # a step cut short is at least as accurate as the step
        return integrate(
            self._velocity, self._start, duration, self._tolerance, duration, **self._how
        )

    def reach(self, row: Array) -> float:
        # the interpolation is a sum of vectors with factors between 0 and 1
        path: Any = self._path
        vectors = path.Q.T if self._how["method"] == "Radau" else path.F
        return float(abs(vectors @ row).sum())


def integrated_steps(
    velocity: Velocity, tolerance: float, start: Array, duration: float, **how: Any
) -> Iterator[IntegratedStep]:
    """Yield every step until the duration is over; arguments as for `steps`."""
    for solver in steps(velocity, start, duration, tolerance, **how):
        step = IntegratedStep(solver, velocity, start, tolerance, **how)
        yield step
        start = step.state


def _silent() -> np.errstate:
    """Context without warnings: an overflow in a trial step is no error."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")
