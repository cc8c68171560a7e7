"""Maps of two parameters: what kind of motion there is at each pair of values."""

from dynkit.parameter_maps.mapping import parameter_map
from dynkit.parameter_maps.result import ParameterMap

__all__ = ["ParameterMap", "parameter_map"]
