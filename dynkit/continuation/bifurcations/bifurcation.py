"""Bifurcations of periodic orbits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from dynkit.continuation.bifurcations.criticality import Criticality, criticality
from dynkit.continuation.bifurcations.kinds import KINDS
from dynkit.continuation.bifurcations.switching import Place
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import Facts, Tabled, largest, measured, table, written
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.kinds import BifurcationKind

_Known = TypeVar("_Known")
_TURNING = BifurcationKind.NS, BifurcationKind.RS
# A bifurcation that is nearer to a point than this, in steps, is at the point.
_AT_POINT = 1e-6


def given(part: _Known | None, owner: str = "Branch") -> _Known:
    """Return a part that stores do not keep; ValueError when the result was loaded without it."""
    if part is None:
        raise ValueError(f"orbit must be given to {owner}.load to get orbits back; got None")
    return part


def borders_a_motion(admissible: NDArray[np.bool_], place: float) -> bool:
    """Whether the orbit of a point next to a place on a branch is a motion of the system."""
    # if a point is on the border itself, examine its neighbours on both sides
    before, after = math.ceil(place - _AT_POINT) - 1, math.floor(place + _AT_POINT) + 1
    return bool(admissible[np.clip(before, 0, len(admissible) - 1) : after + 1].any())


def shown(bifurcations: Iterable[Bifurcation]) -> str:
    """Return kinds and values in one line; inadmissible ones are marked."""
    return ", ".join(
        f"{b.kind} {measured(b.value, b.error, 6)}{'' if b.admissible else ' (inadmissible)'}"
        for b in bifurcations
    )


def table_of(bifurcations: Iterable[Bifurcation], name: str) -> list[str]:
    """Return bifurcations at values of a parameter as a list of one table, or no table."""
    rows = [
        (b.kind, f"{b.value:.12g}", largest(b.error), b.multiplier, b.admissible)
        for b in bifurcations
    ]
    heads = ("kind", name, "error", "critical multiplier", "admissible")
    return [table("Bifurcations", rows, heads)] if rows else []


@final
@dataclass(frozen=True, eq=False, repr=False)
class Bifurcation(Tabled):
    """A bifurcation on a branch, computed to rounding.

    Parameters
    ----------
    kind : BifurcationKind
        Saddle-node (fold), period doubling, Neimark-Sacker, branch point, resonance, Hopf, grazing
        or chatter border; it equals its text, ``"SN"`` ...
    parameter : str
        Name of the continuation parameter.
    value : float
        Value of the parameter at the bifurcation.
    error : float
        To first order a bound on the error of `value`. Infinite where a bifurcation of a map
        without a jacobian was only bisected.
    multiplier : complex or None
        The critical multiplier: 1, -1, or exp(i theta), with the error of theta; for an equilibrium
        the critical eigenvalue, 0 or i omega. None at GR and CB.
    direction : (m,) array
        Null vector of D(multiplier), in the unknowns of the orbit's problem; empty at GR and CB.
        Neither it nor `tangent` has an error estimate: Newton's method corrects the orbits that
        start along them.
    place : float
        Position on the branch: 3.5 is between points 3 and 4; below 0, or above the index of the
        last point, just beyond an end.
    touching : mapping of str to float
        At GR place and time of the contact, named by the problem; their errors are those of `own`,
        or of the unknowns where an impact vanishes.
    history : tuple of float
        Largest residual of the extended system before the first and after each Newton step.
    cost : Cost
    unknowns : (m,) array
        The solution of the equations of the orbit's problem.
    unknowns_error : (m,) array
        To first order bounds on the errors of the unknowns.
    own : (e,) array
        Additional unknowns of the condition: at NS theta, at RS the modulus of the
        multiplier, at HB the angular frequency, at GR those of the problem's condition.
    own_error : (e,) array
        To first order bounds on the errors of `own`.
    tangent : (m + 1,) array
        Direction of the branch, as a chord between points beside the bifurcation, of unit length in
        scaled unknowns, the parameter last.
    event : int
        Index of the problem's event; -1 at SN, BP, PD, NS, RS and HB.
    admissible : bool
        Whether the orbit is a motion of the system; at the borders GR and CB, whether a
        neighbouring point of the branch is one. Otherwise no motion of the system bifurcates.
    """

    kind: BifurcationKind
    parameter: str
    value: float
    error: float
    multiplier: complex | None
    direction: Any
    place: float
    touching: Mapping[str, float]
    history: tuple[float, ...]
    cost: Cost
    unknowns: Array
    unknowns_error: Array
    own: Array
    own_error: Array
    tangent: Array
    event: int
    admissible: bool
    _problem: Problem | None

    @cached_property
    def orbit(self) -> Any:
        """The `PeriodicOrbit`, or the `Equilibrium`, at the bifurcation."""
        return self.problem.solution(self.unknowns, np.array([self.value]), self.history[-1:])

    @property
    def rotation_number(self) -> float | None:
        """At NS and RS the angle of the critical multiplier over 2 pi, in (0, 1/2); otherwise None.

        For an orbit of n iterates it is the rotation number of the n-th iterate. At the bifurcation
        n closed curves are born, and the `OrbitLabel.rotation_number` of the quasi-periodic motion
        on them tends to this value. At RS it is a fraction j/k, and orbits of k periods are born.
        """
        if self.kind not in _TURNING or self.multiplier is None:
            return None
        return float(abs(np.angle(self.multiplier)) / (2.0 * np.pi))

    @property
    def rotation_error(self) -> float | None:
        """To first order a bound on the error of `rotation_number`; None without such a number."""
        if self.kind == BifurcationKind.RS:
            return 0.0
        return None if self.rotation_number is None else float(self.own_error[0] / (2.0 * np.pi))

    @property
    def problem(self) -> Problem:
        """The equations of the branch.

        Raises
        ------
        ValueError
            When the branch was loaded without an orbit.
        """
        return given(self._problem)

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters of the system at the bifurcation, by name."""
        parameters: Mapping[str, float] = self.orbit.system.parameters
        return parameters

    def switch(self) -> list[Any]:
        """Return an orbit on each branch that leaves here, for `continue_orbit`.

        At PD it is on the branch of twice the period, and at BP on the crossing branch. At HB it is
        on the branch of the periodic orbits that are born, and at GR on the branches with one
        impact more or less. The list is empty at SN, NS, RS and CB, and at a GR for which the
        problem has no such orbit.

        Raises
        ------
        NoConvergence
            When no orbit is found on the branch that leaves a PD, BP or HB.
        """
        switch = KINDS[self.kind].switch
        return [] if switch is None else switch(self._place)

    @cached_property
    def criticality(self) -> Criticality | None:
        """The side on which orbits are born at SN, PD, NS or HB, and their stability.

        It is computed from second and third derivatives of the orbit's equations, at NS of the
        return map. None at the other kinds, on a level of an integral, where several multipliers
        are critical, at NS near a strong resonance or for an inadmissible orbit, and where there
        are no such derivatives. For flows it takes seconds.
        """
        kind = KINDS[self.kind]
        if kind.normal_form is None or self.multiplier is None:
            return None
        return criticality(self._place, self.multiplier, kind.normal_form, kind.supercritical)

    @property
    def _place(self) -> Place:
        y = np.append(self.unknowns, self.value)
        error = np.append(self.unknowns_error, self.error)
        return Place(self.problem, y, error, self.direction, self.tangent, self.event, self.own)

    def __repr__(self) -> str:
        turns = self.rotation_number
        rotation = "" if turns is None else f", rotation number {turns:.6g}"
        doubt = "" if self.admissible else ", inadmissible"
        value = measured(self.value, self.error, 12)
        return f"<{self.kind} at {self.parameter} {value}{rotation}{doubt}>"

    def _facts(self) -> Facts:
        return {
            "kind": KINDS[self.kind].title,
            self.parameter: measured(self.value, self.error, 12),
            "critical multiplier": written(self.multiplier),
            "rotation number": self.rotation_number,
            "admissible": self.admissible,
            "residual": largest(self.history[-1]),
            "cost": self.cost,
        }
