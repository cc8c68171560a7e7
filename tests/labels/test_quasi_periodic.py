"""Quasi-periodic motion, and motions that look like it: labels, rotation numbers, their errors."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dynkit import Basins, MapAttractor, basins, continue_orbit, parameter_map
from dynkit.core.validation import Array, finite_array
from dynkit.dynamics.map import Map
from dynkit.labels.label import OrbitKind, OrbitLabel, empty_columns, label_in, put_label
from dynkit.labels.labelling import Window, label_orbit
from dynkit.labels.recurrence import Recurrences
from dynkit.labels.rotation import Rotation, rotation_of
from dynkit.orbits.periodic_orbit import periodic_orbit
from dynkit.systems import DelayedLogistic, Henon, ImpactChain, Logistic
from tests.example_systems import CircleRotation

GOLDEN = (3.0 - np.sqrt(5.0)) / 2.0
ACCURACY = 2.0**-52


def distance(one: float, other: float) -> float:
    """Between rotation numbers of curves that have no orientation."""
    return abs(min(one % 1.0, -one % 1.0) - min(other % 1.0, -other % 1.0))


def turn_of(states: Array, curves: int = 1) -> Rotation | None:
    found = rotation_of(Recurrences(states, None, np.subtract), 1e-6, ACCURACY)
    assert found is None or found.curves == curves
    return found


# --- maps whose rotation numbers are known --------------------------------------------------------


@dataclass(frozen=True)
class Stroboscopic(Map):
    """x'' + x = 0.3 cos(frequency t), undamped, at multiples of the period of the force."""

    frequency: float

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        centre = np.array([0.3 / (1.0 - self.frequency**2), 0.0])
        moved = finite_array("state", state, (2,)) - centre
        return np.asarray(self.jacobian(state) @ moved + centre)

    def jacobian(self, state: Array) -> Array:
        finite_array("state", state, (2,))
        angle = 2.0 * np.pi / self.frequency
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, s], [-s, c]])


@dataclass(frozen=True)
class ArnoldCircle(Map):
    """An angle in turns: theta' = theta + shift + k sin(2 pi theta) / (2 pi), modulo 1."""

    shift: float
    k: float = 0.8

    @property
    def dimension(self) -> int:
        return 1

    def __call__(self, state: Array) -> Array:
        return np.asarray(self.lifted(finite_array("state", state, (1,))) % 1.0)

    def lifted(self, theta: Array) -> Array:
        wave = self.k * np.sin(2.0 * np.pi * theta) / (2.0 * np.pi)
        return np.asarray(theta + self.shift + wave)

    def jacobian(self, state: Array) -> Array:
        theta = finite_array("state", state, (1,))
        return np.diag(1.0 + self.k * np.cos(2.0 * np.pi * theta))

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.asarray(a) - np.asarray(b)
        return np.asarray(gap - np.rint(gap))


@dataclass(frozen=True)
class Alternating(Map):
    """(u, v) -> (v, F(u)): two iterates move u and v by F, so that F's circle becomes two."""

    inner: Map

    @property
    def dimension(self) -> int:
        return 2 * self.inner.dimension

    def __call__(self, state: Array) -> Array:
        u, v = np.split(finite_array("state", state, (self.dimension,)), 2)
        return np.concatenate([v, self.inner(u)])

    def jacobian(self, state: Array) -> Array:
        d = self.inner.dimension
        zero = np.zeros((d, d))
        return np.block([[zero, np.eye(d)], [self.inner.jacobian(state[:d]), zero]])

    def difference(self, a: Array, b: Array) -> Array:
        halves = zip(np.split(a, 2, axis=-1), np.split(b, 2, axis=-1), strict=True)
        return np.concatenate([self.inner.difference(u, v) for u, v in halves], axis=-1)


