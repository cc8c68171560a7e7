"""Proper orthogonal decomposition: exact averages, samples, errors, the paper's mode counts."""

from __future__ import annotations

import re
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import signal

from dynkit.analysis import POD
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import MapAttractor
from dynkit.plotting.figures import new_figure
from dynkit.systems import Henon, ImpactChain, MatrixOscillator

# Frequency, damping and number of modes for 99% of the power: J. P. Cusumano, B.-Y. Bai, Chaos,
# Solitons & Fractals 3 (1993) 515-535, Table 1. Of the paper's ten rows two are as an independent
# computation has them: the chaos of 1.336 stands at 1.346, with the same number, and 1.916 needs 4
# modes, not 3 (98.6% with three).
TABLE_1 = [
    (0.34, 0.1, 3),
    (0.35, 0.1, 3),
    (0.36, 0.1, 3),
    (0.36, 0.01, 5),
    (0.36, 0.001, 7),
    (0.40816, 0.1, 2),
    (0.870, 0.1, 5),
    (1.346, 0.1, 4),
    (1.750, 0.1, 5),
    (1.916, 0.1, 4),
]


def pod_of(frequency: float, damping: float = 0.1, impacts: int = 3000, **choices: Any) -> POD:
    chain = ImpactChain(frequency=frequency, damping=damping)
    return POD(chain.attractor(transient=700, impacts=impacts), **choices)


# --- the paper's numbers --------------------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "damping", "count"), TABLE_1)
def test_modes_for_99_percent_are_those_of_table_1(
    frequency: float, damping: float, count: int
) -> None:
    assert pod_of(frequency, damping).rank(0.99) == count


@pytest.mark.parametrize(("frequency", "damping", "count"), TABLE_1)
def test_mode_counts_are_certain(frequency: float, damping: float, count: int) -> None:
    pod = pod_of(frequency, damping, impacts=20_000)
    distance = abs(pod.cumulative[count - 2 : count] - 0.99)
    # five standard errors; those of Student's t with 31 degrees of freedom pass once in 50,000
    assert (distance > 5.0 * pod.cumulative_errors[count - 2 : count]).all()


@pytest.mark.parametrize(("frequency", "damping", "count"), TABLE_1[::3])
def test_samples_as_in_the_paper_give_the_same_count(
    frequency: float, damping: float, count: int
) -> None:
    chain = ImpactChain(frequency=frequency, damping=damping)
    step = np.pi / chain.natural_frequencies[-1]
    samples = chain.attractor().time_series(step * np.arange(20_000))
    assert POD(samples[:, :10]).rank(0.99) == count


# --- exact averages -------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [0.35, 0.408, 0.87])
@pytest.mark.parametrize("steps", [4_000, 16_000, 64_000])
def test_samples_miss_the_exact_average_by_no_more_than_second_order(
    frequency: float, steps: int
) -> None:
    chain = ImpactChain(frequency=frequency)
    attractor = chain.attractor(impacts=50)
    end = float(attractor.record.time[-1])
    times = np.linspace(0.0, end, steps + 1)
    series = attractor.time_series(times)
    x, v = series[:, :10], series[:, 10:]
    found, exact = POD(x, times), POD(attractor)
    # The trapezoidal rule misses a smooth f by at most end h^2 max |f''| / 12, and a jump J of f'
    # by J h^2 / 8. Here f = x_i x_j, and f'' = x_i'' x_j + 2 v_i v_j + x_i x_j'' is bounded by the
    # largest positions, velocities and accelerations; the samples come within 1% of them.
    acceleration = abs(x @ chain.stiffness.T + v @ chain.damping_matrix.T).max()
    second = 2.0 * (abs(x).max() * acceleration + abs(v).max() ** 2) * 1.01**2
    r = chain.restitution
    jumps = 2.0 * abs(x[:, -1]).max() * (1.0 + 1.0 / r) * attractor.record.relative_velocity.sum()
    h = end / steps
    bound = h**2 * (second / 12.0 + jumps / 8.0 / end)
    assert abs(found.matrix - exact.matrix).max() < bound + exact.error


