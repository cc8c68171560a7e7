"""Records of motions and what they measure: time averages, energies, counts, figures."""
