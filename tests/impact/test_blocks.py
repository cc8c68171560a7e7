"""Blocks of structures whose modes merge, against exponentials of ball arithmetic.

Errors are those of exp(A t) for the worst start: the spectral norm where states are measured by the
roots of their energies; the positions of rigid-body motions, which have none, by the lowest natural
frequency.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flint import arb, arb_mat, ctx, fmpq
from hypothesis import given, settings, strategies as st

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.schur_forms.block_schur import Blocks, real_blocks
from dynkit.systems.impact.modes.schur_forms.invariant_subspaces import (
    LARGEST_PROJECTOR,
    SMALL_PROJECTOR,
)
from dynkit.systems.structure.modes import Derivation, Modes

BITS = 500
HALF_ULP = 2.0**-53

Matrices = tuple[Array, Array, Array]


# --- structures -----------------------------------------------------------------------------------


def links(constants: Any) -> Array:
    """Matrix of elements along a chain, the first one at the wall."""
    n = len(constants)
    stretch = np.eye(n) - np.eye(n, k=-1)
    return stretch.T @ np.diag(np.asarray(constants, dtype=float)) @ stretch


def chain(masses: Any, springs: Any, dashpots: Any) -> Matrices:
    return np.diag(np.asarray(masses, dtype=float)), links(dashpots), links(springs)


def graded(n: int) -> Matrices:
    return chain(np.ones(n), np.ones(n), np.linspace(0.01, 0.2, n))


JOINT = np.array([[1.0, -1.0], [-1.0, 1.0]])

# det(s^2 M + s C + K) is (s + 1)^2 (s^2 + 1), (s^2 + s/8 + 1)^2 and (s + 1)^4: without rounding.
CRITICAL: Matrices = np.eye(2), JOINT, np.eye(2)
DOUBLE: Matrices = np.eye(2), np.diag([0.25, 0.0]), np.array([[65 / 64, 0.125], [0.125, 1.0]])
FOURFOLD: Matrices = np.eye(2), np.diag([3.0, 1.0]), np.array([[2.5, 0.5], [0.5, 0.5]])
# det is (s^2 + 0.2 s + 0.97738...)^3 up to the rounding of K: rates that agree to 1e-5.
TRIPLE: Matrices = (
    np.eye(3),
    np.diag([0.5, 0.1, 0.0]),
    np.array(
        [
            [float.fromhex(x) for x in row.split()]
            for row in (
                "0x1.0c6c2624d3d70p+0 0x1.8cdf363d734d1p-8 -0x1.080520111528cp-2",
                "0x1.8cdf363d734d1p-8 0x1.ec60b2376a2a1p-1 0x1.8aac454642383p-5",
                "-0x1.080520111528cp-2 0x1.8aac454642383p-5 0x1.fbe0e61f933c3p-1",
            )
        ]
    ),
)


def unequal(matrices: Matrices) -> Matrices:
    """The same rates with other masses."""
    factor = np.diag(2.0 ** np.arange(0.0, 3.0 * len(matrices[0]), 3.0))
    mass, damping, stiffness = (np.asarray(factor @ matrix @ factor) for matrix in matrices)
    return mass, damping, stiffness


def twice(matrices: Matrices) -> Matrices:
    mass, damping, stiffness = (np.asarray(np.kron(np.eye(2), matrix)) for matrix in matrices)
    return mass, damping, stiffness


def blocks_of(mass: Array, damping: Array, stiffness: Array) -> Blocks:
    return real_blocks(Derivation.from_matrices(mass, damping, stiffness))


# --- measures -------------------------------------------------------------------------------------


def exact(a: Array) -> Any:
    return arb_mat([[arb(fmpq(*x.as_integer_ratio())) for x in row] for row in a.tolist()])


def rounded(a: Any) -> Array:
    return np.array([[float(a[i, j].mid()) for j in range(a.ncols())] for i in range(a.nrows())])


def state_matrix(matrices: Matrices) -> Any:
    n = len(matrices[0])
    mass, damping, stiffness = map(exact, matrices)
    inverse = mass.inv()
    force, drag = inverse * stiffness, inverse * damping
    out = arb_mat(2 * n, 2 * n)
    for i in range(n):
        out[i, n + i] = 1
        for j in range(n):
            out[n + i, j], out[n + i, n + j] = -force[i, j], -drag[i, j]
    return out


def energy_measure(matrices: Matrices) -> Any:
    """Matrix of numbers whose square sum is twice the energy of a state."""
    modes = Modes.from_matrices(*matrices)
    n, frequencies = len(modes.frequencies), modes.frequencies.copy()
    elastic = frequencies[frequencies > 0.0]
    frequencies[frequencies == 0.0] = elastic[0] if len(elastic) else 1.0
    projector = exact(modes.matrix).inv()
    out = arb_mat(2 * n, 2 * n)
    for i in range(n):
        for j in range(n):
            out[i, j] = projector[i, j] * arb(fmpq(*float(frequencies[i]).as_integer_ratio()))
            out[n + i, n + j] = projector[i, j]
    return out


def block_matrix(blocks: Blocks) -> Any:
    n = blocks.generator.shape[1]
    out = arb_mat(2 * n, 2 * n)
    for entry, (i, j) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        for k in range(n):
            high, low = (g[entry, k].tolist() for g in (blocks.generator, blocks.generator_low))
            out[i * n + k, j * n + k] = arb(fmpq(*high.as_integer_ratio())) + arb(low)
        for t, s, b in zip(blocks.target, blocks.source, blocks.coupling[:, entry], strict=True):
            out[i * n + int(t), j * n + int(s)] = arb(float(b))
    return out


def norm(a: Array) -> float:
    return float(np.linalg.norm(a, 2))


def largest_condition(matrices: Matrices, projector: float = SMALL_PROJECTOR) -> float:
    """That of 2N unit vectors, and as many rows of the inverse as long as projectors may be."""
    return 2.0 * len(matrices[0]) * projector


def errors(matrices: Matrices, times: tuple[float, ...]) -> tuple[Blocks, Array, float]:
    """Blocks, the errors of exp(A t), and what the rounding of basis and inverse may cause.

    Errors are relative to norm(exp(A t)) where that exceeds 1, as it does for rigid bodies that
    fly. Rounding the basis T turns exp(A t) into (1 + E) exp(A t) (1 - E), E the change times the
    inverse of T.
    """
    blocks = blocks_of(*matrices)
    with ctx.workprec(BITS):
        measure = energy_measure(matrices)
        back = measure.inv()
        matrix, generator = state_matrix(matrices), block_matrix(blocks)
        basis, inverse = exact(blocks.matrix), exact(blocks.inverse)
        off = []
        for t in times:
            wanted = (matrix * arb(t)).exp()
            found = basis * (generator * arb(t)).exp() * inverse
            size = max(1.0, norm(rounded(measure * wanted * back)))
            off.append(norm(rounded(measure * (found - wanted) * back)) / size)
        weights, weights_back = np.abs(rounded(measure)), np.abs(rounded(back))
        lost = 2.0 * norm(weights @ np.abs(blocks.matrix)) * norm(rounded(inverse * back))
        lost += norm(rounded(measure * basis)) * norm(np.abs(blocks.inverse) @ weights_back)
    return blocks, np.array(off), HALF_ULP * lost


# --- merging modes --------------------------------------------------------------------------------

TIMES = (0.0, 0.1, 1.0, 10.0, 100.0)
NEAR = [0.0, *(sign * 10.0**-e for e in (3, 5, 8, 11, 13, 15) for sign in (1.0, -1.0))]


@pytest.mark.parametrize("off", NEAR)
@pytest.mark.parametrize(
    "matrices",
    [CRITICAL, DOUBLE, FOURFOLD, TRIPLE, unequal(DOUBLE), twice(DOUBLE), twice(CRITICAL)],
    ids=["critical", "double", "fourfold", "triple", "unequal", "two_double", "two_critical"],
)
def test_motion_near_merging_modes_is_exact_to_rounding(matrices: Matrices, off: float) -> None:
    mass, damping, stiffness = matrices
    blocks, error, rounding = errors((mass, (1.0 + off) * damping, stiffness), TIMES)
    assert blocks.condition <= largest_condition(matrices)
    assert error.max() <= rounding
    assert error.max() < 1e-12


@pytest.mark.parametrize(
    ("matrices", "count"),
    [(CRITICAL, 0), (DOUBLE, 1), (FOURFOLD, 1), (TRIPLE, 3), (unequal(DOUBLE), 1), (graded(30), 0)],
    ids=["critical", "double", "fourfold", "triple", "unequal", "graded"],
)
def test_only_modes_that_merge_are_linked(matrices: Matrices, count: int) -> None:
    assert len(blocks_of(*matrices).target) == count


@pytest.mark.parametrize("n", [10, 30])
def test_motion_of_graded_chains_is_exact_to_rounding(n: int) -> None:
    blocks, error, rounding = errors(graded(n), TIMES)
    assert blocks.condition <= largest_condition(graded(n))
    assert error.max() <= rounding
    assert error.max() < 1e-12


def test_motion_of_strongly_graded_chains_keeps_nine_digits() -> None:
    # All that is linked to a condition of 1e3 would be 171 links of 50 pairs.
    matrices = chain(np.ones(50), np.ones(50), np.geomspace(0.01, 1.0, 50))
    blocks, error, rounding = errors(matrices, (1.0,))
    assert blocks.condition <= largest_condition(matrices, LARGEST_PROJECTOR)
    assert error.max() <= rounding
    assert error.max() < 1e-9


def test_a_hundred_graded_dashpots_leave_residuals_of_rounding() -> None:
    # The modes by themselves have a condition number of 5e9. Bounds of the residuals: every entry
    # of basis, inverse and couplings is rounded once.
    matrices = graded(100)
    blocks = blocks_of(*matrices)
    assert blocks.condition <= largest_condition(matrices, LARGEST_PROJECTOR)
    with ctx.workprec(200):
        measure = energy_measure(matrices)
        matrix, generator = measure * state_matrix(matrices) * measure.inv(), block_matrix(blocks)
        basis = measure * exact(blocks.matrix)
        residual = norm(rounded(matrix * basis - basis * generator))
        identity = rounded(exact(blocks.matrix) * exact(blocks.inverse)) - np.eye(200)
        entries = norm(np.abs(rounded(measure)) @ np.abs(blocks.matrix))
        couplings = norm(blocks.coupling) * norm(rounded(basis))
        size = norm(rounded(matrix)) + norm(rounded(generator))
    assert residual <= HALF_ULP * (size * entries + couplings)
    assert norm(identity) <= HALF_ULP * norm(np.abs(blocks.matrix) @ np.abs(blocks.inverse))


# --- other structures -----------------------------------------------------------------------------

ONES = np.ones(4)


@pytest.mark.parametrize(
    "matrices",
    [
        chain(ONES, ONES, 0.0 * ONES),
        chain(ONES, ONES, 0.125 * ONES),
        chain(ONES, ONES, (9.0, 30.0, 5.0, 1.0)),
        chain(ONES, ONES, (1e8, 0.0, 0.0, 0.0)),
        chain(ONES, ONES, (2.0**-10, 1e8, 0.125, 1e7)),
        chain(ONES, ONES, (1e8, 5e7, 3e7, 1e8)),
        chain([1.0], [1.0], [1e8]),
        chain((1.0, 1e12, 1.0, 1e-12), ONES, (0.125, 0.25, 0.0, 0.5)),
        chain(ONES, (1.0, 1e12, 1.0, 1e-6), (0.125, 0.25, 0.0, 0.5)),
        chain(10.0 ** np.arange(-4.0, 5.0), 10.0 ** -np.arange(-4.0, 5.0), np.full(9, 0.125)),
    ],
    ids=[
        "undamped",
        "proportional",
        "overdamped",
        "wall",
        "unequal",
        "huge",
        "single",
        "masses",
        "springs",
        "tapered",
    ],
)
def test_motion_is_exact_to_rounding_in_extreme_structures(matrices: Matrices) -> None:
    blocks, error, rounding = errors(matrices, (0.0, 1e-4, 1.0, 1e4))
    assert blocks.condition <= largest_condition(matrices)
    assert error.max() <= rounding


@pytest.mark.parametrize(
    "matrices",
    [
        chain(ONES, (0.0, 1.0, 1.0, 1.0), 0.0 * ONES),
        chain(ONES, (0.0, 1.0, 1.0, 1.0), (0.0, 0.25, 0.0, 0.125)),
        chain(ONES, (0.0, 1.0, 1.0, 1.0), (0.25, 0.25, 0.0, 0.125)),
        chain(ONES, (0.0, 1.0, 1.0, 1.0), (2.0**-26, 0.25, 0.0, 0.125)),
        chain(ONES, (0.0, 1.0, 1.0, 1.0), (0.0, 2.0**26, 0.0, 0.125)),
        chain(ONES, (0.0, 1.0, 0.0, 1.0), (0.0, 0.25, 0.5, 0.125)),
        chain(ONES, (0.0, 1.0, 0.0, 1.0), (0.25, 0.25, 0.5, 0.125)),
        chain(ONES, 0.0 * ONES, (1.0, 0.25, 0.5, 0.125)),
        chain(
            2.0 ** np.array([-5.0, -2, -3, -6, -3, 3]), np.zeros(6), (0.0, 0.0625, 0.25, 64, 2, 1)
        ),
        (np.eye(6), np.diag([0.0, 1.0, 0.0, 0.0, 1.0, 0.0]), links((0.0, 1.0, 0.0, 0.0, 1.0, 0.0))),
        chain(ONES, (0.0, 1.0, 0.0, 2.0**-50), (0.0, 0.0, 0.0, 2.0**20)),
        chain([2.0], [0.0], [2.0**-26]),
        chain([2.0], [0.0], [2.0**26]),
        chain([2.0], [0.0], [0.0]),
    ],
    ids=[
        "flying",
        "flying_damped",
        "resisted",
        "hardly_resisted",
        "nearly_stiff",
        "two_bodies",
        "two_resisted",
        "no_springs",
        "no_springs_flying",
        "twins",
        "soft",
        "one_hardly_resisted",
        "one_held",
        "one_free",
    ],
)
def test_rigid_bodies_move_exactly_to_rounding(matrices: Matrices) -> None:
    _, error, rounding = errors(matrices, (0.0, 0.1, 1.0, 100.0, 1e4))
    assert error.max() <= rounding


def test_a_free_rigid_body_is_position_and_velocity() -> None:
    blocks = blocks_of(*chain(ONES, (0.0, 1.0, 1.0, 1.0), (0.0, 0.25, 0.0, 0.125)))
    free = ~blocks.generator[[0, 2, 3]].any(axis=0)
    assert np.sum(free) == 1
    assert blocks.generator[1, free] > 0.0
    assert not blocks.generator_low[:, free].any()


@pytest.mark.parametrize("drag", [2.0**-26, 0.25, 2.0**26])
def test_a_resisted_rigid_body_has_a_rate_of_exactly_zero(drag: float) -> None:
    blocks = blocks_of(*chain(ONES, (0.0, 1.0, 1.0, 1.0), (drag, 0.25, 0.0, 0.125)))
    still = (blocks.generator[0] == 0.0) & (blocks.generator[2] == 0.0)
    assert np.sum(still) == 1
    assert (blocks.generator[1, still] != 0.0).all()


def test_equal_oscillators_need_no_links() -> None:
    blocks = blocks_of(np.eye(3), 0.25 * np.eye(3), np.eye(3))
    assert not len(blocks.target)


@pytest.mark.parametrize(
    "matrices", [chain(ONES, ONES, (0.02, 1.7, 0.3, 40.0)), graded(10)], ids=["unequal", "graded"]
)
def test_separate_rates_are_right_beyond_double_precision(matrices: Matrices) -> None:
    blocks = blocks_of(*matrices)
    with ctx.workprec(BITS):
        wanted = state_matrix(matrices).charpoly()
        found = block_matrix(blocks).charpoly()
        for a, b in zip(wanted.coeffs(), found.coeffs(), strict=True):
            assert abs(float(((b - a) / a).mid())) < 1e-27


# --- what is promised of the blocks ---------------------------------------------------------------

LINKED = [DOUBLE, FOURFOLD, TRIPLE, twice(DOUBLE), graded(40)]
LINKED_NAMES = ["double", "fourfold", "triple", "two_double", "graded"]


@pytest.mark.parametrize("matrices", LINKED, ids=LINKED_NAMES)
def test_links_lead_to_earlier_pairs_and_are_closed(matrices: Matrices) -> None:
    blocks = blocks_of(*matrices)
    assert (blocks.target < blocks.source).all()
    linked = np.zeros((len(matrices[0]),) * 2, dtype=bool)
    linked[blocks.target, blocks.source] = True
    assert not ((linked @ linked) & ~linked).any()


@pytest.mark.parametrize("matrices", LINKED, ids=LINKED_NAMES)
def test_the_square_sum_of_linked_coordinates_never_grows(matrices: Matrices) -> None:
    generator = rounded(block_matrix(blocks_of(*matrices)))
    growth = np.linalg.eigvalsh(generator + generator.T)
    assert growth.max() <= 8.0 * len(generator) * HALF_ULP * norm(generator)


def test_an_indefinite_stiffness_is_refused() -> None:
    with pytest.raises(ValueError, match="stiffness must be positive semidefinite"):
        blocks_of(np.eye(2), np.eye(2), np.diag([1.0, -1.0]))


# --- random structures ----------------------------------------------------------------------------

# Powers of two: the sums of elements in the matrices are exact, so that rigid bodies are rigid.
sizes = st.integers(-6, 6).map(lambda e: 2.0**e)
elements = st.one_of(st.just(0.0), sizes)


@st.composite
def structures(draw: st.DrawFn) -> Matrices:
    n = draw(st.integers(1, 4))
    masses, springs, dashpots = (
        draw(st.lists(kind, min_size=n, max_size=n)) for kind in (sizes, elements, elements)
    )
    mass, damping, stiffness = chain(masses, springs, dashpots)
    if draw(st.booleans()):
        damping = np.diag(np.asarray(dashpots, dtype=float))
    return mass, damping, stiffness


@settings(max_examples=60)
@given(structures())
def test_motion_of_any_structure_is_exact_to_rounding(matrices: Matrices) -> None:
    blocks, error, rounding = errors(matrices, (0.0, 0.1, 1.0, 30.0, 1000.0))
    assert blocks.condition <= largest_condition(matrices)
    assert error.max() <= rounding
