"""The checks of attractors pass what conforms, and name the defect of what does not."""

from functools import partial

import numpy as np
import pytest

from dynkit import testing
from dynkit.core.cost import Cost
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor, MapAttractor
from dynkit.dynamics.map import Map
from dynkit.dynamics.section import PoincareSection
from dynkit.labels.label import OrbitLabel
from dynkit.systems import Henon, Logistic


@pytest.mark.parametrize("check", testing.attractor_checks, ids=testing.check_name)
@pytest.mark.parametrize("system", [Henon(), Logistic(3.2)], ids=repr)
def test_attractors_conform(check: testing.AttractorCheck, system: Map) -> None:
    check(partial(MapAttractor, system, np.full(system.dimension, 0.1)))


def henon_attractor(transient: int, states: int) -> MapAttractor:
    return MapAttractor(Henon(), np.array([0.1, 0.1]), transient, states)


class Wrapped(Attractor):
    """An attractor as good as the one it wraps; its subclasses spoil one thing each."""

    def __init__(self, transient: int, kept: int) -> None:
        self.inner = henon_attractor(transient, kept)

    @property
    def system(self) -> SmoothMap:
        return self.inner.system

    @property
    def transient(self) -> int:
        return self.inner.transient

    @property
    def states(self) -> Array:
        return self.inner.states

    @property
    def label(self) -> OrbitLabel:
        return self.inner.label

    @property
    def cost(self) -> Cost:
        return self.inner.cost

    @property
    def error(self) -> float:
        return self.inner.error

    def time_series(self, times: Array) -> Array:
        return self.inner.time_series(times)

    def section(self, section: PoincareSection) -> Array:
        return self.inner.section(section)


class KeepsOneMore(Wrapped):
    @property
    def states(self) -> Array:
        return henon_attractor(self.transient, len(self.inner.states) + 1).states


class ForgetsTransient(Wrapped):
    @property
    def transient(self) -> int:
        return 0


class Writeable(Wrapped):
    @property
    def states(self) -> Array:
        return self.inner.states.copy()


class Wavering(Wrapped):
    made = 0

    def __init__(self, transient: int, kept: int) -> None:
        super().__init__(transient, kept)
        Wavering.made += 1
        self.number = Wavering.made

    @property
    def error(self) -> float:
        return float(self.number)


class SkipsOneMore(Wrapped):
    @property
    def states(self) -> Array:
        skipped = self.transient + (1 if self.transient else 0)
        return henon_attractor(skipped, len(self.inner.states)).states


class EndsEarlier(Wrapped):
    @property
    def final(self) -> Array:
        return np.asarray(self.inner.states[-2])


class LastsLonger(Wrapped):
    @property
    def duration(self) -> float:
        return 2.0 * self.inner.duration


class DrivenByCompany(Wrapped):
    def time_series(self, times: Array) -> Array:
        return super().time_series(times) + 1e-12 * len(times)


class FlatSection(Wrapped):
    def section(self, section: PoincareSection) -> Array:
        return super().section(section)[:, 0]


class NegativeError(Wrapped):
    @property
    def error(self) -> float:
        return float("nan")


BROKEN_ATTRACTORS: list[tuple[type[Wrapped], testing.AttractorCheck, str]] = [
    (KeepsOneMore, testing.attractor_states_have_the_shape, "the states has shape"),
    (ForgetsTransient, testing.attractor_states_have_the_shape, "the transient is kept"),
    (Writeable, testing.attractor_states_have_the_shape, "the states are read-only"),
    (Wavering, testing.attractor_is_deterministic, "the error is deterministic"),
    (SkipsOneMore, testing.transient_skips_states, "the transient skips states"),
    (EndsEarlier, testing.attractor_goes_on, "the attractor goes on"),
    (LastsLonger, testing.attractor_goes_on, "the durations add up"),
    (DrivenByCompany, testing.time_series_does_not_depend_on_company, "same bits alone"),
    (FlatSection, testing.attractor_has_sections, "the section has shape"),
    (NegativeError, testing.attractor_says_cost_and_error, "the error is not negative"),
]


def test_a_wrapped_attractor_conforms() -> None:
    testing.check_attractor(Wrapped)


@pytest.mark.parametrize(("make", "check", "message"), BROKEN_ATTRACTORS)
def test_a_broken_attractor_is_caught_by_name(
    make: testing.MakeAttractor, check: testing.AttractorCheck, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check(make)
    with pytest.raises(AssertionError):
        testing.check_attractor(make)
