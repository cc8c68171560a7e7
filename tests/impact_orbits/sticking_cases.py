"""Orbits that stick, and the map from one release to the next by simulation alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.systems.impact.impact_map import ImpactMap
from dynkit.systems.impact.orbits.orbit import ImpactOrbit
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from tests.reference.general_oscillator import GeneralOscillator, chain_of

TURN = 2.0 * math.pi

IMPACTS = 400
"""More than happen, or are simulated, in one period of any orbit here."""

SYSTEMS: dict[str, tuple[ImpactOscillator, int]] = {
    "chain of 10, 0.202": (ImpactChain(frequency=0.202), 1),
    "chain of 10, 0.408": (ImpactChain(frequency=0.408), 2),
    "chain of 10, unstable": (ImpactChain(frequency=0.408, restitution=0.0), 1),
    "chain of 10, dead": (ImpactChain(frequency=0.202, restitution=0.0), 1),
    "chain of 3, 0.3": (ImpactChain(masses=3, frequency=0.408, restitution=0.3), 1),
    "chain of 3, 0.6": (ImpactChain(masses=3, frequency=0.202, restitution=0.6), 1),
    "chain of 2, 0.6": (ImpactChain(masses=2, frequency=0.408, restitution=0.6), 1),
    "chain of 2, 0.85": (ImpactChain(masses=2, frequency=0.202, restitution=0.85), 1),
    "forces": (
        ImpactChain(
            masses=3,
            frequency=0.5,
            restitution=0.5,
            damping=0.2,
            harmonic_forces=(0.1, 0.0, -0.05 + 0.1j),
        ),
        1,
    ),
    "weights": (
        ImpactChain(
            masses=2,
            frequency=0.4,
            restitution=0.5,
            damping=0.2,
            offset=0.02,
            constant_forces=(0.01, 0.015),
        ),
        1,
    ),
    "below": (
        ImpactChain(masses=2, frequency=0.4, restitution=0.5, damping=0.2, side="below"),
        1,
    ),
    "contact inside": (
        ImpactChain(masses=3, contact=1, frequency=0.4, restitution=0.5, damping=0.2),
        1,
    ),
    "dashpots": (
        ImpactChain(masses=3, frequency=0.4, restitution=0.5, damping=(0.02, 0.3, 0.1)),
        1,
    ),
    "chain in a play": (
        ImpactChain(
            masses=2,
            frequency=0.3,
            restitution=0.6,
            damping=0.2,
            offset=-0.075,
            play=0.15,
            harmonic_forces=(0.0, 0.5),
        ),
        1,
    ),
    "chain of 1": (ImpactChain(masses=1, frequency=0.408, restitution=0.3), 1),
    "ball": (BouncingBall(amplitude=1.3, frequency=1.0, restitution=0.2), 1),
    "dead ball": (BouncingBall(amplitude=1.3, frequency=1.0, restitution=0.0), 1),
    "single": (
        SingleImpactOscillator(frequency=0.2, restitution=0.3, damping_ratio=0.1, stop=0.5),
        1,
    ),
    "play": (
        PlayOscillator(
            play=1.0,
            spring=0.5,
            damping=0.1,
            force=1.0,
            amplitude=0.2,
            frequency=0.3,
            restitution=0.6,
        ),
        1,
    ),
}
"""Oscillators, and the number m of periods of the orbit that is looked at."""

SEVERAL = [name for name, (system, _) in SYSTEMS.items() if system.degrees_of_freedom > 1]
"""Those with other multipliers than zero."""


@cache
def orbit_of(name: str) -> ImpactOrbit:
    system, periods = SYSTEMS[name]
    if name == "chain in a play":
        start = system.state([0.0, 0.03], [0.0, 0.0])
        found = system.attractor(start=start).periodic_orbit()
        assert isinstance(found, ImpactOrbit)
        assert found.sticks
        return found
    return system.periodic_orbit(sticking=True, periods=periods)


# --- the release section --------------------------------------------------------------------------


@dataclass(frozen=True)
class Releases:
    """What leaves a stop, by the matrices of the oscillator, whose mass matrix is diagonal.

    Places are positions and velocities (2N - 2,) of all coordinates but that in contact.
    """

    system: ImpactMap
    far: bool = False

    @property
    def _sign(self) -> float:
        above = self.system.side == "above"
        return 1.0 if above != self.far else -1.0

    @property
    def others(self) -> Array:
        n = self.system.degrees_of_freedom
        return np.delete(np.arange(n), self.system.contact)

    def whole(self, places: Array, phase: float) -> tuple[Array, Array]:
        """Positions and velocities (N,), the contact coordinate on its stop."""
        s, n = self.system, self.system.degrees_of_freedom
        x, v = np.empty((2, n))
        x[self.others], v[self.others] = places.reshape(2, -1)
        stop = s.offset - self._sign * s.play if self.far else s.offset
        x[s.contact] = s.amplitude * math.sin(phase) + stop
        v[s.contact] = s.amplitude * s.frequency * math.cos(phase)
        return x, v

    def force(self, places: Array, phase: float) -> float:
        """What the stop must push with, to keep the contact coordinate on it."""
        s, c = self.system, self.system.contact
        x, v = self.whole(places, phase)
        inertia = -s.mass[c, c] * s.amplitude * s.frequency**2 * math.sin(phase)
        given = 0.0
        if len(s.harmonic_forces):
            given += (s.harmonic_forces[c] * np.exp(1j * phase)).imag
        if len(s.constant_forces):
            given += s.constant_forces[c]
        pull = float(s.damping_matrix[c] @ v + s.stiffness[c] @ x)
        return float(self._sign * (inertia + pull - given))

    def phase(self, places: Array, guess: float) -> float:
        """The phase near a guess at which the force is zero."""
        h = 1e-5
        for _ in range(20):
            slope = (self.force(places, guess + h) - self.force(places, guess - h)) / (2.0 * h)
            step = self.force(places, guess) / slope
            guess -= step
            if abs(step) < 1e-15:
                break
        return guess

    def section(self, places: Array, phase: float) -> Array:
        """Section coordinates (2N,)."""
        return np.concatenate([places, [-0.0 if self.far else 0.0, phase]])


def releases_of(orbit: ImpactOrbit, k: int = 0) -> tuple[Releases, Array, float]:
    """The release number k of an orbit: its stop, places and phase."""
    state = orbit.states[k]
    return Releases(orbit.system, bool(np.signbit(state[-2]))), state[:-2], float(orbit.phases[k])


def simulated(
    releases: Releases, places: Array, phase: float, periods: float
) -> tuple[Array, float]:
    """Places and phase at the release about so many periods later."""
    system = releases.system
    start = system.impact_state(releases.section(places, phase))
    record = system.simulate(impacts=IMPACTS, start=start)
    ends = record.sticking[:, 1]
    time = float(ends[np.argmin(abs(ends * system.frequency / TURN - periods))])
    assert abs(time * system.frequency / TURN - periods) < 0.2
    x, v = record.sample([time])
    others = releases.others
    return np.concatenate([x[0, others], v[0, others]]), phase + system.frequency * time


def returned(orbit: ImpactOrbit, places: Array) -> Array:
    """Places (2N - 2,) at the release an orbit's period after a release with given places."""
    releases, _, phase = releases_of(orbit)
    start = releases.phase(places, phase)
    return simulated(releases, places, start, orbit.periods)[0]


