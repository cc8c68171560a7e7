"""Lyapunov exponents of impact oscillators: multipliers, volumes, twins, and what contact takes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest

from dynkit.analysis.lyapunov import LyapunovSpectrum
from dynkit.core.validation import Array
from dynkit.dynamics.attractor import Attractor
from dynkit.dynamics.map import Map
from dynkit.plotting.figures import new_figure
from dynkit.systems import (
    BouncingBall,
    DryFriction,
    HardStop,
    ImpactChain,
    ImpactOscillator,
    Jenkins,
    SingleImpactOscillator,
    TodaChain,
)
from dynkit.systems.impact.elements.element import Element
from tests.impact.disguised import disguised
from tests.impact.one_mass import periodic_orbits
from tests.impact.test_coulomb import SLIDING


@cache
def chain(frequency: float, transient: int = 1000) -> Attractor:
    return ImpactChain(frequency=frequency).attractor(transient=transient)


@cache
def spectrum_of(frequency: float, iterations: int) -> LyapunovSpectrum:
    return LyapunovSpectrum(chain(frequency), iterations)


def test_exponents_of_p13_are_logarithms_of_its_multipliers() -> None:
    attractor = chain(0.87, 5000)
    spectrum = LyapunovSpectrum(attractor, 20_000)
    multipliers = attractor.periodic_orbit().multipliers  # type: ignore[attr-defined]
    gap = abs(spectrum.exponents - np.log(abs(multipliers)))
    assert gap.max() < 1e-9
    assert spectrum.error.max() < 1e-8


@pytest.mark.parametrize(("frequency", "n"), [(0.8, 2), (0.68, 3)])
def test_exponents_of_several_impacts_are_means(frequency: float, n: int) -> None:
    attractor = chain(frequency, 3000)
    spectrum = LyapunovSpectrum(attractor, 20_000)
    multipliers = attractor.periodic_orbit().multipliers  # type: ignore[attr-defined]
    assert attractor.label.iterates == n
    gap = abs(spectrum.exponents - np.log(abs(multipliers)) / n)
    assert gap.max() < 1e-8


@pytest.mark.parametrize(("frequency", "periods"), [(1.8, 1), (2.1, 1), (2.4, 1)])
def test_one_mass_against_closed_forms(frequency: float, periods: int) -> None:
    system = SingleImpactOscillator(
        frequency=frequency, damping_ratio=0.02, restitution=0.8, stop=0.1
    )
    (exact,) = periodic_orbits(system, periods)
    assert exact.stable
    spectrum = LyapunovSpectrum.of_map(system, exact.state, iterations=20_000)
    expected = np.sort(np.log(abs(exact.multipliers)))[::-1]
    assert spectrum.exponents == pytest.approx(expected, abs=1e-9)
    period = 2.0 * np.pi * periods / frequency
    assert spectrum.per_time == pytest.approx(expected / period, abs=1e-9)


def test_volumes_shrink_as_restitution_and_damping_say() -> None:
    # Chaos without contact. 2 log r for an impact, and the trace of the damping, 0.1 (2 * 9 + 1),
    # times the time.
    spectrum = LyapunovSpectrum(chain(1.37), 1000)
    duration = spectrum.sum / float(spectrum.per_time.sum())
    assert spectrum.sum == pytest.approx(2.0 * np.log(0.85) - 1.9 * duration, abs=1e-10)
    assert spectrum.exponents[0] > 3.0 * spectrum.error[0]


def test_a_bouncing_ball_loses_two_logarithms_of_the_restitution_per_bounce() -> None:
    ball = BouncingBall(amplitude=1.0, frequency=3.0, restitution=0.95)
    attractor = ball.attractor(transient=100, impacts=1)
    spectrum = LyapunovSpectrum(attractor, 2000)
    assert spectrum.sum == pytest.approx(2.0 * np.log(0.95), abs=1e-9)
    assert spectrum.exponents[0] > 3.0 * spectrum.error[0]


def test_the_largest_exponent_is_the_growth_of_the_distance_of_twins() -> None:
    # Every 10 impacts the twin is put back to a distance of 1e-8.
    attractor = chain(1.37)
    system, state = attractor.system, attractor.states[-1]
    gap = np.full(system.dimension, 1e-8)
    logs = []
    for _ in range(200):
        here, twin = system.iterate(state, 10)[-1], system.iterate(state + gap, 10)[-1]
        ahead = system.difference(twin, here)
        logs.append(np.log(np.linalg.norm(ahead) / np.linalg.norm(gap)) / 10.0)
        gap = 1e-8 * ahead / np.linalg.norm(ahead)
        state = here
    blocks = np.reshape(logs[40:], (32, -1)).mean(axis=1)
    spectrum = LyapunovSpectrum(attractor, 10_000)
    error = np.hypot(blocks.std(ddof=1) / np.sqrt(32.0), spectrum.error[0])
    assert abs(blocks.mean() - spectrum.exponents[0]) < 3.0 * error
    assert error < 0.03


@dataclass(frozen=True)
class BySection(Map):
    """An impact oscillator's map in its section coordinates, and nothing else of it."""

    system: ImpactChain

    @property
    def dimension(self) -> int:
        return self.system.dimension

    def __call__(self, state: Array) -> Array:
        return self.system(state)

    def jacobian(self, state: Array) -> Array:
        return self.system.jacobian(state)


