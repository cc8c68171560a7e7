"""Chains at the edges of what double precision allows, for comparison with 50 digits.

Every case is small enough that the reference takes seconds. The references see the numbers of a
case as they are; a system under test gets the same doubles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Final

from tests.reference.general_oscillator import (
    BITS,
    Contact,
    GeneralOscillator,
    History,
    Impact,
    chain_of,
)
from tests.reference.uniform_chain import UniformChain

RESTITUTIONS: Final = (0.0, 1e-12, 0.85, 1.0 - 1e-12, 1.0)
SIZES: Final = (1, 2, 3, 10)
RATIO: Final = 1e12
LONGEST: Final = 30
"""Masses of a chain whose matrix exponential is simulated."""


@dataclass(frozen=True)
class ExtremeCase:
    """A chain, as for ``ImpactChain``, and where it starts.

    ``on_table`` puts the last mass onto the table with this relative velocity, whatever its entries
    say.
    """

    name: str
    masses: tuple[float, ...]
    springs: tuple[float, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    damping: float | tuple[float, ...] = 0.1
    restitution: float = 0.85
    amplitude: float = 0.1
    offset: float = 0.0
    frequency: float = 0.87
    phase: float = 0.0
    impacts: int = 12
    on_table: float | None = None

    def oscillator(self, bits: int = BITS) -> GeneralOscillator:
        """The same chain to 50 digits."""
        return chain_of(
            self.masses,
            self.springs,
            self.damping,
            restitution=self.restitution,
            amplitude=self.amplitude,
            offset=self.offset,
            frequency=self.frequency,
            bits=bits,
        )

    def simulate(self, bits: int = BITS) -> History:
        """Its impacts, to 50 digits; long chains must be uniform, and have their own precision."""
        if len(self.masses) > LONGEST:
            return self._simulate_modes()
        return self.oscillator(bits).simulate(
            self.position,
            self.velocity,
            self.phase,
            self.impacts,
            relative_velocity=self.on_table,
        )

    def _simulate_modes(self) -> History:
        """By modes in closed form; contact for ever is not among the contacts."""
        assert isinstance(self.damping, float)
        if set(self.masses) != {1.0} or set(self.springs) != {1.0}:
            raise ValueError(f"chains of more than {LONGEST} masses must have units; {self.name}")
        found = UniformChain(
            len(self.masses),
            damping=self.damping,
            restitution=self.restitution,
            amplitude=self.amplitude,
            offset=self.offset,
            frequency=self.frequency,
        ).simulate(self.impacts, self.position, self.velocity, self.phase, self.on_table)
        return History(
            [
                Impact(p.time, p.phase, p.relative_velocity, p.position, p.velocity, "near")
                for p in found.impacts
            ],
            [Contact(start, release, "near") for start, release in found.contacts],
            found.ending,
        )


def integer_springs(n: int) -> tuple[float, ...]:
    """Springs that give unit masses the natural frequency 1 exactly, in the shape (1, 2, ..., n).

    Spring i carries the inertia of the masses i to n and is stretched by 1.
    """
    return tuple(float(sum(range(i, n + 1))) for i in range(1, n + 1))


def base(name: str, n: int) -> ExtremeCase:
    """Unit masses and springs, let go above the table."""
    shape = tuple(0.3 + 0.6 * (i + 1) / n for i in range(n))
    return ExtremeCase(name, (1.0,) * n, (1.0,) * n, shape, (0.0,) * n)


@lru_cache(maxsize=1)
def extreme_cases() -> dict[str, ExtremeCase]:
    """All cases by name."""
    makers = (
        _impacts_and_damping,
        _critical,
        _ratios,
        _frequencies,
        _resonances,
        _tables,
        _starts,
        _dashpots,
    )
    found = [case for maker in makers for case in maker()]
    cases = {case.name: case for case in found}
    assert len(cases) == len(found)
    return cases


@lru_cache(maxsize=1)
def large_cases() -> dict[str, ExtremeCase]:
    """Chains of 100 masses, seconds each to simulate, and of 1000 masses, a minute each."""
    cases = {}
    for n, damping, r in product((100, 1000), (0.0, 0.1, 1e3), (0.0, 0.85, 1.0)):
        name = f"N={n} damping={damping:g} restitution={r:g}"
        velocity = (0.0,) * (n - 1) + (-1.0,)
        case = replace(base(name, n), velocity=velocity, damping=damping, restitution=r)
        cases[name] = replace(case, impacts=4 if n == 1000 else 12)
    return cases


def _impacts_and_damping() -> Iterator[ExtremeCase]:
    for n, r, c in product(SIZES, RESTITUTIONS, (0.0, 1e-12, 0.1, 1e3, 1e8)):
        yield replace(base(f"N={n} restitution={r!r} damping={c:g}", n), restitution=r, damping=c)


def _critical() -> Iterator[ExtremeCase]:
    """Damping critical for the lowest mode: the others are overdamped."""
    for n, r, off in product(SIZES, RESTITUTIONS, (-1e-9, 0.0, 1e-9)):
        case = base(f"N={n} restitution={r!r} critical{off:+g}", n)
        springs, damping = integer_springs(n), 2.0 * (1.0 + off)
        yield replace(case, springs=springs, damping=damping, restitution=r)
    # Frequencies 1 and 2, the upper one critical.
    for off in (-1e-9, 0.0, 1e-9):
        case = base(f"upper of two critical{off:+g}", 2)
        yield replace(case, masses=(1.0, 0.5), springs=(2.0, 1.0), damping=1.0 + off)


def _ratios() -> Iterator[ExtremeCase]:
    """One element unlike the others by a factor of 1e12, either way."""
    for n, c, factor in product((1, 2, 3, 10), (0.0, 0.1), (1.0 / RATIO, RATIO)):
        for place in sorted({0, n // 2, n - 1}):
            values = tuple(factor if i == place else 1.0 for i in range(n))
            name = f"N={n} damping={c:g} number {place + 1} {factor:g}"
            # Thrown down: a heavy mass would take 1e6 periods to come down with the others.
            velocity = (0.0,) * (n - 1) + (-1.0,)
            case = replace(base(name, n), velocity=velocity, damping=c, impacts=6)
            yield replace(case, name=f"mass {name}", masses=values)
            yield replace(case, name=f"spring {name}", springs=values)
    masses, springs = (1.0, RATIO, 1.0 / RATIO), (1.0, RATIO, 1.0 / RATIO)
    yield replace(base("masses 1e-12 to 1e12", 3), masses=masses, impacts=6)
    yield replace(base("springs 1e-12 to 1e12", 3), springs=springs, impacts=6)
    yield replace(base("masses and springs 1e-12 to 1e12", 3), masses=masses, springs=springs)


def _frequencies() -> Iterator[ExtremeCase]:
    for n, w, r in product((1, 3), (1e-6, 1e-3, 1e3, 1e6), (0.0, 0.85, 1.0)):
        case = base(f"N={n} frequency={w:g} restitution={r:g}", n)
        yield replace(case, frequency=w, restitution=r)


def _resonances() -> Iterator[ExtremeCase]:
    """The table at an undamped natural frequency: in flight, and of the masses held in contact."""
    for n, r in product(SIZES, (0.0, 0.85, 1.0)):
        case = base(f"N={n} undamped at its own frequency restitution={r:g}", n)
        yield replace(case, springs=integer_springs(n), damping=0.0, frequency=1.0, restitution=r)
    for r, offset in product((0.0, 0.3), (0.05, 2.0)):
        # Held, the first of two masses has frequency 2.
        case = base(f"held mass at its own frequency restitution={r:g} offset={offset:g}", 2)
        yield replace(
            case,
            springs=(3.0, 1.0),
            position=(0.5, 3.0),
            damping=0.0,
            frequency=2.0,
            restitution=r,
            offset=offset,
            impacts=80,
        )


def _tables() -> Iterator[ExtremeCase]:
    for n, a, r in product((1, 3), (0.0, 1e-300, 1e6), (0.0, 0.85)):
        case = base(f"N={n} amplitude={a:g} restitution={r:g}", n)
        yield replace(case, amplitude=a, restitution=r)
    for n, c, r in product((1, 3), (0.0, 0.1), (0.0, 0.85)):
        case = replace(base(f"N={n} damping={c:g} restitution={r:g}", n), damping=c, restitution=r)
        # Out of reach below; the mass is held down by its springs above.
        yield replace(case, name=f"table far below {case.name}", offset=-1e3)
        high = (1001.0,) * n
        yield replace(case, name=f"table far above {case.name}", offset=1e3, position=high)
    # The undamped mass swings to -0.9: hits the top of the table by little, or misses by little.
    for miss in (1e-3, -1e-3, 1e-9, -1e-9):
        case = base(f"table at rest missed by {miss:g}", 1)
        yield replace(case, damping=0.0, amplitude=0.0, offset=-0.9 - miss)


def _starts() -> Iterator[ExtremeCase]:
    for n, v, r in product((1, 3), (-1.0, 0.0, 1.0), (0.0, 0.85)):
        case = base(f"N={n} 1e-15 above the table velocity={v:g} restitution={r:g}", n)
        position, velocity = (0.2,) * (n - 1) + (1e-15,), (0.0,) * (n - 1) + (v,)
        yield replace(case, position=position, velocity=velocity, restitution=r)
    for n, phase, u, r in product((1, 3), (0.0, 2.0, 4.0), (0.0, 1e-15, 1.0), (0.0, 0.3)):
        case = base(f"N={n} on the table phase={phase:g} u={u:g} restitution={r:g}", n)
        impacts = 12 if r == 0.0 else 80  # beyond the first chatter
        yield replace(case, phase=phase, on_table=u, restitution=r, impacts=impacts)


def _dashpots() -> Iterator[ExtremeCase]:
    """Dashpots that do not go with the springs."""
    for c, r in product((1e-12, 1.0, 1e3), (0.0, 0.85)):
        case = replace(base(f"dashpot={c:g} restitution={r:g}", 3), restitution=r, impacts=8)
        yield replace(case, name=f"first {case.name}", damping=(c, 0.0, 0.0))
        yield replace(case, name=f"last {case.name}", damping=(0.0, 0.0, c))