@dataclass(frozen=True)
class Standard(Map):
    """p' = p + k sin(2 pi q) / (2 pi), q' = q + p', both modulo 1: Chirikov's map."""

    k: float

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        q, p = finite_array("state", state, (2,))
        p = p + self.k * np.sin(2.0 * np.pi * q) / (2.0 * np.pi)
        return np.array([q + p, p]) % 1.0

    def jacobian(self, state: Array) -> Array:
        q, _ = finite_array("state", state, (2,))
        slope = self.k * np.cos(2.0 * np.pi * q)
        return np.array([[1.0 + slope, 1.0], [slope, 1.0]])

    def difference(self, a: Array, b: Array) -> Array:
        gap = np.asarray(a) - np.asarray(b)
        return np.asarray(gap - np.rint(gap))


def label(system: Map, start: list[float], transient: int = 3000, **options: int) -> OrbitLabel:
    attractor = MapAttractor(system, np.array(start), transient, 100)
    return attractor.label_within(options["budget"]) if options else attractor.label


KNOWN: dict[str, tuple[Map, list[float], float, int]] = {
    "rigid rotation of an angle": (CircleRotation(2.0 * np.pi * GOLDEN), [0.1, 1.0], GOLDEN, 1),
    "undamped oscillator at sqrt 2": (Stroboscopic(np.sqrt(2.0)), [0.4, 0.1], np.sqrt(0.5), 1),
    "undamped oscillator at 10 / pi": (Stroboscopic(10.0 / np.pi), [1.0, 0.0], np.pi / 10.0, 1),
    "two circles that alternate": (
        Alternating(CircleRotation(2.0 * np.pi * GOLDEN)),
        [0.1, 1.0, 2.0, 1.0],
        GOLDEN,
        2,
    ),
}
"""System, start, rotation number, curves."""


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_rotation_number_is_within_its_error(name: str) -> None:
    system, start, number, curves = KNOWN[name]
    found = label(system, start)
    assert (found.kind, found.curves) == (OrbitKind.QUASI_PERIODIC, curves)
    assert distance(found.rotation_number, number) <= found.rotation_error < 1e-10
    assert found.error <= found.tolerance


def test_the_circle_map_has_the_rotation_number_of_its_lift() -> None:
    system = ArnoldCircle(0.38)
    found = label(system, [0.2])
    theta = np.array([0.2])
    for _ in range(20_000):
        theta = system.lifted(theta)
    assert found.kind is OrbitKind.QUASI_PERIODIC
    assert distance(found.rotation_number, float(theta[0] - 0.2) / 20_000) < 1.0 / 20_000
    assert found.rotation_error < 1e-12


def mean_advance(system: ArnoldCircle, n: int = 100_000) -> float:
    """Mean advance with smooth weights: S. Das et al., Nonlinearity 30 (2017) 4111-4140."""
    theta = np.array([0.2])
    advances = np.empty(n - 1)
    for i in range(n - 1):
        before, theta = theta, system.lifted(theta % 1.0)
        advances[i] = (theta - before % 1.0)[0]
    times = np.arange(1, n) / n
    weights = np.exp(-1.0 / (times * (1.0 - times)))
    return float(weights @ advances / weights.sum())


# Distances of states 257, 206, 268 or 3 apart change geometrically for a while.
@pytest.mark.parametrize(
    ("shift", "k"),
    [(1.810, 0.5), (1.1141903171953258, 0.5), (2.6162771285475794, 0.5), (2.1036682167140537, 0.3)],
)
def test_a_circle_near_a_resonance_is_quasi_periodic(shift: float, k: float) -> None:
    system = ArnoldCircle(shift / (2.0 * np.pi), k)
    found = label(system, [0.2], 500)
    assert found.kind is OrbitKind.QUASI_PERIODIC
    assert distance(found.rotation_number, mean_advance(system)) <= found.rotation_error + 1e-11


@cache
def delayed_logistic(rate: float) -> OrbitLabel:
    return label(DelayedLogistic(rate), [0.1, 0.1], 15_000)


