"""Structures from their energies: Lagrangian, matrices, modes."""
