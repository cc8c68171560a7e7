"""Equations of motion of one mode as heyoka's expressions, and the numbers in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from dynkit.core.validation import Array

if TYPE_CHECKING:
    from dynkit.systems.structure.equations import Equations
    from dynkit.systems.structure.functions import Form


WATCHED = 6
"""Number of coefficients of a guard."""


@final
@dataclass(frozen=True)
class Plan:
    """Everything that determines the compiled code of a mode, without the values of numbers.

    Attributes
    ----------
    equations : Equations
    kinds : tuple of int
        For each number its value, if that is 0, 1 or -1 and compiled as a constant; 2 for a number
        that is a runtime parameter.
    stops, rubs : tuples of (int, int)
        Elements whose gap (`stops`) or only whose slip velocity (`rubs`) replaces a coordinate, and
        the number of this coordinate.
    held, sticking : tuples of int
        Numbers of the elements that hold, and of those that stick.
    guards : tuple of int
        Element of each guard; guards of sliders come last.
    elements : int
        Number of elements.
    curves : tuple of (int, Form)
        Elements along functions of the coordinates, and these functions.
    sliders : tuple of int
        Elements with sliders. The stretches of their springs are variables; along functions they
        are so without the terms that the other coordinates determine.
    carries : bool
        Whether there are further variables: gaps along functions, their rates, slip velocities of
        sliders, and sine and cosine of the phase. In this case the variable of a spring is the
        remaining stretch until its slider yields.
    slips : tuple of (int, int)
        Slipping friction at the contact with a stop, and this stop.
    normals : tuple of (int, int)
        Friction at the contact with a stop, and this stop.
    dragged : tuple of int
        Friction whose slip velocity is a further variable, since other coordinates determine it.
    digits : int
        Bits by which the tolerance is below that for variables of order one, see `digits_of`.
    impacts : tuple of int
        Numbers of the guards that are gaps of stops in flight, which are never negative.
    careful : bool
        Whether an event that follows those of the guards is the rise of a gap to zero.
    """

    equations: Equations
    kinds: tuple[int, ...]
    stops: tuple[tuple[int, int], ...]
    rubs: tuple[tuple[int, int], ...]
    held: tuple[int, ...]
    sticking: tuple[int, ...]
    guards: tuple[int, ...]
    elements: int
    curves: tuple[tuple[int, Form], ...] = ()
    sliders: tuple[int, ...] = ()
    carries: bool = True
    slips: tuple[tuple[int, int], ...] = ()
    normals: tuple[tuple[int, int], ...] = ()
    dragged: tuple[int, ...] = ()
    digits: int = 0
    impacts: tuple[int, ...] = ()
    careful: bool = False

    @property
    def without_guards(self) -> Plan:
        """The same plan without guards, whose numbers come last, and without further variables."""
        kinds = self.kinds[: len(self.kinds) - WATCHED * len(self.guards)]
        return replace(self, kinds=kinds, guards=(), impacts=(), careful=False, carries=False)

    @property
    def size(self) -> int:
        """Number of parameters, including the phase and the frequency, which come first."""
        return self._first + len(self.kinds)

    @property
    def _first(self) -> int:
        return 2 + len(self.equations.numbers) + sum(len(form.numbers) for _, form in self.curves)

    def where(self, places: Sequence[int]) -> Plan:
        """The same plan, with the numbers at some places compiled as parameters."""
        kinds = list(self.kinds)
        for place in places:
            if place >= self._first:
                kinds[place - self._first] = 2
        return replace(self, kinds=tuple(kinds))

    @property
    def eliminates(self) -> bool:
        """Whether constraints are eliminated symbolically, as rows or masses are not constant."""
        acting = (*self.held, *self.sticking, *(k for k, _ in self.slips))
        held = any(k in acting for k, _ in self.curves)
        return held or not self.equations.constant_mass


def numbers_of(groups: Sequence[tuple[Array, Any]]) -> tuple[Array, tuple[int, ...]]:
    """All numbers as one array, and the kind of each.

    Each group has a mask of numbers that are never compiled as constants, as they differ between
    regimes.
    """
    flat = np.concatenate([np.asarray(group, dtype=float).ravel() for group, _ in groups])
    kinds = np.full(len(flat), 2)
    for value in (0, 1, -1):
        kinds[flat == value] = value
    kept = [np.broadcast_to(mask, np.shape(group)).ravel() for group, mask in groups]
    kinds[np.concatenate(kept)] = 2
    return flat, tuple(kinds.tolist())


@final
class _Leaves:
    """The numbers of a plan as heyoka's expressions, in the order of `numbers_of`."""

    def __init__(self, hy: Any, kinds: tuple[int, ...], first: int) -> None:
        self._hy, self._kinds, self._first, self._next = hy, kinds, first, 0

    def __call__(self, *shape: int) -> Any:
        """The next numbers, as an array of expressions of this shape."""
        count = math.prod(shape)
        places = range(self._next, self._next + count)
        self._next += count
        out = np.empty(count, dtype=object)
        for i, k in enumerate(places):
            kind = self._kinds[k]
            out[i] = float(kind) if kind != 2 else self._hy.par[self._first + k]
        return out.reshape(shape)


