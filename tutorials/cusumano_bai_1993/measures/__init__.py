"""Table 1, and the modes of figures 14 and 15."""
