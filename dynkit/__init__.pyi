# Public names and the modules that define them, for type checkers and for lazy_loader.
from ._version import __version__ as __version__
from .continuation.bifurcations.bifurcation import Bifurcation as Bifurcation
from .continuation.bifurcations.criticality import Criticality as Criticality
from .continuation.continuing import continue_by as continue_by, continue_orbit as continue_orbit
from .continuation.curves import (
    BifurcationCurve as BifurcationCurve,
    continue_curve as continue_curve,
)
from .continuation.exploring import explore as explore
from .continuation.method import ContinuationMethod as ContinuationMethod
from .continuation.network import Network as Network
from .continuation.results.branch import Branch as Branch
from .core.cost import Cost as Cost
from .core.no_motion import (
    CannotFollow as CannotFollow,
    Diverged as Diverged,
    NoCrossing as NoCrossing,
    NoDerivative as NoDerivative,
    NoMotion as NoMotion,
    Refused as Refused,
    TangentCrossing as TangentCrossing,
)
from .core.parameters import Family as Family
from .data.dataset import Dataset as Dataset
from .dynamics.attractor import Attractor as Attractor, MapAttractor as MapAttractor
from .dynamics.equilibrium import Equilibrium as Equilibrium, equilibrium as equilibrium
from .dynamics.flow import Flow as Flow
from .dynamics.hybrid_flow import HybridFlow as HybridFlow, ResetMap as ResetMap
from .dynamics.map import Map as Map, Stream as Stream
from .dynamics.poincare_map import PoincareMap as PoincareMap
from .dynamics.section import (
    Hyperplane as Hyperplane,
    PoincareSection as PoincareSection,
    Stroboscope as Stroboscope,
)
from .engine import WorkerLost as WorkerLost
from .exponential.sums import ExponentialSum as ExponentialSum
from .labels.label import OrbitKind as OrbitKind, OrbitLabel as OrbitLabel
from .orbits.equations import Problem as Problem, ProblemSolution as ProblemSolution
from .orbits.events import WatchedProblem as WatchedProblem
from .orbits.families import (
    FamilyProblem as FamilyProblem,
    FamilySolution as FamilySolution,
    find_solution as find_solution,
)
from .orbits.harmonics import Harmonics as Harmonics
from .orbits.map_orbit import MapOrbit as MapOrbit
from .orbits.newton import NoConvergence as NoConvergence
from .orbits.periodic_orbit import periodic_orbit as periodic_orbit
from .orbits.problem import PeriodicOrbit as PeriodicOrbit, PeriodicProblem as PeriodicProblem
from .orbits.search import OrbitSearch as OrbitSearch, find_orbits as find_orbits
from .sweeps import Sweep as Sweep, sweep as sweep
from .sweeps.basins import Basin as Basin, Basins as Basins, basins as basins
from .sweeps.planes import ParameterMap as ParameterMap, parameter_map as parameter_map
from .viewer.page import Page as Page
from .viewer.viewing import view as view
