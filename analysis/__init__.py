"""What is measured on attractors and sweeps."""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.analysis.chatter import ChatterRatios
    from dynkit.analysis.diagram import BifurcationDiagram
    from dynkit.analysis.pod import POD

__all__ = ["POD", "BifurcationDiagram", "ChatterRatios"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "BifurcationDiagram": "dynkit.analysis.diagram",
        "ChatterRatios": "dynkit.analysis.chatter",
        "POD": "dynkit.analysis.pod",
    },
)
