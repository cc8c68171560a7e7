"""The correlation dimension: known sets, sets without one, and what is shown of it."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from scipy import signal

from dynkit import MapAttractor
from dynkit.analysis import CorrelationDimension
from dynkit.analysis.dimension.coordinates import angles_of, correlation_time, extents_of
from dynkit.analysis.dimension.scaling import TOLERANCE, Outcome
from dynkit.analysis.dimension.sums import Norm
from dynkit.core.cost import Cost
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.labels.label import OrbitLabel
from dynkit.plotting.figures import new_figure
from dynkit.systems import Henon, HighBounce, ImpactChain

TURN = 2.0 * np.pi


def uniform(n: int, d: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(size=(n, d))


def embedded(angles: Array) -> Array:
    return np.concatenate([np.cos(TURN * angles), np.sin(TURN * angles)], axis=1)


def cantor(n: int) -> Array:
    digits = np.random.default_rng(0).integers(0, 2, size=(n, 32))
    return (digits @ (2.0 * 3.0 ** -np.arange(1.0, 33.0)))[:, None]


@pytest.fixture(scope="module")
def henon() -> CorrelationDimension:
    return CorrelationDimension(
        MapAttractor(Henon(), np.array([0.1, 0.1]), transient=100, iterations=20_000)
    )


# --- known sets ---------------------------------------------------------------------------------


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
@pytest.mark.parametrize(
    ("states", "known"),
    [
        (embedded(uniform(5000, 1)), 1.0),
        (embedded(uniform(20_000, 2)), 2.0),
        (cantor(10_000), np.log(2.0) / np.log(3.0)),
    ],
    ids=["circle", "torus", "Cantor set"],
)
def test_dimension_of_a_set_is_the_known_one(states: Array, known: float, norm: Norm) -> None:
    found = CorrelationDimension(states, norm=norm)
    assert found.outcome is Outcome.FOUND
    assert abs(found.value - known) < 2.0 * found.error
    assert found.error < TOLERANCE * known


@pytest.mark.parametrize("d", [1, 2, 3, 4])
def test_dimension_of_noise_is_that_of_its_space(d: int) -> None:
    found = CorrelationDimension(np.random.default_rng(d).normal(size=(20_000, d)), theiler=0)
    assert abs(found.value - d) < 2.0 * found.error
    assert found.error < TOLERANCE * d


def test_dimension_of_the_attractor_of_henon_is_the_known_one(henon: CorrelationDimension) -> None:
    # 1.21: P. Grassberger, I. Procaccia, Phys. Rev. Lett. 50 (1983) 346-349, from 15,000 states;
    # 1.22: J. C. Sprott, G. Rowlands, Int. J. Bifurcation Chaos 11 (2001) 1865-1880
    assert 1.21 - 2.0 * henon.error < henon.value < 1.22 + 2.0 * henon.error
    assert henon.error < TOLERANCE * henon.value


def test_torus_of_angles_has_the_dimension_of_the_torus() -> None:
    found = CorrelationDimension(TURN * uniform(10_000, 2), angles={0: TURN, -1: TURN})
    assert abs(found.value - 2.0) < 2.0 * found.error


def test_noise_of_many_dimensions_has_no_scaling_region() -> None:
    # 4.5e6 pairs: the radius changes by a factor of 4.5e6^(1/9) = 5.5 from one pair to all of them
    found = CorrelationDimension(np.random.default_rng(0).normal(size=(3000, 9)))
    assert found.outcome is Outcome.NONE
    assert found.region is None
    assert np.isnan(found.value)
    assert np.isnan(found.takens.value)
    assert found.error == np.inf
    assert found.bounds is None
    assert found.points is None


def test_chaos_of_many_dimensions_has_no_scaling_region() -> None:
    chain = ImpactChain(frequency=0.36, damping=0.001)
    found = CorrelationDimension(chain.attractor(transient=3000, impacts=3000))
    assert found.outcome is Outcome.NONE
    assert "none: there is no scaling region of 4:1 or more; 3000 states" in repr(found)


# --- finite sets --------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [1, 2, 7])
def test_periodic_orbit_is_a_set_of_dimension_zero(period: int) -> None:
    found = CorrelationDimension(np.tile(uniform(period, 3), (100, 1)))
    assert found.outcome is Outcome.FINITE
    assert (found.value, found.error, found.bounds) == (0.0, 0.0, (0, 1))
    assert found.points == period


@pytest.mark.parametrize(("frequency", "period"), [(0.87, 1), (0.34, 5)], ids=["P(1,3)", "P(5,2)"])
def test_impacts_of_a_periodic_orbit_are_a_set_of_dimension_zero(
    frequency: float, period: int
) -> None:
    attractor = ImpactChain(frequency=frequency).attractor(transient=3000, impacts=500)
    found = CorrelationDimension(attractor)
    assert found.outcome is Outcome.FINITE
    assert (found.value, found.points) == (0.0, period)


def test_states_that_are_all_zero_are_one_point() -> None:
    assert CorrelationDimension(np.zeros((100, 2))).outcome is Outcome.FINITE


def test_dimension_of_narrow_bands_is_that_within_them() -> None:
    bands = 1e-5 * uniform(6000, 1) + np.tile([[0.0], [1.0]], (3000, 1))
    found = CorrelationDimension(bands)
    assert found.outcome is Outcome.FOUND
    assert found.region is not None
    assert found.region.high <= 1e-5
    assert abs(found.value - 1.0) < 2.0 * found.error


def test_one_repeated_state_does_not_make_a_finite_set() -> None:
    states = uniform(3000, 1)
    states[-1] = states[0]
    found = CorrelationDimension(states)
    assert found.outcome is Outcome.FOUND
    assert abs(found.value - 1.0) < 2.0 * found.error


# --- the scaling region -------------------------------------------------------------------------


def test_scaling_region_is_no_shorter_than_asked_for() -> None:
    states = np.random.default_rng(1).normal(size=(3000, 4))
    short, none = (CorrelationDimension(states, least_ratio=ratio) for ratio in (2.0, 64.0))
    assert short.region is not None
    assert short.region.ratio > 2.0 - 1e-9
    assert none.outcome is Outcome.NONE


def test_slope_of_the_region_is_that_of_the_line_of_least_squares(
    henon: CorrelationDimension,
) -> None:
    region, sums = henon.region, henon.sums
    assert region is not None
    inside = (sums.radii >= region.low) & (sums.radii <= region.high)
    line = np.polyfit(np.log(sums.radii[inside]), np.log(sums.values[inside]), 1)
    assert henon.value == pytest.approx(line[0], rel=1e-10)


def test_dimension_lies_between_the_local_slopes_of_its_region(henon: CorrelationDimension) -> None:
    region, slopes = henon.region, henon.local_slopes
    assert region is not None
    inside = (slopes.radii > region.low) & (slopes.radii < region.high)
    assert slopes.values[inside].min() < henon.value < slopes.values[inside].max()


def test_units_change_nothing_but_the_radii(henon: CorrelationDimension) -> None:
    scaled = CorrelationDimension(1024.0 * henon.states, theiler=henon.window)
    assert scaled.region is not None
    assert henon.region is not None
    assert scaled.region.low == 1024.0 * henon.region.low
    assert (scaled.value, scaled.error) == (henon.value, henon.error)


@pytest.mark.parametrize(
    ("states", "bounds"),
    [(embedded(uniform(3000, 1)), (1, 3)), (Henon().iterate(np.array([0.1, 0.1]), 5000), (2, 5))],
    ids=["circle", "Henon"],
)
def test_bounds_are_the_dimension_rounded_up_and_twice_that_and_one(
    states: Array, bounds: tuple[int, int]
) -> None:
    assert CorrelationDimension(states).bounds == bounds


# --- what it is made from -----------------------------------------------------------------------


def test_attractor_and_its_states_give_the_same(henon: CorrelationDimension) -> None:
    assert CorrelationDimension(henon.states).value == henon.value


class OnDemand(Attractor):
    """States that nobody may ask for, but once."""

    asked = 0

    @property
    def system(self) -> Map:
        return Henon()

    @property
    def transient(self) -> int:
        return 0

    @property
    def states(self) -> Array:
        self.asked += 1
        return uniform(200, 2)

    @property
    def label(self) -> OrbitLabel:
        raise NotImplementedError

    @property
    def cost(self) -> Cost:
        raise NotImplementedError

    @property
    def error(self) -> float:
        raise NotImplementedError

    def time_series(self, times: Array) -> Array:
        raise NotImplementedError


def test_everything_is_computed_on_demand_and_once() -> None:
    source = OnDemand()
    found = CorrelationDimension(source)
    assert source.asked == 0
    assert found.sums is found.sums
    assert found.takens is found.takens
    assert source.asked == 1


def test_states_that_are_changed_later_change_nothing() -> None:
    states = uniform(200, 1)
    found = CorrelationDimension(states)
    states[:] = 0.0
    assert found.diameter > 0.5


@pytest.mark.parametrize("norm", ["maximum", "euclidean"])
def test_diameter_bounds_all_distances(norm: Norm) -> None:
    states = uniform(100, 3)
    found = CorrelationDimension(states, norm=norm)
    gaps = abs(states[:, None] - states)
    distances = gaps.max(axis=2) if norm == "maximum" else np.linalg.norm(gaps, axis=2)
    assert found.diameter >= distances.max()
    assert norm == "euclidean" or found.diameter == distances.max()


@pytest.mark.parametrize("n", [1000, 4000, 12_000])
def test_errors_of_sets_with_wide_gaps_cover_their_dimension(n: int) -> None:
    # A baker's map that contracts two strips to a: the curve is a staircase with steps from slope 1
    # to 2, a factor 1 / a wide; on average its slope is 1 + ln 2 / ln(1 / a).
    random, covered = np.random.default_rng(n), 0
    for contraction in random.uniform(0.005, 0.1, 12):
        strips = random.integers(0, 2, n + 100).astype(float)
        x = signal.lfilter([0.5], [1.0, -0.5], strips[::-1])[::-1]
        y = signal.lfilter([1.0 - contraction], [1.0, -contraction], np.append(0.0, strips[:-1]))
        found = CorrelationDimension(np.stack([x, y], axis=1)[50:-50])
        exact = 1.0 - np.log(2.0) / np.log(contraction)
        covered += abs(found.value - exact) <= 2.0 * found.error
        covered += abs(found.takens.value - exact) <= 2.0 * found.takens.error
    assert covered >= 21  # two errors cover 95 %: of 24, fewer than 21 in 3 % of such tests


def test_largest_radius_is_a_tenth_of_the_diameter(henon: CorrelationDimension) -> None:
    assert henon.sums.radii[-1] == pytest.approx(0.1 * henon.diameter)
    wider = CorrelationDimension(henon.states[:500], largest=1.0)
    assert wider.sums.radii[-1] == 1.0


def test_a_radius_beyond_all_states_does_not_make_them_one_point() -> None:
    states = np.random.default_rng(0).normal(size=(300, 3))
    found = CorrelationDimension(states, largest=1e9)
    assert found.outcome is Outcome.NONE
    assert found.sums.radii[-1] == found.diameter


@pytest.mark.parametrize("n", [1, 2, 3, 50, 51])
def test_extent_of_an_angle_is_its_largest_distance(n: int) -> None:
    states = 20.0 * uniform(n, 1, seed=n)
    gaps = abs(states[:, 0, None] - states[:, 0]) % TURN
    extent = np.minimum(gaps, TURN - gaps).max()
    assert extents_of(states, {0: TURN})[0] == pytest.approx(extent, abs=1e-12)


def test_correlation_time_is_that_of_the_memory() -> None:
    noise = np.random.default_rng(0).normal(size=20_000)
    states = np.zeros((20_000, 1))
    for i in range(1, len(states)):
        states[i] = 0.9 * states[i - 1] + noise[i]
    # 0.9^lag < 1/e from lag 9.49 on; over 20,000 states the autocorrelation is known to 3%
    assert abs(correlation_time(states, {}) - 10) <= 1


def test_window_is_a_twentieth_of_the_states_at_most() -> None:
    assert CorrelationDimension(uniform(1000, 1)).window == 50
    assert CorrelationDimension(uniform(3000, 1)).window == 100
    slow = CorrelationDimension(np.linspace(0.0, 1.0, 4000)[:, None])
    assert slow.window == 200


# --- angles of attractors -----------------------------------------------------------------------


def test_angle_of_the_impact_chain_is_found() -> None:
    attractor = ImpactChain(frequency=1.346).attractor(transient=500, impacts=200)
    assert dict(CorrelationDimension(attractor).turns) == {19: TURN}


def test_angle_of_the_high_bounce_ball_is_found() -> None:
    ball = HighBounce(restitution=0.5, gamma=8.0)
    assert angles_of(ball, ball.iterate(np.array([0.1, 0.1]), 300)) == {0: TURN}


def test_map_without_angles_has_none(henon: CorrelationDimension) -> None:
    assert henon.turns == {}


class Mixing(Henon):
    """A map whose differences are more than wrapped coordinates."""

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.asarray(a) - np.asarray(b)
        return np.asarray(gap @ np.array([[1.0, 0.0], [0.5, 1.0]]))


def test_differences_that_do_more_than_wrap_are_refused() -> None:
    attractor = MapAttractor(Mixing(), np.array([0.1, 0.1]), transient=10, iterations=100)
    with pytest.raises(ValueError, match="source must be of a system whose difference only wraps"):
        assert CorrelationDimension(attractor).turns


# --- what is shown ------------------------------------------------------------------------------


def test_repr_shows_dimension_region_and_what_was_counted(henon: CorrelationDimension) -> None:
    assert henon.region is not None
    shown = repr(henon)
    assert shown.startswith(f"CorrelationDimension({henon.value:.4g} +- {henon.error:.2g}, r from ")
    assert f"{henon.region.ratio:.3g}:1" in shown
    assert shown.endswith("20000 states, maximum norm, Theiler window 100)")


def test_cost_counts_distances(henon: CorrelationDimension) -> None:
    assert henon.cost.counts["distances"] == henon.sums.cost.counts["distances"] > 0
    assert henon.cost.seconds > henon.sums.cost.seconds


def test_sums_are_drawn_with_the_line_of_their_region(henon: CorrelationDimension) -> None:
    _, (axes,) = new_figure()
    assert henon.plot(axes) is axes
    points, line = axes.get_lines()
    assert henon.region is not None
    assert np.asarray(points.get_xdata()).size == (henon.sums.pairs > 0).sum()
    across = np.asarray(line.get_xdata())
    assert (across[0], across[-1]) == (henon.region.low, henon.region.high)
    assert f"over {np.log10(henon.region.ratio):.1f} decades" in axes.get_title()


def test_slopes_are_drawn_with_both_estimates(henon: CorrelationDimension) -> None:
    _, (axes,) = new_figure()
    assert henon.plot_slopes(axes, label="Henon") is axes
    _, dimension, takens = axes.get_lines()
    assert np.asarray(dimension.get_ydata()).tolist() == [henon.value] * 2
    assert np.asarray(takens.get_ydata()).tolist() == [henon.takens.value] * 2


def test_missing_region_is_said_in_the_title() -> None:
    _, (axes,) = new_figure()
    CorrelationDimension(uniform(100, 9)).plot_slopes(axes)
    assert axes.get_title() == "there is no scaling region"


def test_plot_needs_no_display() -> None:
    code = (
        "import numpy as np; from dynkit.analysis import CorrelationDimension as D;"
        "d = D(np.random.default_rng(0).uniform(size=(500, 1))); d.plot(); d.plot_slopes()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"source": uniform(63, 2)}, "source must have 64 states or more; got 63"),
        ({"source": [[0.0], [np.inf]]}, r"states\[1, 0\] must be a finite number; got inf"),
        ({"norm": "taxi"}, "norm must be one of: maximum, euclidean; got 'taxi'"),
        ({"theiler": 99}, "theiler must not exceed 98 for 100 states; got 99"),
        ({"largest": 0.0}, "largest must be positive; got 0.0"),
        ({"least_ratio": 1.0}, "least_ratio must be at least 1.5; got 1.0"),
        ({"least_ratio": np.nan}, "least_ratio must be a finite number; got nan"),
        ({"angles": {5: 1.0}}, r"angles must name coordinates in \[-2, 1\]; got 5"),
    ],
)
def test_argument_is_refused(given: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"source": uniform(100, 2), **given}
    with pytest.raises(ValueError, match=f"^{message}$"):
        CorrelationDimension(**arguments)


def test_angles_of_an_attractor_are_refused() -> None:
    with pytest.raises(ValueError, match="angles must be left to the system of an attractor"):
        CorrelationDimension(OnDemand(), angles={0: 1.0})


def test_a_bad_window_is_refused_before_an_attractor_is_simulated() -> None:
    with pytest.raises(ValueError, match=r"^theiler must be zero or a positive integer; got nan$"):
        CorrelationDimension(OnDemand(), theiler=np.nan)  # type: ignore[arg-type]


def test_a_ratio_may_be_any_integer() -> None:
    assert CorrelationDimension(uniform(100, 2), least_ratio=2**80).region is None


def test_radius_in_the_rounding_of_the_states_is_refused() -> None:
    found = CorrelationDimension(uniform(100, 1), largest=1e-12)
    with pytest.raises(ValueError, match="largest must not be less than"):
        assert found.sums.total


def test_a_shorter_range_is_sought_in_the_same_sums() -> None:
    states = np.random.default_rng(0).uniform(size=(2000, 2))
    found = CorrelationDimension(states)
    anew = CorrelationDimension(states, least_ratio=2.0)
    assert found.region_over(2.0) == anew.region
    assert found.region_over(1e6) is None
    with pytest.raises(ValueError, match=r"least_ratio must be at least 1\.5; got 1\.4"):
        found.region_over(1.4)
