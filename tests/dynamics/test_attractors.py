import re

import numpy as np
import pytest
from mpmath import mp, mpf

from dynkit.core.no_motion import Diverged, NoCrossing, Refused
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import MapAttractor
from dynkit.dynamics.map import Map
from dynkit.dynamics.poincare_map import PoincareMap
from dynkit.dynamics.section import Hyperplane
from dynkit.labels.label import OrbitKind
from dynkit.systems import DelayedLogistic, Henon, ImpactChain, Logistic
from tests.example_systems import CircleRotation, DampedRotation, ShiftedLogistic

GOLDEN_TURN = np.pi * (np.sqrt(5.0) - 1.0)


def logistic(rate: float, transient: int = 700, iterations: int = 100) -> MapAttractor:
    return MapAttractor(Logistic(rate), np.array([0.3]), transient, iterations)


def henon(transient: int = 700, iterations: int = 100) -> MapAttractor:
    return MapAttractor(Henon(), np.array([0.1, 0.1]), transient, iterations)


# Period doublings of the logistic map: P(2) from 3, P(4) from 1 + sqrt(6) = 3.44949; P(3) from
# 1 + sqrt(8) = 3.82843 (S. H. Strogatz, Nonlinear Dynamics and Chaos, 1994, section 10.2 to 10.4).
@pytest.mark.parametrize(
    ("rate", "label"),
    [
        (2.8, "P(1)"),
        (2.99, "P(1)"),
        (3.001, "P(2)"),
        (3.2, "P(2)"),
        (3.449, "P(2)"),
        (3.4496, "P(4)"),
        (3.5, "P(4)"),
        (3.8285, "P(3)"),
        (3.83, "P(3)"),
        (3.8282, "chaotic"),
        (4.0, "chaotic"),
    ],
)
def test_the_logistic_map_has_its_known_label(rate: float, label: str) -> None:
    assert str(logistic(rate).label) == label


# The motion covers 0.3 to 0.7 sizes: 3e-14 to 7e-8 of its distance to the origin.
@pytest.mark.parametrize(
    ("offset", "size", "rate", "labels"),
    [
        (1e3, 1e-8, 2.8, {"P(1)"}),
        (1e6, 1e-6, 2.8, {"P(1)"}),
        (1e3, 1e-4, 3.55, {"P(8)"}),
        (1e3, 1e-4, 3.7, {"chaotic"}),
        (1e3, 1e-6, 3.55, {"P(8)", "unsettled"}),
        (1e3, 1e-8, 3.2, {"P(2)", "unsettled"}),
        (1e3, 1e-10, 3.2, {"P(2)", "unsettled"}),
        (1e6, 1e-6, 3.5, {"P(4)", "unsettled"}),
        (1e6, 1e-6, 3.7, {"chaotic", "unsettled"}),
    ],
)
def test_a_small_motion_far_from_the_origin_has_no_wrong_label(
    offset: float, size: float, rate: float, labels: set[str]
) -> None:
    shifted = ShiftedLogistic(rate=rate, offset=offset, size=size)
    attractor = MapAttractor(shifted, np.array([offset + 0.3 * size]), 700, 100)
    assert str(attractor.label) in labels


class ShiftedDelay(Map):
    """The delayed logistic map in coordinates far from its origin, without a jacobian."""

    dimension = 2

    def __init__(self, rate: float, offset: float) -> None:
        self.rate, self.offset = rate, offset

    def __call__(self, state: Array) -> Array:
        x, y = state - self.offset
        return np.array([self.rate * x * (1.0 - y), x]) + self.offset


@pytest.mark.parametrize("rate", [2.05, 2.1])
def test_an_invariant_circle_far_from_the_origin_has_no_period(rate: float) -> None:
    """Its states 205 apart are near, in relation to the offset and not to the circle."""
    offset = 2.0**20
    start = offset + np.array([0.47, 0.47])
    label = MapAttractor(ShiftedDelay(rate, offset), start, 3000, 2000).label
    assert label.kind in (OrbitKind.QUASI_PERIODIC, OrbitKind.UNSETTLED)


def test_at_the_period_doubling_itself_the_motion_is_unsettled() -> None:
    assert logistic(3.0).label.kind is OrbitKind.UNSETTLED


