"""Equations of orbits P(inf,m): passages from one release to the next."""
