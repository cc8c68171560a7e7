"""Curves of bifurcations in the plane of two parameters."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.arclength import Continuation
from dynkit.continuation.bifurcations.bifurcation import Bifurcation
from dynkit.continuation.bifurcations.kinds import condition_of
from dynkit.continuation.bifurcations.tracing import Trace, both_ways, joined
from dynkit.continuation.checks import checked_bounds, checked_method, problem_of
from dynkit.continuation.defining_systems import BifurcationEquations, CriticalMultiplier, merges
from dynkit.continuation.initial_tangents import start_points
from dynkit.continuation.orbit_equations import distance_from_curve
from dynkit.continuation.points import Point, cost_of
from dynkit.continuation.results.solution_curve import SolutionCurve
from dynkit.continuation.termination import Bound, Ending, Reason
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.no_motion import NoMotion
from dynkit.core.reprs import Facts
from dynkit.core.validation import Array, in_interval, of_type, regular_array
from dynkit.data.dataset import Dataset
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import is_admissible
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.newton import correct
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.viewer.page import Page

# A curve of NS ends where theta is closer to 0 or pi than this: its two equations become dependent.
# A curve of HB ends where the frequency falls below this fraction of its value at the start.
_RESONANCE = 1e-3
# A parameter that changes less than this along a curve, relative to its bounds, is constant.
_CHANGES = 1e-8


@final
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BifurcationCurve(Viewed, SolutionCurve):
    """Bifurcations of one kind as two parameters change, made by `continue_curve`.

    Its k points are in the order of the curve. All arrays are read-only.

    Parameters
    ----------
    kind : BifurcationKind
        Kind of the bifurcations.
    label : str
        Label of the orbits, such as ``P(2)`` or ``P(1,3)``.
    names : (str, str)
        Names of the two parameters.
    parameters : (k, 2) array
        Values of the two parameters.
    unknowns : (k, m) array
        Solutions of the orbits' equations.
    own : (k, e) array
        Additional unknowns of the condition: for NS the angle theta, for HB the frequency, (k, 1).
    admissible : (k,) array of bool
        Whether the orbits are motions of the system. On a curve of GR or CB, the border of
        admissibility, rounding may decide.
    residuals : (k,) array
        Largest residual of each point's equations.
    endings : (Ending, Ending)
        Why and where the curve ends at its first point, and at its last.
    cost : Cost

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from dynkit import continue_orbit, periodic_orbit
    >>> from dynkit.systems import Henon
    >>> orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    >>> (doubling,) = continue_orbit(orbit, "a", bounds=(0.1, 1.4)).bifurcations
    >>> curve = continue_curve(doubling, ("a", "b"), bounds=((0.0, 3.0), (-0.9, 0.9)), points=3)
    >>> with TemporaryDirectory() as folder:
    ...     store = Path(folder, "x.h5")
    ...     curve.save(store)
    ...     loaded = BifurcationCurve.load(store, orbit)
    >>> loaded
    <BifurcationCurve of PD: 5 points, a from 0.36... to 0.37..., b from 0.29... to 0.30...>
    >>> loaded.orbit(0).label
    'P(1)'
    """

    _stored: ClassVar = (
        *("kind", "label", "names", "parameters", "unknowns", "own", "admissible", "residuals"),
        *("endings", "cost", "error"),
    )
    kind: BifurcationKind
    label: str
    names: tuple[str, str]
    parameters: Array
    unknowns: Array
    own: Array
    admissible: NDArray[np.bool_]
    residuals: Array
    endings: tuple[Ending, Ending]
    cost: Cost
    _problem: Problem | None
    _event: int = -1
    _widths: Array | float = 1.0

    @property
    def _free(self) -> dict[str, Array]:
        return dict(zip(self.names, self.parameters.T, strict=True))

    @property
    def system(self) -> Any:
        """The system, with the parameters of the first point."""
        return self.orbit(0).system

    @cached_property
    def error(self) -> Array:
        """To first order a bound on the distance from the exact curve, (k,), read-only.

        It is the largest error of a parameter, unknown or `own` of the point. The unit of a
        parameter is its range along the curve, or the width of its bounds if it is constant. The
        units of the orbit's unknowns are their typical sizes. The unit of `own`, such as theta, is
        its magnitude, at least one.
        """
        ranges = np.ptp(self.parameters, axis=0)
        widths = np.where(ranges > _CHANGES * self._widths, ranges, self._widths)
        error = np.empty(len(self))
        for i, (x, own, p) in enumerate(zip(self.unknowns, self.own, self.parameters, strict=True)):
            condition, _ = condition_of(self.kind, self._event, self.problem, x, own, p, widths)
            equations = BifurcationEquations(self.problem, condition, widths)
            y = np.concatenate([x, own, p])
            off = distance_from_curve(equations, equations.full_jacobian(y), y)
            error[i] = (off / equations.scale(y)).max()
        error.setflags(write=False)
        return error

    def __repr__(self) -> str:
        ranges = ", ".join(
            f"{name} from {column.min():.6g} to {column.max():.6g}"
            for name, column in zip(self.names, self.parameters.T, strict=True)
        )
        closed = "closed, " if self.closed else ""
        return f"<BifurcationCurve of {self.kind}: {closed}{len(self)} points, {ranges}>"

    def _facts(self) -> Facts:
        return {
            **self._free,
            "orbits": self.label,
            **super()._facts(),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curve in the plane of its parameters, with the line style of its kind."""
        from dynkit.continuation.results.drawing import draw_curve

        return draw_curve(self.kind, self._free, ax)

    def _page(self, motions: int) -> Page:
        from dynkit.continuation.results.viewing import page_of_curve

        return page_of_curve(self, motions)

    def dataset(self) -> Dataset:
        """Return the points as a dataset.

        Dimensions are ``point``, ``unknown`` and ``condition``, that of `own`.
        """
        each = "point"
        return Dataset(
            {name: (each, column) for name, column in self._free.items()},
            {
                "admissible": (each, self.admissible),
                "unknowns": ((each, "unknown"), self.unknowns),
                "own": ((each, "condition"), self.own),
                **self._checks(),
            },
            self._attributes(f"Curve of {self.kind} of {self.label}"),
        )


