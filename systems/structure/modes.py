"""Normal modes of a structure; frequencies and decays have more than double precision."""

import time
from dataclasses import dataclass, fields
from fractions import Fraction
from threading import RLock
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import span
from dynkit.core.validation import Array, finite_array
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.systems.structure.double_double import (
    ROUNDING,
    DoubleDouble,
    add,
    column_dots,
    power_of_two,
    scale,
    square_root,
)
from dynkit.systems.structure.refinement import Eigenpairs, refine
from dynkit.systems.structure.symmetric import (
    SymmetricMatrix,
    Traction,
    check_definite,
    check_semidefinite,
)

# Larger ratios of damping to stiffness or mass may overflow; then `proportional` is decided by the
# modal matrix.
_LARGEST_RATIO = Fraction(2) ** 1000
# Relative error of rounding to a double: half an ulp.
_HALF_ULP = 2.0**-53


@final
@dataclass(frozen=True, eq=False, repr=False)
class Modes(Saved):
    """Modal form q'' + 2 decay q' + frequencies^2 q = 0 of M x'' + C x' + K x = 0, x = matrix q.

    All arrays are read-only. Frequencies and decays are double-double values: the nearest double,
    and the remainder as a second double.

    Parameters
    ----------
    frequencies : array, shape (N,)
        Natural frequencies of the undamped structure, ascending; exactly 0 for rigid-body modes.
    frequencies_low : array, shape (N,)
        Remainders of `frequencies`.
    frequencies_error : array, shape (N,)
        Bound on the relative error of ``frequencies + frequencies_low``; 0 for rigid-body modes. It
        is about ``1e-31 (frequencies[-1] / frequencies)^2`` or less.
    decay : array, shape (N,)
        Half the modal damping: half of the diagonal of ``matrix' C matrix``.
    decay_low : array, shape (N,)
        Remainders of `decay`.
    matrix : array, shape (N, N)
        Modal matrix, one mode per column, mass-normalised: ``matrix' M matrix = 1``. The last
        nonzero entry of each column is positive.
    proportional : bool
        Whether the damping leaves the modes uncoupled: every off-diagonal element of
        matrix' C matrix is below ``8 sqrt(N) 2^-53 (abs(matrix)' abs(C) abs(matrix))``, the effect
        of rounding C and the modal matrix to doubles.
    error : float
        Estimate of the largest error of `frequencies`, relative, and of the entries of `matrix`,
        relative to the largest of their column: 1.1e-16, half an ulp, unless the problem is badly
        conditioned.
    cost : Cost
        Seconds of the decomposition, and modes.

    Notes
    -----
    Modes whose eigenvalues differ by less than about 1e-28 of the largest one form a single
    eigenspace. Their columns are an orthonormal basis of it; `error` does not include the choice of
    this basis.

    If the last entry of a column is smaller than the column's error, its sign is not determined.

    The precision of double-double arithmetic limits the results. With a ratio of 1e12 between
    masses, or between stiffnesses, all results have full double precision. With 1e12 in both,
    alternating along a chain of ten, frequencies still have full precision, but close low modes
    mix: entries of the modal matrix have an error of 6e-9, and `error` is 2e-6.

    With proportional damping decays are as accurate as frequencies. Otherwise they have about 20
    digits relative to the largest decay, fewer where close modes mix, and depend on the choice of
    the basis in an eigenspace.
    """

    _stored: ClassVar = (
        *("frequencies", "frequencies_low", "frequencies_error", "decay", "decay_low", "matrix"),
        *("proportional", "error", "cost"),
    )
    frequencies: Array
    frequencies_low: Array
    frequencies_error: Array
    decay: Array
    decay_low: Array
    matrix: Array
    proportional: bool
    error: float
    cost: Cost

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __repr__(self) -> str:
        return f"<Modes: {len(self.frequencies)}, frequencies {span(self.frequencies)}>"

    def dataset(self) -> Dataset:
        """Return frequencies, decays and shapes as a dataset over ``mode`` and ``mass``, from 1."""
        each, count = "mode", np.arange(1, len(self.frequencies) + 1)
        return Dataset(
            {each: (each, count), "mass": ("mass", count)},
            {
                "frequency": (each, self.frequencies),
                "frequency_low": (each, self.frequencies_low),
                "frequency_error": (each, self.frequencies_error),
                "decay": (each, self.decay),
                "decay_low": (each, self.decay_low),
                "shape": (("mass", each), self.matrix),
                "error": ((), self.error),
            },
            described(
                "Modes of a structure",
                cost=self.cost,
                error="largest relative error of frequencies, and of shapes to their largest entry",
                proportional=str(self.proportional),
            ),
        )

    @classmethod
    def from_matrices(cls, mass: object, damping: object, stiffness: object) -> "Modes":
        """Return the modes of given matrices, whose elements are assumed to be rounded doubles.

        Parameters
        ----------
        mass, damping, stiffness : array_like, shape (N, N)
            M, positive definite; C and K, positive semidefinite; all symmetric.

        Returns
        -------
        Modes
            A frequency w is exactly 0 if w^2 <= 8 * 2^-53 * abs(phi)' abs(K) abs(phi): it is then
            zero within the rounding of the stiffnesses.

        Raises
        ------
        ValueError
            When a matrix is not square, not symmetric, not finite or not definite as required.

        Examples
        --------
        >>> modes = Modes.from_matrices(np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 1.0]])
        >>> modes.frequencies  # the golden ratio and its inverse
        array([0.61803399, 1.61803399])
        """
        return Derivation.from_matrices(mass, damping, stiffness).modes