def test_error_with_times_covers_the_distance_to_the_exact_average() -> None:
    attractor = ImpactChain(frequency=0.87).attractor(impacts=50)
    times = np.linspace(0.0, float(attractor.record.time[-1]), 20_001)
    found = POD(attractor.time_series(times)[:, :10], times)
    exact = POD(attractor)
    assert abs(found.power - exact.power).max() < found.error < 1e-3 * exact.power[0]


def test_motion_of_whole_periods_has_the_average_of_one() -> None:
    attractor = ImpactChain(frequency=0.87).attractor(transient=3000, impacts=32)
    once = POD(attractor.system.simulate(impacts=1, start=attractor.final))
    # both are of one orbit, which its transient has reached to rounding
    assert POD(attractor).power == pytest.approx(once.power, rel=0.0, abs=1e-13)


def test_error_bounds_what_rounding_does() -> None:
    attractor = ImpactChain(frequency=0.35).attractor(impacts=200)
    moments = attractor.second_moments(200)
    pod = POD(attractor)
    other = moments.products.sum(axis=0) / moments.durations.sum()
    assert abs(other - pod.matrix).max() <= pod.error


def test_record_and_attractor_have_the_same_powers() -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    assert np.array_equal(POD(attractor).power, POD(attractor.record).power)


def test_map_attractor_has_the_powers_of_its_states() -> None:
    attractor = MapAttractor(Henon(), np.zeros(2), transient=100, iterations=1000)
    assert np.array_equal(POD(attractor).power, POD(attractor.states).power)


def test_averages_are_worked_out_when_asked_for_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    asked: list[int] = []
    exact = type(attractor).second_moments

    def counted(self: Any, batches: int) -> Any:
        asked.append(batches)
        return exact(self, batches)

    monkeypatch.setattr(type(attractor), "second_moments", counted)
    pod = POD(attractor)
    assert not asked
    pod.rank(0.99), pod.standard_errors, pod.error, pod.cost
    assert len(asked) == 1


def test_samples_may_be_changed_afterwards() -> None:
    x = np.eye(3)
    pod = POD(x)
    x[:] = 9.0
    assert pod.power == pytest.approx([1.0 / 3.0] * 3, rel=1e-15)


def test_record_knows_its_normal_modes() -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    found = POD(attractor.record).modal_assurance()
    assert np.array_equal(found, POD(attractor).modal_assurance())


# --- what a decomposition is ----------------------------------------------------------------------

samples = arrays(np.float64, (12, 4), elements=st.floats(-1.0, 1.0, width=16)).filter(np.any)


@given(samples)
def test_modes_are_orthonormal(x: Array) -> None:
    assert POD(x).modes.T @ POD(x).modes == pytest.approx(np.eye(4), abs=1e-14)


@given(samples)
def test_powers_sum_up_to_the_mean_square(x: Array) -> None:
    assert POD(x).power.sum() == pytest.approx((x**2).sum() / len(x), rel=1e-13)


@given(samples)
def test_modes_and_powers_give_the_matrix_back(x: Array) -> None:
    pod = POD(x)
    assert pod.modes * pod.power @ pod.modes.T == pytest.approx(x.T @ x / len(x), abs=1e-14)


@given(samples, st.floats(0.01, 1.0))
def test_rank_is_the_first_number_of_modes_that_holds_the_share(x: Array, share: float) -> None:
    pod = POD(x)
    k = pod.rank(share)
    assert pod.cumulative[k - 1] >= share
    assert k == 1 or pod.cumulative[k - 2] < share


def test_about_the_mean_the_matrix_is_the_covariance() -> None:
    x = np.random.default_rng(1).normal(3.0, [1.0, 2.0, 0.5], (500, 3))
    found = POD(x, about="mean").matrix
    assert found == pytest.approx(np.cov(x.T, bias=True), rel=1e-12)


def test_exact_average_about_the_mean_is_that_about_the_origin_less_the_mean() -> None:
    about_mean, about_origin = pod_of(0.35, about="mean"), pod_of(0.35)
    mean = about_origin.mean
    expected = about_origin.matrix - np.outer(mean, mean)
    assert about_mean.matrix == pytest.approx(expected, rel=0.0, abs=about_mean.error)


