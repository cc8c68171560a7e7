"""Small blocks into which any linear structure falls, also where modes merge.

The state matrix of M x'' + C x' + K x = 0, in coordinates whose square sum is twice the energy, is
brought to real Schur form in double-double arithmetic. Every pair of complex rates, and every real
rate, has an invariant subspace. Where these, taken together, are an ill-conditioned basis, because
modes merge or nearly do, those to blame are joined to a cluster, whose subspace gets an orthonormal
basis. What remains are the blocks on the diagonals of the Schur forms of the clusters, and the
couplings above. A single cluster of everything always serves, so that no structure is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.systems.impact.energy_coordinates import EnergyCoordinates, double_double
from dynkit.systems.impact.schur import SchurForm
from dynkit.systems.structure.double_double import DoubleDouble
from dynkit.validation import Array

LARGEST_PROJECTOR = 1e3
"""Clusters are joined until no projector onto one of them, along the others, is larger."""

# Below this, relative to its blocks, a coupling is the rounding error of two equal rates.
_NO_COUPLING = 2.0**-70


@final
@dataclass(frozen=True, eq=False)
class Blocks:
    """Pairs of coordinates y_t' = G_t y_t + sum_s B_ts y_s, whose combinations are (x, v).

    Attributes
    ----------
    generator, generator_low : (4, N) arrays
        Entries 11, 12, 21, 22 of each G, double-double.
    target, source : (L,) arrays of int
        Pair t of each link, and the pair s > t that drives it. Where s drives k and k drives t,
        there is a link from s to t, too.
    coupling : (L, 4) array
        Entries 11, 12, 21, 22 of each B.
    matrix : (2N, 2N) array
        Positions and velocities from coordinates: first those of all pairs, then the second ones.
    inverse : (2N, 2N) array
        Coordinates from positions and velocities.
    condition : float
        Condition number of the basis where states are measured by the roots of their energies. It
        tells by how much conversions of states and coordinates enlarge rounding errors.

    Notes
    -----
    A G with a zero in its place 21 has real rates; it is diagonal where they have nothing in common
    but the place. Rigid-body motions have a rate that is exactly 0 in such a G: (position,
    velocity) with G = (0, 1; 0, 0) where no dashpot holds them.

    The basis of pairs that are linked is orthonormal as measured by the energy, which only falls:
    but for rigid-body motions, the square sum of their coordinates never grows. Therefore damping
    bounds the couplings, ``norm(B_ts)^2 <= norm(G_t + G_t') norm(G_s + G_s')``, and doubles are
    good enough for them.
    """

    generator: Array
    generator_low: Array
    target: NDArray[np.intp]
    source: NDArray[np.intp]
    coupling: Array
    matrix: Array
    inverse: Array
    condition: float


def real_blocks(mass: Array, damping: Array, stiffness: Array) -> Blocks:
    """Blocks of M x'' + C x' + K x = 0.

    Parameters
    ----------
    mass, damping, stiffness : (N, N) arrays
        M, positive definite; C and K, positive semidefinite; all symmetric.

    Raises
    ------
    ValueError
        When a matrix is not as required.

    References
    ----------
    C. Bavely, G. W. Stewart, An algorithm for computing reducing subspaces by block
    diagonalization, SIAM J. Numer. Anal. 16 (1979) 359-367.

    Examples
    --------
    Two equal oscillators, joined by a dashpot that damps their difference critically:

    >>> joint = np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> blocks = real_blocks(np.eye(2), joint, np.eye(2))
    >>> critical = np.argmin(blocks.generator[0])
    >>> np.abs(blocks.generator[:, critical]).round(12)
    array([1., 2., 0., 1.])
    """
    coordinates = EnergyCoordinates.of(mass, damping, stiffness)
    form = SchurForm(coordinates.state_matrix(), coordinates.held)
    clusters, condition = _clusters(form, coordinates.held)
    return _assembled(coordinates, form, clusters, condition)


# --- clusters -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Cluster:
    """Blocks of a Schur form that are taken together.

    Attributes
    ----------
    numbers : list
        Of the blocks.
    vectors : (n, m) array
        Orthonormal basis of their invariant subspace.
    """

    numbers: list[int]
    vectors: Array

    @staticmethod
    def of(form: SchurForm, numbers: list[int]) -> _Cluster:
        return _Cluster(numbers, form.lead(numbers)[0].high)


def _clusters(form: SchurForm, held: int) -> tuple[list[_Cluster], float]:
    """Clusters whose bases make a well-conditioned one together, and its condition number.

    The rates 0 of rigid-body positions, which lead the Schur form, are joined to as many real ones:
    such pairs are position and velocity, however slow the decay is.
    """
    clusters = [_Cluster.of(form, [number]) for number in range(held, len(form.size))]
    if held:
        rigid = _Cluster.of(form, list(range(held)))
        for _ in range(held):
            real = [c for c in clusters if form.size[c.numbers[0]] == 1]
            if real:
                rigid = _joined(form, clusters, rigid, real)
        clusters.append(rigid)
    while True:
        basis = np.concatenate([c.vectors for c in clusters] or [np.eye(0)], axis=1)
        # The small number keeps the inverse finite where two subspaces are the same.
        inverse = np.linalg.inv(basis + 1e-14 * np.eye(len(basis)))
        projectors = _sizes(np.asarray(inverse.T), clusters)
        if len(clusters) < 2 or projectors.max() <= LARGEST_PROJECTOR:
            return clusters, float(np.linalg.cond(basis)) if clusters else 1.0
        worst = clusters.pop(int(np.argmax(projectors)))
        clusters.append(_joined(form, clusters, worst, clusters))


def _sizes(columns: Array, clusters: list[_Cluster]) -> Array:
    """Norms of the columns that belong to each cluster."""
    ends = np.cumsum([c.vectors.shape[1] for c in clusters])
    return np.array([np.linalg.norm(part) for part in np.split(columns, ends[:-1], axis=1)])


def _joined(
    form: SchurForm, clusters: list[_Cluster], one: _Cluster, others: list[_Cluster]
) -> _Cluster:
    """A cluster and that of some others with the smallest angle, taken from the list of clusters.

    Sums of squares of cosines are compared.
    """
    cosines = one.vectors.T @ np.concatenate([other.vectors for other in others], axis=1)
    closest = others[int(np.argmax(_sizes(cosines, others)))]
    clusters[:] = [cluster for cluster in clusters if cluster is not closest]
    return _Cluster.of(form, one.numbers + closest.numbers)


# --- pairs ----------------------------------------------------------------------------------------


def _assembled(
    coordinates: EnergyCoordinates, form: SchurForm, clusters: list[_Cluster], condition: float
) -> Blocks:
    size = 2 * len(coordinates.mass)
    generator = double_double(np.zeros((size, size)))
    columns: list[DoubleDouble] = []
    pairs: list[tuple[int, int]] = []
    alone: list[int] = []  # real rates without a neighbour
    start = 0
    for cluster in clusters:
        numbers, real = _in_order(form, cluster.numbers)
        vectors, own = form.lead(numbers)
        zeros = [i for i, number in enumerate(numbers) if number < coordinates.held]
        stop = start + len(own.high)
        for part, whole in zip(own, generator, strict=True):
            part[np.ix_(zeros, zeros)] = 0.0
            whole[start:stop, start:stop] = part
        columns.append(vectors)
        alone += [start] * (real % 2)
        pairs += [(k, k + 1) for k in range(start + real % 2, stop, 2)]
        start = stop
    alone.sort(key=lambda k: -generator.high[k, k])
    half = len(alone) // 2
    pairs = [*zip(alone[:half], alone[half:], strict=True), *pairs]
    free = (size - start) // 2
    for k in range(start, start + free):
        generator.high[k, k + free] = 1.0
        pairs.append((k, k + free))
    order = np.array(pairs).T.ravel()
    matrix = np.ascontiguousarray(coordinates.states(columns)[:, order])
    high, low = (_pairwise(part[np.ix_(order, order)]) for part in generator)
    target, source = _links(high)
    own_place = np.arange(len(pairs))
    return Blocks(
        generator=np.ascontiguousarray(high[own_place, own_place].T),
        generator_low=np.ascontiguousarray(low[own_place, own_place].T),
        target=target,
        source=source,
        coupling=high[target, source],
        matrix=matrix,
        inverse=coordinates.inverse(matrix),
        condition=condition,
    )


def _in_order(form: SchurForm, numbers: list[int]) -> tuple[list[int], int]:
    """Blocks as they make pairs, and how many are real: an odd one, real ones, complex ones.

    What is odd may share its pair with the odd one of another cluster: it drives nothing.
    """
    real = sorted(number for number in numbers if form.size[number] == 1)
    even = len(real) - len(real) % 2
    turning = [number for number in numbers if form.size[number] == 2]
    return [*real[even:], *real[:even], *turning], len(real)


def _pairwise(matrix: Array) -> Array:
    """(N, N, 4) entries 11, 12, 21, 22 of the blocks; rows and columns: all first, all second."""
    n = len(matrix) // 2
    return matrix.reshape(2, n, 2, n).transpose(1, 3, 0, 2).reshape(n, n, 4)


def _links(blocks: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Targets and sources of all couplings, and of those that they make together."""
    size = np.abs(blocks).max(axis=2)
    own = np.diagonal(size)
    linked = size > _NO_COUPLING * np.minimum(own[:, None], own)
    np.fill_diagonal(linked, False)
    while True:
        longer = linked | (linked @ linked)
        if np.array_equal(longer, linked):
            target, source = np.nonzero(linked)
            return target.astype(np.intp), source.astype(np.intp)
        linked = longer
