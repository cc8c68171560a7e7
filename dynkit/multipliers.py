"""Floquet multipliers: eigenvalues of long products of matrices."""
