"""Records of motions, and results from them: time averages, energies, counts, figures."""
