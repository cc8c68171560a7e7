"""What is measured on attractors and sweeps."""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.analysis.chatter import ChatterRatios
    from dynkit.analysis.diagram import BifurcationDiagram
    from dynkit.analysis.dimension.dimension import CorrelationDimension
    from dynkit.analysis.lyapunov import LyapunovSpectrum
    from dynkit.analysis.pod import POD
    from dynkit.analysis.sections import ImpactSection, StroboscopicSection
    from dynkit.analysis.sensitivity import Sensitivity
    from dynkit.analysis.series import TimeSeries
    from dynkit.analysis.space_time import SpaceTime
    from dynkit.analysis.spectrum import PowerSpectrum
    from dynkit.analysis.work_precision.exact import ExactImpacts
    from dynkit.analysis.work_precision.measuring import WorkPrecision
    from dynkit.analysis.work_precision.methods import FoundImpacts, ImpactMethod
    from dynkit.analysis.work_precision.standard_methods import impact_methods

__all__ = [
    "POD",
    "BifurcationDiagram",
    "ChatterRatios",
    "CorrelationDimension",
    "ExactImpacts",
    "FoundImpacts",
    "ImpactMethod",
    "ImpactSection",
    "LyapunovSpectrum",
    "PowerSpectrum",
    "Sensitivity",
    "SpaceTime",
    "StroboscopicSection",
    "TimeSeries",
    "WorkPrecision",
    "impact_methods",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "BifurcationDiagram": "dynkit.analysis.diagram",
        "ChatterRatios": "dynkit.analysis.chatter",
        "CorrelationDimension": "dynkit.analysis.dimension.dimension",
        "ExactImpacts": "dynkit.analysis.work_precision.exact",
        "FoundImpacts": "dynkit.analysis.work_precision.methods",
        "ImpactMethod": "dynkit.analysis.work_precision.methods",
        "ImpactSection": "dynkit.analysis.sections",
        "LyapunovSpectrum": "dynkit.analysis.lyapunov",
        "POD": "dynkit.analysis.pod",
        "PowerSpectrum": "dynkit.analysis.spectrum",
        "Sensitivity": "dynkit.analysis.sensitivity",
        "SpaceTime": "dynkit.analysis.space_time",
        "StroboscopicSection": "dynkit.analysis.sections",
        "TimeSeries": "dynkit.analysis.series",
        "WorkPrecision": "dynkit.analysis.work_precision.measuring",
        "impact_methods": "dynkit.analysis.work_precision.standard_methods",
    },
)
