"""A toolkit for dynamical systems with impacts.

What is simulated stands in `dynkit.systems`, what is measured in `dynkit.analysis`. Every name here
is imported when it is first used, so that ``import dynkit`` stays light.
"""

from typing import TYPE_CHECKING

from dynkit._lazy import lazy_names

if TYPE_CHECKING:
    from dynkit.attractors import Attractor, MapAttractor
    from dynkit.exponential.sums import ExponentialSum
    from dynkit.flows import Flow
    from dynkit.labels import OrbitLabel
    from dynkit.maps import Map
    from dynkit.results import Cost
    from dynkit.sections import Hyperplane, PoincareMap, PoincareSection, Stroboscope
    from dynkit.sweeps import Sweep, sweep

__version__ = "0.1.0"

__all__ = [
    "Attractor",
    "Cost",
    "ExponentialSum",
    "Flow",
    "Hyperplane",
    "Map",
    "MapAttractor",
    "OrbitLabel",
    "PoincareMap",
    "PoincareSection",
    "Stroboscope",
    "Sweep",
    "__version__",
    "sweep",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Attractor": "dynkit.attractors",
        "Cost": "dynkit.results",
        "ExponentialSum": "dynkit.exponential.sums",
        "Flow": "dynkit.flows",
        "Hyperplane": "dynkit.sections",
        "Map": "dynkit.maps",
        "MapAttractor": "dynkit.attractors",
        "OrbitLabel": "dynkit.labels",
        "PoincareMap": "dynkit.sections",
        "PoincareSection": "dynkit.sections",
        "Stroboscope": "dynkit.sections",
        "Sweep": "dynkit.sweeps",
        "sweep": "dynkit.sweeps",
    },
)
