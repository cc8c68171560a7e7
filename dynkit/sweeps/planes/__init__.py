"""Maps of two parameters: the kind of motion at each pair of values."""

from dynkit.sweeps.planes.mapping import ParameterMap, parameter_map

__all__ = ["ParameterMap", "parameter_map"]