@pytest.mark.parametrize(("a", "label"), [(0.3, "P(1)"), (0.9, "P(2)"), (1.0, "P(4)")])
def test_the_henon_map_has_its_known_periods(a: float, label: str) -> None:
    # period doublings at 3 (1 - b)^2 / 4 = 0.3675 and (1 - b)^2 + (1 + b)^2 / 4 = 0.9125, b = 0.3
    attractor = MapAttractor(Henon(a), np.array([0.1, 0.1]), 700, 100)
    assert str(attractor.label) == label


def test_the_henon_attractor_is_chaotic() -> None:
    assert henon().label.kind is OrbitKind.CHAOTIC


def test_a_rotation_by_the_golden_angle_is_quasi_periodic() -> None:
    rotation = MapAttractor(CircleRotation(GOLDEN_TURN), np.array([0.1, 1.0]), 100, 100)
    assert str(rotation.label) == "quasi-periodic, rotation number 0.381966"


# The circle of the delayed logistic map is born at rate 2 and breaks up near 2.2; the Lyapunov
# exponents, over 50,000 iterates of the plain formulas: 1e-5 at 2.1, 0.016 at 2.245.
@pytest.mark.parametrize(
    ("rate", "label"),
    [
        *((1.98, "P(1)"), (2.01, "quasi-periodic"), (2.1, "quasi-periodic")),
        *((2.19, "P(7)"), (2.245, "chaotic")),
    ],
)
def test_the_delayed_logistic_map_has_its_known_label(rate: float, label: str) -> None:
    attractor = MapAttractor(DelayedLogistic(rate), np.array([0.1, 0.1]), 700, 100)
    assert attractor.label.name == label


def test_a_rational_rotation_recurs_across_the_end_of_its_angle() -> None:
    rotation = MapAttractor(CircleRotation(2.0 * np.pi * 3 / 7), np.array([0.0, 1.0]), 100, 100)
    assert str(rotation.label) == "P(7)"


def test_a_superstable_orbit_is_periodic() -> None:
    # at rate 2 the fixed point 1/2 is the maximum
    assert str(logistic(2.0).label) == "P(1)"


def test_a_poincare_map_has_attractors_too() -> None:
    section = Hyperplane(np.array([0.0, 1.0, 0.0]))
    system = PoincareMap(DampedRotation(damping=0.0), section, time_limit=10.0)
    attractor = MapAttractor(system, np.array([1.0, 1.0]), transient=20, iterations=40)
    assert str(attractor.label) == "P(1)"


def test_states_are_the_iterates_after_the_transient() -> None:
    expected = Henon().iterate(np.array([0.1, 0.1]), 29)[20:]
    assert henon(20, 10).states.tolist() == expected.tolist()


def test_the_label_is_worked_out_once() -> None:
    attractor = henon()
    assert attractor.label is attractor.label


def test_the_error_of_a_stable_orbit_is_of_rounding_size() -> None:
    assert 0.0 < logistic(3.2).error < 1e-14


def test_the_error_in_chaos_is_of_the_size_of_the_attractor() -> None:
    assert 0.5 < logistic(4.0).error < 1.0


def test_the_error_bounds_what_rounding_does_before_chaos_takes_over() -> None:
    attractor = logistic(4.0, transient=0, iterations=30)
    with mp.workdps(50):
        x, off = mpf(0.3), 0.0
        for state in attractor.states[:, 0].tolist():
            off = max(off, abs(float(state - x)))
            x = 4 * x * (1 - x)
    assert off < attractor.error < 30.0 * off


def test_the_error_is_that_of_calls_that_are_less_accurate_than_rounding() -> None:
    # calls off by 1e-9 of states between 1/2 and 1; the cycle's multiplier is 0.16
    attractor = MapAttractor(RoughLogistic(3.2), np.array([0.3]), 700, 100)
    # so at most by 1.2e-9
    assert 1.2e-9 < attractor.error < 4e-9


class RoughLogistic(Logistic):
    @property
    def accuracy(self) -> float:
        return 1e-9


@pytest.mark.parametrize("refusal", [Refused, NoCrossing])
def test_the_error_is_infinite_when_a_twin_runs_away(refusal: type[Exception]) -> None:
    # at the edge of the basin rounding decides
    attractor = MapAttractor(Edge(refusal), np.array([1.0]), transient=0, iterations=200)
    assert attractor.error == np.inf


