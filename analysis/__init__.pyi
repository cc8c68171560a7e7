# Public names and the modules that define them, for type checkers and for lazy_loader.
from .annotation import mark_values as mark_values
from .chatter import ChatterRatios as ChatterRatios
from .diagram import BifurcationDiagram as BifurcationDiagram
from .dimension.dimension import CorrelationDimension as CorrelationDimension
from .histogram import Histogram as Histogram
from .lyapunov import LyapunovSpectrum as LyapunovSpectrum
from .measures import Measures as Measures, measure as measure
from .pod import POD as POD
from .running import (
    Running as Running,
    RunningExponents as RunningExponents,
    RunningHistogram as RunningHistogram,
    RunningPOD as RunningPOD,
    RunningSample as RunningSample,
    RunningSpectrum as RunningSpectrum,
)
from .sections import ImpactSection as ImpactSection, StroboscopicSection as StroboscopicSection
from .sensitivity import Sensitivity as Sensitivity
from .series import TimeSeries as TimeSeries
from .space_time import SpaceTime as SpaceTime
from .spectrum import PowerSpectrum as PowerSpectrum
from .work_precision.exact import ExactImpacts as ExactImpacts
from .work_precision.measuring import WorkPrecision as WorkPrecision
from .work_precision.methods import FoundImpacts as FoundImpacts, ImpactMethod as ImpactMethod
from .work_precision.standard_methods import impact_methods as impact_methods