@pytest.mark.parametrize("rate", [2.002, 2.01, 2.02, 2.1, 2.15, 2.17])
def test_the_delayed_logistic_circle_turns_as_its_states_wind_about_the_fixed_point(
    rate: float,
) -> None:
    found = delayed_logistic(rate)
    states = DelayedLogistic(rate).iterate(np.array([0.1, 0.1]), 40_000)[20_000:] - 1.0 + 1.0 / rate
    angles = np.unwrap(np.arctan2(states[:, 1], states[:, 0]))
    assert (found.kind, found.curves) == (OrbitKind.QUASI_PERIODIC, 1)
    assert distance(found.rotation_number, (angles[-1] - angles[0]) / (40_000 * np.pi)) < 1e-4
    assert found.rotation_error < 1e-12


# The widest of Arnold's tongues that it crosses are those of 1/7, near 2.19, and 2/13.
@pytest.mark.parametrize(("rate", "name"), [(2.19, "P(7)"), (2.2, "P(7)")])
def test_mode_locking_is_periodic(rate: float, name: str) -> None:
    assert str(delayed_logistic(rate)) == name


def test_fewer_states_give_the_same_number_within_the_errors() -> None:
    few = label(DelayedLogistic(2.1), [0.1, 0.1], budget=6000)
    assert few.kind is OrbitKind.QUASI_PERIODIC
    difference = abs(few.rotation_number - delayed_logistic(2.1).rotation_number)
    assert difference <= few.rotation_error + delayed_logistic(2.1).rotation_error


# --- from the Neimark-Sacker bifurcation on -------------------------------------------------------


def test_the_bifurcation_knows_the_rotation_number_that_is_born() -> None:
    orbit = periodic_orbit(DelayedLogistic(1.9), np.array([[0.47, 0.47]]))
    (found,) = continue_orbit(orbit, "rate", bounds=(1.5, 2.5)).bifurcations
    assert found.rotation_number is not None
    assert found.rotation_error is not None
    assert abs(found.rotation_number - 1.0 / 6.0) <= found.rotation_error < 1e-12
    assert repr(found) == "<NS at rate 2, rotation number 0.166667>"
    # labels tend to it: a parabola through three of them
    rates = np.array([2.002, 2.005, 2.01])
    numbers = [delayed_logistic(float(rate)).rotation_number for rate in rates]
    assert abs(np.polyfit(rates - 2.0, numbers, 2)[-1] - found.rotation_number) < 1e-7


def test_other_bifurcations_have_no_rotation_number() -> None:
    orbit = periodic_orbit(Logistic(2.9), np.array([[1.0 - 1.0 / 2.9]]))
    (found,) = continue_orbit(orbit, "rate", bounds=(2.8, 3.2)).bifurcations
    assert found.rotation_number is found.rotation_error is None


@cache
def chain_of_two(frequency: float) -> OrbitLabel:
    chain = ImpactChain(masses=2, frequency=frequency, damping=0.001, restitution=0.9)
    return chain.attractor(transient=30_000, impacts=3000).label


def test_the_chain_turns_as_at_its_bifurcation() -> None:
    chain = ImpactChain(masses=2, frequency=1.5, damping=0.001, restitution=0.9)
    orbits = chain.periodic_orbits(periods=1)
    branches = [continue_orbit(orbit, "frequency", bounds=(1.47, 1.55)) for orbit in orbits]
    (born,) = [b for branch in branches for b in branch.bifurcations if b.kind == "NS"]
    near, far = chain_of_two(born.value - 3e-4), chain_of_two(born.value - 2e-3)
    assert near.kind is far.kind is OrbitKind.QUASI_PERIODIC
    slope = (far.rotation_number - near.rotation_number) / 1.7e-3
    assert born.rotation_number is not None
    assert abs(near.rotation_number - 3e-4 * slope - born.rotation_number) < 1e-5


