"""Random polynomial maps that bifurcate, and what is at a bifurcation of any map to many digits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx

from dynkit.core.validation import Array
from dynkit.dynamics.map import Map
from dynkit.systems import Henon, HighBounce

BITS = 600
STEP = (1, -200)
"""Of differences: what they leave out is below 1e-100."""


@dataclass(frozen=True, eq=False)
class Polynomial(Map):
    """x' = middle + size w, w = A z + p' (u + B z) + q' (v + C z) + Q(z, z) + T z^3.

    With z = (x - middle) / size, and p' and q' the parameters less their middles, in their widths.

    Parameters
    ----------
    p, q : float
    middle, size : (d,) arrays
    middles, widths : (2,) arrays
    linear : (3, d, d) array
        A, B and C.
    drive : (2, d) array
        u and v.
    square, cube : (d, d, d) and (d, d) arrays
    """

    p: float
    q: float
    middle: Array
    size: Array
    middles: Array
    widths: Array
    linear: Array
    drive: Array
    square: Array
    cube: Array

    @property
    def dimension(self) -> int:
        return len(self.middle)

    @property
    def accuracy(self) -> float:
        """Roundings of as many terms as are added up where z is about one."""
        rows = abs(self.linear).sum(axis=(0, 2)) + abs(self.drive).sum(axis=0)
        rows = rows + abs(self.square).sum(axis=(1, 2)) + abs(self.cube).sum(axis=1)
        return 2.0**-52 * float(1.0 + rows.max())

    def __call__(self, state: Array) -> Array:
        z, (p, q) = (state - self.middle) / self.size, self._shifts
        matrix = self.linear[0] + p * self.linear[1] + q * self.linear[2]
        w = matrix @ z + p * self.drive[0] + q * self.drive[1]
        w = w + self.square @ z @ z + self.cube @ z**3
        return np.asarray(self.middle + self.size * w)

    def jacobian(self, state: Array) -> Array:
        z, (p, q) = (state - self.middle) / self.size, self._shifts
        matrix = self.linear[0] + p * self.linear[1] + q * self.linear[2]
        matrix = matrix + (self.square + self.square.transpose(0, 2, 1)) @ z
        matrix = matrix + 3.0 * self.cube * z**2
        return np.asarray(self.size[:, None] * matrix / self.size)

    def parameter_derivative(self, state: Array, name: str) -> Array:
        self.value_of(name)
        z, k = (state - self.middle) / self.size, ("p", "q").index(name)
        change = self.drive[k] + self.linear[1 + k] @ z
        return np.asarray(self.size * change / self.widths[k])

    @property
    def _shifts(self) -> tuple[float, float]:
        p, q = (np.array([self.p, self.q]) - self.middles) / self.widths
        return float(p), float(q)


def random_polynomial(random: Random) -> Polynomial:
    """Of one to four coordinates; near its middles one multiplier or a pair is critical."""
    d = random.choice((1, 2, 2, 3, 4))
    normal = np.vectorize(lambda _: random.gauss(0.0, 1.0), otypes=[float])
    turn = normal(np.empty((d, d))) + np.eye(d)
    core = np.diag([_multiplier(random) for _ in range(d)])
    if d > 1 and random.random() < 0.5:
        angle = random.uniform(0.0, np.pi)
        c, s = np.cos(angle), np.sin(angle)
        core[:2, :2] = [[c, -s], [s, c]]
    else:
        core[0, 0] = random.choice((1.0, -1.0))
    size = 10.0 ** random.uniform(-3.0, 3.0) * 10.0 ** (0.5 * normal(np.empty(d)))
    still = random.random() < 0.3
    far = random.choice((0.1, 1.0, 10.0))
    width = [10.0 ** random.uniform(-1.0, 1.0) for _ in range(2)]
    return Polynomial(
        p=0.0,
        q=0.0,
        middle=size * far * normal(np.empty(d)),
        size=size,
        middles=np.array(width) * random.choice((0.0, 1.0, 10.0)) * normal(np.empty(2)),
        widths=np.array(width),
        linear=np.stack([turn @ core @ np.linalg.inv(turn), *normal(np.empty((2, d, d)))]),
        drive=(0.0 if still else 1.0) * normal(np.empty((2, d))),
        square=random.choice((0.1, 1.0)) * normal(np.empty((d, d, d))),
        cube=random.choice((0.0, 1.0)) * normal(np.empty((d, d))),
    )


def _multiplier(random: Random) -> float:
    return random.choice((-1.0, 1.0)) * float(10.0 ** random.uniform(-3.0, 0.6))


# --- to many digits -------------------------------------------------------------------------------

Ball = Any
"""A number of balls."""


def image_of(system: Map, state: list[Ball], free: dict[str, Ball]) -> list[Ball]:
    """The next state, in balls, at values of the free parameters."""
    values = {name: arb(value) for name, value in system.parameters.items()} | free
    if isinstance(system, Henon):
        x, y = state
        return [1 - values["a"] * x * x + y, values["b"] * x]
    if isinstance(system, HighBounce):
        phase = state[0] + state[1]
        return [phase, values["restitution"] * state[1] - values["gamma"] * phase.cos()]
    assert isinstance(system, Polynomial)
    d = system.dimension
    z = [(x - m) / s for x, m, s in zip(state, _of(system.middle), _of(system.size), strict=True)]
    pq = [
        (values[name] - m) / w
        for name, m, w in zip("pq", _of(system.middles), _of(system.widths), strict=True)
    ]
    out = []
    for i in range(d):
        w = arb(0)
        for k in range(2):
            w += pq[k] * arb(float(system.drive[k, i]))
        for j in range(d):
            slope = arb(float(system.linear[0, i, j]))
            slope += sum(pq[k] * arb(float(system.linear[1 + k, i, j])) for k in range(2))
            slope += sum(z[k] * arb(float(system.square[i, j, k])) for k in range(d))
            slope += arb(float(system.cube[i, j])) * z[j] * z[j]
            w += slope * z[j]
        out.append((arb(float(system.middle[i])) + arb(float(system.size[i])) * w).mid())
    return out


def _of(numbers: Array) -> list[Ball]:
    return [arb(x) for x in numbers.tolist()]


def equations_of(
    system: Map, names: tuple[str, ...], kind: str, n: int
) -> Callable[[list[Ball]], list[Ball]]:
    """What is zero at a bifurcation of n states: (states, own unknowns, parameters) -> equations.

    Besides those of the orbit, that the product of the derivatives has the critical multiplier.
    Derivatives are differences: no formula of a derivative is used. At a BP one of half the period
    doubles it.
    """
    d = system.dimension
    if kind == "BP":
        half = equations_of(system, names, "PD", n // 2)

        def doubled(y: list[Ball]) -> list[Ball]:
            first, second = y[: n * d // 2], y[n * d // 2 : n * d]
            gaps = [a - b for a, b in zip(first, second, strict=True)]
            return [*half([*first, *y[n * d + 1 :]]), *gaps, y[n * d]]

        return doubled

    def equations(y: list[Ball]) -> list[Ball]:
        free = dict(zip(names, y[len(y) - len(names) :], strict=True))
        rows = [y[i * d : i * d + d] for i in range(n)]
        out, product = [], arb_mat(np.eye(d).tolist())
        for i, row in enumerate(rows):
            image = image_of(system, row, free)
            gaps = [a - b for a, b in zip(image, rows[(i + 1) % n], strict=True)]
            if isinstance(system, HighBounce):
                turn = 2 * arb.pi()
                gaps[0] -= turn * round(float(gaps[0].mid()) / (2.0 * np.pi))
            out += gaps
            product = derivative_of(lambda s: image_of(system, s, free), row) * product
        if kind == "NS":
            theta = acb(y[n * d])
            left = (
                acb_mat(product) - acb_mat(np.eye(d).tolist()) * (theta * acb(0, 1)).exp()
            ).det()
            return [*out, left.real, left.imag]
        critical = {"SN": 1, "PD": -1}[kind]
        return [*out, (product - arb_mat(np.eye(d).tolist()) * critical).det()]

    return equations


def branch_points_of(
    system: Polynomial, names: tuple[str, ...]
) -> Callable[[list[Ball]], list[Ball]]:
    """What is zero where its middle, a fixed point for ever, has the multiplier 1.

    Of (state, what unfolds the equations, parameters).
    """
    d = system.dimension

    def equations(y: list[Ball]) -> list[Ball]:
        free = dict(zip(names, y[d + 1 :], strict=True))
        gaps = [a - arb(b) for a, b in zip(y, system.middle.tolist(), strict=False)]
        slope = derivative_of(lambda s: image_of(system, s, free), y[:d])
        return [*gaps, y[d], (slope - arb_mat(np.eye(d).tolist())).det()]

    return equations


def derivative_of(function: Callable[[list[Ball]], list[Ball]], y: list[Ball]) -> Ball:
    """The matrix of the derivatives of a function of several numbers."""
    h, columns = arb(STEP), []
    for k in range(len(y)):
        ends = [function([*y[:k], y[k] + s * h, *y[k + 1 :]]) for s in (1, -1)]
        columns.append([((a - b) / (2 * h)).mid() for a, b in zip(*ends, strict=True)])
    return arb_mat(columns).transpose()


def distance_to(
    equations: Callable[[list[Ball]], list[Ball]], y: list[float], scale: Array
) -> Array | None:
    """The shortest way, (len(y),), from a place to the exact solutions of equations nearby.

    By Newton's method orthogonally, in units of `scale`, to where the solutions go on. None where
    the equations have a double root, as of two multipliers at once, whose place they do not tell.

    Raises
    ------
    ArithmeticError
        When there are none.
    """
    with ctx.workprec(BITS):
        place = [arb(x) for x in y]
        matrix = derivative_of(equations, place)
        scaled = matrix * arb_mat(np.diag(scale).tolist())
        inverse = _inverse(scaled)
        moved = [arb(0)] * len(y)
        for _ in range(60):
            here = [a + arb(s) * b for a, s, b in zip(place, scale.tolist(), moved, strict=True)]
            left = arb_mat([[g.mid()] for g in equations([x.mid() for x in here])])
            step = (inverse * left).mid().entries()
            moved = [a - b for a, b in zip(moved, step, strict=True)]
            if max(float(abs(s).mid()) for s in step) < 1e-50:
                return np.array([float(m.mid()) for m in moved])
    if _is_singular(scaled):
        return None
    raise ArithmeticError("there is no bifurcation near")


def _is_singular(matrix: Ball) -> bool:
    """Whether the last equation, of the multipliers, has no derivative of its own."""
    rows = np.array([[float(x.mid()) for x in row] for row in matrix.table()])
    sizes = abs(rows).max(axis=1)
    sizes[-1] = max(sizes[-1], 1.0)
    return bool(np.linalg.svd(rows / sizes[:, None])[1][-1] < 1e-10)


def _inverse(matrix: Ball) -> Ball:
    """Of equations that are as many as unknowns, or fewer: then the shortest step."""
    if matrix.nrows() == matrix.ncols():
        return matrix.inv().mid()
    across = matrix.transpose()
    return (across * (matrix * across).inv()).mid()
