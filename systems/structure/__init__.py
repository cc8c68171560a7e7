"""Structures from their energies: equations of motion, matrices, modes."""
