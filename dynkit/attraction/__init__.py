"""Basins of attraction: which start leads to which attractor."""

from dynkit.attraction.finding import basins
from dynkit.attraction.result import Basin, Basins

__all__ = ["Basin", "Basins", "basins"]
