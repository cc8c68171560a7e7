"""Basins of attraction: the attractor of each start."""

from dynkit.sweeps.basins.finding import Basins, basins
from dynkit.sweeps.basins.matching import Basin

__all__ = ["Basin", "Basins", "basins"]