@pytest.mark.parametrize("count", [300, 3000])
@pytest.mark.parametrize("jitter", [0.3, 30.0])
def test_error_with_uneven_times_covers_the_distance_to_the_closed_form(
    count: int, jitter: float
) -> None:
    end = 200.0 * np.pi
    for seed in range(50):
        even, moved = (
            np.linspace(0.0, end, count),
            np.random.default_rng(seed).uniform(-1.0, 1.0, count),
        )
        times = np.sort(np.clip(even + jitter * end / count * moved, 0.0, end))[1:-1]
        times = np.unique([0.0, *times, end])
        found = POD(np.stack([np.sin(times), 2.0 * np.cos(times)], axis=1), times)
        assert found.power == pytest.approx([2.0, 0.5], rel=0.0, abs=found.error)


def mean_square(sizes: Array, rates: Array, phases: Array, end: float) -> float:
    """Average of (sum of sizes * cos(rates * t + phases))^2 from 0 to the end."""
    total = 0.0
    for sign in (1.0, -1.0):
        rate = rates[:, None] + sign * rates
        phase = phases[:, None] + sign * phases
        # sin(a + b) - sin(b) = 2 cos(a / 2 + b) sin(a / 2), and np.sinc(x) is sin(pi x) / (pi x)
        part = np.cos(0.5 * rate * end + phase) * np.sinc(0.5 * rate * end / np.pi)
        total += float((0.5 * np.outer(sizes, sizes) * part).sum())
    return total


def test_error_with_even_times_is_never_exceeded_from_ten_samples_in_the_shortest_period() -> None:
    random = np.random.default_rng(0)
    exceeded = 0
    for _ in range(2000):
        waves = int(random.integers(1, 4))
        rates = random.uniform(0.5, 1.0, waves) * np.arange(1, waves + 1)
        sizes, phases = random.normal(size=waves), random.uniform(0.0, 2.0 * np.pi, waves)
        end = 10.0 ** random.uniform(0.3, 1.7)
        samples = random.uniform(10.0, 60.0) * end * rates.max() / (2.0 * np.pi)
        times = np.linspace(0.0, end, max(int(samples), 10) + 2)
        found = POD(np.cos(np.outer(times, rates) + phases) @ sizes[:, None], times)
        exceeded += abs(found.power[0] - mean_square(sizes, rates, phases, end)) > found.error
    assert exceeded == 0


def test_two_samples_with_times_have_no_error_estimate() -> None:
    assert POD([[1.0], [2.0]], [0.0, 1.0]).error == np.inf


def test_times_weigh_samples_by_the_trapezoidal_rule() -> None:
    x, times = np.array([[1.0], [2.0], [4.0]]), np.array([0.0, 1.0, 3.0])
    # squares 1, 4, 16 with the weights 1/2, 3/2, 1, of sum 3
    assert POD(x, times).power[0] == pytest.approx(7.5, rel=1e-15)


# --- standard errors ------------------------------------------------------------------------------


def autoregressive(seed: int, correlation: float, count: int) -> Array:
    """Two independent stationary sequences x' = c x + noise, of variances 4 and 1."""
    noise = np.random.default_rng(seed).normal(size=(count, 2))
    noise[1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -correlation], noise, axis=0) * [2.0, 1.0])


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.98, -0.9])
def test_twice_the_error_covers_the_powers_as_often_as_it_should(correlation: float) -> None:
    trials = 200
    # squares are correlated over (1 + c^2) / (1 - c^2) samples; batches last five times as long
    count = int(5 * 32 * (1.0 + correlation**2) / (1.0 - correlation**2))
    hits = 0
    for seed in range(trials):
        pod = POD(autoregressive(seed, correlation, count))
        hits += int((abs(pod.power - [4.0, 1.0]) < 2.0 * pod.standard_errors).sum())
    # 95% of 2 * 200, less three standard deviations of that binomial count
    assert hits >= 0.95 * 2 * trials - 3.0 * np.sqrt(0.95 * 0.05 * 2 * trials)


