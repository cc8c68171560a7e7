"""Branches of periodic orbits."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.archive import ERROR, ends, error_known, identity_of, refuse_other_orbits
from dynkit.continuation.arclength import OrbitEquations
from dynkit.continuation.bifurcations import Bifurcation, given, shown, table_of
from dynkit.continuation.termination import Ending, Reason
from dynkit.core.cost import Cost
from dynkit.core.reprs import Facts, largest, told
from dynkit.core.smooth_map import SmoothMap
from dynkit.core.validation import Array, index_in
from dynkit.data.dataset import Dataset, Variables, described
from dynkit.data.result import Saved, read_result, write_result
from dynkit.data.store import Archive
from dynkit.orbits.newton import error_bound
from dynkit.orbits.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.orbits.problem import PeriodicOrbit


@final
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Branch(Saved):
    """Periodic orbits that hang together as one parameter changes, made by `continue_orbit`.

    Its k points stand in the order in which the curve is run through; orbits are made of them when
    asked for. All arrays are read-only.

    Parameters
    ----------
    name : str
        Name of the parameter.
    label : str
        What kind of orbits they are, such as ``P(2)`` or ``P(1,3)``.
    parameter : (k,) array
        Values of the parameter.
    unknowns : (k, m) array
        Solutions of the orbits' equations.
    multipliers : (k, d) array of complex
        Floquet multipliers, the largest modulus first.
    admissible : (k,) array of bool
        Whether the orbits are motions of the system.
    residuals : (k,) array
        Largest residual of each point's equations.
    bifurcations : tuple of Bifurcation
        In the order of the points.
    endings : (Ending, Ending)
        Why and where it ends: at the first point, and at the last.
    cost : Cost
        What it cost; of bifurcations that each carries itself, it holds only the seconds.

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
        *("bifurcations", "endings", "cost", "error"),
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
    _system: SmoothMap | None
    _observables: dict[str, Array] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        for name in ("parameter", "unknowns", "multipliers", "admissible", "residuals"):
            getattr(self, name).setflags(write=False)

    @cached_property
    def stable(self) -> NDArray[np.bool_]:
        """Whether all multipliers lie inside the unit circle, (k,), read-only."""
        stable = np.asarray(np.all(abs(self.multipliers) < 1.0, axis=1))
        stable.setflags(write=False)
        return stable

    @property
    def closed(self) -> bool:
        """Whether it is closed on itself; the last point is then the first again."""
        return self.endings[0].reason is Reason.CLOSED

    @cached_property
    def error(self) -> Array:
        """To first order a bound on the distance from the exact curve, (k,), read-only.

        The parameter is measured in its range, the unknowns in their typical sizes.
        """
        low, high = float(self.parameter.min()), float(self.parameter.max())
        equations = OrbitEquations(self.problem, high - low or 1.0)
        points = np.column_stack([self.unknowns, self.parameter])
        error = np.array([_distance(equations, y) for y in points])
        error.setflags(write=False)
        return error

    @cached_property
    def multipliers_error(self) -> Array:
        """Estimate of the error of each multiplier, (k, d), read-only.

        As `PeriodicOrbit.multipliers_error`; points may be off as they may from the exact curve.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        from dynkit.orbits.multiplier_errors import multiplier_errors

        width = float(np.ptp(self.parameter)) or 1.0
        equations = OrbitEquations(self.problem, width)
        rows = []
        for x, p, found in zip(self.unknowns, self.parameter, self.multipliers, strict=True):
            moved = _moved(equations, np.append(x, p))
            rows.append(multiplier_errors(self.problem, x, np.array([p]), found, moved))
        error = np.array(rows)
        error.setflags(write=False)
        return error

    @property
    def problem(self) -> Problem:
        """The equations of its orbits.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        return given(self._problem)

    @property
    def system(self) -> SmoothMap:
        """The system, at one value of the parameter.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        return given(self._system)

    def __len__(self) -> int:
        return len(self.parameter)

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
            "system": self._system and told(self._system, 6, [self.name]),
            self.name: self.parameter,
            "stable": self.stable,
            "admissible": self.admissible,
            "begins where": self.endings[0],
            "ends where": self.endings[1],
            "residual": largest(self.residuals),
            "cost": self.cost,
        }

    def _tables(self) -> list[str]:
        return table_of(self.bifurcations, self.name)

    def orbit(self, place: int) -> PeriodicOrbit:
        """Return the orbit of a point; negative places count from the end.

        Raises
        ------
        ValueError
            When there is no such point, or the branch was loaded without an orbit.
        """
        place = index_in("place", place, -len(self), len(self) - 1)
        p = self.parameter[[place]]
        return self.problem.orbit(self.unknowns[place], p, (float(self.residuals[place]),))

    def observable(self, name: str) -> Array:
        """Return one of the system's observables at all orbits, (k, n), read-only.

        Raises
        ------
        ValueError
            When there is no such observable, or the branch was loaded without an orbit.
        """
        if name not in self._observables:
            values = np.array([self.orbit(i).observable(name) for i in range(len(self))])
            values.setflags(write=False)
            self._observables[name] = values
        return self._observables[name]

    def plot(self, ax: Axes | None = None, y: str | None = None) -> Axes:
        """Draw an observable against the parameter, and return the axes.

        Stable orbits are solid, unstable ones dashed, inadmissible ones dotted. Bifurcations carry
        their kinds: those of motions of the system beside circles, the others, in brackets, beside
        crosses.

        Parameters
        ----------
        ax : Axes, optional
            Where; a new figure otherwise.
        y : str, optional
            Name of an observable; the system's first one otherwise.
        """
        from dynkit.continuation.drawing import draw_branch

        return draw_branch(self, ax, y)

    def dataset(self) -> Dataset:
        """Return its points as a dataset.

        Dimensions are ``point``, ``multiplier``, ``unknown``, ``state`` and ``bifurcation``. Where
        orbits can be made of it, what `plot` draws by default is in it: the first observable.
        """
        each = "point"
        drawn: Variables = {}
        if self._problem is not None:
            name = self.system.observables[0]
            drawn = {name: ((each, "state"), self.observable(name))}
        return Dataset(
            {self.name: (each, self.parameter)},
            {
                "stable": (each, self.stable),
                "admissible": (each, self.admissible),
                **drawn,
                "multiplier": ((each, "multiplier"), self.multipliers),
                "unknowns": ((each, "unknown"), self.unknowns),
                "residual": (each, self.residuals),
                **error_known(self),
                **of_bifurcations(self.bifurcations),
            },
            described(
                f"Branch of {self.label}",
                cost=self.cost,
                error=ERROR,
                system=self._system,
                swept=(self.name,),
                **ends(self.endings),
            ),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a store (HDF5); the file is the new one, or after any failure the old one.

        Raises
        ------
        ValueError
            When it cannot be written there, the system cannot be told from others, or the branch
            was loaded without an orbit.
        """
        write_result(path, self, identity_of(self.system, self.first()))

    @classmethod
    def load(cls, path: str | os.PathLike[str], orbit: PeriodicOrbit | None = None) -> Branch:
        """Read it from a store: the same bits.

        Parameters
        ----------
        path : path
        orbit : PeriodicOrbit, optional
            Any orbit of the same kind of the same system, at any value of the branch's parameter;
            needed for whatever makes orbits.

        Raises
        ------
        ValueError
            When the file is missing, damaged or no store of a branch, or the orbit is of another
            kind or system.
        """
        branch, file, archive = read_result(path, cls)
        return branch if orbit is None else branch.with_orbits(file, archive, orbit, branch.first())

    def with_orbits(
        self, file: Path, archive: Archive, orbit: PeriodicOrbit, free: Mapping[str, float]
    ) -> Branch:
        """Return it, which was read, as a branch that makes orbits like the one given.

        The store names its system with the parameter at the value that is given as free.

        Raises
        ------
        ValueError
            When the orbit is of another kind or system than that of the store.
        """
        refuse_other_orbits(file, archive, self.label, self.unknowns, orbit, free)
        problem = orbit.problem(self.name)
        bifurcations = tuple(
            dataclasses.replace(found, _problem=problem) for found in self.bifurcations
        )
        branch = dataclasses.replace(
            self, bifurcations=bifurcations, _problem=problem, _system=orbit.system
        )
        vars(branch)["error"] = self.error
        return branch

    def first(self) -> dict[str, float]:
        """Return the parameter's first value, by its name."""
        return {self.name: float(self.parameter[0])}


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


def _distance(equations: OrbitEquations, y: Array) -> float:
    return float((_moved(equations, y) / equations.scale(y)).max())


def _moved(equations: OrbitEquations, y: Array) -> Array:
    """How far each unknown and the parameter may be from the curve, (m + 1,)."""
    scale = equations.scale(y)
    jacobian = equations.jacobian(y)
    tangent = np.linalg.svd(jacobian * scale)[2][-1]
    return error_bound(equations, jacobian, y, scale, tangent)
