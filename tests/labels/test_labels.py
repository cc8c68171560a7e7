"""Labels of motions whose kind is known beforehand."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dynkit.core.no_motion import Diverged
from dynkit.core.validation import Array
from dynkit.labels.label import OrbitKind, OrbitLabel
from dynkit.labels.labelling import Window, attraction, label_orbit, with_multiplier
from dynkit.labels.recurrence import _STEEPEST, _Decay

Numbers = NDArray[np.int64]
StateAt = Callable[[Numbers], Array]


@dataclass
class Synthetic:
    """An orbit given in closed form: state and time as functions of the number of the state."""

    state_at: StateAt
    time_at: StateAt | None = None
    release_every: int | None = None
    growth_rate: float = -0.1
    ends_after: int | None = None
    accuracy: float = 2.0**-52
    given: int = field(default=0, init=False)

    def more(self, count: int) -> Window:
        stop = self.given + count
        if self.ends_after is not None:
            stop = min(stop, self.ends_after)
        number = np.arange(self.given, stop, dtype=np.int64)
        self.given = stop
        times = None if self.time_at is None else self.time_at(number)
        if self.release_every is None:
            return Window(self.state_at(number), times)
        released = number[number % self.release_every == 0] // self.release_every
        chatter = np.zeros((len(number), 2))
        assert self.time_at is not None
        release_times = self.time_at(released)
        return Window(
            chatter,
            self.time_at(number // self.release_every),
            self.state_at(released),
            release_times,
        )

    def difference(self, a: Array, b: Array) -> Array:
        return np.subtract(a, b)

    def growth(self, steps: int) -> Array:
        noise = np.random.default_rng(3).normal(scale=0.3, size=steps)
        return np.asarray(self.growth_rate + noise - noise.mean())


def cycle(n: int, dimension: int = 4, seed: int = 0) -> StateAt:
    points: Array = np.random.default_rng(seed).normal(size=(n, dimension))
    return lambda number: np.asarray(points[number % n])


def settling(n: int, ratio: float, amplitude: float = 0.3, seed: int = 1) -> StateAt:
    """A cycle, and a disturbance that is multiplied by the ratio over each period."""
    exact = cycle(n)
    shape = np.random.default_rng(seed).normal(size=(n, 4))

    def state_at(number: Numbers) -> Array:
        decay = np.sign(ratio) ** (number // n) * np.abs(ratio) ** (number // n)
        return np.asarray(exact(number) + amplitude * decay[:, None] * shape[number % n])

    return state_at


def split(n: int, separation: float) -> StateAt:
    """A cycle of length 2n whose halves differ by the separation: a period doubling just passed."""
    exact = cycle(n)
    return lambda number: exact(number) + separation / 2 * np.cos(np.pi * (number // n))[:, None]


def noisy(state_at: StateAt, level: float) -> StateAt:
    def disturbed(number: Numbers) -> Array:
        states = state_at(number)
        noise = np.random.default_rng(int(number[0])).normal(size=states.shape)
        return states + level * noise

    return disturbed


def regular_times(n: int, m: int) -> StateAt:
    """Times of n unequal steps in m table periods."""
    steps = np.random.default_rng(5).uniform(0.5, 1.5, size=n)
    within = np.concatenate([[0.0], np.cumsum(steps)[:-1]]) * m / steps.sum()
    return lambda number: number // n * m + within[number % n]


def label_of(state_at: StateAt, n: int = 1, m: int = 1) -> OrbitLabel:
    return label_orbit(Synthetic(state_at, regular_times(n, m)))


@pytest.mark.parametrize(
    ("n", "m"), [(1, 3), (1, 6), (2, 5), (7, 1), (5, 2), (33, 4), (39, 15), (74, 32), (601, 97)]
)
def test_an_exact_cycle_gets_its_period(n: int, m: int) -> None:
    assert str(label_of(cycle(n), n, m)) == f"P({n},{m})"


@pytest.mark.parametrize("n", [1, 2, 39])
@pytest.mark.parametrize("level", [1e-15, 1e-12, 1e-9])
def test_noise_below_the_tolerance_does_not_change_the_period(n: int, level: float) -> None:
    assert str(label_of(noisy(cycle(n), level), n, 2)) == f"P({n},2)"


@pytest.mark.parametrize("level", [1e-4, 1e-2])
def test_noise_above_the_tolerance_is_unsettled(level: float) -> None:
    assert label_of(noisy(cycle(2), level), 2, 1).kind is OrbitKind.UNSETTLED


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("ratio", [0.2, -0.2, -0.5, 0.87, -0.9, 0.97, 0.99, -0.99])
def test_a_motion_that_settles_gets_the_period_it_settles_on(n: int, ratio: float) -> None:
    assert str(label_of(settling(n, ratio), n, 3)) == f"P({n},3)"


class Attracted(Synthetic):
    """An orbit whose derivative over a period is a number, known to the label."""

    derivative = 0.9

    def more(self, count: int) -> Window:
        def known(*_: object) -> tuple[float, bool]:
            factors = np.full((1, 1, 1), self.derivative)
            return attraction(factors, factors, self.accuracy)

        return replace(super().more(count), attraction=known)


@pytest.mark.parametrize(("n", "most"), [(1, 2), (2, 4), (5, 4)])
def test_a_motion_that_recurs_is_decided_by_few_comparisons(n: int, most: int) -> None:
    """From the last state or period to all others, and from period to period of each divisor."""
    compared: list[int] = []

    class Counted(Synthetic):
        def difference(self, a: Array, b: Array) -> Array:
            compared.append(len(b))
            return super().difference(a, b)

    label = label_orbit(Counted(cycle(n), regular_times(n, 2)))
    assert str(label) == f"P({n},2)"
    assert len(compared) <= most


def bent(number: Numbers) -> Array:
    """A decay to an orbit of one state, whose rate changes once, as on the way round a focus."""
    logs = -0.16 * number - 2.0 * np.cos(number / 40.0)
    return np.asarray(1.0 + np.array([0.3, -0.2]) * np.exp(logs)[:, None])


def test_an_orbit_that_attracts_by_its_derivative_is_no_matter_of_a_fit() -> None:
    source = Attracted(bent, regular_times(1, 2))
    label = label_orbit(source, kept=90)
    assert (str(label), label.simulated) == ("P(1,2)", 90)
    assert label_orbit(Synthetic(bent, regular_times(1, 2)), kept=90).simulated > 90


@pytest.mark.parametrize("derivative", [1.0 - 1e-9, 1.0, 1.1, np.nan, np.inf])
def test_an_orbit_that_does_not_attract_is_left_to_the_fit(derivative: float) -> None:
    source = Attracted(bent, regular_times(1, 2))
    source.derivative = derivative
    assert label_orbit(source, kept=90).simulated > 90


def test_a_derivative_does_not_hide_a_doubled_period() -> None:
    def doubled(number: Numbers) -> Array:
        return np.asarray(bent(number) + split(1, 3e-8)(number)[:, :2])

    assert str(label_orbit(Attracted(doubled, regular_times(1, 2)), kept=122)) == "P(2,4)"


@pytest.mark.parametrize("multiplier", [0.5 + 0.4j, -0.3 + 0.8j, -0.9 + 0.2j, 0.1 + 0.3j])
@pytest.mark.parametrize("period", range(1, 13))
def test_the_error_of_a_multiplier_holds_while_a_complex_pair_turns(
    multiplier: complex, period: int
) -> None:
    """The change of the modulus vanishes now and then, the change of the pair does not."""

    def derivatives(k: int) -> Array:
        now = multiplier + 1e-3 * multiplier**k
        return np.array([[[now.real, -now.imag], [now.imag, now.real]]])

    label = OrbitLabel(OrbitKind.PERIODIC, 1, 1, 1e-6, 1e-7, 100)
    known = with_multiplier(label, derivatives(period), derivatives(period - 1), 2.0**-52)
    assert abs(known.multiplier - abs(multiplier)) <= known.multiplier_error
    assert known.multiplier_error < 0.1 * abs(multiplier) ** period


@pytest.mark.parametrize("multiple", [2, 3])
def test_rounding_does_not_choose_a_multiple_of_the_period(multiple: int) -> None:
    """The last states recur to 1e-13, and by chance better after some periods than after one."""
    decay = settling(1, 0.5, amplitude=1e-7)

    def state_at(number: Numbers) -> Array:
        return np.asarray(decay(number) + 1e-13 * (number % multiple)[:, None])

    assert str(label_of(state_at, 1, 2)) == "P(1,2)"


def test_a_fast_decay_does_not_hide_the_slow_one_beside_a_period_doubling() -> None:
    """The multipliers are 0.8 and -0.9995, and the first disturbance is larger at first."""
    ratios, sizes = np.array([0.8, -0.9995]), np.array([0.3, 1e-4])

    def state_at(number: Numbers) -> Array:
        return np.asarray(1.0 + sizes * ratios ** number[:, None])

    class Known(Synthetic):
        def more(self, count: int) -> Window:
            def known(n: int, _: object) -> tuple[float, bool]:
                factors = np.array([np.diag(ratios)] * n)
                return attraction(factors, factors, self.accuracy)

            return replace(super().more(count), attraction=known)

    given = state_at, regular_times(1, 1)
    assert str(label_orbit(Synthetic(*given), kept=50)) == "P(2,2)"
    assert str(label_orbit(Known(*given), kept=50)) == "P(1,1)"


@pytest.mark.parametrize("ratio", [0.999, -0.999])
def test_slow_settling_is_seen_within_the_budget(ratio: float) -> None:
    assert str(label_of(settling(1, ratio), 1, 3)) == "P(1,3)"


@pytest.mark.parametrize("budget", [1000, 3000, 10000])
def test_settling_too_slow_for_the_budget_is_unsettled(budget: int) -> None:
    source = Synthetic(settling(1, 0.9999), regular_times(1, 1))
    assert label_orbit(source, budget=budget).kind is OrbitKind.UNSETTLED


def test_settling_like_a_power_of_time_is_not_taken_for_geometric() -> None:
    exact = cycle(1)
    slow = label_of(lambda number: exact(number) * (1.0 + 1.0 / (1.0 + number[:, None])), 1, 1)
    assert slow.kind is OrbitKind.UNSETTLED


@pytest.mark.parametrize("n", [1, 3, 8])
@pytest.mark.parametrize("separation", [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9])
def test_a_small_period_doubling_is_not_overlooked(n: int, separation: float) -> None:
    assert str(label_of(split(n, separation), 2 * n, 4)) == f"P({2 * n},4)"


@pytest.mark.parametrize("separation", [1e-3, 1e-5, 1e-7])
def test_a_noisy_period_doubling_is_not_overlooked(separation: float) -> None:
    assert label_of(noisy(split(1, separation), 1e-12), 2, 2).iterates == 2


@pytest.mark.parametrize("separation", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("ratio", [0.6, 0.9, 0.97])
def test_a_motion_that_settles_on_a_doubled_orbit_gets_the_doubled_period(
    separation: float, ratio: float
) -> None:
    disturbance = settling(1, ratio)
    doubled = split(1, separation)

    def state_at(number: Numbers) -> Array:
        return doubled(number) + disturbance(number) - cycle(1)(number)

    assert label_of(state_at, 2, 2).iterates == 2


def test_a_motion_that_leaves_an_unstable_orbit_is_not_given_its_period() -> None:
    leaving = Synthetic(settling(1, 1.15, amplitude=1e-13), regular_times(1, 1))
    assert label_orbit(leaving, kept=100, budget=110).kind is OrbitKind.UNSETTLED


def test_bounces_of_one_chatter_are_not_a_period() -> None:
    chatter = Synthetic(
        lambda number: np.full((len(number), 2), 0.7), lambda number: 1.0 - 0.85 ** (number / 10)
    )
    assert label_orbit(chatter).kind is not OrbitKind.PERIODIC


@pytest.mark.parametrize(("releases", "m"), [(1, 2), (2, 4), (3, 3)])
def test_sticking_is_labelled_by_its_releases(releases: int, m: int) -> None:
    source = Synthetic(cycle(releases), regular_times(releases, m), release_every=80)
    label = label_orbit(source)
    assert (label.kind, label.iterates, str(label)) == (OrbitKind.STICKING, None, f"P(inf,{m})")


def test_slowly_settling_sticking_is_labelled_within_the_budget() -> None:
    label = label_orbit(Synthetic(settling(1, 0.87), regular_times(1, 2), release_every=80))
    assert str(label) == "P(inf,2)"


def test_the_looks_stay_within_the_budget() -> None:
    rotation = Synthetic(lambda number: np.stack([np.cos(number), np.sin(number)], axis=1))
    assert label_orbit(rotation, budget=5000).simulated <= 5000


def test_the_kept_states_are_always_looked_at() -> None:
    assert label_orbit(Synthetic(cycle(1)), kept=50, budget=10).iterates == 1


@pytest.mark.parametrize("kept", [1, 2, 3, 17, 1000])
def test_the_number_of_kept_states_does_not_matter(kept: int) -> None:
    assert str(label_orbit(Synthetic(cycle(5), regular_times(5, 2)), kept=kept)) == "P(5,2)"


def test_sticking_that_dies_out_is_forgotten() -> None:
    class Passing(Synthetic):
        def more(self, count: int) -> Window:
            window = super().more(count)
            if self.given > 100:
                return window
            assert window.times is not None
            return Window(window.states, window.times, window.states[:1], window.times[:1])

    assert str(label_orbit(Passing(cycle(3), regular_times(3, 2)))) == "P(3,2)"


def test_a_source_that_ends_has_no_impacts() -> None:
    label = label_orbit(Synthetic(cycle(7), ends_after=60))
    assert (label.kind, str(label)) == (OrbitKind.NO_IMPACTS, "no impacts")


def test_a_rotation_is_quasi_periodic() -> None:
    angle = np.pi * (np.sqrt(5.0) - 1.0)
    rotation = Synthetic(
        lambda number: np.stack([np.cos(angle * number), np.sin(angle * number)], axis=1),
        growth_rate=0.0,
    )
    assert label_orbit(rotation).kind is OrbitKind.QUASI_PERIODIC


def scattered(number: Numbers) -> Array:
    return np.random.default_rng(number).normal(size=(len(number), 20))


def test_growth_that_is_certain_makes_a_motion_chaotic() -> None:
    label = label_orbit(Synthetic(scattered, growth_rate=0.1))
    assert (label.kind, str(label)) == (OrbitKind.CHAOTIC, "chaotic")


@pytest.mark.parametrize("rate", [0.0, -0.1, 1e-9, -np.inf])
def test_growth_that_is_not_certain_leaves_a_motion_unsettled(rate: float) -> None:
    label = label_orbit(Synthetic(scattered, growth_rate=rate))
    assert (label.kind, str(label)) == (OrbitKind.UNSETTLED, "unsettled")


@dataclass
class Shearing(Synthetic):
    """Nearby states part as the square of time."""

    def growth(self, steps: int) -> Array:
        return np.diff(2.0 * np.log(np.arange(1.0, steps + 2.0)))


def test_growth_as_the_square_of_time_is_not_chaotic() -> None:
    assert label_orbit(Shearing(scattered)).kind is OrbitKind.UNSETTLED


def test_the_recurrence_found_is_that_of_the_window() -> None:
    label = label_of(noisy(cycle(1), 1e-9))
    assert 1e-9 < label.recurrence < 1e-8


def test_a_recurrence_above_the_tolerance_tells_of_extrapolation() -> None:
    label = label_orbit(Synthetic(settling(1, 0.9)), kept=85)
    assert label.iterates == 1
    assert label.tolerance < label.recurrence < 1e-5


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"kept": 0}, "kept must be a positive integer; got 0"),
        ({"budget": 1.5}, "budget must be a positive integer; got 1.5"),
        ({"tolerance": 0.0}, "tolerance must be positive; got 0.0"),
    ],
)
def test_bad_options_are_refused_by_name(option: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        label_orbit(Synthetic(cycle(1)), **option)


@pytest.mark.parametrize("count", [10, 11, 20, 100])
def test_no_decay_ends_farther_away_than_the_steepest(count: int) -> None:
    # of numbers in an interval, those at its ends, in the order of size, have the steepest line
    steps = np.where(np.arange(count) < count // 2, 1e4, 1.01e-13)
    steps[-1] = 1.01e-13
    assert _Decay.of(steps).rest * _STEEPEST > steps[-1]


def test_states_whose_squares_overflow_run_away() -> None:
    orbit = Synthetic(lambda n: 1e160 * np.exp2(n % 3)[:, None])
    with pytest.raises(Diverged, match="the motion runs away: states exceed 1e154"):
        label_orbit(orbit, kept=100)
