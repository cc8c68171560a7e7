from typing import Any

import mpmath
import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf

from dynkit.core.validation import Array
from dynkit.systems.structure.chain import Chain
from dynkit.systems.structure.lagrangian import LagrangianStructure
from dynkit.systems.structure.modes import Modes, _last
from dynkit.systems.structure.refinement import refine
from tests.reference.impact_chain import to_mpf
from tests.structure import reference
from tests.structure.reference import column_error, matrix_error, relative_errors, value

SIZES = [1, 2, 3, 10, 30]


def random_chain(size: int, *, damped: bool = False) -> Chain:
    rng = np.random.default_rng(size)
    masses, springs = rng.uniform(0.5, 2.0, size), rng.uniform(0.5, 2.0, size)
    return Chain(masses, springs, rng.uniform(0.0, 0.2, size) if damped else 0.0)


def uniform(size: int) -> Chain:
    """Unit masses and springs, dashpots that go with the springs: one for all tests of a size."""
    return Chain(size, dashpots=0.1)


class GroundedTwins(LagrangianStructure):
    """Two unit masses, each with a unit spring to the ground, and a coupling spring."""

    @property
    def degrees_of_freedom(self) -> int:
        return 2

    def __init__(self, coupling: float) -> None:
        self.coupling = coupling

    def kinetic(self, v: tuple[Any, ...]) -> Any:
        return (v[0] ** 2 + v[1] ** 2) / 2

    def potential(self, x: tuple[Any, ...]) -> Any:
        return (x[0] ** 2 + x[1] ** 2) / 2 + self.coupling * (x[0] - x[1]) ** 2 / 2


def laplacian(size: int) -> Array:
    """Stiffness of a closed ring of unit springs: every frequency but one or two comes twice."""
    return 2.0 * np.eye(size) - np.roll(np.eye(size), 1, 0) - np.roll(np.eye(size), -1, 0)


# ------------------------------------------------------------------------------- frequencies


@pytest.mark.parametrize("size", [1, 2, 3, 10, 100, 1000])
def test_frequencies_of_the_uniform_chain(size: int) -> None:
    modes = uniform(size).modes
    errors = relative_errors(modes, reference.uniform_frequencies(size))
    assert np.all(errors <= modes.frequencies_error)


@pytest.mark.parametrize("size", [1, 2, 3, 10, 100, 1000])
def test_frequencies_of_the_uniform_chain_are_the_nearest_doubles(size: int) -> None:
    exact = [float(w) for w in reference.uniform_frequencies(size)]
    assert uniform(size).modes.frequencies.tolist() == exact


def test_the_lowest_frequency_of_a_long_chain_is_good_to_24_digits() -> None:
    # w = 1.6e-3, where the largest is 2: w^2 is 6e-7 of the norm of K.
    modes = uniform(1000).modes
    assert modes.frequencies_error[0] < 1e-24
    assert relative_errors(modes, reference.uniform_frequencies(1000))[0] < 1e-28


@pytest.mark.parametrize("size", SIZES)
def test_frequencies_of_random_chains(size: int) -> None:
    chain = random_chain(size)
    exact, _ = reference.chain_modes(chain)
    assert np.all(relative_errors(chain.modes, exact) <= chain.modes.frequencies_error)


def test_the_paper_frequencies() -> None:
    # Cusumano & Bai 1993, table A1; the first is 0.14946 and was rounded up there.
    printed = [0.149, 0.445, 0.731, 1.000, 1.247, 1.466, 1.652, 1.802, 1.911, 1.978]
    assert Chain(10).modes.frequencies.round(3).tolist() == printed


def test_high_and_low_parts_do_not_overlap() -> None:
    modes = random_chain(30, damped=True).modes
    assert np.array_equal(modes.frequencies + modes.frequencies_low, modes.frequencies)
    assert np.array_equal(modes.decay + modes.decay_low, modes.decay)
    assert modes.frequencies_low.any()


