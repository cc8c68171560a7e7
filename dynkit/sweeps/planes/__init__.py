"""Maps of two parameters: the kind of motion at each pair of values."""

from dynkit.sweeps.planes.mapping import parameter_map
from dynkit.sweeps.planes.result import ParameterMap

__all__ = ["ParameterMap", "parameter_map"]