_lock, _last = RLock(), dict[tuple[bytes, ...], Eigenpairs]()
_LARGEST_KEPT = 200
"""Largest size of matrices whose eigenpairs are kept: they and their key take 80 n^2 bytes."""


@dataclass(frozen=True, eq=False)
class Derivation:
    """The unrounded matrices of a structure, and its modes.

    Parameters
    ----------
    mass, damping, stiffness : SymmetricMatrix
        M, C and K, definite as required.
    exact : bool
        Whether the matrices are exact to double-double precision; otherwise they are assumed to be
        rounded to doubles.
    motion : Motion, optional
        Equations of motion where the energies are not quadratic. The matrices are then those of
        small oscillations about zero; the stiffness need not be semidefinite.
    traction : Traction or None
        Friction proportional to contact forces, which adds terms to C and K that are not symmetric.
        The modes are those without it.
    """

    mass: SymmetricMatrix
    damping: SymmetricMatrix
    stiffness: SymmetricMatrix
    exact: bool
    motion: Any = None
    traction: Traction | None = None

    @classmethod
    def from_matrices(cls, mass: object, damping: object, stiffness: object) -> "Derivation":
        """Return the derivation of given matrices: see `Modes.from_matrices`."""
        m = _checked("mass", mass, None)
        c = _checked("damping", damping, len(m))
        k = _checked("stiffness", stiffness, len(m))
        check_definite("mass", m)
        check_semidefinite("damping", c)
        check_semidefinite("stiffness", k)
        inertia, drag, springs = map(SymmetricMatrix.from_dense, (m, c, k))
        return cls(inertia, drag, springs, exact=False)

    @property
    def rounding(self) -> float:
        """Relative rounding error: a sum below this fraction of its absolute terms is zero.

        It is 0 if the matrices are exact.
        """
        return 0.0 if self.exact else 8.0 * _HALF_ULP

    def without(self, places: NDArray[np.intp], ties: Array | None = None) -> "Derivation":
        """Matrices of the structure with some coordinates held: see `SymmetricMatrix.without`."""
        return Derivation(
            self.mass.without(places, ties),
            self.damping.without(places, ties),
            self.stiffness.without(places, ties),
            self.exact,
            traction=None if self.traction is None else self.traction.without(places, ties),
        )

    @cached_property
    def modes(self) -> Modes:
        """Normal modes, computed at first access; zero frequencies define the rigid motions.

        Raises
        ------
        ValueError
            When the energies are not quadratic and zero is not a stable equilibrium.
        """
        if self.motion is not None:
            check_semidefinite("the stiffness matrix of small oscillations", self.stiffness.dense)
        with _lock:
            return _modes_of(self)


