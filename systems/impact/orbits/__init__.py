"""Periodic orbits of impact oscillators."""