def test_the_derivative_in_section_coordinates_has_the_same_exponents() -> None:
    # Along the same motion for some 30 of its impacts; then both are averages over the attractor.
    attractor = chain(1.37)
    system = attractor.system
    assert isinstance(system, ImpactChain)
    fast = LyapunovSpectrum(attractor, 1600)
    slow = LyapunovSpectrum.of_map(BySection(system), attractor.states[-1], iterations=1600)
    gap = abs(fast.exponents - slow.exponents)
    assert (gap < 4.0 * np.hypot(fast.error, slow.error)).all()
    assert np.hypot(fast.error, slow.error).max() < 0.1


def test_sticking_orbits_have_no_dimension() -> None:
    spectrum = LyapunovSpectrum(chain(0.408), 2000)
    assert np.isneginf(spectrum.per_time).sum() == 2
    assert spectrum.exponents[0] < 0.0
    assert spectrum.dimension == 0.0


# Contact in every second period, and once in some hundred or thousand impacts of chaos.
CONTACTS = [(0.40816, 1000), (1.916, 5000), (1.346, 12_000)]


@pytest.mark.parametrize(("frequency", "iterations"), CONTACTS)
def test_one_contact_takes_two_directions_for_good(frequency: float, iterations: int) -> None:
    spectrum = spectrum_of(frequency, iterations)
    assert np.isneginf(spectrum.exponents).tolist() == 18 * [False] + 2 * [True]
    assert (spectrum.error[-2:] == 0.0).all()
    assert (spectrum.sum, spectrum.sum_error) == (-np.inf, 0.0)


@pytest.mark.parametrize(("frequency", "iterations"), CONTACTS)
def test_nothing_is_no_number_where_directions_are_lost(frequency: float, iterations: int) -> None:
    spectrum = spectrum_of(frequency, iterations)
    shown = [spectrum.exponents, spectrum.per_time, spectrum.error, spectrum.per_time_error]
    numbers = [spectrum.sum, spectrum.sum_error, spectrum.dimension, spectrum.dimension_error]
    assert not np.isnan(np.concatenate([*shown, numbers])).any()
    assert np.isfinite(np.concatenate([spectrum.error, spectrum.per_time_error])).all()
    assert (np.diff(spectrum.exponents[:18]) <= 0.0).all()


@pytest.mark.parametrize(("frequency", "iterations"), CONTACTS)
def test_finite_exponents_are_drawn_where_directions_are_lost(
    frequency: float, iterations: int
) -> None:
    _, (axes,) = new_figure()
    spectrum_of(frequency, iterations).plot(axes)
    assert len(axes.lines) == 18


