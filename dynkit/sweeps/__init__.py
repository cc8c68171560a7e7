"""Following sweeps: one parameter through many values, each starting where the last one ended."""

from dynkit.sweeps.result import Sweep
from dynkit.sweeps.sweeping import sweep

__all__ = ["Sweep", "sweep"]
