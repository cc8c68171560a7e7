"""Branches of periodic orbits in their parameters."""
