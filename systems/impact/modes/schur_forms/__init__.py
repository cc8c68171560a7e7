"""Real Schur forms to 30 digits, with blocks for modes that merge."""
