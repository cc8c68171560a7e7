"""Ends of branches and curves."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, final


class Reason(Enum):
    """Why a branch or a curve ends."""

    BOUND = "the bound was reached"
    CLOSED = "it is closed on itself"
    RETRACED = "it meets another branch, and its points come again behind"
    LIMIT = "the number of points was reached"
    NO_CONVERGENCE = "Newton's method does not converge"
    NEAR_REPETITION = "an orbit of a shorter period is too near"
    NO_SOLUTION = "the equations are not defined beyond"
    EQUILIBRIUM = "it shrinks to an equilibrium, at a Hopf bifurcation"
    RESONANCE = "a strong resonance is near"
    DOUBLE_ZERO = "two eigenvalues are nearly zero"
    SEPARATED = "beyond, the branches that cross come apart"
    BORDER = "beyond, there is no such orbit"
    INADMISSIBLE = "beyond, it is no motion of the system"


@final
@dataclass(frozen=True)
class Ending:
    """Why and where a branch or a curve ends.

    Parameters
    ----------
    reason : Reason
    message : str
        The reason in words, with the place.
    """

    reason: Reason
    message: str

    def __str__(self) -> str:
        return self.message


@final
class Bound(NamedTuple):
    """An interval [low, high] of an unknown; a curve ends where the unknown leaves it."""

    unknown: int
    name: str
    low: float
    high: float
    reason: Reason = Reason.BOUND
