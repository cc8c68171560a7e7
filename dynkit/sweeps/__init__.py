"""Sweeps of one parameter, planes of two parameters, and basins of attraction."""

from dynkit.sweeps.result import Sweep
from dynkit.sweeps.sweeping import sweep

__all__ = ["Sweep", "sweep"]
