"""Sweeps of one parameter, planes of two parameters, and basins of attraction."""

from dynkit.sweeps.sweeping import Sweep, sweep

__all__ = ["Sweep", "sweep"]
