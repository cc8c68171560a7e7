"""Tests of structures: energies, matrices, modes."""
