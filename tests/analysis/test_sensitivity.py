"""The paper's test of sensitive dependence, and closed forms."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from dynkit import Map, MapAttractor
from dynkit.analysis.lyapunov import LyapunovSpectrum
from dynkit.analysis.sensitivity import Sensitivity
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.systems import Henon, ImpactChain, Logistic
from tests.example_systems import CircleRotation

# Cusumano and Bai, section 4: 1e-8 apart, "the periodic orbits showed no change, but chaotic
# orbits diverged after about 100 impacts".
PERIODIC, CHAOTIC = (0.34, 0.64, 0.87, 1.75), (1.346, 1.916)


@pytest.mark.parametrize("frequency", PERIODIC)
def test_periodic_orbits_show_no_change(frequency: float) -> None:
    attractor = ImpactChain(frequency=frequency).attractor(transient=3000)
    found = Sensitivity(attractor, distance=1e-8, iterations=100)
    assert found.distances[0] == pytest.approx(1e-8 * np.sqrt(20.0), rel=1e-6)
    assert found.growth < 1.0


def anywhere_in_chaos(frequency: float) -> tuple[Attractor, list[Attractor]]:
    """An attractor, and those that begin in 16 of its states, 100 impacts apart."""
    system = ImpactChain(frequency=frequency)
    whole = system.attractor(transient=1000, impacts=1600)
    starts = (system.impact_state(state) for state in whole.states[::100])
    return whole, [system.attractor(transient=0, impacts=1, start=start) for start in starts]


@pytest.mark.parametrize("frequency", CHAOTIC)
def test_chaotic_orbits_diverge_within_100_impacts(frequency: float) -> None:
    # About 100: of 100 orbits some three take longer.
    whole, attractors = anywhere_in_chaos(frequency)
    size = float(np.linalg.norm(whole.states.std(axis=0)))
    found = [Sensitivity(each, distance=1e-8, iterations=100) for each in attractors]
    assert sum(each.distances.max() > 0.5 * size for each in found) >= 11
    assert len(found) == 16


def test_the_growth_is_that_of_the_largest_exponent() -> None:
    # As long as it is small; over 32 impacts the growth varies by the scatter of 32 of them.
    whole, attractors = anywhere_in_chaos(1.346)
    found = [Sensitivity(each, distance=1e-12, iterations=32) for each in attractors]
    spectrum = LyapunovSpectrum(whole, 10_000)
    scatter = spectrum.error[0] * np.sqrt(10_000 / 32)
    rates = np.array([np.log(each.growth) / 32 for each in found])
    # at the start the distance turns into the direction that grows
    slack = np.log(10.0) / 32
    assert abs(rates.mean() - spectrum.exponents[0]) < 3.0 * scatter / np.sqrt(16.0) + slack
    assert np.median([each.distances.max() for each in found]) < 1e-3


def test_a_rotation_keeps_angles_apart() -> None:
    attractor = MapAttractor(CircleRotation(1.0), np.array([0.3, 0.0]), transient=0, iterations=1)
    distances = Sensitivity(attractor, distance=1e-4, iterations=30).distances
    expected = 1e-4 * np.hypot(1.0, 0.5 ** np.arange(31))
    assert distances == pytest.approx(expected, rel=1e-10)


def test_it_is_worked_out_on_demand_with_its_cost_and_error() -> None:
    attractor = MapAttractor(Henon(), np.array([0.1, 0.1]), transient=100, iterations=1)
    found = Sensitivity(attractor, iterations=50)
    assert repr(found) == "<Sensitivity of Henon: 50 iterations, not computed yet>"
    assert found.cost.counts == {"iterates": 100}
    assert 0.0 < found.error < 1e-15
    assert "\n" not in repr(found)
    assert "1.4e-08 to" in repr(found)


def test_the_plot_shows_the_distances() -> None:
    from dynkit.plotting.figures import new_figure

    _, (axes,) = new_figure()
    attractor = MapAttractor(Henon(), np.array([0.1, 0.1]), transient=100, iterations=1)
    found = Sensitivity(attractor, iterations=50)
    assert found.plot(axes) is axes
    assert (np.asarray(axes.lines[0].get_ydata()) == found.distances).all()


@pytest.mark.parametrize(
    ("distance", "iterations", "message"),
    [
        (0.0, 10, "distance must be positive; got 0.0"),
        (1e-8, 0, "iterations must be a positive integer; got 0"),
    ],
)
def test_bad_arguments_are_refused(distance: float, iterations: int, message: str) -> None:
    attractor = MapAttractor(Henon(), np.array([0.1, 0.1]), transient=100, iterations=1)
    with pytest.raises(ValueError, match=message):
        Sensitivity(attractor, distance, iterations)


def test_the_error_of_an_iterate_is_that_of_both_motions() -> None:
    random = np.random.default_rng(0)
    for rate in random.uniform(3.5, 4.0, 300):
        attractor = MapAttractor(
            Logistic(rate), random.uniform(0.1, 0.9, 1), transient=5, iterations=1
        )
        found = Sensitivity(attractor, distance=random.uniform(1e-9, 1e-4), iterations=1)
        x = Fraction(float(attractor.states[-1, 0]))
        first = Fraction(float(attractor.states[-1, 0] + found._distance)) - x
        exact = abs(Fraction(float(rate)) * first * (1 - 2 * x - first))
        assert abs(Fraction(float(found.distances[1])) - exact) <= found.error


def test_what_is_no_attractor_is_refused() -> None:
    with pytest.raises(ValueError, match=r"got Henon.*, whose attractor\(\) gives one"):
        Sensitivity(Henon())  # type: ignore[arg-type]


def test_a_distance_that_rounding_swallows_is_refused() -> None:
    class Shifted(Map):
        dimension = 1

        def __call__(self, state: Array) -> Array:
            x = state - 1e6
            return 1e6 + 4.0 * x * (1.0 - x)

    attractor = MapAttractor(Shifted(), np.array([1e6 + 0.3]), transient=10, iterations=1)
    with pytest.raises(ValueError, match=r"^distance must exceed the rounding of .*; got 1e-12$"):
        Sensitivity(attractor, distance=1e-12)
