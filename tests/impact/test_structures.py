"""Structures of a user's own: energies overridden, dashpots apart, inertia that couples masses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import pytest
import scipy.linalg
from mpmath import mp, mpf

from dynkit.systems.impact.oscillators.chain import ImpactChain
from dynkit.systems.impact.oscillators.matrix import MatrixOscillator
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator
from dynkit.systems.impact.simulation.trajectory import Ending
from tests.impact.exact import exact_errors
from tests.structure.reference import links_matrix

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, kw_only=True)
class TaperedChain(ImpactChain):
    """Masses and springs that shrink from the wall outwards, by its energies alone."""

    taper: float = 0.9
    masses: int | tuple[float, ...] = 4

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        terms = (self.taper**i * v[i] ** 2 / 2 for i in range(len(v)))
        return sum(terms, start=0 * v[0])

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return self._links(x)

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return 0.125 * self._links(v)

    def _links(self, z: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        inner = (0 * z[0], *z)
        terms = (self.taper**i * (z[i] - inner[i]) ** 2 / 2 for i in range(len(z)))
        return sum(terms, start=0 * z[0])


@dataclass(frozen=True, kw_only=True)
class Rod(ImpactChain):
    """A chain whose neighbours share inertia, as in a rod of finite elements."""

    coupling: float = 0.2
    masses: int | tuple[float, ...] = 3

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        shared = (self.coupling * v[i] * v[i + 1] for i in range(len(v) - 1))
        return super().kinetic(v) + sum(shared, start=0 * v[0])


def tapered_pair(frequency: float) -> tuple[TaperedChain, ImpactChain]:
    """The same chain, by energies and by arrays."""
    sizes = tuple(0.9**i for i in range(4))
    return (
        TaperedChain(frequency=frequency),
        ImpactChain(masses=sizes, springs=sizes, damping=0.125, frequency=frequency),
    )


@dataclass(frozen=True, kw_only=True)
class Branch(ImpactOscillator):
    """Two grounded arms of two masses each, joined at the mass that hits the table."""

    degrees_of_freedom = 5

    def kinetic(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return sum((z**2 / 2 for z in v), start=0 * v[0])

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        links = (x[0], x[1] - x[0], x[4] - x[1], x[2], x[3] - x[2], 0.75 * (x[4] - x[3]))
        return sum((z**2 / 2 for z in links), start=0 * x[0])

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return 0.1 * (v[4] - v[1]) ** 2 / 2 + 0.02 * v[2] ** 2 / 2


@pytest.mark.parametrize("frequency", [0.3, 0.87])
def test_a_branching_structure_is_exact_to_1e_13(frequency: float) -> None:
    branch = Branch(frequency=frequency, amplitude=0.3)
    record = branch.simulate(impacts=12)
    assert exact_errors(record).max() < 1e-13


def test_a_chain_that_nothing_holds_falls_onto_the_table() -> None:
    chain = ImpactChain(
        masses=3,
        springs=(0.0, 1.0, 1.0),
        damping=0.05,
        frequency=0.9,
        constant_forces=(-0.1, -0.1, -0.1),
    )
    assert chain.natural_frequencies == pytest.approx([0.0, 1.0, math.sqrt(3.0)], abs=1e-15)
    start = chain.state([2.0, 2.0, 2.0], phase=0.2)
    record = chain.simulate(impacts=1, start=start)
    # Until it touches the table it falls as one body.
    time = record.time[0]
    assert 2.0 - 0.05 * time**2 == pytest.approx(0.1 * math.sin(0.2 + 0.9 * time), abs=1e-14)
    assert record.position[0] == pytest.approx(2.0 - 0.05 * time**2, abs=1e-14)


@pytest.mark.parametrize("frequency", [0.3, 0.45, 0.87])
def test_same_energies_give_the_same_bits(frequency: float) -> None:
    own, chain = tapered_pair(frequency)
    assert np.array_equal(own.stiffness, chain.stiffness)
    assert np.array_equal(own.damping_matrix, chain.damping_matrix)
    one, other = own.simulate(impacts=150), chain.simulate(impacts=150)
    assert one.states.tobytes() == other.states.tobytes()
    assert one.time.tobytes() == other.time.tobytes()
    assert one.sticking.tobytes() == other.sticking.tobytes()


@dataclass(frozen=True, kw_only=True)
class Stiffened(MatrixOscillator):
    """Matrices, and a spring from the first mass to the ground beside them."""

    hardening: float = 0.0

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return super().potential(x) + x[0] ** 2 / 4 + self.hardening * x[0] ** 4

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return super().dissipation(v) + v[1] ** 2 / 8


@dataclass(frozen=True, kw_only=True)
class StiffenedChain(ImpactChain):
    hardening: float = 0.0

    def potential(self, x: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return super().potential(x) + x[0] ** 2 / 4 + self.hardening * x[0] ** 4

    def dissipation(self, v: tuple[sympy.Symbol, ...]) -> sympy.Expr:
        return super().dissipation(v) + v[1] ** 2 / 8


def test_matrices_of_an_oscillator_are_checked_where_they_become_others_of_it() -> None:
    free = MatrixOscillator(M=np.eye(2), C=np.zeros((2, 2)), K=[[1, -1], [-1, 1]], frequency=1.0)
    assert free.replace(frequency=2.0).M is free.M
    assert free.replace(C=free.K).C == free.K
    with pytest.raises(ValueError, match="M must be positive definite"):
        free.replace(M=free.K)
    with pytest.raises(ValueError, match=r"C must have shape \(1, 1\); got shape \(2, 2\)"):
        free.replace(M=((1.0,),), K=((1.0,),))


@pytest.mark.parametrize("hardening", [0.0, 0.25])
def test_energies_that_a_subclass_adds_to_matrices_count(hardening: float) -> None:
    plain = ImpactChain(masses=2, frequency=0.9)
    chain = StiffenedChain(masses=2, frequency=0.9, hardening=hardening)
    matrices: dict[str, Any] = {"M": plain.mass, "C": plain.damping_matrix, "K": plain.stiffness}
    given = Stiffened(frequency=0.9, hardening=hardening, **matrices)
    assert given.engine == chain.engine
    assert given.stiffness == pytest.approx(chain.stiffness)
    starts = [system.state([0.1, 0.4], [0.0, 0.1]) for system in (given, chain)]
    found = given.simulate(impacts=20, start=starts[0])
    expected = chain.simulate(impacts=20, start=starts[1])
    near = found.error + expected.error
    assert np.all(abs(found.relative_velocity - expected.relative_velocity) <= near)


def test_a_subclass_is_replaced_by_its_own_kind() -> None:
    chain = TaperedChain(frequency=0.87)
    assert chain.replace(taper=0.8) == TaperedChain(frequency=0.87, taper=0.8)
    assert chain.replace(taper=0.8).mass[3, 3] == 0.8**3


@pytest.mark.parametrize(
    "damping",
    [
        (0.5, 0.0),
        (0.0, 0.5),
        (0.02, 1.7, 0.3),
        (8.0, 0.1, 0.0),
        (0.1, 0.3, 0.0, 1.2, 0.05),
    ],
)
def test_dashpots_apart_from_the_springs_are_exact_to_1e_12(damping: tuple[float, ...]) -> None:
    chain = ImpactChain(masses=len(damping), damping=damping, amplitude=0.3, frequency=0.8)
    assert not chain.modes.proportional
    record = chain.simulate(impacts=12)
    assert record.ending is Ending.COUNT_REACHED
    assert exact_errors(record).max() < 1e-12


@pytest.mark.parametrize("seed", range(12))
def test_dashpots_apart_are_as_exact_as_the_record_says(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.choice([2, 3, 4]))
    dashpots = abs(random.normal(size=n)) * random.choice([1e-3, 1e-2, 0.1, 1.0])
    chain = ImpactChain(
        masses=n,
        damping=tuple(dashpots.tolist()),
        amplitude=0.3,
        offset=float(random.choice([0.0, -0.6])),
        frequency=float(random.uniform(0.1, 2.0)),
    )
    position, velocity = 0.5 * random.normal(size=(2, n))
    position[-1] = 0.7
    record = chain.simulate(impacts=8, start=chain.state(position, velocity))
    off = exact_errors(record)[:, 1]
    assert (off <= record.error).all()


def test_rates_of_coupled_modes_are_right_beyond_double_precision() -> None:
    damping = (0.02, 1.7, 0.3, 40.0)
    chain = ImpactChain(masses=4, damping=damping, frequency=1.0)
    pairs = chain._structure.free.pairs
    with mp.workdps(50):
        matrix = mpmath.matrix(8)
        matrix[:4, 4:] = mpmath.eye(4)
        matrix[4:, :4] = -links_matrix((1.0,) * 4)
        matrix[4:, 4:] = -links_matrix(damping)
        exact, _ = mpmath.eig(matrix)
        assert not pairs.links.size
        for parts in zip(pairs.generator.T.tolist(), pairs.generator_low.T.tolist(), strict=True):
            g = [mpf(high) + mpf(low) for high, low in zip(*parts, strict=True)]
            middle, product = (g[0] + g[3]) / 2, g[0] * g[3] - g[1] * g[2]
            apart = mpmath.sqrt(middle**2 - product)
            for rate in (middle + apart, middle - apart):
                off = min(abs(rate - other) for other in exact)
                assert off < mpf(10) ** -27 * abs(rate)


def test_dashpots_apart_that_overdamp_all_modes_are_exact_to_1e_12() -> None:
    chain = ImpactChain(masses=2, damping=(9.0, 30.0), amplitude=0.3, frequency=0.8)
    assert (chain._structure.free.pairs.scale == 0.0).all()
    assert exact_errors(chain.simulate(impacts=6)).max() < 1e-12


@pytest.mark.parametrize("damping", [(0.02, 1.7, 0.3), (0.1, 0.3, 0.0, 1.2, 0.05)])
def test_sticking_with_dashpots_apart_is_exact_to_1e_12(damping: tuple[float, ...]) -> None:
    chain = ImpactChain(
        masses=len(damping),
        damping=damping,
        restitution=0.3,
        amplitude=0.3,
        offset=0.2,
        frequency=0.6,
    )
    record = chain.simulate(impacts=40)
    assert np.isfinite(record.sticking).all(axis=1).any()
    assert exact_errors(record).max() < 1e-12


@pytest.mark.parametrize("offset", [0.0, 0.1])
@pytest.mark.parametrize("coupling", [0.2, 0.45])
def test_coupled_inertia_is_exact_to_1e_13(coupling: float, offset: float) -> None:
    rod = Rod(coupling=coupling, offset=offset, frequency=0.5)
    record = rod.simulate(impacts=6)
    assert exact_errors(record).max() < 1e-13


@pytest.mark.parametrize("coupling", [0.2, 0.45])
def test_chatter_of_coupled_inertia_hands_its_momentum_on(coupling: float) -> None:
    def first_after_release(tolerance: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        rod = Rod(coupling=coupling, offset=0.1, frequency=0.5, chatter_tolerance=tolerance)
        record = rod.simulate(impacts=250)
        return np.array(record.states[np.searchsorted(record.time, record.sticking[0, 1])])

    off = abs(first_after_release(1e-16) - first_after_release(1e-26)).max()
    assert off < 1e-13


# Both pairs of rates agree, to this: a single mode shape, or two, with rates -1 or complex ones.
MERGED: dict[str, tuple[float | tuple[float, ...], tuple[float, float]]] = {
    "one rate": ((2.0 + math.sqrt(2.0), 1.0 - math.sqrt(0.5)), (2.0, 1.0)),
    "two rates": (1.0, (4.032297922, 2.535018771)),
}


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-12, 1e-8, 1e-5, 1e-2])
@pytest.mark.parametrize("name", MERGED)
def test_modes_that_merge_keep_their_digits(name: str, apart: float) -> None:
    springs, (first, second) = MERGED[name]
    chain = ImpactChain(
        masses=2, springs=springs, damping=(first + apart, second), amplitude=0.3, frequency=0.8
    )
    record = chain.simulate(impacts=10)
    off = exact_errors(record)[:, 1]
    assert (off <= record.error).all()
    # Bases of modes nearer than this are joined: projectors up to 1e3; the rest is the motion's.
    assert off.max() < 1e-11


@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize("offset", [-3.0, 0.0, 0.5, 7.0])
@pytest.mark.parametrize("play", [0.2, 2.0, np.inf])
def test_default_start_is_between_the_stops(side: str, offset: float, play: float) -> None:
    chain = ImpactChain(masses=3, frequency=0.9, side=side, offset=offset, play=play)
    sign = 1.0 if side == "above" else -1.0
    shape = chain.modal_matrix[:, 0]
    start = chain.state(phase=0.3)
    gap = sign * (start.position[-1] - offset - chain.amplitude * np.sin(0.3))
    fits = 0.0 <= sign * (sign * abs(shape[-1]) - offset) - sign * 0.1 * np.sin(0.3) <= play
    assert gap == pytest.approx(
        sign * (sign * abs(shape[-1]) - offset - 0.1 * np.sin(0.3)) if fits else min(1.0, play / 2)
    )
    np.testing.assert_allclose(start.position * shape[-1], shape * start.position[-1], atol=1e-14)


@pytest.mark.parametrize(
    "rows",
    [
        [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]],
        [[-1.0, 1.0, 0.0, 0.0], [0.0, -1.0, 1.0, 0.0]],
        [[0.5, -1.0, 1.5, 0.25], [0.0, 2.0, 0.5, 1.0], [1.0, 1.0, 0.0, 0.0]],
    ],
)
def test_a_structure_with_several_rows_held_is_the_rest_of_it(rows: list[list[float]]) -> None:
    """Its frequencies are those within the null space of the rows."""
    chain = ImpactChain(masses=(1.0, 2.0, 0.5, 1.5), springs=(1.0, 3.0, 2.0, 0.5), frequency=1.0)
    held = chain._structure.holding(np.array(rows))
    assert held.structure is not None
    left = scipy.linalg.null_space(np.array(rows))
    expected = scipy.linalg.eigh(
        left.T @ chain.stiffness @ left, left.T @ chain.mass @ left, eigvals_only=True
    )
    found = scipy.linalg.eigh(held.structure.stiffness, held.structure.mass, eigvals_only=True)
    assert found == pytest.approx(expected, rel=1e-12)
    assert held.weights @ np.array(rows).T == pytest.approx(np.eye(len(rows)), abs=1e-14)
