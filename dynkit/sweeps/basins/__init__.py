"""Basins of attraction: which start leads to which attractor."""

from dynkit.sweeps.basins.basin import Basin
from dynkit.sweeps.basins.finding import basins
from dynkit.sweeps.basins.result import Basins

__all__ = ["Basin", "Basins", "basins"]
