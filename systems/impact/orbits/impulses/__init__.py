"""Equations of orbits P(n,m): phases and impulses, by periodic impulse responses."""