def _total(terms: Iterable[Any]) -> Any:
    """The sum of products, without products that are zero."""
    kept = [a * b for a, b in terms if not (_zero(a) or _zero(b))]
    out = kept[0] if kept else 0.0
    for term in kept[1:]:
        out = out + term
    return out


def _zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0


@final
class _Builder:
    """Coordinates, elements and accelerations of a plan as expressions.

    For each element, `own` has sign, phasor (2), offset, drift, push, stiffness and damping. For
    each slider, `joints` has the rate of its spring's stretch divided by the slip velocity, 1 or 0;
    the side on which it is nearer to yielding; and the stretch at which it yields.
    """

    def __init__(self, hy: Any, plan: Plan) -> None:
        n, e = plan.equations.size, plan.elements
        self._plan, self._n = plan, n
        self.zx = [hy.expression(f"x{i}") for i in range(n)]
        self.zv = [hy.expression(f"v{i}") for i in range(n)]
        self._phase, self._rate = hy.par[0] + hy.par[1] * hy.time, hy.par[1]
        count = len(plan.equations.numbers)
        self._numbers = [hy.par[2 + i] for i in range(count)]
        first = 2 + count
        self._of_curves = []
        for _, form in plan.curves:
            self._of_curves.append([hy.par[first + i] for i in range(len(form.numbers))])
            first += len(form.numbers)
        self.leaves = _Leaves(hy, plan.kinds, first)
        self._forces = self.leaves(3, n)
        self._rows, self._own = self.leaves(e, n), self.leaves(e, 8)
        swings = (*self._forces[:2].ravel(), *self._own[:, 1:3].ravel())
        self._turns = plan.carries and not all(map(_zero, swings))
        if self._turns:
            self._sine, self._cosine = hy.expression("sine"), hy.expression("cosine")
        else:
            self._sine, self._cosine = hy.sin(self._phase), hy.cos(self._phase)
        self._joints = dict(zip(plan.sliders, self.leaves(len(plan.sliders), 3), strict=True))
        self.springs = {k: hy.expression(f"s{k}") for k in plan.sliders}
        self._places = dict(plan.stops)
        self._speeds = dict((*plan.stops, *plan.rubs))
        own, x, v = self._own, list(self.zx), list(self.zv)
        for k, p in self._places.items():
            x[p] = x[p] + own[k, 0] * (own[k, 3] + self.swing(k, 0))
        for k, p in self._speeds.items():
            v[p] = v[p] + own[k, 0] * (own[k, 4] + self.swing(k, 1))
        self.x, self.v = (_applied(self.leaves(n, n), part) for part in (x, v))
        parted = (k for k, _ in plan.curves if k not in plan.sliders)
        curves, sliders = [*parted, *plan.dragged], plan.sliders
        if not plan.carries:
            curves, sliders = [], ()
        self.gaps = {k: hy.expression(f"g{k}") for k in curves}
        self.slips = {k: hy.expression(f"u{k}") for k in (*sliders, *curves)}
        self._bends: dict[int, Any] = {}
        self._along: dict[int, Any] = {}
        self._curve()

    def _curve(self) -> None:
        """Functions, their gradients, and accelerations along them due to velocities alone."""
        from dynkit.systems.symbolic.taylor import series

        n = self._n
        for (k, form), numbers in zip(self._plan.curves, self._of_curves, strict=True):
            symbols = dict(zip(form.x, self.x, strict=True))
            symbols |= dict(zip(form.numbers, numbers, strict=True))
            found = series("the coordinate of an element", form.values, symbols)
            pairs = ((i, j) for i in range(n) for j in range(n))
            terms = ((found[1 + n + n * i + j], self.v[i] * self.v[j]) for i, j in pairs)
            self._along[k], self._rows[k] = found[0], found[1 : 1 + n]
            self._bends[k] = _total((a, b) for a, b in terms if not _nil(a))

    def swing(self, k: int, order: int) -> Any:
        """Displacement of an element (order 0), its rate (1) or its acceleration (2)."""
        real, imaginary = self._own[k, 1], self._own[k, 2]
        if order == 1:
            turned = _total([(real, self._cosine)]) - _total([(imaginary, self._sine)])
            return self._rate * turned
        still = _total([(real, self._sine), (imaginary, self._cosine)])
        return still if order == 0 else -1.0 * (self._rate * (self._rate * still))

    def gap(self, k: int) -> Any:
        """Gap of an element."""
        if k in self._places or k in self.gaps:
            return self.gaps[k] if k in self.gaps else self.zx[self._places[k]]
        along = self._along.get(k)
        along = _total(zip(self._rows[k], self.x, strict=True)) if along is None else along
        return self._own[k, 0] * (along - self._own[k, 3] - self.swing(k, 0))

    def stretch(self, k: int) -> Any:
        """Stretch of the spring to a slider."""
        _, side, reach = self._joints[k]
        if self._plan.carries:
            return side * (reach - self.springs[k])
        along = self._own[k, 0] * self._along[k] if k in self._along else 0.0
        return self.springs[k] + along

    def slip(self, k: int) -> Any:
        """Rate of the gap of an element."""
        if k in self._speeds or k in self.slips:
            return self.slips[k] if k in self.slips else self.zv[self._speeds[k]]
        along = _total(zip(self._rows[k], self.v, strict=True))
        return self._own[k, 0] * (along - self._own[k, 4] - self.swing(k, 1))

    def accelerations(self) -> tuple[list[Any], list[Any]]:
        """Accelerations, and the forces along the rows of holding and sticking elements."""
        from dynkit.systems.symbolic.taylor import series

        plan, n = self._plan, self._n
        equations, both = plan.equations, (*plan.held, *plan.sticking)
        symbols = dict(zip((*equations.x, *equations.v), (*self.x, *self.v), strict=True))
        symbols |= {equations.phase: self._phase, equations.rate: self._rate}
        symbols |= dict(zip(equations.numbers, self._numbers, strict=True))
        f = self._pushed(series("the energies", equations.force, symbols))
        moved = [self.swing(k, 2) for k in both]
        moved = [
            m - self._bends[k] if k in self._bends else m for k, m in zip(both, moved, strict=True)
        ]
        if plan.eliminates:
            mass = series("the energies", [m for row in equations.mass for m in row], symbols)
            matrix = np.array(mass, dtype=object).reshape(n, n)
            tractions = zip(plan.slips, self.leaves(len(plan.slips)), strict=True)
            slips = [(both.index(stop), self._rows[k], t) for (k, stop), t in tractions]
            return _constrained(matrix, f, self._rows, both, moved, slips)
        through, given = self.leaves(n, n), self.leaves(n, len(both))
        pull, stiff = self.leaves(len(both), n), self.leaves(len(both), len(both))
        known = [*f, *moved]
        a = _applied(np.concatenate([through, given], axis=1), known)
        return a, _applied(np.concatenate([pull, stiff], axis=1), known)

    def _pushed(self, f: list[Any]) -> list[Any]:
        """Forces `f` plus the excitation and the forces of the elements."""
        own, drives = self._own, (self._sine, self._cosine, 1.0)
        f = [f[i] + _total(zip(self._forces[:, i], drives, strict=True)) for i in range(self._n)]
        for k in range(self._plan.elements):
            parts = [(1.0, own[k, 5])]
            along = self.stretch if k in self.springs else self.gap
            parts += [(-1.0 * own[k, 6], along(k))] if not _zero(own[k, 6]) else []
            parts += [(-1.0 * own[k, 7], self.slip(k))] if not _zero(own[k, 7]) else []
            push = _total(parts)
            if not _zero(push):
                f = [f[i] + _total([(own[k, 0] * self._rows[k, i], push)]) for i in range(self._n)]
        return f

    def turning(self) -> tuple[list[Any], list[Any]]:
        """Sine and cosine of the phase, if they are variables, and their rates."""
        if not self._turns:
            return [], []
        rates = [self._rate * self._cosine, -1.0 * (self._rate * self._sine)]
        return [self._sine, self._cosine], rates

    def rates(self, a: list[Any]) -> list[Any]:
        """Rates of all variables but sine and cosine, from the accelerations (N,)."""
        plan = self._plan
        at_x = {p: k for k, p in self._places.items()}
        at_v = {p: k for k, p in self._speeds.items()}
        dx, dv = list(self.v), list(a)
        for p, k in at_x.items():
            dx[p] = 0.0 if k in plan.held else self.zv[p]
        for p, k in at_v.items():
            along = _total(zip(self._rows[k], a, strict=True))
            still = k in (*plan.held, *plan.sticking)
            dv[p] = 0.0 if still else self._own[k, 0] * (along - self.swing(k, 2))
        for k in plan.sliders:
            follows, side, _ = self._joints[k]
            share = -1.0 * (side * follows) if plan.carries else follows
            away = 0.0
            if k in self._along and not plan.carries:
                away = self._own[k, 0] * _total(zip(self._rows[k], self.v, strict=True))
            dx.append(share * self.slip(k) - away)
        for k, slip in self.slips.items():
            along = _total(zip(self._rows[k], a, strict=True)) - self.swing(k, 2)
            along = along + self._bends[k] if k in self._bends else along
            dx += [0.0 if k in (*plan.held, *plan.dragged) else slip] if k in self.gaps else []
            still = k in (*plan.held, *plan.sticking)
            dv.append(0.0 if still else self._own[k, 0] * along)
        return [*dx, *dv]

    def guard(self, watch: Any, k: int, press: list[Any]) -> Any:
        """A guard of an element: its coefficients times gap, rate, force, one, spring, normal."""
        terms = [(1.0, watch[3])]
        terms += [(watch[4], self.springs[k])] if k in self.springs else []
        terms += [(watch[0], self.gap(k))] if not _zero(watch[0]) else []
        terms += [(watch[1], self.slip(k))] if not _zero(watch[1]) else []
        if not _zero(watch[2]):
            number = (*self._plan.held, *self._plan.sticking).index(k)
            terms.append((watch[2] * self._own[k, 0], press[number]))
        if not _zero(watch[5]):
            stop = dict(self._plan.normals)[k]
            terms.append((watch[5] * self._own[stop, 0], press[self._plan.held.index(stop)]))
        return _total(terms)