# Largest Lyapunov exponents over 4000 impacts: 2e-7 +- 6e-6, 0.0 +- 5e-7 and 1e-10 +- 4e-7.
@pytest.mark.parametrize(
    ("chain", "curves", "number"),
    [
        (ImpactChain(masses=2, damping=0.001, restitution=0.9, frequency=0.796), 2, 0.134283),
        (ImpactChain(masses=3, damping=0.005, restitution=0.6, frequency=1.14), 2, 0.416066),
        (ImpactChain(masses=3, damping=0.005, restitution=0.6, frequency=1.455), 4, 0.056411),
    ],
)
def test_impacts_visit_several_curves_in_turn(
    chain: ImpactChain, curves: int, number: float
) -> None:
    found = chain.attractor(transient=20_000).label
    assert (found.kind, found.curves) == (OrbitKind.QUASI_PERIODIC, curves)
    assert abs(found.rotation_number - number) < 1e-6
    assert found.rotation_error < 1e-11


def test_a_chain_that_sticks_turns_from_release_to_release() -> None:
    # NS at damping 0.009294 with the multiplier exp(2.13616 i)
    chain = ImpactChain(masses=3, frequency=0.408, restitution=0.3, damping=0.0092)
    found = chain.attractor(transient=100_000, impacts=16_000).label
    assert (found.kind, found.curves) == (OrbitKind.QUASI_PERIODIC, 1)
    assert abs(found.rotation_number - 2.13616 / (2.0 * np.pi)) < 2e-4


# --- smooth curves in any number of dimensions ----------------------------------------------------


@dataclass(frozen=True)
class Curves:
    """Random smooth closed curves, visited in turn, on which angles advance by a constant turn."""

    seed: int
    count: int
    number: float
    harmonics: int
    dimension: int

    def states(self, n: int) -> Array:
        random = np.random.default_rng(self.seed)
        shape = self.count, self.harmonics, self.dimension
        amplitudes = random.normal(size=shape) + 1j * random.normal(size=shape)
        amplitudes *= np.exp(-0.6 * np.arange(self.harmonics))[:, None]
        centres = 3.0 * random.normal(size=(self.count, self.dimension))
        turns, curve = np.divmod(np.arange(n), self.count)
        angles = 2.0 * np.pi * (turns * self.number % 1.0)
        waves = np.exp(1j * angles[:, None] * np.arange(1, self.harmonics + 1))
        shapes = np.einsum("nh,nhd->nd", waves, amplitudes[curve]).real
        return np.asarray(shapes + centres[curve])


@pytest.mark.parametrize("dimension", [2, 3, 4, 6])
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("harmonics", [1, 4])
def test_rotation_numbers_on_smooth_curves_are_within_their_errors(
    dimension: int, count: int, harmonics: int
) -> None:
    random = np.random.default_rng([dimension, count, harmonics])
    named = 0
    for seed in range(10):
        number = GOLDEN if seed == 0 else random.uniform(0.02, 0.48)
        curves = Curves(seed, count, number, harmonics, dimension)
        found = turn_of(curves.states(3200), count)
        if found is not None:
            named += 1
            assert abs(found.number - number) <= found.error < 1e-6
    assert named >= 9


@pytest.mark.parametrize("level", [1e-12, 1e-10])
def test_noise_is_in_the_error(level: float) -> None:
    states = Curves(0, 1, GOLDEN, 3, 3).states(3200)
    states += level * np.random.default_rng(1).normal(size=states.shape)
    found = turn_of(states)
    assert found is not None
    assert abs(found.number - GOLDEN) <= found.error < level


def test_an_inaccurate_motion_has_an_uncertain_number() -> None:
    states = Curves(0, 1, GOLDEN, 1, 2).states(1000)
    found = rotation_of(Recurrences(states, None, np.subtract), 1e-6, accuracy=1e-9)
    assert found is not None
    assert found.error > 1e-10


# --- what is not quasi-periodic -------------------------------------------------------------------


