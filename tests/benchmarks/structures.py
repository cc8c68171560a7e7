"""What structures cost: complex modes, contact anywhere, forces, subclasses, derivations.

Every ratio is one of times taken in turns, in one run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynkit.systems import ImpactChain, MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from tests.benchmarks.report import table

Array = NDArray[np.float64]

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


def in_turns(calls: Mapping[str, Callable[[], object]], runs: int = 7) -> dict[str, float]:
    """Shortest time of each call, the calls taken in turns."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(runs):
        for name, call in calls.items():
            began = perf_counter()
            call()
            best[name] = min(best[name], perf_counter() - began)
    return best


def gradings(n: int) -> Iterator[tuple[str, ImpactOscillator]]:
    """Chains whose dashpots are not proportional to their springs."""
    one = np.ones(n)
    one[n // 2] = 10.0
    random = 1.0 + 0.5 * np.random.default_rng(0).uniform(-1.0, 1.0, n)
    for name, dashpots in (
        ("linear, 0.05 to 0.15", np.linspace(0.05, 0.15, n)),
        ("linear, 0.01 to 0.2", np.linspace(0.01, 0.2, n)),
        ("one ten times the others", 0.1 * one),
        ("random, 0.05 to 0.15", 0.1 * random),
        ("geometric, 0.01 to 1", np.geomspace(0.01, 1.0, n)),
    ):
        yield name, ImpactChain(masses=n, damping=tuple(dashpots), frequency=FREQUENCY)
    springs = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    springs[-1, -1] = 1.0
    end = np.zeros((n, n))
    end[-1, -1] = DAMPING
    for name, damping in (
        ("from the last mass to the ground only", end),
        ("proportional, and to the ground at the last mass", DAMPING * springs + 10.0 * end),
    ):
        yield name, MatrixOscillator(M=np.eye(n), C=damping, K=springs, frequency=FREQUENCY)


def beside(systems: Mapping[str, ImpactOscillator], impacts: int) -> list[tuple[str, ...]]:
    """Name, links, cost of an impact, its ratio to the first system's, flight time and cells."""
    starts, records = {}, {}
    for name, system in systems.items():
        n = system.degrees_of_freedom
        if system.side == "above":
            start = system.state(np.zeros(n), np.zeros(n), phase=np.pi)
        else:
            start = system.state(np.zeros(n), np.zeros(n), phase=0.0)
        starts[name] = system.simulate(impacts=100, start=start).final
        records[name] = system.simulate(impacts=impacts, start=starts[name])

    def again(name: str) -> Callable[[], object]:
        return lambda: systems[name].simulate(impacts=impacts, start=starts[name])

    times = in_turns({name: again(name) for name in systems})
    each = {name: times[name] / len(record) for name, record in records.items()}
    first = next(iter(each.values()))
    return [
        (
            name,
            str(systems[name]._free.pairs.links.shape[1]),
            f"{1e6 * each[name]:.2f}",
            f"{each[name] / first:.2f}",
            f"{float(record.time[-1]) / len(record):.1f}",
            f"{record.cost.counts['cells'] / len(record):.1f}",
        )
        for name, record in records.items()
    ]


HEAD = ("structure", "links", "us per impact", "ratio", "flight time", "cells")


def complex_modes(sizes: tuple[int, ...] = (10, 30, 100)) -> None:
    for n in sizes:
        systems: dict[str, ImpactOscillator] = {
            "proportional": ImpactChain(masses=n, damping=DAMPING, frequency=FREQUENCY)
        }
        systems |= gradings(n)
        began = perf_counter()
        slowest = 0.0
        for system in systems.values():
            _ = system._gaps
            slowest = max(slowest, perf_counter() - began)
            began = perf_counter()
        title = f"Dashpots not proportional to springs, N = {n}, set-up at most {slowest:.1f} s"
        table(title, HEAD, beside(systems, max(20_000 // n, 100)))


def generic_contact(n: int = 10) -> None:
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
    }
    table(f"Contact and forces, N = {n}", HEAD, beside(systems, 20_000))


def own_energies(n: int = 10) -> None:
    systems: dict[str, ImpactOscillator] = {
        "ImpactChain": ImpactChain(masses=n, frequency=FREQUENCY),
        "subclass with energies of its own": OwnEnergies(masses=n, frequency=FREQUENCY),
    }
    table(f"Subclasses, N = {n}", HEAD, beside(systems, 20_000))


def derivations() -> None:
    """SymPy's part, modes included; then the same structure once more in the same process."""
    rows = []
    for n in (10, 100, 1000):
        for name, kind in (("ImpactChain", ImpactChain), ("subclass", OwnEnergies)):
            began = perf_counter()
            _ = kind(masses=n, frequency=FREQUENCY).modes
            first = perf_counter() - began
            began = perf_counter()
            _ = kind(masses=n, frequency=0.5).modes
            rows.append((n, name, f"{first:.3f}", f"{1e3 * (perf_counter() - began):.3f}"))
    head = ("N", "structure", "first (s)", "with another frequency (ms)")
    table("From energies to modes", head, rows)


def structures() -> None:
    """All tables of this file."""
    complex_modes()
    generic_contact()
    own_energies()
    derivations()
