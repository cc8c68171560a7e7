"""The replaceable parts of a continuation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

from dynkit.continuation.corrector import Corrector, NewtonCorrector
from dynkit.continuation.predictor import Predictor, cubic
from dynkit.continuation.step_control import AdaptiveSteps, StepControl
from dynkit.continuation.test_functions import TESTS, TestFunction
from dynkit.core.validation import positive_integer


@final
@dataclass(frozen=True)
class ContinuationMethod:
    """The parts of a continuation, for `continue_by`.

    Parameters
    ----------
    predictor : Predictor
        Guesses the next point; `dynkit.continuation.predictor` has `cubic` and `tangent`.
    corrector : Corrector
        Finds the point near a guess.
    steps : StepControl
        Chooses the step sizes.
    tests : tuple of TestFunction
        Test functions in addition to the events of the problem. Bifurcations of other kinds are not
        detected.
    points : int
        Largest number of points in each direction.

    Examples
    --------
    A tangent predictor with steps of one size:

    >>> from dataclasses import dataclass
    >>> from dynkit import continue_by, periodic_orbit
    >>> from dynkit.continuation.predictor import tangent
    >>> from dynkit.systems import Henon
    >>> @dataclass(frozen=True)
    ... class EqualSteps:
    ...     first: float = 0.02
    ...     smallest: float = 1e-6
    ...
    ...     def shorter(self, step):
    ...         return 0.5 * step
    ...
    ...     def next(self, before, after, taken):
    ...         return self.first
    >>> method = ContinuationMethod(predictor=tangent, steps=EqualSteps())
    >>> orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    >>> continue_by(method, orbit, "a", bounds=(-0.1, 1.4)).bifurcations
    (<PD at a 0.3675>,)
    """

    predictor: Predictor = cubic
    corrector: Corrector = field(default_factory=NewtonCorrector)
    steps: StepControl = field(default_factory=AdaptiveSteps)
    tests: tuple[TestFunction, ...] = TESTS
    points: int = 2000

    def __post_init__(self) -> None:
        positive_integer("points", self.points)
