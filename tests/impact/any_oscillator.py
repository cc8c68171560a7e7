"""Impact oscillators of any kind, with starts, for Hypothesis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import assume, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.oscillators.ball import BouncingBall
from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.oscillators.play import PlayOscillator
from dynkit.systems.impact.oscillators.single import SingleImpactOscillator
from dynkit.systems.impact.records.record import ImpactRecord
from dynkit.systems.impact.simulation.state import ImpactState

RESTITUTIONS = st.floats(1e-3, 1.0) | st.sampled_from([0.0, 1.0])


@dataclass(frozen=True)
class Begin:
    """An oscillator, and where to start from."""

    system: Any
    position: Array
    velocity: Array
    phase: float

    @property
    def state(self) -> ImpactState:
        state: ImpactState = self.system.state(self.position, self.velocity, self.phase)
        return state

    def simulate(self, impacts: int) -> ImpactRecord:
        record: ImpactRecord = self.system.simulate(impacts=impacts, start=self.state)
        return record

    def changed(self, **arguments: Any) -> Begin:
        """The same start of an oscillator with other arguments."""
        return Begin(self.system.replace(**arguments), self.position, self.velocity, self.phase)


def semidefinite(random: np.random.Generator, n: int, rank: int) -> Array:
    """A symmetric matrix of at most that rank, of order one."""
    factor = random.normal(size=(n, rank)) / math.sqrt(max(rank, 1))
    return np.asarray(factor @ factor.T)


def chain_links(random: np.random.Generator, n: int) -> Array:
    """Springs of order one from mass to mass, the first one to the wall."""
    links = random.uniform(0.2, 3.0, n)
    step = np.eye(n) - np.eye(n, k=-1)
    return np.asarray(step.T @ np.diag(links) @ step)


@st.composite
def structures(draw: st.DrawFn, largest: int = 8, *, damped: bool = True) -> dict[str, Any]:
    """Matrices M, C, K: diagonal or coupled, of full rank or not, damping of any kind or none."""
    n = draw(st.integers(1, largest))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mass = np.diag(random.uniform(0.2, 5.0, n))
    if draw(st.booleans()):
        mass = mass + 0.5 * semidefinite(random, n, n)
    if draw(st.booleans()):
        stiffness = chain_links(random, n)
    else:
        stiffness = semidefinite(random, n, draw(st.sampled_from([n, n, max(n - 1, 1)])))
    stiffness *= draw(st.sampled_from([1.0, 1.0, 0.1, 20.0]))
    damping = np.zeros((n, n))
    kind = draw(st.sampled_from(["none", "stiffness", "mass", "any"])) if damped else "none"
    size = draw(st.sampled_from([0.01, 0.1, 1.0]))
    if kind == "stiffness":
        damping = size * stiffness
    elif kind == "mass":
        damping = size * mass
    elif kind == "any":
        damping = size * semidefinite(random, n, draw(st.integers(1, n)))
    return {"M": mass, "C": damping, "K": stiffness}


def forces(n: int) -> st.SearchStrategy[tuple[float, ...]]:
    return st.just(()) | st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n).map(tuple)


@st.composite
def begins(
    draw: st.DrawFn,
    /,
    largest: int = 8,
    *,
    damped: bool = True,
    play: bool = True,
    restitution: st.SearchStrategy[float] | None = None,
    **fixed: Any,
) -> Begin:
    """Any oscillator, and a start off its stops; `fixed` arguments are not drawn."""
    matrices = draw(structures(largest, damped=damped))
    n = len(matrices["M"])
    arguments: dict[str, Any] = {
        "frequency": draw(st.floats(0.1, 5.0)),
        "restitution": draw(RESTITUTIONS if restitution is None else restitution),
        "amplitude": draw(st.just(0.0) | st.floats(0.01, 1.0)),
        "offset": draw(st.floats(-1.0, 1.0)),
        "contact": draw(st.integers(0, n - 1)),
        "side": draw(st.sampled_from(["above", "below"])),
        "play": draw(st.just(math.inf) | st.floats(0.1, 3.0)) if play else math.inf,
        "constant_forces": draw(forces(n)),
        "harmonic_forces": draw(forces(n)),
        "chatter_tolerance": draw(st.sampled_from([1e-16, 1e-12])),
        **fixed,
    }
    phase = draw(st.floats(0.0, 6.28))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    position, velocity = random.uniform(-1.0, 1.0, (2, n))
    try:
        system = MatrixOscillator(**matrices, **arguments)
        room = min(system.play, 2.0)
        sign = 1.0 if system.side == "above" else -1.0
        table = system.amplitude * math.sin(phase) + system.offset
        position[system.contact] = table + sign * room * draw(st.floats(1e-6, 0.999))
        begin = Begin(system, position, velocity, phase)
        begin.simulate(1)
    except ValueError as refusal:  # resonance without damping
        assume("must not" not in str(refusal))
        raise
    return begin


# --- the families that have a class of their own --------------------------------------------------

SIZES = st.floats(0.2, 5.0)
SHARE = st.just(0.0) | st.floats(1e-100, 1.0)
SIGN = st.sampled_from([-1.0, 1.0])
ANY_RESTITUTION = st.floats(0.0, 1.0) | st.sampled_from([0.0, 1.0])
TOLERANCES = st.sampled_from([1e-16, 1e-12, 1e-8])


@st.composite
def chains(draw: st.DrawFn) -> Begin:
    n = draw(st.integers(1, 4))
    elements = st.lists(SIZES, min_size=n, max_size=n).map(tuple)
    dashpots = st.lists(st.floats(0.0, 2.0), min_size=n, max_size=n).map(tuple)
    chain = ImpactChain(
        masses=draw(st.just(n) | elements),
        springs=draw(st.just(1.0) | elements),
        damping=draw(st.floats(0.0, 8.0) | st.sampled_from([0.0, 0.1]) | dashpots),
        restitution=draw(ANY_RESTITUTION),
        amplitude=draw(st.floats(0.01, 1.0)),
        offset=draw(st.floats(-1.0, 1.0)),
        frequency=draw(st.floats(0.1, 5.0)),
        chatter_tolerance=draw(TOLERANCES),
    )
    coordinates = st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n)
    position, velocity = np.array(draw(coordinates)), np.array(draw(coordinates))
    phase = draw(st.floats(0.0, 6.28))
    position[-1] = table_at(chain, np.array(phase))[0] + draw(st.floats(1e-9, 2.0))
    try:
        begin = Begin(chain, position, velocity, phase)
        begin.simulate(1)
    except ValueError as refusal:  # nearly defective dashpots, resonance without damping
        assume("must not" not in str(refusal))
        raise
    return begin


@st.composite
def singles(draw: st.DrawFn) -> Begin:
    system = SingleImpactOscillator(
        frequency=draw(st.floats(0.1, 8.0)),
        damping_ratio=draw(st.sampled_from([0.0, 1.0]) | st.floats(1e-3, 3.0)),
        force=draw(SHARE),
        stop=draw(SHARE) * draw(SIGN),
        restitution=draw(ANY_RESTITUTION),
        chatter_tolerance=draw(TOLERANCES),
    )
    return one_mass(draw, system, system.stop - draw(st.floats(1e-9, 2.0)))


@st.composite
def balls(draw: st.DrawFn) -> Begin:
    system = BouncingBall(
        frequency=draw(st.floats(0.1, 8.0)),
        amplitude=draw(st.just(0.0) | st.floats(0.01, 1.0)),
        gravity=draw(st.floats(0.1, 10.0)),
        restitution=draw(ANY_RESTITUTION),
        chatter_tolerance=draw(TOLERANCES),
    )
    return one_mass(draw, system, draw(st.floats(1e-9, 2.0)))


@st.composite
def plays(draw: st.DrawFn) -> Begin:
    system = PlayOscillator(
        frequency=draw(st.floats(0.1, 8.0)),
        play=draw(st.floats(0.1, 3.0)),
        spring=draw(st.just(0.0) | st.floats(1e-2, 4.0)),
        damping=draw(st.just(0.0) | st.floats(1e-2, 4.0)),
        force=draw(SHARE) * draw(SIGN),
        amplitude=draw(st.just(0.0) | st.floats(0.01, 1.0)),
        restitution=draw(ANY_RESTITUTION),
        chatter_tolerance=draw(TOLERANCES),
    )
    return one_mass(draw, system, draw(st.floats(-0.499, 0.499)) * system.play)


def one_mass(draw: st.DrawFn, system: ImpactOscillator, place: float) -> Begin:
    """A start at a place that is counted from the moving table."""
    phase = draw(st.floats(0.0, 6.28))
    place += system.amplitude * math.sin(phase)
    return Begin(system, np.array([place]), np.array([draw(st.floats(-2.0, 2.0))]), phase)


# --- records --------------------------------------------------------------------------------------


def alive(record: ImpactRecord) -> ImpactRecord:
    """The record, of a motion that has not died out to the smallest numbers.

    One whose rest is on a table at rest does: where it then touches, underflow decides.
    """
    assume(len(record) > 0)
    assume(abs(record.position[-1]).max() + abs(record.velocity[-1]).max() > 1e-100)
    moving = abs(record.relative_velocity[record.relative_velocity != 0.0])
    assume(moving.min(initial=1.0) > 1e-200)
    return record


def certain(record: ImpactRecord) -> Array:
    """What the impacts may be off by, (n,); motions that graze tell nothing of their twins."""
    assume(alive(record).cost.counts["touches"] == 0)
    error = record.error
    assume(error[-1] < 1e-6)
    return error


def table_at(system: ImpactOscillator, phase: Array) -> tuple[Array, Array, Array]:
    """Place, velocity and acceleration of the (near) stop."""
    swing, w = system.amplitude, system.frequency
    return (
        swing * np.sin(phase) + system.offset,
        swing * w * np.cos(phase),
        -swing * w * w * np.sin(phase),
    )


def forces_at(system: MatrixOscillator, phase: Array) -> Array:
    """Forces, (k, N), at phases, (k,)."""
    n = system.degrees_of_freedom
    constant = np.array(system.constant_forces or (0.0,) * n)
    harmonic = np.array(system.harmonic_forces or (0.0,) * n)
    return np.asarray(constant + (harmonic * np.exp(1j * phase)[:, None]).imag)