def torus(n: int, thickness: float = 1.0) -> Array:
    angles = 2.0 * np.pi * np.arange(n)[:, None] * [np.sqrt(2.0), np.sqrt(3.0)] % (2.0 * np.pi)
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1) * ([1.0, thickness] * 2)


@pytest.mark.parametrize("thickness", [1.0, 1e-2, 1e-5, 1e-7])
@pytest.mark.parametrize("count", [800, 3200, 12_000])
def test_a_torus_of_two_dimensions_is_no_curve(thickness: float, count: int) -> None:
    assert turn_of(torus(count, thickness)) is None


@pytest.mark.parametrize("decay", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_spiral_is_no_curve(decay: float) -> None:
    n = np.arange(3200)
    radius = np.exp(-decay * n)
    angle = 2.0 * np.pi * GOLDEN * n
    assert turn_of(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)) is None


@pytest.mark.parametrize("level", [1e-3, 1e-5, 1e-7])
def test_noise_beyond_the_tolerance_is_no_curve(level: float) -> None:
    states = Curves(0, 1, GOLDEN, 3, 3).states(3200)
    states += level * np.random.default_rng(1).normal(size=states.shape)
    assert turn_of(states) is None


def test_a_drift_that_has_not_closed_the_curve_is_none() -> None:
    angle = 2.0 * np.pi * (1.0 / 6.0 + 1e-5) * np.arange(3200)
    assert turn_of(np.stack([np.cos(angle), np.sin(angle)], axis=1)) is None


@pytest.mark.parametrize("period", [1, 7, 500, 1100, 1597, 3000])
def test_a_cycle_is_no_curve(period: int) -> None:
    turn = round(GOLDEN * period) / period
    angle = 2.0 * np.pi * (np.arange(3200) * turn % 1.0)
    assert turn_of(np.stack([np.cos(angle), np.sin(angle)], axis=1)) is None


@pytest.mark.parametrize("count", [1, 2, 3, 100, 255])
def test_few_states_are_no_curve(count: int) -> None:
    assert turn_of(Curves(0, 1, GOLDEN, 1, 2).states(count)) is None


@dataclass(frozen=True)
class Tongue(Map):
    """An angle in turns, with two cycles of the given period where a is below 1 in size.

    theta' = theta + p / q + step (a + cos(2 pi q theta)), modulo 1, seen as a point of a circle.
    """

    p: int
    q: int
    step: float
    a: float

    @property
    def dimension(self) -> int:
        return 2

    def __call__(self, state: Array) -> Array:
        x, y = finite_array("state", state, (2,))
        theta = np.arctan2(y, x) / (2.0 * np.pi)
        theta += self.p / self.q
        theta += self.step * (self.a + np.cos(2.0 * np.pi * self.q * (theta - self.p / self.q)))
        return np.array([np.cos(2.0 * np.pi * theta), np.sin(2.0 * np.pi * theta)])

    def jacobian(self, state: Array) -> Array:
        (x, y), (u, v) = state, self(state)
        rise = np.sin(2.0 * np.pi * self.q * np.arctan2(y, x) / (2.0 * np.pi))
        slope = 1.0 - 2.0 * np.pi * self.q * self.step * rise
        return np.asarray(slope * np.outer([-v, u], [-y, x]) + 0.5 * np.outer([u, v], [x, y]))


SLOW = [(15, 22, 8.3e-8, 0.98, 0.98), (17, 46, 1e-8, 0.09, 0.58), (51, 67, 3.1e-7, 0.52, 0.79)]
SLOW += [(53, 74, 1.2e-9, 0.75, 0.51), (67, 72, 2.1e-9, 0.83, 0.067), (18, 53, 1.4e-7, 0.96, 0.56)]


