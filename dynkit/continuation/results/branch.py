"""Branches of periodic orbits."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.bifurcations.bifurcation import Bifurcation, given, shown, table_of
from dynkit.continuation.orbit_equations import OrbitEquations, distance_from_curve
from dynkit.continuation.results.lines import Line, kinds_of, nodes_of
from dynkit.continuation.results.solution_curve import SolutionCurve
from dynkit.continuation.termination import Ending
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, system_repr
from dynkit.core.validation import Array, one_of, read_only
from dynkit.data.dataset import Dataset, Variables
from dynkit.orbits.equations import Problem
from dynkit.orbits.spectrum import Spectrum
from dynkit.viewer.page import Page
from dynkit.viewer.viewing import Viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.equations import ProblemSolution


@final
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Branch(Viewed, SolutionCurve):
    """Periodic orbits, or equilibria, along a parameter; made by `continue_orbit`.

    Its k points are in the order of the curve; `orbit` returns the orbit of a point. All arrays are
    read-only.

    Parameters
    ----------
    name : str
        Name of the parameter.
    label : str
        Label of the orbits, such as ``P(2)`` or ``P(1,3)``.
    parameter : (k,) array
        Values of the parameter.
    unknowns : (k, m) array
        Solutions of the orbits' equations.
    multipliers : (k, d) array of complex
        Floquet multipliers, the largest modulus first; for equilibria the eigenvalues, the largest
        real part first.
    admissible : (k,) array of bool
        Whether the orbits are motions of the system.
    residuals : (k,) array
        Largest residual of each point's equations.
    bifurcations : tuple of Bifurcation
        In the order of the points.
    endings : (Ending, Ending)
        Why and where the branch ends at its first point, and at its last.
    spectrum : Spectrum
        Whether `multipliers` are multipliers or eigenvalues.
    cost : Cost
        Cost of the branch; the Newton steps of bifurcations are in their costs only.

    Examples
    --------
    >>> from dynkit import continue_orbit, periodic_orbit
    >>> from dynkit.systems import Logistic
    >>> orbit = periodic_orbit(Logistic(rate=2.5), [0.6])
    >>> branch = continue_orbit(orbit, "rate", bounds=(2.0, 3.8))
    >>> branch.bifurcations
    (<PD at rate 3>,)
    >>> print(branch.endings[1])
    the bound was reached: rate 3.8
    >>> (doubled,) = branch.bifurcations[0].switch()
    >>> print(doubled.label, doubled.stable)
    P(2) True
    """

    _stored: ClassVar = (
        *("name", "label", "parameter", "unknowns", "multipliers", "admissible", "residuals"),
        *("bifurcations", "endings", "cost", "error", "spectrum"),
    )
    name: str
    label: str
    parameter: Array
    unknowns: Array
    multipliers: NDArray[np.complex128]
    admissible: NDArray[np.bool_]
    residuals: Array
    bifurcations: tuple[Bifurcation, ...]
    endings: tuple[Ending, Ending]
    cost: Cost
    _problem: Problem | None
    _system: Any
    spectrum: Spectrum = Spectrum.MULTIPLIERS
    _observables: dict[str, Array] = field(default_factory=dict, init=False)

    @property
    def _free(self) -> dict[str, Array]:
        return {self.name: self.parameter}

    @cached_property
    def stable(self) -> NDArray[np.bool_]:
        """Whether all multipliers lie inside the unit circle, (k,), read-only.

        For equilibria, whether all eigenvalues have negative real parts.
        """
        return read_only(np.asarray(np.all(self.spectrum.stable(self.multipliers), axis=1)))

    @cached_property
    def error(self) -> Array:
        """To first order a bound on the distance from the exact curve, (k,), read-only.

        The unit of the parameter is its range; the units of the unknowns are their typical sizes.
        The nearest exact orbit may be one at another value of the parameter: see `orbit_errors`.
        """
        return read_only(np.array([(moved / scale).max() for moved, scale in self._moved]))

    @cached_property
    def orbit_errors(self) -> Array:
        """The `error` of the orbit of each point, at exactly its `parameter`, (k,), read-only.

        It is in the units of the states, and larger than `error` where the branch is steep. Near a
        fold, where the nearest exact orbit is at another value of the parameter, it has no limit.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.

        Examples
        --------
        >>> from dynkit import continue_orbit, periodic_orbit
        >>> from dynkit.systems import Henon
        >>> orbit = periodic_orbit(Henon(a=-0.1, b=0.3), [2.0, 0.6])
        >>> branch = continue_orbit(orbit, "a", bounds=(-0.13, -0.05))
        >>> nearest = abs(branch.parameter + 0.1225).argmin()
        >>> bool(branch.orbit_errors[nearest] > 100 * branch.error[nearest])
        True
        """
        return read_only(np.array([self.orbit(k).error for k in range(len(self))]))

    @cached_property
    def multipliers_error(self) -> Array:
        """Estimate of the error of each multiplier, (k, d), read-only.

        As `PeriodicOrbit.multipliers_error`, for the distances of the points from the exact curve.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        from dynkit.orbits.multiplier_errors import multiplier_errors

        points = zip(self.unknowns, self.parameter, self.multipliers, self._moved, strict=True)
        errors = [
            multiplier_errors(self.problem, x, np.array([p]), found, moved)
            for x, p, found, (moved, _) in points
        ]
        return read_only(np.array(errors))

    @cached_property
    def _moved(self) -> list[tuple[Array, Array]]:
        """Errors of unknowns and parameter of each point, and their scales."""
        equations = OrbitEquations(self.problem, float(np.ptp(self.parameter)) or 1.0)
        rows = np.column_stack([self.unknowns, self.parameter])
        return [
            (distance_from_curve(equations, equations.jacobian(y), y), equations.scale(y))
            for y in rows
        ]

    @property
    def system(self) -> Any:
        return given(self._system)

    def __repr__(self) -> str:
        low, high = self.parameter.min(), self.parameter.max()
        found = shown(self.bifurcations[:6])
        more = ", ..." if len(self.bifurcations) > 6 else ""
        closed = "closed, " if self.closed else ""
        return (
            f"<Branch of {self.label}: {closed}{len(self)} points, "
            f"{self.name} from {low:.6g} to {high:.6g}{'; ' if found else ''}{found}{more}>"
        )

    def _facts(self) -> Facts:
        return {
            "system": self._system and system_repr(self._system, 6, [self.name]),
            self.name: self.parameter,
            "stable": self.stable,
            **super()._facts(),
        }

    def _tables(self) -> list[str]:
        return table_of(self.bifurcations, self.name)

    def observable(self, name: str) -> Array:
        """Return one of the system's observables at all orbits, (k, n), read-only.

        Raises
        ------
        ValueError
            When there is no such observable, or the branch was loaded without an orbit.
        """
        if str(name) not in self._observables:
            points = zip(self.unknowns, self.parameter[:, None], strict=True)
            values = np.array([self.problem.observed(x, p, name) for x, p in points])
            values.setflags(write=False)
            self._observables[name] = values
        return self._observables[name]

    def plot(self, ax: Axes | None = None, y: str | None = None) -> Axes:
        """Draw an observable against the parameter, and return the axes.

        Stable orbits are solid, unstable ones dashed, inadmissible ones dotted. Each kind of
        bifurcation has a symbol, which the legend explains; symbols of inadmissible ones are grey,
        and their kinds are in brackets. The label of the orbits is written beside the curve. A
        second branch can be drawn into the same axes.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure.
        y : str, optional
            Name of an observable; by default the system's first.

        Raises
        ------
        ValueError
            When there is no such observable, or the branch was loaded without an orbit.
        """
        from dynkit.continuation.results.drawing import draw_branches

        return draw_branches([self._line(y)], ax)

    @property
    def _default(self) -> str:
        """Name of the observable that is drawn by default."""
        first: str = self.orbit(0).observables[0]
        return first

    def _line(self, y: str | None) -> Line:
        """Return the line that is drawn, by default of the system's first observable."""
        name = self._default if y is None else one_of("y", y, self.orbit(0).observables)
        rows, nodes = self.observable(name), nodes_of(len(self), self.bifurcations)
        points = [
            (self.parameter[int(place)], rows[int(place)])
            if b is None
            else (b.value, b.orbit.observable(name))
            for place, b in nodes
        ]
        return Line(
            names=(self.name, name),
            nodes=nodes,
            x=np.array([x for x, _ in points]),
            y=np.array([row for _, row in points]),
            kinds=kinds_of(nodes, self.stable, self.admissible),
            label=self.label,
        )

    def _page(self, motions: int) -> Page:
        from dynkit.continuation.results.viewing import page_of

        title = f"Branch of {self.label} along {self.name}"
        return page_of(title, [self], None, motions)

    def dataset(self) -> Dataset:
        """Return the points as a dataset.

        Dimensions are ``point``, ``multiplier``, ``unknown``, ``state`` and ``bifurcation``. It
        contains the first observable, unless the branch was loaded without an orbit.
        """
        each = "point"
        drawn: Variables = {}
        if self._problem is not None:
            name = self._default
            drawn = {name: ((each, "state"), self.observable(name))}
        return Dataset(
            {self.name: (each, self.parameter)},
            {
                "stable": (each, self.stable),
                "admissible": (each, self.admissible),
                **drawn,
                "multiplier": ((each, "multiplier"), self.multipliers),
                "unknowns": ((each, "unknown"), self.unknowns),
                **self._checks(),
                **of_bifurcations(self.bifurcations),
            },
            self._attributes(f"Branch of {self.label}"),
        )

    def _replaced(self, problem: Problem, orbit: ProblemSolution) -> dict[str, Any]:
        found = tuple(dataclasses.replace(b, _problem=problem) for b in self.bifurcations)
        return {"bifurcations": found, "_problem": problem, "_system": orbit.system}


def of_bifurcations(found: Sequence[Bifurcation]) -> Variables:
    """Return the numbers of bifurcations as variables of a dataset."""
    kinds: dict[str, Any] = {
        "kind": "U2",
        "value": float,
        "admissible": bool,
        "error": float,
        "place": float,
    }
    columns = {name: np.array([getattr(b, name) for b in found], of) for name, of in kinds.items()}
    return {f"bifurcation_{name}": ("bifurcation", column) for name, column in columns.items()}