def test_exponents_that_contact_does_not_take_are_those_without_it() -> None:
    # Every third run of a thousand impacts or so is without contact.
    attractor, whole = chain(1.346), spectrum_of(1.346, 12_000)
    runs = (
        LyapunovSpectrum.of_map(attractor.system, start, iterations=1000)
        for start in attractor.states
    )
    without = next(run for run in runs if np.isfinite(run.exponents).all())
    gap = abs(without.exponents - whole.exponents)[:18]
    assert not np.isfinite(whole.exponents).all()
    assert (gap < 4.0 * np.hypot(without.error, whole.error)[:18]).all()
    gap_of_dimensions = abs(without.dimension - whole.dimension)
    assert gap_of_dimensions < 3.0 * np.hypot(without.dimension_error, whole.dimension_error)


@pytest.mark.parametrize(
    "system",
    [
        ImpactChain(masses=2, restitution=0.4, frequency=0.2),
        ImpactChain(masses=2, restitution=0.4, frequency=0.2, chatter_tolerance=1e-10),
        ImpactChain(masses=3, damping=(0.1, 0.4, 0.2), restitution=0.4, frequency=0.2),
        ImpactChain(masses=3, frequency=0.9, restitution=0.0),
    ],
    ids=["two masses", "coarse", "dashpots apart", "dead"],
)
def test_exponents_of_sticking_orbits_are_logarithms_of_multipliers(system: ImpactChain) -> None:
    # By the product of the derivatives of all impacts of a period, whose two zeros are rounding.
    attractor = system.attractor(transient=4000, impacts=100)
    assert str(attractor.label) == "P(inf,1)"
    turns = attractor.record.time * system.frequency / (2.0 * np.pi)
    n = int(np.searchsorted(turns, turns[0] + 1.0 - 1e-6))
    product = np.eye(system.dimension)
    for state in attractor.states[:n]:
        product = system.jacobian(state) @ product
    expected = np.sort(abs(np.linalg.eigvals(product)))[:1:-1]
    spectrum = LyapunovSpectrum(attractor, 20_000)
    assert np.isneginf(spectrum.exponents[-2:]).all()
    # errors of the product's entries, of its smallest eigenvalues too
    worst = 2.0**-52 * n * system.dimension / expected[-1]
    gap = abs(spectrum.exponents[:-2] - np.log(expected) / n)
    assert gap.max() < 100.0 * worst + 1e-8
    assert spectrum.error[:-2].max() < 1e-7


def test_a_transient_that_is_not_over_is_told() -> None:
    # Frequency 0.35: chaos for thousands of impacts, how many is chance, then P(39,15). Three
    # motions whose chaos ends between a fifth and three fifths of what counts.
    system = ImpactChain(frequency=0.35)
    starts = (system.state(system.state().position * (1.0 + 0.01 * k)) for k in range(300))
    sections = (system.simulate(impacts=100, start=start).states[-1] for start in starts)
    ending = islice((y for y in sections if 4500 < impacts_of_chaos(system, y) < 8500), 3)
    runs = [LyapunovSpectrum.of_map(system, section, iterations=10_000) for section in ending]
    assert [run.resolved for run in runs] == [False, False, False]


def impacts_of_chaos(system: ImpactChain, section: Array) -> int:
    """Impacts until velocities repeat after 39 of them; 11 000 where that is later."""
    motion = system.simulate(impacts=11_039, start=system.impact_state(section))
    change = abs(motion.relative_velocity[39:] - motion.relative_velocity[:-39])
    return int(np.flatnonzero(change > 1e-3).max(initial=0))


def pair(*elements: Element, frequency: float = 1.0, force: float = 0.3) -> ImpactChain:
    forces = [0.0, force]
    return ImpactChain(
        masses=2, damping=0.02, frequency=frequency, harmonic_forces=forces, elements=elements
    )