def differences(function: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Derivative by central differences of two steps, the error of the second order removed."""
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = steps[k]
        pair = [(function(x + c * step) - function(x - c * step)) / (2.0 * c) for c in (1.0, 2.0)]
        columns.append((4.0 * pair[0] - pair[1]) / (3.0 * steps[k]))
    return np.stack(columns, axis=-1) if columns else np.empty((0, 0))


@cache
def monodromy(name: str) -> Array:
    """Derivative (2N - 2, 2N - 2) of the simulated map from a release to that a period later."""
    orbit = orbit_of(name)
    _, places, _ = releases_of(orbit)
    half = len(places) // 2
    sizes = [abs(part).max() for part in orbit.sample(np.linspace(0.0, orbit.period, 200))]
    steps = 2e-4 * np.repeat(sizes, half)
    return differences(lambda z: returned(orbit, z), places, steps)


# --- 50 digits ------------------------------------------------------------------------------------


def exact_of(system: ImpactMap, stick_below: str) -> GeneralOscillator:
    """The same oscillator to 50 digits and more."""
    parameters: dict[str, Any] = {
        "frequency": system.frequency,
        "restitution": system.restitution,
        "amplitude": system.amplitude,
        "offset": system.offset,
        "contact": system.contact,
        "side": system.side,
        "harmonic_forces": [complex(f) for f in system.harmonic_forces],
        "constant_forces": [float(g) for g in system.constant_forces],
        "stick_below": stick_below,
        "bits": 256,
    }
    if math.isfinite(system.play):
        sign = 1.0 if system.side == "above" else -1.0
        parameters["far_stop"] = system.offset + sign * system.play
    if isinstance(system, ImpactChain):
        n = system.degrees_of_freedom
        masses = [1.0] * n if isinstance(system.masses, int) else system.masses
        springs = [system.springs] * n if isinstance(system.springs, float) else system.springs
        return chain_of(masses, springs, system.damping, **parameters)
    matrices = [m.tolist() for m in (system.mass, system.damping_matrix, system.stiffness)]
    return GeneralOscillator(*matrices, **parameters)