def continue_curve(
    bifurcation: Bifurcation,
    parameters: tuple[str, str],
    *,
    bounds: tuple[tuple[float, float], tuple[float, float]],
    step: float = 0.01,
    largest_step: float = 0.05,
    points: int = 2000,
) -> BifurcationCurve:
    """Return the curve of bifurcations of one kind through a bifurcation, as two parameters change.

    A curve of BP continues as long as branches cross because of a symmetry, or of an orbit that
    exists for all parameters. Where a parameter breaks this, the branches separate and the curve
    ends, possibly at its start. A curve of SN, PD or NS ends at a GR where two events of the orbit
    merge: no such orbit exists beyond.

    Parameters
    ----------
    bifurcation : Bifurcation
        Start of the curve.
    parameters : (str, str)
        Names of the parameters that change.
    bounds : ((float, float), (float, float))
        Least and greatest value of each.
    step, largest_step, points : float, float, int
        As in `continue_orbit`.

    Returns
    -------
    BifurcationCurve
        The points in the order of the curve.

    Raises
    ------
    ValueError
        When the system has no such parameters, bounds are reversed, the bifurcation lies outside of
        them or was not solved for, or a number is out of range.

    Examples
    --------
    >>> from dynkit import continue_orbit, periodic_orbit
    >>> from dynkit.systems import Henon
    >>> orbit = periodic_orbit(Henon(a=0.2, b=0.3), [0.8, 0.2])
    >>> (doubling,) = continue_orbit(orbit, "a", bounds=(0.1, 1.4)).bifurcations
    >>> curve = continue_curve(doubling, ("a", "b"), bounds=((0.0, 3.0), (-0.9, 0.9)))
    >>> a, b = curve.parameters.T
    >>> bool(abs(a - 3.0 * (1.0 - b) ** 2 / 4.0).max() < 1e-12)
    True
    """
    began = time.perf_counter()
    of_type("bifurcation", bifurcation, Bifurcation, "one of a branch's bifurcations")
    of_type("parameters", parameters, Sequence, "two names")
    asked: tuple[str, ...] = tuple(parameters)
    if len(asked) != 2 or asked[0] == asked[1]:
        raise ValueError(f"parameters must be two names; got {parameters!r}")
    names = (asked[0], asked[1])
    if regular_array("bounds", bounds).ndim == 0 or len(bounds) != 2:
        raise ValueError(f"bounds must be two pairs of numbers; got {bounds!r}")
    ranges = [checked_bounds(f"bounds[{i}]", bounds[i]) for i in range(2)]
    problem = problem_of(bifurcation.orbit, names)
    for name, value, (low, high) in zip(names, problem.values, ranges, strict=True):
        in_interval(name, float(value), low, high)
    method = checked_method(step, largest_step, points)
    widths = np.array([high - low for low, high in ranges])
    start, equations = _start(bifurcation, problem, widths)
    first, _, first_p = equations.split(start.y)
    of_multiplier = isinstance(equations.condition, CriticalMultiplier)
    m, e = problem.size, equations.condition.unknowns
    limits = [
        Bound(m + e + i, name, *interval)
        for i, (name, interval) in enumerate(zip(names, ranges, strict=True))
    ]
    if bifurcation.kind is BifurcationKind.NS:
        limits.append(Bound(m, "theta", _RESONANCE, np.pi - _RESONANCE, Reason.RESONANCE))
    if bifurcation.kind is BifurcationKind.HB:
        least = _RESONANCE * float(start.y[m])
        limits.append(Bound(m, "frequency", least, np.inf, Reason.DOUBLE_ZERO))

    def follow(point: Point) -> Trace:
        near, found = equations.near(point.y), Trace()
        for each in Continuation(near, point, tuple(limits), method, _accept).shown():
            if isinstance(each, Ending):
                found.ending = each
                break
            x, _, p = equations.split(each.y)
            merged = of_multiplier and merges(problem, x, p, first, first_p)
            if merged or equations.is_unfolded(each.y):
                reason = Reason.BORDER if merged else Reason.SEPARATED
                last = ", ".join(f"{value:.6g}" for value in found.points[-1].y[m + e :])
                message = f"{reason.value}: {names[0]}, {names[1]} {last}"
                found.ending = Ending(reason, message)
                break
            found.points.append(each)
        return found

    found, endings = joined(*both_ways(start, follow))
    split = [equations.split(point.y) for point in found]
    return BifurcationCurve(
        kind=bifurcation.kind,
        label=bifurcation.orbit.label,
        names=names,
        parameters=np.array([p for _, _, p in split]),
        unknowns=np.array([x for x, _, _ in split]),
        own=np.array([own for _, own, _ in split]),
        admissible=np.array([is_admissible(problem, x, p) for x, _, p in split]),
        residuals=np.array([point.residual for point in found]),
        endings=endings,
        cost=cost_of(found, time.perf_counter() - began),
        _problem=problem,
        _event=bifurcation.event,
        _widths=widths,
    )


def _accept(_: Point, after: Point) -> tuple[Point, bool]:
    return after, True


def _start(
    bifurcation: Bifurcation, problem: Problem, widths: Array
) -> tuple[Point, BifurcationEquations]:
    kind, x, p = bifurcation.kind, bifurcation.unknowns, problem.values
    own = bifurcation.own
    if kind is BifurcationKind.NS:
        # the angle between 0 and pi of the conjugate pair
        own = np.arccos(np.cos(own))
    try:
        condition, own = condition_of(kind, bifurcation.event, problem, x, own, p, widths)
        equations = BifurcationEquations(problem, condition, widths)
        (start, *_) = start_points(equations, np.concatenate([x, own, p]))
    except NoMotion as refusal:
        raise ValueError(f"bifurcation must be solved for; got {refusal}") from refusal
    found = correct(equations, start.y, start.scale, start.tangent)
    if not found.converged:
        raise ValueError(f"bifurcation must be solved for; got {found.outcome.value}")
    return replace(start, y=found.y), equations
