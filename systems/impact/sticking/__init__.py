"""Periodic orbits of impact oscillators that stick."""
