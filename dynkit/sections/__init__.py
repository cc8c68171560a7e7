"""Poincare sections, and the map that a flow makes on one."""

from dynkit.sections.poincare_map import PoincareMap
from dynkit.sections.surfaces import Hyperplane, PoincareSection, Stroboscope

__all__ = ["Hyperplane", "PoincareMap", "PoincareSection", "Stroboscope"]