def test_standard_error_of_independent_samples_is_that_of_a_mean() -> None:
    ratios = []
    for seed in range(100):
        x = autoregressive(seed, 0.0, 3200)
        ratios.append(POD(x).standard_errors / ((x**2).std(axis=0) / np.sqrt(len(x))))
    # from 12 waves, or 6 where these are larger: 1.25 times, as Student's t has it
    mean = float(np.sqrt(np.mean(np.square(ratios))))
    assert 1.0 < mean < 1.5


def test_one_batch_has_no_finite_standard_error() -> None:
    record = ImpactChain(frequency=0.87).attractor(impacts=1).record
    assert np.isinf(POD(record).standard_errors).all()


def test_cumulative_error_of_all_modes_is_zero() -> None:
    assert pod_of(0.35).cumulative_errors[-1] < 1e-15


# --- normal modes ---------------------------------------------------------------------------------


def test_modal_assurance_of_its_own_modes_is_one() -> None:
    pod = pod_of(0.35)
    assert pod.modal_assurance(3.0 * pod.modes) == pytest.approx(np.eye(10), abs=1e-13)


def test_modal_assurance_with_orthogonal_modes_sums_up_to_one() -> None:
    assurance = pod_of(0.35).modal_assurance()
    assert assurance.sum(axis=0) == pytest.approx(np.ones(10), rel=1e-13)
    assert assurance.sum(axis=1) == pytest.approx(np.ones(10), rel=1e-13)


def test_first_modes_of_the_sticking_orbit_are_near_normal_modes() -> None:
    # the paper's figure 14 draws them on top of one another
    assert np.diagonal(pod_of(0.40816).modal_assurance())[:2].min() > 0.98


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "times", "message"),
    [
        ([[1.0, 2.0]], None, "source must hold two samples or more; got shape (1, 2)"),
        ([1.0, 2.0], None, "source must have 2 dimensions; got shape (2,)"),
        (Henon(), None, "source must be an attractor, a record or an array; got Henon("),
        ([[1.0], [np.nan]], None, "source[1, 0] must be a finite number; got nan"),
        (
            np.zeros((3, 2)),
            None,
            "source must move about its origin by a mean square of more than rounding, 0; got 0",
        ),
        ([[1.0], [2.0]], [0.0], "times must have shape (2,); got shape (1,)"),
        ([[1.0], [2.0]], [1.0, 1.0], "times[1] must exceed times[0]; got 1.0"),
    ],
)
def test_bad_samples_are_refused(source: Any, times: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        POD(source, times)


@pytest.mark.parametrize(
    ("unit", "limit"), [(1e200, "not exceed 1e+145 in"), (1e-200, "be zero, or at least 1e-145 in")]
)
def test_samples_whose_squares_are_no_numbers_are_refused(unit: float, limit: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"source must {limit} size; got {unit:g}")):
        POD([[unit], [0.5 * unit]])


@pytest.mark.parametrize("unit", [1e-200, 1e200])
def test_modal_assurance_does_not_depend_on_units(unit: float) -> None:
    assurance = POD([[3.0, 0.0], [0.0, 1.0]]).modal_assurance(unit * np.eye(2))
    assert assurance == pytest.approx(np.eye(2), abs=1e-15)


def test_constant_samples_do_not_move_about_their_mean() -> None:
    with pytest.raises(ValueError, match="source must move about its mean"):
        POD(np.full((9, 2), 0.1), about="mean")


@pytest.mark.parametrize("about", ["centre", np.array([]), np.array(["origin", "mean"])])
def test_unknown_moments_are_refused(about: Any) -> None:
    with pytest.raises(ValueError, match=r"^about must be one of: origin, mean; got "):
        POD(np.ones((3, 2)), about=about)


def test_times_of_an_exact_average_are_refused() -> None:
    attractor = ImpactChain(frequency=0.87).attractor()
    with pytest.raises(ValueError, match="times must not be given with a motion whose averages"):
        POD(attractor, [0.0, 1.0])


@pytest.mark.parametrize("share", [0.0, -0.1, 1.1, float("nan"), "all"])
def test_share_outside_of_its_range_is_refused(share: Any) -> None:
    with pytest.raises(ValueError, match="share must "):
        POD(np.eye(3)).rank(share)


