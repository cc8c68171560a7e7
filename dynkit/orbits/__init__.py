"""Periodic orbits: their equations, Newton's method, multipliers, searches."""