class Edge(Map):
    """A fixed point at 1 from which all else leaves, upwards for ever."""

    def __init__(self, refusal: type[Exception]) -> None:
        self.refusal = refusal

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        if abs(state[0] - 1.0) > 0.5:
            raise self.refusal("state must lie in [0.5, 1.5]")
        return 1.0 + 3.0 * (state - 1.0)

    def jacobian(self, state: Array) -> Array:
        return np.array([[3.0]])


def test_the_time_series_goes_on_beyond_what_was_kept() -> None:
    expected = henon(20, 60).states[[0, 55, 3]]
    assert henon(20, 10).time_series(np.array([0, 55, 3])).tolist() == expected.tolist()


@pytest.mark.parametrize(("time", "shown"), [(-1.0, "-1.0"), (0.5, "0.5")])
def test_a_time_series_refuses_times_between_iterates(time: float, shown: str) -> None:
    message = f"times[1] must be zero or a positive integer; got {shown}"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        henon(0, 5).time_series(np.array([0.0, time]))


def test_a_section_holds_the_states_just_beyond_it() -> None:
    attractor = henon()
    points = attractor.section(Hyperplane(np.array([1.0, 0.0])))
    x = attractor.states[:, 0]
    expected = attractor.states[1:][(x[1:] >= 0.0) & (x[:-1] < 0.0)]
    assert points.tolist() == expected.tolist()


def test_a_section_of_the_other_direction_holds_the_states_below() -> None:
    points = henon().section(Hyperplane(np.array([1.0, 0.0]), direction=-1))
    assert len(points) > 0
    assert (points[:, 0] <= 0.0).all()


@pytest.mark.parametrize(
    ("start", "transient", "iterations", "message"),
    [
        ([0.1, np.nan], 1, 1, "start[1] must be a finite number; got nan"),
        ([0.1], 1, 1, "start must have shape (2,); got shape (1,)"),
        ([0.1, 0.1], -1, 1, "transient must be zero or a positive integer; got -1"),
        ([0.1, 0.1], 1, 0, "iterations must be a positive integer; got 0"),
    ],
)
def test_bad_arguments_are_refused(
    start: list[float], transient: int, iterations: int, message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        MapAttractor(Henon(), np.array(start), transient, iterations)


def test_a_motion_that_runs_away_is_refused() -> None:
    with pytest.raises(
        Diverged, match=r"^the motion runs away: state\[0\] is -inf after 9 iterates$"
    ):
        MapAttractor(Henon(), np.array([5.0, 5.0]), 100, 10)


def test_the_cost_counts_iterates() -> None:
    assert henon(20, 10).cost.counts == {"iterates": 29}


def test_a_map_gives_its_attractors_as_an_impact_oscillator_does() -> None:
    found = Henon().attractor(start=[0.1, 0.1], transient=20, keep=30)
    assert np.array_equal(found.states, MapAttractor(Henon(), np.array([0.1, 0.1]), 20, 30).states)
    assert np.array_equal(found.observable("state[1]"), found.states[:, 1])
    later = Henon().attractor(start=found.final, transient=0, keep=5).states
    assert np.array_equal(later, found.time_series(np.arange(29.0, 34.0)))
    chain = ImpactChain(masses=2, frequency=0.9)
    kept, named = chain.attractor(transient=5, keep=7), chain.attractor(transient=5, impacts=7)
    assert kept.states.tobytes() == named.states.tobytes()


def test_a_map_needs_a_start_and_a_number_is_given_once() -> None:
    with pytest.raises(ValueError, match=r"start must be a state of the map, \(2,\); got None"):
        Henon().attractor()
    with pytest.raises(ValueError, match="keep must not be given beside impacts; got 7"):
        ImpactChain(frequency=0.9).attractor(keep=7, impacts=7)
    with pytest.raises(ValueError, match="keep must be a positive integer; got 0"):
        ImpactChain(frequency=0.9).attractor(keep=0)
    with pytest.raises(ValueError, match="keep must be a positive integer; got -1"):
        Henon().attractor(start=[0.1, 0.1], keep=-1)
    with pytest.raises(ValueError, match=r"name must be one of: state\[0\], state\[1\]; got 'x'"):
        Henon().attractor(start=[0.1, 0.1]).observable("x")