def test_modes_must_be_given_for_samples() -> None:
    with pytest.raises(ValueError, match="modes must be given: the source has no normal modes"):
        POD(np.eye(3)).modal_assurance()


def test_zero_mode_is_refused() -> None:
    with pytest.raises(ValueError, match=re.escape("modes[:, 1] must not be zero")):
        POD(np.eye(2)).modal_assurance([[1.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(("count", "limit"), [(5, "exceed the 3 modes; got 5"), (0, "a positive")])
def test_number_of_modes_to_draw_is_limited(count: int, limit: str) -> None:
    with pytest.raises(ValueError, match=limit):
        POD(np.eye(3)).plot_modes(count=count, modes=np.eye(3))


def test_as_many_axes_as_modes_are_asked_for() -> None:
    _, axes = new_figure(rows=2)
    with pytest.raises(ValueError, match="ax must hold 3 axes; got 2"):
        POD(np.eye(3)).plot_modes(axes, count=3, modes=np.eye(3))


# --- figures --------------------------------------------------------------------------------------


def test_cumulative_power_is_drawn() -> None:
    pod = pod_of(0.35, impacts=100)
    _, (axes,) = new_figure()
    assert pod.plot(axes, label="chaos") is axes
    assert np.array_equal(axes.lines[0].get_ydata(), pod.cumulative)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("number of modes", "cumulative power")


def test_curves_of_one_picture_differ_without_colour() -> None:
    _, (axes,) = new_figure()
    for _ in range(3):
        POD(np.eye(3)).plot(axes)
    drawn = [line for line in axes.lines if len(np.asarray(line.get_xdata())) == 3]
    assert len({line.get_linestyle() for line in drawn}) == 3
    assert len({line.get_marker() for line in drawn}) == 3


def test_modes_are_drawn_beside_the_nearest_normal_ones() -> None:
    pod = pod_of(0.40816, impacts=300)
    figure = Figure()
    panels: list[Axes] = list(figure.subplots(2, 2).ravel())
    assert pod.plot_modes(panels) == panels
    for k, panel in enumerate(panels):
        own, other = (np.asarray(line.get_ydata()) for line in panel.lines[1:])
        assert np.array_equal(own, pod.modes[:, k])
        assert (own @ other) ** 2 == pytest.approx(pod.modal_assurance()[k].max(), rel=1e-12)


def test_few_modes_and_modes_of_samples_are_drawn() -> None:
    from matplotlib import pyplot as plt

    of_machine = POD(ImpactChain(masses=2, frequency=0.87).attractor()).plot_modes()
    assert [len(panel.lines) for panel in of_machine] == [3, 3]
    of_samples = POD(np.eye(3) * [3.0, 2.0, 1.0]).plot_modes()
    assert [len(panel.lines) for panel in of_samples] == [2, 2, 2]
    assert [panel.get_title() for panel in of_samples] == ["mode 1", "mode 2", "mode 3"]
    plt.close("all")


@pytest.mark.parametrize("count", [1, 3])
def test_modes_get_a_figure_of_their_own(count: Literal[1, 3]) -> None:
    from matplotlib import pyplot as plt

    panels = POD(np.eye(3) * [3.0, 2.0, 1.0]).plot_modes(count=count, modes=np.eye(3))
    assert len(panels) == count
    plt.close(panels[0].get_figure(root=True))


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (1e-156, r"root mean squares of positions must be zero, or at least 1e-145 in size; got "),
        (1e160, r"modal coordinates must not exceed 1e\+145 in size; got "),
    ],
)
def test_averages_whose_squares_are_out_of_range_are_refused(size: float, message: str) -> None:
    system = MatrixOscillator(
        M=[[1.0]], C=[[0.1]], K=[[1.0]], frequency=2.8, amplitude=0.0, harmonic_forces=(size,)
    )
    start = system.state([0.7 * size], [0.3 * size])
    attractor = system.attractor(start=start, transient=10, impacts=50)
    with pytest.raises(ValueError, match=message):
        POD(attractor).power  # noqa: B018
