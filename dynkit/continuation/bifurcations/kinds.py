"""Properties of each kind of bifurcation, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from dynkit.continuation.bifurcations.criticality import NormalForm, flip, fold, rotation
from dynkit.continuation.bifurcations.switching import Switch, born, crossing, doubled, neighbours
from dynkit.continuation.defining_systems import (
    BranchPoint,
    CriticalMultiplier,
    Fold,
    Hopf,
    NeimarkSacker,
    PeriodDoubling,
    Resonance,
)
from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.orbits.events import Condition, WatchedProblem
from dynkit.orbits.kinds import BifurcationKind
from dynkit.orbits.spectrum import Spectrum


@final
@dataclass(frozen=True)
class Kind:
    """Properties of a kind of bifurcation.

    Parameters
    ----------
    title : str
        Full name.
    line : line style
        Line style of its curves; dotted lines are reserved for inadmissible orbits.
    marker : str
        Its symbol on branches, a marker of matplotlib.
    defining_system : subclass of CriticalMultiplier, optional
        The condition in addition to the orbit's equations; by default that of the problem's event.
        A test function detects the bifurcations that have one, the others are events.
    switch : callable, optional
        Place -> orbits on the branches that leave there; by default none leave.
    critical : mapping of Spectrum to float
        The critical multiplier and eigenvalue, if it is the same for all bifurcations of the kind.
    jump : float
        A sign change at which the magnitude stays above this fraction of its value a step away is
        a jump, not a zero.
    normal_form : callable, optional
        Function for the coefficient of the normal form.
    supercritical : int
        Sign of this coefficient in the supercritical case; 0 where criticality is not defined.
    """

    title: str
    line: Any
    marker: str
    defining_system: type[CriticalMultiplier] | None = None
    switch: Switch | None = None
    critical: Mapping[Spectrum, float] = field(default_factory=dict)
    jump: float = 0.0
    normal_form: NormalForm | None = None
    supercritical: int = 0


_NEUTRAL = {spectrum: spectrum.neutral for spectrum in Spectrum}

KINDS: Mapping[BifurcationKind, Kind] = {
    BifurcationKind.SN: Kind(
        "saddle-node (fold)",
        "-",
        "s",
        defining_system=Fold,
        critical=_NEUTRAL,
        normal_form=fold,
    ),
    BifurcationKind.BP: Kind(
        "branch point",
        (0, (5, 2, 1, 2, 1, 2)),
        "P",
        defining_system=BranchPoint,
        switch=crossing,
        critical=_NEUTRAL,
    ),
    BifurcationKind.PD: Kind(
        "period doubling",
        (0, (5, 2)),
        "D",
        defining_system=PeriodDoubling,
        switch=doubled,
        critical={spectrum: -1.0 for spectrum in Spectrum if spectrum.periodic},
        normal_form=flip,
        supercritical=1,
    ),
    BifurcationKind.NS: Kind(
        "Neimark-Sacker",
        (0, (5, 2, 1, 2)),
        "^",
        defining_system=NeimarkSacker,
        normal_form=rotation,
        supercritical=-1,
    ),
    BifurcationKind.RS: Kind(
        "resonance",
        (0, (2, 2, 7, 2)),
        "v",
        defining_system=Resonance,
    ),
    BifurcationKind.HB: Kind(
        "Hopf",
        (0, (1.5, 1.5, 5, 1.5)),
        "p",
        defining_system=Hopf,
        switch=born,
        normal_form=rotation,
        supercritical=-1,
    ),
    # GR: the smallest gap of a flight jumps like a square root within 1e-9 of the border. CB: there
    # is no orbit beyond the last chatter that completes, so that the division of steps ends early.
    BifurcationKind.GR: Kind("grazing", (0, (3, 1.5)), "o", switch=neighbours, jump=1e-4),
    BifurcationKind.CB: Kind("chatter border", (0, (9, 2)), ">", jump=0.05),
}
"""The properties of each kind."""


def condition_of(
    kind: BifurcationKind,
    event: int,
    problem: Problem,
    x: Array,
    own: Array,
    p: Array,
    widths: Array,
) -> tuple[Condition, Array]:
    """Return the condition of a bifurcation, and a guess of its additional unknowns.

    Parameters
    ----------
    kind : BifurcationKind
    event : int
        Index of the problem's event, for GR and CB.
    problem : Problem
    x : (m,) array
        Unknowns of a near orbit.
    own : (e,) array
        For NS the angle, for HB the frequency, otherwise a guess or an empty array.
    p, widths : (k,) arrays
        The free parameters and their units.
    """
    system = KINDS[kind].defining_system
    if system is None:
        if not isinstance(problem, WatchedProblem):
            raise ValueError(f"problem must have events, for {kind}; got {problem!r}")
        condition, guess = problem.condition(event, x, p)
        return condition, (own if len(own) == condition.unknowns else guess)
    if not len(own):
        own = np.zeros(system.unknowns)
    return system(problem, x, own, p, widths), own
