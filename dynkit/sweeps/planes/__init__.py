"""Maps of two parameters: what kind of motion there is at each pair of values."""

from dynkit.sweeps.planes.mapping import parameter_map
from dynkit.sweeps.planes.result import ParameterMap

__all__ = ["ParameterMap", "parameter_map"]
