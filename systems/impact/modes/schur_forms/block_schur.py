"""Block-diagonal Schur forms of linear structures, also where modes merge.

The state matrix of M x'' + C x' + K x = 0, in coordinates whose square sum is twice the energy, is
brought to real Schur form in double-double arithmetic. Every pair of complex eigenvalues, and every
real one, has an invariant subspace. Where modes merge or nearly merge, the bases of these subspaces
are ill-conditioned together; the subspaces concerned are then joined to a cluster, which gets an
orthonormal basis. The result consists of the diagonal blocks of the Schur forms of the clusters,
and the couplings above them. No structure is refused: a single cluster of all modes always exists.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from dynkit.core.validation import Array
from dynkit.systems.impact.modes.energy_coordinates import EnergyCoordinates
from dynkit.systems.impact.modes.schur_forms.invariant_subspaces import Cluster, clusters_of
from dynkit.systems.structure.double_double import DoubleDouble
from dynkit.systems.structure.modes import Derivation

# A coupling below this, relative to its blocks, is the rounding error of two equal rates.
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
    energy : (2N, 2N) array
        From coordinates to numbers whose square sum is twice the energy.
    condition : float
        Condition number of the basis in the energy norm: the factor by which conversions between
        states and coordinates enlarge rounding errors.

    Notes
    -----
    A block G whose entry 21 is zero has real eigenvalues; if these are unrelated, G is diagonal. A
    rigid-body motion is a pair of position and velocity, up to factors: entry 11 of its G is
    exactly zero, and so is entry 22 if no dashpot acts on the body.

    The basis of each pair, and of linked pairs, is orthonormal in the energy norm. Energy never
    grows, except that rigid-body positions have none. Therefore damping bounds the couplings,
    ``norm(B_ts)^2 <= norm(G_t + G_t') norm(G_s + G_s')``, and doubles suffice for them. Traction
    may feed energy in; then an unlinked pair of complex eigenvalues has the form (a, b; -b, a).
    """

    generator: Array
    generator_low: Array
    target: NDArray[np.intp]
    source: NDArray[np.intp]
    coupling: Array
    matrix: Array
    inverse: Array
    energy: Array
    condition: float


def real_blocks(given: Derivation) -> Blocks:
    """Blocks of M x'' + C x' + K x = 0.

    References
    ----------
    C. Bavely, G. W. Stewart, An algorithm for computing reducing subspaces by block
    diagonalization, SIAM J. Numer. Anal. 16 (1979) 359-367.

    Examples
    --------
    Two equal oscillators, joined by a dashpot that damps their difference critically:

    >>> joint = np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> blocks = real_blocks(Derivation.from_matrices(np.eye(2), joint, np.eye(2)))
    >>> critical = np.argmin(blocks.generator[0])
    >>> np.abs(blocks.generator[:, critical]).round(12)
    array([1., 2., 0., 1.])
    """
    coordinates = EnergyCoordinates.of(given)
    clusters = clusters_of(coordinates)
    if given.traction is not None:
        # Energy may grow; the norm of a circular pair grows only if the motion of the pair does.
        clusters = [cluster.circular() for cluster in clusters]
    vectors = DoubleDouble(
        *(np.concatenate(part, axis=1) for part in zip(*(c.vectors for c in clusters), strict=True))
    )
    generator, pairs = _arranged(clusters)
    order = np.array(pairs).T.ravel()
    states = coordinates.states(vectors)
    matrix = DoubleDouble(*(np.ascontiguousarray(part[:, order]) for part in states))
    energy = vectors.high[:, order]
    energy[: coordinates.rigid] = 0.0
    high, low = (_pairwise(part[np.ix_(order, order)]) for part in generator)
    target, source = _links(high)
    own = np.arange(len(pairs))
    return Blocks(
        generator=np.ascontiguousarray(high[own, own].T),
        generator_low=np.ascontiguousarray(low[own, own].T),
        target=target,
        source=source,
        coupling=high[target, source],
        matrix=matrix.high,
        inverse=coordinates.inverse(matrix),
        energy=energy,
        condition=float(np.linalg.cond(vectors.high)),
    )


def _arranged(clusters: list[Cluster]) -> tuple[DoubleDouble, list[tuple[int, int]]]:
    """State matrix in the coordinates of all clusters, and which coordinates form pairs."""
    size = sum(len(cluster.matrix.high) for cluster in clusters)
    generator = DoubleDouble(np.zeros((size, size)), np.zeros((size, size)))
    pairs: list[tuple[int, int]] = []
    alone: list[int] = []  # real rates without a partner
    start = 0
    for cluster in clusters:
        stop, odd = start + len(cluster.matrix.high), cluster.real % 2
        for part, whole in zip(cluster.matrix, generator, strict=True):
            whole[start:stop, start:stop] = part
        alone += [start] * odd
        pairs += [(k, k + 1) for k in range(start + odd, stop, 2)]
        start = stop
    # The first coordinate of a cluster drives no other: two clusters may share a pair.
    alone.sort(key=lambda k: -generator.high[k, k])
    half = len(alone) // 2
    return generator, [*zip(alone[:half], alone[half:], strict=True), *pairs]


def _pairwise(matrix: Array) -> Array:
    """(N, N, 4) entries 11, 12, 21, 22 of the blocks; rows and columns: all first, all second."""
    n = len(matrix) // 2
    return matrix.reshape(2, n, 2, n).transpose(1, 3, 0, 2).reshape(n, n, 4)


def _links(blocks: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Targets and sources of all links, with links implied by two successive couplings."""
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
