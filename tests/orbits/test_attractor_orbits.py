"""The orbit that an attractor of a map settles on."""

import numpy as np
import pytest

from dynkit import Map, MapAttractor
from dynkit.core.validation import Array, finite_array
from dynkit.orbits.newton import NoConvergence
from dynkit.systems import DelayedLogistic, Henon, HighBounce, Logistic
from tests.example_systems import CircleRotation


@pytest.mark.parametrize(
    ("system", "start", "label"),
    [
        (Logistic(2.8), [0.3], "P(1)"),
        (Logistic(3.2), [0.3], "P(2)"),
        (Logistic(3.5), [0.3], "P(4)"),
        (Logistic(3.55), [0.3], "P(8)"),
        (Logistic(3.83), [0.3], "P(3)"),
        (Henon(0.9), [0.1, 0.1], "P(2)"),
        (Henon(1.0), [0.1, 0.1], "P(4)"),
        (DelayedLogistic(1.9), [0.4, 0.4], "P(1)"),
        (HighBounce(restitution=0.8, gamma=2.0), [4.0, 6.2], "P(1)"),
    ],
)
def test_it_is_the_orbit_that_the_label_names(system: Map, start: list[float], label: str) -> None:
    attractor = MapAttractor(system, np.array(start), transient=1000, iterations=100)
    orbit = attractor.periodic_orbit()
    assert orbit.label == str(attractor.label) == label
    assert orbit.stable
    last = attractor.states[-orbit.period :]
    gaps = abs(system.difference(orbit.states[:, None], last[None])).max(axis=2)
    assert gaps.min(axis=1).max() <= orbit.error + attractor.error


@pytest.mark.parametrize("transient", [0, 3, 30])
def test_a_motion_that_is_still_settling_gives_the_same_orbit(transient: int) -> None:
    settled = MapAttractor(Logistic(3.4), np.array([0.3]), 1000, 100).periodic_orbit()
    settling = MapAttractor(Logistic(3.4), np.array([0.3]), transient, 2).periodic_orbit()
    assert np.sort(settling.states[:, 0]) == pytest.approx(
        np.sort(settled.states[:, 0]), abs=settled.error + settling.error
    )


def test_near_a_doubling_newtons_method_is_far_ahead_of_the_motion() -> None:
    # the multiplier of 1 - 1/r is 2 - r: a disturbance takes a hundred iterates to fall by e
    rate = 2.99
    attractor = MapAttractor(Logistic(rate), np.array([0.6]), transient=0, iterations=1000)
    orbit = attractor.periodic_orbit()
    assert abs(attractor.states[-1, 0] - (1.0 - 1.0 / rate)) > 1e-7
    assert abs(orbit.states[0, 0] - (1.0 - 1.0 / rate)) <= orbit.error < 1e-12


@pytest.mark.parametrize(
    ("system", "start", "kind"),
    [
        (Logistic(4.0), [0.3], "chaotic"),
        (Henon(), [0.1, 0.1], "chaotic"),
        (CircleRotation(np.pi * (np.sqrt(5.0) - 1.0)), [1.0, 1.0], "quasi-periodic"),
    ],
)
def test_without_a_period_there_is_no_orbit(system: Map, start: list[float], kind: str) -> None:
    attractor = MapAttractor(system, np.array(start), transient=200, iterations=100)
    with pytest.raises(ValueError, match=f"attractor must be periodic; got one that is {kind}"):
        attractor.periodic_orbit()


class SecantThroughZero(Logistic):
    """Its derivative is none: it sends Newton's method to the fixed point 0 from anywhere."""

    def jacobian(self, state: Array) -> Array:
        (x,) = finite_array("state", state, (1,))
        return np.array([[self.rate * (1.0 - x)]])


def test_an_orbit_elsewhere_is_refused() -> None:
    attractor = MapAttractor(SecantThroughZero(2.9), np.array([0.6]), 30, 100)
    assert str(attractor.label) == "P(1)"
    with pytest.raises(
        NoConvergence, match=r"left the attractor P\(1\) for an orbit P\(1\) that is"
    ):
        attractor.periodic_orbit()