# ----------------------------------------------------------------------------- modal matrices


@pytest.mark.parametrize("size", [1, 2, 3, 10, 100, 1000])
def test_modes_of_the_uniform_chain(size: int) -> None:
    modes = uniform(size).modes
    for number in sorted({1, size // 2 + 1, size}):
        exact = reference.uniform_mode(size, number)
        assert column_error(modes.matrix[:, number - 1], exact) <= modes.error


@pytest.mark.parametrize("size", SIZES)
def test_modes_of_random_chains(size: int) -> None:
    chain = random_chain(size)
    _, vectors = reference.chain_modes(chain)
    assert matrix_error(chain.modes, vectors) <= chain.modes.error


def test_errors_stay_below_half_an_ulp_and_a_little() -> None:
    assert all(random_chain(size).modes.error < 1.2e-16 for size in [*SIZES, 300])


@pytest.mark.parametrize("size", SIZES)
def test_the_tip_moves_outwards_in_every_mode(size: int) -> None:
    assert np.all(random_chain(size).modes.matrix[-1] >= 0.0)


def test_modes_are_mass_normalised() -> None:
    chain = random_chain(100)
    modal = chain.modes.matrix.T @ chain.mass @ chain.modes.matrix
    assert np.allclose(modal, np.eye(100), rtol=0.0, atol=1e-14)


def test_modes_with_a_resting_tip_have_a_positive_last_entry() -> None:
    modes = Modes.from_matrices(np.eye(2), np.zeros((2, 2)), np.diag([2.0, 1.0]))
    assert modes.matrix.tolist() == [[0.0, 1.0], [1.0, 0.0]]


@pytest.mark.parametrize("name", ["frequencies", "frequencies_low", "decay", "matrix"])
def test_results_are_read_only(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(Chain(3).modes, name)[0] = 1.0


# --------------------------------------------------------------------------- hard structures

UNEQUAL = {
    "masses": Chain(10.0 ** np.array([0, 12, 3, 7, 1, 9, 12, 0, 5, 2])),
    "springs": Chain(10, 10.0 ** np.array([0, 12, 3, 7, 1, 9, 12, 0, 5, 2])),
    "alternating masses": Chain([1.0, 1e12] * 5),
    "alternating springs": Chain(10, [1.0, 1e12] * 5),
    "soft wall": Chain(10, [1e-12] + [1.0] * 9),
    "weak link": Chain(10, [1.0] * 5 + [1e-15] + [1.0] * 4),
    "graded": Chain(10.0 ** np.linspace(0, 12, 10), 10.0 ** np.linspace(12, 0, 10)),
    "graded alike": Chain(10.0 ** np.linspace(12, 0, 10), 10.0 ** np.linspace(0, 12, 10)),
    "huge": Chain([1e-290] * 4, 1e290),
    "tiny": Chain([1e200] * 4, 1e-200),
}


@pytest.mark.parametrize("chain", UNEQUAL.values(), ids=UNEQUAL.keys())
def test_unequal_elements_leave_all_of_double_precision(chain: Chain) -> None:
    exact, vectors = reference.chain_modes(chain)
    assert np.all(relative_errors(chain.modes, exact) <= chain.modes.frequencies_error)
    assert matrix_error(chain.modes, vectors) <= chain.modes.error
    assert chain.modes.error < 1e-14


def test_the_error_is_honest_where_double_double_is_not_enough() -> None:
    chain = Chain([1.0, 1e12] * 5, [1.0, 1e12] * 5)
    exact, vectors = reference.chain_modes(chain)
    assert np.all(relative_errors(chain.modes, exact) <= chain.modes.frequencies_error)
    assert 1e-12 < matrix_error(chain.modes, vectors) <= chain.modes.error < 1e-4


@pytest.mark.parametrize("cuts", [(0,), (0, 4), (0, 3, 7)])
def test_rigid_body_modes_have_frequency_zero_exactly(cuts: tuple[int, ...]) -> None:
    springs = np.random.default_rng(1).uniform(0.5, 2.0, 10)
    springs[list(cuts)] = 0.0
    modes = Chain(np.linspace(0.7, 2.3, 10), springs).modes
    assert np.count_nonzero(modes.frequencies == 0.0) == len(cuts)
    assert modes.frequencies[len(cuts)] > 0.1


def test_rigid_body_modes_of_rounded_matrices_have_frequency_zero_exactly() -> None:
    springs = [0.0, *np.random.default_rng(1).uniform(0.5, 2.0, 9)]
    chain = Chain(10, springs)
    modes = Modes.from_matrices(chain.mass, chain.damping_matrix, chain.stiffness)
    assert modes.frequencies[0] == 0.0
    assert modes.frequencies[1] > 0.1


@pytest.mark.parametrize("seed", range(30))
def test_a_coordinate_without_springs_that_masses_join_is_a_rigid_body(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 9))
    factor = rng.normal(size=(size, size))
    mass = np.diag(rng.uniform(0.5, 2.0, size)) + 0.3 * factor @ factor.T
    stiffness = np.diag(np.insert(rng.uniform(0.1, 3.0, size - 1), rng.integers(size), 0.0))
    modes = Modes.from_matrices((mass + mass.T) / 2.0, np.zeros((size, size)), stiffness)
    assert modes.frequencies[0] == 0.0
    assert modes.frequencies[1] > 0.01


@pytest.mark.parametrize("size", [4, 9, 60])
def test_double_frequencies_are_found_twice(size: int) -> None:
    modes = Modes.from_matrices(np.eye(size), np.zeros((size, size)), laplacian(size))
    with mpmath.workdps(40):
        exact = sorted(2 * mpmath.sin(mpmath.pi * (i // 2) / size) for i in range(1, size + 1))
    assert modes.frequencies[0] == 0.0
    assert np.all(relative_errors(modes, exact) <= modes.frequencies_error)
    assert modes.error < 1.2e-16


@pytest.mark.parametrize("size", [4, 9, 60])
def test_modes_of_double_frequencies_are_an_orthonormal_basis(size: int) -> None:
    matrix = Modes.from_matrices(np.eye(size), np.zeros((size, size)), laplacian(size)).matrix
    assert np.allclose(matrix.T @ matrix, np.eye(size), rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("apart", [1e-6, 1e-10, 1e-14, 1e-16, 1e-20, 1e-24])
def test_nearly_equal_frequencies_are_told_apart(apart: float) -> None:
    # Two equal oscillators with a weak coupling: w^2 = 1 and 1 + 2 apart.
    modes = GroundedTwins(apart).modes
    with mpmath.workdps(60):
        exact = [mpmath.mpf(1), mpmath.sqrt(1 + 2 * mpmath.mpf(apart))]
        found = [
            value(*pair) for pair in zip(modes.frequencies, modes.frequencies_low, strict=True)
        ]
        assert abs((found[1] - found[0]) / (exact[1] - exact[0]) - 1) < 1e-29 / apart
    half = np.sqrt(0.5)
    assert np.allclose(modes.matrix, [[half, -half], [half, half]], rtol=0.0, atol=modes.error)


@pytest.mark.parametrize("size", [3, 12, 80])
def test_full_mass_and_stiffness_matrices(size: int) -> None:
    rng = np.random.default_rng(size)
    a, b = rng.normal(size=(2, size, size)).round(3)
    mass, stiffness = (x.T @ x for x in (a + 3 * np.sqrt(size) * np.eye(size), b))
    mass, stiffness = (mass + mass.T) / 2, (stiffness + stiffness.T) / 2
    modes = Modes.from_matrices(mass, np.zeros((size, size)), stiffness)
    with mpmath.workdps(40), ctx.workprec(400):
        m, k = arb_mat(mass.tolist()), arb_mat(stiffness.tolist())
        for chosen in (0, size - 1):
            pair = modes.frequencies[chosen], modes.frequencies_low[chosen]
            squared = (arb(float(pair[0])) + arb(float(pair[1]))) ** 2
            column = modes.matrix[:, chosen].tolist()
            # One step of inverse iteration gives the mode to twice the digits, its growth the gap.
            shifted = k - m * squared + m * arb("1e-22")
            solved = shifted.solve(m * arb_mat(size, 1, column)).entries()
            better = [to_mpf(entry) for entry in solved]
            largest = max(abs(entry) for entry in better)
            exact = [entry / mpmath.norm(better) * mpmath.norm(column) for entry in better]
            sign = mpmath.sign(exact[size - 1] * column[size - 1])
            assert largest > 1e18
            assert column_error(modes.matrix[:, chosen], [sign * e for e in exact]) < 3e-16


# ------------------------------------------------------------------------------------- decays


def decay_errors(modes: Modes, exact: list[Any]) -> Array:
    with mpmath.workdps(reference.DIGITS):
        largest = max(exact)
        pairs = zip(modes.decay, modes.decay_low, exact, strict=True)
        return np.array([float(abs(value(high, low) - d) / largest) for high, low, d in pairs])


@pytest.mark.parametrize("size", SIZES)
def test_decays_of_randomly_damped_chains(size: int) -> None:
    chain = random_chain(size, damped=True)
    _, vectors = reference.chain_modes(chain)
    assert decay_errors(chain.modes, reference.chain_decay(chain, vectors)).max() < 1e-26


@pytest.mark.parametrize("size", [2, 3, 10, 30])
def test_random_dashpots_couple_the_modes(size: int) -> None:
    assert not random_chain(size, damped=True).modes.proportional


@pytest.mark.parametrize(
    ("springs", "dashpots"), [(1.0, 0.1), (3.7, 0.37), ([1.0, 2.0], [0.1, 0.2])]
)
def test_dashpots_like_the_springs_give_decays_like_the_squared_frequencies(
    springs: Any, dashpots: Any
) -> None:
    modes = Chain(2, springs, dashpots).modes
    with mpmath.workdps(40):
        ratio = mpmath.mpf(np.ravel(dashpots)[0].item()) / mpmath.mpf(np.ravel(springs)[0].item())
        pairs = zip(modes.frequencies, modes.frequencies_low, strict=True)
        exact = [ratio * value(*pair) ** 2 / 2 for pair in pairs]
        found = [value(*pair) for pair in zip(modes.decay, modes.decay_low, strict=True)]
        assert all(abs(a / b - 1) < 1e-30 for a, b in zip(found, exact, strict=True))
    assert modes.proportional


def test_the_uniform_chain_decays_by_its_closed_form() -> None:
    modes = uniform(1000).modes
    with mpmath.workdps(40):
        exact = [mpmath.mpf(0.1) * w**2 / 2 for w in reference.uniform_frequencies(1000)]
    assert modes.decay.tolist() == [float(d) for d in exact]


def test_springs_and_dashpots_proportional_up_to_rounding_do_not_couple() -> None:
    springs = np.random.default_rng(2).uniform(0.5, 2.0, 100)
    modes = Chain(100, springs, 0.07 * springs).modes
    assert modes.proportional
    assert np.allclose(modes.decay, 0.035 * modes.frequencies**2, rtol=1e-12, atol=0.0)


def test_damping_like_the_masses_gives_one_decay_for_all() -> None:
    chain = random_chain(6)
    modes = Modes.from_matrices(chain.mass, 0.25 * chain.mass, chain.stiffness)
    assert modes.proportional
    assert modes.decay.tolist() == [0.125] * 6


def test_damping_by_masses_and_springs_does_not_couple() -> None:
    chain = random_chain(12)
    damping = 0.5 * chain.mass + 0.25 * chain.stiffness
    modes = Modes.from_matrices(chain.mass, damping, chain.stiffness)
    assert modes.proportional
    assert np.allclose(modes.decay, 0.25 + 0.125 * modes.frequencies**2, rtol=1e-15, atol=0.0)


def test_a_slightly_stronger_dashpot_couples() -> None:
    assert not Chain(10, 1.0, [0.1] * 9 + [0.1 * (1 + 1e-11)]).modes.proportional


def test_without_dashpots_nothing_decays() -> None:
    modes = random_chain(5).modes
    assert modes.decay.tolist() == [0.0] * 5
    assert modes.proportional


# ------------------------------------------------------------------------------------ refusals

ONE, ZERO = np.eye(2), np.zeros((2, 2))


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        ((np.ones((2, 3)), ZERO, ONE), r"mass must be a square matrix; got shape \(2, 3\)"),
        ((np.ones((0, 0)), ZERO, ONE), "mass must be a square matrix"),
        ((ONE, np.zeros((3, 3)), ONE), r"damping must have shape \(2, 2\); got shape \(3, 3\)"),
        (
            (ONE, ZERO, [[1.0, 2.0], [0.0, 1.0]]),
            r"stiffness must be symmetric; got 2\.0 at \[0, 1\]",
        ),
        ((ONE, ZERO, [[1.0, np.nan], [0.0, 1.0]]), r"stiffness\[0, 1\] must be a finite number"),
        ((ZERO, ZERO, ONE), r"mass must be positive definite; got 0\.0 at \[0, 0\]"),
        ((np.ones((2, 2)), ZERO, ONE), "mass must be positive definite; got the eigenvalue"),
        ((ONE, -ONE, ONE), r"damping must be positive semidefinite; got -1\.0 at \[0, 0\]"),
        ((ONE, ZERO, 1 - ONE), r"stiffness must be positive semidefinite; got the eigenvalue -1"),
    ],
)
def test_impossible_matrices_are_refused(matrices: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Modes.from_matrices(*matrices)


def test_close_low_modes_beside_a_stiff_one_are_exact() -> None:
    # Its first approximation mixes them by 1e-4, whose cube is not small.
    stiff = 1e12
    modes = Chain(3, [1.0, stiff, 1.0], 0.0).modes
    with mp.workdps(60):
        k = mpf(stiff)
        exact, shapes = mpmath.eigsy(mpmath.matrix([[1 + k, -k, 0], [-k, k + 1, -1], [0, -1, 1]]))
        for i in range(3):
            found = mpf(float(modes.frequencies[i])) + mpf(float(modes.frequencies_low[i]))
            error = float(modes.frequencies_error[i])
            assert abs(found / mpmath.sqrt(exact[i]) - 1) <= error
            sign = mpmath.sign(shapes[2, i])
            off = [float(mpf(float(modes.matrix[j, i])) - sign * shapes[j, i]) for j in range(3)]
            assert max(map(abs, off)) <= modes.error


def test_another_damping_takes_no_eigenpairs_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(*given: Any) -> Any:
        calls.append(given)
        return refine(*given)

    monkeypatch.setattr("dynkit.systems.structure.modes.refine", counted)
    springs = (1.0, 2.0, 1.0625)
    found = [Chain(3, springs, dashpots=0.01 * k).modes for k in range(1, 6)]
    assert len(calls) == 1
    assert len({each.decay.tobytes() for each in found}) == 5
    assert Chain([1.0, 1.0, 1.5], springs).modes.frequencies[0] < found[0].frequencies[0]
    assert len(calls) == 2


def test_eigenpairs_of_large_matrices_are_not_kept() -> None:
    for size in (2, 201):
        assert Chain(size, [1.3125] * size).modes.frequencies[0] > 0.0
    assert [len(pairs.values.high) for pairs in _last.values()] == [2]
