"""Runs of structures whose energies are not quadratic, by Taylor's method."""
