"""Periodic orbits of maps."""
