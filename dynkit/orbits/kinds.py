"""Names of bifurcations."""

from enum import StrEnum
from typing import final


@final
class BifurcationKind(StrEnum):
    """Kind of a bifurcation; it equals its printed name: ``kind == "SN"``."""

    SN = "SN"
    """Saddle-node (fold): the branch turns back."""
    BP = "BP"
    """Branch point: another branch crosses."""
    PD = "PD"
    """Period doubling: a multiplier is -1."""
    NS = "NS"
    """Neimark-Sacker: a pair of complex multipliers is on the unit circle."""
    RS = "RS"
    """Resonance: multipliers of a conservative orbit are k-th roots of one, k from 3 to 6."""
    HB = "HB"
    """Hopf: a pair of complex eigenvalues of an equilibrium is on the imaginary axis."""
    GR = "GR"
    """Grazing: an impact appears or vanishes."""
    CB = "CB"
    """Chatter border: a chatter only just completes."""