BELTS = [DryFriction(k, force=0.5 - 0.2 * k, static=0.8, velocity=0.2) for k in (0, 1)]


class Uneven(ImpactOscillator):
    """A mass that slides on a table, both masses vary with their places."""

    degrees_of_freedom = 2

    def kinetic(self, x: Any, v: Any) -> Any:  # type: ignore[override]
        return (1 + x[0] ** 2 / 5) * v[0] ** 2 / 2 + (1 + x[1] ** 2 / 10) * v[1] ** 2 / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 / 2 - x[0] * x[1] / 5 + x[1] ** 2 / 4 + 2 * x[1] / 5 + x[0] ** 4 / 20

    def dissipation(self, v: Any) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 20


HOLDING = {
    "a slider": (pair(Jenkins(0, stiffness=2.0, force=0.1)), 1),
    "two sliders": (
        pair(Jenkins(0, stiffness=2.0, force=0.1), Jenkins(1, stiffness=1.0, force=0.1)),
        2,
    ),
    "a slider beside a stop": (
        ImpactChain(
            masses=2,
            damping=0.02,
            frequency=1.3,
            elements=[
                HardStop(1, amplitude=0.2, restitution=0.8),
                Jenkins(0, stiffness=2.0, force=0.05),
            ],
        ),
        1,
    ),
    "friction": (pair(DryFriction(0, force=0.3), frequency=0.3, force=0.45), 1),
    "an impact that stops the slip": (SLIDING, 1),
    "an impact that stops the slip, by Taylor's method": (disguised(SLIDING), 1),
    "an impact that stops the slip, where masses vary": (
        Uneven(
            frequency=1.1,
            elements=[
                HardStop(1, amplitude=1.2, restitution=0.6, name="table"),
                DryFriction(0, coefficient=0.6, normal="table", velocity=0.1),
            ],
        ),
        1,
    ),
    "friction beside springs that are not linear": (
        TodaChain(
            masses=2,
            damping=0.02,
            frequency=0.3,
            harmonic_forces=[0.0, 0.45],
            elements=[DryFriction(0, force=0.3)],
        ),
        1,
    ),
    "belts": (ImpactChain(masses=2, damping=0.01, frequency=1.0, elements=BELTS), 2),
}


@pytest.mark.parametrize(("system", "taken"), HOLDING.values(), ids=HOLDING)
def test_what_holds_takes_directions_and_the_others_are_logarithms_of_multipliers(
    system: ImpactOscillator, taken: int
) -> None:
    # one pair of multipliers has moduli that are near each other, which takes many iterates
    transient, keep, iterations = (150, 50, 150) if system.engine == "Taylor" else (400, 100, 400)
    attractor = system.attractor(transient=transient, keep=keep)
    orbit = attractor.periodic_orbit()
    spectrum = LyapunovSpectrum(attractor, iterations)
    left = system.dimension - taken
    assert np.isneginf(spectrum.exponents).tolist() == left * [False] + taken * [True]
    multipliers = np.sort(abs(orbit.multipliers))[::-1]
    expected = np.log(multipliers[:left]) / attractor.label.iterates
    assert spectrum.exponents[:left] == pytest.approx(expected, abs=1e-5)
    assert (spectrum.error[left:] == 0.0).all()


def test_a_plastic_stop_among_others_takes_two_directions() -> None:
    stops = [HardStop(1, amplitude=0.3, restitution=0.0), HardStop(0, offset=-0.2, restitution=0.7)]
    system = ImpactChain(masses=2, damping=0.05, frequency=1.3, elements=stops)
    alone = ImpactChain(masses=2, damping=0.05, frequency=1.3, amplitude=0.3, restitution=0.0)
    found, expected = (
        LyapunovSpectrum(each.attractor(transient=300), 600).exponents for each in (system, alone)
    )
    assert np.isneginf(found).tolist() == [False, False, True, True]
    assert found[:2] == pytest.approx(expected[:2], abs=1e-4)
