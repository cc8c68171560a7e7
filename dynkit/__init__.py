"""A toolkit for dynamical systems with impacts.

What is simulated stands in `dynkit.systems`, what is measured in `dynkit.analysis`. Every name here
is imported when it is first used, so that ``import dynkit`` stays light.
"""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.attraction import Basin, Basins, basins
    from dynkit.attractors import Attractor, MapAttractor
    from dynkit.continuation.bifurcations import Bifurcation
    from dynkit.continuation.branch import Branch
    from dynkit.continuation.continuing import continue_orbit
    from dynkit.continuation.curves import BifurcationCurve, continue_curve
    from dynkit.continuation.exploring import explore
    from dynkit.continuation.network import Network
    from dynkit.continuation.newton import NoConvergence
    from dynkit.continuation.orbit_search import OrbitSearch, find_orbits
    from dynkit.exponential.sums import ExponentialSum
    from dynkit.flows import Flow
    from dynkit.labels import OrbitLabel
    from dynkit.map_orbits import MapOrbit, periodic_orbit
    from dynkit.maps import Map
    from dynkit.no_motion import (
        CannotFollow,
        Diverged,
        NoCrossing,
        NoMotion,
        Refused,
        TangentCrossing,
    )
    from dynkit.orbits import PeriodicOrbit
    from dynkit.parameter_maps import ParameterMap, parameter_map
    from dynkit.results import Cost
    from dynkit.sections import Hyperplane, PoincareMap, PoincareSection, Stroboscope
    from dynkit.sweeps import Sweep, sweep
    from dynkit.workers import WorkerLost

__version__ = "0.1.0"

__all__ = [
    "Attractor",
    "Basin",
    "Basins",
    "Bifurcation",
    "BifurcationCurve",
    "Branch",
    "CannotFollow",
    "Cost",
    "Diverged",
    "ExponentialSum",
    "Flow",
    "Hyperplane",
    "Map",
    "MapAttractor",
    "MapOrbit",
    "Network",
    "NoConvergence",
    "NoCrossing",
    "NoMotion",
    "OrbitLabel",
    "OrbitSearch",
    "ParameterMap",
    "PeriodicOrbit",
    "PoincareMap",
    "PoincareSection",
    "Refused",
    "Stroboscope",
    "Sweep",
    "TangentCrossing",
    "WorkerLost",
    "__version__",
    "basins",
    "continue_curve",
    "continue_orbit",
    "explore",
    "find_orbits",
    "parameter_map",
    "periodic_orbit",
    "sweep",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Attractor": "dynkit.attractors",
        "Basin": "dynkit.attraction",
        "Basins": "dynkit.attraction",
        "Bifurcation": "dynkit.continuation.bifurcations",
        "BifurcationCurve": "dynkit.continuation.curves",
        "CannotFollow": "dynkit.no_motion",
        "Branch": "dynkit.continuation.branch",
        "Cost": "dynkit.results",
        "Diverged": "dynkit.no_motion",
        "ExponentialSum": "dynkit.exponential.sums",
        "Flow": "dynkit.flows",
        "Hyperplane": "dynkit.sections",
        "Map": "dynkit.maps",
        "MapAttractor": "dynkit.attractors",
        "MapOrbit": "dynkit.map_orbits",
        "Network": "dynkit.continuation.network",
        "NoConvergence": "dynkit.continuation.newton",
        "NoCrossing": "dynkit.no_motion",
        "NoMotion": "dynkit.no_motion",
        "OrbitLabel": "dynkit.labels",
        "OrbitSearch": "dynkit.continuation.orbit_search",
        "ParameterMap": "dynkit.parameter_maps",
        "PeriodicOrbit": "dynkit.orbits",
        "PoincareMap": "dynkit.sections",
        "PoincareSection": "dynkit.sections",
        "Refused": "dynkit.no_motion",
        "Stroboscope": "dynkit.sections",
        "Sweep": "dynkit.sweeps",
        "TangentCrossing": "dynkit.no_motion",
        "WorkerLost": "dynkit.workers",
        "basins": "dynkit.attraction",
        "continue_curve": "dynkit.continuation.curves",
        "continue_orbit": "dynkit.continuation.continuing",
        "explore": "dynkit.continuation.exploring",
        "find_orbits": "dynkit.continuation.orbit_search",
        "parameter_map": "dynkit.parameter_maps",
        "periodic_orbit": "dynkit.map_orbits",
        "sweep": "dynkit.sweeps",
    },
)
