"""Invariant subspaces of a Schur form, joined if their bases together are ill-conditioned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from dynkit.systems.impact.modes.energy_coordinates import EnergyCoordinates
from dynkit.systems.impact.modes.schur_forms.schur import SchurForm
from dynkit.systems.structure.double_double import (
    DoubleDouble,
    add,
    divide,
    multiply,
    negative,
    square_root,
)

SMALL_PROJECTOR = 1e3
"""Largest norm of a projector onto a cluster along the others, as long as the clusters have no more
links than pairs, or than `FEW_LINKS`: more links would dominate the cost of an impact."""

LARGEST_PROJECTOR = 1e5
"""Largest norm of a projector for any number of links. Conversions of states amplify rounding by
this factor, to errors of about 1e-11 of the size of the states."""

FEW_LINKS = 64

# Largest condition number of the change to a basis in which a pair moves on circles.
_FLATTEST = 100.0

# Rates below this, relative to the fastest one, are zero to double-double rounding.
_UNRESOLVED = 2.0**-90


@final
@dataclass(frozen=True, eq=False)
class Cluster:
    """An invariant subspace V of a matrix A, A V = V matrix.

    Attributes
    ----------
    numbers : list of int
        Numbers of its blocks in the Schur form, ascending.
    vectors : DoubleDouble, shape (n, m)
        Orthonormal basis.
    matrix : DoubleDouble, shape (m, m)
        Block upper triangular; real rates come first, and zeros first among these.
    real : int
        Number of real blocks.
    """

    numbers: list[int]
    vectors: DoubleDouble
    matrix: DoubleDouble
    real: int

    @staticmethod
    def of(form: SchurForm, numbers: list[int], rigid: int) -> Cluster:
        """The subspace of some blocks; the rates of the first `rigid` ones are exactly zero."""
        real = [number for number in numbers if form.size[number] == 1]
        turning = [number for number in numbers if form.size[number] == 2]
        vectors, matrix = form.lead([*real, *turning])
        still = sum(number < rigid for number in numbers)
        for part in matrix:
            part[:still, :still] = 0.0
        return Cluster(numbers, vectors, matrix, len(real))

    def circular(self) -> Cluster:
        """The cluster with a matrix (a, b; -b, a), if it is one well-conditioned complex pair."""
        if len(self.matrix.high) != 2 or self.real:
            return self
        p, q, r, t = (
            DoubleDouble(*(part[i, j : j + 1] for part in self.matrix))
            for i in (0, 1)
            for j in (0, 1)
        )
        a, off = (DoubleDouble(*(0.5 * part for part in add(p, x))) for x in (t, negative(t)))
        square = negative(add(multiply(off, off), multiply(q, r)))
        if square.high[0] <= 0.0:
            return self
        b = square_root(square)
        across, along = divide(negative(off), b), divide(negative(r), b)
        change = np.array([[1.0, across.high[0]], [0.0, along.high[0]]])
        if np.linalg.cond(change) > _FLATTEST:
            return self
        first, second = (DoubleDouble(*(part[:, [k]] for part in self.vectors)) for k in (0, 1))
        second = add(multiply(first, across), multiply(second, along))
        columns = zip(first, second, strict=True)
        vectors = DoubleDouble(*(np.concatenate(parts, axis=1) for parts in columns))
        matrix = (np.block([[x, y], [-y, x]]) for x, y in zip(a, b, strict=True))
        return Cluster(self.numbers, vectors, DoubleDouble(*matrix), 0)


def clusters_of(coordinates: EnergyCoordinates) -> list[Cluster]:
    """Invariant subspaces of the state matrix whose bases are well-conditioned together.

    For dashpots that are graded along a chain, all projectors grow exponentially with its length:
    no cheap basis is then as good as an orthonormal one of all modes.
    """
    rigid = coordinates.rigid
    form = SchurForm(coordinates.matrix, rigid)
    clusters = _rigid_pairs(form, coordinates) if rigid else []
    used = {number for cluster in clusters for number in cluster.numbers}
    others = (number for number in range(len(form.size)) if number not in used)
    clusters += [Cluster.of(form, [number], rigid) for number in others]
    while len(clusters) > 1:
        basis = np.concatenate([cluster.vectors.high for cluster in clusters], axis=1)
        ends = np.cumsum([len(cluster.matrix.high) for cluster in clusters])
        starts = ends - [len(cluster.matrix.high) for cluster in clusters]
        gram = basis.T @ basis
        # Squared norms of the rows of the inverse basis; the added diagonal keeps them finite.
        squares = np.diagonal(np.linalg.inv(gram + 1e-13 * np.eye(len(gram))))
        projectors = np.add.reduceat(squares, starts)
        worst = int(np.argmax(projectors))
        if projectors[worst] <= SMALL_PROJECTOR**2:
            break
        cosines = np.add.reduceat(np.sum(gram[starts[worst] : ends[worst]] ** 2, axis=0), starts)
        cosines[worst] = 0.0
        joined = [clusters[worst], clusters[int(np.argmax(cosines))]]
        if any(cluster.numbers[0] < rigid for cluster in joined):
            # Rigid-body positions stay together, except those that form pairs.
            joined += [cluster for cluster in clusters if cluster.numbers[0] < rigid]
        numbers = sorted({number for cluster in joined for number in cluster.numbers})
        rest = [cluster for cluster in clusters if cluster not in joined]
        sizes = [sum(form.size[number] for number in numbers)]
        sizes += [len(cluster.matrix.high) for cluster in rest]
        links = sum((size // 2) * (size // 2 - 1) // 2 for size in sizes)
        few = links <= max(len(basis) // 2, FEW_LINKS)
        if not few and projectors[worst] <= LARGEST_PROJECTOR**2:
            break
        clusters = [*rest, Cluster.of(form, numbers, rigid)]
    return clusters


def _rigid_pairs(form: SchurForm, coordinates: EnergyCoordinates) -> list[Cluster]:
    """Pairs of rigid-body positions and velocities, however slowly dashpots stop the bodies.

    A real rate r has a vector v, orthogonal to all positions, with A v = r v + w and w a position:
    v and w span an invariant subspace. The rates chosen are those that carry the bodies farthest,
    in directions as different as possible. Where this fails, positions and rates form one cluster.

    Rates that are zero to rounding are set to zero: no dashpot acts on the body.
    """
    from scipy.linalg import qr

    rigid = coordinates.rigid
    still = list(range(rigid))
    unresolved = _UNRESOLVED * float(np.abs(coordinates.matrix.high).max())
    pairs: list[Cluster] = []
    undamped: list[int] = []
    for number in range(rigid, len(form.size)):
        vectors, matrix = form.lead([*still, number])
        rate = float(np.abs(matrix.high[rigid:, rigid:]).max())
        drift = float(np.linalg.norm(matrix.high[:rigid, -1]))
        real = form.size[number] == 1
        drag = coordinates.uncertain_drag(vectors.high[:, -1]) if real else 0.0
        # Only the velocity of a rigid body becomes drift.
        if rate <= max(drag, unresolved) and drift > 0.5 * coordinates.scale[0]:
            undamped.append(number)
        elif real:
            pairs.append(_rigid_pair(vectors, matrix, [*still, number]))
    vectors, matrix = form.lead([*still, *undamped])
    for k in range(rigid, len(matrix.high)):
        place = [*still, k]
        one = DoubleDouble(*(part[:, place] for part in vectors))
        own = DoubleDouble(*(part[np.ix_(place, place)] for part in matrix))
        own.high[-1, -1] = own.low[-1, -1] = 0.0
        pairs.append(_rigid_pair(one, own, [*still, *undamped]))
    numbers = sorted({number for pair in pairs for number in pair.numbers} | set(still))
    if len(pairs) < rigid:
        return [Cluster.of(form, numbers, rigid)]
    drifts = np.stack([pair.vectors.high[:rigid, 0] for pair in pairs], axis=1)
    speeds = np.array([pair.matrix.high[:, 1] for pair in pairs])
    reach = speeds[:, 0] / np.hypot(*speeds.T)
    chosen = qr(drifts * reach, mode="r", pivoting=True)[1][:rigid].tolist()
    if np.linalg.cond(drifts[:, chosen]) <= SMALL_PROJECTOR:
        return [pairs[i] for i in chosen]
    return [Cluster.of(form, numbers, rigid)]


def _rigid_pair(vectors: DoubleDouble, matrix: DoubleDouble, numbers: list[int]) -> Cluster:
    """The pair of a displacement of rigid bodies and of a real rate, whose vector is the last."""
    drift = matrix.high[:-1, -1]
    speed = float(np.linalg.norm(drift))
    position = vectors.high[:, :-1] @ (drift / speed if speed else drift)
    zero = np.zeros_like(position)
    return Cluster(
        numbers,
        DoubleDouble(
            np.stack([position, vectors.high[:, -1]], axis=1),
            np.stack([zero, vectors.low[:, -1]], axis=1),
        ),
        DoubleDouble(
            np.array([[0.0, speed], [0.0, matrix.high[-1, -1]]]),
            np.array([[0.0, 0.0], [0.0, matrix.low[-1, -1]]]),
        ),
        2,
    )
