"""What structures cost: complex modes, contact anywhere, forces, subclasses, derivations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from dynkit.systems import ImpactChain, MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.benchmarks.report import Line, in_turns

FREQUENCY = 0.35
DAMPING = 0.1


class OwnEnergies(ImpactChain):
    """The chain's energies, written out by a user."""

    def kinetic(self, v: Any) -> Any:
        return sum(rate**2 for rate in v) / 2

    def potential(self, x: Any) -> Any:
        return x[0] ** 2 / 2 + sum((b - a) ** 2 for a, b in pairwise(x)) / 2

    def dissipation(self, v: Any) -> Any:
        return DAMPING * self.potential(v)


def gradings(n: int) -> Iterator[tuple[str, ImpactOscillator]]:
    """Chains whose dashpots are not proportional to their springs."""
    one = np.ones(n)
    one[n // 2] = 10.0
    random = 1.0 + 0.5 * np.random.default_rng(0).uniform(-1.0, 1.0, n)
    for name, dashpots in (
        ("dashpots 0.05 to 0.15, linear", np.linspace(0.05, 0.15, n)),
        ("dashpots 0.01 to 0.2, linear", np.linspace(0.01, 0.2, n)),
        ("one dashpot ten times the others", 0.1 * one),
        ("dashpots 0.05 to 0.15, random", 0.1 * random),
        ("dashpots 0.01 to 1, geometric", np.geomspace(0.01, 1.0, n)),
    ):
        yield name, ImpactChain(masses=n, damping=tuple(dashpots), frequency=FREQUENCY)
    springs = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    springs[-1, -1] = 1.0
    end = np.zeros((n, n))
    end[-1, -1] = DAMPING
    for name, damping in (
        ("dashpot from the last mass to the ground only", end),
        ("proportional dashpots, and one to the ground", DAMPING * springs + 10.0 * end),
    ):
        yield name, MatrixOscillator(M=np.eye(n), C=damping, K=springs, frequency=FREQUENCY)


def beside(systems: Mapping[str, ImpactOscillator], impacts: int, first: str) -> Iterator[Line]:
    """An impact of each system, beside that of the first, whose name in the table is given."""
    calls = []
    for system in systems.values():
        n = system.degrees_of_freedom
        phase = np.pi if system.side == "above" else 0.0
        start = system.state(np.zeros(n), np.zeros(n), phase=phase)
        start = system.simulate(impacts=100, start=start).final
        calls.append(partial(system.simulate, impacts=impacts, start=start))
        calls[-1]()
    reference, *others = (seconds / impacts for seconds in in_turns(*calls))
    for name, seconds in zip(list(systems)[1:], others, strict=True):
        yield Line(f"impact, {n} masses, {name}", seconds, first, reference)


def complex_modes(sizes: tuple[int, ...] = (10, 100)) -> Iterator[Line]:
    """Dashpots that couple the modes."""
    for n in sizes:
        plain = ImpactChain(masses=n, damping=DAMPING, frequency=FREQUENCY)
        systems: dict[str, ImpactOscillator] = {"proportional": plain, **dict(gradings(n))}
        yield from beside(systems, max(20_000 // n, 100), "damping proportional to the springs")


def generic_contact(n: int = 10) -> Iterator[Line]:
    """Stops anywhere, forces, and energies of a user's own."""
    plain = ImpactChain(masses=n, frequency=FREQUENCY)
    force = np.zeros(n)
    force[0] = 0.02
    systems: dict[str, ImpactOscillator] = {
        "plain": plain,
        "contact inside": plain.replace(contact=n // 2),
        "below the table": plain.replace(side="below"),
        "play": plain.replace(play=0.5),
        "harmonic force": plain.replace(harmonic_forces=tuple(force)),
        "gravity": plain.replace(constant_forces=(-0.001,) * n),
        "stop at rest, harmonic force": plain.replace(
            amplitude=0.0, harmonic_forces=tuple(10.0 * force)
        ),
        "energies of a subclass": OwnEnergies(masses=n, frequency=FREQUENCY),
    }
    yield from beside(systems, 20_000, "the plain chain")


def derivations() -> Iterator[Line]:
    """SymPy's part, modes included, of energies that a user has written."""
    for n in (100, 1000):
        springs = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        systems: tuple[ImpactOscillator, ...] = (
            MatrixOscillator(M=np.eye(n), C=0.1 * springs, K=springs, frequency=FREQUENCY),
            OwnEnergies(masses=n, frequency=FREQUENCY),
        )
        matrices, energies = (
            in_turns(partial(getattr, system, "modes"), runs=1)[0] for system in systems
        )
        what = f"from energies of a subclass to modes, {n} masses"
        yield Line(what, energies, "from matrices to modes", matrices)


def new_modes(n: int = 300) -> Iterator[Line]:
    """The first impact of a chain, with its modes, where dashpots couple them."""
    chains = dict(gradings(n))
    plain = ImpactChain(masses=n, damping=DAMPING, frequency=FREQUENCY)
    chosen = ("dashpots 0.05 to 0.15, random", "dashpots 0.01 to 0.2, linear")
    for system in dict(gradings(40)).values():  # compiles
        system.simulate(impacts=1)
    calls = [
        partial(system.simulate, impacts=1)
        for system in (plain, *(chains[name] for name in chosen))
    ]
    reference, *others = (seconds for seconds in in_turns(*calls, runs=1))
    for name, seconds in zip(chosen, others, strict=True):
        what = f"first impact and new modes, {n} masses, {name}"
        yield Line(what, seconds, "damping proportional to the springs", reference)


def structures() -> Iterator[Line]:
    """All lines of this file."""
    yield from complex_modes()
    yield from new_modes()
    yield from generic_contact()
    yield from derivations()