@pytest.mark.parametrize(("p", "q", "step", "a", "start"), SLOW)
def test_a_slow_approach_to_a_cycle_is_unsettled(
    p: int, q: int, step: float, a: float, start: float
) -> None:
    angle = 2.0 * np.pi * start
    found = label(Tongue(p, q, step, a), [np.cos(angle), np.sin(angle)], 0)
    assert found.kind is OrbitKind.UNSETTLED


FEIGENBAUM = 3.569945672
NEGATIVE: dict[str, tuple[Map, list[float]]] = {
    "spiral before NS": (DelayedLogistic(1.999), [0.1, 0.1]),
    "decay at NS": (DelayedLogistic(2.0), [0.1, 0.1]),
    "chaos beyond the circle": (DelayedLogistic(2.245), [0.1, 0.1]),
    "more chaos beyond the circle": (DelayedLogistic(2.27), [0.1, 0.1]),
    "weak chaos of Henon's map": (Henon(1.0581), [0.1, 0.1]),
    "chaos of Henon's map": (Henon(1.4), [0.1, 0.1]),
    "chaos in a layer": (Standard(0.9), [0.001, 0.0]),
    "thinner chaos in a layer": (Standard(0.5), [0.001, 0.0]),
    "Feigenbaum's Cantor set": (Logistic(FEIGENBAUM), [0.3]),
    "decay at a period doubling": (Logistic(3.0), [0.3]),
    "decay at a second period doubling": (Logistic(1.0 + np.sqrt(6.0)), [0.3]),
    "intermittency before a fold": (Logistic(1.0 + np.sqrt(8.0) - 1e-7), [0.3]),
    "drift before a fold of the circle map": (ArnoldCircle(0.8 / (2.0 * np.pi) + 1e-9), [0.2]),
}


@pytest.mark.parametrize("name", NEGATIVE)
def test_what_fills_no_smooth_curve_is_not_quasi_periodic(name: str) -> None:
    system, start = NEGATIVE[name]
    assert label(system, start, 700).kind is not OrbitKind.QUASI_PERIODIC


def test_curves_and_chaos_of_the_standard_map_are_told_apart() -> None:
    golden = label(Standard(0.5), [0.0, 0.62])
    assert golden.kind is OrbitKind.QUASI_PERIODIC
    assert label(Standard(3.0), [0.001, 0.0]).kind is OrbitKind.CHAOTIC


@dataclass
class Turning:
    """States on a circle, whose disturbances grow at a rate of their own."""

    rate: float
    accuracy: float = ACCURACY
    given: int = 0

    def more(self, count: int) -> Window:
        angles = 2.0 * np.pi * (np.arange(self.given, self.given + count) * GOLDEN % 1.0)
        self.given += count
        return Window(np.stack([np.cos(angles), np.sin(angles)], axis=1))

    def difference(self, a: Array, b: Array) -> Array:
        return np.subtract(a, b)

    def growth(self, steps: int) -> Array:
        return np.full(steps, self.rate)


@pytest.mark.parametrize(
    ("rate", "kind"),
    [
        (0.0, OrbitKind.QUASI_PERIODIC),
        (1e-5, OrbitKind.QUASI_PERIODIC),
        (0.1, OrbitKind.CHAOTIC),
        (-0.1, OrbitKind.UNSETTLED),
        (-np.inf, OrbitKind.UNSETTLED),
    ],
)
def test_the_largest_exponent_must_be_zero(rate: float, kind: OrbitKind) -> None:
    assert label_orbit(Turning(rate)).kind is kind


@pytest.mark.parametrize("fall", [1e-3, 0.03, 0.2, 0.9])
def test_a_decay_too_slow_for_the_budget_is_unsettled(fall: float) -> None:
    class Slow(Turning):
        def more(self, count: int) -> Window:
            begin = self.given
            self.given += count
            size = 1.0 + np.exp(-fall / 5000.0 * np.arange(begin, begin + count))
            return Window(np.stack([size, size], axis=1))

    assert label_orbit(Slow(-fall / 5000.0)).kind is OrbitKind.UNSETTLED


