"""Continuation of periodic orbits and equilibria in parameters."""