def system_of(hy: Any, plan: Plan) -> tuple[list[Any], list[Any], list[Any]]:
    """The variables, their rates, and the guards, as heyoka's expressions.

    The variables are positions, springs of sliders, gaps along functions, velocities, slip
    velocities of sliders, rates of gaps along functions; and sine and cosine of the phase, if the
    plan has further variables, and harmonic forces or motions need them.
    """
    build = _Builder(hy, plan)
    a, press = build.accelerations()
    turns, turned = build.turning()
    rates = [hy.expression(d) if isinstance(d, float) else d for d in (*build.rates(a), *turned)]
    watches = build.leaves(len(plan.guards), WATCHED)
    pairs = zip(watches, plan.guards, strict=True)
    first = [*build.zx, *build.springs.values(), *build.gaps.values()]
    variables = [*first, *build.zv, *build.slips.values(), *turns]
    return variables, rates, [build.guard(watch, k, press) for watch, k in pairs]


def _applied(matrix: Any, values: list[Any]) -> list[Any]:
    """Products (m,) of a matrix (m, n) of expressions with values (n,)."""
    return [_total(zip(row, values, strict=True)) for row in matrix]


def _constrained(
    mass: Any,
    f: list[Any],
    rows: Any,
    both: tuple[int, ...],
    moved: list[Any],
    slips: list[tuple[int, Any, Any]],
) -> tuple[list[Any], list[Any]]:
    """Accelerations, and forces along the rows of holding and sticking elements, by elimination.

    `slips` has, for each slipping friction, the number of its normal force, its row, and its
    traction.
    """
    n, h = len(f), len(both)
    right = np.empty((n, 1 + h), dtype=object)
    right[:, 0] = f
    right[:, 1:] = rows[list(both)].T if h else np.empty((n, 0), dtype=object)
    for number, row, traction in slips:
        for i in range(n):
            right[i, 1 + number] = _total([(1.0, right[i, 1 + number]), (traction, row[i])])
    solved = _solved(mass, right)
    a, press = list(solved[:, 0]), list[Any]()
    if h:
        inner, outer = np.empty((h, h), dtype=object), np.empty((h, 1), dtype=object)
        for j, k in enumerate(both):
            for i in range(h):
                inner[j, i] = _total(zip(rows[k], solved[:, 1 + i], strict=True))
            outer[j, 0] = moved[j] - _total(zip(rows[k], a, strict=True))
        press = list(_solved(inner, outer)[:, 0])
        for i in range(n):
            a[i] = a[i] + _total(zip(solved[i, 1:], press, strict=True))
    return a, press


def _solved(matrix: Any, right: Any) -> Any:
    """Solution of a system of expressions whose principal minors are positive, by elimination."""
    a, b, n = matrix.copy(), right.copy(), len(matrix)
    for k in range(n):
        for i in range(k + 1, n):
            if _nil(a[i, k]):
                continue
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, n):
                a[i, j] = a[i, j] if _nil(a[k, j]) else a[i, j] - factor * a[k, j]
            for j in range(b.shape[1]):
                b[i, j] = b[i, j] if _nil(b[k, j]) else b[i, j] - factor * b[k, j]
    for k in reversed(range(n)):
        for j in range(b.shape[1]):
            left = b[k, j]
            for i in range(k + 1, n):
                if not (_nil(a[k, i]) or _nil(b[i, j])):
                    left = left - a[k, i] * b[i, j]
            b[k, j] = left if _nil(left) else left / a[k, k]
    return b


def _nil(value: Any) -> bool:
    return _zero(value) or str(value) in ("0", "0.0", "0.0000000000000000")
