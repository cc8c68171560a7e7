"""Correlation sums and the correlation dimension."""