def test_a_budget_that_leaves_no_growth_to_look_at_leaves_the_label_open() -> None:
    assert label_orbit(Turning(0.0), budget=1500).kind is OrbitKind.UNSETTLED


# --- where labels are shown and kept --------------------------------------------------------------


def made(error: float, curves: int = 1) -> OrbitLabel:
    found = OrbitLabel(OrbitKind.QUASI_PERIODIC, None, None, 1e-6, 3e-9, 20_000, curves=curves)
    object.__setattr__(found, "rotation_number", 0.16478415352)
    object.__setattr__(found, "rotation_error", error)
    return found


@pytest.mark.parametrize(
    ("error", "curves", "text"),
    [
        (1e-14, 1, "quasi-periodic, rotation number 0.164784"),
        (2e-4, 1, "quasi-periodic, rotation number 0.165"),
        (1e-9, 3, "quasi-periodic, rotation number 0.164784 on 3 curves"),
    ],
)
def test_a_label_shows_the_digits_that_its_error_leaves(
    error: float, curves: int, text: str
) -> None:
    assert str(made(error, curves)) == text
    assert made(error, curves).name == "quasi-periodic"


def test_columns_hold_rotation_numbers() -> None:
    columns = empty_columns(2, -1)
    put_label(columns, 1, made(1e-12, 2))
    found = label_in(columns, 1, OrbitKind.QUASI_PERIODIC)
    assert found == made(1e-12, 2)
    assert (found.rotation_number, found.rotation_error) == (0.16478415352, 1e-12)


def test_a_parameter_plane_has_one_name_for_quasi_periodic_motions() -> None:
    values = {"rate": [1.9, 2.05, 2.1], "s": [1.0]}
    found = parameter_map(DelayedLogistic(2.0), values, start=[0.1, 0.1], progress=False)
    assert found.names[:, 0].tolist() == ["P(1)", "quasi-periodic", "quasi-periodic"]
    assert found.where(OrbitKind.QUASI_PERIODIC)[:, 0].tolist() == [False, True, True]
    assert abs(found.label(2, 0).rotation_number - delayed_logistic(2.1).rotation_number) < 1e-12
    assert repr(found).endswith("quasi-periodic 2, P(1) 1>")
    legend = found.plot().get_legend()
    assert legend is not None
    assert "quasi-periodic" in [text.get_text() for text in legend.get_texts()]


def test_one_invariant_circle_is_one_basin(tmp_path: Path) -> None:
    starts = [[0.1, 0.1], [0.4, 0.45], [0.6, 0.5], [5.0, 5.0]]
    found = basins(DelayedLogistic(2.1), starts, progress=False)
    assert found.numbers.tolist() == [0, 0, 0, -2]
    found.save(tmp_path / "basins.npz")
    before, after = (each.basins[0].label for each in (found, Basins.load(tmp_path / "basins.npz")))
    assert before.kind is OrbitKind.QUASI_PERIODIC
    assert (str(after), after.rotation_error) == (str(before), before.rotation_error)


def test_two_invariant_circles_are_two_basins() -> None:
    found = basins(Stroboscopic(np.sqrt(2.0)), [[0.4, 0.1], [0.8, 0.1]], progress=False)
    assert found.numbers.tolist() == [0, 1]


def test_invariant_circles_near_a_resonance_are_told_apart() -> None:
    # thousands of states remain near 214 points of the circle
    system = Stroboscopic(1.0 / (23.0 / 214.0 + 6e-7))
    centre = np.array([0.3 / (1.0 - system.frequency**2), 0.0])
    turns = np.array([0.0, 0.2, 0.34, 0.61, 0.83]) * 2.0 * np.pi
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    starts = np.stack([centre + 0.4 * circle, centre + 0.41 * circle])
    found = basins(system, starts, progress=False)
    assert found.numbers.tolist() == [[0] * 5, [1] * 5]
