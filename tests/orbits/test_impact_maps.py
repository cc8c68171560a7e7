"""Orbits of impact oscillators as maps, by multiple shooting, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dynkit import periodic_orbit
from dynkit.core.validation import Array
from dynkit.orbits.map_orbit import MapOrbit
from dynkit.orbits.newton import NoConvergence
from dynkit.orbits.problem import PeriodicOrbit
from dynkit.systems import BouncingBall, ImpactChain, SingleImpactOscillator
from tests.impact.one_mass import periodic_orbits

ROUNDING = 2.0**-52


def strengths(restitution: float, n: int) -> tuple[float, float]:
    """Of the table's acceleration: where bounces of n periods are born, and double their period."""
    born = math.pi * n * (1.0 - restitution) / (1.0 + restitution)
    force = 2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2
    return born, math.hypot(born, force)


def bounce(strength: float, restitution: float, n: int, sign: int) -> tuple[BouncingBall, Array]:
    """A ball and its state in a bounce of n periods; the sign is that of sin(phase)."""
    frequency = 3.0
    ball = BouncingBall(
        amplitude=strength / frequency**2, frequency=frequency, restitution=restitution
    )
    born, _ = strengths(restitution, n)
    u = 2.0 * math.pi * n * restitution / ((1.0 + restitution) * frequency)
    return ball, np.array([u, sign * math.acos(born / strength) % (2.0 * math.pi)])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("restitution", [0.3, 0.7, 0.95])
@pytest.mark.parametrize("share", [0.2, 0.9, 1.3])
@pytest.mark.parametrize("unknowns", ["states", "impulses"])
def test_bounces_of_n_periods(
    unknowns: str, share: float, restitution: float, n: int, sign: int
) -> None:
    born, doubled = strengths(restitution, n)
    strength = born + share * (doubled - born)
    ball, state = bounce(strength, restitution, n, sign)
    orbit: PeriodicOrbit = periodic_orbit(ball, state + np.array([1e-3, -1e-3]))
    if unknowns == "impulses":
        orbit = ball.periodic_orbit(periods=n, phases=[state[1] - 1e-3])
    assert orbit.label == ("P(1)" if unknowns == "states" else f"P(1,{n})")
    if isinstance(orbit, MapOrbit):
        assert orbit.duration == pytest.approx(2.0 * math.pi * n / ball.frequency, abs=1e-10)
    off = abs(ball.difference(orbit.states[0], state))
    assert off.max() <= orbit.error + 8.0 * ROUNDING * state.max()
    assert orbit.error < 1e-11
    # one of them is 1 at the birth and -1 at the doubling, the other r^2 and -r^2; in between the
    # trace is linear in the slope of the table's velocity
    sine = strength * math.sin(state[1])
    trace = 1.0 + restitution**2 - (1.0 + restitution) ** 2 * sine
    assert orbit.multipliers.sum() == pytest.approx(trace, abs=1e-10)
    assert orbit.multipliers.prod() == pytest.approx(restitution**2, abs=1e-10)
    assert orbit.stable == (sign > 0 and share < 1.0)


def test_beyond_the_doubling_there_is_a_stable_orbit_of_two_bounces() -> None:
    born, doubled = strengths(0.5, 1)
    ball, state = bounce(doubled + 0.02 * (doubled - born), 0.5, 1, 1)
    motion = ball.iterate(state + np.array([1e-2, 0.0]), 400)
    orbit = periodic_orbit(ball, motion[-2:].round(2))
    assert orbit.label == "P(2)"
    assert orbit.stable
    gaps = abs(ball.difference(orbit.states[:, None], motion[-2:][None])).max(axis=2)
    assert gaps.min(axis=1).max() < 1e-9
    assert abs(orbit.multipliers.prod()) == pytest.approx(0.5**4, rel=1e-9)


def test_where_bounces_are_not_born_yet_there_is_none() -> None:
    born, _ = strengths(0.5, 1)
    ball, state = bounce(1.2 * born, 0.5, 1, 1)
    weak = ball.replace(amplitude=0.9 * born / 9.0)
    with pytest.raises(NoConvergence, match="no periodic orbit found"):
        periodic_orbit(weak, state)


@pytest.mark.parametrize(
    ("frequency", "periods"), [(1.9, 1), (2.2, 1), (2.5, 1), (2.8, 1), (2.8, 2)]
)
def test_orbits_of_one_mass(frequency: float, periods: int) -> None:
    system = SingleImpactOscillator(
        frequency=frequency, damping_ratio=0.02, restitution=0.8, stop=0.1
    )
    (exact,) = periodic_orbits(system, periods)
    orbit = periodic_orbit(system, exact.state * (1.0 + 1e-5))
    assert abs(system.difference(orbit.states[0], exact.state)).max() <= orbit.error
    found = sorted(orbit.multipliers, key=lambda z: (abs(z), z.imag))
    # their derivative by the state is of the order of their squares over u
    scale = (1.0 + abs(exact.multipliers).max()) ** 2 / float(exact.u)
    assert found == pytest.approx(exact.multipliers, abs=100.0 * scale * orbit.error)
    assert orbit.stable == exact.stable


@pytest.mark.parametrize(
    ("frequency", "label"), [(0.87, "P(1)"), (0.8, "P(2)"), (0.68, "P(3)"), (0.5, "P(15)")]
)
def test_what_a_chain_settles_on_is_found(frequency: float, label: str) -> None:
    chain = ImpactChain(frequency=frequency)
    attractor = chain.attractor(transient=3000, impacts=60)
    n = attractor.label.iterates
    assert n is not None
    orbit = periodic_orbit(chain, attractor.states[-n:])
    assert orbit.label == label
    assert orbit.stable
    gap = abs(chain.difference(orbit.states, attractor.states[-n:])).max()
    assert gap <= orbit.error + attractor.error


def test_impulses_as_unknowns_give_the_same_orbit() -> None:
    chain = ImpactChain(frequency=0.87)
    other = chain.periodic_orbit(impacts=1, periods=3)
    orbit = periodic_orbit(chain, other.states * (1.0 + 1e-6))
    gap = abs(chain.difference(orbit.states, other.states)).max()
    assert gap <= orbit.error + other.error
    assert abs(orbit.multipliers[0]) == pytest.approx(abs(other.multipliers[0]), rel=1e-9)
    assert np.prod(abs(orbit.multipliers)) == pytest.approx(
        np.prod(abs(other.multipliers)), rel=1e-6
    )
