"""Basins of attraction: the attractor of each start."""

from dynkit.sweeps.basins.basin import Basin
from dynkit.sweeps.basins.finding import basins
from dynkit.sweeps.basins.result import Basins

__all__ = ["Basin", "Basins", "basins"]
