"""Duffing's oscillator: energy, elliptic functions, the linear limit, and stroboscopic maps."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from dynkit import Hyperplane, MapAttractor, PoincareMap, Stroboscope
from dynkit.core.validation import Array
from dynkit.systems import Duffing
from tests.flows.cases import STATES

WELLS = [(-1.0, 1.0), (1.0, 0.3), (0.0, 1.0), (2.0, -0.1)]


def free(stiffness: float = 1.0, cubic: float = 1.0) -> Duffing:
    return Duffing(damping=0.0, force=0.0, stiffness=stiffness, cubic=cubic)


def energy(duffing: Duffing, state: Array) -> float:
    x, v, _ = state
    return float(v**2 / 2 + duffing.stiffness * x**2 / 2 + duffing.cubic * x**4 / 4)


@pytest.mark.parametrize(("stiffness", "cubic"), WELLS)
@pytest.mark.parametrize("place", range(3))
def test_the_energy_is_kept_without_damping_and_force(
    stiffness: float, cubic: float, place: int
) -> None:
    duffing, start = free(stiffness, cubic), STATES["duffing"][place]
    end = duffing.advance(start, 20.0)
    # hundreds of steps; the energy's gradient is below 5 on these orbits
    allowed = 1e3 * duffing.accuracy * 5.0
    assert energy(duffing, end) == pytest.approx(energy(duffing, start), abs=allowed)


@pytest.mark.parametrize("place", range(3))
def test_the_energy_falls_by_the_work_of_the_damping(place: int) -> None:
    duffing, start, duration = Duffing(force=0.0), STATES["duffing"][place], 5.0
    nodes, weights = np.polynomial.legendre.leggauss(48)
    path = [duffing.advance(start, duration * (1.0 + t) / 2.0) for t in nodes]
    power = np.array([-duffing.damping * state[1] ** 2 for state in path])
    change = energy(duffing, duffing.advance(start, duration)) - energy(duffing, start)
    assert change == pytest.approx(duration / 2.0 * float(weights @ power), abs=1e-10)


@pytest.mark.parametrize("amplitude", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("time", [0.5, 3.0, 10.0])
def test_free_motion_is_jacobis_elliptic_cosine(amplitude: float, time: float) -> None:
    """A cn(w t, m), w^2 = stiffness + cubic A^2, m = cubic A^2/(2 w^2).

    Guckenheimer and Holmes 1983, section 2.2; I. Kovacic, M. J. Brennan, The Duffing Equation,
    Wiley 2011, section 4.3.
    """
    rate = mpmath.sqrt(1 + mpmath.mpf(amplitude) ** 2)
    modulus = mpmath.mpf(amplitude) ** 2 / (2 * rate**2)
    position = float(amplitude * mpmath.ellipfun("cn", rate * time, m=modulus))
    sn, dn = (mpmath.ellipfun(name, rate * time, m=modulus) for name in ("sn", "dn"))
    velocity = float(-amplitude * rate * sn * dn)
    found = free().advance(np.array([amplitude, 0.0, 0.0]), time)[:2]
    # two hundred steps, at a rate of shear below one turn a unit of time
    assert found == pytest.approx([position, velocity], abs=1e-10)


@pytest.mark.parametrize("amplitude", [0.3, 1.0, 2.0])
def test_the_free_period_is_a_complete_elliptic_integral(amplitude: float) -> None:
    # 4 K(m) / w, as above
    rate = mpmath.sqrt(1 + mpmath.mpf(amplitude) ** 2)
    expected = float(4 * mpmath.ellipk(mpmath.mpf(amplitude) ** 2 / (2 * rate**2)) / rate)
    maxima = Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, -1, angles=[2])
    system = PoincareMap(free(), maxima, time_limit=30.0)
    assert system.return_time(np.array([amplitude, 1.0])) == pytest.approx(expected, rel=1e-11)


def linear() -> Duffing:
    return Duffing(damping=0.2, stiffness=2.0, cubic=0.0, force=0.7, frequency=1.3)


def test_the_linear_oscillator_settles_to_its_frequency_response() -> None:
    duffing = linear()
    response = duffing.force / (2.0 - 1.3**2 + 0.2j * 1.3)
    state = np.array([response.real, -1.3 * response.imag])
    found = PoincareMap(duffing, Stroboscope(3), time_limit=10.0)(state)
    assert found == pytest.approx(state, abs=1e-11)


@pytest.mark.parametrize("phase", [0.0, 1.0, -4.0])
def test_the_linear_oscillators_stroboscopic_map_has_its_multipliers(phase: float) -> None:
    # exp(lambda T), lambda^2 + damping lambda + stiffness = 0
    system = PoincareMap(linear(), Stroboscope(3, phase), time_limit=10.0)
    period = 2.0 * np.pi / 1.3
    expected = np.exp(np.roots([1.0, 0.2, 2.0]) * period)
    found = np.linalg.eigvals(system.jacobian(np.array([0.4, -0.3])))
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), abs=1e-11)


# --- stroboscopic maps ----------------------------------------------------------------------------


def stroboscopic(duffing: Duffing, phase: float = 0.0) -> PoincareMap:
    return PoincareMap(duffing, Stroboscope(3, phase), time_limit=20.0)


@pytest.mark.parametrize("frequency", [0.7, 1.2, 5.0])
@pytest.mark.parametrize("phase", [0.0, 2.0, 100.0])
def test_a_stroboscope_flashes_once_a_period(frequency: float, phase: float) -> None:
    system = stroboscopic(Duffing(frequency=frequency), phase)
    found = system.return_time(np.array([0.4, -0.3]))
    # the phase is a number of that size, and rounded
    assert found == pytest.approx(2.0 * np.pi / frequency, rel=1e-14 * (1.0 + phase))


@pytest.mark.parametrize("n", [1, 3])
def test_iterates_are_the_states_whole_periods_later(n: int) -> None:
    duffing = Duffing(force=0.2)
    start = np.array([1.1, 0.1])
    later = duffing.advance(np.array([*start, 0.0]), n * 2.0 * np.pi / 1.2)[:2]
    assert stroboscopic(duffing).iterate(start, n)[-1] == pytest.approx(later, abs=1e-10)


def test_the_area_shrinks_by_the_damping_of_a_period() -> None:
    found = np.linalg.det(stroboscopic(Duffing()).jacobian(np.array([0.4, -0.3])))
    assert found == pytest.approx(np.exp(-0.3 * 2.0 * np.pi / 1.2), rel=1e-9)


def test_states_turned_by_half_a_period_move_alike() -> None:
    """The mirror symmetry (x, v, phase) -> (-x, -v, phase + pi)."""
    duffing, start = Duffing(), np.array([0.4, -0.3, 0.5])
    other = duffing.advance(np.array([-0.4, 0.3, 0.5 + np.pi]), 3.0)
    expected = duffing.advance(start, 3.0) * [-1.0, -1.0, 1.0] + [0.0, 0.0, np.pi]
    assert other == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    ("force", "label"),
    [(0.20, "P(1)"), (0.28, "P(2)"), (0.29, "P(4)"), (0.37, "P(5)"), (0.65, "P(2)")],
)
def test_labels_are_those_of_jordan_and_smith(force: float, label: str) -> None:
    # D. W. Jordan, P. Smith, Nonlinear Ordinary Differential Equations, 4th ed., Oxford 2007,
    # pp. 453-462: periods of the response for damping 0.3, frequency 1.2
    system = stroboscopic(Duffing(force=force))
    attractor = MapAttractor(system, np.array([1.0, 0.0]), transient=100, iterations=60)
    assert str(attractor.label) == label


def test_on_another_section_the_phase_is_an_angle() -> None:
    """A motion of period 1 has one maximum a period: it recurs though the phase has grown."""
    maxima = Hyperplane(np.array([0.0, 1.0, 0.0]), 0.0, -1, angles=[2])
    system = PoincareMap(Duffing(force=0.2), maxima, time_limit=20.0)
    attractor = MapAttractor(system, np.array([1.2, 0.0]), transient=100, iterations=60)
    assert str(attractor.label) == "P(1)"
    assert ((attractor.states[:, 1] >= 0.0) & (attractor.states[:, 1] <= 2.0 * np.pi)).all()