def _modes_of(given: Derivation) -> Modes:
    began = time.perf_counter()
    mass, damping, stiffness = given.mass, given.damping, given.stiffness
    # Scaling by powers of two avoids overflow and underflow of squares.
    heavy, stiff = mass.exponent, stiffness.exponent
    solved = _solved(stiffness, mass)
    squared = _without_rounding_modes(solved, given.rounding)
    root = square_root(squared)
    frequencies = power_of_two(root, (stiff - heavy) // 2)
    positive = squared.high > 0.0
    relative = np.zeros_like(squared.high)
    relative[positive] = solved.values_error[positive] / (2.0 * squared.high[positive]) + ROUNDING
    matrix = _with_tip_outwards(power_of_two(solved.vectors, -heavy // 2))
    decay, proportional = _decay(mass, damping, stiffness, squared, matrix)
    return Modes(
        frequencies=frequencies.high,
        frequencies_low=frequencies.low,
        frequencies_error=relative,
        decay=decay.high,
        decay_low=decay.low,
        matrix=matrix.high,
        proportional=proportional,
        error=float(_HALF_ULP + max(relative.max(), solved.vectors_error.max())),
        cost=Cost(time.perf_counter() - began, {"modes": len(relative)}),
    )


def _solved(stiffness: SymmetricMatrix, mass: SymmetricMatrix) -> Eigenpairs:
    """Eigenpairs of scaled K and M; the last ones are kept, as where the damping alone changes."""
    scaled = [matrix.scaled(-matrix.exponent) for matrix in (stiffness, mass)]
    if mass.size > _LARGEST_KEPT:
        return refine(*scaled)
    key = tuple(a.tobytes() for m in (stiffness, mass) for a in (m.rows, m.columns, m.high, m.low))
    if key not in _last:
        _last.clear()
        _last[key] = refine(*scaled)
    return _last[key]


def _checked(name: str, value: object, size: int | None) -> Array:
    matrix = finite_array(name, value, (size, size))
    if len(matrix) != matrix.shape[1] or not len(matrix):
        raise ValueError(f"{name} must be a square matrix; got shape {matrix.shape}")
    unequal = np.argwhere(matrix != matrix.T)
    if len(unequal):
        row, column = map(int, unequal[0])
        pair = f"{matrix[row, column]} at [{row}, {column}] and {matrix[column, row]} across"
        raise ValueError(f"{name} must be symmetric; got {pair}")
    return matrix


def _without_rounding_modes(solved: Eigenpairs, rounding: float) -> DoubleDouble:
    """Squared frequencies; those that are zero up to rounding are set to zero."""
    rigid = solved.values.high <= np.maximum(solved.values_error, rounding * solved.rounding_level)
    return DoubleDouble(
        np.where(rigid, 0.0, solved.values.high), np.where(rigid, 0.0, solved.values.low)
    )


def _with_tip_outwards(matrix: DoubleDouble) -> DoubleDouble:
    """Give each column the sign that makes its last nonzero entry positive."""
    nonzero = matrix.high[::-1] != 0.0
    last = len(nonzero) - 1 - np.argmax(nonzero, axis=0)
    sign = np.sign(matrix.high[last, np.arange(len(last))])
    return DoubleDouble(matrix.high * sign, matrix.low * sign)


def _decay(
    mass: SymmetricMatrix,
    damping: SymmetricMatrix,
    stiffness: SymmetricMatrix,
    squared: DoubleDouble,
    matrix: DoubleDouble,
) -> tuple[DoubleDouble, bool]:
    """Return half the modal damping, and whether the damping leaves the modes uncoupled.

    `squared` has the squared frequencies of the scaled matrices, from the refinement.
    """
    ratio = _exact_ratio(damping, stiffness)
    if ratio is not None:
        exponent = stiffness.exponent - mass.exponent - 1
        return power_of_two(_times_number(squared, ratio), exponent), True
    ratio = _exact_ratio(damping, mass)
    if ratio is not None:
        ones = DoubleDouble(np.ones_like(squared.high), np.zeros_like(squared.high))
        return power_of_two(_times_number(ones, ratio), -1), True
    exponent = damping.exponent
    scaled = damping.scaled(-exponent)
    forces = scaled.times(matrix.high)
    low = scaled.dense @ matrix.low
    forces = add(forces, DoubleDouble(low, np.zeros_like(low)))
    diagonal = add(
        column_dots(matrix.high, forces), column_dots(matrix.low, DoubleDouble(forces.high, low))
    )
    size = np.abs(matrix.high)
    coupling = np.abs(matrix.high.T @ forces.high)
    np.fill_diagonal(coupling, 0.0)
    level = 8.0 * np.sqrt(len(size)) * _HALF_ULP * (size.T @ np.abs(scaled.dense) @ size)
    return power_of_two(diagonal, exponent - 1), bool(np.all(coupling <= level))


def _exact_ratio(first: SymmetricMatrix, second: SymmetricMatrix) -> Fraction | None:
    """The number g with first = g second exactly; None if there is none, or if it overflows."""
    if not len(first.high):
        return Fraction(0)
    if not (
        np.array_equal(first.rows, second.rows) and np.array_equal(first.columns, second.columns)
    ):
        return None
    pairs = set(
        zip(*(part.tolist() for m in (first, second) for part in (m.high, m.low)), strict=True)
    )
    ratio: Fraction | None = None
    for high, low, other_high, other_low in pairs:
        found = (Fraction(high) + Fraction(low)) / (Fraction(other_high) + Fraction(other_low))
        if ratio is not None and found != ratio:
            return None
        ratio = found
    return ratio if ratio is None or ratio < _LARGEST_RATIO else None


def _times_number(x: DoubleDouble, number: Fraction) -> DoubleDouble:
    high = float(number)
    low = float(number - Fraction(high))
    first = scale(x, np.full_like(x.high, high))
    return add(first, scale(x, np.full_like(x.high, low)))
